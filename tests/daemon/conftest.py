import signal
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path

import can
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon import log_process
from dctorque_can.daemon.link import open_bus
from dctorque_can.daemon.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car
from dctorque_can.resources import shipped_config

from .clock import Clock

HANG_S = 900  # so late that no load of the machine explains it

_numbers = count()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(autouse=True)
def _only_what_hangs_is_late(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail a test that hangs, so that its loops may wait without a limit of their own."""

    def hung(number: int, frame: object) -> None:
        pytest.fail(f"hangs: not done after {HANG_S} s")

    monkeypatch.setattr(log_process, "OPEN_TIMEOUT_S", HANG_S)
    monkeypatch.setattr(log_process, "CLOSE_TIMEOUT_S", HANG_S)
    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(HANG_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


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


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "logs"
