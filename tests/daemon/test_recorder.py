"""What was received is asked to be written within half of `flush_ms`, whatever comes when."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from dctorque_can.daemon.log.counts import State, no_state
from dctorque_can.daemon.log.recorder import Recorder
from dctorque_can.pipeline.frames import Frames

LONGEST_WAIT_S = 0.1  # of the service's receive loop


class Written:
    """Stands for the log process: what is handed over, and when it is asked to be written."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, float, object]] = []
        self.wants = False

    def hand_over(self, content: bytes, frames: int = 0) -> None:
        self.calls.append(("frames", time.monotonic(), frames))

    def flush(self, state: State, received_s: float) -> bool:
        self.calls.append(("flush", time.monotonic(), (received_s, state())))
        return True

    def rotate(self, state: State) -> None:
        self.calls.append(("rotate", time.monotonic(), state()))

    def wants_new(self, now_s: float) -> bool:
        wanted, self.wants = self.wants, False
        return wanted

    def pump(self) -> None:
        pass


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def go(seconds: float) -> None:
        now[0] += seconds

    return go


@pytest.mark.parametrize("flush_s", [0.01, 0.05, 0.2, 2.0])
@pytest.mark.parametrize("pause_s", [0.0003, 0.02, 0.7])
def test_every_frame_is_flushed_in_time(clock: Callable[[float], None], flush_s: float, pause_s: float) -> None:
    """Bursts and silences at random; the loop wakes up with each frame, and when the recorder says so."""
    rng = np.random.default_rng(3)
    log, seen = Written(), 0
    recorder = Recorder(log, True, True, flush_s, lambda: lambda: b"%d" % seen)  # type: ignore[arg-type]
    received: list[float] = []
    next_s = time.monotonic()
    end_s = next_s + max(12 * flush_s, 400 * pause_s)
    while time.monotonic() < end_s:
        now_s = time.monotonic()
        wait_s = min(LONGEST_WAIT_S, recorder.pause_s(now_s), max(next_s - now_s, 0.0))
        clock(wait_s)
        if time.monotonic() >= next_s - 1e-9:
            recorder.frames(Frames.empty(1))
            received.append(time.monotonic())
            seen += 1
            next_s += float(rng.exponential(pause_s))
        recorder.keep_time(time.monotonic())
    handed = flushed = 0
    for call, at_s, content in log.calls:
        if call == "frames":
            handed += int(content)  # type: ignore[call-overload]
        elif call == "flush":
            since_s, state = content  # type: ignore[misc]
            assert since_s == received[flushed]
            assert at_s - received[flushed] <= flush_s / 2 + 1e-9
            assert state == b"%d" % handed  # exactly of the frames that were handed over
            flushed = handed
    assert flushed > 5


def test_a_new_log_begins_behind_all_that_was_handed_over(clock: Callable[[float], None]) -> None:
    log = Written()
    recorder = Recorder(log, True, True, 0.2, lambda: lambda: b"state")  # type: ignore[arg-type]
    recorder.frames(Frames.empty(3))
    log.wants = True
    recorder.keep_time(time.monotonic())
    assert [(call, content) for call, _, content in log.calls] == [("frames", 3), ("rotate", b"state")]


def test_without_frames_in_the_log_there_is_no_state(clock: Callable[[float], None]) -> None:
    log = Written()
    recorder = Recorder(log, False, True, 0.2, lambda: pytest.fail)  # type: ignore[arg-type, return-value]
    recorder.rotate()
    assert log.calls[-1][2] == no_state()
