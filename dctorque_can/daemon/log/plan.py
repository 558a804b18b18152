"""How logs are written: names, quota, flushing, rotation."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dctorque_can.daemon.log.quota import MARK, OwnLog, own_logs

if TYPE_CHECKING:
    from dctorque_can.config.load import Config

OWN_MARK = MARK
"""Name of the metadata by which a log of the service is known."""
STATE_NAME = "estimator.state"
"""Name of the document that holds the state with which a log begins."""


@dataclass(frozen=True)
class LogFolder:
    """Where logs go.

    Attributes:
        directory: is made when it is missing.
        stem: first part of every name.
        first: exact path of the first log, or None for a name with the time of its start.
        quota_mb: all logs of this vehicle and stem together; 0 for no limit.
        vehicle: whose logs they are; two vehicles may come to the same stem.
    """

    directory: Path
    stem: str
    first: Path | None = None
    quota_mb: float = 0.0
    vehicle: str = ""

    def next_path(self, count: int, now: datetime | None = None) -> Path:
        """Return a path that does not exist yet (``first`` excepted) for log number ``count`` (from 0)."""
        if self.first is not None and (count == 0 or (self.first.exists() and not self.first.is_file())):
            return self.first  # a device takes every log
        began = (now or datetime.now(UTC)).strftime("%Y%m%dT%H%M%SZ")
        return next(path for path in self._candidates(began) if not os.path.lexists(path))

    def _candidates(self, began: str) -> Iterator[Path]:
        number = 1
        while True:
            suffix = "" if number == 1 else f"_{number}"
            yield self.directory / f"{self.stem}_{began}{suffix}.mcap"
            number += 1

    def own_logs(self) -> list[OwnLog]:
        """Return the logs that are there already, the oldest first; those named by `first` do not count.

        Raises:
            OSError: the directory cannot be read.
        """
        return own_logs(self.directory, self.vehicle, self.stem)


@dataclass(frozen=True)
class LogPlan:
    """How logs are written.

    Attributes:
        folder: names and quota.
        flush_s: time from receiving to the hands of the operating system, at most.
        rotate_mb: size after which a new log begins; 0 for never.
        rotate_s: age after which a new log begins; 0 for never.
        signals: also write the decoded signals of every known message.
        metadata: named sets of words for every log.
        fsync_s: interval at which the disk must have everything; 0 for never.
        least_free_mb: of the disk, that stay free; 0 for none.
    """

    folder: LogFolder
    flush_s: float
    rotate_mb: float
    rotate_s: float
    signals: bool
    metadata: Mapping[str, Mapping[str, str]]
    fsync_s: float = 0.0
    least_free_mb: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """Return the plan for `Kind.SETUP`."""
        folder = self.folder
        return {
            "directory": str(folder.directory),
            "stem": folder.stem,
            "first": None if folder.first is None else str(folder.first),
            "quota_mb": folder.quota_mb,
            "vehicle": folder.vehicle,
            "flush_s": self.flush_s,
            "rotate_mb": self.rotate_mb,
            "rotate_s": self.rotate_s,
            "signals": self.signals,
            "metadata": {name: dict(values) for name, values in self.metadata.items()},
            "fsync_s": self.fsync_s,
            "least_free_mb": self.least_free_mb,
        }

    @classmethod
    def from_json(cls, plan: Mapping[str, Any]) -> LogPlan:
        """Return what `as_json` gave."""
        first = plan["first"]
        folder = LogFolder(
            Path(plan["directory"]),
            plan["stem"],
            None if first is None else Path(first),
            plan["quota_mb"],
            plan["vehicle"],
        )
        given = ("flush_s", "rotate_mb", "rotate_s", "signals", "metadata", "fsync_s", "least_free_mb")
        return cls(folder, *(plan[name] for name in given))


def bus_metadata(config: Config) -> dict[str, dict[str, str]]:
    """Return which buses a log is of: `bus`, and `bus 1`, … for further channels."""
    return {
        f"bus {bus.number}" if n else "bus": {"interface": bus.interface, "channel": str(bus.channel)}
        for n, bus in enumerate(config.buses)
    }


def plan_for(config: Config, first: Path | None = None) -> LogPlan:
    """Return how ``config`` wants logs to be written; ``first`` is the exact path of the first one.

    Logs after ``first`` (SIGUSR1, size, age) stand beside it.
    """
    settings = config.logging
    name = "".join(letter if letter.isalnum() else "_" for letter in config.name)
    folder = LogFolder(
        directory=Path(settings.directory) if first is None else first.parent,
        stem=name if first is None else first.stem,
        first=first,
        quota_mb=settings.keep_mb or 0.0,
        vehicle=config.name,
    )
    return LogPlan(
        folder=folder,
        flush_s=settings.flush_ms / 1000,
        rotate_mb=settings.rotate_mb or 0.0,
        rotate_s=settings.rotate_s or 0.0,
        signals=settings.signals,
        metadata=bus_metadata(config),
        fsync_s=settings.fsync_s or 0.0,
        least_free_mb=settings.least_free_mb or 0.0,
    )
