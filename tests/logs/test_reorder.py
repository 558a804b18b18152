"""Frames out of order: sorted within the window, a step of the clock beyond it, however they are cut."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.logs.reorder import Reorder
from dctorque_can.pipeline.frames import Frames

WINDOW = 30


def frames_at(times):
    frames = Frames.empty(len(times))
    frames.t_us[:] = times
    frames.can_id[:] = np.arange(len(times)) % 2048
    return frames


def run(times, cuts=(), window=WINDOW):
    frames = frames_at(times)
    order = Reorder(window)
    parts = [frames[a:b] for a, b in zip([0, *cuts], [*cuts, len(frames)], strict=True)]
    return Frames.concatenate(order.sorted(parts)), order


def expected(times, window):
    """One frame after another: those of a stretch between two steps of the clock, sorted."""
    stretches, latest = [[]], None
    for k, t in enumerate(times):
        if latest is not None and latest - t > window:
            stretches.append([])
            latest = t
        stretches[-1].append((t, k))
        latest = t if latest is None else max(latest, t)
    return [k for stretch in stretches for _, k in sorted(stretch)]


@settings(max_examples=200)
@given(st.lists(st.integers(0, 200), max_size=60), st.data())
def test_any_times_however_they_are_cut(times, data):
    cuts = sorted(data.draw(st.lists(st.integers(0, len(times)), max_size=6)))
    found, _ = run(times, cuts)
    assert found.can_id.tolist() == expected(times, WINDOW)


def test_what_is_in_order_stays_and_is_not_counted():
    times = np.repeat(np.arange(10_000) * 7, 2)
    found, order = run(times, (5000, 13_000))
    assert found.t_us.tolist() == times.tolist()
    assert (order.moved, order.furthest_us) == (0, 0)


def test_merged_channels_come_out_in_order():
    rng = np.random.default_rng(5)
    times = np.arange(20_000) * 10
    order = np.argsort(times + rng.integers(0, WINDOW, len(times)), kind="stable")
    found, counted = run(times[order], (777, 9000))
    assert found.t_us.tolist() == times.tolist()
    behind = np.maximum.accumulate(times[order]) - times[order]
    assert (counted.moved, counted.furthest_us) == (np.count_nonzero(behind), behind.max())


def test_without_a_window_nothing_changes():
    found, order = run([5, 3, 9, 1], window=0)
    assert found.t_us.tolist() == [5, 3, 9, 1]
    assert order.moved == 0
