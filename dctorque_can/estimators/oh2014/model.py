"""What the 2014 observer knows of a vehicle: its constants, and what follows from the engaged gears alone."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.gear_pair import effective_inertia
from dctorque_can.driveline.parameters import AIR_DENSITY, GEARS, STANDARD_GRAVITY, Vehicle
from dctorque_can.estimators.oh2014.design import Oh2014Design

REFERENCE_ENGINE_SPEED = 200.0  # rad/s, at which γ_e gives the adaptation time
STEP_EXPONENT = 0.4
"""How the wheel acceleration filter of a gear pair follows its ratio step |R_1 - R_2|.

Handing a clutch torque over changes T_o in proportion to the step and (65), (66) divide by it, so the error of lag
is the same for all pairs, ∝ 1/p; noise is divided by the step, ∝ p^1.5/step. p ∝ step^(2/5) keeps their balance.
"""
REFERENCE_WHEEL_ACCELERATION = 5.0  # rad/s², at which γ_t gives the adaptation time

CONSTANTS = np.dtype(
    [
        ("J_e", "f8"),  # engine and damper inertia
        ("J_c1", "f8"),
        ("J_c2", "f8"),
        ("J_v", "f8"),
        ("k_t1", "f8"),
        ("k_t2", "f8"),
        ("i_t", "f8", (GEARS,)),  # by gear number + 1; 0 where there is no such gear
        ("i_f", "f8", (GEARS,)),
        ("J_g", "f8", (GEARS,)),
        ("shaft", "i8", (GEARS,)),
        ("efficiency", "f8"),  # of gear pair and final drive together
        ("p_e", "f8"),  # double pole of the engine-side unknown input observer
        ("p_s", "f8"),  # … of the clutch-side one
        ("p_w", "f8"),  # … of the wheel acceleration filter, for the widest ratio step
        ("widest_step", "f8"),  # largest |R_1 - R_2| of neighbouring forward gears
        ("L", "f8"),  # L_1 = L_2
        ("g_l", "f8"),  # γ_l
        ("T_a", "f8"),  # adaptation time
        ("T_road", "f8"),
        ("road_load", "i8"),  # RoadLoad
        ("gating", "?"),
        ("printed_rate_law", "?"),
        ("roll_nm", "f8"),  # r_w K_rr m_v g
        ("drag_nm", "f8"),  # ½ ρ C_d A r_w³, times ω_w²
    ],
    align=True,
)

PAIR = np.dtype(
    [
        ("g1", "i8"),
        ("g2", "i8"),
        ("side", "i8"),  # shaft on which the clutch-side observer runs: 1, 2 (mirrored), 0 none
        ("R_1", "f8"),
        ("R_2", "f8"),
        ("i_t1", "f8"),
        ("i_t2", "f8"),
        ("i_f1", "f8"),
        ("i_f2", "f8"),
        ("J_es", "f8"),  # J_e1 or J_e2, effective inertia at the side's shaft
        ("R_s", "f8"),  # R_1 or R_2
        ("g_e", "f8"),  # γ_e
        ("g_t", "f8"),  # γ_t
        ("p_w", "f8"),  # double pole of the wheel acceleration filter
    ],
    align=True,
)
"""What follows from the engaged gears alone."""


def constants(vehicle: Vehicle, design: Oh2014Design) -> NDArray[np.void]:
    """Return the `CONSTANTS` record ``[1]`` of a vehicle and a design."""
    c = np.zeros(1, CONSTANTS)
    chassis = vehicle.chassis
    c["J_e"] = vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2
    c["J_c1"], c["J_c2"] = (shaft.inertia_kgm2 for shaft in vehicle.shafts)
    c["k_t1"], c["k_t2"] = (shaft.transfer_stiffness_nm_per_rad for shaft in vehicle.shafts)
    c["J_v"] = chassis.inertia_kgm2
    for gear in vehicle.gears:
        c["i_t"][0, gear.number + 1] = gear.ratio
        c["i_f"][0, gear.number + 1] = gear.final_drive
        c["J_g"][0, gear.number + 1] = gear.inertia_kgm2
        c["shaft"][0, gear.number + 1] = gear.shaft
    c["efficiency"] = vehicle.gear_efficiency * vehicle.final_drive_efficiency
    c["p_e"] = design.engine_bandwidth_rad_s
    c["p_s"] = design.shaft_bandwidth_rad_s
    c["p_w"] = design.acceleration_bandwidth_rad_s
    c["widest_step"] = max(ratio_steps(vehicle), default=0.0)
    c["L"] = design.torque_crossover_rad_s
    c["g_l"] = 1.0 / design.leakage_time_s
    c["T_a"] = design.adaptation_time_s
    c["T_road"] = design.road_load_time_s
    c["road_load"] = design.road_load
    c["gating"] = design.phase_gating
    c["printed_rate_law"] = design.printed_rate_law
    c["roll_nm"] = chassis.wheel_radius_m * chassis.rolling_resistance * chassis.mass_kg * STANDARD_GRAVITY
    c["drag_nm"] = (
        0.5 * AIR_DENSITY * chassis.drag_coefficient * chassis.frontal_area_m2 * chassis.wheel_radius_m**3
    )
    return c


def ratio_steps(vehicle: Vehicle) -> list[float]:
    """Return the differences of the total ratios of neighbouring forward gears, from first gear on."""
    forward = sorted((g for g in vehicle.gears if g.number > 0), key=lambda gear: gear.number)
    return [abs(one.total_ratio - two.total_ratio) for one, two in pairwise(forward)]


@compiled_without_allocation
def acceleration_bandwidth(p: float, step: float, widest: float) -> float:
    """Return the double pole of the wheel acceleration filter for a pair with ratio step ``step``, rad/s."""
    if step >= widest:
        return float(p)
    return float(p * (step / widest) ** STEP_EXPONENT)


def slowest_acceleration_bandwidth(vehicle: Vehicle, design: Oh2014Design) -> float:
    """Return the same for the narrowest step of the vehicle, rad/s."""
    steps = ratio_steps(vehicle)
    p = design.acceleration_bandwidth_rad_s
    return acceleration_bandwidth(p, min(steps), max(steps)) if steps else p


@compiled_without_allocation
def set_pair(pair: Any, c: Any, g1: int, g2: int) -> None:
    """Fill ``pair`` for gear ``g1`` on shaft 1 and ``g2`` on shaft 2; 0 is neutral."""
    pair.g1 = g1
    pair.g2 = g2
    i_t1, i_f1, J_g1 = c.i_t[g1 + 1], c.i_f[g1 + 1], c.J_g[g1 + 1]
    i_t2, i_f2, J_g2 = c.i_t[g2 + 1], c.i_f[g2 + 1], c.J_g[g2 + 1]
    pair.i_t1, pair.i_f1, pair.R_1 = i_t1, i_f1, i_t1 * i_f1
    pair.i_t2, pair.i_f2, pair.R_2 = i_t2, i_f2, i_t2 * i_f2
    J_1 = c.J_c1 + J_g1
    J_2 = c.J_c2 + J_g2
    if g1 != 0:
        pair.side = 1
        pair.R_s = pair.R_1
        pair.J_es = effective_inertia(J_1, J_2, pair.R_2 / pair.R_1) if g2 != 0 else J_1
    elif g2 != 0:
        pair.side = 2
        pair.R_s = pair.R_2
        pair.J_es = J_2
    else:
        pair.side = 0
        pair.R_s = 1.0
        pair.J_es = J_1
    step = abs(pair.R_1 - pair.R_2) if g1 != 0 and g2 != 0 else c.widest_step
    pair.p_w = acceleration_bandwidth(c.p_w, step, c.widest_step)
    pair.g_e = 1.0 / (c.T_a * REFERENCE_ENGINE_SPEED**2)
    pair.g_t = pair.R_s**2 / (c.T_a * REFERENCE_WHEEL_ACCELERATION**2)
