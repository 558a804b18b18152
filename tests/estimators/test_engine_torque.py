"""The nominal engine torque between its frames: it rises evenly, and the engine may follow with a lag."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators import kalman
from dctorque_can.estimators.kalman_model import DT_E, W_D, W_E
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
OPEN = 0
PERIOD_US = 10_000


def started(**numbers):
    k = kalman.new(SETTINGS.vehicle, replace(SETTINGS.kalman, **numbers), 10)
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 100.0, 50.0, 30.0, 3.0, 0.0)
    return k, f


def turn(k, f, told):
    """Let a free engine run through torques that the bus tells every 10 ms; return its angular momentum, N·m·s."""
    for torque in told:
        kalman.predict(f, k.tables, k.tuning[0], OPEN, OPEN, False, False, int(f["t_us"]) + PERIOD_US)
        kalman.take_engine_torque(f, k.tuning[0], torque)
    vehicle = SETTINGS.vehicle
    return vehicle.engine_inertia_kgm2 * (f["x"][W_E] - 100.0) + vehicle.damper.inertia_kgm2 * (
        f["x"][W_D] - 100.0
    )


@pytest.mark.parametrize("lag_s", [0.0, 0.08])
def test_a_torque_that_rises_evenly_is_not_taken_for_a_staircase(lag_s):
    """The momentum is the integral of the ramp, as far as the engine has followed it."""
    k, f = started(engine_torque_lag_s=lag_s)
    seconds, slope = 0.3, 400.0
    told = slope * 0.01 * np.arange(1, round(seconds / 0.01) + 1)
    left = np.exp(-seconds / lag_s) if lag_s else 0.0
    torque = slope * (seconds - lag_s * (1.0 - left))
    exact = slope * (seconds**2 / 2 - lag_s * seconds + lag_s**2 * (1.0 - left))
    staircase = slope * 0.01 * seconds / 2  # what a torque that is held between frames lags behind
    assert turn(k, f, told) == pytest.approx(exact, abs=0.15 * staircase)
    assert f["T_en"] == pytest.approx(torque, abs=0.02 * told[-1])


def test_an_engine_with_a_lag_follows_a_step():
    k, f = started(engine_torque_lag_s=0.08)
    f["told"] = 100.0
    mean, before = [], f["T_en"]
    for _ in range(8):
        mean.append(kalman.follow_torque(f, k.tuning[0], 0.01))
    assert before == 0.0
    assert f["T_en"] == pytest.approx(100.0 * (1.0 - np.exp(-1.0)))
    assert 0.01 * sum(mean) == pytest.approx(100.0 * (0.08 - 0.08 * (1.0 - np.exp(-1.0))))


@pytest.mark.parametrize(
    ("silence_us", "speed_us", "seconds"), [(20_000, None, 0.02), (20_000, 5_000, 0.005), (60_000, None, 0.0)]
)
def test_only_what_nothing_has_told_is_made_up_for(silence_us, speed_us, seconds):
    """A speed has told of the time before it, and a torque after a silence was no ramp."""
    k, f = started(engine_torque_lag_s=0.0)
    before = f["x"][W_E]
    f["t_us"] += silence_us
    if speed_us is not None:
        f["accepted"][0], f["accepted_us"][0] = 100.0, f["t_us"] - speed_us
    kalman.take_engine_torque(f, k.tuning[0], 100.0)
    made_up = 100.0 * 0.5 * seconds / SETTINGS.vehicle.engine_inertia_kgm2
    assert f["x"][W_E] - before == pytest.approx(made_up)
    assert f["x"][DT_E] == 0.0
