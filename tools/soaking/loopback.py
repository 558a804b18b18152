"""A bus that needs no kernel with CAN: a socket, from which the service fetches by `soak_bus`."""

from __future__ import annotations

import mmap
import socket
import sys
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .bus import HEARD, Bus
from .interface.soak_bus import FETCHED_BYTES
from .traffic import RECORD, Traffic

ENTRY_POINTS = "[can.interface]\nsoak = soak_bus:SoakBus\n"
MOST_WAITING_BYTES = 24 << 20  # four minutes: as an adapter with very much memory


class Loopback(Bus):
    """See `Bus`. The frames that wait for a service that is stopped are kept, and so none is lost on the way."""

    def __init__(self, traffic: Traffic, folder: Path, torque_id: int, valid_mask: int) -> None:
        super().__init__(traffic, folder, torque_id, valid_mask)
        self._path = folder / "bus"
        self._fetched_path = folder / "bus.fetched"
        self._fetched_path.write_bytes(bytes(FETCHED_BYTES))
        with self._fetched_path.open("r+b") as file:
            self._fetched = memoryview(mmap.mmap(file.fileno(), FETCHED_BYTES)).cast("q")
        self.entry_points = folder / "python"
        info = self.entry_points / "soak_bus-0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: soak_bus\nVersion: 0\n")
        (info / "entry_points.txt").write_text(ENTRY_POINTS)
        self._lock = threading.Lock()
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None
        self._waiting = bytearray()
        self._torn = b""
        self.up()

    def connection(self) -> list[str]:
        return ["-i", "soak", "--channel", str(self._path)]

    @property
    def python_path(self) -> list[str]:
        """Folders in which the service finds `soak_bus`, and that it is an interface."""
        return [str(self.entry_points), str(Path(sys.modules[SOAK_BUS].__file__ or "").parent)]

    def fetched(self) -> int:
        """Return how many frames were fetched since `forget_fetched`."""
        return self._fetched[0]

    def fetched_times(self) -> list[int]:
        """Return the monotonic times in µs at which the latest were fetched, each at its number modulo `TIMES`."""
        return self._fetched[1:].tolist()

    def forget_fetched(self) -> None:
        self._fetched[0] = 0

    def down(self) -> None:
        with self._lock:
            if self._server is not None:
                self._server.close()
                self._path.unlink()
            self._server = None
            self._hang_up()

    def up(self) -> None:
        server = socket.socket(socket.AF_UNIX)
        server.bind(str(self._path))
        server.listen()
        server.setblocking(False)
        self._server = server

    def set_clock(self, step_us: int) -> None:
        self.traffic.disturbance.clock_us += step_us

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None
        self._waiting.clear()
        self._torn = b""

    def _give(self, records: NDArray[np.void]) -> int:
        with self._lock:
            self._accept()
            if self._client is None or len(self._waiting) > MOST_WAITING_BYTES:
                return 0
            self._waiting += records.tobytes()
            self._push()
            return len(records)

    def _accept(self) -> None:
        if self._server is None:
            return
        try:
            client, _ = self._server.accept()
        except BlockingIOError:
            return
        self._hang_up()
        client.setblocking(False)
        self._client = client

    def _push(self) -> None:
        assert self._client is not None
        while self._waiting:
            try:
                sent = self._client.send(bytes(self._waiting[: 1 << 16]))
            except BlockingIOError:
                return
            except OSError:  # it has closed; what it sent before is still to be read
                self._waiting.clear()
                return
            del self._waiting[:sent]

    def _take(self) -> bytes:
        with self._lock:
            if self._client is None:
                return b""
            self._push()
            try:
                content = self._client.recv(1 << 16)
            except BlockingIOError:
                return b""
            except OSError:
                content = b""
            if not content:
                self._hang_up()
                return b""
        content = self._torn + content
        whole = len(content) - len(content) % RECORD.itemsize
        self._torn = content[whole:]
        rows = np.frombuffer(content[:whole], RECORD).copy()
        rows["t_us"] = round(1e6 * time.monotonic())
        return rows.view(HEARD).tobytes()

    def _close(self) -> None:
        self.down()


SOAK_BUS = f"{__package__}.interface.soak_bus"
