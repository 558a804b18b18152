"""The service as a process, started again as systemd would, and what it needs of the computer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .bus import Bus
from .interface.soak_bus import TIMES
from .loopback import Loopback

RESTART_S = 2.0  # RestartSec of tools/dctorque@.service
HANG_S = 600.0


@dataclass
class Life:
    """One process of the service.

    Attributes:
        number: from 0.
        pid: of the process.
        first: index of the first frame that passed on the bus when it was started.
        began_s: monotonic times: of its start, …
        ready_s: … of its readiness, 0 before; and of its end.
        ended_s: see above.
        ending: "SIGTERM", "SIGKILL", or "" for one that ended by itself.
        killed: "the service" or "everything" of a SIGKILL.
        code: exit code.
        told: lines on standard error, with the time of each.
        summary: of an orderly end.
        fetched: frames that it fetched from the bus, where that is known, …
        fetched_times: … and when the latest, see `Loopback.fetched_times`.
    """

    number: int
    pid: int
    first: int
    began_s: float
    ready_s: float = 0.0
    ended_s: float = 0.0
    ending: str = ""
    killed: str = ""
    code: int | None = None
    told: list[tuple[float, str]] = field(default_factory=list)
    summary: dict[str, Any] | None = None
    fetched: int | None = None
    fetched_times: list[int] = field(default_factory=list)

    def fetched_s(self, number: int) -> float | None:
        """Return the monotonic time at which a frame was fetched; None if nobody knows."""
        if self.fetched is None or not max(self.fetched - TIMES, 0) <= number < self.fetched:
            return None
        return self.fetched_times[number % TIMES] / 1e6

    def was_told(self, *texts: str) -> list[str]:
        return [line for _, line in self.told if any(text in line for text in texts)]


@dataclass(frozen=True)
class Sample:
    """What a process needs at one time: kB of memory of its own, as files come and go, and open files."""

    at_s: float
    life: int
    pid: int
    role: str
    own_kb: int
    files: int


class ServiceProcess:
    """Starts ``dctorque run``, and ends it in several ways.

    Args:
        bus: that it is on.
        arguments: of the command.
        folder: for what it says.
    """

    def __init__(self, bus: Bus, arguments: list[str], folder: Path) -> None:
        self.lives: list[Life] = []
        self.samples: list[Sample] = []
        self._bus = bus
        self._command = [sys.executable, "-m", "dctorque_can.cli", "run", *arguments, *bus.connection()]
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None
        self._reader: threading.Thread | None = None

    @property
    def life(self) -> Life:
        return self.lives[-1]

    def start(self) -> None:
        """Start it, and wait until it is ready."""
        environment = dict(os.environ)
        if isinstance(self._bus, Loopback):
            self._bus.forget_fetched()
            more = environment.get("PYTHONPATH")
            environment["PYTHONPATH"] = os.pathsep.join([*self._bus.python_path, *([more] if more else [])])
        number = len(self.lives)
        with (self._folder / f"summary_{number}.json").open("w") as out:
            first, began_s = self._bus.passed, time.monotonic()
            self._process = subprocess.Popen(
                self._command, stdout=out, stderr=subprocess.PIPE, text=True, env=environment, cwd=self._folder
            )
        life = Life(number, self._process.pid, first, began_s)
        self.lives.append(life)
        self._reader = threading.Thread(target=self._read, args=(life, self._process), name="stderr")
        self._reader.start()
        limit_s = began_s + HANG_S
        while not life.ready_s and self._process.poll() is None and time.monotonic() < limit_s:
            time.sleep(0.01)

    def alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def writers(self) -> list[int]:
        """Return the log processes."""
        return _children(self.life.pid, "daemon.log.worker")

    def terminate(self) -> None:
        """End it in order."""
        assert self._process is not None
        self.life.ending = "SIGTERM"
        self._process.send_signal(signal.SIGTERM)
        self.settle()

    def kill(self, with_writers: bool) -> None:
        """End it without warning."""
        assert self._process is not None
        self.life.ending = "SIGKILL"
        self.life.killed = "everything" if with_writers else "the service"
        writers = self.writers() if with_writers else []
        os.kill(self.life.pid, signal.SIGKILL)
        self.life.ended_s = time.monotonic()
        for pid in writers:
            _signal(pid, signal.SIGKILL)
        self.settle()

    def settle(self) -> None:
        """Wait for the end, and note what is left of it."""
        assert self._process is not None
        assert self._reader is not None
        life = self.life
        life.code = self._process.wait(HANG_S)
        life.ended_s = life.ended_s or time.monotonic()
        if isinstance(self._bus, Loopback):
            life.fetched, life.fetched_times = self._bus.fetched(), self._bus.fetched_times()
        self._reader.join(HANG_S)  # a log process that goes on for a moment holds the pipe
        content = (self._folder / f"summary_{life.number}.json").read_text()
        life.summary = json.loads(content) if content.strip() and life.ending != "SIGKILL" else None

    def sample(self) -> None:
        """Note memory and open files of its processes."""
        named = [("service", self.life.pid), *(("log process", pid) for pid in self.writers())]
        for role, pid in named:
            try:
                words = Path(f"/proc/{pid}/status").read_text().split("RssAnon:")[1].split()
                files = len(os.listdir(f"/proc/{pid}/fd"))  # noqa: PTH208  no path of these is wanted
            except (OSError, IndexError):  # it has just ended
                continue
            self.samples.append(Sample(time.monotonic(), self.life.number, pid, role, int(words[0]), files))

    def _read(self, life: Life, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        with (self._folder / f"told_{life.number}.txt").open("w") as copy:
            for line in process.stderr:
                copy.write(line)
                copy.flush()
                life.told.append((time.monotonic(), line.rstrip("\n")))
                if ": estimating on " in line:
                    life.ready_s = time.monotonic()
        process.stderr.close()


def _children(parent: int, word: str) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if (
                int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == parent
                and word in (entry / "cmdline").read_text()
            ):
                found.append(int(entry.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


def _signal(pid: int, number: int) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:  # it was faster
        return
