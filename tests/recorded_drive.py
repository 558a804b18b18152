"""Fixtures of the live service and of the rooms that work on recordings: one car, one drive, one virtual bus."""

from collections.abc import Callable
from functools import partial
from itertools import count

import can
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.wire.link import open_bus
from dctorque_can.offline.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car
from dctorque_can.resources import shipped_config

from .clock import Clock

_numbers = count()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def config() -> Config:
    """The paper's car on a virtual bus of its own."""
    channel = f"test {next(_numbers)}"
    return load_config(
        shipped_config("paper_car"),
        {"can.interface": "virtual", "can.channel": channel, "output.enabled": "true"},
    )


@pytest.fixture
def connect(config: Config) -> Callable[[], can.BusABC]:
    return partial(open_bus, config.can.arguments())


@pytest.fixture(scope="session")
def drive() -> SimulatedDrive:
    """Launch and first upshift with production signals."""
    config = load_config(shipped_config("paper_car"))
    return simulate_car(config, DriveName.PAPER, ProfileName.PRODUCTION, seed=3, duration_s=7.0)
