"""The disk under the logs: its free space, the quota, what it has taken for good, and who else may write there."""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path

from dctorque_can.daemon.background import finished, in_background
from dctorque_can.daemon.log.plan import LogPlan
from dctorque_can.daemon.log.quota import OwnLog, make_room
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.writer import McapLog

_LOOK_S = 1.0
_SYNC_LIMIT_S = 30.0


def report(**content: str | int | float) -> None:
    """Tell the service, one JSON object a line; one that is dead needs no telling, and its log is closed."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), json.dumps(content).encode() + b"\n")


class Disk:
    """What the log process does for its disk.

    Args:
        plan: how logs are written.
    """

    def __init__(self, plan: LogPlan) -> None:
        self._plan = plan
        self._warned = False
        self._look_s = self._sync_s = 0.0
        self._syncing: Future[None] | None = None

    def check(self, folder: Path, logs: Sequence[OwnLog]) -> None:
        """Look at the folder before a log is opened there.

        Raises:
            DctorqueError: there is too little room.
            OSError: it cannot be looked at.
        """
        if not self._warned:
            self._warned = True
            doubt = doubtful_owner(folder)
            if doubt:
                report(warning=doubt)
        self._make_free(folder, list(logs))

    def look(self, now_s: float, log: McapLog | None, give_up: Callable[[str], None]) -> None:
        """Look at the free space and have the disk take everything, when it is time; for each flush."""
        if log is None:
            return
        try:
            if now_s >= self._look_s:
                self._look_s = now_s + _LOOK_S
                self._make_free(log.path.parent, None)
            self._sync(now_s, log)
        except DctorqueError as error:
            give_up(str(error))
        except OSError as error:
            give_up(f"{log.path}: {error.strerror}")

    def keep_quota(self, logs: Sequence[OwnLog]) -> None:
        """Delete the oldest of the logs that were there before the one that was just opened."""
        quota_mb = self._plan.folder.quota_mb
        if quota_mb > 0:
            self._delete(logs, quota_mb * 1e6, "the quota")

    def settle(self) -> None:
        """Wait for the disk, so that the log can be closed."""
        if self._syncing is not None:
            finished(self._syncing, _SYNC_LIMIT_S)
            self._syncing = None

    def _sync(self, now_s: float, log: McapLog) -> None:
        """Have the disk take everything if it is time to."""
        if self._syncing is not None:
            if not self._syncing.done():
                return
            syncing, self._syncing = self._syncing, None
            syncing.result()
        if self._plan.fsync_s > 0 and now_s >= self._sync_s:
            self._sync_s = now_s + self._plan.fsync_s
            self.begin_sync(log)

    def begin_sync(self, log: McapLog) -> None:
        """Begin to have the disk take a log, in a thread: meanwhile writing goes on. A device has no disk."""
        if not log.path.is_file():
            return
        number = os.dup(log.fileno())

        def sync() -> None:
            try:
                os.fsync(number)
            finally:
                os.close(number)

        self._syncing = in_background(sync, "fsync")

    def _make_free(self, folder: Path, logs: list[OwnLog] | None) -> None:
        least = self._plan.least_free_mb * 1e6
        if least <= 0 or (missing := least - _free_bytes(folder)) <= 0:
            return
        if self._plan.folder.quota_mb > 0:  # then logs may be deleted, but for the one that is being written
            if logs is None:
                logs = self._plan.folder.own_logs()[:-1]
            self._delete(logs, sum(log.size for log in logs) - missing, "the free space")
            missing = least - _free_bytes(folder)
        if missing > 0:
            raise DctorqueError(
                f"{folder}: less is free than logging.least_free_mb = {self._plan.least_free_mb:g} MB; "
                "delete something, or let logging.keep_mb delete old logs"
            )

    def _delete(self, logs: Sequence[OwnLog], keep_bytes: float, why: str) -> None:
        gone, failures = make_room(logs, keep_bytes)
        for old in gone:
            report(deleted=str(old), to_keep=why)
        for failure in failures:
            report(warning=failure)


def doubtful_owner(folder: Path) -> str:
    """Return what is doubtful about who may write to a folder, "" if nothing is."""
    status = folder.stat()
    remedy = f"its logs can be exchanged; `chown $USER {folder} && chmod go-w {folder}`"
    if status.st_uid not in (0, os.geteuid()):
        return f"{folder} belongs to another user (number {status.st_uid}): {remedy}"
    if status.st_mode & stat.S_IWOTH:
        return f"everybody may write to {folder}: {remedy}"
    return ""


def _free_bytes(folder: Path) -> int:
    disk = os.statvfs(folder)
    return disk.f_bavail * disk.f_frsize
