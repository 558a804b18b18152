"""What signals do to the service: SIGINT and SIGTERM stop it, SIGHUP has it read its vehicle file anew,
SIGUSR1 begins a new log.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from types import FrameType

from dctorque_can.daemon.journal import STDERR, Priority, line
from dctorque_can.daemon.service import Service

GRACE_S = 1.5
_NO_SUMMARY = "ended without a summary: something (the driver of the bus?) does not return"
_STOPPING = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def obeying_signals(service: Service) -> Iterator[None]:
    """Let signals reach ``service`` inside the block; a second SIGINT or SIGTERM acts as usual.

    While it compiles, a signal raises KeyboardInterrupt. When something that never returns (a driver) keeps the
    service from stopping, the process ends after `GRACE_S` all the same; the log writer, another process, then
    closes the log. A log that is being closed is waited for.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        service.stop()
        signal.signal(number, previous[number])
        if service.compiling:
            raise KeyboardInterrupt

    def rotate(number: int, frame: FrameType | None) -> None:
        service.rotate()

    def reload(number: int, frame: FrameType | None) -> None:
        service.reload()

    handlers = {signal.SIGINT: stop, signal.SIGTERM: stop, signal.SIGHUP: reload, signal.SIGUSR1: rotate}
    previous = {int(number): signal.getsignal(number) for number in handlers}
    for number, handler in handlers.items():
        signal.signal(number, handler)
    try:
        with _ending_in_time(service):
            yield
    finally:
        for old, handler_before in previous.items():
            signal.signal(old, handler_before)


@contextmanager
def _ending_in_time(service: Service) -> Iterator[None]:
    """End the process `GRACE_S` after a signal that should stop ``service``, unless the block has ended by then.

    A handler in Python runs only when the main thread is in Python; a number in a pipe arrives always.
    """
    left = Event()
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)

    def watch() -> None:
        while numbers := os.read(reader, 64):
            stopping = [number for number in numbers if number in _STOPPING]
            if stopping and not left.wait(GRACE_S) and not service.finishing:
                os.write(STDERR, line(Priority.ERROR, _NO_SUMMARY).encode() + b"\n")
                os._exit(128 + stopping[0])

    watcher = Thread(target=watch, name="signals", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        left.set()
        signal.set_wakeup_fd(before)
        os.close(writer)
        watcher.join()
        os.close(reader)
