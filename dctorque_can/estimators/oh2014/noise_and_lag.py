"""Noise and lag of the sampled 2014 observer, linearised at one driving condition with both clutches closed.

Every frame is one linear step of the errors (truth minus estimate), exactly as `observer.predict`, ``correct_*``
and ``settle`` take it: noise covariances follow from discrete Lyapunov equations over one period of all messages,
the lag from a run of the same steps while torque is handed from one clutch to the other. Each speed is one message
with a period of its own; messages that fall together come in the order engine, shafts, wheels. The known road load
T_n is held, as it is between two closed clutches. Speeds are taken as constant where they multiply an error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.oh2014 import observer as oh2014
from dctorque_can.estimators.oh2014.design import Oh2014Design
from dctorque_can.estimators.oh2014.driving_conditions import DrivingCondition
from dctorque_can.estimators.oh2014.stability import observer_records

Floats = NDArray[np.float64]

STATES = ("tau_e", "tau_o", "w_e", "T_c", "w_s", "T_a", "w_w", "a_w", "T_c1", "T_c2", "noise_1", "noise_2")
"""Errors of the sampled observer, fields of `STATE`; then the noise of both shafts' last samples, rad/s."""

TORQUES = (
    "clutch_torque_sum_nm",  # T_c
    "side_torque_nm",  # T_a1
    "output_torque_adaptive_nm",  # T_o of (47), at the wheels
    "output_torque_nm",  # T_o of (31), at the wheels
    "clutch1_torque_uio_nm",  # (65)
    "clutch2_torque_uio_nm",  # (66)
    "clutch1_torque_nm",  # the full observer, (36) to (38)
    "clutch2_torque_nm",
)
"""Torques whose errors are given, N·m; the names of the estimates where there is one."""

MOST_FRAMES = 2000  # in one period of all messages together
_N = len(STATES)
_TAU_E, _TAU_O, _W_E, _T_C, _W_S, _T_A, _W_W, _A_W, _T_C1, _T_C2, _NOISE_1, _NOISE_2 = range(_N)


@dataclass(frozen=True, slots=True)
class SpeedSensors:
    """Noise and period of the measured speeds.

    Attributes:
        engine_rad_s: standard deviation of one engine speed sample.
        shaft_rad_s: of one sample of each input shaft.
        wheel_rad_s: of the speed that the wheel filter gets, the mean of the wheels of an axle.
        engine_period_us: of the engine speed.
        shaft_period_us: of the input shaft speeds.
        wheel_period_us: of the wheel speeds.
    """

    engine_rad_s: float
    shaft_rad_s: float
    wheel_rad_s: float
    engine_period_us: int
    shaft_period_us: int
    wheel_period_us: int


@dataclass(frozen=True, slots=True)
class Step:
    """One frame: x̃ becomes ``matrix`` x̃ + ``noise`` v + ``ramp``, v white with variance 1.

    Attributes:
        time_us: after the start of the period of all messages.
        matrix: float64 ``[12, 12]``.
        noise: float64 ``[12, k]``.
        ramp: float64 ``[12]``, what the true torques move meanwhile.
        published: the first frame of its time, in answer to which the estimator gives an estimate.
    """

    time_us: int
    matrix: Floats
    noise: Floats
    ramp: Floats
    published: bool


class SampledErrors:
    """The errors of the running observer at one driving condition.

    Args:
        vehicle: its parameters.
        design: design numbers of the observer.
        g1: gear on shaft 1.
        g2: gear on shaft 2.
        condition: point at which the errors are linearised.
        sensors: noise and periods.
        step_us: of the grid on which the observer predicts.
        rate: torque handed from clutch 1 to clutch 2, N·m/s.

    Raises:
        DctorqueError: the periods have no common multiple within reason.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        design: Oh2014Design,
        g1: int,
        g2: int,
        condition: DrivingCondition,
        sensors: SpeedSensors,
        step_us: int = 1000,
        rate: float = 0.0,
    ) -> None:
        self._c, self._pair = observer_records(vehicle, design, g1, g2)
        self._w_e = condition.engine_speed_rad_s
        self._a_w = condition.wheel_acceleration_rad_s2
        self._loss = oh2014.loss_factor(self._c, self._pair, condition.output_torque_nm)
        self._tau_o = float(self._c["J_v"])
        self._sensors = sensors
        self._step_us = step_us
        self._rates = np.array([-rate, rate])
        unit = ((1.0, 0.0), (0.0, 1.0))
        self._separation = np.array(
            [oh2014.unknown_input_torques(self._pair, *u, True, True) for u in unit]
        ).T  # (65), (66): rows clutches, columns T_c and T_a1
        self._twist = np.array([self._shaft_rates(*u, 0.0) for u in unit]).T
        self._share = np.array(self._shaft_rates(0.0, 0.0, 1.0))
        self.steps = tuple(self._steps())
        self.period_s = math.lcm(*self._periods()) * 1e-6

    # --- one frame ---

    def _shaft_rates(self, w_c1: float, w_c2: float, dT_o: float) -> tuple[float, float]:
        return oh2014.shaft_torque_rates(self._c, self._pair, True, True, w_c1, w_c2, dT_o)

    def _predict(self, dt: float) -> tuple[Floats, Floats]:
        """Return matrix ``[12, 12]`` and ramp ``[12]`` of `observer.predict` on the observer's grid."""
        c, pair = self._c, self._pair
        step = self._step_us * 1e-6
        whole, rest = divmod(dt + 1e-12, step)
        matrix = np.eye(_N)
        for part, times in ((step, int(whole)), (rest, 1)):
            F = np.eye(_N)
            F[_W_E, _TAU_E] = part * self._w_e / c["J_e"]
            F[_W_E, _T_C] = -part / c["J_e"]
            F[_W_S, _T_A] = part / pair["J_es"]
            F[_W_S, _TAU_O] = -part * self._loss * self._a_w / (pair["R_s"] * pair["J_es"])
            F[_W_S, _A_W] = -part * self._loss * self._tau_o / (pair["R_s"] * pair["J_es"])
            F[_W_W, _A_W] = part
            F[_TAU_E, _TAU_E] = F[_TAU_O, _TAU_O] = 1.0 - part * c["g_l"]
            matrix = np.linalg.matrix_power(F, times) @ matrix
        dT = self._rates
        dT_c, dT_a = float(dT.sum()), float(dT[0] + pair["R_2"] / pair["R_1"] * dT[1])
        jerk = float(pair["R_1"] * dT[0] + pair["R_2"] * dT[1]) / self._loss / self._tau_o  # T_n is held
        ramp = np.zeros(_N)
        ramp[_T_C], ramp[_T_A], ramp[_A_W] = dt * dT_c, dt * dT_a, dt * jerk
        ramp[[_T_C1, _T_C2]] = dt * dT
        ramp[_W_E] = -0.5 * dt**2 * dT_c / c["J_e"]
        ramp[_W_S] = 0.5 * dt**2 * (dT_a - self._loss * self._tau_o * jerk / pair["R_s"]) / pair["J_es"]
        ramp[_W_W] = 0.5 * dt**2 * jerk
        return matrix, ramp

    def _engine(self, h: float) -> tuple[Floats, Floats, Floats]:
        c, pair = self._c, self._pair
        alpha, beta = oh2014.sampled_gains(float(c["p_e"]), h)
        impulse = float(c["J_e"]) * alpha
        column = np.zeros(_N)
        column[_W_E] = -alpha
        column[_T_C] = c["J_e"] * beta / h
        column[_TAU_E] = -oh2014.adaptation(pair, self._w_e, self._a_w, impulse, 0.0)[0]
        if c["printed_rate_law"]:
            d_tau_o = oh2014.adaptation(pair, self._w_e, self._a_w, 0.0, impulse)[1]
            column[[_T_C1, _T_C2]] = -self._share * self._a_w * d_tau_o
        return self._correction(column, _W_E, self._sensors.engine_rad_s)

    def _shafts(self, h: float) -> tuple[Floats, Floats, Floats]:
        c, pair = self._c, self._pair
        alpha, beta = oh2014.sampled_gains(float(c["p_s"]), h)
        column = np.zeros(_N)
        column[_W_S] = -alpha
        column[_T_A] = -pair["J_es"] * beta / h
        d_tau_o = oh2014.adaptation(pair, 0.0, self._a_w, 0.0, float(pair["J_es"]) * alpha)[1]
        column[_TAU_O] = -d_tau_o
        column[[_T_C1, _T_C2]] = -self._share * self._a_w * d_tau_o
        matrix, noise, ramp = self._correction(column, _W_S, self._sensors.shaft_rad_s)
        noise = np.hstack([noise, np.zeros((_N, 1))])
        # (37), (38) by the trapezoidal rule, from this sample and the last
        torques, noises = [_T_C1, _T_C2], [_NOISE_1, _NOISE_2]
        matrix[np.ix_(torques, noises)] = -0.5 * h * self._twist
        noise[torques] -= 0.5 * h * self._sensors.shaft_rad_s * self._twist
        matrix[noises] = 0.0
        noise[noises] = self._sensors.shaft_rad_s * np.eye(2)
        # what the shafts turn, they turn because of the torques; only τ_o dω_w²/dt² is left out of (36)
        dT_o = float(self._pair["R_1"] * self._rates[0] + self._pair["R_2"] * self._rates[1])
        ramp[torques] = -h * (self._rates - self._share * dT_o)
        return matrix, noise, ramp

    def _wheels(self, h: float) -> tuple[Floats, Floats, Floats]:
        alpha, beta = oh2014.sampled_gains(float(self._pair["p_w"]), h)
        column = np.zeros(_N)
        column[_W_W], column[_A_W] = -alpha, -beta / h
        return self._correction(column, _W_W, self._sensors.wheel_rad_s)

    @staticmethod
    def _correction(column: Floats, speed: int, sigma: float) -> tuple[Floats, Floats, Floats]:
        """Return one correction by an innovation: the error of ``speed`` and the noise of the sample."""
        matrix = np.eye(_N)
        matrix[:, speed] += column
        return matrix, sigma * column[:, None], np.zeros(_N)

    def _settle(self, dt: float) -> Floats:
        share = 1.0 - math.exp(-float(self._c["L"]) * dt)
        matrix = np.eye(_N)
        torques = [_T_C1, _T_C2]
        matrix[torques, torques] = 1.0 - share
        matrix[np.ix_(torques, [_T_C, _T_A])] = share * self._separation
        return matrix

    # --- one period of all messages ---

    def _periods(self) -> tuple[int, int, int]:
        s = self._sensors
        return s.engine_period_us, s.shaft_period_us, s.wheel_period_us

    def _steps(self) -> Iterator[Step]:
        periods = self._periods()
        whole = math.lcm(*periods)
        if sum(whole // period for period in periods) > MOST_FRAMES:
            given = ", ".join(f"{period / 1000:g}" for period in periods)
            raise DctorqueError(
                f"periods of {given} ms repeat only after {whole / 1000:g} ms, "
                f"which is more than {MOST_FRAMES} frames: give rounder ones"
            )
        corrections = [
            law(period * 1e-6)
            for law, period in zip((self._engine, self._shafts, self._wheels), periods, strict=True)
        ]
        frames = sorted((t, k) for k in range(3) for t in range(periods[k], whole + 1, periods[k]))
        now = 0
        for position, (t, k) in enumerate(frames):
            dt = (t - now) * 1e-6
            matrix, ramp = self._predict(dt)
            correct, noise, more = corrections[k]
            settle = self._settle(dt)
            published = position == 0 or frames[position - 1][0] != t
            yield Step(t, settle @ correct @ matrix, settle @ noise, settle @ (correct @ ramp + more), published)
            now = t

    # --- what comes of it ---

    def outputs(self) -> Floats:
        """Return the rows ``[8, 12]`` that give the errors of `TORQUES` from those of `STATES`."""
        rows = np.zeros((len(TORQUES), _N))
        rows[0, _T_C] = rows[1, _T_A] = 1.0
        rows[2, [_TAU_O, _A_W]] = self._a_w, self._tau_o
        rows[3, [_T_C1, _T_C2]] = np.array([self._pair["R_1"], self._pair["R_2"]]) / self._loss
        rows[4:6][:, [_T_C, _T_A]] = self._separation
        rows[6, _T_C1] = rows[7, _T_C2] = 1.0
        return rows

    def spectral_radius(self) -> float:
        """Return the largest eigenvalue of one period of all messages, in magnitude; below 1 it is stable."""
        return float(np.abs(np.linalg.eigvals(self._monodromy()[0])).max())

    def lyapunov_growth(self, weights: Floats) -> float:
        """Return the largest factor by which one sample can change V of (74), ``weights`` ``[6]``.

        The dissipation of (76) belongs to the continuous form. Engine side and clutch side are not coupled, so
        each is judged over its own sample; the larger counts. Below 1, V is one of the sampled form too.
        """
        sides = (
            ([_TAU_E, _W_E, _T_C], [0, 2, 3], self._engine, self._sensors.engine_period_us),
            ([_TAU_O, _W_S, _T_A], [1, 4, 5], self._shafts, self._sensors.shaft_period_us),
        )
        growth = []
        for states, core, law, period_us in sides:
            h = period_us * 1e-6
            whole = (law(h)[0] @ self._predict(h)[0])[np.ix_(states, states)]
            root = np.sqrt(weights[core])
            growth.append(float(np.linalg.norm(root[:, None] * whole / root, 2) ** 2))
        return max(growth)

    def _monodromy(self) -> tuple[Floats, Floats]:
        whole, covariance = np.eye(_N), np.zeros((_N, _N))
        for step in self.steps:
            whole = step.matrix @ whole
            covariance = step.matrix @ covariance @ step.matrix.T + step.noise @ step.noise.T
        return whole, covariance

    def deviations(self) -> Floats:
        """Return the standard deviations ``[8]`` of `TORQUES`, N·m: rms over time of what is published.

        Infinite where the errors grow.
        """
        if self.spectral_radius() >= 1.0:
            return np.full(len(TORQUES), np.inf)
        covariance = np.asarray(solve_discrete_lyapunov(*self._monodromy()), np.float64)
        rows = self.outputs()
        variances, times = [], []
        for step in self.steps:
            covariance = step.matrix @ covariance @ step.matrix.T + step.noise @ step.noise.T
            if step.published:
                variances.append(np.einsum("ij,jk,ik->i", rows, covariance, rows))
                times.append(step.time_us)
        held = np.diff([*times, times[0] + self.steps[-1].time_us])
        return np.asarray(np.sqrt(np.average(variances, axis=0, weights=held)), np.float64)

    def largest_lag(self, seconds: float) -> Floats:
        """Return the largest errors ``[8]`` of `TORQUES` within a hand-over, N·m, truth - estimate.

        Infinite where the errors grow.
        """
        if self.spectral_radius() >= 1.0:
            return np.full(len(TORQUES), np.inf)
        error, largest = np.zeros(_N), np.zeros(len(TORQUES))
        rows = self.outputs()
        for k in range(max(round(seconds / self.period_s), 1)):
            for step in self.steps:
                if k * self.period_s + step.time_us * 1e-6 > seconds + 1e-9:
                    return largest
                error = step.matrix @ error + step.ramp
                if step.published:
                    now = rows @ error
                    largest = np.where(np.abs(now) > np.abs(largest), now, largest)
        return largest


BANDWIDTHS = (
    "engine_bandwidth_rad_s",
    "shaft_bandwidth_rad_s",
    "torque_crossover_rad_s",
    "acceleration_bandwidth_rad_s",
)
"""The design numbers that noise and lag depend on."""


def scaled_design(design: Oh2014Design, factor: float, names: tuple[str, ...] = BANDWIDTHS) -> Oh2014Design:
    """Return the design with some of its bandwidths times ``factor``."""
    changes: dict[str, Any] = {name: factor * getattr(design, name) for name in names}
    return replace(design, **changes)
