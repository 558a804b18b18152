"""A virtual interface of SocketCAN."""

from __future__ import annotations

import errno
import socket
import struct
import subprocess
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .bus import HEARD, Bus
from .traffic import Traffic

FRAME = struct.Struct("=IB3x8s")
GONE = (errno.ENOBUFS, errno.ENETDOWN, errno.ENXIO, errno.ENODEV, errno.EAGAIN)


class Vcan(Bus):
    """See `Bus`."""

    def __init__(self, traffic: Traffic, folder: Path, torque_id: int, valid_mask: int, channel: str) -> None:
        super().__init__(traffic, folder, torque_id, valid_mask)
        self._channel = channel
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self._socket.bind((channel,))
        self._socket.setblocking(False)

    def connection(self) -> list[str]:
        return ["-i", "socketcan", "--channel", self._channel]

    def down(self) -> None:
        subprocess.run(["ip", "link", "set", self._channel, "down"], check=True)

    def up(self) -> None:
        subprocess.run(["ip", "link", "set", self._channel, "up"], check=True)

    def set_clock(self, step_us: int) -> None:
        time.clock_settime(time.CLOCK_REALTIME, time.time() + step_us / 1e6)

    def _give(self, records: NDArray[np.void]) -> int:
        send = self._socket.send
        rows = zip(records["can_id"].tolist(), records["length"].tolist(), records["data"], strict=True)
        for n, (can_id, length, data) in enumerate(rows):
            try:
                send(FRAME.pack(can_id, length, data.tobytes()))
            except OSError as error:
                if error.errno not in GONE:
                    raise
                return n
        return len(records)

    def _take(self) -> bytes:
        rows = []
        while True:
            try:
                can_id, length, data = FRAME.unpack(self._socket.recv(FRAME.size))
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno not in GONE:
                    raise
                break
            rows.append((round(1e6 * time.monotonic()), can_id, length, (0, 0, 0), tuple(data)))
        return np.array(rows, HEARD).tobytes()

    def _close(self) -> None:
        self._socket.close()


def clock_is_ours() -> bool:
    """Return whether this kernel, and so its clock, is of this run alone: user-mode Linux."""
    return "User Mode Linux" in Path("/proc/cpuinfo").read_text()
