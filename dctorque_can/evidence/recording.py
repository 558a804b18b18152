"""A vehicle file held against recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dctorque_can.analysis.health import health_counts, never_received
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config
from dctorque_can.evidence.findings import Finding, findings
from dctorque_can.evidence.intervals import Interval, Intervals
from dctorque_can.evidence.measured import measure
from dctorque_can.logs.reader import LogReader
from dctorque_can.offline.replay import (
    ReplayContent,
    ReplayResult,
    ReplayTargets,
    mapped_messages,
    replay_logs,
)
from dctorque_can.pipeline.frames import Frames


@dataclass(frozen=True)
class Judged:
    """What recordings say of a vehicle file.

    Attributes:
        findings: the worst first.
        replay: what the estimator made of the recordings.
        frames: those of the mapped messages, in order.
    """

    findings: list[Finding]
    replay: ReplayResult
    frames: list[Frames]

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
    addresses = [message.address for message in mapped_messages(config)]
    kept: list[Frames] = []

    def watch(frames: Frames) -> None:
        rows = np.zeros(len(frames), np.bool_)
        for address in addresses:
            rows |= address.rows(frames)
        kept.append(frames[rows])

    replay = replay_logs(logs, config, ReplayTargets(None), ReplayContent(), progress, watch)
    told = _told(kept, config, replay.health, replay.never_received)
    return Judged(told, replay, kept)


def judge_frames(frames: Sequence[Frames], config: Config) -> list[Finding]:
    """Return what frames, in order, say against a vehicle file; of all mapped messages at least."""
    return _told(frames, config, *_estimated(frames, config))


def _estimated(frames: Sequence[Frames], config: Config) -> tuple[dict[str, Any], list[str]]:
    """Return the health of an estimator that was fed, and which inputs it never got."""
    chain = Chain(config)
    for each in frames:
        chain.feed(each)
    return health_counts(chain.health), never_received(config.inputs, chain.health)


def _intervals(frames: Sequence[Frames], config: Config) -> dict[str, Interval]:
    """Return how often the mapped messages come, by name."""
    mapped = mapped_messages(config)
    intervals = Intervals(message.address for message in mapped)
    for each in frames:
        intervals.take(each)
    found = {message.name: intervals.of(message.address) for message in reversed(mapped)}
    return {name: interval for name, interval in found.items() if interval is not None}


def _told(
    frames: Sequence[Frames],
    config: Config,
    health: Mapping[str, Any],
    missing: Sequence[str],
) -> list[Finding]:
    """Return what was measured, and what else the estimator says of the file in which that is put right.

    What it says no more then was a consequence.
    """
    measured, draft = measure(frames, config)
    if draft.fixes:
        health, missing = _estimated(frames, draft.config)
    known = frozenset[str]().union(*(finding.explains for finding in measured))
    left = [each for each in health["findings"] if each["finding"] not in known]
    intervals = _intervals(frames, draft.config)
    rest = findings(draft.config, {**health, "findings": left}, missing, intervals)
    return sorted([*measured, *rest], key=lambda finding: ("error", "warning", "hint").index(finding.severity))
