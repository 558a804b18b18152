"""The nominal engine torque between its frames: it rises evenly, and the engine may follow with a lag."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import engine, faults, gearbox
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman.model import DT_E, GAIN, LAG_1, LAG_2, W_D, W_E
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
OPEN = 0
PERIOD_US = 10_000


def started(**numbers):
    k = kalman.new(SETTINGS.vehicle, replace(SETTINGS.kalman, **numbers))
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 100.0, 50.0, 30.0, 3.0, 0.0)
    return k, f


def turn(k, f, told):
    """Let a free engine run through torques that the bus tells every 10 ms; return its angular momentum, N·m·s."""
    for torque in told:
        kalman.predict(f, k.tables, k.tuning[0], OPEN, OPEN, False, False, int(f["t_us"]) + PERIOD_US)
        engine.take_engine_torque(f, k.tuning[0], torque)
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
        mean.append(engine.follow_torque(f, k.tuning[0], 0.01))
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
    engine.take_engine_torque(f, k.tuning[0], 100.0)
    made_up = 100.0 * 0.5 * seconds / SETTINGS.vehicle.engine_inertia_kgm2
    assert f["x"][W_E] - before == pytest.approx(made_up)
    assert f["x"][DT_E] == 0.0


def learn(lag_s, gain=1.0, seconds=6.0):
    """Turn a free engine by a torque whose signal is a demand, or wrong by a factor; return the filter's state.

    The demand alternates between ramps and rests of up to 150 N·m; the engine speed comes every 10 ms with noise.
    """
    k, f = started()
    tuning, J = k.tuning[0], SETTINGS.vehicle.engine_inertia_kgm2 + SETTINGS.vehicle.damper.inertia_kgm2
    random = np.random.default_rng(4)
    noise = SETTINGS.kalman.engine_speed_noise_rad_s
    t = 1e-3 * np.arange(1, round(1000 * seconds) + 1)
    demand = np.interp(t, np.arange(13) * 0.5, 150.0 * np.array([0, 0, 1, -1, -1, 1, 0, 0.5, -1, 1, 0, 0, 0]))
    torque, w, now = np.zeros(len(t)), np.full(len(t), 100.0), 0.0
    for n in range(1, len(t)):
        now = demand[n] if lag_s == 0.0 else now + (demand[n] - now) * 1e-3 / lag_s
        torque[n] = now
        w[n] = w[n - 1] + 1e-3 * torque[n] / J
    for n in range(9, len(t), 10):
        kalman.predict(f, k.tables, tuning, OPEN, OPEN, False, False, round(1e6 * t[n]))
        engine.take_engine_torque(f, tuning, gain * demand[n])
        gearbox.apply_phases(f, tuning, True, True)
        kalman.measure(f, W_E, w[n] + noise * random.standard_normal(), noise**2)
        f["accepted"][0], f["accepted_us"][0] = w[n], f["t_us"]
    return f


@pytest.mark.parametrize("lag_s", [0.0, 0.04, 0.08, 0.15, 0.25])
def test_a_lag_that_nobody_told_is_learned(lag_s):
    """Of one free engine, in six seconds, with its uncertainty."""
    f = learn(lag_s)
    assert f["x"][LAG_1] + f["x"][LAG_2] == pytest.approx(lag_s, abs=0.012 + 0.06 * lag_s)
    sigma = np.sqrt(f["P"][LAG_1 : LAG_2 + 1, LAG_1 : LAG_2 + 1].sum())
    assert sigma < 0.012


@pytest.mark.parametrize("gain", [0.93, 1.06])
def test_a_gain_that_is_wrong_is_learned(gain):
    """Slowly, beside an error that changes within seconds: a quarter of it at least in these six."""
    f, error = learn(0.0, gain), 1.0 / gain - 1.0
    assert f["x"][GAIN] == pytest.approx(error, abs=0.75 * abs(error))
    assert abs(f["x"][GAIN] - error) < 2.0 * np.sqrt(f["P"][GAIN, GAIN])


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.0, 3.0])
def test_noise_of_the_torque_is_no_lag(sigma):
    """A minute of idling at a steady speed, with a noisy torque that is rounded to 1 N·m: within one σ of none.

    What would smooth the noise away, a gain of zero behind long lags, is many σ from it.
    """
    k, f = started()
    random = np.random.default_rng(6)
    noise = SETTINGS.kalman.engine_speed_noise_rad_s
    for n in range(1, 6001):
        kalman.predict(f, k.tables, k.tuning[0], OPEN, OPEN, False, False, n * PERIOD_US)
        engine.take_engine_torque(f, k.tuning[0], np.round(random.normal(0.0, sigma)))
        gearbox.apply_phases(f, k.tuning[0], True, True)
        kalman.measure(f, W_E, 100.0 + noise * random.standard_normal(), noise**2)
    lag = np.sqrt(f["P"][LAG_1 : LAG_2 + 1, LAG_1 : LAG_2 + 1].sum())
    assert abs(f["x"][LAG_1] + f["x"][LAG_2]) < lag < 0.062
    assert abs(f["x"][GAIN]) < 0.01
    assert f["torque_noise"] == pytest.approx(np.hypot(sigma, 1.0 / np.sqrt(12.0)), rel=0.3)


def test_a_torque_that_jumps_must_be_confirmed():
    """At 10 ms: a lone spike is told of and not taken; of a step the second one is taken, a fast ramp at once."""
    _, f = started()

    def judge(torque):
        f["t_us"] += PERIOD_US
        taken, spike = engine.judge_jump(f, torque)
        if taken:
            f["told"], f["torque_us"] = torque, f["t_us"]
        return taken, spike

    assert [judge(torque) for torque in (0.0, 100.0, 1.0)] == [(True, False), (False, False), (True, True)]
    assert [judge(torque) for torque in (100.0, 99.0, 98.0)] == [(False, False), (True, False), (True, False)]
    assert [judge(torque) for torque in (20.0, -55.0)] == [(True, False), (True, False)]
    assert [judge(torque) for torque in (250.0, -300.0, -54.0)] == [(False, False), (False, True), (True, True)]


def test_a_torque_at_fault_teaches_no_lag():
    """What was learned is forgotten, and its places are as at the start."""
    f = learn(0.25)
    tuning = kalman.new(SETTINGS.vehicle, SETTINGS.kalman).tuning[0]
    faults.forget_lasting_errors(f, tuning)
    assert (f["x"][GAIN : LAG_2 + 1] == 0.0).all()
    np.testing.assert_allclose(np.diag(f["P"])[GAIN : LAG_2 + 1], [0.75 * 0.05**2, 0.06**2 / 2, 0.06**2 / 2])
    assert np.count_nonzero(f["P"][GAIN : LAG_2 + 1]) == 3
