"""Timeouts that are learned from how often an input comes."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.pipeline.estimator import Estimator

from .drives import SETTINGS, Q, locked_in_first, traffic

WHEELS = (Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR, Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR)
LEARNS = replace(
    SETTINGS,
    inputs=tuple(replace(i, learns_timeout=i.quantity in WHEELS, timeout_us=2_000_000) for i in SETTINGS.inputs),
)


def thinned(seconds, every, silent_from_us=None, silent_us=0):
    """Return traffic in which one in ``every`` frames of the wheels comes, but for a silence."""
    data = traffic(seconds, locked_in_first()[0])
    wheels = np.isin(data.quantity, WHEELS)
    times = np.unique(data.t_us[wheels])
    kept = ~wheels | np.isin(data.t_us, times[::every])
    if silent_from_us is not None:
        kept &= ~(wheels & (data.t_us > silent_from_us) & (data.t_us <= silent_from_us + silent_us))
    return data[kept]


def timeouts(settings, data):
    estimator = Estimator(settings)
    estimator.feed(data)
    return int(estimator.health["timeouts"][0][Q.WHEEL_SPEED_RL])


def stale_at_us(settings, data):
    """Return when the wheels of the rear axle are first older than their timeout."""
    for end_us in range(2_010_000, 3_000_000, 10_000):
        if timeouts(settings, data[data.t_us <= end_us]):
            return end_us
    return None


@pytest.mark.parametrize(("every", "expected_us"), [(1, 50_000), (5, 250_000)])
def test_five_intervals_are_a_timeout(every, expected_us):
    data = thinned(3.0, every, 2_000_000, 800_000)
    last_us = data.t_us[(data.quantity == Q.WHEEL_SPEED_RL) & (data.t_us <= 2_000_000)].max()
    assert stale_at_us(LEARNS, data) - last_us == pytest.approx(expected_us, abs=12_500)


def test_a_slow_input_is_not_stale_again_and_again():
    fixed = replace(SETTINGS, inputs=tuple(replace(i, timeout_us=100_000) for i in SETTINGS.inputs))
    data = thinned(6.0, 20)  # every 0.2 s
    assert timeouts(fixed, data) > 20
    assert timeouts(LEARNS, data) <= 9  # while it learns


def test_a_bus_that_loses_more_and_more_does_not_move_it():
    usual, thin = thinned(3.0, 1), thinned(9.0, 30)
    thin = thin[thin.t_us > usual.t_us[-1]]
    both = usual[:0]
    both = replace(both, **{n: np.concatenate([getattr(usual, n), getattr(thin, n)]) for n in both.__slots__})
    assert timeouts(LEARNS, both) > 15


def test_a_few_doubles_and_gaps_move_nothing():
    data = traffic(2.0, locked_in_first()[0])
    estimator = Estimator(LEARNS)
    rng = np.random.default_rng(2)
    wheels = np.isin(data.quantity, WHEELS)
    lost = np.isin(data.t_us, rng.choice(np.unique(data.t_us[wheels]), 20, replace=False))
    estimator.feed(data[~(wheels & lost)])
    assert int(estimator.health["timeouts"][0][Q.WHEEL_SPEED_RL]) == 0
