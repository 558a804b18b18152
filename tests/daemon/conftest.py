"""The real parts of the service: a virtual bus, the log-writer process, a simulated car."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from dctorque_can.daemon import stalls
from dctorque_can.daemon.log import process as log_process

from ..recorded_drive import clock, config, connect, drive  # noqa: F401  fixtures

HANG_S = 900  # so late that no load of the machine explains it


@pytest.fixture(autouse=True)
def _only_what_hangs_is_late(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail a test that hangs, so that its loops may wait without a limit of their own."""

    def hung(number: int, frame: object) -> None:
        pytest.fail(f"hangs: not done after {HANG_S} s")

    monkeypatch.setattr(log_process, "OPEN_TIMEOUT_S", HANG_S)
    monkeypatch.setattr(log_process, "CLOSE_TIMEOUT_S", HANG_S)
    monkeypatch.setattr(log_process, "SLOW_S", HANG_S)
    monkeypatch.setattr(stalls, "STALL_S", HANG_S)
    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(HANG_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "logs"
