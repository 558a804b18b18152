"""A measured number that is also known to be more than something: moments of a truncated normal distribution."""

import numpy as np
import pytest

from dctorque_can.evidence.clutches import beyond
from dctorque_can.evidence.fits import Number


@pytest.mark.parametrize(("value", "sigma", "least"), [(2.0, 0.5, 2.3), (2.0, 0.5, 1.0), (-1.0, 2.0, 3.0)])
def test_moments_are_those_of_what_is_drawn(value: float, sigma: float, least: float) -> None:
    drawn = value + sigma * np.random.default_rng(1).standard_normal(4_000_000)
    drawn = drawn[drawn > least]
    found = beyond(Number(value, sigma, 1.0), least)
    assert found.value == pytest.approx(drawn.mean(), abs=0.01 * sigma)
    assert found.sigma == pytest.approx(drawn.std(), rel=0.02)


def test_far_from_the_bound_nothing_changes() -> None:
    assert beyond(Number(5.0, 0.1, 1.0), 2.0) == Number(pytest.approx(5.0), pytest.approx(0.1), 1.0)


def test_far_beyond_it_the_bound_is_the_number() -> None:
    found = beyond(Number(2.0, 0.01, 1.0), 3.0)
    assert found.value == pytest.approx(3.0, abs=0.01)
    assert found.sigma < 0.01
