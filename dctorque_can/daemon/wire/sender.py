"""Sends frames on a python-can bus; one that blocks holds up its own thread and nobody else."""

from __future__ import annotations

import errno
import re
import socket
import struct
from concurrent.futures import Future
from functools import partial
from queue import SimpleQueue
from threading import Thread

import can
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import build_can_frame
from can.interfaces.virtual import VirtualBus

from dctorque_can.daemon.background import finished, settle
from dctorque_can.pipeline.frames import EXTENDED_ID

SEND_S = 0.1  # for interfaces that keep to a time limit
PATIENCE_S = 0.005  # that long the receive loop waits for a frame to be taken
NEVER_WAIT = (SocketcanBus, VirtualBus)  # these say at once that they are full
_CLASSIC = struct.Struct("=IB2xB8s")  # struct can_frame
_FULL = {errno.ENOBUFS, errno.EAGAIN}
# What python-can's interfaces say without a code: socketcan "Transmit buffer full", virtual the other.
_FULL_TEXT = re.compile(r"\bfull\b|to one or more recipients", re.IGNORECASE)


def is_full(error: Exception) -> bool:
    """Return whether an error of `Sender.send` says that the bus takes no frame now, and no more than that."""
    if isinstance(error, can.CanTimeoutError) or getattr(error, "error_code", None) in _FULL:
        return True
    return isinstance(error, can.CanError) and _FULL_TEXT.search(str(error)) is not None


class Sender:
    """Hands one frame after the other to a bus.

    Args:
        bus: where to. Unless it is known never to wait (`NEVER_WAIT`), it gets a thread: `can.BusABC.send` has a
            time limit, but many interfaces do not keep to it, or wait for the hardware after it.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        # python-can asks first whether the socket takes a frame; the socket says so itself
        self._socket = bus.socket if isinstance(bus, SocketcanBus) and bus.channel else None
        self._under_way: Future[None] | None = None
        self._calls: SimpleQueue[tuple[can.Message, Future[None]] | None] | None = None
        if not isinstance(bus, NEVER_WAIT):
            self._calls = SimpleQueue()
            Thread(target=self._work, args=(self._calls,), name="sender", daemon=True).start()

    def send(self, message: can.Message) -> bool:
        """Send, and wait for it up to `PATIENCE_S`; false: it is under way, and counts as sent until `late_error`.

        Raises:
            Exception: whatever the interface raises; `can.CanTimeoutError` when an earlier frame is under way.
        """
        if self._socket is not None:
            _send_raw(self._socket, message)
            return True
        if self._calls is None:
            self._bus.send(message)
            return True
        if self._under_way is not None:
            raise can.CanTimeoutError("the frame before is still under way")
        future: Future[None] = Future()
        self._calls.put((message, future))
        if not finished(future, PATIENCE_S):
            self._under_way = future
            return False
        future.result()
        return True

    def late_error(self) -> Exception | None:
        """Return, once, what a frame that `send` left under way failed of: None if it did not, or not yet."""
        if self._under_way is None or not self._under_way.done():
            return None
        error, self._under_way = self._under_way.exception(), None
        return error if isinstance(error, Exception) else None

    def close(self, timeout_s: float) -> bool:
        """Send no more; return whether the frame that is under way, if any, is through within ``timeout_s``."""
        if self._calls is not None:
            self._calls.put(None)
        return self._under_way is None or finished(self._under_way, timeout_s)

    def _work(self, calls: SimpleQueue[tuple[can.Message, Future[None]] | None]) -> None:
        while (call := calls.get()) is not None:
            message, future = call
            settle(future, partial(self._bus.send, message, SEND_S))


def _send_raw(raw: socket.socket, message: can.Message) -> None:
    try:
        raw.send(_can_frame(message), socket.MSG_DONTWAIT)
    except OSError as error:
        raise can.CanOperationError(f"Failed to transmit: {error.strerror}", error.errno) from error


def _can_frame(message: can.Message) -> bytes:
    """Return what python-can's ``build_can_frame`` does, sooner for the usual kind of frame."""
    if message.is_fd or message.is_remote_frame or message.is_error_frame or len(message.data) > 8:
        return build_can_frame(message)
    can_id = message.arbitration_id | (EXTENDED_ID if message.is_extended_id else 0)
    return _CLASSIC.pack(can_id, len(message.data), message.dlc, message.data)
