"""Times between frames, by hand."""

import numpy as np
import pytest

from dctorque_can.evidence.intervals import Intervals
from dctorque_can.pipeline.frames import Address, FrameFlag, Frames

ONE, OTHER = Address(0x100), Address(0x200)


def frames(times_ms, can_id=0x100, flags=0):
    made = Frames.empty(len(times_ms))
    made.t_us[:] = np.round(np.array(times_ms) * 1000)
    made.can_id[:], made.flags[:] = can_id, flags
    return made


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_median_and_what_is_usual(cut):
    """200 steps of 10 ms, of which 4 are doubled: the cut of the batches does not matter."""
    steps = np.full(200, 10.0)
    steps[[20, 80, 120, 160]] = 20.0
    times = np.concatenate([[5.0], 5.0 + np.cumsum(steps)])
    intervals = Intervals([ONE, OTHER])
    for first in range(0, len(times), cut):
        intervals.take(frames(times[first : first + cut]))
    found = intervals.of(ONE)
    assert (found.frames, found.median_ms, found.longest_usual_ms) == (201, 10.0, 20.0)
    assert intervals.of(OTHER) is None


def test_what_does_not_count():
    """Steps back of the clock, error and own frames, and other messages."""
    intervals = Intervals([ONE])
    intervals.take(frames([1000.0, 1010.0, 500.0, 510.0, 520.0]))
    intervals.take(frames([522.0, 524.0], flags=FrameFlag.SENT))
    intervals.take(frames([522.0, 524.0], can_id=0x101))
    found = intervals.of(ONE)
    assert (found.frames, found.median_ms, found.longest_usual_ms) == (4, 10.0, 10.0)


def test_one_frame_is_no_interval_and_a_pause_counts_as_ten_seconds():
    intervals = Intervals([ONE])
    intervals.take(frames([0.0]))
    assert intervals.of(ONE) is None
    intervals.take(frames([3_600_000.0]))
    assert intervals.of(ONE).median_ms == 10_000.0
