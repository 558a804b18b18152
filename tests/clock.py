"""A clock that tests wind themselves, so that no test judges how quick the machine is."""

import math


class Clock:
    """Stands for the module ``time`` in a module under test: only what sleeps on it, or a test, moves it on.

    Attributes:
        now_s: what it shows.
        oversleep_s: that much longer than asked takes every sleep.
    """

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.oversleep_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.now_s = math.nextafter(self.now_s + seconds + self.oversleep_s, math.inf)  # or rounding cuts it short
