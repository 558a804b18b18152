"""Noise of the speeds that is clearly another than the vehicle file says, and the key that sets it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
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


@dataclass(frozen=True, slots=True)
class LearnedNoise:
    """What was learned of the noise of one kind of speeds.

    Attributes:
        key: of the vehicle file.
        words: how these speeds are called.
        learned_rad_s: standard deviation of one sample, without rounding; 0 without samples.
        told_rad_s: the same as the vehicle file has it; 0 where nothing is measured.
        samples: of steady driving.
    """

    key: str
    words: str
    learned_rad_s: float
    told_rad_s: float
    samples: float

    @property
    def value(self) -> float | None:
        """What is to be set; None where too little was learned, or what is told will do."""
        usual = self.told_rad_s / CLEAR <= self.learned_rad_s <= self.told_rad_s * CLEAR
        if self.samples < ENOUGH or usual:
            return None
        return float(f"{max(self.learned_rad_s, LEAST * self.told_rad_s):.2g}")


def key_of(sensor: str) -> str:
    """Return the key of the vehicle file for the noise of one of `SENSORS`."""
    return f"estimator.kalman.{_KEYS.get(sensor, 'wheel_speed')}_noise_rad_s"


def noise_hints(health: NDArray[np.void]) -> list[dict[str, Any]]:
    """Return a hint for each noise that a `HEALTH` record ``[1]`` has learned and that is clearly another."""
    return [asdict(hint) for hint in _hints(learned_noises(health))]


def learned_noises(healths: NDArray[np.void]) -> list[LearnedNoise]:
    """Return what the runs of `HEALTH` records ``[n]`` have learned together."""
    found = []
    for group, words in _WORDS.items():
        key = f"estimator.kalman.{group}_noise_rad_s"
        places = [k for k, name in enumerate(SENSORS) if key_of(name) == key]
        samples = np.asarray(healths["speed_noise_samples"][:, places], np.float64)
        squares = np.asarray(healths["speed_noise_rad_s"][:, places], np.float64) ** 2
        of_each = samples.sum(axis=0)
        known = of_each >= ENOUGH if (of_each >= ENOUGH).any() else of_each > 0.0
        total = float(of_each[known].sum())
        noise = sqrt(float((samples * squares)[:, known].sum()) / total) if total > 0.0 else 0.0
        told = float(healths["speed_noise_told_rad_s"][:, places].max(initial=0.0))
        enough = float(of_each.max(initial=0.0))
        found.append(LearnedNoise(key, words, noise, told, enough))
    return found


def _hints(noises: Iterable[LearnedNoise]) -> Iterator[NoiseHint]:
    for each in noises:
        value, told, noise = each.value, each.told_rad_s, each.learned_rad_s
        if value is None:
            continue
        measured = f"noise {noise:.2g} rad/s rather than {told:.2g}"
        if noise < told:
            measured = f"noise less than {LEAST * told:.2g} rad/s rather than {told:.2g}"
        yield NoiseHint(each.key, value, noise, told, f"{each.words}: {measured}: set {each.key}: {value:g}")
