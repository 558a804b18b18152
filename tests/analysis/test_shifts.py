"""Shifts found in hand-made phases."""

import numpy as np
import pytest

from dctorque_can.analysis.shifts import Shift, find_shifts
from dctorque_can.driveline.phases import ClutchPhase

OP, S, L = ClutchPhase.OPEN, ClutchPhase.SLIPPING, ClutchPhase.LOCKED


def rows(phase1, phase2, gear1=1, gear2=2):
    table = np.zeros(len(phase1), [("phase1", "u1"), ("phase2", "u1"), ("gear1", "i1"), ("gear2", "i1")])
    table["phase1"], table["phase2"], table["gear1"], table["gear2"] = phase1, phase2, gear1, gear2
    return table


def test_a_launch_is_no_shift():
    assert find_shifts(rows([OP, S, S, L, L], [OP] * 5)) == []


def test_up_and_down():
    up = find_shifts(rows([L, L, L, S, S, OP, OP], [OP, OP, S, S, S, L, L]))
    assert up == [Shift(2, 5, 1, 2)]
    assert up[0].is_up
    down = find_shifts(rows([OP, OP, S, S, L], [L, L, S, OP, OP]))
    assert down == [Shift(2, 4, 2, 1)]
    assert not down[0].is_up


def test_a_shift_given_up_is_none():
    assert find_shifts(rows([L, L, S, L, L], [OP, S, S, OP, OP])) == []


def test_a_stop_in_between_is_no_shift():
    """The off-going clutch opened, its shaft went to neutral, and the car started on the other shaft."""
    gear1 = np.array([1, 1, 0, 0, 0, 0])
    assert find_shifts(rows([L, L, OP, OP, OP, OP], [OP, OP, OP, S, S, L], gear1)) == []


@pytest.mark.parametrize("n", [0, 1])
def test_nothing(n):
    assert find_shifts(rows([OP] * n, [OP] * n)) == []
