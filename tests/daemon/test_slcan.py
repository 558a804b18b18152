"""An slcan adapter at the end of a pseudo-terminal: reset inside a line, noisy, unplugged, no longer reading."""

import os
import pty
import tty
from collections.abc import Callable, Iterator

import pytest

from dctorque_can.daemon.wire import link as link_module
from dctorque_can.daemon.wire import sender
from dctorque_can.daemon.wire.link import BusLink, open_bus
from dctorque_can.daemon.wire.slcan import LONGEST_LINE, is_whole

from .test_link import MESSAGE

GOOD = b"t1232AABB\r"
HALF_A_LINE = b"t10\r"


class Adapter:
    """The far end of a pseudo-terminal; a new one is plugged in after the last was pulled out."""

    def __init__(self) -> None:
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        os.set_blocking(self.master, False)

    def open(self) -> object:
        return open_bus({"interface": "slcan", "channel": self.port, "sleep_after_open": 0.0})

    def says(self, *lines: bytes) -> None:
        for line in lines:
            assert os.write(self.master, line) == len(line)

    def reads(self) -> bytes:
        read = b""
        while True:
            try:
                read += os.read(self.master, 1 << 16)
            except BlockingIOError:
                return read

    def pull_out(self) -> None:
        os.close(self.master)
        os.close(self._slave)
        self.master = -1


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender, "PATIENCE_S", 900.0)  # what the bus says is known, however busy the machine


@pytest.fixture
def adapters() -> Iterator[list[Adapter]]:
    plugged = [Adapter()]
    yield plugged
    for adapter in plugged:
        if adapter.master >= 0:
            adapter.pull_out()


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def link(adapters: list[Adapter], told: list[str]) -> Iterator[BusLink]:
    connect: Callable = lambda: adapters[-1].open()  # noqa: E731
    link = BusLink(connect, lambda is_error, text: told.append(text))
    link.open()
    yield link
    link.close()


def receive(link: BusLink, count: int) -> list[bytes]:
    received: list[bytes] = []
    while len(received) < count:
        frames = link.receive(0.05)
        received += [bytes(data[:size]) for data, size in zip(frames.data, frames.length, strict=True)]
    return received


def test_half_a_line_is_dropped_and_counted(link: BusLink, adapters: list[Adapter], told: list[str]) -> None:
    adapters[0].says(GOOD, HALF_A_LINE, GOOD, HALF_A_LINE, GOOD)
    assert receive(link, 3) == [b"\xaa\xbb"] * 3
    assert (link.counts.damaged, link.counts.lost, link.counts.received) == (2, 0, 3)
    (line,) = told
    assert line.startswith(f"a damaged line of the slcan adapter on slcan:{adapters[0].port}")


@pytest.mark.parametrize(
    "garbage",
    [
        b"t\r",
        b"t123\r",
        b"t1232AA\r",  # shorter than it says
        b"t1232AABBC\r",
        b"t1232A" + GOOD,  # a reset inside the data, and no end of the line
        b"t12x0\r",
        b"t-120\r",
        b"tFFF0\r",  # more than 11 bits
        b"t1239" + b"00" * 12 + b"\r",
        b"T123\r",
        b"TFFFFFFFF0\r",
        b"r12\r",
        b"D123\r",
        b"t12\xff0\r",
        b"\xff\xfe\x00\r",
        b"hello\r",
        b"t10\a",
    ],
)
def test_garbage_is_dropped_and_counted(link: BusLink, adapters: list[Adapter], garbage: bytes) -> None:
    for _ in range(3):
        adapters[0].says(garbage, GOOD)
        assert receive(link, 1) == [b"\xaa\xbb"]
    assert (link.counts.damaged, link.counts.lost) == (3, 0)


def test_a_line_without_an_end_is_dropped(link: BusLink, adapters: list[Adapter]) -> None:
    adapters[0].says(b"0" * (LONGEST_LINE + 1))
    while not link.counts.damaged:
        assert len(link.receive(0.01)) == 0
    adapters[0].says(GOOD)
    assert receive(link, 1) == [b"\xaa\xbb"]


@pytest.mark.parametrize(
    "line",
    [
        *("\r", "\a", "z\r", "Z\r", "V1013\r", "NA123\r", "F00\r"),
        *("t1230\r", "t1232AABB\r", "t1232aabb\r", "t1232AABB1A2B\r", "T1ABCDEF01FF\r"),
        *("r1238\r", "R000001230\r", f"d1239{'00' * 12}\r", f"B000001239{'00' * 12}\r"),
    ],
)
def test_what_adapters_may_say_is_whole(line: str) -> None:
    assert is_whole(line)


def test_an_adapter_that_is_pulled_out_while_something_is_sent(
    link: BusLink, adapters: list[Adapter], told: list[str]
) -> None:
    assert link.send(MESSAGE)
    adapters[0].pull_out()
    assert not link.send(MESSAGE)
    assert not link.up
    for _ in range(3):
        assert len(link.receive(0.01)) == 0
        assert not link.send(MESSAGE)
    assert (link.counts.lost, link.counts.sent, link.counts.send_failures) == (1, 1, 4)
    assert ["the bus is gone" in line for line in told] == [True]
    adapters.append(Adapter())
    while not link.up:
        link.receive(0.05)
    adapters[1].says(GOOD)
    assert receive(link, 1) == [b"\xaa\xbb"]
    assert link.send(MESSAGE)
    assert "t100101\r" in adapters[1].reads().decode()
    assert "open again" in told[1]


def test_an_adapter_that_is_pulled_out_while_it_is_listened_to(
    link: BusLink, adapters: list[Adapter], told: list[str]
) -> None:
    adapters[0].pull_out()
    while link.up:
        link.receive(0.05)
    assert ["the bus is gone" in line for line in told] == [True]


def test_an_adapter_that_does_not_read_any_more(
    link: BusLink, adapters: list[Adapter], told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The buffer of the pseudo-terminal is full; frames still come in, and the bus stays open."""
    monkeypatch.setattr(link_module, "REFUSAL_S", 0.0)
    while link.send(MESSAGE):
        pass
    sent = link.counts.sent
    assert not link.send(MESSAGE)
    adapters[0].says(GOOD)
    assert receive(link, 1) == [b"\xaa\xbb"]
    assert (link.counts.lost, link.counts.send_failures) == (0, 2)
    assert ["no frame could be sent" in line for line in told] == [True]
    assert adapters[0].reads().count(b"t100101\r") >= sent - 1  # the last one may have been cut
    assert link.send(MESSAGE)
    assert "can be sent again" in told[1]


def test_a_port_whose_adapter_does_not_read_is_closed_all_the_same(
    link: BusLink, adapters: list[Adapter], told: list[str]
) -> None:
    while link.send(MESSAGE):
        pass
    port = link._bus.serialPortOrig  # type: ignore[union-attr]
    link.close()
    assert not port.is_open
    assert told == []
