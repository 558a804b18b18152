"""The matrix arithmetic of the Kalman filter: one prediction and one scalar measurement.

The clutch torques are states, and they cut the driveline in two: engine and damper depend on one another, gearbox
and car likewise, and all else decays on its own or is the integral of something that does. So the rows of F are,
with the errors of the nominal engine torque among the columns of the first ones,

    W_E, W_D, TH_D                 of W_E, W_D, TH_D, both clutch torques and rates, DT_E, GAIN, LAG_1, LAG_2
    W_C1 … W_B, TH_T1 … T_X        of one another (W_B of itself alone), both clutch torques and rates, T_V
    T_C1, T_C2                     of themselves and their rates
    all others                     of themselves

Each row of a product is written as the sum that it is: a vector unit then does several places of the row at once,
with the sum in a register. Every place is summed in the order in which it is written here, whatever that unit is.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators.kalman.model import (
    CAR,
    COUPLED,
    DT_E,
    ENGINE,
    GAIN,
    LAG_1,
    LAG_2,
    LATE,
    R_1,
    R_2,
    T_C1,
    T_C2,
    T_V,
    T_X,
    TH_D,
    TH_O,
    TH_T1,
    TH_T2,
    W_B,
    W_C1,
    W_C2,
    W_D,
    W_E,
    W_O,
    W_W,
    WIDTH,
    N,
)
from dctorque_can.estimators.kalman.seen import Seen, variance

Noises = tuple[float, float, float, float, float]
"""Factors of `noise.process_noise`."""

_ENGINE, _CAR = np.array(ENGINE, np.uint8), np.array(CAR, np.uint8)
_DRIVEN = np.array([0, 1, 0, 1, 3, 4], np.uint8)  # which factor the noise of T_C1 … DT_E has
_AT_ONCE = 5  # rows of the covariance in a measurement; divides N


@compiled_without_allocation
def carry_on(f: Any, step: Any, T_en: float, q: Noises) -> None:
    """f.next ← F x + b T_en, P ← F P Fᵀ + Q.

    To F belongs what errors of T_en do to the state: b times ``f.per_error`` in the columns of their states.

    Args:
        f: `filter.FILTER`.
        step: `model.STEP` of the model.
        T_en: nominal engine torque, N·m.
        q: factors of the noises, of `noise.process_noise`.
    """
    e_0, e_1, e_2 = f.per_error[0], f.per_error[1], f.per_error[2]
    T_en += e_0 * f.x[GAIN] + e_1 * f.x[LAG_1] + e_2 * f.x[LAG_2]
    for j in range(N):
        f.along[j] = e_0 * f.P[GAIN, j] + e_1 * f.P[LAG_1, j] + e_2 * f.P[LAG_2, j]
    multiply_engine(f, step, T_en)
    multiply_car(f, step)
    for k in range(N):
        for i in range(COUPLED):
            f.PF[k, i] = f.FP[i, k]
    sum_noise(f, step, q)
    multiply_car_again(f, step)
    multiply_engine_again(f, step)
    multiply_rest(f, step, q)
    mirror(f)
    carry_lasting(f, step)


@compiled_without_allocation
def carry_lasting(f: Any, step: Any) -> None:
    """s ← F s of what the lasting error of an open clutch's drag has done to the state (`filter.FILTER`).

    All columns up to those of GAIN are written out, so that a vector unit does several rows at once; `WIDTH` of
    them, for which ``f.h`` has room.
    """
    F, columns, b = step.phi, step.columns, step.input
    for c in range(2):
        if not f.lasts[c]:
            continue
        s = f.lasting[c]
        T_en = f.per_error[0] * s[GAIN] + f.per_error[1] * s[LAG_1] + f.per_error[2] * s[LAG_2]
        s_0, s_1, s_2, s_3, s_4, s_5 = s[0], s[1], s[2], s[3], s[4], s[5]
        s_6, s_7, s_8, s_9, s_10, s_11 = s[6], s[7], s[8], s[9], s[10], s[11]
        s_12, s_13, s_14, s_15, s_16, s_17 = s[12], s[13], s[14], s[15], s[16], s[17]
        for i in range(WIDTH):
            total = columns[0, i] * s_0 + columns[1, i] * s_1 + columns[2, i] * s_2 + columns[3, i] * s_3
            total += columns[4, i] * s_4 + columns[5, i] * s_5 + columns[6, i] * s_6 + columns[7, i] * s_7
            total += columns[8, i] * s_8 + columns[9, i] * s_9 + columns[10, i] * s_10 + columns[11, i] * s_11
            total += columns[12, i] * s_12 + columns[13, i] * s_13 + columns[14, i] * s_14
            total += columns[15, i] * s_15 + columns[16, i] * s_16 + columns[17, i] * s_17
            f.h[i] = total + b[i] * T_en
        for i in range(COUPLED):
            f.lasting[c, i] = f.h[i]
        s[T_C1] = F[T_C1, T_C1] * s_12 + F[T_C1, R_1] * s_14
        s[T_C2] = F[T_C2, T_C2] * s_13 + F[T_C2, R_2] * s_15
        for i in range(R_1, N):
            s[i] *= F[i, i]


@compiled_without_allocation
def correct_lasting(f: Any, a: Seen) -> None:
    """s ← s − K aᵀs: what a measurement that has just been weighed takes of it."""
    for c in range(2):
        if f.lasts[c]:
            s = f.lasting[c]
            of_it = s[a.i] + a.w * s[a.b] + a.v * s[LATE]
            for k in range(N):
                s[k] -= f.K[k] * of_it


@compiled_without_allocation
def multiply_engine(f: Any, step: Any, T_en: float) -> None:
    """The engine's rows of F x + b T_en and of F P."""
    F, x, P, FP, along = step.phi, f.x, f.P, f.FP, f.along
    for n in range(len(_ENGINE)):
        i = _ENGINE[n]
        a_0, a_1, a_2 = F[i, W_E], F[i, W_D], F[i, TH_D]
        a_3, a_4 = F[i, T_C1], F[i, T_C2]
        a_5, a_6 = F[i, R_1], F[i, R_2]
        a_7, b = F[i, DT_E], step.input[i]
        value = a_0 * x[W_E] + a_1 * x[W_D] + a_2 * x[TH_D] + a_3 * x[T_C1] + a_4 * x[T_C2]
        f.next[i] = value + a_5 * x[R_1] + a_6 * x[R_2] + a_7 * x[DT_E] + b * T_en
        for j in range(N):
            total = a_0 * P[W_E, j] + a_1 * P[W_D, j] + a_2 * P[TH_D, j] + a_3 * P[T_C1, j] + a_4 * P[T_C2, j]
            FP[i, j] = total + a_5 * P[R_1, j] + a_6 * P[R_2, j] + a_7 * P[DT_E, j] + b * along[j]


@compiled_without_allocation
def multiply_car(f: Any, step: Any) -> None:
    """The gearbox's and the car's rows of F x and of F P."""
    F, x, P, FP = step.phi, f.x, f.P, f.FP
    for n in range(len(_CAR)):
        i = _CAR[n]
        a_0, a_1, a_2 = F[i, W_C1], F[i, W_C2], F[i, W_O]
        a_3, a_4, a_5 = F[i, W_W], F[i, TH_T1], F[i, TH_T2]
        a_6, a_7 = F[i, TH_O], F[i, T_X]
        a_8, a_9 = F[i, T_C1], F[i, T_C2]
        a_10, a_11, a_12 = F[i, R_1], F[i, R_2], F[i, T_V]
        value = a_0 * x[W_C1] + a_1 * x[W_C2] + a_2 * x[W_O] + a_3 * x[W_W] + a_4 * x[TH_T1] + a_5 * x[TH_T2]
        value += a_6 * x[TH_O] + a_7 * x[T_X] + a_8 * x[T_C1] + a_9 * x[T_C2]
        f.next[i] = value + a_10 * x[R_1] + a_11 * x[R_2] + a_12 * x[T_V]
        for j in range(N):
            total = a_0 * P[W_C1, j] + a_1 * P[W_C2, j] + a_2 * P[W_O, j] + a_3 * P[W_W, j] + a_4 * P[TH_T1, j]
            total += a_5 * P[TH_T2, j] + a_6 * P[TH_O, j] + a_7 * P[T_X, j] + a_8 * P[T_C1, j]
            FP[i, j] = total + a_9 * P[T_C2, j] + a_10 * P[R_1, j] + a_11 * P[R_2, j] + a_12 * P[T_V, j]
    own = F[W_B, W_B]
    f.next[W_B] += own * x[W_B]
    for j in range(N):
        FP[W_B, j] += own * P[W_B, j]


@compiled_without_allocation
def multiply_engine_again(f: Any, step: Any) -> None:
    """The engine's rows of F (P Fᵀ) + Q, in the columns of `COUPLED` states."""
    F, FP, PF, Q = step.phi, f.FP, f.PF, f.Q_engine
    for n in range(len(_ENGINE)):
        i = _ENGINE[n]
        a_0, a_1, a_2 = F[i, W_E], F[i, W_D], F[i, TH_D]
        a_3, a_4 = F[i, T_C1], F[i, T_C2]
        a_5, a_6, a_7 = F[i, R_1], F[i, R_2], F[i, DT_E]
        b = step.input[i]
        a_8, a_9, a_10 = b * f.per_error[0], b * f.per_error[1], b * f.per_error[2]
        for j in range(COUPLED):
            total = Q[n * COUPLED + j] + a_0 * PF[W_E, j] + a_1 * PF[W_D, j] + a_2 * PF[TH_D, j]
            total += (
                a_3 * PF[T_C1, j] + a_4 * PF[T_C2, j] + a_5 * PF[R_1, j] + a_6 * PF[R_2, j] + a_7 * PF[DT_E, j]
            )
            FP[i, j] = total + a_8 * PF[GAIN, j] + a_9 * PF[LAG_1, j] + a_10 * PF[LAG_2, j]


@compiled_without_allocation
def multiply_car_again(f: Any, step: Any) -> None:
    """The gearbox's and the car's rows of F (P Fᵀ) + Q, in the columns of `COUPLED` states."""
    F, FP, PF, Q = step.phi, f.FP, f.PF, f.Q_car
    for n in range(len(_CAR)):
        i = _CAR[n]
        a_0, a_1, a_2 = F[i, W_C1], F[i, W_C2], F[i, W_O]
        a_3, a_4, a_5 = F[i, W_W], F[i, TH_T1], F[i, TH_T2]
        a_6, a_7 = F[i, TH_O], F[i, T_X]
        a_8, a_9 = F[i, T_C1], F[i, T_C2]
        a_10, a_11, a_12 = F[i, R_1], F[i, R_2], F[i, T_V]
        for j in range(COUPLED):
            total = Q[n * COUPLED + j] + a_0 * PF[W_C1, j] + a_1 * PF[W_C2, j] + a_2 * PF[W_O, j]
            total += (
                a_3 * PF[W_W, j] + a_4 * PF[TH_T1, j] + a_5 * PF[TH_T2, j] + a_6 * PF[TH_O, j] + a_7 * PF[T_X, j]
            )
            total += a_8 * PF[T_C1, j] + a_9 * PF[T_C2, j] + a_10 * PF[R_1, j] + a_11 * PF[R_2, j]
            FP[i, j] = total + a_12 * PF[T_V, j]
    own = F[W_B, W_B]
    for j in range(COUPLED):
        FP[W_B, j] += own * PF[W_B, j]


@compiled_without_allocation
def multiply_rest(f: Any, step: Any, q: Noises) -> None:
    """All other rows of F x and F P Fᵀ + Q, up to the diagonal: the clutch torques, their rates, and decays."""
    F, x, P, PF, noise = step.phi, f.x, f.P, f.PF, step.noise_rest
    t_1, r_1 = F[T_C1, T_C1], F[T_C1, R_1]
    t_2, r_2 = F[T_C2, T_C2], F[T_C2, R_2]
    f.next[T_C1], f.next[T_C2] = t_1 * x[T_C1] + r_1 * x[R_1], t_2 * x[T_C2] + r_2 * x[R_2]
    for j in range(COUPLED):
        P[T_C1, j] = t_1 * PF[T_C1, j] + r_1 * PF[R_1, j]
        P[T_C2, j] = t_2 * PF[T_C2, j] + r_2 * PF[R_2, j]
    both = t_1 * P[T_C2, T_C1] + r_1 * P[T_C2, R_1], t_1 * P[R_2, T_C1] + r_1 * P[R_2, R_1]
    P[T_C2, T_C1] = t_2 * both[0] + r_2 * both[1]
    P[T_C1, T_C1] = t_1 * t_1 * P[T_C1, T_C1] + 2.0 * t_1 * r_1 * P[R_1, T_C1] + r_1 * r_1 * P[R_1, R_1]
    P[T_C2, T_C2] = t_2 * t_2 * P[T_C2, T_C2] + 2.0 * t_2 * r_2 * P[R_2, T_C2] + r_2 * r_2 * P[R_2, R_2]
    for i in range(R_1, N):
        own = F[i, i]
        f.next[i] = own * x[i]
        for j in range(COUPLED):
            P[i, j] = own * PF[i, j]
        P[i, T_C1] = own * (t_1 * P[i, T_C1] + r_1 * P[i, R_1])
        P[i, T_C2] = own * (t_2 * P[i, T_C2] + r_2 * P[i, R_2])
        for j in range(R_1, i + 1):
            P[i, j] *= own * F[j, j]
    for n in range(len(_DRIVEN)):
        i, factor = COUPLED + n, q[_DRIVEN[n]]
        for j in range(i + 1):
            P[i, j] += factor * noise[n, j]
    for n in range(N - GAIN):
        P[GAIN + n, GAIN + n] += step.noise_lasting[n]


@compiled_without_allocation
def sum_noise(f: Any, step: Any, q: Noises) -> None:
    """Q of the engine's and of the car's side."""
    engine, car = step.noise_engine, step.noise_car
    for n in range(len(_ENGINE) * COUPLED):
        total = engine[0, n] + q[0] * engine[1, n] + q[1] * engine[2, n]
        f.Q_engine[n] = total + q[4] * engine[3, n]
    for n in range(len(_CAR) * COUPLED):
        total = car[0, n] + q[0] * car[1, n] + q[1] * car[2, n]
        f.Q_car[n] = total + q[2] * car[3, n] + q[3] * car[4, n]


@compiled_without_allocation
def mirror(f: Any) -> None:
    """Make P of its lower triangle."""
    P, FP = f.P, f.FP
    for i in range(COUPLED):
        for j in range(i + 1):
            P[i, j] = P[j, i] = FP[i, j]
    for i in range(COUPLED, N):
        for j in range(i):
            P[j, i] = P[i, j]


@compiled_without_allocation
def take_measurement(f: Any, a: Seen, e: float, R: float) -> float:
    """Take a scalar measurement of aᵀx; return the variance of its innovation.

    With the optimal gain K = P a / S Joseph's form is P − (P a) (P a)ᵀ / S, here with √S on either side, so that P
    stays symmetric to the last bit. P a becomes R/S of what it was, from which row and column i follow: no small
    difference of large numbers, so that variance stays positive however sure the measurement is.

    Args:
        f: `filter.FILTER`; ``f.K`` becomes the gain.
        a: what is measured.
        e: innovation.
        R: variance of the measurement.
    """
    S = weigh(f, a, e, R)
    P, h = f.P, f.h
    for k in range(0, N, _AT_ONCE):
        h_0, h_1, h_2, h_3, h_4 = h[k], h[k + 1], h[k + 2], h[k + 3], h[k + 4]
        for m in range(N):
            h_m = h[m]
            P[k, m] -= h_0 * h_m
            P[k + 1, m] -= h_1 * h_m
            P[k + 2, m] -= h_2 * h_m
            P[k + 3, m] -= h_3 * h_m
            P[k + 4, m] -= h_4 * h_m
    i = a.i
    for k in range(N):
        if k != i:
            P[k, i] = P[i, k] = f.along[k] - a.w * P[a.b, k] - a.v * P[LATE, k]
    P[i, i] = f.along[i] - a.w * P[a.b, i] - a.v * P[LATE, i]
    return S


@compiled_without_allocation
def weigh(f: Any, a: Seen, e: float, R: float) -> float:
    """Let a measurement of aᵀx act on x alone; leave K, h = P a / √S and the new P a; return S."""
    S = variance(f, a) + R
    inverse, root, rest = 1.0 / S, 1.0 / math.sqrt(S), R / S
    for k in range(N):
        along = f.P[a.i, k] + a.w * f.P[a.b, k] + a.v * f.P[LATE, k]
        f.K[k] = along * inverse
        f.x[k] += f.K[k] * e
        f.h[k] = along * root
        f.along[k] = along * rest
    return float(S)


@compiled_without_allocation
def weigh_second(f: Any, i: int, j: int, e: float, R: float) -> float:
    """`weigh` a measurement of x_j after that of x_i, which has not acted on P yet."""
    h_j = f.h[j]
    for k in range(N):
        f.along_2[k] = f.P[j, k] - h_j * f.h[k]
    f.along_2[i] = f.along[j]
    S = f.along_2[j] + R
    inverse, root, rest = 1.0 / S, 1.0 / math.sqrt(S), R / S
    for k in range(N):
        along = f.along_2[k]
        f.K[k] = along * inverse
        f.x[k] += f.K[k] * e
        f.h_2[k] = along * root
        f.along_2[k] = along * rest
    return float(S)


@compiled_without_allocation
def take_both(f: Any, i: int, j: int) -> None:
    """Let both measurements that were weighed act on P, in one way through it."""
    P, h, g = f.P, f.h, f.h_2
    for k in range(0, N, _AT_ONCE):
        h_0, h_1, h_2, h_3, h_4 = h[k], h[k + 1], h[k + 2], h[k + 3], h[k + 4]
        g_0, g_1, g_2, g_3, g_4 = g[k], g[k + 1], g[k + 2], g[k + 3], g[k + 4]
        for m in range(N):
            h_m, g_m = h[m], g[m]
            P[k, m] -= h_0 * h_m + g_0 * g_m
            P[k + 1, m] -= h_1 * h_m + g_1 * g_m
            P[k + 2, m] -= h_2 * h_m + g_2 * g_m
            P[k + 3, m] -= h_3 * h_m + g_3 * g_m
            P[k + 4, m] -= h_4 * h_m + g_4 * g_m
    g_i = g[i]
    for k in range(N):
        P[k, i] = P[i, k] = f.along[k] - g_i * g[k]
    for k in range(N):
        P[k, j] = P[j, k] = f.along_2[k]
