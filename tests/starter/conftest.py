"""One drive for all of these tests: traffic with launches, stops, and all gears."""

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.offline.simulated_car import DriveName, drive_of
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import simulate

from .bus import Drive


@pytest.fixture(scope="session")
def traffic() -> Drive:
    config = load_config(shipped_config("avante_dct7"))
    return Drive(simulate(config.settings.vehicle, drive_of(config, DriveName.MIXED, 3, 180.0)))
