"""The service's side of the status process: hands over snapshots and never waits."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dctorque_can.daemon.child import close_pipes, start
from dctorque_can.daemon.status.listener import SOCKET_NAME
from dctorque_can.errors import DctorqueError

if TYPE_CHECKING:
    from dctorque_can.config.edges import StatusSection

OPEN_TIMEOUT_S = 30.0
CLOSE_S = 1.0
RESTART_S = 1.0
LONGEST_RESTART_S = 60.0


@dataclass(frozen=True)
class StatusPlaces:
    """Where the status can be read.

    Attributes:
        socket: path of a Unix socket, or None.
        metrics: loopback address and port for Prometheus, or None.
    """

    socket: Path | None = None
    metrics: tuple[str, int] | None = None

    @property
    def names(self) -> set[str]:
        """Return the places for people."""
        socket = [] if self.socket is None else [str(self.socket)]
        return {*socket, *([] if self.metrics is None else ["{}:{}".format(*self.metrics)])}


def places_for(section: StatusSection, socket: Path | None = None) -> StatusPlaces | None:
    """Return where the status can be read; None: nowhere.

    Args:
        section: of the vehicle file.
        socket: path from the command line. Without one of both it is in the folder that systemd has made.
    """
    made = os.environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    if socket is None and section.socket is not None:
        socket = Path(section.socket)
    if socket is None and made:
        socket = Path(made) / SOCKET_NAME
    places = StatusPlaces(socket, section.metrics_address())
    return places if places.names else None


class StatusProcess:
    """Starts the process, hands over snapshots, starts it anew when it dies.

    Args:
        places: at least one.
        tell: is told what goes wrong: ``tell(is_error, text)``.
    """

    def __init__(self, places: StatusPlaces, tell: Callable[[bool, str], None]) -> None:
        self._places = places
        self._tell = tell
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""  # of what the pipe has not taken yet
        self._reports = b""
        self._open: set[str] = set()
        self._failed: dict[str, str] = {}
        self._restart_at_s = 0.0
        self._restart_s = RESTART_S

    def begin(self) -> None:
        """Start the process; what becomes of it says `wait_until_open` or `publish`."""
        self._start()

    def wait_until_open(self, given_up: Callable[[], bool]) -> None:
        """Wait until all places can be reached.

        Raises:
            DctorqueError: one cannot be had, or the process does not answer.
        """
        limit = time.monotonic() + OPEN_TIMEOUT_S
        while self._open != self._places.names and not given_up():
            self._read_reports()
            late = self._process is None or self._process.poll() is not None or time.monotonic() > limit
            if self._failed or late:
                reasons = [_cannot(*item) for item in self._failed.items()] or [
                    "status: its process did not start"
                ]
                self.close()
                raise DctorqueError("\n".join(reasons))
            time.sleep(0.01)

    def publish(self, snapshot: dict[str, Any]) -> None:
        """Hand over a snapshot, unless the process has not taken the one before."""
        if self._process is None:
            if time.monotonic() >= self._restart_at_s:
                self._start()
            return
        for name, reason in self._read_reports():
            self._tell(True, f"{_cannot(name, reason)}; it is tried again and again")
        if self._process.poll() is not None:
            self._died()
            return
        if not self._rest:
            self._rest = json.dumps(snapshot, allow_nan=False).encode() + b"\n"
        self._write()

    def close(self) -> None:
        """End the process; it removes its socket."""
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._forget()

    def _start(self) -> None:
        try:
            self._process = start("dctorque_can.daemon.status.worker")
        except OSError as error:  # no memory, no process more
            self._tell(True, f"the status process cannot be started: {error.strerror}")
            self._restart_later()
            return
        self._open.clear()
        socket = None if self._places.socket is None else str(self._places.socket)
        self._rest = json.dumps({"socket": socket, "metrics": self._places.metrics}).encode() + b"\n"
        self._write()

    def _write(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        with suppress(BlockingIOError, BrokenPipeError):  # one that is dead is found by the next `publish`
            self._rest = self._rest[os.write(self._process.stdin.fileno(), self._rest) :]

    def _read_reports(self) -> list[tuple[str, str]]:
        """Take note of what the process tells, and return which places it cannot have for which new reason."""
        assert self._process is not None
        assert self._process.stdout is not None
        with suppress(BlockingIOError):
            while chunk := os.read(self._process.stdout.fileno(), 1 << 16):
                self._reports += chunk
        *lines, self._reports = self._reports.split(b"\n")
        new = []
        for report in map(json.loads, lines):
            if "listening" in report:
                self._open.add(report["listening"])
                self._failed.pop(report["listening"], None)
                self._restart_s = RESTART_S
            elif self._failed.get(report["failed"]) != report["reason"]:
                self._failed[report["failed"]] = report["reason"]
                new.append((report["failed"], report["reason"]))
        return new

    def _died(self) -> None:
        assert self._process is not None
        code = self._process.wait()
        if self._restart_s == RESTART_S:  # tell it once, not at every try
            self._tell(True, f"the status process ended with code {code} and is started anew")
        self._forget()
        self._restart_later()

    def _restart_later(self) -> None:
        self._restart_at_s = time.monotonic() + self._restart_s
        self._restart_s = min(2 * self._restart_s, LONGEST_RESTART_S)

    def _forget(self) -> None:
        assert self._process is not None
        close_pipes(self._process)
        self._process, self._rest, self._reports = None, b"", b""


def _cannot(name: str, reason: str) -> str:
    return f"status: {name}: {reason}"
