"""Frames onto a bus in real time, each at its absolute deadline."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from dctorque_can.config.edges import CanSection
from dctorque_can.daemon.wire.link import BusLink, open_bus
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import FrameFlag, Frames

RETRY_S = 0.0005
PATIENCE_S = 0.2  # that long a full transmit queue is waited for


@contextmanager
def playing(bus: CanSection, tell: Callable[[bool, str], None]) -> Iterator[BusLink]:
    """Give an open link that is closed afterwards.

    Args:
        bus: where to.
        tell: is told when the bus goes away and comes back: ``tell(is_error, text)``.

    Raises:
        DctorqueError: the bus cannot be opened, or may only be listened to.
    """
    if bus.listen_only:
        raise DctorqueError(f"{bus}: nothing can be played onto it, the vehicle file says listen_only: true")
    link = BusLink(partial(open_bus, bus.arguments()), tell)
    link.open()
    try:
        yield link
    finally:
        link.close()


class Player:
    """Sends batches of one recording; deadlines run on from batch to batch, so that no error adds up.

    Args:
        link: where to; a bus that goes away is waited for, its frames of that time are lost and counted.
        speed: bus seconds per second.

    Attributes:
        sent: frames that the bus took.
        failed: frames that it did not take.
        latest_s: the largest delay of a frame behind its deadline.
    """

    def __init__(self, link: BusLink, speed: float) -> None:
        self.sent = 0
        self.failed = 0
        self.latest_s = 0.0
        self._link = link
        self._speed = speed
        self._first_us: int | None = None
        self._began_s = 0.0

    def play(
        self,
        frames: Frames,
        progress: Callable[[float], None] = lambda fraction: None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Send ``frames``; error frames are left out. Returns early when ``stop`` says so."""
        if self._first_us is None and len(frames):
            self._first_us = int(frames.t_us[0])
            self._began_s = time.monotonic()
        shown_s = 0.0
        for i, t_us in enumerate(frames.t_us.tolist()):
            assert self._first_us is not None
            due_s = self._began_s + (t_us - self._first_us) / 1e6 / self._speed
            now_s = time.monotonic()
            while now_s < due_s:
                time.sleep(min(due_s - now_s, 0.1))
                if stop():
                    return
                now_s = time.monotonic()
            self.latest_s = max(self.latest_s, now_s - due_s)
            if now_s - shown_s > 0.1:
                shown_s = now_s
                progress(i / len(frames))
                if stop():
                    return
            if not frames.flags[i] & FrameFlag.ERROR:
                self._send(frames, i)
        progress(1.0)

    def _send(self, frames: Frames, i: int) -> None:
        message = message_from_frame(frames, i)
        message.channel = None  # the number of a channel in a log names no interface here
        limit_s = time.monotonic() + PATIENCE_S
        while not self._link.send(message):
            if not self._link.up or time.monotonic() > limit_s:
                self.failed += 1
                return
            time.sleep(RETRY_S)
        self.sent += 1
