"""What the filter learns of a clutch that is known, and what it never claims to know."""

import numpy as np
import pytest

from dctorque_can.clutch_maps import learner as states
from dctorque_can.clutch_maps import prior
from dctorque_can.clutch_maps.learner import Learner, hat
from dctorque_can.clutch_maps.settings import NODES

from .car import TOUCH_MM, capacity, settings

STEP_US = 50_000


def taught(count, seed=1, friction=lambda k: 1.0, noise=3.0, most_mm=7.5, **changes):
    """Return a learner that has seen ``count`` windows at positions across the range."""
    rules = settings(**changes)
    learner = Learner(rules.clutches[0], 400.0, rules)
    random = np.random.default_rng(seed)
    for k in range(count):
        x = float(random.uniform(3.3, most_mm))
        torque = float(capacity(x, friction(k)) + noise * random.standard_normal())
        learner.take(k * STEP_US, x, float(random.uniform(-3.0, 3.0)), torque, noise, 60.0, 0.0)
    return learner


def errors(learner, friction=1.0):
    """Return error and σ at the nodes in the range that was seen."""
    torque, covariance = learner.curve(0.0)
    seen = (learner.grid > learner.seen[0]) & (learner.grid < learner.seen[1])
    return (torque - capacity(learner.grid, friction))[seen], np.sqrt(np.diagonal(covariance))[seen]


def test_the_characteristic_is_found_within_its_sigma():
    error, sigma = errors(taught(600))
    assert np.sqrt(np.mean(error**2)) < 0.02 * 170.0  # of an engine's torque
    assert np.mean(np.abs(error) < 2.0 * sigma) >= 0.9
    assert len(error) >= 8


def test_an_error_of_the_estimate_that_lasts_is_never_averaged_away():
    """A gain of 5 % that nobody knows: the σ of a node stays above what it falsifies, however much it sees."""
    few, many = taught(300), taught(3000)
    for learner in (few, many):
        torque, covariance = learner.curve(0.0)
        node = int(np.searchsorted(learner.grid, 6.0))
        assert np.sqrt(covariance[node, node]) > 0.05 * torque[node]
        assert learner.P[states.OFFSET, states.OFFSET] == pytest.approx(9.0, rel=0.2)


def test_friction_that_drifts_by_thirty_percent_is_followed():
    """Within 20 minutes, a window every second: 6000 s/s as traffic has it."""
    rules = settings()
    learner = Learner(rules.clutches[0], 400.0, rules)
    random = np.random.default_rng(2)
    held = []
    for second in range(1200):
        friction = 1.0 - 0.3 * second / 1200.0
        x = float(random.uniform(3.5, 7.0))
        torque = float(capacity(x, friction) + 4.0 * random.standard_normal())
        learner.take(second * 1_000_000, x, 0.0, torque, 4.0, 60.0, 0.0)
        if second % 60 == 59:
            error, sigma = errors(learner, friction)
            held.append(np.abs(error) < 2.0 * sigma)
    assert np.mean(np.concatenate(held)) >= 0.9
    error, _ = errors(learner, 0.7)
    assert np.sqrt(np.mean(error**2)) < 0.02 * 170.0
    index = np.exp(learner.x[states.FRICTION])
    assert index == pytest.approx(0.7, abs=2.0 * index * np.sqrt(learner.P[states.FRICTION, states.FRICTION]))


def test_the_touch_point_that_moves_is_followed():
    rules = settings()
    learner = Learner(rules.clutches[0], 400.0, rules)
    random = np.random.default_rng(3)
    for k in range(2000):
        shift = -0.5 * max(k - 1000, 0) / 1000.0
        x = float(random.uniform(3.3, 7.0))
        torque = float(capacity(x, 1.0, shift) + 3.0 * random.standard_normal())
        learner.take(k * 500_000, x, 0.0, torque, 3.0, 60.0, 0.0)
    torque, _ = learner.curve(0.0)
    node = int(np.searchsorted(learner.grid, 5.0))
    assert torque[node] == pytest.approx(capacity(learner.grid[node], 1.0, -0.5), abs=6.0)


def test_what_is_far_beyond_all_doubt_is_refused():
    learner = taught(400)
    before = learner.x.copy()
    assert learner.take(401 * STEP_US, 6.0, 0.0, 400.0, 3.0, 60.0, 0.0) is None
    assert learner.refused == 1
    np.testing.assert_array_equal(learner.x, before)


def test_a_range_that_grows_keeps_what_was_learned():
    """The span doubles; the nodes that were between the old ones' ends stay where they were."""
    learner = taught(300, most_mm=6.0)
    inside = np.linspace(3.5, 6.0, 9)
    before = [float(hat(x, learner.left, learner.span)[0] @ learner.x[:NODES]) for x in inside]
    span = learner.span
    learner.take(400 * STEP_US, learner.left + 1.5 * span, 0.0, 300.0, 1e4, 60.0, 0.0)
    assert learner.span == 2.0 * span
    after = [float(hat(x, learner.left, learner.span)[0] @ learner.x[:NODES]) for x in inside]
    np.testing.assert_allclose(after, before, atol=1.5)
    assert np.linalg.eigvalsh(learner.P).min() > -1e-6


def test_the_conditional_of_the_prior_is_that_of_the_joint_normal_distribution():
    """Schur complement by hand; what both grids share is carried over as it is."""
    new = np.linspace(0.0, 1.0, 8)
    old = 0.5 * new
    joint = prior.covariance(np.concatenate([old, new]), np.concatenate([old, new]))
    a, left_open = prior.twice_the_span(8)
    regression = joint[8:, :8] @ np.linalg.inv(joint[:8, :8])
    np.testing.assert_allclose(a, regression, atol=1e-4)
    np.testing.assert_allclose(left_open, joint[8:, 8:] - regression @ joint[:8, 8:], atol=1e-6)
    assert left_open[1, 1] < 1e-6 < left_open[-1, -1]


def test_a_node_has_its_value_and_between_two_it_is_straight():
    weights, slopes = hat(2.5, 0.0, NODES - 1.0)
    assert weights[2] == weights[3] == 0.5
    assert slopes[3] == 1.0 == -slopes[2]
    assert hat(-5.0, 0.0, 1.0)[0][0] == 1.0
    assert hat(+5.0, 0.0, 1.0)[0][-1] == 1.0


def test_a_rest_makes_less_sure():
    learner = taught(300)
    before = np.sqrt(np.diagonal(learner.curve(0.0)[1]))
    learner.rest()
    after = np.sqrt(np.diagonal(learner.curve(0.0)[1]))
    seen = learner.grid > TOUCH_MM
    assert np.all(after[seen] > before[seen])
