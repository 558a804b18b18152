"""BLF objects that stand outside of containers, and times that no float holds."""

import numpy as np
import pytest

from ..reading import read
from .crafted import can_message, container, write_blf


def ids(path):
    frames, log = read(path)
    return frames.can_id.tolist(), log.problems


def test_objects_without_any_container(tmp_path):
    objects = [can_message(0x100 + k, ticks=k * 1_000_000) for k in range(5)]
    path = write_blf(tmp_path / "x.blf", *objects)
    frames, log = read(path)
    assert log.problems == []
    assert frames.can_id.tolist() == [0x100 + k for k in range(5)]
    np.testing.assert_array_equal(np.diff(frames.t_us), 1000)
    assert frames.data.tobytes() == b"12345678" * 5


def test_objects_before_between_and_behind_containers_keep_their_order(tmp_path):
    one, two, three, four, five = (can_message(k) for k in range(1, 6))
    path = write_blf(tmp_path / "x.blf", one, container(two), three, container(four), five)
    assert ids(path) == ([1, 2, 3, 4, 5], [])


def test_many_of_them(tmp_path):
    path = write_blf(
        tmp_path / "x.blf", *[can_message(k % 0x700) for k in range(60_000)]
    )  # more than is read at once
    found, problems = ids(path)
    assert found == [k % 0x700 for k in range(60_000)]
    assert problems == []


def test_one_that_is_cut_off_is_told(tmp_path):
    path = write_blf(tmp_path / "x.blf", can_message(1), can_message(2)[:-3])
    found, problems = ids(path)
    assert found == [1]
    assert len(problems) == 1


@pytest.mark.parametrize("ticks", [(1 << 53) - 1, 1 << 53, (1 << 53) + 1500, 10**17, (1 << 59) - 1])
def test_times_beyond_what_a_float_holds(tmp_path, ticks):
    path = write_blf(tmp_path / "x.blf", container(can_message(1, ticks=0) + can_message(2, ticks=ticks)))
    frames, log = read(path)
    assert log.problems == []
    passed = int(frames.t_us[1]) - int(frames.t_us[0])
    assert abs(1000 * passed - ticks) <= (500 if ticks >= 1 << 53 else 1500)


def test_times_that_mean_nothing_are_told(tmp_path):
    path = write_blf(tmp_path / "x.blf", container(can_message(1, ticks=1 << 62) + can_message(2)))
    found, problems = ids(path)
    assert found == [2]
    assert "1 damaged objects" in problems[0]
