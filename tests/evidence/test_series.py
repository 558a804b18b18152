"""A recording as time series, against the truth of the car that made it."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.evidence.series import UNKNOWN_GEAR, Signal, decoded
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config


@pytest.fixture(scope="module")
def drive():
    config = load_config(shipped_config("paper_car"))
    return config, simulate_car(config, DriveName.PAPER, ProfileName.LABORATORY, 1, 6.0)


def test_speeds_and_gears_are_those_of_the_truth(drive):
    config, driven = drive
    series = decoded([driven.frames[:5000], driven.frames[5000:]], config)
    truth = driven.truth
    t_s = (truth["t_us"] - truth["t_us"][0]) * 1e-6
    known = slice(100, -100)
    speed = series.on(Quantity.ENGINE_SPEED, t_s)[known]
    assert np.abs(speed - truth["engine_speed_rad_s"][known]).max() < 6 * 0.3  # noise of the laboratory
    assert (
        series.gears(1, t_s)[known] == np.where(truth["changing1"] == 1, 0, truth["gear1"])[known]
    ).mean() > 0.99
    closed = series.closes_by(1, t_s)[known] > 0.0
    assert (closed == (truth["clutch1_capacity_nm"][known] > 0.0)).mean() > 0.98
    assert series.seconds == pytest.approx(6.0, abs=0.01)
    assert Quantity.ACCELERATION not in series.signals


def test_the_clock_goes_on(drive):
    """A second half whose clock begins anew counts on where the first one ends."""
    config, driven = drive
    half = len(driven.frames) // 2
    frames = driven.frames[half:]
    again = replace(frames, t_us=frames.t_us - 3_600_000_000)
    series = decoded([driven.frames[:half], again], config)
    assert series.seconds == pytest.approx(6.0, abs=0.01)
    assert all((np.diff(signal.t_s) >= 0).all() for signal in series.signals.values())


def test_values_beyond_the_range(drive):
    _, driven = drive
    narrow = load_config(shipped_config("paper_car"), {"inputs.engine_speed.range": "[0, 300]"})
    assert Quantity.ENGINE_SPEED not in decoded([driven.frames], narrow).signals
    assert len(decoded([driven.frames], narrow, any_value=True).signals[Quantity.ENGINE_SPEED]) > 5000


def test_a_signal_between_its_samples():
    signal = Signal(np.array([0.0, 1.0, 2.0, 9.0]), np.array([0.0, 2.0, 4.0, 5.0]))
    assert signal.at(np.array([0.5, 1.5, 5.0, 10.0]), 2.0) == pytest.approx(
        [1.0, 3.0, np.nan, np.nan], nan_ok=True
    )
    assert signal.held(np.array([-1.0, 1.9, 3.5]), 1.0) == pytest.approx([np.nan, 2.0, np.nan], nan_ok=True)
    assert signal.sooner(0.25).t_s[0] == -0.25
    assert UNKNOWN_GEAR not in range(-1, 16)
