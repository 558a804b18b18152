"""How long the traffic of a recording is, whatever its clock did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_CLOCK_STEP_US = 1_000_000


class TrafficTime:
    """Adds up the time that frames span, of each stretch between two steps back of the clock.

    Frames that are a little out of order, as those of several channels, are no step.
    """

    def __init__(self) -> None:
        self._before_us = 0
        self._begin_us: int | None = None
        self._latest_us = 0
        self._last_us = 0

    @property
    def seconds(self) -> float:
        """The time so far."""
        return 0.0 if self._begin_us is None else (self._before_us + self._latest_us - self._begin_us) / 1e6

    def take(self, t_us: NDArray[np.int64]) -> None:
        """Go on with the times of the next frames."""
        if not len(t_us):
            return
        last = t_us[0] if self._begin_us is None else self._last_us
        steps = np.diff(t_us, prepend=last)
        for number, stretch in enumerate(np.split(t_us, np.flatnonzero(steps < -_CLOCK_STEP_US))):
            if not len(stretch):  # the step stands before the first frame
                continue
            if self._begin_us is None or number:
                if self._begin_us is not None:
                    self._before_us += self._latest_us - self._begin_us
                self._begin_us = self._latest_us = int(stretch[0])
            self._begin_us = min(self._begin_us, int(stretch.min()))
            self._latest_us = max(self._latest_us, int(stretch.max()))
        self._last_us = int(t_us[-1])
