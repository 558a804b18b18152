"""A noise that is clearly another than told is proposed as the key to set; sound sensors are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.analysis.noise_hints import noise_hints
from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import HEALTH
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, mixed_drive, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, emit_frames

CONFIG = load_config(shipped_config("paper_car"))


def health(learned, samples=1000.0):
    record = np.zeros(1, HEALTH)
    record["speed_noise_told_rad_s"] = (0.1, 0.1, 0.1, 0.02, 0.02)
    record["speed_noise_rad_s"] = learned
    record["speed_noise_samples"] = samples
    return record


def test_what_is_as_told_is_left_alone():
    assert noise_hints(health((0.1, 0.06, 0.1, 0.035, 0.011))) == []
    assert noise_hints(health((0.9, 0.0, 0.0, 0.2, 0.2), samples=399.0)) == []
    assert noise_hints(np.zeros(1, HEALTH)) == []  # of the 2014 observer


def test_the_sentence_names_the_key_and_the_value():
    """Of two axles the mean of the variances: √((0.10² + 0.12²)/2) = 0.1105."""
    (hint,) = noise_hints(health((0.1, 0.1, 0.1, 0.10, 0.12)))
    key = "estimator.kalman.wheel_speed_noise_rad_s"
    assert (hint["key"], hint["value"]) == (key, 0.11)
    assert hint["says"] == f"wheels: noise 0.11 rad/s rather than 0.02: set {key}: 0.11"


def test_an_axle_that_has_not_been_learned_does_not_count():
    (hint,) = noise_hints(health((0.1, 0.1, 0.1, 5.0, 0.06), (1000.0, 1000.0, 1000.0, 10.0, 1000.0)))
    assert hint["value"] == 0.06


def test_less_than_half_is_not_proposed():
    (hint,) = noise_hints(health((0.01, 0.1, 0.1, 0.02, 0.02)))
    assert (hint["key"], hint["value"]) == ("estimator.kalman.engine_speed_noise_rad_s", 0.05)
    assert "noise less than 0.05 rad/s rather than 0.1" in hint["says"]


@pytest.fixture(scope="module")
def traffic():
    return simulate(CONFIG.settings.vehicle, mixed_drive(CONFIG.settings.vehicle, 2, 180.0))


def hints_after(truth, profile, config=CONFIG):
    frames = emit_frames(truth, config.settings.vehicle, replace(profile, seed=6), config.database)
    estimator = Estimator(config.settings)
    estimator.feed(Decoder(config.database, config.inputs, config.protections).decode(frames))
    return {hint["key"].rsplit(".", 1)[1]: hint["value"] for hint in noise_hints(estimator.health)}


def test_wheels_of_a_real_car_in_traffic(traffic):
    """Within a tenth of the noise that they were given; after it has been set, nothing is said any more."""
    noisy = replace(PRODUCTION, noise=replace(PRODUCTION.noise, wheel_speed_rad_s=0.11))
    hints = hints_after(traffic, noisy)
    assert list(hints) == ["wheel_speed_noise_rad_s"]
    value = hints["wheel_speed_noise_rad_s"]
    assert value == pytest.approx(0.11, rel=0.1)
    told = {"estimator.kalman.wheel_speed_noise_rad_s": str(value)}
    assert hints_after(traffic, noisy, load_config(shipped_config("paper_car"), told)) == {}


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"vehicle.chassis.mass_kg": "1900"},
        {"vehicle.engine_inertia_kgm2": "0.17"},
        {"inputs.engine_torque.factor": "1.08"},
    ],
)
def test_sound_sensors_are_never_called_faulty(traffic, wrong):
    """Nor are they when the vehicle file is somewhat wrong."""
    assert hints_after(traffic, PRODUCTION, load_config(shipped_config("paper_car"), wrong)) == {}


def test_the_laboratory_is_noisier_than_a_production_car():
    """Engine and shafts have 0.3 rad/s there."""
    hints = hints_after(simulate(CONFIG.settings.vehicle, PAPER), LABORATORY)
    assert hints == {
        "engine_speed_noise_rad_s": pytest.approx(0.3, rel=0.1),
        "shaft_speed_noise_rad_s": pytest.approx(0.3, rel=0.1),
    }
