"""What a signal does to a service that compiles, serves, or is held up by something that does not return."""

import os
import signal
from dataclasses import dataclass
from typing import Any

import pytest

from dctorque_can.daemon import signals
from dctorque_can.daemon.signals import obeying_signals


@dataclass
class Stub:
    """Stands for the service."""

    compiling: bool = False
    finishing: bool = False
    stopped: bool = False
    rotated: bool = False
    reloaded: bool = False

    def stop(self) -> None:
        self.stopped = True

    def rotate(self) -> None:
        self.rotated = True

    def reload(self) -> None:
        self.reloaded = True


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "GRACE_S", 900.0)  # or a busy machine would end the tests


def obey(stub: Stub) -> Any:
    return obeying_signals(stub)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_stops_a_service_and_restores_what_signals_did_before(number: int) -> None:
    before, stub = signal.getsignal(number), Stub()
    with obey(stub):
        os.kill(os.getpid(), number)
        assert stub.stopped
        assert signal.getsignal(number) == before  # a second one acts as usual
    assert signal.getsignal(number) == before
    assert signal.set_wakeup_fd(-1) == -1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_interrupts_compiling(number: int) -> None:
    with pytest.raises(KeyboardInterrupt), obey(Stub(compiling=True)):
        os.kill(os.getpid(), number)


@pytest.mark.parametrize(
    ("number", "outcome"), [(signal.SIGUSR1, (True, False, False)), (signal.SIGHUP, (False, True, False))]
)
def test_sigusr1_begins_a_new_log_and_sighup_reads_the_file_anew(
    number: int, outcome: tuple[bool, bool, bool]
) -> None:
    stub = Stub()
    with obey(stub):
        os.kill(os.getpid(), number)
    assert (stub.rotated, stub.reloaded, stub.stopped) == outcome


@pytest.mark.parametrize(("finishing", "ends"), [(False, [143]), (True, [])])
def test_a_service_that_is_held_up_ends_unless_it_is_closing_its_log(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], finishing: bool, ends: list[int]
) -> None:
    """The exit is recorded instead of done; the watch then goes on until the block ends."""
    codes: list[int] = []
    monkeypatch.setattr(signals, "GRACE_S", 0.0)
    monkeypatch.setattr(os, "_exit", codes.append)
    waited = []
    inner = os.read

    def read(descriptor: int, size: int) -> bytes:
        waited.append(1)
        return inner(descriptor, size)

    monkeypatch.setattr(os, "read", read)
    with obey(Stub(finishing=finishing)):
        os.kill(os.getpid(), signal.SIGTERM)
        while len(waited) < 2:  # it has dealt with the signal and waits for the next
            pass
    assert codes == ends
    assert ("does not return" in capfd.readouterr().err) == bool(ends)
