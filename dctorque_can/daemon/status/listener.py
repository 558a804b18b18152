"""The socket on which the status is read: never through a symbolic link, never that of another living service."""

from __future__ import annotations

import fcntl
import os
import socket
import stat
import time
from pathlib import Path

SOCKET_NAME = "status.sock"  # in the folder that systemd makes
MODE = 0o660
BACKLOG = 16
_PROBE_S = 1.0
_LOCK_S = 1.0


class StatusError(Exception):
    """The socket cannot be had; the text says why, and what would help."""


def listen(path: Path) -> socket.socket:
    """Return a listening socket at ``path``, which only its user and group may use.

    A socket whose process is dead is replaced. Two processes that begin at once look one after the other: the
    folder is locked meanwhile.

    Raises:
        StatusError: something else is there, or somebody who lives serves there.
        OSError: the folder cannot be used.
    """
    folder = _locked(path.parent)
    try:
        _make_way(path)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o777 & ~MODE)
        try:
            listener.bind(str(path))
        except OSError:
            listener.close()
            raise
        finally:
            os.umask(before)
        listener.listen(BACKLOG)
        listener.setblocking(False)
        return listener
    finally:
        os.close(folder)


def identity(path: Path) -> tuple[int, int]:
    """Return by what the file of a socket is told from one that another process puts into its place."""
    status = path.lstat()
    return status.st_dev, status.st_ino


def remove(path: Path, ours: tuple[int, int]) -> None:
    """Remove the file of a socket, unless another one stands in its place by now.

    Raises:
        OSError: it cannot be removed.
        StatusError: the folder stays locked.
    """
    folder = _locked(path.parent)
    try:
        if identity(path) == ours:
            path.unlink()
    except FileNotFoundError:  # gone already, as when systemd clears the folder
        return
    finally:
        os.close(folder)


def _locked(folder: Path) -> int:
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    limit = time.monotonic() + _LOCK_S
    while True:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= limit:
                os.close(number)
                raise StatusError(f"{folder} is locked by somebody") from None
            time.sleep(0.02)
        except BaseException:
            os.close(number)
            raise
        else:
            return number


def _make_way(path: Path) -> None:
    """Remove a socket that nobody serves any more."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        what = "a symbolic link" if stat.S_ISLNK(mode) else "a file"
        raise StatusError(f"is {what}, which is left as it is: remove it, or name another path (status.socket)")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(_PROBE_S)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
            return
        except FileNotFoundError:
            return
        except OSError as error:  # it is full, or of another kind: then somebody has it
            raise StatusError(f"somebody has this socket ({error.strerror or error})") from error
    raise StatusError("another service serves there: stop it, or name another path (status.socket)")
