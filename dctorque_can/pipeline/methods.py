"""The estimators to choose from: one line each."""

from __future__ import annotations

from typing import Any

from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.settings import Settings


def new(settings: Settings) -> Any:
    """Return the estimator that was chosen, before its first frame; only its package is loaded and compiled."""
    if settings.method is Method.KALMAN:
        from dctorque_can.estimators.kalman import frame as kalman

        return kalman.new(settings.vehicle, settings.kalman)
    from dctorque_can.estimators.oh2014 import frame as oh2014

    return oh2014.new(settings.vehicle, settings.observer)
