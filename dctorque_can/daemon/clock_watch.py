"""Steps of the clock by which frames are stamped: system time, set anew by a person, by NTP or by GPS."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FORWARD_US = 100_000  # a smaller step forwards is lost in the jitter of stamps
LEAK = 0.01  # of the time that passes: how quickly a clock may be slewed back
FIRST = 10  # steps that are told one by one


class ClockWatch:
    """Notices, counts and tells steps of the frames' clock; what follows from a step is for others to decide.

    A step back is a frame that is older than the one before it by more than frames are ever out of order. A step
    forwards looks like a silence, and is told from one by a clock that nobody sets: a frame cannot be received
    before it was sent, so the time from stamp to reception, up to a constant, never falls below what it was.

    Args:
        out_of_order_us: so much older than the latest one a frame may be without a step.
        tell: is told of the first steps, and then of fewer and fewer: ``tell(is_error, text)``.

    Attributes:
        steps: how many there were.
    """

    def __init__(self, out_of_order_us: int, tell: Callable[[bool, str], None]) -> None:
        self.steps = 0
        self._out_of_order_us = out_of_order_us
        self._tell = tell
        self._latest_us: int | None = None
        self._received_us = 0
        self._age_us = 0  # the smallest of late, from stamp to reception, up to a constant

    def look(self, t_us: NDArray[np.int64], now_s: float) -> None:
        """Take the stamps of the next frames, received at ``now_s`` of a clock that nobody sets."""
        received_us = round(now_s * 1e6)
        stamps = t_us.tolist()
        if self._goes_on(stamps, received_us):
            return
        judged = self._latest_us is not None  # the first frames may have waited for long, each for another time
        for stamp_us in stamps:
            age_us = received_us - stamp_us
            if self._latest_us is None:
                self._latest_us, self._age_us = stamp_us, age_us
            elif stamp_us < self._latest_us - self._out_of_order_us or (
                judged and age_us < self._age_us - FORWARD_US
            ):
                self._step(self._latest_us, stamp_us, received_us)
                self._latest_us, self._age_us = stamp_us, age_us
            else:
                self._latest_us = max(self._latest_us, stamp_us)
                leak_us = round(LEAK * (received_us - self._received_us))
                self._age_us = min(age_us, self._age_us + leak_us)
            self._received_us = received_us

    def _goes_on(self, stamps: list[int], received_us: int) -> bool:
        """Take stamps among which there is certainly no step, all at once; the result is that of one by one."""
        if self._latest_us is None:
            return False
        latest_us = max(self._latest_us, max(stamps))
        age_us = self._age_us + round(LEAK * (received_us - self._received_us))
        smallest_us = received_us - max(stamps)
        if min(stamps) < latest_us - self._out_of_order_us or smallest_us < age_us - FORWARD_US:
            return False
        self._latest_us, self._age_us, self._received_us = latest_us, min(smallest_us, age_us), received_us
        return True

    def _step(self, latest_us: int, stamp_us: int, received_us: int) -> None:
        self.steps += 1
        if self.steps > FIRST and self.steps & (self.steps - 1):
            return  # of a clock that never rests: only the powers of two
        way = "back" if stamp_us < latest_us else "forwards"
        step_us = abs(stamp_us - latest_us - (received_us - self._received_us))
        number = "" if self.steps == 1 else f" (step {self.steps})"
        self._tell(False, f"the clock of the frames was set {way} by {step_us / 1e6:.3f} s{number}")
