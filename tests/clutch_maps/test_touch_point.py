"""The lower end of a map whose law is known."""

import numpy as np
import pytest

from dctorque_can.clutch_maps.touch_point import UNKNOWN, touch_of

GRID = np.linspace(1.8, 8.0, 24)


def fitted(point, p, a, noise_nm=1.0, highest=8.0, wrong_nm=0.0):
    torque = a * np.maximum(GRID - point, 0.0) ** p + wrong_nm
    covariance = noise_nm**2 * np.eye(len(GRID))
    return touch_of(GRID, torque, covariance, (GRID > 3.3) & (highest > GRID), (3.0, 0.6), 400.0)


@pytest.mark.parametrize("point", [2.4, 3.0, 3.6])
@pytest.mark.parametrize("p", [1.2, 1.5, 1.9])
def test_any_power_law_is_found(point, p):
    a = 30.0
    touch = fitted(point, p, a)
    assert abs(touch.point - point) < 2.0 * touch.point_sigma
    assert touch.point == pytest.approx(point, abs=0.15)
    way = (0.2 * 400.0 / a) ** (1.0 / p)  # from the touch point to where it carries a fifth of its capacity
    assert touch.slope == pytest.approx(a * p * way ** (p - 1.0), rel=0.05)


def test_noisier_nodes_make_it_less_sure():
    sigmas = [fitted(3.0, 1.5, 25.0, noise).point_sigma for noise in (0.5, 2.0, 8.0)]
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] < 1.2  # what is believed beforehand stays


def test_its_sigma_is_the_scatter_of_many_fits():
    random = np.random.default_rng(5)
    noise = 2.0
    points = []
    for _ in range(200):
        torque = 25.0 * np.maximum(GRID - 3.0, 0.0) ** 1.5 + noise * random.standard_normal(len(GRID))
        seen = (GRID > 3.3) & (GRID < 7.0)
        touch = touch_of(GRID, torque, noise**2 * np.eye(len(GRID)), seen, (3.0, 0.6), 400.0)
        points.append(touch.point)
    assert np.std(points) < touch.point_sigma  # beliefs beforehand and an allowance for the law on top
    assert abs(np.mean(points) - 3.0) < touch.point_sigma


def test_too_little_is_not_known():
    none = np.zeros(24, np.bool_)
    torque = 25.0 * np.maximum(GRID - 3.0, 0.0) ** 1.5
    assert touch_of(GRID, torque, np.eye(24), none, (3.0, 0.6), 400.0) is UNKNOWN
    assert touch_of(GRID, 0.01 * torque, np.eye(24), ~none, (3.0, 0.6), 400.0) is UNKNOWN
