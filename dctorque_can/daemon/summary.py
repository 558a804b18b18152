"""What a run or a replay amounted to: inputs that never came, estimates that may be trusted, time that passed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import Input

_BOTH_VALID = np.uint32(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID)
_CLOCK_STEP_US = 1_000_000


def never_received(inputs: Sequence[Input], health: NDArray[np.void]) -> list[str]:
    """Return the mapped quantities of which a `HEALTH` record ``[1]`` counts no usable value, in lower case."""
    accepted = health[0]["accepted"]
    return [entry.quantity.name.lower() for entry in inputs if not accepted[entry.quantity]]


def count_valid(rows: NDArray[np.void]) -> int:
    """Return how many `ESTIMATE` rows have both clutch torques valid."""
    return int(np.count_nonzero((rows["status"] & _BOTH_VALID) == _BOTH_VALID))


def doubts(missing: Sequence[str], estimates: int, valid: int) -> list[str]:
    """Return warnings, one line each, for the results of `never_received` and `count_valid`."""
    lines = []
    if missing:
        lines.append(f"never received a usable value of: {', '.join(missing)} (see `dctorque check`)")
    if estimates and not valid:
        lines.append(f"none of the {estimates} estimates has valid clutch torques")
    return lines


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
