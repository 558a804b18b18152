"""The values of every run, from a scrambled Sobol' sequence.

A Sobol' sequence fills the space of the factors more evenly than random numbers do, and its first n points are the
same however many follow: the number of runs can be raised later, and what has been run stays part of the study.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dctorque_can.study.plan import CUT, FactorSection, Study

_BITS = 30  # of a coordinate
_SCRAMBLING, _NOISE = 0, 1  # purposes of random numbers


def draw(study: Study) -> list[dict[str, float]]:
    """Return the values of the factors per run: nothing for run 0, the nominal car, then those that are drawn."""
    return [{}, *drawn(study.vary, study.plan.seed, study.plan.runs)]


def drawn(vary: Mapping[str, FactorSection], seed: int, runs: int) -> list[dict[str, float]]:
    """Return the values of so many draws, by name of the factor."""
    from scipy.stats import qmc  # takes a second to import; only a study draws

    random = np.random.default_rng([seed, _SCRAMBLING])
    sequence = qmc.Sobol(len(vary), scramble=True, bits=_BITS, seed=random)
    points = sequence.random(1 << (runs - 1).bit_length())[:runs] + 0.5**_BITS / 2
    columns = [quantile(section, points[:, i]).tolist() for i, section in enumerate(vary.values())]
    return [dict(zip(vary, row, strict=True)) for row in zip(*columns, strict=True)]


def quantile(section: FactorSection, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values below which a share (0..1) of all draws lies."""
    if section.uniform is not None:
        low, high = section.limits
        return np.asarray(low + share * (high - low))
    from scipy.special import ndtr, ndtri

    assert section.normal is not None
    inside = ndtr(-CUT) + share * (ndtr(CUT) - ndtr(-CUT))
    return np.asarray(section.normal.mean + section.normal.std * ndtri(inside))


def noise_seed(seed: int, run: int) -> int:
    """Return the seed of sensor noise and jitter of one run: every run has noise of its own."""
    return int(np.random.SeedSequence([seed, _NOISE, run]).generate_state(1)[0])
