"""Frames leave at their deadlines, and a recording survives a bus that stumbles."""

from collections.abc import Callable

import can
import numpy as np
import pytest

from dctorque_can.daemon.wire.link import BusLink
from dctorque_can.offline import playback
from dctorque_can.offline.playback import PATIENCE_S, Player
from dctorque_can.pipeline.frames import FrameFlag, Frames

from ..clock import Clock

PERIOD_S = 0.01


class Wire:
    """Takes the place of a link and notes when it was given what; it refuses what it is told to."""

    def __init__(self, clock: Clock) -> None:
        self.up = True
        self.refuses = lambda: False
        self.can_ids: list[int] = []
        self.seconds: list[float] = []
        self._clock = clock
        self._began_s = clock.now_s

    def send(self, message: can.Message) -> bool:
        if self.refuses():
            return False
        self.can_ids.append(message.arbitration_id)
        self.seconds.append(self._clock.now_s - self._began_s)
        return True


def every_10_ms(n: int) -> Frames:
    frames = Frames.empty(n)
    frames.t_us[:] = 5_000_000 + 10_000 * np.arange(n)
    frames.can_id[:] = 0x100 + np.arange(n)
    return frames


@pytest.fixture
def wire(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Wire:
    monkeypatch.setattr(playback, "time", clock)
    return Wire(clock)


def player_on(wire: Wire, speed: float = 1.0) -> Player:
    return Player(wire, speed)  # type: ignore[arg-type]


@pytest.mark.parametrize("speed", [1.0, 4.0])
@pytest.mark.parametrize("oversleep_s", [0.0, 0.002])
def test_deadlines_are_absolute_over_batches(wire: Wire, clock: Clock, speed: float, oversleep_s: float) -> None:
    """A sleep that takes longer than asked makes each frame that much late, and none later than that."""
    frames = every_10_ms(60)
    clock.oversleep_s = oversleep_s
    player = player_on(wire, speed)
    player.play(frames[:20])
    clock.now_s += 0.1 * PERIOD_S / speed  # it takes a little until the next batch is there
    player.play(frames[20:])
    assert (player.sent, player.failed) == (60, 0)
    assert wire.can_ids == frames.can_id.tolist()
    late = np.full(60, oversleep_s)
    late[0] = 0.0  # is due at once
    np.testing.assert_allclose(wire.seconds, PERIOD_S / speed * np.arange(60) + late, rtol=0, atol=1e-9)
    assert player.latest_s == pytest.approx(oversleep_s, abs=1e-9)


def test_after_a_stall_the_frames_catch_up(wire: Wire, clock: Clock) -> None:
    player = player_on(wire)
    player.play(every_10_ms(10))
    clock.now_s += 0.055
    late = every_10_ms(20)
    late.t_us[:] += 100_000
    player.play(late)
    at_once = 0.09 + 0.055  # of the frames that were due at 0.10 to 0.14 s
    expected = np.maximum(PERIOD_S * np.arange(30), np.where(np.arange(30) < 10, 0.0, at_once))
    np.testing.assert_allclose(wire.seconds, expected, rtol=0, atol=1e-9)
    assert player.latest_s == pytest.approx(at_once - 0.1)


def test_a_recording_goes_through_a_real_link(connect: Callable[[], can.BusABC]) -> None:
    frames = every_10_ms(4)
    frames.flags[1] = FrameFlag.ERROR
    link = BusLink(connect, lambda is_error, text: None)
    link.open()
    with connect() as receiver:
        player = Player(link, 100.0)
        player.play(frames)
        received = [receiver.recv(0) for _ in range(4)]
    link.close()
    assert player.sent == 3
    assert [message and message.arbitration_id for message in received] == [0x100, 0x102, 0x103, None]


def test_it_stops_when_told(wire: Wire, clock: Clock) -> None:
    began_s = clock.now_s
    player = player_on(wire)
    player.play(every_10_ms(1000), stop=lambda: clock.now_s - began_s > 0.195)
    assert player.sent == 20
    assert clock.now_s - began_s == pytest.approx(0.2)


def test_it_stops_within_a_long_silence(wire: Wire, clock: Clock) -> None:
    frames = every_10_ms(2)
    frames.t_us[1] += 3_600_000_000
    began_s = clock.now_s
    player_on(wire).play(frames, stop=lambda: clock.now_s - began_s > 5.0)
    assert wire.can_ids == [0x100]
    assert 5.0 < clock.now_s - began_s < 5.15


def test_it_stops_while_it_is_late(wire: Wire, clock: Clock) -> None:
    """Nothing is waited for then, so the look at the clock is the only chance."""
    began_s = clock.now_s
    player = player_on(wire)
    frames = every_10_ms(1000)
    frames.t_us[:] = frames.t_us[0]
    wire.refuses = lambda: bool(clock.sleep(0.02))  # so long does this bus take for a frame
    player.play(frames, stop=lambda: clock.now_s - began_s > 0.5)
    assert 0.5 < clock.now_s - began_s < 0.65


def test_a_full_bus_is_waited_for_and_a_bus_that_is_away_is_not(wire: Wire, clock: Clock) -> None:
    player = player_on(wire)
    full_until_s = clock.now_s + 0.5 * PATIENCE_S
    wire.refuses = lambda: clock.now_s < full_until_s
    player.play(every_10_ms(1))
    assert (player.sent, player.failed) == (1, 0)
    wire.refuses = lambda: True
    since_s = clock.now_s
    player.play(every_10_ms(1))
    assert (player.sent, player.failed) == (1, 1)
    assert clock.now_s - since_s == pytest.approx(PATIENCE_S, abs=0.001)
    wire.up = False
    since_s = clock.now_s
    player.play(every_10_ms(3))
    assert (player.sent, player.failed) == (1, 4)
    assert clock.now_s == since_s
