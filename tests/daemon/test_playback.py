"""Frames leave at their deadlines, and a recording survives a bus that stumbles."""

import time
from collections.abc import Callable

import can
import numpy as np
import pytest

from dctorque_can.daemon.link import BusLink
from dctorque_can.daemon.playback import Player
from dctorque_can.pipeline.frames import FrameFlag, Frames


def every_10_ms(n: int) -> Frames:
    frames = Frames.empty(n)
    frames.t_us[:] = 5_000_000 + 10_000 * np.arange(n)
    frames.can_id[:] = 0x100 + np.arange(n)
    return frames


@pytest.fixture
def link(connect: Callable[[], can.BusABC]):
    link = BusLink(connect, lambda is_error, text: None)
    link.open()
    yield link
    link.close()


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_deadlines_are_absolute_over_batches(
    link: BusLink, connect: Callable[[], can.BusABC], speed: float
) -> None:
    frames = every_10_ms(60)
    with connect() as receiver:
        player = Player(link, speed)
        began = time.monotonic()
        player.play(frames[:20])
        player.play(frames[20:])
        seconds = time.monotonic() - began
        received = [receiver.recv(0) for _ in range(60)]
    assert seconds == pytest.approx(0.59 / speed, abs=0.1)
    assert (player.sent, player.failed) == (60, 0)
    assert [message.arbitration_id for message in received if message] == frames.can_id.tolist()


def test_error_frames_are_not_sent(link: BusLink) -> None:
    frames = every_10_ms(4)
    frames.flags[1] = FrameFlag.ERROR
    player = Player(link, 100.0)
    player.play(frames)
    assert player.sent == 3


def test_it_stops_when_told(link: BusLink) -> None:
    player = Player(link, 1.0)
    began = time.monotonic()
    player.play(every_10_ms(1000), stop=lambda: time.monotonic() - began > 0.2)
    assert time.monotonic() - began < 1.0
    assert 0 < player.sent < 100
