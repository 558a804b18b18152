"""Manoeuvres driven once for all tests, and what is read from their truth."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES

Rows = NDArray[np.void]
OPEN, SLIPPING, LOCKED = ClutchPhase.OPEN, ClutchPhase.SLIPPING, ClutchPhase.LOCKED


@cache
def driven(vehicle: Vehicle, name: str) -> Rows:
    return simulate(vehicle, MANOEUVRES[name](vehicle))


def seconds(truth: Rows) -> NDArray[np.float64]:
    return np.asarray(truth["t_us"] / 1e6)


def speed(truth: Rows, car: Vehicle) -> NDArray[np.float64]:
    return np.asarray(truth["undriven_wheel_speed_rad_s"] * car.chassis.wheel_radius_m)


def part(truth: Rows, start: float, end: float) -> Rows:
    t = seconds(truth)
    return np.asarray(truth[(t >= start) & (t <= end)])
