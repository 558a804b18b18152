"""A bus that goes away, comes back, and does not take what it is given."""

import errno
import queue
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from dctorque_can.daemon.wire import link as link_module
from dctorque_can.daemon.wire import opening, pace, sender, spin
from dctorque_can.daemon.wire.link import BusError, BusLink, open_bus
from dctorque_can.daemon.wire.pace import REST_S, SPARE_LOOKS
from dctorque_can.daemon.wire.socketcan import MOST
from dctorque_can.daemon.wire.spin import SPIN_RETURNS, SPIN_S, raise_on_spin

from ..clock import Clock

MESSAGE = can.Message(arbitration_id=0x100, data=b"\1", is_extended_id=False)


class Bus:
    """Plays a list of events: a message, silence (None) or an error."""

    channel_info = "a bus of tests"

    def __init__(self, events: list[Any], full: bool = False) -> None:
        self.events = events
        self.closed = False
        self.full = full

    def recv(self, timeout: float) -> can.Message | None:
        event = self.events.pop(0) if self.events else None
        if isinstance(event, Exception):
            raise event
        return event

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.full:
            raise can.CanOperationError("Failed to transmit", errno.ENOBUFS)

    def shutdown(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def _on_the_clock(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "time", clock)
    monkeypatch.setattr(pace, "time", clock)
    monkeypatch.setattr(sender, "PATIENCE_S", 900.0)  # what a bus says is known, however busy the machine


def make(*buses: Bus | BusError) -> tuple[BusLink, list[str]]:
    queue = list(buses)
    told: list[str] = []

    def connect() -> Any:
        bus = queue.pop(0)
        if isinstance(bus, BusError):
            raise bus
        return bus

    return BusLink(connect, lambda is_error, text: told.append(text)), told


class Polling(can.BusABC):
    """One message, and then nothing: it returns after a pause, however long it is asked to wait."""

    def __init__(self, clock: Clock, pause_s: float) -> None:
        super().__init__("polling")
        self.calls = 0
        self._clock = clock
        self._pause_s = pause_s

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.calls += 1
        if self.calls == 1:
            return MESSAGE, False
        self._clock.sleep(min(timeout or 0.0, self._pause_s))
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError


class SocketCand:
    """The least of a socketcand server: two frames for each client when it is told to, until it shall hang up."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.arguments = {"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": self.port}
        self.attempts = 0
        self._ready: queue.Queue[socket.socket] = queue.Queue()
        self._clients: list[socket.socket] = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.sendall(b"< hi >")
            for _ in range(2):  # open, rawmode
                if not client.recv(256):
                    break
                client.sendall(b"< ok >")
            else:
                self._ready.put(client)
                continue
            client.close()

    def open_and_speak(self) -> can.BusABC:
        """Open a bus, and only then send: python-can takes frames that come earlier for a part of an answer."""
        self.attempts += 1
        bus = open_bus(self.arguments)
        client = self._ready.get()
        client.sendall(b"< frame 123 1.5 0102 >< frame 124 1.6 03 >")
        self._clients.append(client)
        return bus

    def hang_up(self) -> None:
        while self._clients:
            self._clients.pop().close()

    def close(self) -> None:
        self.hang_up()
        if self._thread.is_alive():
            self._listener.shutdown(socket.SHUT_RDWR)
            self._thread.join()
            self._listener.close()


@pytest.fixture
def socketcand() -> Iterator[SocketCand]:
    server = SocketCand()
    yield server
    server.close()


def receive_all(link: BusLink, calls: int) -> int:
    return sum(len(link.receive(1.0)) for _ in range(calls))


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
    link, _ = make(Bus([MESSAGE] * (MOST + 2) + [None, MESSAGE]))
    link.open()
    assert [len(link.receive(0.0)) for _ in range(3)] == [MOST, 2, 1]


def test_an_error_behind_a_message_takes_nothing_away() -> None:
    first = Bus([MESSAGE, MESSAGE, can.CanOperationError("Network is down", errno.ENETDOWN)])
    link, _ = make(first)
    link.open()
    assert len(link.receive(0.0)) == 2
    assert link.up
    assert len(link.receive(0.0)) == 0
    assert (link.up, link.counts.lost, link.counts.received) == (False, 1, 2)


def test_a_busy_bus_is_looked_at_once_a_millisecond_and_a_quiet_one_at_once(clock: Clock) -> None:
    free = 1 + SPARE_LOOKS
    looks = free + 20
    link, _ = make(Bus([*[MESSAGE, None] * looks, *[MESSAGE] * MOST, MESSAGE, None]))
    link.open()
    began_s = clock.now_s
    for _ in range(free):  # a few that come close together
        assert len(link.receive(1.0)) == 1
    assert clock.now_s == began_s
    for _ in range(looks - free):
        clock.now_s += 0.25 * REST_S
        assert len(link.receive(1.0)) == 1
    assert clock.now_s - began_s == pytest.approx((looks - free) * REST_S)
    clock.now_s += 5.0
    before_s = clock.now_s
    assert len(link.receive(1.0)) == MOST
    assert len(link.receive(1.0)) == 1
    assert clock.now_s == before_s  # a whole batch: more waits behind it


def test_a_silence_earns_a_few_looks_and_no_more(clock: Clock) -> None:
    link, _ = make(Bus([MESSAGE, None] * 40))
    link.open()
    clock.now_s += 60.0
    began_s = clock.now_s
    for _ in range(40):
        assert len(link.receive(1.0)) == 1
    assert clock.now_s - began_s == pytest.approx((40 - 1 - SPARE_LOOKS) * REST_S)


def test_a_bus_that_cannot_be_opened_is_one_clear_error() -> None:
    with pytest.raises(BusError, match=r"nonsense:x cannot be opened: Unknown interface type .*socketcan"):
        open_bus({"interface": "nonsense", "channel": "x"})


def test_a_virtual_bus_keeps_the_time_of_simulated_frames(connect: Callable[[], can.BusABC]) -> None:
    with connect() as sender, connect() as receiver:
        sender.send(can.Message(timestamp=12.5, arbitration_id=1))
        received = receiver.recv(1.0)
    assert received is not None
    assert received.timestamp == 12.5


@pytest.fixture
def _spin_on_the_clock(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spin, "time", clock)
    monkeypatch.setattr(can.bus, "time", clock.monotonic)


@pytest.mark.usefixtures("_spin_on_the_clock")
@pytest.mark.parametrize("pause_s", [1e-6, 0.9 * SPIN_S / SPIN_RETURNS])
def test_an_interface_that_returns_at_once_for_ever_is_lost(clock: Clock, pause_s: float) -> None:
    bus = Polling(clock, pause_s)
    raise_on_spin(bus)
    link, told = make(bus, Bus([MESSAGE]))  # type: ignore[arg-type]
    link.open()
    assert receive_all(link, 20) == 2
    assert bus.calls <= 3 + SPIN_RETURNS  # one of them asked whether more waits
    assert (link.counts.lost, link.counts.reconnects) == (1, 1)
    assert "its other end has closed" in told[0]


@pytest.mark.usefixtures("_spin_on_the_clock")
@pytest.mark.parametrize("pause_s", [1.1 * SPIN_S / SPIN_RETURNS, 0.001, 10.0])
def test_a_silent_interface_that_polls_is_not_lost(clock: Clock, pause_s: float) -> None:
    bus = Polling(clock, pause_s)
    raise_on_spin(bus)
    with bus:
        assert bus.recv(0.01) is MESSAGE
        assert bus.recv(0.3) is None
        for _ in range(1000):
            assert bus.recv(0.0) is None  # asked not to wait: as quick as it likes
    assert bus.calls > 1001


def refuse_python_can(monkeypatch: pytest.MonkeyPatch) -> None:
    """python-can alone tries for 10 s, without a pause, to reach a socketcand server that is not there."""

    def tries(**arguments: object) -> None:
        pytest.fail("python-can was asked")

    monkeypatch.setattr(can, "Bus", tries)


def test_a_socketcand_server_that_goes_and_comes_back(
    socketcand: SocketCand, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opening, "PROBE_S", None)  # the server answers, be it late
    told: list[str] = []
    link = BusLink(socketcand.open_and_speak, lambda is_error, text: told.append(text))
    link.open()

    def receive(count: int) -> list[int]:
        ids: list[int] = []
        while len(ids) < count:
            ids += link.receive(0.05).can_id.tolist()
        return ids

    assert receive(2) == [0x123, 0x124]
    assert len(link.receive(0.3)) == 0
    assert link.counts.lost == 0  # silent, and no more
    monkeypatch.setattr(spin, "time", clock)  # which stands still: what returns early has returned at once
    socketcand.hang_up()
    assert receive(2) == [0x123, 0x124]
    assert (link.counts.lost, link.counts.reconnects) == (1, 1)
    assert "the bus is gone" in told[0]
    assert "open again" in told[1]
    refuse_python_can(monkeypatch)
    socketcand.close()
    while link.up:
        link.receive(0.05)
    began_s = clock.now_s
    while socketcand.attempts < 4:
        link.receive(0.05)
    assert clock.now_s - began_s == pytest.approx(0.3)  # 0.1 s, a try, 0.2 s, another try
    assert (link.counts.lost, link.counts.reconnects) == (2, 1)
    link.close()


def test_a_socketcand_server_that_is_not_there_is_an_error_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    refuse_python_can(monkeypatch)
    with pytest.raises(BusError, match="refused"):
        open_bus({"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1", "port": port})
