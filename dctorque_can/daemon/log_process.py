"""The service's side of the log-writer process: hands over columns and never waits."""

from __future__ import annotations

import fcntl
import json
import os
import select
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dctorque_can.daemon.log_plan import LogPlan
from dctorque_can.daemon.log_protocol import Kind, document_message, json_message, message
from dctorque_can.errors import DctorqueError

PIPE_BYTES = 1 << 20
MAX_WAITING_BYTES = 32 << 20  # about five minutes of a full bus
RESTART_S = 1.0
LONGEST_RESTART_S = 60.0
OPEN_TIMEOUT_S = 30.0
SLOW_S = 5.0  # that long a log is waited for that is not needed
CLOSE_TIMEOUT_S = 30.0


@dataclass
class LogCounts:
    """What became of the frames that were handed over.

    Attributes:
        written: frames that are in a log and handed to the operating system.
        dropped: frames that are (or may be) in no log.
        restarts: times the process had to be started anew.
        paths: logs that were opened, in order.
        failures: why a log could not be written, in order.
    """

    written: int = 0
    dropped: int = 0
    restarts: int = 0
    paths: list[Path] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


class LogProcess:
    """Starts the process, feeds it, restarts it when it dies, and counts.

    Attributes:
        counts: what became of the frames.
        news: remarks for people since the last look (is an error, text); the reader empties it.
    """

    def __init__(self, plan: LogPlan, documents: Mapping[str, bytes]) -> None:
        self.counts = LogCounts()
        self.news: deque[tuple[bool, str]] = deque(maxlen=100)
        self._plan = plan
        self._documents = dict(documents)
        self._waiting: deque[tuple[memoryview, int]] = deque()
        self._waiting_bytes = 0
        self._handed = 0  # frames written to the pipe and not yet confirmed
        self._reports = b""
        self._restart_at_s = 0.0
        self._restart_s = RESTART_S
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def has_a_given_path(self) -> bool:
        """Whether somebody has named the file of the first log."""
        return self._plan.folder.first is not None

    def open(self, needed: bool = True, given_up: Callable[[], bool] = lambda: False) -> None:
        """Start the process and wait until the first log is open.

        Args:
            needed: a log that cannot be created, or not soon, is an error. Else it is told; `pump` goes on trying.
            given_up: says meanwhile that nobody waits any more.

        Raises:
            DctorqueError: the log is needed and cannot be created.
        """
        self._start()
        limit = time.monotonic() + (OPEN_TIMEOUT_S if needed else SLOW_S)
        while not self.counts.paths and not given_up():
            self.pump()
            late = time.monotonic() > limit
            if late and not needed:
                self.news.append((True, f"log: not open after {SLOW_S:g} s: the disk, or the computer, is slow"))
            if needed and (self.counts.failures or self._process is None or late):
                reason = self.counts.failures[0] if self.counts.failures else "the log writer did not start"
                self.close()
                raise DctorqueError(f"no log: {reason}")
            if self.counts.failures or self._process is None or late:
                return
            time.sleep(0.01)

    def hand_over(self, content: bytes, frames: int = 0) -> None:
        """Queue one message that holds ``frames`` frames; it is dropped, and counted, when too much waits."""
        if self._waiting_bytes + len(content) > MAX_WAITING_BYTES:
            self.counts.dropped += frames
        else:
            self._waiting.append((memoryview(content), frames))
            self._waiting_bytes += len(content)

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the pipe has not taken yet."""
        return self._waiting_bytes

    def rotate(self) -> None:
        """Close the log and begin the next one."""
        self.hand_over(message(Kind.ROTATE))

    def pump(self) -> None:
        """Move as much as the pipe takes, read reports, restart a dead process. Never waits."""
        if self._process is None:
            if time.monotonic() < self._restart_at_s:
                return
            self.counts.restarts += 1
            self._start()
            if self._process is None:
                return
        try:
            self._write()
        except BrokenPipeError:
            self._died()
            return
        self._read_reports()
        if self._process is not None and self._process.poll() is not None:
            self._died()

    def close(self) -> None:
        """Hand over what waits and wait until the log is closed."""
        process = self._process
        if process is None:
            self._drop_waiting()
            return
        limit = time.monotonic() + CLOSE_TIMEOUT_S
        while self._waiting and self._process is process and time.monotonic() < limit:
            assert process.stdin is not None
            select.select([], [process.stdin], [], 0.1)
            self.pump()
        if self._process is not process:
            self._drop_waiting()
            return
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # a writer that is dead already has its frames counted below
            process.stdin.close()
        try:
            process.wait(max(limit - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._read_reports(to_the_end=True)
        self._forget()
        self._drop_waiting()

    def _start(self) -> None:
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "dctorque_can.daemon.log_worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
            )
        except OSError as error:  # no memory, no process more
            self.news.append((True, f"the log writer cannot be started: {error.strerror}"))
            self._restart_later()
            return
        self._process = process
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(PermissionError):  # above the user's limit for pipes: the default size must do
            fcntl.fcntl(process.stdin, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(process.stdin.fileno(), False)
        os.set_blocking(process.stdout.fileno(), False)
        head = [json_message(Kind.SETUP, self._plan.as_json())]
        head += [document_message(name, content) for name, content in self._documents.items()]
        head.append(message(Kind.ROTATE))  # opens the first log
        for content in reversed(head):
            self._waiting.appendleft((memoryview(content), 0))
            self._waiting_bytes += len(content)

    def _write(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        pipe = self._process.stdin.fileno()
        while self._waiting:
            content, frames = self._waiting[0]
            try:
                taken = os.write(pipe, content)
            except BlockingIOError:
                return
            self._waiting_bytes -= taken
            if taken < len(content):
                self._waiting[0] = (content[taken:], frames)
                return
            self._waiting.popleft()
            self._handed += frames

    def _read_reports(self, to_the_end: bool = False) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        while True:
            try:
                chunk = os.read(self._process.stdout.fileno(), 1 << 16)
            except BlockingIOError:
                return
            *lines, self._reports = (self._reports + chunk).split(b"\n")
            for line in lines:
                self._note(json.loads(line))
            if not chunk or not to_the_end:
                return

    def _note(self, report: dict[str, str | int]) -> None:
        for what, value in report.items():
            if what == "written":
                self.counts.written += int(value)
                self._handed -= int(value)
            elif what == "lost":
                self.counts.dropped += int(value)
                self._handed -= int(value)
            elif what == "opened":
                self._restart_s = RESTART_S
                self.counts.paths.append(Path(str(value)))
                self.news.append((False, f"logging to {value}"))
            elif what == "failed":
                self.counts.failures.append(str(value))
                self.news.append((True, f"log: {value}"))
            elif what == "kept":
                self.news.append((True, f"log: {value}"))
            elif what == "deleted":
                self.news.append((False, f"deleted {value} to keep the quota"))

    def _died(self) -> None:
        assert self._process is not None
        self._process.wait()
        self._read_reports(to_the_end=True)
        code = self._process.returncode
        self.news.append((True, f"the log writer ended with code {code} and is started anew"))
        self._forget()
        if self._waiting:  # the front may have been cut in the middle
            content, frames = self._waiting.popleft()
            self._waiting_bytes -= len(content)
            self.counts.dropped += frames
        self._restart_later()

    def _restart_later(self) -> None:
        self._restart_at_s = time.monotonic() + self._restart_s
        self._restart_s = min(2 * self._restart_s, LONGEST_RESTART_S)

    def _forget(self) -> None:
        assert self._process is not None
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None and not pipe.closed:
                with suppress(BrokenPipeError):
                    pipe.close()
        self.counts.dropped += self._handed
        self._handed = 0
        self._reports = b""
        self._process = None

    def _drop_waiting(self) -> None:
        self.counts.dropped += sum(frames for _, frames in self._waiting)
        self._waiting.clear()
        self._waiting_bytes = 0
