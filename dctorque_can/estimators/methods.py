"""The estimators to choose from."""

from __future__ import annotations

from enum import IntEnum


class Method(IntEnum):
    """Which estimator gives the published torques."""

    OH2014 = 0
    KALMAN = 1
