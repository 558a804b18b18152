"""How logs are written: names, quota, flushing, rotation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dctorque_can.config.load import Config


@dataclass(frozen=True)
class LogFolder:
    """Where logs go.

    Attributes:
        directory: is made when it is missing.
        stem: first part of every name.
        first: exact path of the first log, or None for a name with the time of its start.
        quota_mb: all logs of this stem together; 0 for no limit.
    """

    directory: Path
    stem: str
    first: Path | None = None
    quota_mb: float = 0.0

    def next_path(self, count: int, now: datetime | None = None) -> Path:
        """Return a path that does not exist yet (``first`` excepted) for log number ``count`` (from 0)."""
        if self.first is not None and (count == 0 or (self.first.exists() and not self.first.is_file())):
            return self.first  # a device takes every log
        began = (now or datetime.now(UTC)).strftime("%Y%m%dT%H%M%SZ")
        return next(path for path in self._candidates(began) if not path.exists())

    def _candidates(self, began: str) -> Iterator[Path]:
        number = 1
        while True:
            suffix = "" if number == 1 else f"_{number}"
            yield self.directory / f"{self.stem}_{began}{suffix}.mcap"
            number += 1

    def make_room(self, current: Path) -> list[Path]:
        """Delete the oldest logs of this stem, never ``current``, until the quota holds; return what went."""
        if self.quota_mb <= 0:
            return []
        logs = [(path, path.stat()) for path in self.directory.glob(f"{self.stem}_*.mcap")]
        logs.sort(key=lambda log: (log[1].st_mtime_ns, log[0].name))
        used = sum(stat.st_size for _, stat in logs)
        gone = []
        for path, stat in logs:
            if used <= self.quota_mb * 1e6:
                break
            if path != current:
                path.unlink()
                used -= stat.st_size
                gone.append(path)
        return gone


@dataclass(frozen=True)
class LogPlan:
    """How logs are written.

    Attributes:
        folder: names and quota.
        flush_s: what a killed computer may lose.
        rotate_mb: size after which a new log begins; 0 for never.
        rotate_s: age after which a new log begins; 0 for never.
        signals: also write the decoded signals of every known message.
        metadata: named sets of words for every log.
    """

    folder: LogFolder
    flush_s: float
    rotate_mb: float
    rotate_s: float
    signals: bool
    metadata: Mapping[str, Mapping[str, str]]

    def as_json(self) -> dict[str, Any]:
        """Return the plan for `Kind.SETUP`."""
        folder = self.folder
        return {
            "directory": str(folder.directory),
            "stem": folder.stem,
            "first": None if folder.first is None else str(folder.first),
            "quota_mb": folder.quota_mb,
            "flush_s": self.flush_s,
            "rotate_mb": self.rotate_mb,
            "rotate_s": self.rotate_s,
            "signals": self.signals,
            "metadata": {name: dict(values) for name, values in self.metadata.items()},
        }

    @classmethod
    def from_json(cls, plan: Mapping[str, Any]) -> LogPlan:
        """Return what `as_json` gave."""
        first = plan["first"]
        folder = LogFolder(
            Path(plan["directory"]), plan["stem"], None if first is None else Path(first), plan["quota_mb"]
        )
        return cls(folder, plan["flush_s"], plan["rotate_mb"], plan["rotate_s"], plan["signals"], plan["metadata"])


def plan_for(config: Config, first: Path | None = None) -> LogPlan:
    """Return how ``config`` wants logs to be written; ``first`` is the exact path of the first one.

    Logs after ``first`` (SIGHUP, size, age) stand beside it.
    """
    settings = config.logging
    name = "".join(letter if letter.isalnum() else "_" for letter in config.name)
    folder = LogFolder(
        directory=Path(settings.directory) if first is None else first.parent,
        stem=name if first is None else first.stem,
        first=first,
        quota_mb=settings.keep_mb or 0.0,
    )
    return LogPlan(
        folder=folder,
        flush_s=settings.flush_ms / 1000,
        rotate_mb=settings.rotate_mb or 0.0,
        rotate_s=settings.rotate_s or 0.0,
        signals=settings.signals,
        metadata={"bus": {"interface": config.can.interface, "channel": str(config.can.channel)}},
    )
