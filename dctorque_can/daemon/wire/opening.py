"""Opens a bus of python-can such that the service can live with it."""

from __future__ import annotations

import errno
import os
import re
import socket
from collections.abc import Mapping
from typing import Any

import can
from can.interfaces import BACKENDS

from dctorque_can.daemon.wire.listening import forbid_sending, listening
from dctorque_can.daemon.wire.spin import raise_on_spin
from dctorque_can.daemon.wire.steady_recv import receive_by_steady_clock
from dctorque_can.errors import DctorqueError

PROBE_S = 1.0
RECEIVE_BUFFER_BYTES = 4 << 20
STURDY = {
    "slcan": ("dctorque_can.daemon.wire.slcan", "SturdySlcanBus"),
    "socketcand": ("dctorque_can.daemon.wire.socketcand", "SturdySocketcandBus"),
}
"""Interfaces of ours instead of python-can's; imported when they are wanted, since not everybody has pyserial."""


class BusError(DctorqueError):
    """A bus cannot be opened."""


class DamagedLineError(can.CanError):
    """An interface received what is no frame; the next one may be whole."""


def open_bus(arguments: Mapping[str, Any], listen_only: bool = False) -> can.BusABC:
    """Open a python-can bus.

    Args:
        arguments: of ``can.Bus``, with ``interface`` and ``channel``.
        listen_only: nothing can be sent on it, and the hardware is silent where python-can can ask it to be.

    Raises:
        BusError: there is no such interface or channel, or it is down, or its driver is missing.
    """
    interface, channel = arguments["interface"], arguments["channel"]
    if interface == "virtual":  # otherwise frames of a simulation would be stamped anew
        arguments = {"preserve_timestamps": True} | dict(arguments)
    if listen_only:
        arguments = listening(arguments)
    BACKENDS.update(STURDY)
    try:
        if interface == "socketcand":
            _probe(arguments)
        if interface == "socketcan" and str(channel) not in {name for _, name in socket.if_nameindex()}:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))  # python-can would leave its socket open
        bus = can.Bus(**arguments)
    except Exception as error:  # an interface may raise whatever its driver raises
        raise BusError(
            f"{interface}:{channel} cannot be opened: {reason(error)}{_hint(error, channel)}"
        ) from error
    try:
        _enlarge_buffer(bus)
        _refuse_down(bus)
    except OSError as error:
        bus.shutdown()
        raise BusError(f"{interface}:{channel} cannot be used: {reason(error)}{_hint(error, channel)}") from error
    if listen_only:
        forbid_sending(bus)
    raise_on_spin(bus)
    receive_by_steady_clock(bus)
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


def close_bus(bus: can.BusABC) -> None:
    """Close a bus, for good.

    Raises:
        Exception: whatever the interface raises; python-can then does not try it again when it forgets the bus.
    """
    try:
        bus.shutdown()
    except Exception:
        if isinstance(raw := getattr(bus, "socket", None), socket.socket):
            raw.close()
        raise
    finally:
        bus._is_shutdown = True


def reason(error: BaseException) -> str:
    """Return what an error says, in words for people."""
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
