"""The individual clutch torque observer of Oh, Choi et al. (Mechatronics 2014), section 3.

Equation numbers are the paper's. `right_hand_side` is the continuous observer (68) as printed. On a bus,
speeds arrive as samples, so the same pieces run in sampled form: `predict` moves the model between frames, and
each frame corrects it once with the poles that the continuous observer would have had over the time since the
frame before (`sampled_gains`). For short sampling times both are the same; at 10 ms the sampled form adds no lag.

Everything here is scalar and compiled; states and constants are records with the paper's symbols.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled, compiled_without_allocation
from dctorque_can.estimators.inputs import STANDSTILL
from dctorque_can.estimators.oh2014.design import RoadLoad
from dctorque_can.estimators.oh2014.model import set_pair
from dctorque_can.estimators.oh2014.thresholds import MAX_TAU_E, MAX_TAU_O, MAX_WHEEL_ACCELERATION

STATE = np.dtype(
    [
        ("T_c1", "f8"),
        ("T_c2", "f8"),
        ("tau_e", "f8"),
        ("tau_o", "f8"),
        ("w_e", "f8"),
        ("T_c", "f8"),
        ("w_s", "f8"),  # ω_c1, or ω_c2 in the mirrored form
        ("T_a", "f8"),  # T_a1, or T_a2 in the mirrored form
        ("T_n", "f8"),  # known part of the output torque, at the wheel
        ("w_w", "f8"),  # wheel speed filter
        ("a_w", "f8"),  # wheel acceleration
        ("T_c1_uio", "f8"),
        ("T_c2_uio", "f8"),
    ],
    align=True,
)
"""The eight states of (68), the known road load, and the filter that gives the wheel acceleration."""


# --- the pieces of the observer, shared by the continuous and the sampled form ---


@compiled_without_allocation
def continuous_gains(p: float, J: float) -> tuple[float, float]:
    """Return (l, l') that put both poles of s² + l s + l'/J at -p, as in (59), (60) and (63), (64)."""
    return 2.0 * p, p**2 * J


@compiled_without_allocation
def sampled_gains(p: float, h: float) -> tuple[float, float]:
    """Return the shares (α, β) of an innovation e that one sample, ``h`` seconds after the last, may correct.

    The speed moves by α e, its rate by β e / h: both poles at exp(-p h), so α → l h, β → p² h² for small h.
    """
    z = math.exp(-p * h)
    return 1.0 - z * z, (1.0 - z) ** 2


@compiled_without_allocation
def adaptation(pair: Any, w_e: float, a_w: float, eps_e: float, eps_o: float) -> tuple[float, float]:
    """Return the driving terms of (52) and (53); the leakage is apart."""
    return pair.g_e * w_e * eps_e, -pair.g_t * (a_w / pair.R_s) * eps_o


@compiled_without_allocation
def shaft_torque_rates(
    c: Any, pair: Any, carries_1: bool, carries_2: bool, w_c1: float, w_c2: float, dT_o: float
) -> tuple[float, float]:
    """Return the model's rates of both clutch torques, first term of (37) and (38), with ω_o from (36).

    A shaft in neutral obeys none of these, and one whose clutch is open transfers nothing: it leaves (36) and D.
    """
    D = weighted = twist_1 = twist_2 = 0.0
    if carries_1:
        D += c.k_t1 * pair.i_f1**2  # D = k_t1 i_f1² + k_t2 i_f2²
        twist_1 = w_c1 / pair.i_t1
        weighted += c.k_t1 * pair.i_f1 * twist_1
    if carries_2:
        D += c.k_t2 * pair.i_f2**2
        twist_2 = w_c2 / pair.i_t2
        weighted += c.k_t2 * pair.i_f2 * twist_2
    if D == 0.0:
        return 0.0, 0.0
    w_o = (weighted - dT_o) / D  # (36)
    dT_c1 = c.k_t1 / pair.i_t1 * (twist_1 - pair.i_f1 * w_o) if carries_1 else 0.0  # (37)
    dT_c2 = c.k_t2 / pair.i_t2 * (twist_2 - pair.i_f2 * w_o) if carries_2 else 0.0  # (38)
    return dT_c1, dT_c2


@compiled_without_allocation
def unknown_input_torques(
    pair: Any, T_c: float, T_a: float, carries_1: bool, carries_2: bool
) -> tuple[float, float]:
    """Return both clutch torques from the unknown input observers.

    (65), (66) when both clutches may carry torque; with one of them open the other carries everything.
    """
    if not carries_1 or not carries_2:
        return (T_c if carries_1 else 0.0), (T_c if carries_2 else 0.0)
    delta = pair.R_1 - pair.R_2
    if pair.side == 1:
        return (pair.R_1 * T_a - pair.R_2 * T_c) / delta, pair.R_1 * (T_c - T_a) / delta  # (65), (66)
    return pair.R_2 * (T_a - T_c) / delta, (pair.R_1 * T_c - pair.R_2 * T_a) / delta  # mirrored


@compiled
def right_hand_side(
    x: NDArray[np.float64],
    c: Any,
    pair: Any,
    w_e: float,
    w_c1: float,
    w_c2: float,
    a_w: float,
    T_en: float,
) -> NDArray[np.float64]:
    """Return dX/dt of (68) for X = [T_c1, T_c2, τ_e, τ_o, ω_e, T_c, ω_c1, T_a1], both gears engaged, T_n = 0.

    Args:
        x: float64 ``[8]``.
        c: `CONSTANTS` record.
        pair: `PAIR` record.
        w_e, w_c1, w_c2: measured speeds, rad/s.
        a_w: wheel acceleration, rad/s².
        T_en: nominal engine torque, N·m.
    """
    T_c1, T_c2, tau_e, tau_o, w_e_hat, T_c, w_c1_hat, T_a1 = x
    l_1, l_2 = continuous_gains(c.p_e, c.J_e)
    l_3, l_4 = continuous_gains(c.p_s, pair.J_es)
    e_e = w_e - w_e_hat
    e_o = w_c1 - w_c1_hat
    eps_e = c.J_e * l_1 * e_e
    eps_o = pair.J_es * l_3 * e_o
    drive_e, drive_o = adaptation(pair, w_e, a_w, eps_e, eps_o)
    if c.printed_rate_law:
        _, rate_o = adaptation(pair, w_e, a_w, eps_e, eps_o + eps_e)
    else:
        rate_o = drive_o
    # the leakage part of dT_o/dt enters (36) and is taken out again by the last term of (37), (38)
    dT_c1, dT_c2 = shaft_torque_rates(c, pair, True, True, w_c1, w_c2, a_w * rate_o)
    T_c1_uio, T_c2_uio = unknown_input_torques(pair, T_c, T_a1, True, True)
    T_e = T_en + w_e * tau_e  # (46)
    T_o = a_w * tau_o  # (47)
    return np.array(
        [
            dT_c1 + c.L * (T_c1_uio - T_c1),  # (37)
            dT_c2 + c.L * (T_c2_uio - T_c2),  # (38)
            -c.g_l * tau_e + drive_e,  # (52)
            c.g_l * (c.J_v - tau_o) + drive_o,  # (53), τ_on = J_v
            (T_e - T_c) / c.J_e + l_1 * e_e,  # (59)
            -l_2 * e_e,  # (60)
            T_a1 / pair.J_es - T_o / (pair.J_es * pair.R_s) + l_3 * e_o,  # (63)
            l_4 * e_o,  # (64)
        ]
    )


# --- the sampled form ---


@compiled_without_allocation
def loss_factor(c: Any, pair: Any, T_o: float) -> float:
    """Return the factor from a torque at the wheels to the one before gear and final drive losses.

    The engine drives when torque and ratio have the same sign, also in reverse.
    """
    return 1.0 / c.efficiency if T_o * pair.R_s >= 0.0 else float(c.efficiency)


@compiled_without_allocation
def after_losses(c: Any, pair: Any, T_o: float) -> float:
    """Return the torque at the wheels of a torque before gear and final drive losses, N·m."""
    return float(T_o / loss_factor(c, pair, T_o))


@compiled_without_allocation
def shaft_acceleration(s: Any, c: Any, pair: Any) -> float:
    """Return the model's dω/dt of the side's shaft, (63) without innovation; rad/s²."""
    if pair.side == 0:
        return 0.0
    T_o = s.T_n + s.a_w * s.tau_o  # (47)
    T_o *= loss_factor(c, pair, T_o)
    return float((s.T_a - T_o / pair.R_s) / pair.J_es)  # (63)


@compiled_without_allocation
def predict(s: Any, c: Any, pair: Any, T_en: float, dt: float) -> None:
    """Move the model by ``dt`` seconds without any measurement."""
    dw_s = shaft_acceleration(s, c, pair)
    s.w_e += dt * (T_en + s.w_e * s.tau_e - s.T_c) / c.J_e  # (59)
    s.w_s += dt * dw_s
    s.w_w += dt * s.a_w
    s.tau_e -= dt * c.g_l * s.tau_e  # (52)
    s.tau_o += dt * c.g_l * (c.J_v - s.tau_o)  # (53)


@compiled_without_allocation
def correct_wheel(s: Any, pair: Any, w_w: float, h: float) -> None:
    """Take a wheel speed sample: second-order filter with the double pole p_w, gives dω_w/dt."""
    alpha, beta = sampled_gains(pair.p_w, h)
    e = w_w - s.w_w
    s.w_w += alpha * e
    s.a_w = min(max(s.a_w + beta / h * e, -MAX_WHEEL_ACCELERATION), MAX_WHEEL_ACCELERATION)


@compiled_without_allocation
def correct_engine(s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool, w_e: float, h: float) -> None:
    """Take an engine speed sample, ``h`` seconds after the last: (59), (60), (52)."""
    alpha, beta = sampled_gains(c.p_e, h)
    e = w_e - s.w_e
    s.w_e += alpha * e
    s.T_c -= c.J_e * beta / h * e  # (60)
    impulse = c.J_e * alpha * e  # ∫ε_e dt
    d_tau_e, _ = adaptation(pair, w_e, s.a_w, impulse, 0.0)
    s.tau_e = min(max(s.tau_e + d_tau_e, -MAX_TAU_E), MAX_TAU_E)
    if c.printed_rate_law:
        _, d_tau_o = adaptation(pair, w_e, s.a_w, 0.0, impulse)
        add_shaft_torques(s, shaft_torque_rates(c, pair, carries_1, carries_2, 0.0, 0.0, s.a_w * d_tau_o))


@compiled_without_allocation
def correct_shaft(s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool, w_s: float, h: float) -> None:
    """Take a sample of the side's shaft speed: (63), (64), (53)."""
    alpha, beta = sampled_gains(c.p_s, h)
    e = w_s - s.w_s
    s.w_s += alpha * e
    s.T_a += pair.J_es * beta / h * e  # (64)
    _, d_tau_o = adaptation(pair, 0.0, s.a_w, 0.0, pair.J_es * alpha * e)
    s.tau_o = min(max(s.tau_o + d_tau_o, 0.0), MAX_TAU_O * c.J_v)
    add_shaft_torques(s, shaft_torque_rates(c, pair, carries_1, carries_2, 0.0, 0.0, s.a_w * d_tau_o))


@compiled_without_allocation
def add_shaft_torques(s: Any, change: tuple[float, float]) -> None:
    """Add the model's change of both clutch torques."""
    s.T_c1 += change[0]
    s.T_c2 += change[1]


@compiled_without_allocation
def settle(s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool, dt: float) -> None:
    """Draw the clutch torques to the unknown input estimates (37), (38) over ``dt``."""
    s.T_c1_uio, s.T_c2_uio = unknown_input_torques(pair, s.T_c, s.T_a, carries_1, carries_2)
    share = 1.0 - math.exp(-c.L * dt)
    s.T_c1 = s.T_c1 + share * (s.T_c1_uio - s.T_c1) if carries_1 else 0.0
    s.T_c2 = s.T_c2 + share * (s.T_c2_uio - s.T_c2) if carries_2 else 0.0


@compiled_without_allocation
def learn_road_load(s: Any, c: Any, pair: Any, carries_1: bool, carries_2: bool, dt: float) -> bool:
    """Renew the known part T_n of the output torque over ``dt``; return whether it was learned.

    While at most one clutch carries torque, that is T_c alone. So T_a is known, and what the clutch-side observer
    finds instead belongs to the output torque. At rest the brakes may hold anything, and nothing is learned.
    """
    if c.road_load == RoadLoad.FLAT:
        s.T_n = flat_road_load(c, s.w_w)
    if c.road_load != RoadLoad.LEARNED or pair.side == 0 or (carries_1 and carries_2) or abs(s.w_w) < STANDSTILL:
        return False
    R_own = pair.R_1 if carries_1 else pair.R_2
    T_a = s.T_c * R_own / pair.R_s if carries_1 or carries_2 else 0.0
    factor = loss_factor(c, pair, s.T_n + s.a_w * s.tau_o)
    s.T_n += (1.0 - math.exp(-dt / c.T_road)) * pair.R_s / factor * (T_a - s.T_a)
    return True


@compiled_without_allocation
def flat_road_load(c: Any, w_w: float) -> float:
    """Return (11) without grade, N·m at the wheel, zero at standstill."""
    if abs(w_w) < STANDSTILL:
        return 0.0
    return math.copysign(c.roll_nm + c.drag_nm * w_w * w_w, w_w)


@compiled_without_allocation
def change_gears(s: Any, c: Any, pair: Any, g1: int, g2: int, w_c1: float, w_c2: float) -> None:
    """Take new gears: the clutch-side observer changes its shaft, the torques it stands for do not jump."""
    set_pair(pair, c, g1, g2)
    if pair.side == 1:
        s.w_s = w_c1
        s.T_a = s.T_c1 + (pair.R_2 / pair.R_1 * s.T_c2 if g2 != 0 else 0.0)  # (61)
    elif pair.side == 2:
        s.w_s = w_c2
        s.T_a = s.T_c2
    else:
        s.T_a = 0.0


@compiled_without_allocation
def reset(s: Any, c: Any, w_e: float, w_s: float, w_w: float, T_en: float) -> None:
    """Start anew at the measured speeds; no torque is assumed but the engine's own balance."""
    s.T_c1 = s.T_c2 = s.T_a = s.T_c1_uio = s.T_c2_uio = 0.0
    s.tau_e = 0.0
    s.tau_o = c.J_v
    s.w_e, s.w_s, s.w_w, s.a_w = w_e, w_s, w_w, 0.0
    s.T_c = T_en
    s.T_n = 0.0 if c.road_load == RoadLoad.NONE else flat_road_load(c, w_w)
