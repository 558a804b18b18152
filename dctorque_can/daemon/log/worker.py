"""The log-writer process: takes columns from a pipe and writes them to MCAP logs.

It is a process of its own because writing in the service, or in a thread beside it, holds up its receive loop
for tens of milliseconds. It ends, with a closed log, when the pipe ends: after a stop of the service and
after its death alike. When a log begins, and when it is written, decides the service.
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
from typing import TYPE_CHECKING, Any

import numpy as np

from dctorque_can.daemon import journal
from dctorque_can.daemon.journal import Priority
from dctorque_can.daemon.log.disk import Disk, report
from dctorque_can.daemon.log.plan import STATE_NAME, LogPlan
from dctorque_can.daemon.log.protocol import (
    Kind,
    MessageSplitter,
    read_end,
    read_flush,
    read_frames,
    read_rotate,
    read_table_rows,
)
from dctorque_can.daemon.log.quota import mark
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.estimates import HEALTH as HEALTH_ROW

if TYPE_CHECKING:
    from dctorque_can.bus.columns import MessageColumns

CHUNK = 1 << 16
READ = 1 << 20


class LogWorker:
    """Writes what it is handed; a log that cannot be written is given up, and the service asks for a new one.

    Args:
        plan: how to write.
        documents: for every log.
        opened: logs that were opened before.

    Attributes:
        ended: whether nothing else comes.
    """

    def __init__(self, plan: LogPlan, documents: Mapping[str, bytes], opened: int = 0) -> None:
        self.ended = False
        self._use(plan, documents)
        self._next: tuple[LogPlan, Mapping[str, bytes]] | None = None
        self._log: McapLog | None = None
        self._opened = opened
        self._unflushed_s: float | None = None  # since when something is in memory alone
        self._frames = 0  # taken since the last point
        self._lost = 0  # … of these

    def _use(self, plan: LogPlan, documents: Mapping[str, bytes]) -> None:
        self._plan, self._documents = plan, documents
        self._disk = Disk(plan)
        self._signals: MessageColumns | None = None
        if plan.signals:  # the imports cost a second, so only those who want signals pay it
            from dctorque_can.bus.columns import MessageColumns
            from dctorque_can.config.load import load_documents

            config = load_documents(documents)
            self._signals = MessageColumns(config.database, config.addresses)

    def change(self, plan: LogPlan, documents: Mapping[str, bytes]) -> None:
        """Write otherwise, from the next log on."""
        self._next = plan, documents

    def take(self, kind: Kind, body: bytes, now_s: float) -> None:
        """Write one message."""
        if kind == Kind.ROTATE:
            number, state = read_rotate(body)
            self._close()
            if self._next is not None:
                self._use(*self._next)
                self._next = None
            self._open(state)
            self._reach(number)
        elif kind == Kind.FLUSH:
            number, received_s = read_flush(body)
            self._flush()
            self._disk.look(now_s, self._log, self._give_up)
            self._reach(number, age_s=time.monotonic() - received_s)
        elif kind == Kind.END:
            self.ended = True
            self._close(settle=False)  # the service waits
            self._reach(read_end(body))
        else:
            self._write(kind, body)
            if self._unflushed_s is None:
                self._unflushed_s = now_s

    def keep_time(self, now_s: float) -> None:
        """Flush if the service has not asked for it in time; to be called often."""
        if self._unflushed_s is not None and now_s >= self._unflushed_s + self._plan.flush_s / 2:
            self._flush()

    def finish(self) -> Path | None:
        """Close the log, and return its path."""
        path = None if self._log is None else self._log.path
        self._close()
        return path

    def _write(self, kind: Kind, body: bytes) -> None:
        frames = read_frames(body) if kind == Kind.FRAMES else None
        self._frames += 0 if frames is None else len(frames)
        log = self._log
        if log is None:
            self._lost = self._frames
            return
        try:
            if frames is not None:
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
            self._give_up(str(error))

    def _reach(self, number: int, **more: float) -> None:
        """Tell that all up to a point is handed to the operating system, but for what is lost."""
        size = 0 if self._log is None else self._log.written
        report(point=number, lost=self._lost, size=size, **more)
        self._frames = self._lost = 0

    def _open(self, state: bytes) -> None:
        folder = self._plan.folder
        path = folder.next_path(self._opened)
        documents = {**self._documents, STATE_NAME: state} if state else self._documents
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            logs = folder.own_logs()
            self._disk.check(path.parent, logs)
            number = logs[-1].number + 1 if logs else 1
            metadata = {**mark(folder.vehicle, folder.stem, number), **self._plan.metadata}
            self._log = McapLog(path, documents=documents, metadata=metadata, chunk_size=CHUNK, held=True)
            self._disk.begin_sync(self._log)  # the mark is what a log is known by after a power cut
        except OSError as error:
            self._give_up(f"{error.filename or path}: {error.strerror}")
            _remove_empty(path)
            return
        except DctorqueError as error:
            self._give_up(str(error))
            _remove_empty(path)
            return
        self._opened += 1
        report(opened=str(path))
        self._disk.keep_quota(logs)

    def _flush(self) -> None:
        self._unflushed_s = None
        if self._log is None:
            return
        try:
            self._log.flush()
        except DctorqueError as error:
            self._give_up(str(error))

    def _close(self, settle: bool = True) -> None:
        self._flush()
        if settle:
            self._disk.settle()
        if self._log is None:
            return
        try:
            self._log.close()
            report(closed=str(self._log.path), size=self._log.written)
        except DctorqueError as error:
            report(failed=str(error))
        self._log = None

    def _give_up(self, reason: str) -> None:
        report(failed=reason)
        self._lost = self._frames
        self._disk.settle()
        if self._log is None:
            return
        try:
            self._log.close()
        except DctorqueError as second:
            report(failed=str(second))
        _remove_empty(self._log.path)
        self._log = None


def _remove_empty(path: Path) -> None:
    """Remove a log that got nothing, or a full disk would leave one at every try."""
    with suppress(OSError):
        if path.is_file() and path.stat().st_size == 0:
            path.unlink()


def main() -> None:
    """Serve the pipe on standard input until it ends."""
    for unwanted in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
        signal.signal(unwanted, signal.SIG_IGN)  # the end of the pipe is what ends this process
    splitter = MessageSplitter()
    documents: dict[str, bytes] = {}
    worker: LogWorker | None = None
    plan: dict[str, Any] | None = None
    changed = False
    pipe = sys.stdin.fileno()
    while True:
        ready = select.select([pipe], [], [], 0.02 if worker else None)[0]
        chunk = os.read(pipe, READ) if ready else None
        now_s = time.monotonic()
        for kind, body in splitter.feed(chunk or b""):
            if kind == Kind.SETUP:
                plan, documents, changed = json.loads(body), {}, worker is not None
            elif kind == Kind.DOCUMENT:
                name, _, content = body.partition(b"\0")
                documents[name.decode()] = content
            elif plan is not None:
                if worker is None:
                    worker = LogWorker(LogPlan.from_json(plan), documents, plan["opened"])
                elif changed:
                    worker.change(LogPlan.from_json(plan), documents)
                    changed = False
                worker.take(kind, body, now_s)
        if worker is not None:
            worker.keep_time(now_s)
        if worker is not None and worker.ended:
            os._exit(0)  # all is written and told; to take Python down would take longer
        if chunk == b"":
            break
    if worker is not None:
        path = worker.finish()
        _say(f"dctorque: the service is gone; all that it handed over is in {path}, which is closed")


def _say(line: str) -> None:
    """Tell those who look at what is left of the service's own output."""
    with suppress(OSError):
        os.write(sys.stderr.fileno(), journal.line(Priority.WARNING, line).encode() + b"\n")


if __name__ == "__main__":
    main()
