"""Frames of the kernel: what recvmmsg gives is what python-can makes of the same frames.

A pair of local sockets stands for SocketCAN, which needs a kernel with CAN: it stamps and delivers messages by the
same code of the kernel. What it cannot do, flags and counts of the kernel, is written into the memory itself.
"""

import socket
import struct
from collections.abc import Iterator
from typing import NamedTuple

import can
import numpy as np
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan import socketcan as stock
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.bus.kernel_frames import (
    CONTROL_BYTES,
    CONTROL_LENGTH,
    MESSAGE_FLAGS,
    MESSAGE_LENGTH,
    NO_FRAME,
    NO_TIME,
    SO_RXQ_OVFL,
    SO_TIMESTAMPNS,
)
from dctorque_can.daemon.wire.link import BusLink
from dctorque_can.daemon.wire.reception import MessageReceiver, receiver_of
from dctorque_can.daemon.wire.socketcan import MOST, KernelMemory, SocketcanReceiver
from dctorque_can.logs.messages import frames_from_messages
from dctorque_can.pipeline.frames import FrameFlag, Frames

EXTENDED, REMOTE, ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
COLUMNS = ("can_id", "length", "flags", "channel")


def classic(can_id: int, data: bytes, length: int | None = None, raw_dlc: int = 0) -> bytes:
    """Return a struct can_frame."""
    return struct.pack("=IB2xB8s", can_id, len(data) if length is None else length, raw_dlc, data)


def fd(can_id: int, data: bytes, flags: int = 0) -> bytes:
    """Return a struct canfd_frame."""
    return struct.pack("=IBB2x64s", can_id, len(data), flags, data)


FRAMES = {
    "standard": classic(0x123, b"\1\2\3"),
    "no data": classic(0x7FF, b""),
    "extended": classic(0x18FEF100 | EXTENDED, bytes(range(8))),
    "remote": classic(0x123 | REMOTE, b"", 4),
    "remote, raw DLC": classic(0x123 | REMOTE, b"", 8, 12),
    "error": classic(0x40 | ERROR, bytes(8)),
    "stale data behind the end": classic(0x1, b"\xff" * 8, 2),
    "FD, short": fd(0x55, b"\5" * 7),
    "FD, long": fd(0x56 | EXTENDED, bytes(range(64)), 1),
    "FD, both flags": fd(0x57, bytes(range(20)), 3),
    "FD, length without a DLC": fd(0x58, b"\7" * 13),
}


class Pair(NamedTuple):
    wire: socket.socket
    bus: SocketcanBus


@pytest.fixture
def pair(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pair]:
    """A bus of python-can on one end of a pair of sockets, and the other end."""
    wire, end = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    monkeypatch.setattr(stock, "create_socket", lambda: end)
    monkeypatch.setattr(stock, "bind_socket", lambda sock, channel: None)
    with SocketcanBus("pair") as bus, wire:
        yield Pair(wire, bus)


def by_python_can(pair: Pair, raws: list[bytes]) -> Frames:
    """Return what python-can makes of frames."""
    messages = []
    for raw in raws:
        pair.wire.send(raw)
        messages.append(stock.capture_message(pair.bus.socket))
    assert None not in messages
    return frames_from_messages(messages)  # type: ignore[arg-type]


def same(ours: Frames, theirs: Frames) -> None:
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    width = min(ours.data.shape[1], theirs.data.shape[1])
    np.testing.assert_array_equal(ours.data[:, :width], theirs.data[:, :width])
    assert not ours.data[:, width:].any()
    assert not theirs.data[:, width:].any()


@pytest.mark.parametrize("name", FRAMES)
def test_a_frame_is_what_python_can_makes_of_it(pair: Pair, name: str) -> None:
    theirs = by_python_can(pair, [FRAMES[name]])
    receiver = receiver_of(pair.bus)
    assert isinstance(receiver, SocketcanReceiver)
    pair.wire.send(FRAMES[name])
    same(receiver.receive(1.0), theirs)


def test_frames_of_all_kinds_come_in_one_batch(pair: Pair) -> None:
    raws = list(FRAMES.values())[-9:]  # what a local socket keeps
    theirs = by_python_can(pair, raws)
    receiver = receiver_of(pair.bus)
    for raw in raws:
        pair.wire.send(raw)
    batch = receiver.receive(1.0)
    same(batch, theirs)
    assert (np.diff(batch.t_us) >= 0).all()
    pair.wire.send(FRAMES["standard"])
    after = receiver.receive(1.0)
    same(after, by_python_can(pair, [FRAMES["standard"]]))
    assert after.data.shape == (1, 8)  # nothing of the long frames is left


def test_the_time_is_that_of_the_kernel(pair: Pair) -> None:
    receiver = receiver_of(pair.bus)
    pair.bus.socket.setblocking(False)
    pair.wire.send(FRAMES["standard"])
    stamp = pair.bus.socket.recvmsg(72, 64, socket.MSG_PEEK)[1][0][2]
    seconds, nanoseconds = struct.unpack("qq", stamp)
    assert receiver.receive(0.0).t_us[0] == (seconds * 1_000_000_000 + nanoseconds + 500) // 1000


def test_silence_is_waited_for_and_is_no_frame(pair: Pair) -> None:
    assert len(receiver_of(pair.bus).receive(0.01)) == 0


def test_what_is_no_frame_is_an_error(pair: Pair) -> None:
    receiver = receiver_of(pair.bus)
    pair.wire.send(b"123")
    with pytest.raises(can.CanOperationError, match="no CAN frame"):
        receiver.receive(1.0)


def test_a_socket_that_is_closed_is_a_lost_bus(pair: Pair) -> None:
    told: list[str] = []
    link = BusLink(lambda: pair.bus, lambda is_error, text: told.append(text))
    link.open()
    pair.bus.socket.close()
    assert len(link.receive(0.0)) == 0
    assert (link.up, link.counts.lost) == (False, 1)
    assert told == ["the bus is gone: Error receiving: Bad file descriptor; trying to open it again"]


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=0x123, data=b"\1\2\3", is_extended_id=False),
        can.Message(arbitration_id=0x18FEF100, data=bytes(8)),
        can.Message(arbitration_id=0x7FF, is_extended_id=False),
        can.Message(arbitration_id=0x18FEF100, is_remote_frame=True, dlc=4),
        can.Message(arbitration_id=0x55, data=bytes(range(20)), is_fd=True, bitrate_switch=True),
    ],
)
def test_frames_are_sent_as_python_can_sends_them(pair: Pair, message: can.Message) -> None:
    pair.bus.send(message)
    link = BusLink(lambda: pair.bus, lambda is_error, text: None)
    link.open()
    assert link.send(message)
    assert pair.wire.recv(100) == pair.wire.recv(100)


def test_a_socket_that_is_full_refuses_a_frame_and_stays_open(pair: Pair) -> None:
    link = BusLink(lambda: pair.bus, lambda is_error, text: None)
    link.open()
    message = can.Message(arbitration_id=0x123, data=b"1", is_extended_id=False)
    while link.send(message):
        pass
    assert (link.up, link.counts.send_failures, link.counts.lost) == (True, 1, 0)
    assert link.counts.sent > 0


def test_filters_that_the_kernel_does_not_apply_are_left_to_python_can(pair: Pair) -> None:
    pair.bus.set_filters([{"can_id": 0x100, "can_mask": 0x7FF}])
    assert isinstance(receiver_of(pair.bus), MessageReceiver)


# --- what a local socket cannot do ---


def control(*messages: tuple[int, bytes]) -> bytes:
    """Return control messages as the kernel writes them."""
    return b"".join(
        struct.pack("=Qii", 16 + len(data), socket.SOL_SOCKET, kind) + data.ljust(-(-len(data) // 8) * 8, b"\0")
        for kind, data in messages
    )


STAMP = (SO_TIMESTAMPNS, struct.pack("=qq", 1_700_000_000, 123_456_500))


def written(memory: KernelMemory, i: int, raw: bytes, cmsg: bytes, flags: int = 0) -> None:
    memory.raw[i, : len(raw)] = np.frombuffer(raw, np.uint8)
    memory.control[i].view(np.uint8)[: len(cmsg)] = np.frombuffer(cmsg, np.uint8)
    memory.headers[i, CONTROL_LENGTH] = len(cmsg)
    memory.headers[i, MESSAGE_FLAGS] = flags
    memory.headers[i, MESSAGE_LENGTH] = len(raw)


def test_what_was_sent_from_this_computer_is_marked() -> None:
    memory = KernelMemory()
    for i, flags in enumerate((0, socket.MSG_DONTROUTE, socket.MSG_DONTROUTE | 0x800)):  # 0x800: by this socket
        written(memory, i, FRAMES["standard"], control(STAMP), flags)
    _, frames = memory.frames(3, 0)
    assert frames.flags.tolist() == [0, FrameFlag.TRANSMITTED, FrameFlag.TRANSMITTED]
    assert frames.t_us.tolist() == [1_700_000_000_123_457] * 3
    assert memory.headers[:3, CONTROL_LENGTH].tolist() == [CONTROL_BYTES] * 3  # ready for the next call


def test_frames_that_the_kernel_dropped_are_counted() -> None:
    memory = KernelMemory()
    dropped = (SO_RXQ_OVFL, struct.pack("=I", 7))
    written(memory, 0, FRAMES["standard"], control(STAMP))
    written(memory, 1, FRAMES["standard"], control(STAMP, dropped))
    assert memory.frames(1, 0)[0] == 0
    written(memory, 0, FRAMES["standard"], control(dropped, STAMP))
    assert memory.frames(1, 0)[0] == 7
    written(memory, 0, FRAMES["standard"], control(STAMP))
    assert memory.frames(1, 7)[0] == 7  # it says so only where some were dropped


def test_dropped_frames_are_counted_and_told_at_each_doubling(pair: Pair) -> None:
    told: list[str] = []
    link = BusLink(lambda: pair.bus, lambda is_error, text: told.append(text))
    link.open()
    for dropped in (0, 2, 2, 3, 10, 11):
        link._receiver.dropped = dropped  # type: ignore[union-attr]
        pair.wire.send(FRAMES["standard"])
        assert len(link.receive(1.0)) == 1
    assert link.counts.dropped == 11
    assert told == [
        "2 frames of socketcan channel 'pair' were not fetched in time and lost; "
        "others are counted, and told when there are twice as many",
        "10 frames of socketcan channel 'pair' in all were not fetched in time",
    ]


@pytest.mark.parametrize(
    ("cmsg", "size", "fault"),
    [
        (b"", 16, NO_TIME),
        (control(STAMP)[:24], 16, NO_TIME),
        (control((SO_RXQ_OVFL, bytes(4))), 16, NO_TIME),
        (struct.pack("=Qii", 0, 1, SO_TIMESTAMPNS) + bytes(16), 16, NO_TIME),
        (control(STAMP), 15, NO_FRAME),
        (control(STAMP), 71, NO_FRAME),
    ],
)
def test_messages_that_are_not_whole_are_told_from_frames(cmsg: bytes, size: int, fault: int) -> None:
    memory = KernelMemory()
    written(memory, 0, bytes(size), cmsg)
    assert memory.frames(1, 0)[0] == fault


@given(
    st.binary(min_size=72, max_size=72), st.binary(min_size=64, max_size=64), st.integers(0, 2**31), st.booleans()
)
def test_no_bytes_lead_out_of_the_memory(raw: bytes, cmsg: bytes, size: int, is_fd: bool) -> None:
    memory = KernelMemory()
    written(memory, MOST - 1, raw if is_fd else raw[:16], cmsg)
    memory.headers[MOST - 1, CONTROL_LENGTH] = size
    _, frames = memory.frames(MOST, 0)
    assert frames.length[-1] <= 64
    assert not frames.data[-1, frames.length[-1] :].any()
