"""The log-writer process: takes columns from a pipe and writes them to MCAP logs.

It is a process of its own because writing in the service, or in a thread beside it, holds up its receive loop
for tens of milliseconds. It ends, with a closed log, when the pipe ends: after a stop of the service and
after its death alike.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dctorque_can.daemon.log_plan import LogPlan
from dctorque_can.daemon.log_protocol import Kind, MessageSplitter, read_frames, read_table_rows
from dctorque_can.daemon.log_quota import make_room, mark
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.estimates import HEALTH as HEALTH_ROW

if TYPE_CHECKING:
    from dctorque_can.bus.columns import MessageColumns

RETRY_S = 10.0
LONGEST_RETRY_S = 300.0
CHUNK = 1 << 16
READ = 1 << 20


class LogWorker:
    """Writes what it is handed; a log that cannot be written is given up and a new one tried after a while."""

    def __init__(self, plan: LogPlan, documents: Mapping[str, bytes]) -> None:
        self._plan = plan
        self._documents = documents
        self._signals: MessageColumns | None = None
        if plan.signals:  # the imports cost a second, so only those who want signals pay it
            from dctorque_can.bus.columns import MessageColumns
            from dctorque_can.config.load import load_documents

            config = load_documents(documents)
            self._signals = MessageColumns(config.database, config.addresses)
        self._log: McapLog | None = None
        self._opened = 0
        self._began_s = 0.0
        self._retry_s = 0.0
        self._pause_s = RETRY_S
        self._flush_s = 0.0
        self._unconfirmed = 0

    def take(self, kind: Kind, body: bytes, now_s: float) -> None:
        """Write one message."""
        if kind == Kind.ROTATE:
            self._close()
            self._open(now_s)
            return
        if self._log is None and now_s >= self._retry_s:
            self._open(now_s)
        frames = read_frames(body) if kind == Kind.FRAMES else None
        if self._log is None:
            self._lost(0 if frames is None else len(frames))
            return
        log = self._log
        try:
            if frames is not None:
                self._unconfirmed += len(frames)
                log.write_frames(frames)
                if self._signals is not None:
                    for name, rows in self._signals.decode(frames).items():
                        log.write_table(Table.of_signals(name, rows.dtype), rows)
            elif kind == Kind.ESTIMATES:
                log.write_table(ESTIMATES, np.frombuffer(body, ESTIMATE))
            elif kind == Kind.HEALTH:
                log.write_table(HEALTH, np.frombuffer(body, HEALTH_ROW))
            elif kind == Kind.TABLE:
                log.write_table(*read_table_rows(body))
            elif kind == Kind.EVENT:
                event = json.loads(body)
                log.write_event(event["t_us"], EventLevel(event["level"]), event["name"], event["text"])
        except DctorqueError as error:
            self._give_up(error, now_s)

    def keep_time(self, now_s: float) -> None:
        """Flush and rotate when it is time; to be called often."""
        if self._log is None or now_s < self._flush_s:
            return
        self._flush_s = now_s + self._plan.flush_s
        self._flush(now_s)
        if self._log is None:
            return
        size_mb, age_s = self._log.size / 1e6, now_s - self._began_s
        if 0 < self._plan.rotate_mb <= size_mb or 0 < self._plan.rotate_s <= age_s:
            self._close()
            self._open(now_s)

    def finish(self) -> None:
        """Close the log."""
        self._close()

    def _open(self, now_s: float) -> None:
        folder = self._plan.folder
        path = folder.next_path(self._opened)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            logs = folder.own_logs()
            number = logs[-1].number + 1 if logs else 1
            metadata = {**mark(folder.vehicle, folder.stem, number), **self._plan.metadata}
            self._log = McapLog(path, documents=self._documents, metadata=metadata, chunk_size=CHUNK)
            self._log.sync()  # the mark is what a log is known by after a power cut
        except OSError as error:
            self._give_up(DctorqueError(f"{error.filename or path}: {error.strerror}"), now_s)
            _remove_empty(path)
            return
        except DctorqueError as error:
            self._give_up(error, now_s)
            _remove_empty(path)
            return
        self._opened += 1
        self._began_s = now_s
        self._flush_s = now_s + self._plan.flush_s
        report(opened=str(path))
        if folder.quota_mb > 0:
            gone, failures = make_room(logs, folder.quota_mb * 1e6)
            for old in gone:
                report(deleted=str(old))
            for failure in failures:
                report(kept=failure)

    def _flush(self, now_s: float) -> None:
        if self._log is None:
            return
        try:
            self._log.flush()
        except DctorqueError as error:
            self._give_up(error, now_s)
            return
        if self._unconfirmed:
            self._pause_s = RETRY_S
            report(written=self._unconfirmed)
            self._unconfirmed = 0

    def _close(self) -> None:
        self._flush(time.monotonic())
        if self._log is None:
            return
        try:
            self._log.close()
            report(closed=str(self._log.path))
        except DctorqueError as error:
            report(failed=str(error))
        self._log = None

    def _give_up(self, error: DctorqueError, now_s: float) -> None:
        report(failed=f"{error}; trying a new log in {self._pause_s:g} s")
        self._retry_s = now_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, LONGEST_RETRY_S)
        self._lost(self._unconfirmed)
        self._unconfirmed = 0
        if self._log is None:
            return
        try:
            self._log.close()
        except DctorqueError as second:
            report(failed=str(second))
        _remove_empty(self._log.path)
        self._log = None

    def _lost(self, frames: int) -> None:
        if frames:
            report(lost=frames)


def _remove_empty(path: Path) -> None:
    """Remove a log that got nothing, or a full disk would leave one at every try."""
    with suppress(OSError):
        if path.is_file() and path.stat().st_size == 0:
            path.unlink()


def report(**content: str | int) -> None:
    """Tell the service, one JSON object a line; one that is dead needs no telling, and its log is closed."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), json.dumps(content).encode() + b"\n")


def main() -> None:
    """Serve the pipe on standard input until it ends."""
    for unwanted in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(unwanted, signal.SIG_IGN)  # the end of the pipe is what ends this process
    splitter = MessageSplitter()
    documents: dict[str, bytes] = {}
    worker: LogWorker | None = None
    plan: LogPlan | None = None
    pipe = sys.stdin.fileno()
    while True:
        ready = select.select([pipe], [], [], 0.02 if worker else None)[0]
        chunk = os.read(pipe, READ) if ready else None
        now_s = time.monotonic()
        for kind, body in splitter.feed(chunk or b""):
            if kind == Kind.SETUP:
                plan = LogPlan.from_json(json.loads(body))
            elif kind == Kind.DOCUMENT:
                name, _, content = body.partition(b"\0")
                documents[name.decode()] = content
            elif worker is not None:
                worker.take(kind, body, now_s)
            elif plan is not None:
                worker = LogWorker(plan, documents)
                worker.take(kind, body, now_s)
        if worker is not None:
            worker.keep_time(now_s)
        if chunk == b"":
            break
    if worker is not None:
        worker.finish()


if __name__ == "__main__":
    main()
