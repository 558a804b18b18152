"""How evenly the cyclic messages were sent: measured where they leave the service, by a clock that nobody sets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

PAUSE_S = 0.5  # longer is no jitter: nothing was to be sent (or of slow messages, two cycles)


@dataclass(slots=True)
class _Cycle:
    name: str
    period_s: float
    latest_s: float | None = None
    intervals: int = 0
    pauses: int = 0
    sum_s: float = 0.0
    squares_s2: float = 0.0  # of the deviations from the period
    longest_s: float = 0.0


class CycleTimes:
    """Intervals between the frames of each message.

    Args:
        periods: name and nominal period, s, of each message, by its identifier.
    """

    def __init__(self, periods: Mapping[int, tuple[str, float]]) -> None:
        self._cycles = {can_id: _Cycle(name, period_s) for can_id, (name, period_s) in periods.items()}

    def sent(self, can_id: int, now_s: float) -> None:
        """Note that a frame was sent."""
        cycle = self._cycles[can_id]
        before_s, cycle.latest_s = cycle.latest_s, now_s
        if before_s is None:
            return
        interval_s = now_s - before_s
        if interval_s > max(PAUSE_S, 2.0 * cycle.period_s):
            cycle.pauses += 1
            return
        cycle.intervals += 1
        cycle.sum_s += interval_s
        cycle.squares_s2 += (interval_s - cycle.period_s) ** 2
        cycle.longest_s = max(cycle.longest_s, interval_s)

    @property
    def worst_jitter_ms(self) -> float | None:
        """The largest jitter of all messages, ms; None while nothing is known."""
        known = [each["jitter_ms"] for each in self.as_json().values()]
        return max(known) if known else None

    def as_json(self) -> dict[str, dict[str, Any]]:
        """Return of each message that was sent twice: period, mean interval, jitter (RMS of what the intervals are
        off the period), longest interval, all in ms; how many intervals and pauses there were.
        """
        return {
            each.name: {
                "period_ms": round(1e3 * each.period_s, 3),
                "mean_ms": round(1e3 * each.sum_s / each.intervals, 3),
                "jitter_ms": round(1e3 * math.sqrt(each.squares_s2 / each.intervals), 3),
                "longest_ms": round(1e3 * each.longest_s, 3),
                "intervals": each.intervals,
                "pauses": each.pauses,
            }
            for each in self._cycles.values()
            if each.intervals
        }
