"""Cycle times as they were sent, and the limit of frames in a second."""

import math

import pytest

from dctorque_can.daemon.output.cycles import PAUSE_S, CycleTimes
from dctorque_can.daemon.output.send_rate import BURST_S, HEADROOM, SendRate


def test_intervals_are_held_against_the_period() -> None:
    cycles = CycleTimes({0x6F0: ("Torque", 0.010), 0x6F3: ("Status", 0.1)})
    assert (cycles.as_json(), cycles.worst_jitter_ms) == ({}, None)
    for at_s in (5.000, 5.010, 5.022, 5.030, 9.0, 9.011):
        cycles.sent(0x6F0, at_s)
    cycles.sent(0x6F3, 5.0)  # only once: nothing is known
    (torque,) = cycles.as_json().values()
    off_ms = [0.0, 2.0, -2.0, 1.0]
    assert torque == {
        "period_ms": 10.0,
        "mean_ms": pytest.approx(10.0 + sum(off_ms) / 4),
        "jitter_ms": pytest.approx(math.sqrt(sum(x * x for x in off_ms) / 4), abs=1e-3),
        "longest_ms": pytest.approx(12.0),
        "intervals": 4,
        "pauses": 1,
    }
    assert cycles.worst_jitter_ms == torque["jitter_ms"]


def test_of_a_slow_message_a_pause_is_two_cycles() -> None:
    cycles = CycleTimes({1: ("Slow", 1.0)})
    for at_s in (0.0, 1.0 + 1.5 * PAUSE_S, 10.0):
        cycles.sent(1, at_s)
    assert (cycles.as_json()["Slow"]["intervals"], cycles.as_json()["Slow"]["pauses"]) == (1, 1)


def test_no_more_frames_than_the_limit_are_admitted_over_any_second() -> None:
    """Frames are due without end, as from a driver whose stamps jump back and forth."""
    rate = SendRate(100.0)
    admitted = [now_s for k in range(100_000) if rate.admits(now_s := 1000.0 + k * 1e-4)]
    assert len(admitted) == pytest.approx(HEADROOM * 100.0 * (10.0 + BURST_S), abs=2)
    later = [at_s for at_s in admitted if at_s > 1001.0]
    assert len(later) == pytest.approx(HEADROOM * 100.0 * 9.0, abs=2)
    assert rate.admits(5000.0)


def test_what_the_cycles_ask_for_is_always_admitted() -> None:
    rate = SendRate(670.0)
    assert all(rate.admits(k / 670.0) for k in range(20_000))
