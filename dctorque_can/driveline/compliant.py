"""The model with transfer shaft compliance of section 2.2; engine and damper stay as in 2.1: (1), (2), (7).

SI units; torque is positive from the engine to the wheels. Every function takes numbers or arrays (`Values`) and
returns what their shapes broadcast to. From here on T_o stands at the output shaft, *after* the final drive.

**Own inertias.** The paper prints J_e1, J_e2 in (12), (13). Behind a transfer shaft each input shaft moves on its
own, so its own inertia J_1, J_2 (`GearPair`) belongs there; the effective ones would count each shaft twice.

Gear losses are not part of the paper's equations. A shaft in neutral has T_ti = 0 in (12)–(14).
"""

from __future__ import annotations

from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.driveline.values import Values


def input_shaft_acceleration(T_c: Values, T_t: Values, i_t: float, J: float) -> Values:
    """Return ω̇_ci of (12), (13), rad/s².

    Args:
        T_c: torque of the shaft's clutch, N·m.
        T_t: torque of its transfer shaft, N·m.
        i_t: gear ratio.
        J: own inertia J_1 or J_2 of the shaft, kg·m².
    """
    return (T_c - T_t / i_t) / J  # (12), (13)


def output_shaft_acceleration(T_t1: Values, T_t2: Values, T_o: Values, pair: GearPair, J_o: float) -> Values:
    """Return ω̇_o of (14), rad/s², from transfer shaft and output torques, N·m, and J_o, kg·m²."""
    return (pair.i_f1 * T_t1 + pair.i_f2 * T_t2 - T_o) / J_o  # (14)


def transfer_shaft_torque(
    twist: Values, w_c: Values, w_o: Values, i_t: float, i_f: float, k_t: float, b_t: float
) -> Values:
    """Return T_ti of (15), (16), N·m.

    Args:
        twist: θ_ci/i_ti − i_fi θ_o, rad.
        w_c: ω_ci, rad/s.
        w_o: speed of the output shaft, rad/s.
        i_t, i_f: ratios of the engaged gear.
        k_t, b_t: stiffness, N·m/rad, and damping, N·m·s/rad.
    """
    return k_t * twist + b_t * (w_c / i_t - i_f * w_o)  # (15), (16)


def output_torque(twist: Values, w_o: Values, w_w: Values, k_o: float, b_o: float) -> Values:
    """Return T_o of (17), N·m, at the output shaft.

    Args:
        twist: θ_o − θ_w, rad.
        w_o, w_w: speed of output shaft and wheel, rad/s.
        k_o, b_o: `OutputShaft` stiffness, N·m/rad, and damping, N·m·s/rad.
    """
    return k_o * twist + b_o * (w_o - w_w)  # (17)


def wheel_acceleration(T_o: Values, T_v: Values, J_v: float) -> Values:
    """Return ω̇_w, rad/s², from output and resistance torque, N·m, and J_v, kg·m²: (5) with T_o after i_f."""
    return (T_o - T_v) / J_v  # with (17)
