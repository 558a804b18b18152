"""Receives from a SocketCAN bus of python-can, all that waits with one call of the kernel."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import select
import socket
import sys
from dataclasses import replace

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus

from dctorque_can.bus.kernel_frames import (
    CAN_FD_BYTES,
    CONTROL,
    CONTROL_BYTES,
    CONTROL_LENGTH,
    HEADER_WORDS,
    NO_FRAME,
    NO_TIME,
    SO_RXQ_OVFL,
    VECTOR,
    VECTOR_WORDS,
    VECTORS,
    read_kernel_frames,
)
from dctorque_can.pipeline.frames import Frames

MOST = 256  # frames at once

_libc = ctypes.CDLL(None, use_errno=True)
_WORDS_ARE_64_BITS = sys.byteorder == "little" and ctypes.sizeof(ctypes.c_size_t) == 8
_KNOWN_KERNEL = _WORDS_ARE_64_BITS and hasattr(_libc, "recvmmsg")
if _KNOWN_KERNEL:
    _recvmmsg = _libc.recvmmsg
    _recvmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)
    _recvmmsg.restype = ctypes.c_int


class SocketcanReceiver:
    """Receives frames as columns, without an object of Python for each.

    The time of a frame is the kernel's, as python-can has asked for it (``SO_TIMESTAMPNS``).

    Args:
        bus: opened by python-can, which sends on it and closes it; nobody else may receive from it.

    Attributes:
        dropped: frames that the kernel has dropped since they were not fetched in time (``SO_RXQ_OVFL``).
        times: see `reception.Receiver`.
    """

    times = "kernel"

    def __init__(self, bus: SocketcanBus) -> None:
        self.dropped = 0
        self._socket = bus.socket
        self._socket.setsockopt(socket.SOL_SOCKET, SO_RXQ_OVFL, 1)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._memory = KernelMemory()

    @staticmethod
    def fits(bus: can.BusABC) -> bool:
        """Return whether a bus is one of SocketCAN on a known kernel, whose filters the kernel applies."""
        return _KNOWN_KERNEL and isinstance(bus, SocketcanBus) and (bus.filters is None or bool(bus._is_filtered))

    def receive(self, timeout_s: float) -> Frames:
        """Return what waits, `MOST` frames at most; if nothing does, wait for it up to ``timeout_s``.

        The columns are only valid until the next call.

        Raises:
            can.CanOperationError: the interface went down or away.
        """
        n = self._fetch()
        if n == 0 and timeout_s > 0:
            self._poll.poll(math.ceil(1000.0 * timeout_s))  # its clock is nobody's to set
            n = self._fetch()
        dropped, frames = self._memory.frames(n, self.dropped)
        if dropped < 0:
            what = {NO_FRAME: "what is no CAN frame", NO_TIME: "a frame without time stamp"}[dropped]
            raise can.CanOperationError(f"Error receiving: the socket gave {what}")
        self.dropped = dropped
        return frames

    def _fetch(self) -> int:
        n = _recvmmsg(self._socket.fileno(), self._memory.address, MOST, socket.MSG_DONTWAIT, None)
        if n >= 0:
            return int(n)
        code = ctypes.get_errno()
        if code in (errno.EAGAIN, errno.EINTR):
            return 0
        raise can.CanOperationError(f"Error receiving: {os.strerror(code)}", code)


class KernelMemory:
    """Memory into which ``recvmmsg`` writes, and the columns that come out of it.

    Attributes:
        headers: struct mmsghdr ``[MOST, HEADER_WORDS]``.
        raw: payloads of the messages ``[MOST, CAN_FD_BYTES]``.
        control: control messages ``[MOST, CONTROL_BYTES / 8]``.
        address: of the headers.
    """

    def __init__(self) -> None:
        self.headers = np.zeros((MOST, HEADER_WORDS), np.int64)
        self.raw = np.zeros((MOST, CAN_FD_BYTES), np.uint8)
        self.control = np.zeros((MOST, CONTROL_BYTES // 8), np.int64)
        self._vectors = np.zeros((MOST, VECTOR_WORDS), np.int64)
        rows = np.arange(MOST)
        self._vectors[:, 0] = self.raw.ctypes.data + CAN_FD_BYTES * rows
        self._vectors[:, 1] = CAN_FD_BYTES
        self.headers[:, VECTOR] = self._vectors.ctypes.data + 8 * VECTOR_WORDS * rows
        self.headers[:, VECTORS] = 1
        self.headers[:, CONTROL] = self.control.ctypes.data + CONTROL_BYTES * rows
        self.headers[:, CONTROL_LENGTH] = CONTROL_BYTES
        self.address = self.headers.ctypes.data
        self._narrow = Frames.empty(MOST, 8)
        self._wide = replace(self._narrow, data=np.zeros((MOST, 64), np.uint8))
        self._arguments = (
            *(self.headers, self.raw, self.control),
            *(self._narrow.t_us, self._narrow.can_id, self._narrow.length, self._narrow.flags),
            *(self._narrow.data, self._wide.data),
        )
        self._views: dict[tuple[int, bool], Frames] = {}

    def frames(self, n: int, dropped: int) -> tuple[int, Frames]:
        """Return what `read_kernel_frames` says of the first ``n`` messages, and their columns."""
        if n > 0:
            dropped = read_kernel_frames(n, dropped, *self._arguments)
        is_wide = n > 0 and max(self._narrow.length[:n].tobytes()) > 8
        view = self._views.get((n, is_wide))
        if view is None:
            view = self._views[n, is_wide] = (self._wide if is_wide else self._narrow)[:n]
        return dropped, view


def warm_up() -> None:
    """Compile what receiving needs."""
    memory = KernelMemory()
    read_kernel_frames(0, 0, *memory._arguments)
