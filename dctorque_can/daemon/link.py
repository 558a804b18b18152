"""The connection to a CAN bus that comes back by itself."""

from __future__ import annotations

import errno
import os
import re
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import can

from dctorque_can.daemon.spin import raise_on_spin
from dctorque_can.errors import DctorqueError

FIRST_BACKOFF_S = 0.1
LONGEST_BACKOFF_S = 5.0
SILENCE_S = 2.0  # without a frame on a bus that had some: told
PROBE_S = 1.0
RECEIVE_BUFFER_BYTES = 4 << 20
BUS_OFF = 0x40  # in the identifier of a SocketCAN error frame (linux/can/error.h)
_FULL = {errno.ENOBUFS, errno.EAGAIN}


class BusError(DctorqueError):
    """A bus cannot be opened."""


@dataclass
class LinkCounts:
    """What happened on the wire.

    Attributes:
        received: messages of any kind.
        error_frames: error frames among them.
        bus_offs: error frames that reported bus-off.
        lost: times the bus went away (down, removed, closed by its server).
        silences: times a bus that had given frames gave none for `SILENCE_S`.
        reconnects: times it came back.
        sent: messages handed to the bus.
        send_failures: messages that the bus did not take.
    """

    received: int = 0
    error_frames: int = 0
    bus_offs: int = 0
    lost: int = 0
    silences: int = 0
    reconnects: int = 0
    sent: int = 0
    send_failures: int = 0


def open_bus(arguments: Mapping[str, Any]) -> can.BusABC:
    """Open a python-can bus.

    Args:
        arguments: of ``can.Bus``, with ``interface`` and ``channel``.

    Raises:
        BusError: there is no such interface or channel, or it is down, or its driver is missing.
    """
    interface, channel = arguments["interface"], arguments["channel"]
    if interface == "virtual":  # otherwise frames of a simulation would be stamped anew
        arguments = {"preserve_timestamps": True} | dict(arguments)
    try:
        if interface == "socketcand":
            _probe(arguments)
        bus = can.Bus(**arguments)
    except (can.CanError, OSError, ImportError, ValueError, TypeError) as error:
        raise BusError(
            f"{interface}:{channel} cannot be opened: {_reason(error)}{_hint(error, channel)}"
        ) from error
    try:
        _enlarge_buffer(bus)
        _refuse_down(bus)
    except OSError as error:
        bus.shutdown()
        raise BusError(f"{interface}:{channel} cannot be used: {_reason(error)}{_hint(error, channel)}") from error
    raise_on_spin(bus)
    return bus


def _probe(arguments: Mapping[str, Any]) -> None:
    """Raise soon when no server answers; python-can itself tries for 10 s without a pause, or waits for ever."""
    if "host" not in arguments or "port" not in arguments:
        return
    with socket.create_connection((arguments["host"], arguments["port"]), PROBE_S) as probe:
        if not probe.recv(256):  # socketcand speaks first
            raise ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))


def _enlarge_buffer(bus: can.BusABC) -> None:
    """Let the kernel keep more frames while the process does not run; as much as it allows."""
    raw = getattr(bus, "socket", None)
    if isinstance(raw, socket.socket):
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def _refuse_down(bus: can.BusABC) -> None:
    """Raise when the interface of a socket is down, which is told once and then taken for silence."""
    raw = getattr(bus, "socket", None)
    if isinstance(raw, socket.socket):
        pending = raw.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if pending:
            raise OSError(pending, os.strerror(pending))


def _reason(error: BaseException) -> str:
    text = str(getattr(error, "strerror", None) or error) or type(error).__name__
    return re.sub(r" \[Error Code -?\d+\]$", "", text)


def _hint(error: BaseException, channel: object) -> str:
    code = getattr(error, "errno", None) or getattr(error, "error_code", None)
    if code == errno.ENODEV:
        return f" (`ip link` lists the interfaces; is {channel} the right one?)"
    if code == errno.ENETDOWN:
        return f" (bring it up, e.g. `ip link set {channel} up type can bitrate 500000`)"
    if isinstance(error, can.CanInterfaceNotImplementedError):
        return f" (one of: {', '.join(sorted(can.VALID_INTERFACES))})"
    return ""


class BusLink:
    """Receives and sends on a bus; when the bus goes away it is opened anew, with growing pauses.

    Args:
        connect: opens the bus, e.g. a partial of `open_bus`.
        tell: is told what happens, in one line: ``tell(is_error, text)``.
    """

    def __init__(self, connect: Callable[[], can.BusABC], tell: Callable[[bool, str], None]) -> None:
        self.counts = LinkCounts()
        self._connect = connect
        self._tell = tell
        self._bus: can.BusABC | None = None
        self._backoff_s = FIRST_BACKOFF_S
        self._retry_at_s = 0.0
        self._heard_s: float | None = None  # None: this bus has not given anything yet
        self._silent = False

    @property
    def up(self) -> bool:
        """Whether the bus is open."""
        return self._bus is not None

    def open(self) -> None:
        """Open the bus for the first time.

        Raises:
            BusError: it cannot be opened.
        """
        self._bus = self._connect()

    def receive(self, timeout_s: float) -> can.Message | None:
        """Return the next message, or None after ``timeout_s`` or while the bus is away."""
        if self._bus is None and not self._reopen(timeout_s):
            return None
        assert self._bus is not None
        try:
            message = self._bus.recv(timeout_s)
        except (can.CanError, OSError, EOFError) as error:
            self._lose(error)
            return None
        if message is None:
            self._watch_silence()
            return None
        self._hear()
        self._backoff_s = FIRST_BACKOFF_S
        self.counts.received += 1
        if message.is_error_frame:
            self.counts.error_frames += 1
            if message.arbitration_id & BUS_OFF:
                self.counts.bus_offs += 1
                self._tell(True, "bus-off: the controller has left the bus")
        return message

    def receive_some(self, timeout_s: float, most: int) -> list[can.Message]:
        """Wait up to ``timeout_s`` for a message; return it with those that wait behind it, ``most`` in all."""
        messages = []
        message = self.receive(timeout_s)
        while message is not None:
            messages.append(message)
            message = self.receive(0.0) if len(messages) < most and self._bus is not None else None
        return messages

    def send(self, message: can.Message) -> bool:
        """Send without waiting; false when the bus did not take it."""
        if self._bus is None and not self._reopen(0.0):
            self.counts.send_failures += 1
            return False
        assert self._bus is not None
        try:
            self._bus.send(message)
        except (can.CanError, OSError) as error:
            self.counts.send_failures += 1
            code = getattr(error, "error_code", None)
            if code is not None and code not in _FULL:
                self._lose(error)
            return False
        self.counts.sent += 1
        return True

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _hear(self) -> None:
        now_s = time.monotonic()
        if self._silent and self._heard_s is not None:
            self._silent = False
            self._tell(False, f"frames again after {now_s - self._heard_s:.1f} s on {self._name()}")
        self._heard_s = now_s

    def _watch_silence(self) -> None:
        """Tell a silence once. The bus stays open: a car that is switched off is silent too."""
        if self._silent or self._heard_s is None or time.monotonic() - self._heard_s < SILENCE_S:
            return
        self._silent = True
        self.counts.silences += 1
        self._tell(False, f"no frame for {SILENCE_S:g} s on {self._name()}")

    def _name(self) -> str:
        assert self._bus is not None
        return self._bus.channel_info

    def _lose(self, error: BaseException) -> None:
        self.counts.lost += 1
        if self._backoff_s == FIRST_BACKOFF_S:  # tell it once, not at every try
            self._tell(True, f"the bus is gone: {_reason(error)}; trying to open it again")
        self.close()
        self._retry_at_s = time.monotonic() + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, LONGEST_BACKOFF_S)

    def _reopen(self, timeout_s: float) -> bool:
        wait_s = self._retry_at_s - time.monotonic()
        if wait_s > 0:
            time.sleep(min(wait_s, timeout_s))
            return False
        try:
            self._bus = self._connect()
        except BusError:
            self._retry_at_s = time.monotonic() + self._backoff_s
            self._backoff_s = min(2 * self._backoff_s, LONGEST_BACKOFF_S)
            return False
        self.counts.reconnects += 1
        if self._heard_s is not None:
            self._heard_s, self._silent = time.monotonic(), False
        self._tell(False, "the bus is open again")
        return True
