"""The conventional, lumped model of section 2.1: rigid transfer shafts, so that both input shafts turn as one.

SI units; torque is positive from the engine to the wheels. Every function takes numbers or arrays (`Values`) and
returns what their shapes broadcast to.

**Where T_o stands.** In this section alone, T_o stands at the transmission output, *before* the final drive, and
k_o and b_o of (10) are those of a spring there. `Vehicle.output_shaft` is behind the final drive, as section 2.2
has it: `before_final_drive` takes its stiffness and damping to the other side.

**Two final drives.** The paper writes (3), (4) with the gear ratios i_t, which is exact when both gears drive one
final drive. With two, "before the final drive" has two meanings, and T_o of (3) and of (4) are different torques.
Here R = i_t i_f stands in for i_t wherever the two shafts meet, and the T_o handed to the equation of shaft i
stands before final drive i: T_o,i = T_out/i_fi with T_out at the output shaft, so T_o,i/i_ti = T_out/R_i. With one
final drive these are the printed equations.

**Not here:** (6), T_e = f(throttle, ω_e), is the engine's map. It is data of the simulated car
(`simulation.engine.driver_demand`); the equations here take T_e as an argument, from wherever it comes.

**Neglected by the paper:** J_o. The rigid limit of section 2.2 has J_e1 + J_o/R_1² where (3) has J_e1.
"""

from __future__ import annotations

import numpy as np

from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.driveline.parameters import AIR_DENSITY, STANDARD_GRAVITY, Chassis, Clutch
from dctorque_can.driveline.values import Values


def engine_acceleration(T_e: Values, T_d: Values, J_e: float) -> Values:
    """Return ω̇_e of (1), rad/s², from engine and damper torque, N·m, and J_e, kg·m² (without the damper)."""
    return (T_e - T_d) / J_e  # (1)


def damper_acceleration(T_d: Values, T_c1: Values, T_c2: Values, J_d: float) -> Values:
    """Return ω̇_d of (2), rad/s², from damper and clutch torques, N·m, and J_d, kg·m²."""
    return (T_d - T_c1 - T_c2) / J_d  # (2)


def input_shaft1_acceleration(T_c1: Values, T_c2: Values, T_o: Values, pair: GearPair) -> Values:
    """Return ω̇_c1 of (3), rad/s².

    Args:
        T_c1, T_c2: clutch torques, N·m.
        T_o: torque before final drive 1, N·m.
        pair: gives J_e1; R_2/R_1 is the paper's i_t2/i_t1.
    """
    return (T_c1 + pair.R_2 / pair.R_1 * T_c2 - T_o / pair.i_t1) / pair.J_e1  # (3)


def input_shaft2_acceleration(T_c1: Values, T_c2: Values, T_o: Values, pair: GearPair) -> Values:
    """Return ω̇_c2 of (4), rad/s²: (3) seen from clutch 2, ω̇_c2 = (R_2/R_1) ω̇_c1.

    Args:
        T_c1, T_c2: clutch torques, N·m.
        T_o: torque before final drive 2, N·m: that of (3) times i_f1/i_f2.
        pair: gives J_e2; R_1/R_2 is the paper's i_t1/i_t2.
    """
    return (pair.R_1 / pair.R_2 * T_c1 + T_c2 - T_o / pair.i_t2) / pair.J_e2  # (4)


def wheel_acceleration(T_o: Values, T_v: Values, i_f: float, J_v: float) -> Values:
    """Return ω̇_w of (5), rad/s².

    Args:
        T_o: torque before the final drive, N·m.
        T_v: resistance at the wheel, N·m.
        i_f: final drive ratio on the side of T_o.
        J_v: `Chassis.inertia_kgm2`.
    """
    return (i_f * T_o - T_v) / J_v  # (5)


def damper_torque(twist: Values, w_e: Values, w_d: Values, k_d: float, b_d: float) -> Values:
    """Return T_d of (7), N·m.

    Args:
        twist: θ_e − θ_d, rad.
        w_e, w_d: speed of engine and of the damper's secondary side, rad/s.
        k_d, b_d: stiffness, N·m/rad, and damping, N·m·s/rad.
    """
    return k_d * twist + b_d * (w_e - w_d)  # (7)


def torque_capacity(clutch: Clutch, normal_force: Values) -> Values:
    """Return C = μ R_c F_n, N·m, of all friction surfaces with the kinetic μ, at a normal force ≥ 0 in N."""
    return clutch.surfaces * clutch.friction_kinetic * clutch.effective_radius_m * normal_force


def slipping_clutch_torque(capacity: Values, slip: Values) -> Values:
    """Return T_ci of (8), (9), N·m; zero without slip, where the torque is no function of the capacity.

    Args:
        capacity: μ R_ci F_ni, N·m, not negative (`torque_capacity`).
        slip: ω_d − ω_ci, rad/s.
    """
    return capacity * np.sign(slip)  # (8), (9)


def before_final_drive(k_or_b: float, i_f: float) -> float:
    """Return a stiffness or damping of the output shaft as it is at the transmission output: divided by i_f²."""
    return k_or_b / i_f**2


def output_torque(
    twist: Values, w_c: Values, w_w: Values, i_t: float, i_f: float, k_o: float, b_o: float
) -> Values:
    """Return T_o of (10), N·m, before the final drive.

    Args:
        twist: θ_ci/i_ti − i_fi θ_w, rad.
        w_c: ω_ci, rad/s.
        w_w: wheel speed, rad/s.
        i_t, i_f: ratios of the engaged side.
        k_o, b_o: stiffness and damping *before* the final drive (`before_final_drive`).
    """
    return k_o * twist + b_o * (w_c / i_t - i_f * w_w)  # (10)


def road_load(chassis: Chassis, grade: Values, w_w: Values) -> Values:
    """Return T_v of (11) at the wheel, N·m, with v_x = r_w ω_w.

    Printed for a car that rolls forward. Rolling and air resistance are given the sign of v_x, so that they oppose
    it backwards too; at rest they are zero, since what friction then holds is no function of the speed.

    Args:
        chassis: of the vehicle.
        grade: θ_road, rad, positive uphill.
        w_w: wheel speed, rad/s.
    """
    weight = chassis.mass_kg * STANDARD_GRAVITY
    v_x = chassis.wheel_radius_m * w_w
    climbing = weight * np.sin(grade)
    rolling = chassis.rolling_resistance * weight * np.cos(grade) * np.sign(v_x)
    air = 0.5 * AIR_DENSITY * v_x * np.abs(v_x) * chassis.drag_coefficient * chassis.frontal_area_m2
    return chassis.wheel_radius_m * (climbing + rolling + air)  # (11)
