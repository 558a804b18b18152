"""Three ways to state the torques of both clutches from what is known elsewhere in the driveline (section 2.2).

First method, damper side, (18), (19); second method, shaft side, (20), (21); third method, whole gearbox,
(25)–(28), from (22)–(24). On the model's own trajectories all agree; in a car they differ by the errors of what
they are fed with. When both clutches slip, (27), (28) alone need no friction coefficient.

SI units; torque is positive from the engine to the wheels. Every function takes numbers or arrays (`Values`,
`Phases`) and returns what their shapes broadcast to. T_o stands at the output shaft; J_1 and J_2 are own inertias.
With a `GearPair` nothing here divides by zero: a singular pair cannot be made.
"""

from __future__ import annotations

import numpy as np

from dctorque_can.driveline.conventional import slipping_clutch_torque
from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.driveline.values import Phases, Values


def damper_side_torque(
    phase: Phases, capacity: Values, slip: Values, T_d: Values, T_other: Values, J_d: float, dw_d: Values
) -> Values:
    """Return the torque of one clutch by the first method, (18) or (19), N·m.

    Args:
        phase: of this clutch.
        capacity: μ R_c F_n of this clutch, N·m; used while it slips.
        slip: ω_d − ω_ci, rad/s; used while it slips.
        T_d: damper torque, N·m; the rest is used while it is locked.
        T_other: torque of the other clutch, N·m.
        J_d: inertia of the damper's secondary side, kg·m².
        dw_d: ω̇_d, rad/s².
    """
    return _by_phase(phase, capacity, slip, T_d - T_other - J_d * dw_d)  # (18), (19)


def damper_side_torques(
    phases: tuple[Phases, Phases],
    capacities: tuple[Values, Values],
    slips: tuple[Values, Values],
    T_d: Values,
    J_d: float,
    dw_d: Values,
) -> tuple[Values, Values]:
    """Return both clutch torques by the first method, (18) and (19), N·m, each by the phase of its clutch.

    With both clutches locked the damper side knows their sum alone: both are not-a-number there. Arguments are as
    in `damper_side_torque`, of clutch 1 and 2.
    """
    friction = [
        _by_phase(phase, capacity, slip, np.nan)
        for phase, capacity, slip in zip(phases, capacities, slips, strict=True)
    ]
    return (
        damper_side_torque(phases[0], capacities[0], slips[0], T_d, friction[1], J_d, dw_d),  # (18)
        damper_side_torque(phases[1], capacities[1], slips[1], T_d, friction[0], J_d, dw_d),  # (19)
    )


def shaft_side_torque(
    phase: Phases, capacity: Values, slip: Values, T_t: Values, i_t: float, J: float, dw_c: Values
) -> Values:
    """Return the torque of one clutch by the second method, (20) or (21), N·m.

    Args:
        phase: of this clutch.
        capacity: μ R_c F_n of this clutch, N·m; used while it slips.
        slip: ω_d − ω_ci, rad/s; used while it slips.
        T_t: torque of its transfer shaft, N·m; the rest is used while it is locked.
        i_t: ratio of its gear.
        J: own inertia J_1 or J_2 of its shaft, kg·m².
        dw_c: ω̇_ci, rad/s².
    """
    return _by_phase(phase, capacity, slip, T_t / i_t + J * dw_c)  # (20), (21)


def gearbox_side_torque1(
    pair: GearPair, J_o: float, dw_o: Values, dw_c1: Values, dw_c2: Values, T_c2: Values, T_o: Values
) -> Values:
    """Return T_c1 of (25), N·m, from the other clutch torque; true in every phase.

    Args:
        pair: engaged gears.
        J_o: inertia of the output shaft, kg·m².
        dw_o, dw_c1, dw_c2: ω̇_o, ω̇_c1, ω̇_c2, rad/s².
        T_c2: torque of the other clutch, N·m.
        T_o: output shaft torque, N·m.
    """
    other = pair.R_2 / pair.R_1
    return J_o / pair.R_1 * dw_o + pair.J_1 * dw_c1 + other * (pair.J_2 * dw_c2 - T_c2) + T_o / pair.R_1  # (25)


def gearbox_side_torque2(
    pair: GearPair, J_o: float, dw_o: Values, dw_c1: Values, dw_c2: Values, T_c1: Values, T_o: Values
) -> Values:
    """Return T_c2 of (26), N·m: `gearbox_side_torque1` with the shafts exchanged."""
    other = pair.R_1 / pair.R_2
    return J_o / pair.R_2 * dw_o + pair.J_2 * dw_c2 + other * (pair.J_1 * dw_c1 - T_c1) + T_o / pair.R_2  # (26)


def whole_gearbox_torque1(
    pair: GearPair,
    J_o: float,
    dw_o: Values,
    dw_c1: Values,
    dw_c2: Values,
    T_o: Values,
    T_d: Values,
    J_d: float,
    dw_d: Values,
) -> Values:
    """Return T_c1 of (28), N·m, from neither clutch torque; true in every phase.

    Errors of the arguments grow by 1/|R_1/R_2 − 1|, 1.4 to 7.4 for neighbouring gears of the shipped vehicles.

    Args:
        pair: engaged gears; a singular pair cannot be made.
        J_o: inertia of the output shaft, kg·m².
        dw_o, dw_c1, dw_c2: ω̇_o, ω̇_c1, ω̇_c2, rad/s².
        T_o: output shaft torque, N·m.
        T_d: damper torque, N·m.
        J_d: inertia of the damper's secondary side, kg·m².
        dw_d: ω̇_d, rad/s².
    """
    sum_from_damper = T_d - J_d * dw_d  # T_c1 + T_c2, (2)
    ratio = pair.R_1 / pair.R_2
    behind = J_o / pair.R_2 * dw_o + ratio * pair.J_1 * dw_c1 + pair.J_2 * dw_c2 + T_o / pair.R_2
    return (behind - sum_from_damper) / (ratio - 1.0)  # (28)


def whole_gearbox_torque2(
    pair: GearPair,
    J_o: float,
    dw_o: Values,
    dw_c1: Values,
    dw_c2: Values,
    T_o: Values,
    T_d: Values,
    J_d: float,
    dw_d: Values,
) -> Values:
    """Return T_c2 of (27), N·m: `whole_gearbox_torque1` with the shafts exchanged."""
    sum_from_damper = T_d - J_d * dw_d  # T_c1 + T_c2, (2)
    ratio = pair.R_2 / pair.R_1
    behind = J_o / pair.R_1 * dw_o + pair.J_1 * dw_c1 + ratio * pair.J_2 * dw_c2 + T_o / pair.R_1
    return (behind - sum_from_damper) / (ratio - 1.0)  # (27)


def _by_phase(phase: Phases, capacity: Values, slip: Values, locked: Values) -> Values:
    """Return 0 where open, the friction torque where slipping, and ``locked`` elsewhere."""
    slipping = slipping_clutch_torque(capacity, slip)
    is_open, slips = np.equal(phase, ClutchPhase.OPEN), np.equal(phase, ClutchPhase.SLIPPING)
    chosen: Values = np.where(is_open, 0.0, np.where(slips, slipping, locked))[()]  # [()]: a number stays one
    return chosen
