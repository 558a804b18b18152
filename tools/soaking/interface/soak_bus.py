"""An interface of python-can, for the service's process: frames from a socket of `soaking.loopback`.

How many frames were fetched from it, and when the latest ones were, stands in a file that outlives the process.
"""

from __future__ import annotations

import mmap
import select
import socket
import struct
import time
from collections import deque
from pathlib import Path
from typing import Any

import can

RECORD = struct.Struct("<qIBBH8s")
"""Of a frame: time in µs, identifier, length, nothing, nothing, data."""
TIMES = 8192
"""So many of the latest frames have the time at which they were fetched."""
FETCHED_BYTES = 8 * (1 + TIMES)
"""A count, then times in monotonic µs, each at its frame's number modulo `TIMES`."""


class SoakBus(can.BusABC):
    """See above; ``channel`` is the path of the socket, and beside it ``.fetched`` the file."""

    def __init__(self, channel: str, can_filters: Any = None, **kwargs: Any) -> None:
        self._is_shutdown = True  # until the socket is there
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.connect(channel)
        except OSError:
            self._socket.close()
            raise
        with Path(f"{channel}.fetched").open("r+b") as file:
            self._file = mmap.mmap(file.fileno(), FETCHED_BYTES)
        self._fetched = memoryview(self._file).cast("q")
        self._waiting: deque[tuple[Any, ...]] = deque()
        self._torn = b""
        self.channel_info = f"soak:{Path(channel).name}"
        self._is_shutdown = False
        super().__init__(channel, can_filters=can_filters, **kwargs)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._waiting:
            self._read(timeout)
        if not self._waiting:
            return None, False
        t_us, can_id, length, _, _, data = self._waiting.popleft()
        count = self._fetched[0]
        self._fetched[1 + count % TIMES] = int(time.monotonic() * 1e6)
        self._fetched[0] = count + 1
        return can.Message(t_us / 1e6, can_id, is_extended_id=False, dlc=length, data=data[:length]), False

    def _read(self, timeout: float | None) -> None:
        if not select.select([self._socket], [], [], timeout)[0]:
            return
        content = self._socket.recv(1 << 18)
        if not content:
            raise can.CanOperationError("the other end has closed")
        content = self._torn + content
        whole = len(content) - len(content) % RECORD.size
        self._waiting.extend(RECORD.iter_unpack(content[:whole]))
        self._torn = content[whole:]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._socket.sendall(RECORD.pack(0, msg.arbitration_id, msg.dlc, 0, 0, bytes(msg.data).ljust(8, b"\0")))

    def fileno(self) -> int:
        return self._socket.fileno()

    def shutdown(self) -> None:
        if self._is_shutdown:
            return
        super().shutdown()
        self._socket.close()
        self._fetched.release()
        self._file.close()  # it has a descriptor of its own
