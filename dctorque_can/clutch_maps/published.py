"""The map as it is published: rising, moved no faster than a clutch changes, each node valid or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.learner import Learner
from dctorque_can.clutch_maps.settings import NODES, MapSettings

Floats = NDArray[np.float64]


class Published:
    """The published values of one clutch's nodes.

    Args:
        settings: of all maps.

    Attributes:
        raw_nm: as learned ``[NODES]``.
        capacity_nm: rising, never negative, and moved by no more than may be ``[NODES]``.
        sigma_nm: standard deviation of ``capacity_nm`` ``[NODES]``.
        valid: whether a node has seen enough, in the range seen, and is known well enough ``[NODES]``.
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self.raw_nm, self.capacity_nm, self.sigma_nm = np.zeros(NODES), np.zeros(NODES), np.zeros(NODES)
        self.valid = np.zeros(NODES, np.bool_)
        self.grid: Floats = np.zeros(NODES)
        self.moved_s = 0.0

    def renew(self, learner: Learner, theta: float, slipped_s: float) -> Floats:
        """Take over what is learned, and return its covariance ``[NODES, NODES]``.

        Args:
            learner: of the clutch.
            theta: ϑ of now.
            slipped_s: for how long the clutch has slipped in all.
        """
        self.raw_nm, covariance = learner.curve(theta)
        variance = np.maximum(np.diagonal(covariance), 1e-12)
        target = np.maximum(rising(self.raw_nm, 1.0 / variance), 0.0)
        most = self._settings.node_speed_nm_s * (slipped_s - self.moved_s)
        if self.moved_s > 0.0:
            before = np.interp(learner.grid, self.grid, self.capacity_nm)
            was = np.interp(learner.grid, self.grid, self.valid.astype(np.float64)) > 0.0
            target = np.where(was, np.clip(target, before - most, before + most), target)
            target = np.maximum.accumulate(target)
        self.grid, self.capacity_nm, self.moved_s = learner.grid, target, slipped_s
        self.sigma_nm = np.sqrt(variance + (target - self.raw_nm) ** 2)
        step = learner.span / (NODES - 1)
        inside = (self.grid > learner.seen[0] - step) & (self.grid < learner.seen[1] + step)
        known = self.sigma_nm <= self._settings.largest_sigma_share * learner.capacity_nm
        self.valid = inside & known & (_near(learner.samples) >= self._settings.least_samples)
        return covariance


def rising(values: Floats, weights: Floats) -> Floats:
    """Return the nearest values ``[n]`` that never fall, by weighted squares: pool adjacent violators.

    Ayer, Brunk, Ewing, Reid and Silverman, An empirical distribution function for sampling with incomplete
    information, Annals of Mathematical Statistics 26, 1955. (scipy's takes a second to import.)
    """
    pools: list[tuple[float, float, int]] = []  # mean, weight, number
    for value, weight in zip(values.tolist(), weights.tolist(), strict=True):
        mean, total, count = value, weight, 1
        while pools and pools[-1][0] >= mean:
            before, heavy, many = pools.pop()
            mean = (before * heavy + mean * total) / (heavy + total)
            total, count = total + heavy, count + many
        pools.append((mean, total, count))
    return np.repeat([mean for mean, _, _ in pools], [count for _, _, count in pools])


def _near(samples: Floats) -> Floats:
    """Return what each node has seen, and half of what its neighbours have: between them the curve is smooth."""
    beside = np.zeros(len(samples))
    beside[1:] += 0.5 * samples[:-1]
    beside[:-1] += 0.5 * samples[1:]
    return np.asarray(samples + beside)
