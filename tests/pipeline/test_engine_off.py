"""An engine that is off has no torque of its own, whatever is told of it: no fault, and nothing learned."""

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator

from .manoeuvres import config, driven, frames_of, wrong_ms

FAULTS = Status.ENGINE_SPEED_FAULT | Status.ENGINE_TORQUE_FAULT


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
@pytest.mark.parametrize("told_nm", [-60.0, 0.0, 40.0])
def test_what_is_told_of_an_engine_that_is_off_does_not_count(car, told_nm):
    of, truth = config(car), driven(car, "stop_start").copy()
    off = truth["engine_speed_rad_s"] < 25.0
    truth["engine_torque_nominal_nm"][off] = told_nm
    estimator = Estimator(of.settings)
    samples = Decoder(of.database, of.inputs, of.protections).decode(frames_of(of, truth, ()))
    rows = estimator.feed(samples).rows
    assert max(wrong_ms(rows, truth).values()) == 0.0
    seconds = rows["t_us"] * 1e-6
    stopped = (seconds > 15.5) & (seconds < 18.0)
    assert stopped.sum() > 500
    assert np.mean(rows["status"][stopped] & FAULTS > 0) < 0.02
    assert np.mean(rows["status"][stopped] & 7 == 7) > 0.98
    after = (seconds > 20.0) & (seconds < 25.0)
    errors = rows["engine_torque_nm"] - np.interp(rows["t_us"], truth["t_us"], truth["engine_torque_nm"])
    assert np.abs(errors[after]).mean() < 8.0  # N·m
