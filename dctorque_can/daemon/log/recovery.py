"""Torn logs of this service are closed afterwards: by a process of its own, beside the one that writes.

A log is torn when its computer lost power, or when its writer was killed. It is replaced by a whole one at once or
not at all. Files that somebody holds open for writing, files of others, and files that are damaged elsewhere than
at their end are left alone.
"""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from dctorque_can.daemon.log.plan import LogFolder
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.recover import Recovery, recover

_END = b"\x89MCAP0\r\n"
_PART = ".part"
_PATIENCE_S = 10.0
_RETRY_S = 10.0  # after a process that could not be started


class LogRecovery:
    """The service's side: begins the process and passes on what it tells. Never waits.

    Args:
        folder: with the logs.
    """

    def __init__(self, folder: LogFolder) -> None:
        self._folder = folder
        self._wanted: list[tuple[dict[str, int], list[str]]] = []
        self._cut: dict[str, int] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._told = b""
        self._again_s = 0.0

    def begin(self, but: Sequence[Path]) -> None:
        """Close every torn log of the folder but those of this run: of these the service knows where they end."""
        self._wanted.append(({}, [str(path) for path in but]))

    def cut(self, path: Path, size: int) -> None:
        """Close a log that ends at a size: what is behind that stands in the next one."""
        self._wanted.append(({str(path): size}, []))

    @property
    def cuts(self) -> bool:
        """Whether a log still stands that ends too late: nobody knows after a restart where its end is."""
        return bool(self._cut or any(cut for cut, _ in self._wanted))

    def news(self) -> Iterator[tuple[Path | None, bool, str]]:
        """Yield what happened: a log that is whole again or None, is an error, text."""
        if self._process is None:
            if self._wanted and time.monotonic() >= self._again_s:
                try:
                    self._start(*self._wanted[0])
                except OSError as error:  # no memory, no process more
                    self._again_s = time.monotonic() + _RETRY_S
                    yield None, True, f"torn logs cannot be closed yet: {error.strerror}"
                else:
                    del self._wanted[0]
            return
        assert self._process.stdout is not None
        ended = self._process.poll() is not None
        with suppress(BlockingIOError):
            while chunk := os.read(self._process.stdout.fileno(), 1 << 16):
                self._told += chunk
        *lines, self._told = self._told.split(b"\n")
        for line in lines:
            path, is_error, text = json.loads(line)
            yield None if path is None else Path(path), is_error, text
        if ended:
            self._process.stdout.close()
            self._process = None
            self._cut = {}

    def end(self) -> None:
        """Stop; what is not done is done after the next start."""
        if self._process is not None:
            assert self._process.stdout is not None
            self._process.kill()
            self._process.wait()
            self._process.stdout.close()
            self._process = None

    def _start(self, cut: dict[str, int], but: list[str]) -> None:
        folder = {"directory": str(self._folder.directory), "vehicle": self._folder.vehicle}
        words = json.dumps({**folder, "stem": self._folder.stem, "cut": cut, "but": but})
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "dctorque_can.daemon.log.recovery", words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
        )
        self._cut = cut
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)


def finalise(path: Path, size: int | None = None, patience_s: float = 0.0) -> tuple[Path | None, bool, str] | None:
    """Close a torn log, and return what is to be told of it; None for one that is whole or held by somebody.

    Args:
        path: of the log.
        size: at which it ends, if more of it is known to stand elsewhere.
        patience_s: for which somebody may still hold it: a process that was killed may be waiting for the disk.

    Raises:
        OSError: it cannot be read, or nothing can be written beside it.
        DctorqueError: likewise.
    """
    number = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    with os.fdopen(number, "rb+", buffering=0) as file:
        if not _locked(number, patience_s):
            return None
        length = file.seek(0, os.SEEK_END)
        file.seek(max(length - len(_END), 0))
        if file.read(len(_END)) == _END and length > 2 * len(_END) and size is None:
            return None
        if size is not None and size < length:
            file.truncate(size)
        return _replaced(path, os.fstat(number).st_mode)


def _locked(number: int, patience_s: float) -> bool:
    """Lock an open file, and return whether that was possible."""
    limit = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= limit:
                return False
            time.sleep(0.05)
        else:
            return True


def _replaced(path: Path, mode: int) -> tuple[Path | None, bool, str]:
    part = path.with_name(f".{path.name}{_PART}")
    part.unlink(missing_ok=True)
    try:
        result = recover(path, part)
        if not result.only_cut:
            return None, True, f"{path}: is damaged and left as it is; `dctorque recover` saves what can be read"
        with part.open("rb+") as file:
            os.fchmod(file.fileno(), mode & 0o777)
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    _sync(path.parent)
    return path, False, f"{path}: was torn and is whole again: {_saved(result)}"


def _saved(result: Recovery) -> str:
    lost = f", {result.bytes_lost} bytes at its end were no whole message" if result.bytes_lost else ""
    return f"{result.messages} messages{lost}"


def _sync(folder: Path) -> None:
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def finalise_all(
    folder: LogFolder, cut: Mapping[str, int], but: Sequence[str] = (), patience_s: float = 0.0
) -> Iterator[tuple[Path | None, bool, str]]:
    """Close torn logs and yield what is to be told.

    Args:
        folder: all of which are closed if there is no ``cut``.
        cut: path of a log to the size at which it ends.
        but: paths of logs that stay as they are.
        patience_s: for which somebody may still hold one.
    """
    try:
        paths = [Path(path) for path in cut] or [log.path for log in folder.own_logs() if str(log.path) not in but]
    except OSError as error:
        yield None, True, f"{folder.directory}: cannot be looked through for torn logs: {error.strerror}"
        return
    for path in paths:
        try:
            told = finalise(path, cut.get(str(path)), patience_s)
        except FileNotFoundError:  # it was deleted meanwhile to keep the quota
            continue
        except OSError as error:
            told = None, True, f"{path}: was torn and cannot be closed: {error.strerror}"
        except DctorqueError as error:
            told = None, True, f"{path}: was torn and cannot be closed: {error}"
        if told is not None:
            yield told


def main() -> None:
    """Do what the first argument says, and tell it in lines on standard output."""
    os.nice(10)
    for unwanted in (signal.SIGHUP, signal.SIGUSR1):  # to all of a unit: they are for the service
        signal.signal(unwanted, signal.SIG_IGN)
    words = json.loads(sys.argv[1])
    folder = LogFolder(Path(words["directory"]), words["stem"], vehicle=words["vehicle"])
    for told in finalise_all(folder, words["cut"], words["but"], _PATIENCE_S):
        path, is_error, text = told
        line = json.dumps([None if path is None else str(path), is_error, text])
        with suppress(BrokenPipeError):  # whoever wanted to know is gone
            os.write(sys.stdout.fileno(), line.encode() + b"\n")


if __name__ == "__main__":
    main()
