"""What signals do to the service: SIGINT and SIGTERM stop it, SIGHUP begins a new log."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from dctorque_can.daemon.service import Service


@contextmanager
def obeying_signals(service: Service) -> Iterator[None]:
    """Let signals reach ``service`` inside the block; a second SIGINT or SIGTERM acts as usual."""

    def stop(number: int, frame: FrameType | None) -> None:
        service.stop()
        signal.signal(number, previous[number])

    def rotate(number: int, frame: FrameType | None) -> None:
        service.rotate()

    handlers = {signal.SIGINT: stop, signal.SIGTERM: stop, signal.SIGHUP: rotate}
    previous = {int(number): signal.getsignal(number) for number in handlers}
    for number, handler in handlers.items():
        signal.signal(number, handler)
    try:
        yield
    finally:
        for old, handler_before in previous.items():
            signal.signal(old, handler_before)
