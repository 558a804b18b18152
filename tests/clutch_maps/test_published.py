"""What is published of a map: rising, slow, and valid only where it has seen enough."""

import numpy as np
import pytest
from scipy.optimize import isotonic_regression

from dctorque_can.clutch_maps.learner import Learner
from dctorque_can.clutch_maps.published import Published, rising
from dctorque_can.clutch_maps.settings import NODES

from .car import capacity, settings


def learner(rules, count=400, friction=1.0, most_mm=7.0):
    one = Learner(rules.clutches[0], 400.0, rules)
    random = np.random.default_rng(6)
    for k in range(count):
        x = float(random.uniform(3.5, most_mm))
        one.take(k * 50_000, x, 0.0, float(capacity(x, friction) + 3.0 * random.standard_normal()), 3.0, 60.0, 0.0)
    return one


def test_a_dip_is_levelled_and_told_in_sigma():
    rules = settings()
    one, shown = learner(rules), Published(rules)
    one.x[12] = one.x[10] - 20.0
    shown.renew(one, 0.0, 1.0)
    assert np.diff(shown.raw_nm).min() < 0.0
    assert np.diff(shown.capacity_nm).min() >= 0.0
    assert shown.capacity_nm.min() >= 0.0
    moved = np.abs(shown.capacity_nm - shown.raw_nm)
    assert moved.max() > 5.0
    assert np.all(shown.sigma_nm >= moved)


def test_what_rises_is_what_scipy_finds():
    random = np.random.default_rng(9)
    for _ in range(20):
        values, weights = random.standard_normal(24).cumsum(), random.uniform(0.1, 5.0, 24)
        np.testing.assert_allclose(rising(values, weights), isotonic_regression(values, weights=weights).x)


def test_a_node_moves_no_faster_than_may_be_and_says_so():
    rules = settings(node_speed_nm_s=10.0)
    shown = Published(rules)
    shown.renew(learner(rules), 0.0, 1.0)
    before = shown.capacity_nm.copy()
    was = shown.valid.copy()
    shown.renew(learner(rules, friction=0.6), 0.0, 1.5)
    assert np.abs(shown.capacity_nm - before)[was].max() == pytest.approx(5.0)
    left = np.abs(shown.capacity_nm - shown.raw_nm)[was]
    assert left.max() > 10.0
    assert np.all(shown.sigma_nm[was] >= left)


def test_nodes_are_valid_where_enough_was_seen():
    rules = settings()
    shown = Published(rules)
    shown.renew(learner(rules), 0.0, 1.0)
    x = shown.grid[shown.valid]
    assert x.min() > 3.5 - 0.25
    assert x.max() < 7.0 + 0.25
    assert len(x) > 8
    few = Published(rules)
    few.renew(learner(rules, count=4), 0.0, 0.2)
    assert not few.valid.any()


def test_a_grid_that_has_grown_is_followed():
    rules = settings(node_speed_nm_s=1.0)
    one, shown = learner(rules), Published(rules)
    shown.renew(one, 0.0, 1.0)
    at_6 = np.interp(6.0, shown.grid, shown.capacity_nm)
    one.take(10**9, one.left + 1.5 * one.span, 0.0, 400.0, 1e4, 60.0, 0.0)
    shown.renew(one, 0.0, 1.0)
    assert len(shown.grid) == NODES
    assert np.interp(6.0, shown.grid, shown.capacity_nm) == pytest.approx(at_6, abs=3.0)
