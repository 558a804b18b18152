"""Noise of the speeds that is not as told: learned from the innovations while nothing else explains them.

The innovation e of a speed has the variance P_ii + R, so (e² − P_ii)/R says how many times as large as the
configured R the variance is. Shifts, changes of torque and wrong parameters make e larger too: it is learned only
while the torques are steady, and the less the surer the sample is than the prediction, since e² − P_ii itself has
the variance 2 (P_ii + R)². R never falls below a quarter of what is configured, nor below the resolution's q²/12:
a value that stays the same has an error that does. What the filter doubts too much of a prediction looks like a
sensor that is better than told; the quarter limits what that can do.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation

_SAMPLES = 400.0  # over which is averaged: seconds of a production bus; leaves 7 % of chance
_KNOWN = 50.0  # samples that the configured noise counts for at the start
_STEADY = 2.0  # steady rates of the clutch torques


@compiled_without_allocation
def forget_noise(f: Any) -> None:
    """Believe the configured noise, as at the start."""
    for sensor in range(len(f.noise_ratio)):
        f.noise_ratio[sensor], f.noise_samples[sensor] = 1.0, _KNOWN


@compiled_without_allocation
def noise_factor(f: Any, tuning: Any, sensor: int) -> float:
    """Return by what the configured variance of a sensor's sample must be multiplied."""
    return float(max(f.noise_ratio[sensor], tuning.least_noise[sensor]))


@compiled_without_allocation
def report_noise(f: Any, tuning: Any, row: Any) -> None:
    """Fill what a health row says of the noise of each sensor: as it is told, and as all samples have it.

    Without what rounding does, as the keys of a vehicle file have it.
    """
    for sensor in range(len(f.noise_ratio)):
        told, variance = tuning.told_noise[sensor], tuning.told_noise[sensor] ** 2 + tuning.rounding[sensor]
        samples = f.all_samples[sensor]
        learned = f.all_noise[sensor] / samples * variance - tuning.rounding[sensor] if samples > 0.0 else 0.0
        row.speed_noise_told_rad_s[sensor] = told
        row.speed_noise_rad_s[sensor] = math.sqrt(max(learned, 0.0))
        row.speed_noise_samples[sensor] = samples


@compiled_without_allocation
def learn_noise(f: Any, tuning: Any, sensor: int, e: float, known: float, variance: float) -> None:
    """Learn from an innovation that is believed.

    Args:
        f: `filter.FILTER`.
        tuning: `tuning.TUNING`.
        sensor: as in `faults.measure_gated`.
        e: innovation, rad/s.
        known: variance of it that is not the noise's, (rad/s)².
        variance: of its noise as it was believed, (rad/s)².
    """
    if not steady(f, tuning):
        return
    weight = (variance / (variance + known)) ** 2
    f.noise_samples[sensor] = min(f.noise_samples[sensor] + weight, _SAMPLES)
    configured = variance / noise_factor(f, tuning, sensor)
    ratio = (e * e - known) / configured
    f.all_noise[sensor] += ratio * weight
    f.all_samples[sensor] += weight
    change = ratio - f.noise_ratio[sensor]
    f.noise_ratio[sensor] = max(f.noise_ratio[sensor] + change * weight / f.noise_samples[sensor], 0.0)


@compiled_without_allocation
def steady(f: Any, tuning: Any) -> bool:
    """Return whether no clutch torque changes; a shaft in neutral does not matter to the others."""
    most = _STEADY * tuning.steady_rate
    first = f.gear[0] == 0 or f.torque_rate[0] <= most
    return bool(first and (f.gear[1] == 0 or f.torque_rate[1] <= most))
