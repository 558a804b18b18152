"""A vehicle file held against recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from dctorque_can.config.load import Config
from dctorque_can.evidence.findings import Finding, findings
from dctorque_can.evidence.intervals import Intervals
from dctorque_can.logs.reader import LogReader
from dctorque_can.offline.replay import (
    ReplayContent,
    ReplayResult,
    ReplayTargets,
    mapped_messages,
    replay_logs,
)


@dataclass(frozen=True)
class Judged:
    """What recordings say of a vehicle file.

    Attributes:
        findings: the worst first.
        replay: what the estimator made of the recordings.
    """

    findings: list[Finding]
    replay: ReplayResult

    def as_json(self) -> dict[str, Any]:
        """Return the result for scripts."""
        return {
            "findings": [finding.as_json() for finding in self.findings],
            "recording": {
                "frames": self.replay.frames,
                "seconds": self.replay.bus_seconds,
                "estimates": self.replay.estimates,
                "valid_estimates": self.replay.valid_estimates,
                "problems": self.replay.problems,
            },
        }


def judge(logs: Sequence[LogReader], config: Config, progress: Callable[[float], None]) -> Judged:
    """Estimate over ``logs``, one after another, and tell what contradicts the vehicle file.

    Raises:
        DctorqueError: a log cannot be read.
    """
    mapped = mapped_messages(config)
    intervals = Intervals(message.address for message in mapped)
    replay = replay_logs(logs, config, ReplayTargets(None), ReplayContent(), progress, intervals.take)
    found = {message.name: intervals.of(message.address) for message in reversed(mapped)}
    measured = {name: interval for name, interval in found.items() if interval is not None}
    return Judged(findings(config, replay.health, replay.never_received, measured), replay)
