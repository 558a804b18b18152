"""A bus that blocks in sending, opening or closing holds up nobody; whatever it raises means that it is gone."""

import threading
from collections.abc import Iterator
from typing import Any

import can
import pytest

from dctorque_can.daemon.wire import link as link_module
from dctorque_can.daemon.wire import sender
from dctorque_can.daemon.wire.link import BusError, BusLink, open_bus
from dctorque_can.daemon.wire.sender import is_full

from .test_link import MESSAGE, Bus


class Blocking(Bus):
    """Blocks in one call until it is released."""

    def __init__(self, call: str) -> None:
        super().__init__([MESSAGE] * 100)
        self.released = threading.Event()
        self.error: Exception | None = None
        self._call = call

    def _block(self, call: str) -> None:
        if call == self._call:
            self.released.wait()
            if self.error is not None:
                raise self.error

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self._block("send")

    def shutdown(self) -> None:
        self._block("shutdown")
        super().shutdown()


@pytest.fixture
def bus(request: pytest.FixtureRequest) -> Iterator[Blocking]:
    bus = Blocking(request.param)
    yield bus
    bus.released.set()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender, "PATIENCE_S", 0.0)
    monkeypatch.setattr(link_module, "CLOSE_S", 0.01)


def opened(*buses: Any) -> tuple[BusLink, list[str]]:
    told: list[str] = []
    waiting = list(buses)
    link = BusLink(lambda: waiting.pop(0), lambda is_error, text: told.append(text))
    link.open()
    return link, told


@pytest.mark.parametrize("bus", ["send"], indirect=True)
def test_a_send_that_blocks_holds_up_neither_receiving_nor_closing(bus: Blocking) -> None:
    link, _ = opened(bus)
    assert link.send(MESSAGE)  # in the hands of the interface
    assert not link.send(MESSAGE)
    assert len(link.receive(0.0)) > 0
    assert (link.counts.sent, link.counts.send_failures, link.counts.lost) == (1, 1, 0)
    link.close()
    assert not link.up


@pytest.mark.parametrize("bus", ["send"], indirect=True)
def test_a_bus_that_takes_nothing_is_told_once_although_it_is_tried_again_and_again(
    bus: Blocking, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each frame that it is given is under way for a while, and then failed."""
    monkeypatch.setattr(link_module, "REFUSAL_S", 0.0)
    link, told = opened(bus)
    bus.error = can.CanTimeoutError("it takes no more")
    for tries in (1, 2, 3):
        bus.released.clear()
        assert link.send(MESSAGE)
        assert not link.send(MESSAGE)
        bus.released.set()
        while link.counts.send_failures < 2 * tries:
            link.receive(0.0)
    assert (link.counts.sent, link.counts.lost) == (0, 0)
    assert ["no frame could be sent" in line for line in told] == [True]


@pytest.mark.parametrize("bus", ["send"], indirect=True)
def test_a_send_that_fails_late_is_counted_as_not_sent(bus: Blocking) -> None:
    link, told = opened(bus)
    bus.error = RuntimeError("pulled out")
    assert link.send(MESSAGE)
    bus.released.set()
    while link.up:
        link.receive(0.0)
    assert (link.counts.sent, link.counts.send_failures, link.counts.lost) == (0, 1, 1)
    assert told == ["the bus is gone: pulled out; trying to open it again"]


@pytest.mark.parametrize("bus", ["shutdown"], indirect=True)
def test_a_bus_that_does_not_close_is_told_and_left(bus: Blocking) -> None:
    link, told = opened(bus)
    link.close()
    assert told == ["a bus of tests does not close and is left as it is"]


@pytest.mark.parametrize("bus", ["shutdown"], indirect=True)
def test_a_lost_bus_that_does_not_close_is_opened_again(bus: Blocking) -> None:
    link, _ = opened(bus, Bus([MESSAGE]))
    bus.events.insert(0, OSError("gone"))
    while link.counts.received == 0:
        link.receive(0.01)
    assert (link.counts.lost, link.counts.reconnects) == (1, 1)


def test_an_error_in_closing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Blocking("shutdown")
    bus.error = AttributeError("no such handle")
    bus.released.set()
    link, told = opened(bus)
    monkeypatch.setattr(link_module, "CLOSE_S", 900.0)
    link.close()
    assert told == ["a bus of tests cannot be closed: no such handle"]


def test_opening_that_blocks_can_be_given_up_and_what_opens_later_is_closed() -> None:
    released, bus = threading.Event(), Bus([])

    def connect() -> Any:
        released.wait()
        return bus

    link = BusLink(connect, lambda is_error, text: None)
    link.open(given_up=lambda: True)
    assert not link.up
    assert len(link.receive(0.0)) == 0
    link.close()
    released.set()
    while not bus.closed:
        pass


def test_opening_that_never_ends_is_one_clear_error_and_is_waited_for_if_need_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released = threading.Event()
    tries = []

    def connect() -> Any:
        tries.append(1)
        released.wait()
        return Bus([MESSAGE])

    monkeypatch.setattr(link_module, "OPEN_S", 0.0)
    link = BusLink(connect, lambda is_error, text: None)
    with pytest.raises(BusError, match="no answer"):
        link.open()
    assert len(link.receive(0.0)) == 0
    released.set()
    while not len(link.receive(0.01)):
        pass
    assert len(tries) == 1  # or every try would leave a thread behind
    link.close()


@pytest.mark.parametrize(
    "error", [IndexError("string index out of range"), AttributeError("x"), RuntimeError("x")]
)
def test_whatever_is_raised_while_receiving_or_opening_means_that_the_bus_is_gone(error: Exception) -> None:
    told: list[str] = []
    tries: list[Any] = [Bus([MESSAGE, error]), error, Bus([MESSAGE])]

    def connect() -> Any:
        bus = tries.pop(0)
        if isinstance(bus, Exception):
            raise bus
        return bus

    link = BusLink(connect, lambda is_error, text: told.append(text))
    link.open()
    while link.counts.received < 2:
        link.receive(0.01)
    assert (link.counts.lost, link.counts.reconnects) == (1, 1)
    assert told == [f"the bus is gone: {error}; trying to open it again", "the bus is open again"]
    link.close()


@pytest.mark.parametrize("error", [KeyError("driver"), AttributeError("x"), RuntimeError("x")])
def test_whatever_is_raised_by_python_can_at_the_first_opening_is_one_clear_error(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fails(**arguments: object) -> None:
        raise error

    monkeypatch.setattr(can, "Bus", fails)
    with pytest.raises(BusError, match="pcan:PCAN_USBBUS1 cannot be opened"):
        open_bus({"interface": "pcan", "channel": "PCAN_USBBUS1"})


@pytest.mark.parametrize(
    ("error", "full"),
    [
        (can.CanOperationError("Transmit buffer full"), True),  # socketcan
        (can.CanOperationError("Could not send message to one or more recipients"), True),  # virtual
        (can.CanOperationError("Failed to transmit", 105), True),  # ENOBUFS
        (can.CanTimeoutError("x"), True),
        (can.CanOperationError("Could not write to serial device"), False),
        (can.CanOperationError("Failed to transmit", 100), False),  # ENETDOWN
        (TimeoutError("full"), False),
        (RuntimeError("full"), False),
    ],
)
def test_a_full_queue_is_told_from_a_bus_that_is_gone(error: Exception, full: bool) -> None:
    assert is_full(error) == full
