"""Stability and observability of the 2014 observer: eigenvalues, null space, Lyapunov function, error bounds.

Equation numbers are the paper's (Oh, Choi et al., Mechatronics 2014). Errors are truth minus estimate, in the
order of `CORE`; both clutch torques follow these six as a cascade with the pole -L each. With constant unknown
torques and adaptive states the errors obey x̃' = A x̃ + b, where A, rows and columns 3 to 8 of the matrix in (68),
depends on the engine speed ω_e and the wheel acceleration dω_w/dt alone, and is affine in both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space
from scipy.optimize import minimize_scalar

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.estimators.oh2014 import model as oh2014_model
from dctorque_can.estimators.oh2014 import observer as oh2014
from dctorque_can.estimators.oh2014.design import Oh2014Design

Floats = NDArray[np.float64]

CORE = ("tau_e", "tau_o", "w_e", "T_c", "w_c1", "T_a1")
"""States of the core: τ_e [N·m·s/rad], τ_o [kg·m²], ω_e [rad/s], T_c [N·m], ω_c1 [rad/s], T_a1 [N·m]."""

RANK_TOLERANCE = 1e-8  # of the largest singular value, with states scaled to one unit of torque each


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of the running observer with one pair of gears, and the inertias that they rest on.

    Attributes:
        l_1, l_3: of (59), (63), 1/s.
        l_2, l_4: of (60), (64), N·m/rad.
        L: L_1 = L_2 of (37), (38), 1/s.
        g_e: γ_e of (52), s/rad².
        g_t: γ_t of (53), s³/rad².
        g_l: γ_l of (52), (53), 1/s.
        J_e: engine and damper, kg·m².
        J_e1: effective inertia at shaft 1, kg·m².
        R_1: total ratio of the gear on shaft 1.
    """

    l_1: float
    l_2: float
    l_3: float
    l_4: float
    L: float
    g_e: float
    g_t: float
    g_l: float
    J_e: float
    J_e1: float
    R_1: float


def observer_records(vehicle: Vehicle, design: Oh2014Design, g1: int, g2: int) -> tuple[Any, Any]:
    """Return the records `CONSTANTS` and `PAIR` of the running observer, gears ``g1`` and ``g2`` engaged."""
    c = oh2014_model.constants(vehicle, design)
    pair = np.zeros(1, oh2014_model.PAIR)
    oh2014_model.set_pair(pair[0], c[0], g1, g2)
    return c[0], pair[0]


def gains(c: Any, pair: Any) -> Gains:
    """Return the gains that the running observer uses."""
    J_e, J_e1 = float(c["J_e"]), float(pair["J_es"])
    l_1, l_2 = oh2014.continuous_gains(float(c["p_e"]), J_e)
    l_3, l_4 = oh2014.continuous_gains(float(c["p_s"]), J_e1)
    L, g_l = float(c["L"]), float(c["g_l"])
    return Gains(l_1, l_2, l_3, l_4, L, float(pair["g_e"]), float(pair["g_t"]), g_l, J_e, J_e1, float(pair["R_s"]))


def error_matrix(g: Gains, w_e: float, a_w: float, loss: float = 1.0) -> Floats:
    """Return A ``[6, 6]`` of the frozen error system, 1/s where rows and columns have the same unit.

    Args:
        g: gains.
        w_e: engine speed, rad/s.
        a_w: wheel acceleration, rad/s².
        loss: factor from the torque at the wheels to that before gear losses; the paper has none, 1.
    """
    A = np.zeros((6, 6))
    A[0, 0] = A[1, 1] = -g.g_l
    A[0, 2] = -g.J_e * g.l_1 * g.g_e * w_e  # (52), ε_e = J_e l_1 ω̃_e
    A[1, 4] = g.J_e1 * g.l_3 * g.g_t * a_w / g.R_1  # (53), ε_o = J_e1 l_3 ω̃_c1
    A[2, 0], A[2, 2], A[2, 3] = w_e / g.J_e, -g.l_1, -1.0 / g.J_e  # (59)
    A[3, 2] = g.l_2  # (60)
    A[4, 1], A[4, 4], A[4, 5] = -loss * a_w / (g.J_e1 * g.R_1), -g.l_3, 1.0 / g.J_e1  # (63)
    A[5, 4] = -g.l_4  # (64)
    return A


def eigenvalues(A: Floats) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the three eigenvalues of the engine side (τ_e, ω_e, T_c) and those of the clutch side, 1/s.

    The two sides are not coupled. The slowest comes first, and then the pair of the unknown input observer.
    """
    sides = []
    for rows in ((0, 2, 3), (1, 4, 5)):
        values = np.asarray(np.linalg.eigvals(A[np.ix_(rows, rows)]), np.complex128)
        sides.append(values[np.argsort(-values.real, kind="stable")])
    return sides[0], sides[1]


# --- observability ---


@dataclass(frozen=True, slots=True)
class Observability:
    """What the outputs ω_e and ω_c1 tell of the six states of `CORE`.

    Attributes:
        rank: numerical rank of the observability matrix.
        singular_values: float64 ``[6]``, of the scaled matrix, largest is 1.
        unobservable: float64 ``[6, 6 - rank]``, basis of the null space in the units of `CORE`.
    """

    rank: int
    singular_values: Floats
    unobservable: Floats


def observability(g: Gains, w_e: float, a_w: float, loss: float = 1.0, leakage: bool = False) -> Observability:
    """Return rank and null space of the observability matrix at one frozen point.

    Each state is scaled by what one N·m of clutch torque makes of it and time by the faster pole, so that all
    entries are of order one; singular values below `RANK_TOLERANCE` times the largest are zero.

    Args:
        g: gains.
        w_e: engine speed, rad/s.
        a_w: wheel acceleration, rad/s².
        loss: factor from the torque at the wheels to that before gear losses.
        leakage: False for the physical model, τ_e, τ_o, T_c and T_a1 constant; True adds the observer's own
            assumption that τ_e and τ_o return to their nominal values.
    """
    free = Gains(0.0, 0.0, 0.0, 0.0, g.L, 0.0, 0.0, g.g_l if leakage else 0.0, g.J_e, g.J_e1, g.R_1)
    p_e, p_s = g.l_1 / 2.0, g.l_3 / 2.0
    unit_o = abs(g.R_1) / oh2014_model.REFERENCE_WHEEL_ACCELERATION
    unit = np.array(
        [1.0 / oh2014_model.REFERENCE_ENGINE_SPEED, unit_o, 1.0 / (g.J_e * p_e), 1.0, 1.0 / (g.J_e1 * p_s), 1.0]
    )
    A = error_matrix(free, w_e, a_w, loss) * unit / unit[:, None] / max(p_e, p_s)
    rows = [np.eye(6)[[2, 4]]]
    for _ in range(5):
        rows.append(rows[-1] @ A)
    stacked = np.vstack(rows)
    singular: Floats = np.asarray(np.linalg.svd(stacked, compute_uv=False), np.float64)
    values: Floats = np.asarray(singular / singular[0], np.float64)
    basis = np.asarray(null_space(stacked, rcond=RANK_TOLERANCE)) * unit[:, None]
    return Observability(int(np.sum(values > RANK_TOLERANCE)), values, np.asarray(basis, np.float64))


@dataclass(frozen=True, slots=True)
class Misreading:
    """What an error that cannot be observed becomes; estimate minus truth, N·m per N·m of the error.

    Attributes:
        sum_per_engine: T̂_c of an engine torque error: the whole of it, δτ_e ω_e = δT_c.
        clutch1_per_engine, clutch2_per_engine: T̂_c1 and T̂_c2 of it by (65), (66).
        side_per_output: T̂_a1 of an error of the output torque at the wheels, δτ_o dω_w/dt / R_1 = δT_a1.
        clutch1_per_output, clutch2_per_output: T̂_c1 and T̂_c2 of it by (65), (66).
    """

    sum_per_engine: float
    clutch1_per_engine: float
    clutch2_per_engine: float
    side_per_output: float
    clutch1_per_output: float
    clutch2_per_output: float


def misreading(pair: Any, loss: float = 1.0) -> Misreading:
    """Return what errors along the null space become with both clutches closed."""
    engine = oh2014.unknown_input_torques(pair, 1.0, 0.0, True, True)
    side = loss / float(pair["R_s"])
    output = oh2014.unknown_input_torques(pair, 0.0, side, True, True)
    return Misreading(1.0, float(engine[0]), float(engine[1]), side, float(output[0]), float(output[1]))


# --- the Lyapunov function ---


def lyapunov_weights(g: Gains) -> Floats:
    """Return the diagonal ``[6]`` of P in V = ½ x̃ᵀ P x̃ of (74): neither ω_e nor dω_w/dt is in it."""
    return np.array(
        [
            1.0 / (g.J_e**2 * g.l_1 * g.g_e),
            1.0 / (g.J_e1**2 * g.l_3 * g.g_t),
            1.0,
            1.0 / (g.J_e * g.l_2),
            1.0,
            1.0 / (g.J_e1 * g.l_4),
        ]
    )


def scaled(A: Floats, P: Floats) -> Floats:
    """Return A ``[6, 6]`` in the coordinates z = √P x̃, in which V = ½ zᵀz; 1/s."""
    root = np.sqrt(P)
    return np.asarray(root[:, None] * A / root, np.float64)


def lyapunov_rate(A: Floats, P: Floats) -> Floats:
    """Return Aᵀ P + P A in the coordinates of `scaled`, ``[6, 6]``, 1/s: dV/dt = ½ zᵀ (…) z."""
    S = scaled(A, P)
    return S + S.T


def rate_spread(g: Gains) -> float:
    """Return by how much `lyapunov_rate` depends on ω_e and dω_w/dt, relative to the terms that have to cancel.

    A is affine in (ω_e, dω_w/dt). So the three points (0, 0), (1, 0) and (0, 1), here in reference values, stand
    for all: a result of zero (rounding) means that V is a common Lyapunov function, whatever both do over time.
    """
    P = lyapunov_weights(g)
    w_e, a_w = oh2014_model.REFERENCE_ENGINE_SPEED, oh2014_model.REFERENCE_WHEEL_ACCELERATION
    at_rest = lyapunov_rate(error_matrix(g, 0.0, 0.0), P)
    spread = 0.0
    for point in ((w_e, 0.0), (0.0, a_w)):
        A = error_matrix(g, *point)
        moved = np.abs(scaled(A, P) - scaled(error_matrix(g, 0.0, 0.0), P)).max()
        spread = max(spread, float(np.abs(lyapunov_rate(A, P) - at_rest).max() / moved))
    return spread


def weight_jump(before: Gains, after: Gains) -> float:
    """Return the largest ratio ≥ 1 of a weight of (74) after a gear change to that before, either way round."""
    ratio = lyapunov_weights(after) / lyapunov_weights(before)
    return float(max(ratio.max(), 1.0 / ratio.min()))


def acceleration_limit(g: Gains, efficiency: float) -> float:
    """Return the wheel acceleration up to which V does not grow in spite of gear losses, rad/s²; inf without any.

    (63) then has f τ_o dω_w/dt with η ≤ f ≤ 1/η while (53) has no f, and V̇ keeps the cross term (1 - f) c τ̃_o ω̃_c1
    in scaled coordinates, c = √(l_3 γ_t) dω_w/dt / R_1. It stays below zero while ((1 - f) c)² ≤ 4 γ_l l_3, also
    where drive turns to coast, since the factor of a difference of two torques lies between η and 1/η.
    """
    excess = 1.0 / efficiency - 1.0
    return 2.0 * abs(g.R_1) * math.sqrt(g.g_l / g.g_t) / excess if excess > 0.0 else math.inf


@dataclass(frozen=True, slots=True)
class ErrorBound:
    """What holds for one side however fast ω_e and dω_w/dt vary within their limits.

    Attributes:
        decay_rate: every error dies out at least as fast as exp(-rate t) without disturbance, 1/s.
        loop_gain: of the loop through the adaptive state; below 1 the small-gain bound holds.
        torque_per_adaptive: ultimate bound of |T̃_c| (|T̃_a1|) in N·m per unit of |τ_e| (|τ_o - τ_on|).
        torque_per_rate: the same in N·m per N·m/s of |dT_c/dt| (|dT_a1/dt|).
    """

    decay_rate: float
    loop_gain: float
    torque_per_adaptive: float
    torque_per_rate: float


def engine_bound(g: Gains, max_engine_speed: float) -> ErrorBound:
    """Return the bound of (τ_e, ω_e, T_c) for |ω_e| ≤ ``max_engine_speed``, rad/s."""
    weights = lyapunov_weights(g)[[0, 3]]
    return _bound(g.g_l, g.l_1 / 2.0, max_engine_speed * math.sqrt(g.l_1 * g.g_e), 1.0, weights)


def shaft_bound(g: Gains, max_wheel_acceleration: float, efficiency: float = 1.0) -> ErrorBound:
    """Return the bound of (τ_o, ω_c1, T_a1) for |dω_w/dt| ≤ ``max_wheel_acceleration``, rad/s²."""
    weights = lyapunov_weights(g)[[1, 5]]
    coupling = max_wheel_acceleration * math.sqrt(g.l_3 * g.g_t) / abs(g.R_1)
    return _bound(g.g_l, g.l_3 / 2.0, coupling, efficiency, weights)


def _bound(g_l: float, p: float, coupling: float, efficiency: float, weights: Floats) -> ErrorBound:
    """Bound y' = -γ_l y - c w + γ_l Y, w' = f c y - 2p w - p T, T' = p w + d for all |c| ≤ ``coupling``.

    These are the scaled errors of one side. V of (74) does not decay along T. W = ½|z|² + ε w T does:
    dW/dt ≤ -2λ W holds everywhere if it does at the vertices (c, f c), since the rate is affine in both and its
    smallest eigenvalue concave. ε is chosen for the largest λ, and |z_T| ends within √(M⁻¹)_TT |disturbance|_M/λ.

    A sharper bound takes c y as the input of the double pole -p. Of its peak gains (∫ of the impulse responses)
    2/(e p) and 1/p lead from c y to w and T, 1/p and 2/p from d, and 1/γ_l from c w to y. The loop
    κ = 2 f c²/(e p γ_l) has to be below 1.
    """
    losses = (efficiency, 1.0 / efficiency)

    def decay(eps: float) -> float:
        M = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, eps], [0.0, eps, 1.0]])
        rates = []
        for f in losses:
            A = np.array([[-g_l, -coupling, 0.0], [f * coupling, -2.0 * p, -p], [0.0, p, 0.0]])
            rates.append(float(eigh(-0.5 * (A.T @ M + M @ A), M, eigvals_only=True)[0]))
        return min(rates)

    found = minimize_scalar(lambda power: -decay(10.0**power), bounds=(-12.0, -0.05), method="bounded")
    eps = 10.0 ** float(found.x)
    rate = max(decay(eps), 0.0)
    reach = 1.0 / math.sqrt(1.0 - eps**2) / rate if rate > 0.0 else math.inf
    ratio = math.sqrt(weights[0] / weights[1])
    c, f = coupling, losses[1]
    loop = 2.0 * f * c**2 / (math.e * p * g_l)
    open_loop = 1.0 / (1.0 - loop) if loop < 1.0 else math.inf
    per_adaptive = min(reach * g_l, f * c / p * open_loop) if c > 0.0 else 0.0
    per_rate = min(reach, 2.0 / p + f * c**2 / (g_l * p**2) * open_loop) if c > 0.0 else 2.0 / p
    return ErrorBound(rate, loop, per_adaptive * ratio, per_rate)


def stationary_errors(
    A: Floats, g: Gains, tau_e: float = 0.0, tau_o_excess: float = 0.0, dT_c: float = 0.0, dT_a1: float = 0.0
) -> Floats:
    """Return the errors ``[6]`` at which the frozen system comes to rest under constant disturbances.

    Args:
        A: `error_matrix`.
        g: gains.
        tau_e: true τ_e, N·m·s/rad, which the leakage draws to 0.
        tau_o_excess: true τ_o - τ_on, kg·m².
        dT_c: dT_c/dt, N·m/s.
        dT_a1: dT_a1/dt, N·m/s.
    """
    b = np.array([g.g_l * tau_e, g.g_l * tau_o_excess, 0.0, dT_c, 0.0, dT_a1])
    return np.asarray(-np.linalg.solve(A, b), np.float64)
