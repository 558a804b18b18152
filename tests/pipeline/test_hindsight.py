"""Movements noted and foretold: which way a car went, from its first moment on."""

import numpy as np
import pytest

from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.hindsight import DIARY, MOVEMENTS, Hindsight, against_gears, foretold, forget, note


def noted(diary, *events):
    """Events: (ms, moves, way)."""
    for ms, moves, way in events:
        note(diary[0], 1000 * ms, moves, way)


def told(diary, *ms):
    return [foretold(diary[0], 1000 * t) for t in ms]


@pytest.fixture
def diary():
    return np.zeros(1, DIARY)


def test_rolling_back_and_setting_off(diary):
    """Each way holds from the first moment on; it changes in the middle of the standstill."""
    hindsight = Hindsight(diary)
    noted(diary, (0, False, 0), (1000, True, 0), (1400, True, -1), (2000, False, 0))
    noted(diary, (2300, True, 0), (2900, True, 1), (9000, False, 0))
    hindsight.collect(diary)
    assert told(diary, 1500) == [0]  # online nothing is
    hindsight.foretell(diary, 0)
    assert told(diary, 0, 1000, 1200, 1999, 2149, 2151, 2300, 8999, 20_000) == [-1, -1, -1, -1, -1, 1, 1, 1, 1]
    rows = np.zeros(4, ESTIMATE)
    rows["t_us"], rows["gear1"] = [1_500_000, 1_500_000, 5_000_000, 5_000_000], [1, -1, 1, -1]
    assert against_gears(diary, rows).tolist() == [True, False, False, True]


def test_the_last_word_counts_and_doubt_stays(diary):
    hindsight = Hindsight(diary)
    noted(
        diary, (0, True, 1), (500, True, 0), (600, True, -1), (1000, False, 0), (2000, True, 0), (3000, False, 0)
    )
    hindsight.collect(diary)
    hindsight.foretell(diary, 0)
    assert told(diary, 0, 1400, 1600, 2500) == [-1, -1, 0, 0]


def test_a_movement_over_several_stretches(diary):
    """What a later stretch decides is told in all before it, and what comes next in the one before."""
    hindsight = Hindsight(diary)
    noted(diary, (0, True, 0))
    hindsight.collect(diary)
    noted(diary, (1000, True, 0))
    hindsight.collect(diary)
    noted(diary, (2000, True, 1), (3000, False, 0))
    hindsight.collect(diary)
    noted(diary, (5000, True, -1))
    hindsight.collect(diary)
    for n in range(3):
        hindsight.foretell(diary, n)
        assert told(diary, 0, 1500, 3500) == [1, 1, 1], n
    assert told(diary, 4500) == [-1]
    hindsight.foretell(diary, 3)
    assert told(diary, 4500, 6000) == [-1, -1]


def test_nothing_is_told_across_a_reset(diary):
    """The clock may have been set: the time before says nothing of that after."""
    hindsight = Hindsight(diary)
    noted(diary, (0, True, 1))
    hindsight.collect(diary)
    forget(diary[0])
    noted(diary, (500, True, -1))
    hindsight.collect(diary)
    noted(diary, (1500, True, -1))
    hindsight.collect(diary)
    hindsight.foretell(diary, 0)
    assert told(diary, 100) == [1]
    hindsight.foretell(diary, 1)
    assert told(diary, 100, 700) == [0, 0]
    hindsight.foretell(diary, 2)
    assert told(diary, 700) == [0]


def test_more_movements_than_can_be_noted(diary):
    """Then nothing is told of that stretch; a later one is as any other."""
    hindsight = Hindsight(diary)
    for n in range(MOVEMENTS + 3):
        noted(diary, (100 * n, True, 1), (100 * n + 50, False, 0))
    hindsight.collect(diary)
    noted(diary, (5000, True, -1), (6000, False, 0))
    hindsight.collect(diary)
    hindsight.foretell(diary, 0)
    assert told(diary, 0, 500, 1000) == [0, 0, 0]
    hindsight.foretell(diary, 1)
    assert told(diary, 5500) == [-1]
