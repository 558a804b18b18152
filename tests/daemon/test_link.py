"""A bus that goes away, comes back, and does not take what it is given."""

import errno
from collections.abc import Callable
from typing import Any

import can
import pytest

from dctorque_can.daemon import link as link_module
from dctorque_can.daemon.link import BusError, BusLink, open_bus

MESSAGE = can.Message(arbitration_id=0x100, data=b"\1", is_extended_id=False)


class Bus:
    """Plays a list of events: a message, silence (None) or an error."""

    def __init__(self, events: list[Any], full: bool = False) -> None:
        self.events = events
        self.closed = False
        self.full = full

    def recv(self, timeout: float) -> can.Message | None:
        event = self.events.pop(0) if self.events else None
        if isinstance(event, Exception):
            raise event
        return event

    def send(self, message: can.Message) -> None:
        if self.full:
            raise can.CanOperationError("Failed to transmit", errno.ENOBUFS)

    def shutdown(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def _short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "FIRST_BACKOFF_S", 0.001)
    monkeypatch.setattr(link_module, "LONGEST_BACKOFF_S", 0.004)


def make(*buses: Bus | BusError) -> tuple[BusLink, list[str]]:
    queue = list(buses)
    told: list[str] = []

    def connect() -> Any:
        bus = queue.pop(0)
        if isinstance(bus, BusError):
            raise bus
        return bus

    return BusLink(connect, lambda is_error, text: told.append(text)), told


def receive_all(link: BusLink, calls: int) -> int:
    return sum(link.receive(0.01) is not None for _ in range(calls))


@pytest.mark.parametrize(
    "error",
    [
        can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN),
        OSError(errno.ENODEV, "No such device"),
        EOFError("server closed"),
    ],
)
def test_a_lost_bus_is_opened_again(error: Exception) -> None:
    first, second = Bus([MESSAGE, error]), Bus([MESSAGE, MESSAGE])
    link, told = make(first, BusError("still down"), BusError("still down"), second)
    link.open()
    assert receive_all(link, 60) == 3
    assert first.closed
    assert (link.counts.lost, link.counts.reconnects, link.counts.received) == (1, 1, 3)
    assert len(told) == 2
    assert "gone" in told[0]
    assert "[Error Code" not in told[0]
    assert "again" in told[1]


def test_a_bus_that_keeps_failing_is_told_once() -> None:
    down = can.CanOperationError("Network is down", errno.ENETDOWN)
    link, told = make(*(Bus([down]) for _ in range(5)), Bus([MESSAGE]))
    link.open()
    assert receive_all(link, 200) == 1
    assert link.counts.lost == 5
    assert sum("gone" in line for line in told) == 1


def test_a_full_transmit_queue_is_counted_and_no_reason_to_reconnect() -> None:
    link, told = make(Bus([], full=True))
    link.open()
    assert not link.send(MESSAGE)
    assert link.up
    assert (link.counts.send_failures, link.counts.lost) == (1, 0)
    assert told == []


def test_bus_off_is_told() -> None:
    bus_off = can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, dlc=8, data=bytes(8))
    link, told = make(Bus([bus_off]))
    link.open()
    link.receive(0.0)
    assert (link.counts.error_frames, link.counts.bus_offs) == (1, 1)
    assert "bus-off" in told[0]


def test_waiting_messages_come_together() -> None:
    link, _ = make(Bus([MESSAGE] * 5 + [None, MESSAGE]))
    link.open()
    assert [len(link.receive_some(0.0, most)) for most in (3, 64, 64)] == [3, 2, 1]


def test_a_bus_that_cannot_be_opened_is_one_clear_error() -> None:
    with pytest.raises(BusError, match=r"nonsense:x cannot be opened: Unknown interface type .*socketcan"):
        open_bus({"interface": "nonsense", "channel": "x"})


def test_a_virtual_bus_keeps_the_time_of_simulated_frames(connect: Callable[[], can.BusABC]) -> None:
    with connect() as sender, connect() as receiver:
        sender.send(can.Message(timestamp=12.5, arbitration_id=1))
        received = receiver.recv(1.0)
    assert received is not None
    assert received.timestamp == 12.5
