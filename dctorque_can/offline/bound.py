"""The same Kalman filter, told what no estimator is told: the true parameters, gears and clutch phases.

What it leaves of an error comes from noise, time and the physics that a linear filter does not have. A filter that
must find out parameters, gears and phases can come down to it, and is not expected to go below.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchActuation, PhaseSource
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import Estimates
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Input, Quantity, Samples, SampleStatus
from dctorque_can.pipeline.settings import Settings

_TOLD = {
    Quantity.GEAR1: "gear1",
    Quantity.GEAR2: "gear2",
    Quantity.CLUTCH1_POSITION: "phase1",  # PhaseSource.GIVEN
    Quantity.CLUTCH2_POSITION: "phase2",
}
_FOREVER_US = 2**60


class BoundChain:
    """As `chain.Chain`, of a filter that is told the truth.

    Args:
        config: what is measured, and the noises of the filter; its method does not matter.
        vehicle: the true one.
        truth: ``[n]`` with ``t_us`` on the time scale of the frames (ascending), gears and phases.
    """

    def __init__(self, config: Config, vehicle: Vehicle, truth: NDArray[np.void]) -> None:
        self._truth = truth
        self._decoder = Decoder(config.database, config.inputs, config.protections)
        self._estimator = Estimator(told_settings(config.settings, vehicle))

    def feed(self, frames: Frames) -> Estimates:
        """Return the estimates that became due with ``frames``."""
        return self._estimator.feed(told_samples(self._decoder.decode(frames), self._truth))

    @property
    def health(self) -> NDArray[np.void]:
        """`HEALTH` ``[1]`` as of the last frame."""
        return self._estimator.health


def told_settings(settings: Settings, vehicle: Vehicle) -> Settings:
    """Return the settings of a Kalman filter of ``vehicle`` that takes the samples of `told_samples`."""
    given = ClutchActuation(PhaseSource.GIVEN, 0.0, 0.0)
    told = tuple(Input(quantity, (), -1.0, 100.0, _FOREVER_US) for quantity in _TOLD)
    return replace(
        settings,
        vehicle=vehicle,
        method=Method.KALMAN,
        gear_inference=None,
        one_gear=None,
        phases=replace(settings.phases, clutches=(given, given)),
        inputs=(*(item for item in settings.inputs if item.quantity not in _TOLD), *told),
    )


def told_samples(samples: Samples, truth: NDArray[np.void]) -> Samples:
    """Return samples in which every frame begins with the gears and phases that are true at its time.

    Args:
        samples: whole frames. Their own gears and clutch positions are left out.
        truth: ``[n]`` with ``t_us`` on the same time scale (ascending), gears and phases; at least one row.
    """
    ends = np.flatnonzero(samples.last)
    frame = np.searchsorted(ends, np.arange(len(samples)))
    kept = np.flatnonzero(~np.isin(samples.quantity, list(_TOLD)))
    t_us = samples.t_us[ends]
    rows = truth[np.clip(np.searchsorted(truth["t_us"], t_us, side="right") - 1, 0, None)]
    parts = [
        Samples(
            t_us,
            np.full(len(ends), quantity, np.uint8),
            rows[name].astype(np.float64),
            np.full(len(ends), SampleStatus.OK, np.uint8),
            np.zeros(len(ends), np.bool_),
        )
        for quantity, name in _TOLD.items()
    ]
    order = np.argsort(np.concatenate([np.tile(np.arange(len(ends)), len(_TOLD)), frame[kept]]), kind="stable")
    parts.append(samples[kept])
    last = np.zeros(len(order), np.bool_)
    last[np.cumsum(len(_TOLD) + np.bincount(frame[kept], minlength=len(ends))) - 1] = True
    return Samples(
        np.concatenate([part.t_us for part in parts])[order],
        np.concatenate([part.quantity for part in parts])[order],
        np.concatenate([part.value for part in parts])[order],
        np.concatenate([part.status for part in parts])[order],
        last,
    )
