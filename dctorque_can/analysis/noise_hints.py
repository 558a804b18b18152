"""Noise of the speeds that is clearly another than the vehicle file says, and the key that sets it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.estimates import SENSORS

ENOUGH = 400.0
"""Samples of steady driving: chance is then 7 % of a variance."""
CLEAR = 2.0
"""Times as noisy as told, or as quiet: nothing of what is usual in a sound car gets there (docs/kalman.md)."""
LEAST = 0.5
"""Share of what is told that is proposed at least: a quiet prediction looks like a quiet sensor."""
_KEYS = {"engine": "engine_speed", "shaft1": "shaft_speed", "shaft2": "shaft_speed"}
_WORDS = {"engine_speed": "engine speed", "shaft_speed": "input shafts", "wheel_speed": "wheels"}


@dataclass(frozen=True, slots=True)
class NoiseHint:
    """A noise to be set.

    Attributes:
        key: of the vehicle file.
        value: to set there, rad/s.
        learned_rad_s: standard deviation of one sample, without rounding.
        told_rad_s: the same as the vehicle file has it.
        says: all of that in a sentence.
    """

    key: str
    value: float
    learned_rad_s: float
    told_rad_s: float
    says: str


def noise_hints(health: NDArray[np.void]) -> list[dict[str, Any]]:
    """Return a hint for each noise that a `HEALTH` record ``[1]`` has learned and that is clearly another."""
    return [asdict(hint) for hint in _hints(health[0])]


def _hints(record: np.void) -> Iterator[NoiseHint]:
    samples = np.asarray(record["speed_noise_samples"], np.float64)
    learned = np.asarray(record["speed_noise_rad_s"], np.float64)
    for group, words in _WORDS.items():
        places = [k for k, name in enumerate(SENSORS) if _KEYS.get(name, "wheel_speed") == group]
        known = [k for k in places if samples[k] >= ENOUGH]
        if not known:
            continue
        noise = sqrt(float(np.average(learned[known] ** 2, weights=samples[known])))
        told = float(record["speed_noise_told_rad_s"][known[0]])
        if told / CLEAR <= noise <= told * CLEAR:
            continue
        value = float(f"{max(noise, LEAST * told):.2g}")
        key = f"estimator.kalman.{group}_noise_rad_s"
        measured = f"noise {noise:.2g} rad/s rather than {told:.2g}"
        if noise < told:
            measured = f"noise less than {LEAST * told:.2g} rad/s rather than {told:.2g}"
        yield NoiseHint(key, value, noise, told, f"{words}: {measured}: set {key}: {value:g}")
