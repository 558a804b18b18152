"""Noise that is not as told, learned from innovations whose variance is known."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman.learning import forget_noise, learn_noise, noise_factor
from dctorque_can.estimators.kalman.tuning import tuning as tuning_of
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
TUNING = tuning_of(SETTINGS.vehicle, SETTINGS.kalman)[0]
SHAFT, CONFIGURED = 1, 0.01


def fresh(gears=(1, 2), rates=(1.0, 1.0)):
    """A filter at the start; clutch torques change by these multiples of the steady rate."""
    f = np.zeros(1, kalman.FILTER)[0]
    f["gear"][:] = gears
    f["torque_rate"][:] = np.array(rates) * TUNING["steady_rate"]
    forget_noise(f)
    return f


def drive(f, ratio, known, samples, seed=1):
    """Innovations of a sensor whose noise has ``ratio`` times the configured variance."""
    for e in np.random.default_rng(seed).normal(0.0, np.sqrt(known + ratio * CONFIGURED), samples):
        learn_noise(f, TUNING, SHAFT, e, known, CONFIGURED * noise_factor(f, TUNING, SHAFT))


@pytest.mark.parametrize("known", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("ratio", [4.0, 25.0])
def test_the_true_variance_is_found_whatever_the_prediction_is_worth(ratio, known):
    f = fresh()
    drive(f, ratio, known, 4000)
    assert noise_factor(f, TUNING, SHAFT) == pytest.approx(ratio, rel=0.25)
    assert noise_factor(f, TUNING, 0) == noise_factor(f, TUNING, 2) == 1.0


def test_a_hundred_samples_tell_most_of_it():
    """At the start the configured variance counts like fifty samples: 1 + 8 · 100/150."""
    f = fresh()
    drive(f, 9.0, 0.0, 100)
    assert noise_factor(f, TUNING, SHAFT) == pytest.approx(1 + 8 * 2 / 3, rel=0.3)


def test_less_than_configured_is_believed_down_to_a_quarter():
    f = fresh()
    drive(f, 0.5, 0.005, 4000)
    assert noise_factor(f, TUNING, SHAFT) == pytest.approx(0.5, rel=0.25)
    drive(f, 0.05, 0.002, 4000)
    assert noise_factor(f, TUNING, SHAFT) == 0.25
    assert 0.0 <= f["noise_ratio"][SHAFT] < 0.25
    drive(f, 9.0, 0.005, 1500)  # and what comes later is not missed
    assert noise_factor(f, TUNING, SHAFT) == pytest.approx(9.0, rel=0.25)


def test_less_than_the_resolution_is_never_believed():
    """0.06 rad/s on one of the wheels: q²/12 of its 0.02² + q²/12 rad²/s² is three sevenths."""
    design = replace(SETTINGS.kalman, speed_resolutions_rad_s=(0.0, 0.0, 0.0, 0.0, 0.0, 0.06, 0.0))
    least = tuning_of(SETTINGS.vehicle, design)["least_noise"][0]
    np.testing.assert_allclose(least, [0.25, 0.25, 0.25, 3 / 7, 3 / 7])


def test_a_shift_teaches_nothing():
    for rates in ((10.0, 1.0), (1.0, 10.0)):
        f = fresh(rates=rates)
        drive(f, 25.0, 0.01, 500)
        assert noise_factor(f, TUNING, SHAFT) == 1.0
    f = fresh(gears=(1, 0), rates=(1.0, 10.0))  # a synchroniser on the other shaft does not matter
    drive(f, 25.0, 0.01, 500)
    assert noise_factor(f, TUNING, SHAFT) > 10


def test_a_start_forgets():
    f = fresh()
    drive(f, 25.0, 0.01, 500)
    kalman.start(f, TUNING, 200.0, 150.0, 100.0, 10.0, 80.0)
    assert noise_factor(f, TUNING, SHAFT) == 1.0
