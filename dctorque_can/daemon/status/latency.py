"""How long it takes from receiving a frame to its answer: counted, in memory that does not grow."""

from __future__ import annotations

import math
from typing import Any

PER_DECADE = 20  # bins: a percentile is known to 12 %
FIRST_S = 1e-5
_DECADES = 6  # from 10 µs to 10 s
_BINS = PER_DECADE * _DECADES + 2  # what is below, and what is above
LONGEST_S = 60.0  # longer ago, or in the future: the stamps are of another clock
PERIOD_S = 60.0
QUANTILES = (0.5, 0.99, 0.999)


class Histogram:
    """Counts times in bins that are wider the longer they are.

    Attributes:
        count: how many were added.
        sum_s: of all.
        longest_s: the longest.
    """

    def __init__(self) -> None:
        self.count = 0
        self.sum_s = 0.0
        self.longest_s = 0.0
        self._bins = [0] * _BINS

    def add(self, seconds: float) -> None:
        """Count one time."""
        self.count += 1
        self.sum_s += seconds
        self.longest_s = max(self.longest_s, seconds)
        if seconds <= FIRST_S:
            self._bins[0] += 1
            return
        place = 1 + int(PER_DECADE * math.log10(seconds / FIRST_S))
        self._bins[min(place, _BINS - 1)] += 1

    def quantile_s(self, share: float) -> float | None:
        """Return the upper end of the bin in which a share of all times ends, at most the longest; None: none."""
        if not self.count:
            return None
        wanted, below = share * self.count, 0
        for place, n in enumerate(self._bins):
            below += n
            if below >= wanted and place < _BINS - 1:
                return min(FIRST_S * math.pow(10.0, place / PER_DECADE), self.longest_s)
        return self.longest_s

    def as_json(self) -> dict[str, Any]:
        """Return count, mean, quantiles and longest, ms; None where nothing was counted."""
        known = {f"p{100 * share:g}_ms": self.quantile_s(share) for share in QUANTILES}
        mean_s = self.sum_s / self.count if self.count else None
        times = {"mean_ms": mean_s, **known, "longest_ms": self.longest_s if self.count else None}
        return {"count": self.count} | {
            name: None if seconds is None else round(1e3 * seconds, 3) for name, seconds in times.items()
        }


class Latency:
    """From the time stamp of a frame to its answer: since the start, and over the last whole minute.

    Stamps that an adapter or a server made by a clock of its own say nothing; they are counted alone.

    Attributes:
        foreign_clock: frames whose stamp lies in the future, or `LONGEST_S` ago.
    """

    def __init__(self) -> None:
        self.foreign_clock = 0
        self._all = Histogram()
        self._minute = Histogram()
        self._last_minute = Histogram()
        self._until_s: float | None = None

    def answered(self, stamp_us: int, now_us: int) -> None:
        """Note that a frame with a stamp was answered now, both by the clock of the system.

        What has waited for the service to start is not of interest: it counts from the first `keep_time` on.
        """
        if self._until_s is None:
            return
        seconds = 1e-6 * (now_us - stamp_us)
        if not 0.0 <= seconds <= LONGEST_S:
            self.foreign_clock += 1
            return
        self._all.add(seconds)
        self._minute.add(seconds)

    def keep_time(self, now_s: float) -> None:
        """Begin a new minute when it is time; by a clock that nobody sets."""
        if self._until_s is None:
            self._until_s = now_s + PERIOD_S
        elif now_s >= self._until_s:
            self._until_s = now_s + PERIOD_S
            self._last_minute, self._minute = self._minute, Histogram()

    def as_json(self) -> dict[str, Any]:
        """Return `Histogram.as_json` of all, the same of the last whole minute, and the sum, s."""
        return {
            **self._all.as_json(),
            "sum_s": round(self._all.sum_s, 6),
            "foreign_clock": self.foreign_clock,
            "last_minute": self._last_minute.as_json(),
        }
