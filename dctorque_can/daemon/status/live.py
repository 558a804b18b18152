"""What the service is doing right now, for `dctorque status` and Prometheus: gathered once a second."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

from dctorque_can import __version__
from dctorque_can.analysis.health import COUNTERS, FAULTS, by_quantity, findings
from dctorque_can.analysis.message_faults import message_faults
from dctorque_can.analysis.origins import identifier_text
from dctorque_can.analysis.status_shares import BOTH_CLUTCHES
from dctorque_can.bus.addresses import at_term, read_addresses
from dctorque_can.config.identity import database_digest, vehicle_digest
from dctorque_can.config.load import Config
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.status.parts import Parts
from dctorque_can.daemon.status.process import StatusProcess

PERIOD_S = 1.0
MOST_FILES = 10  # logs that are told one by one, the latest
MOST_FAILURES = 5
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


class LiveStatus:
    """Gathers the status and hands it over, once in `PERIOD_S`.

    Args:
        process: that serves it.
        parts: of the service.
    """

    def __init__(self, process: StatusProcess, parts: Parts) -> None:
        self.process = process
        self._parts = parts
        self._messages = MessageAges(parts.config)
        self._due_s = self._began_s = time.monotonic()
        self._began_cpu_s = time.thread_time()
        self._before = (self._began_s, {"frames": 0, "estimates": 0, "published": 0})
        self._latest: tuple[int, float] | None = None
        self._of: Config | None = None
        self._configuration: dict[str, Any] = {}

    def begin(self, needed: bool, given_up: Callable[[], bool]) -> None:
        """Start the process; if the places are needed, wait until they can be reached.

        Raises:
            DctorqueError: they are needed, and one cannot be had.
        """
        self.process.begin()
        if needed:
            self.process.wait_until_open(given_up)

    def keep_time(self, now_s: float, frames: int, t_us: int | None, doing: Callable[[], str]) -> None:
        """Hand over a snapshot when it is time; to be called after every receive.

        Args:
            now_s: monotonic.
            frames: received since the start.
            t_us: time of the last of them; None before the first.
            doing: says in a few words what the service does.
        """
        if t_us is not None and (self._latest is None or t_us != self._latest[0]):
            self._latest = t_us, now_s
        if now_s < self._due_s:
            return
        self._due_s = now_s + PERIOD_S
        self._parts.latency.keep_time(now_s)
        self.process.publish(self.snapshot(now_s, frames, doing()))

    def snapshot(self, now_s: float, frames: int, state: str) -> dict[str, Any]:
        """Return the status as it is now."""
        parts = self._parts
        counts = {"frames": frames, "estimates": parts.shares.estimates, "published": parts.links.counts.sent}
        uptime_s = now_s - self._began_s
        cpu_s = time.thread_time() - self._began_cpu_s
        health = parts.chain.health
        return {
            "name": parts.config.name,
            "version": __version__,
            "pid": os.getpid(),
            "time": round(time.time(), 3),
            "uptime_s": round(uptime_s, 3),
            "state": state,
            "away": parts.links.away,
            "configuration": self._configuration_json(),
            "frames": frames,
            "estimates": counts["estimates"],
            "valid_estimates": parts.shares.having(BOTH_CLUTCHES),
            "rates_hz": self._rates(now_s, counts),
            "cpu_share": round(cpu_s / uptime_s, 4) if uptime_s > 0 else None,
            "memory_mb": _memory_mb(),
            "latency": parts.latency.as_json(),
            "status_time": parts.shares.time_as_json(),
            "messages": self._messages.as_json(parts.chain.told_us(), self._latest, now_s),
            "message_faults": message_faults(*parts.chain.messages),
            "buses": parts.buses_json(),
            **parts.output_json(),
            "stalls": parts.stalls_json(),
            "clock_steps": parts.clock.steps,
            "log": None if parts.log is None else log_json(parts.log),
            "health": {
                **{name: int(health[name][0]) for name in COUNTERS},
                **{fault: by_quantity(health, fault) for fault in FAULTS},
                "findings": findings(health),
            },
        }

    def _rates(self, now_s: float, counts: dict[str, int]) -> dict[str, float]:
        before_s, before = self._before
        self._before = now_s, counts
        seconds = now_s - before_s
        return {name: round((n - before[name]) / seconds, 1) if seconds > 0 else 0.0 for name, n in counts.items()}

    def _configuration_json(self) -> dict[str, Any]:
        """Return which vehicle file is in force; a digest is made once for each."""
        config = self._parts.config
        if self._of is not config:
            self._of = config
            self._configuration = {
                "file": str(config.path),
                "vehicle_digest": vehicle_digest(config),
                "database_digest": database_digest(config),
            }
        return {**self._configuration, "reloads": dict(self._parts.reloads)}


class MessageAges:
    """How long ago each message told a value that could be used.

    Args:
        config: whose inputs are read.
    """

    def __init__(self, config: Config) -> None:
        by_name = {message.name: message for message in config.database.messages}
        mapped = read_addresses(config.database, config.inputs, config.addresses)
        places = {key: place for place, key in enumerate(mapped)}
        self._names = [
            {"name": name, "id": identifier_text(address.can_id), "channel": address.channel}
            for name, address in mapped
        ]
        terms = [term for each in config.inputs for term in each.signals]
        self._of_term = [
            places[term.message, at_term(term, by_name[term.message], config.addresses)] for term in terms
        ]

    def as_json(
        self, told_us: list[int | None], latest: tuple[int, float] | None, now_s: float
    ) -> list[dict[str, Any]]:
        """Return each message with its age, s; None for one that has not told anything.

        Args:
            told_us: `Chain.told_us`.
            latest: time of the last frame, and the monotonic time at which it came.
            now_s: monotonic.
        """
        newest: list[int | None] = [None] * len(self._names)
        for place, t_us in zip(self._of_term, told_us, strict=True):
            if t_us is not None and (newest[place] is None or t_us > newest[place]):  # type: ignore[operator]
                newest[place] = t_us
        ages: list[float | None] = [None] * len(newest)
        if latest is not None:
            last_us, came_s = latest
            ages = [
                None if t_us is None else round(max(1e-6 * (last_us - t_us), 0.0) + now_s - came_s, 3)
                for t_us in newest
            ]
        return [{**name, "age_s": age_s} for name, age_s in zip(self._names, ages, strict=True)]


def log_json(log: LogProcess) -> dict[str, Any]:
    """Return the counters of a log and its latest files, not all: a service runs for months."""
    counts = log.counts
    files = zip(counts.paths[-MOST_FILES:], counts.sizes[-MOST_FILES:], strict=True)
    return {
        "written": counts.written,
        "dropped": counts.dropped,
        "restarts": counts.restarts,
        "deleted": counts.deleted,
        "finalised": len(counts.finalised),
        "slowest_flush_ms": counts.slowest_flush_ms,
        "late_flushes": counts.late_flushes,
        "waiting_bytes": log.waiting_bytes,
        "opened": len(counts.paths),
        "files": [{"path": str(path), "bytes": size} for path, size in files],
        "failures": counts.failures[-MOST_FAILURES:],
    }


def _memory_mb() -> float:
    """Return the memory of this process that is in RAM, MB."""
    with open("/proc/self/statm", "rb") as file:  # noqa: PTH123  three times as quick
        return round(int(file.read().split()[1]) * _PAGE_BYTES / 1e6, 1)
