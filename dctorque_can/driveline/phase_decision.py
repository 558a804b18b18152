"""The phase decision of Fig. 3: open, slipping or locked, with hysteresis in position, slip and time.

`is_closed`, `small_slip_since` and `decide_phase` are one clutch at one instant, compiled: the pipeline calls them
for each frame, `phase_history` over columns. They remember nothing; what lasts is handed in and returned.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled, compiled_without_allocation
from dctorque_can.driveline.phases import ClutchActuation, ClutchPhase, DrivelinePhase, PhaseSettings, PhaseSource
from dctorque_can.driveline.values import Phases
from dctorque_can.errors import DctorqueError

NEVER = -(2**62)  # a time before all others, µs

_OPEN, _SLIPPING, _LOCKED = (int(phase) for phase in ClutchPhase)


def closing_band(clutch: ClutchActuation) -> tuple[float, float, float]:
    """Return (sign, closed_above, open_below): the band for sign · value, in the direction of closing."""
    closes = clutch.closes_increasing or clutch.source is not PhaseSource.POSITION
    sign = 1.0 if closes else -1.0
    return (
        sign,
        sign * clutch.threshold + 0.5 * clutch.hysteresis,
        sign * clutch.threshold - 0.5 * clutch.hysteresis,
    )


@compiled_without_allocation
def is_closed(
    source: int, value: float, sign: float, closed_above: float, open_below: float, was_closed: bool
) -> bool:
    """Return whether a clutch can carry torque; within the band it stays what it was.

    Args:
        source: `PhaseSource`.
        value: actuator position, "clutch open" flag or commanded torque, N·m.
        sign, closed_above, open_below: of `closing_band`; unused for a flag.
        was_closed: the last answer.
    """
    if source == PhaseSource.FLAG:
        return value < 0.5
    if source == PhaseSource.STATE:
        return value > 0.5
    x = sign * value
    if x >= closed_above:
        return True
    if x <= open_below:
        return False
    return bool(was_closed)


@compiled_without_allocation
def small_slip_since(slip: float, slip_locked: float, t_us: int, since_us: int) -> int:
    """Return since when the slip has been small, µs; `NEVER` if it is not.

    Args:
        slip: |ω_e − ω_ci|, rad/s.
        slip_locked: up to this a slip is small, rad/s.
        t_us: now.
        since_us: the last answer.
    """
    if slip > slip_locked:
        return NEVER
    if since_us == NEVER:
        return t_us
    return since_us


@compiled_without_allocation
def decide_phase(
    closed: bool, slip: float, was: int, since_us: int, t_us: int, slip_released: float, lock_time_us: int
) -> int:
    """Return the `ClutchPhase` of one clutch.

    It locks when the slip has been small for a time, and slips again when the slip exceeds another threshold.

    Args:
        closed: of `is_closed`.
        slip: |ω_e − ω_ci|, rad/s.
        was: the last phase.
        since_us: of `small_slip_since`.
        t_us: now.
        slip_released: a locked clutch stays locked up to this, rad/s.
        lock_time_us: for how long the slip must be small, µs.
    """
    if not closed:
        return _OPEN
    stays = was == _LOCKED and slip <= slip_released
    locks = since_us != NEVER and t_us - since_us >= lock_time_us
    return _LOCKED if stays or locks else _SLIPPING


def phase_history(
    t_us: NDArray[np.int64],
    slip_rad_s: NDArray[np.float64],
    actuation: NDArray[np.float64],
    clutch: ClutchActuation,
    settings: PhaseSettings,
) -> NDArray[np.uint8]:
    """Return the `ClutchPhase` of one clutch at every instant, ``[n]``, as the pipeline would decide it.

    Before the first instant the clutch counts as closed and not locked, so a value within the band means closed.

    Args:
        t_us: int64 ``[n]``, does not fall.
        slip_rad_s: ``[n]``, ω_e − ω_ci, rad/s, of either sign.
        actuation: ``[n]``, actuator position, "clutch open" flag or commanded torque as ``clutch.source`` has it.
            Not-a-number is unknown: then nothing says that the clutch is open, and it counts as closed.
        clutch: when this clutch is closed.
        settings: thresholds of the slip (its ``clutches`` are not read).

    Raises:
        DctorqueError: the columns differ in length, time falls, or a slip is not finite.
    """
    t_us = np.ascontiguousarray(t_us, np.int64)
    slip = np.abs(np.ascontiguousarray(slip_rad_s, np.float64))
    actuation = np.ascontiguousarray(actuation, np.float64)
    if t_us.ndim != 1 or not t_us.shape == slip.shape == actuation.shape:
        shapes = f"{t_us.shape}, {slip.shape} and {actuation.shape}"
        raise DctorqueError(f"phase history: time, slip and actuation must be columns of one length, not {shapes}")
    if (np.diff(t_us) < 0).any():
        raise DctorqueError("phase history: time must not fall")
    if not np.isfinite(slip).all():
        row = int(np.flatnonzero(~np.isfinite(slip))[0])
        raise DctorqueError(f"phase history: slip {slip[row]} in row {row} must be a finite number")
    phases = np.zeros(len(t_us), np.uint8)
    sign, closed_above, open_below = closing_band(clutch)
    thresholds = (settings.slip_locked_rad_s, settings.slip_released_rad_s, settings.lock_time_us)
    _run(t_us, slip, actuation, int(clutch.source), sign, closed_above, open_below, *thresholds, phases)
    return phases


@compiled
def _run(
    t_us: NDArray[np.int64],
    slip: NDArray[np.float64],
    actuation: NDArray[np.float64],
    source: int,
    sign: float,
    closed_above: float,
    open_below: float,
    slip_locked: float,
    slip_released: float,
    lock_time_us: int,
    phases: NDArray[np.uint8],
) -> None:
    closed, since_us, phase = True, NEVER, _OPEN
    for k in range(t_us.size):
        known = not np.isnan(actuation[k])
        closed = not known or is_closed(source, actuation[k], sign, closed_above, open_below, closed)
        since_us = small_slip_since(slip[k], slip_locked, t_us[k], since_us)
        phase = decide_phase(closed, slip[k], phase, since_us, t_us[k], slip_released, lock_time_us)
        phases[k] = phase


def driveline_phase(phase1: Phases, phase2: Phases) -> Phases:
    """Return the `DrivelinePhase` of both clutches (Fig. 3), an int or an integer array.

    | | 2 open | 2 slipping | 2 locked |
    |---|---|---|---|
    | **1 open** | both slipping | both slipping | clutch 2 engaged |
    | **1 slipping** | both slipping | both slipping | clutch 2 engaged |
    | **1 locked** | clutch 1 engaged | clutch 1 engaged | clutch 1 engaged |

    Fig. 3 has no place for two of these. *Both open* engages no clutch and so is "both slipping", with no torque.
    *Both locked* ties two ratios to one output shaft: it lasts at rest only, and else for as long as the transfer
    shafts can twist (a tie-up). Clutch 1 is named then, so that the answer is definite; how the torque is shared
    only the second method, (20) and (21), can tell, since the damper side knows the sum alone.

    Args:
        phase1: `ClutchPhase` of clutch 1, a number or an array.
        phase2: `ClutchPhase` of clutch 2.
    """
    locked1, locked2 = np.equal(phase1, ClutchPhase.LOCKED), np.equal(phase2, ClutchPhase.LOCKED)
    otherwise = np.where(locked2, int(DrivelinePhase.CLUTCH2_ENGAGED), int(DrivelinePhase.BOTH_SLIPPING))
    joint: Phases = np.where(locked1, int(DrivelinePhase.CLUTCH1_ENGAGED), otherwise)[()]
    return joint
