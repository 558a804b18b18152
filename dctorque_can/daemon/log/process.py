"""The service's side of the log-writer process: hands over columns and never waits.

What was handed over is kept until the process has confirmed that the operating system has it. Each flush and each
rotation is such a point, with the state of the estimator as it was there. If the process dies, the next one begins
a log with the last confirmed state and gets everything after it once more: nothing is missing, and each log alone
replays to the same bits. Where something had to be dropped, a new log begins too.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dctorque_can.daemon.child import close_pipes, start
from dctorque_can.daemon.log.counts import LogCounts, Message, State, no_state
from dctorque_can.daemon.log.plan import LogPlan
from dctorque_can.daemon.log.protocol import (
    Kind,
    document_message,
    end_message,
    flush_message,
    json_message,
    rotate_message,
)
from dctorque_can.daemon.log.recovery import LogRecovery
from dctorque_can.errors import DctorqueError

PIPE_BYTES = 1 << 20
MAX_WAITING_BYTES = 32 << 20  # about five minutes of a full bus
RESTART_S = 1.0
LONGEST_RESTART_S = 60.0
RETRY_S = 10.0  # after a log that could not be written; each time twice as long
LONGEST_RETRY_S = 300.0
OPEN_TIMEOUT_S = 30.0
SLOW_S = 5.0  # that long a log is waited for that is not needed
CLOSE_TIMEOUT_S = 30.0
END_S = 0.5  # that long a process is waited for that has closed the log
_MOST_DEATHS = 5  # of a log that was begun, without a confirmation: it may be what it is handed that kills it
_MOST_POINTS = 20  # that are not confirmed: each has a copy of the state


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
        self._waiting: deque[Message] = deque()
        self._waiting_bytes = 0
        self._begun = 0  # bytes of the front that the pipe has taken
        self._unconfirmed: deque[Message] = deque()  # that the pipe has taken
        self._base: State = no_state  # at the last point that was confirmed
        self._last_number = 0
        self._points: set[int] = set()  # that are not confirmed
        self._rotation = 0  # number of the one that is under way
        self._opening = 0  # … of the one with which the process began
        self._gap = False  # what comes is dropped until the next rotation
        self._retry_s = 0.0
        self._pause_s = RETRY_S
        self._failing = ""  # why there is no log
        self._size = 0  # of the log, at the last point that was confirmed
        self._opened_s: float | None = None  # None: there is no log
        self._reports = b""
        self._restart_at_s = 0.0
        self._restart_s = RESTART_S
        self._deaths = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._recovery = LogRecovery(plan.folder)

    @property
    def given_path(self) -> Path | None:
        """The file of the first log, if somebody has named it."""
        return self._plan.folder.first

    def open(self, needed: bool = True, given_up: Callable[[], bool] = lambda: False) -> None:
        """Start the process, wait until the first log is open, and begin to close those that are torn.

        Args:
            needed: a log that cannot be created, or not soon, is an error. Else it is told, and `wants_new`.
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
                break
            time.sleep(0.01)
        self._recovery.begin(self.counts.paths)

    def hand_over(self, content: bytes, frames: int = 0) -> None:
        """Queue one message that holds ``frames`` frames; it is dropped, and counted, when too much waits."""
        if self._waiting_bytes + len(content) > MAX_WAITING_BYTES and not self._gap:
            self._gap = True
            self.news.append((True, "log: the disk is too slow; frames are missing until the next log begins"))
        if self._gap:
            self.counts.dropped += frames
        else:
            self._queue(Message(content, frames))

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the pipe has not taken yet."""
        return self._waiting_bytes

    def wants_new(self, now_s: float) -> bool:
        """Return whether the log is as long or as old as it may be, or one is missing: then `rotate`."""
        if self._rotation:
            return False
        if self._gap:
            return now_s >= self._retry_s and self._waiting_bytes < MAX_WAITING_BYTES / 2
        if self._opened_s is None:
            return False
        plan = self._plan
        return 0 < plan.rotate_mb * 1e6 <= self._size or 0 < plan.rotate_s <= now_s - self._opened_s

    def rotate(self, state: State = no_state) -> None:
        """Close the log and begin the next one, with the state after all that was handed over until now."""
        self._gap = False
        self._rotation = self._point(lambda number: rotate_message(number, state()), state)

    def change(self, plan: LogPlan, documents: Mapping[str, bytes]) -> None:
        """Write the logs that begin from now on as another plan says; to be followed by `rotate`."""
        self._plan, self._documents = plan, dict(documents)
        if self._process is not None:
            for message in self._head():
                self._queue(message)

    def flush(self, state: State = no_state, received_s: float | None = None) -> bool:
        """Have all that was handed over written; return whether that was asked for: not while too much waits.

        Args:
            state: after that.
            received_s: monotonic time at which the oldest of it was received; None: now.
        """
        if self._gap or len(self._points) >= _MOST_POINTS:
            return False
        since_s = time.monotonic() if received_s is None else received_s
        self._point(lambda number: flush_message(number, since_s), state)
        return True

    def _point(self, content: Callable[[int], bytes], state: State) -> int:
        self._last_number += 1
        self._points.add(self._last_number)
        self._queue(Message(content(self._last_number), 0, self._last_number, state))
        return self._last_number

    def _queue(self, message: Message) -> None:
        self._waiting.append(message)
        self._waiting_bytes += len(message.content)

    def pump(self) -> None:
        """Move as much as the pipe takes, read reports, restart a dead process. Never waits."""
        self._look_at_recovery()
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
        limit = time.monotonic() + CLOSE_TIMEOUT_S
        self._point(end_message, no_state)
        if self._process is None and (self._unconfirmed or len(self._waiting) > 1):
            self.counts.restarts += 1  # it has died: there is time for another one
            self._start()
        if self._process is not None:
            self._finish(self._process, limit)
        self._drop_everything()
        while self._recovery.cuts and time.monotonic() < limit:
            self._look_at_recovery()
            time.sleep(0.01)
        self._look_at_recovery()
        self._recovery.end()

    def _finish(self, process: subprocess.Popen[bytes], limit: float) -> None:
        """Wait until the log is closed; the process itself may take longer, to wait for the disk or to end."""
        assert process.stdin is not None
        assert process.stdout is not None
        end = self._last_number
        with suppress(BrokenPipeError):  # a writer that is dead already has its frames counted below
            while end in self._points and process.poll() is None and time.monotonic() < limit:
                select.select([process.stdout], [process.stdin] if self._waiting else [], [], 0.1)
                self._write()
                self._read_reports()
        self._read_reports(to_the_end=process.poll() is not None)
        if end not in self._points:
            self._let_end(process)
        elif process.poll() is not None:
            self._died()
        else:
            process.kill()
            process.wait()
            self._read_reports(to_the_end=True)
            self._forget()

    def _let_end(self, process: subprocess.Popen[bytes]) -> None:
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.news.append((True, "the log is closed, but the disk has not taken all of it yet"))
        self._forget()

    def _start(self) -> None:
        try:
            self._process = start("dctorque_can.daemon.log.worker", PIPE_BYTES)
        except OSError as error:  # no memory, no process more
            self.news.append((True, f"the log writer cannot be started: {error.strerror}"))
            self._restart_later()
            return
        messages = self._head()
        if not self._gap:  # else the next log begins with a state of its own
            self._last_number += 1
            self._rotation = self._opening = self._last_number
            opening = rotate_message(self._last_number, self._base())
            messages.append(Message(opening, 0, self._last_number, self._base, again=False))
        messages += [message for message in (*self._unconfirmed, *self._waiting) if message.again]
        self._waiting = deque(messages)
        self._waiting_bytes = sum(len(message.content) for message in self._waiting)
        self._unconfirmed.clear()
        self._begun = 0

    def _head(self) -> list[Message]:
        """Return what a process must know before it begins a log."""
        head = [json_message(Kind.SETUP, self._plan.as_json() | {"opened": len(self.counts.paths)})]
        head += [document_message(name, content) for name, content in self._documents.items()]
        return [Message(content, again=False) for content in head]

    def _write(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        pipe = self._process.stdin.fileno()
        while self._waiting:
            message = self._waiting[0]
            try:
                taken = os.write(pipe, memoryview(message.content)[self._begun :])
            except BlockingIOError:
                return
            self._waiting_bytes -= taken
            self._begun += taken
            if self._begun < len(message.content):
                return
            self._begun = 0
            self._unconfirmed.append(self._waiting.popleft())

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

    def _note(self, report: dict[str, Any]) -> None:
        if "opened" in report:
            self.counts.paths.append(Path(report["opened"]))
            self.counts.sizes.append(0)
            self._opened_s, self._size, self._failing = time.monotonic(), 0, ""
            self._restart_s = RESTART_S
            self.news.append((False, f"logging to {report['opened']}"))
        if "closed" in report:
            self.counts.sizes[-1] = int(report["size"])
        if "failed" in report:
            self._failed(report["failed"])
        if "warning" in report:
            self.news.append((True, f"log: {report['warning']}"))
        if "deleted" in report:
            self.counts.deleted += 1
            self.news.append((False, f"deleted {report['deleted']} to keep {report['to_keep']}"))
        if "point" in report:
            self._confirmed(report)

    def _confirmed(self, report: Mapping[str, Any]) -> None:
        """Let go what was handed over up to a point."""
        number, lost = int(report["point"]), int(report["lost"])
        while self._unconfirmed:
            message = self._unconfirmed.popleft()
            self.counts.written += message.frames
            self._points.discard(message.number)
            if message.number == number:
                self._base = message.state
                break
        self.counts.written -= lost
        self.counts.dropped += lost
        self._size = int(report["size"])
        if self._opened_s is not None and self._size:  # 0: it is closed
            self.counts.sizes[-1] = self._size
        if number != self._opening:  # more than a log that can be begun
            self._deaths = 0
        if number == self._rotation:
            self._rotation = 0
        elif self._opened_s is not None:  # and one that can be written
            self._pause_s = RETRY_S
        age_s = report.get("age_s")
        if age_s is not None:
            self.counts.slowest_flush_ms = max(self.counts.slowest_flush_ms, round(1000 * age_s, 1))
            self.counts.late_flushes += age_s > self._plan.flush_s

    def _failed(self, reason: str) -> None:
        self._opened_s = None
        self._gap = True
        self._retry_s = time.monotonic() + self._pause_s
        if self._failing != reason:
            self._failing = reason
            self.counts.failures.append(reason)
            self.news.append((True, f"log: {reason}; trying a new log in {self._pause_s:g} s, then less often"))
        self._pause_s = min(2 * self._pause_s, LONGEST_RETRY_S)

    def _died(self) -> None:
        assert self._process is not None
        self._process.wait()
        self._read_reports(to_the_end=True)
        code = self._process.returncode
        self._forget()
        if self._opened_s is not None:
            self._deaths += 1
        frames = sum(message.frames for message in (*self._unconfirmed, *self._waiting))
        if self._deaths >= _MOST_DEATHS:
            self._drop_everything()
            self._base, self._gap = no_state, True
            left = f"{frames} frames are missing in the log"
        else:
            left = f"the {frames} frames that it had not confirmed go to the next one"
        self.news.append((True, f"the log writer ended with code {code} and is started anew; {left}"))
        if self._opened_s is not None and self._size:
            self._recovery.cut(self.counts.paths[-1], self._size)
        self._opened_s = None
        self._restart_later()

    def _restart_later(self) -> None:
        self._restart_at_s = time.monotonic() + self._restart_s
        self._restart_s = min(2 * self._restart_s, LONGEST_RESTART_S)

    def _forget(self) -> None:
        assert self._process is not None
        close_pipes(self._process)
        self._reports = b""
        self._rotation = 0
        self._process = None

    def _drop_everything(self) -> None:
        self.counts.dropped += sum(message.frames for message in (*self._unconfirmed, *self._waiting))
        self._unconfirmed.clear()
        self._waiting.clear()
        self._points.clear()
        self._waiting_bytes = self._begun = 0

    def _look_at_recovery(self) -> None:
        for path, is_error, text in self._recovery.news():
            if path is not None:
                self.counts.finalised.append(path)
            self.news.append((is_error, text))
