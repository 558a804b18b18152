"""What smoothing makes of the estimates of a catalogue: errors as shares of those online, and bands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dctorque_can.analysis.errors import TORQUES
from dctorque_can.study.run import Record

LEAST_RMS_NM = 0.5
"""A torque whose RMS error online is less, because its clutch is open all the time, has no share."""
MOST_SHARE = 1.10
"""By so much at most a smoothed torque should be worse than online in a single drive."""


@dataclass(frozen=True, slots=True)
class Smoothing:
    """One torque over all runs, of the estimates that are called valid.

    Attributes:
        share: root of the squares of all errors, smoothed over online; None when there are none.
        drives: number of runs that have a share of their own, see `LEAST_RMS_NM`.
        worse: how many of these are beyond `MOST_SHARE`.
        worst: the greatest of these shares, None when there is none …
        worst_case: … and its run.
        held: share of all within the smoothed 95 % band; None when there are none.
        held_least: … in the worst run.
        wrong_ms: for how long they were confidently wrong in all, smoothed …
        wrong_online_ms: … and online.
    """

    share: float | None
    drives: int
    worse: int
    worst: float | None
    worst_case: dict[str, Any] | None
    held: float | None
    held_least: float | None
    wrong_ms: float
    wrong_online_ms: float


def smoothing(records: Iterable[Record]) -> dict[str, Smoothing]:
    """Return what the runs that were smoothed say, by torque; empty when none was."""
    found = [record for record in records if "smoothed" in record]
    return {name: _torque(name, found) for name in TORQUES} if found else {}


def _torque(name: str, records: list[Record]) -> Smoothing:
    pairs = [(record["case"], record["torques"][name], record["smoothed"][name]) for record in records]
    valid = [(case, online, after) for case, online, after in pairs if online["rows"]]
    rows = np.array([online["rows"] for _, online, _ in valid], np.float64)
    before = np.array([online["rms_nm"] for _, online, _ in valid])
    after = np.array([smoothed["rms_nm"] for _, _, smoothed in valid])
    held = np.array([smoothed["held"] for _, _, smoothed in valid])
    counted = np.flatnonzero(before >= LEAST_RMS_NM)
    shares = after[counted] / before[counted]
    worst = int(np.argmax(shares)) if len(shares) else None
    return Smoothing(
        share=float(np.sqrt(rows @ after**2 / (rows @ before**2))) if (rows @ before**2) > 0.0 else None,
        drives=len(counted),
        worse=int(np.count_nonzero(shares > MOST_SHARE)),
        worst=None if worst is None else float(shares[worst]),
        worst_case=None if worst is None else valid[counted[worst]][0],
        held=float(rows @ held / rows.sum()) if len(valid) else None,
        held_least=float(held.min()) if len(valid) else None,
        wrong_ms=sum(smoothed["wrong_ms"] for _, _, smoothed in pairs),
        wrong_online_ms=sum(online["wrong_ms"] for _, online, _ in pairs),
    )
