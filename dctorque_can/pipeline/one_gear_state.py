"""What the rule of `one_gear` remembers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phase_decision import NEVER

ONE_GEAR = np.dtype(
    [
        ("actual", "i8"),  # the gear that drives, as last told; 0 neutral
        ("former", "i8"),  # … the one before, as long as its clutch may still carry torque; 0: none
        ("changed_us", "i8"),  # when the actual gear changed
        ("together_us", "i8"),  # since when its clutch slips little, NEVER while it does
        ("gear", "i8", (2,)),  # by the ratio of each shaft's speed
        ("gear_known", "u1", (2,)),
        ("odd_us", "i8"),  # when the speed of the shaft that does not drive last left its gear
        ("up", "u1"),  # the next shift is expected to be one up
        ("shifting", "u1"),  # a shift is told, or seen by the slip
    ],
    align=True,
)
"""State of the rule for one gear signal of the whole gearbox."""


def first_one_gear(state: NDArray[np.void]) -> None:
    """Make ``state``, `ONE_GEAR` of zeros, what it is before the first frame."""
    state["changed_us"] = state["together_us"] = state["odd_us"] = NEVER
    state["up"] = True
