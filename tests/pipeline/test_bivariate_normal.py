"""The quadrant probability against scipy, against an integral of one variable, and where it has a closed form."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from dctorque_can.pipeline.bivariate_normal import normal_cdf, upper_quadrant

CORRELATIONS = (0.0, 0.2, -0.7, 0.9, 0.9249999, -0.925, 0.97, -0.999, 0.999999, -0.99999999)


def conditional_integral(h, k, r):
    """∫ φ(x) P(Y > k | x) dx over x > h, cut where the conditional probability is steep."""
    spread = math.sqrt((1.0 - r) * (1.0 + r))
    steep = [(k + m * spread) / r for m in (-8, -3, 0, 3, 8)] if r else []
    edges = sorted([h, *(x for x in steep if h < x < h + 20.0)])
    edges.append(max(edges[-1], 0.0) + 12.0)

    def density(x):  # φ and Φ of the standard library: those of scipy.stats take fifty times as long
        return (
            math.exp(-0.5 * x * x) / math.sqrt(math.tau) * 0.5 * math.erfc(-(r * x - k) / spread / math.sqrt(2.0))
        )

    return sum(quad(density, a, b, epsabs=1e-14)[0] for a, b in pairwise(edges))


@pytest.mark.parametrize("r", CORRELATIONS)
def test_against_an_integral_of_one_variable(r):
    random = np.random.default_rng(1)
    for h, k in random.uniform(-5.0, 5.0, (30, 2)):
        assert upper_quadrant(h, k, r) == pytest.approx(conditional_integral(h, k, r), abs=1e-13)


@pytest.mark.parametrize("r", CORRELATIONS)
def test_against_scipy(r):
    random = np.random.default_rng(2)
    normal = multivariate_normal(cov=[[1.0, r], [r, 1.0]], allow_singular=True)
    for h, k in random.uniform(-3.0, 3.0, (20, 2)):
        assert upper_quadrant(h, k, r) == pytest.approx(normal.cdf([-h, -k]), abs=2e-5)  # scipy's own tolerance


@pytest.mark.parametrize("r", CORRELATIONS)
def test_at_the_origin(r):
    """P(X > 0, Y > 0) = 1/4 + asin(r)/2π (Sheppard)."""
    assert upper_quadrant(0.0, 0.0, r) == pytest.approx(0.25 + math.asin(r) / math.tau, abs=1e-15)


@pytest.mark.parametrize(("h", "k"), [(0.3, -0.2), (-1.0, 2.0), (-2.0, -2.5), (1.5, 1.5)])
def test_full_correlation(h, k):
    """At r = 1 both are one variable, at r = −1 Y is −X."""
    assert upper_quadrant(h, k, 1.0) == pytest.approx(norm.sf(max(h, k)), abs=1e-15)
    assert upper_quadrant(h, k, -1.0) == pytest.approx(max(0.0, norm.cdf(-k) - norm.cdf(h)), abs=1e-15)


@pytest.mark.parametrize("r", CORRELATIONS)
def test_far_away(r):
    """Torques that are known well give bounds of thousands of standard deviations."""
    assert upper_quadrant(1e4, 0.0, r) == upper_quadrant(-1.0, 1e300, r) == 0.0
    assert upper_quadrant(-1e4, 0.5, r) == pytest.approx(norm.sf(0.5), abs=1e-15)
    assert upper_quadrant(-1e300, -1e4, r) == pytest.approx(1.0, abs=1e-15)


def test_one_variable():
    x = np.linspace(-8.0, 8.0, 33)
    np.testing.assert_allclose([normal_cdf(each) for each in x], norm.cdf(x), rtol=1e-13)
