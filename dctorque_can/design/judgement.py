"""What ``dctorque design`` finds, as one JSON object: keys carry units, texts may be quoted."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.config.estimation import FASTEST_POLE
from dctorque_can.design.conditions import checks, limits_of_the_proof
from dctorque_can.driveline.parameters import STANDARD_GRAVITY, DrivenAxle
from dctorque_can.estimators.oh2014 import noise_and_lag, stability
from dctorque_can.estimators.oh2014.driving_conditions import DrivingCondition, driving_conditions
from dctorque_can.estimators.oh2014.noise_and_lag import SampledErrors, SpeedSensors
from dctorque_can.pipeline.samples import Quantity

if TYPE_CHECKING:
    from dctorque_can.pipeline.settings import Settings

Pair = tuple[int, int]
FACTORS = tuple(2.0 ** (k / 4) for k in range(-8, 9))
VARIED = {
    "all": noise_and_lag.BANDWIDTHS,
    "unknown-input": ("engine_bandwidth_rad_s", "shaft_bandwidth_rad_s"),
    "crossover": ("torque_crossover_rad_s",),
    "wheel": ("acceleration_bandwidth_rad_s",),
}
"""Choice of ``--vary`` to the design numbers that are scaled."""


class Design:
    """The observer of a vehicle file, judged with the noise and the periods of given sensors.

    Args:
        settings: of the estimator.
        pairs: gears on shaft 1 and 2, at least one pair.
        sensors: noise and periods; the noise of the wheels is that of one wheel.
        rate: torque handed from one clutch to the other, N·m/s.
    """

    def __init__(self, settings: Settings, pairs: tuple[Pair, ...], sensors: SpeedSensors, rate: float) -> None:
        self.settings = settings
        self.vehicle, self.design = settings.vehicle, settings.observer
        self.efficiency = self.vehicle.gear_efficiency * self.vehicle.final_drive_efficiency
        self.grip = STANDARD_GRAVITY / self.vehicle.chassis.wheel_radius_m
        self.pairs, self.sensors, self.rate = pairs, sensors, rate
        self.gains = {
            pair: stability.gains(*stability.observer_records(self.vehicle, self.design, *pair)) for pair in pairs
        }
        self.conditions = {pair: driving_conditions(self.vehicle, *pair) for pair in pairs}

    def report(self, sweep_pair: Pair, vary: str) -> dict[str, Any]:
        """Return everything, with noise and lag over the bandwidths for one pair."""
        g = self.gains[self.pairs[0]]
        return {
            "gains": {
                "l_1_per_s": g.l_1,
                "l_2_nm_per_rad": g.l_2,
                "l_3_per_s": g.l_3,
                "L_per_s": g.L,
                "gamma_e_s_per_rad2": g.g_e,
                "gamma_l_per_s": g.g_l,
                "J_e_kgm2": g.J_e,
            },
            "pairs": [self._pair(pair) for pair in self.pairs],
            "rank_tolerance": stability.RANK_TOLERANCE,
            "sensors": asdict(self.sensors),
            "hand_over_nm_per_s": self.rate,
            "checks": checks(self),
            "limits_of_the_proof": limits_of_the_proof(self),
            "sweep": self._sweep(sweep_pair, vary),
        }

    # --- one pair of gears ---

    def _pair(self, pair: Pair) -> dict[str, Any]:
        g = self.gains[pair]
        record = stability.observer_records(self.vehicle, self.design, *pair)[1]
        accelerating = self.shift_condition(pair)
        misread = stability.misreading(record, 1.0 / self.efficiency)
        noise, lag = self._noise_and_lag(pair, 1.0, ())
        return {
            "gear1": pair[0],
            "gear2": pair[1],
            "R_1": float(record["R_1"]),
            "R_2": float(record["R_2"]),
            "J_e1_kgm2": g.J_e1,
            "l_4_nm_per_rad": g.l_4,
            "gamma_t_s3_per_rad2": g.g_t,
            "conditions": [self._at(g, condition) for condition in self.conditions[pair]],
            "misreading_nm_per_nm": asdict(misread),
            "lyapunov_weights": stability.lyapunov_weights(g).tolist(),
            "noise_condition": accelerating.name,
            "noise_nm": _by_torque(noise),
            "lag_nm": _by_torque(lag),
            "lag_seconds": abs(accelerating.clutch_torque_nm) / self.rate,
        }

    def _at(self, g: stability.Gains, condition: DrivingCondition) -> dict[str, Any]:
        point = condition.engine_speed_rad_s, condition.wheel_acceleration_rad_s2
        A = stability.error_matrix(g, *point)
        engine, shaft = stability.eigenvalues(A)
        seen = stability.observability(g, *point)
        assumed = stability.observability(g, *point, leakage=True)
        rate = stability.lyapunov_rate(A, stability.lyapunov_weights(g))
        return {
            **asdict(condition),
            "engine_eigenvalues_per_s": [[value.real, value.imag] for value in engine.tolist()],
            "shaft_eigenvalues_per_s": [[value.real, value.imag] for value in shaft.tolist()],
            "cascade_eigenvalues_per_s": [-g.L, -g.L],
            "rank": seen.rank,
            "singular_values": seen.singular_values.tolist(),
            "unobservable": dict(zip(stability.CORE, seen.unobservable.tolist(), strict=True)),
            "rank_with_leakage": assumed.rank,
            "lyapunov_rate_eigenvalues_per_s": np.linalg.eigvalsh(rate).tolist(),
        }

    def shift_condition(self, pair: Pair) -> DrivingCondition:
        """Return the condition at which noise and lag are taken: shifts happen under load."""
        return next(condition for condition in self.conditions[pair] if condition.name == "accelerating")

    # --- noise and lag ---

    def errors(
        self, pair: Pair, condition: DrivingCondition, factor: float, names: tuple[str, ...]
    ) -> SampledErrors:
        """Return the errors of the sampled observer, some of its bandwidths times ``factor``."""
        design = noise_and_lag.scaled_design(self.design, factor, names)
        s = self.sensors
        wheel = s.wheel_rad_s / math.sqrt(averaged_wheels(self.settings))
        sensors = replace(s, wheel_rad_s=wheel)
        from_1 = condition.gear == pair[0]  # an upshift: out of the shorter gear, in which the car accelerates
        rate = self.rate if from_1 else -self.rate
        step_us = self.settings.step_us
        return SampledErrors(self.vehicle, design, *pair, condition, sensors, step_us, rate)

    def _noise_and_lag(
        self, pair: Pair, factor: float, names: tuple[str, ...]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        condition = self.shift_condition(pair)
        errors = self.errors(pair, condition, factor, names)
        return errors.deviations(), errors.largest_lag(abs(condition.clutch_torque_nm) / self.rate)

    def _sweep(self, pair: Pair, vary: str) -> dict[str, Any]:
        names = VARIED[vary]
        fastest = FASTEST_POLE * 1e6 / self.settings.step_us
        limit = fastest / max(getattr(self.design, name) for name in names)
        results = [self._noise_and_lag(pair, factor, names) for factor in FACTORS]
        noise = np.array([noise for noise, _ in results])
        lag = np.array([lag for _, lag in results])
        return {
            "gear1": pair[0],
            "gear2": pair[1],
            "varied": list(names),
            "largest_factor_allowed": limit,
            "factors": list(FACTORS),
            "noise_nm": _by_torque(noise.T),
            "lag_nm": _by_torque(lag.T),
            "balanced_factor": _crossing(noise[:, 6:].max(axis=1), np.abs(lag[:, 6:]).max(axis=1)),
        }


def averaged_wheels(settings: Settings) -> int:
    """Return of how many measured wheels the wheel filter gets the mean."""
    given = {item.quantity for item in settings.inputs}
    front = len(given & {Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_FR})
    rear = len(given & {Quantity.WHEEL_SPEED_RL, Quantity.WHEEL_SPEED_RR})
    undriven = {DrivenAxle.FRONT: rear, DrivenAxle.REAR: front, DrivenAxle.ALL: front + rear}[settings.driven_axle]
    return undriven or front + rear


def _by_torque(values: NDArray[np.float64]) -> dict[str, Any]:
    """Return values ``[8]`` or ``[8, n]`` by name; None where the observer is unstable."""
    known = values.astype(object)
    known[~np.isfinite(values)] = None
    return dict(zip(noise_and_lag.TORQUES, known.tolist(), strict=True))


def _crossing(noise: NDArray[np.float64], lag: NDArray[np.float64]) -> float | None:
    """Return the largest factor at which noise overtakes lag; None if that is outside of the factors."""
    sound = (noise > 0.0) & (lag > 0.0) & np.isfinite(noise)
    if not np.all(sound):
        return None
    excess = np.log(noise) - np.log(lag)
    (ups,) = np.nonzero((excess[:-1] <= 0.0) & (excess[1:] > 0.0))
    if not len(ups):
        return None
    around = slice(int(ups[-1]), int(ups[-1]) + 2)
    return float(np.exp(np.interp(0.0, excess[around], np.log(FACTORS[around]))))
