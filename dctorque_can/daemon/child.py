"""The other processes of the service: modules of this package that are told and answer through pipes."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from contextlib import suppress


def start(module: str, pipe_bytes: int | None = None) -> subprocess.Popen[bytes]:
    """Start a module as a process whose standard input and output are pipes that never block this end.

    Nothing is imported from the working directory (``-P``).

    Args:
        module: dotted name.
        pipe_bytes: room of the pipe to it, where the user's limit allows that.

    Raises:
        OSError: no memory, no process more.
    """
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", module], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
    )
    assert process.stdin is not None
    assert process.stdout is not None
    if pipe_bytes is not None:
        with suppress(PermissionError):  # above the limit: the default size must do
            fcntl.fcntl(process.stdin, fcntl.F_SETPIPE_SZ, pipe_bytes)
    for pipe in (process.stdin, process.stdout):
        os.set_blocking(pipe.fileno(), False)
    return process


def close_pipes(process: subprocess.Popen[bytes]) -> None:
    """Close both pipes to a process, whatever became of it."""
    for pipe in (process.stdin, process.stdout):
        if pipe is not None and not pipe.closed:
            with suppress(BrokenPipeError):
                pipe.close()
