"""Clutch phases (Fig. 3 of the paper): open, slipping or locked, and what they are decided by."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class ClutchPhase(IntEnum):
    """What a clutch does."""

    OPEN = 0  # carries no torque
    SLIPPING = 1
    LOCKED = 2


class DrivelinePhase(IntEnum):
    """What both clutches do together: the three phases of Fig. 3 (`phase_decision.driveline_phase`)."""

    CLUTCH1_ENGAGED = 0  # clutch 2 slips or is open
    CLUTCH2_ENGAGED = 1  # clutch 1 slips or is open
    BOTH_SLIPPING = 2  # or open: no clutch is engaged


class PhaseSource(IntEnum):
    """What tells whether a clutch is open."""

    POSITION = 0  # actuator position against the kissing point
    FLAG = 1  # a "clutch open" flag
    COMMAND = 2  # commanded torque
    NONE = 4  # nothing: it may always carry torque, and the speeds alone say how much
    STATE = 5  # one state of both clutches together: open or not
    GIVEN = 3  # somebody who knows the phase gives it, as a `ClutchPhase` in the place of the position


@dataclass(frozen=True, slots=True)
class ClutchActuation:
    """When one clutch counts as closed (able to carry torque).

    Attributes:
        source: which quantity is read.
        threshold: kissing point in the unit of the position, or torque in N·m; unused for a flag.
        hysteresis: full width of the band around ``threshold``, same unit.
        closes_increasing: a position above (true) or below (false) the kissing point is closed.
        touches_before: by how much earlier the clutch may begin to carry torque, same unit; 0: not at all.
    """

    source: PhaseSource
    threshold: float
    hysteresis: float
    closes_increasing: bool = True
    touches_before: float = 0.0


@dataclass(frozen=True, slots=True)
class PhaseSettings:
    """Thresholds of the phase decision."""

    clutches: tuple[ClutchActuation, ClutchActuation]
    slip_locked_rad_s: float  # |slip| below this for `lock_time_us` counts as locked
    slip_released_rad_s: float  # |slip| above this counts as slipping again
    lock_time_us: int
