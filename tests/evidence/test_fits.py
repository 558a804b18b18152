"""Robust fits against numbers that are known."""

import numpy as np
import pytest

from dctorque_can.evidence.fits import BLOCK_S, Number, fit, median, slope

STEP_S = 0.01
T_S = np.arange(0.0, 120.0, STEP_S)


def lasting_noise(random, sigma):
    """White noise from block to block, the same within one."""
    return np.repeat(random.normal(0.0, sigma, 60), round(BLOCK_S / STEP_S))


def test_a_line_with_outliers():
    random = np.random.default_rng(1)
    x = np.sin(T_S)
    y = 3.0 * x + 0.5 + random.normal(0.0, 0.1, len(x))
    y[::50] += 30.0
    found = fit(T_S, [x, np.ones(len(x))], y, STEP_S)
    assert found.values == pytest.approx([3.0, 0.5], abs=0.01)
    assert found.seconds == pytest.approx(120.0)


@pytest.mark.parametrize("what", ["median", "fit"])
def test_sigma_is_that_of_repeated_recordings(what):
    """Errors that last for a block count once: the standard error is theirs, not that of single moments."""
    random = np.random.default_rng(2)
    numbers = []
    for _ in range(200):
        values = 5.0 + lasting_noise(random, 1.0)
        number = (
            median(T_S, values, STEP_S)
            if what == "median"
            else fit(T_S, [np.ones(len(T_S))], values, STEP_S).number(0)
        )
        numbers.append((number.value, number.sigma))
    values, sigmas = np.array(numbers).T
    assert values.mean() == pytest.approx(5.0, abs=0.05)
    assert np.median(sigmas) == pytest.approx(values.std(), rel=0.25)


def test_a_slope_between_two_signals_with_errors():
    """Both regressions are off by a fifth of the variance, one to either side; the truth is between them."""
    random = np.random.default_rng(4)
    true = lasting_noise(random, 1.0)
    x, y = (k * true + random.normal(0.0, 0.5 * k, len(T_S)) for k in (1.0, 3.0))
    found = slope(T_S, x, y, [np.ones(len(T_S))], STEP_S)
    assert found.least.value == pytest.approx(3.0 / 1.25, rel=0.03)
    assert found.number.value == pytest.approx(3.0, rel=0.02)
    assert found.number.sigma > abs(3.0 * 1.25 - 3.0 / 1.25) / 4.0
    assert found.correlation == pytest.approx(0.8, abs=0.02)
    assert slope(T_S, x, -y, [], STEP_S).correlation == pytest.approx(-0.8, abs=0.02)
    other = slope(T_S, lasting_noise(random, 1.0), true, [], STEP_S)
    assert abs(other.correlation) < 0.3
    assert other.number.sigma > abs(other.number.value)


def test_too_little():
    assert median(T_S[:300], T_S[:300], STEP_S) is None  # two blocks
    assert fit(T_S[:400], [np.ones(400)], np.ones(400), STEP_S) is None
    ones = np.ones(len(T_S))
    assert fit(T_S, [ones, 2.0 * ones], ones, STEP_S) is None  # cannot be told apart


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (3.0561, 0.0123, "3.056 ± 0.012"),
        (1410.4, 63.0, "1410 ± 63"),
        (31.2, 2.1, "31 ± 2"),
        (0.93, 0.0, "0.9300 ± 0.0009"),
    ],
)
def test_shown_to_the_digits_that_sigma_leaves(value, sigma, text):
    assert Number(value, sigma, 1.0).shown() == text


def test_off_beyond_both_uncertainties():
    number = Number(1.0, 0.3, 1.0)
    assert not number.is_off(0.0, 0.4)  # 1 < 3 · 0.5
    assert number.is_off(0.0, 0.1)  # 1 > 3 · 0.316
