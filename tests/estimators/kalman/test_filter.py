"""One step of the filter against plain matrices, and what it says of itself against data drawn from its model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import engine, faults
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import noise as kalman_noise
from dctorque_can.estimators.kalman.faults import SensorFault
from dctorque_can.estimators.kalman.model import STEPS_US, N, State, process_covariance
from dctorque_can.estimators.kalman.tuning import tuning as tuning_of
from dctorque_can.resources import shipped_config

from .with_past import dense_update, sensor_row

SETTINGS = load_config(shipped_config("paper_car")).settings
DESIGN = replace(SETTINGS.kalman, timing_error_s=0.0, engine_torque_delay_s=0.0, parameter_error_share=0.0)
VEHICLE = SETTINGS.vehicle
OPEN, SLIPPING, LOCKED = 0, 1, 2
T_EN = 80.0


@pytest.fixture(scope="module")
def tables():
    return kalman.new(VEHICLE, DESIGN).tables


def new_filter(tables, **changes):
    """A filter in first and second gear, started at 200, 150, 100 and 10 rad/s."""
    k = kalman.Kalman(np.zeros(1, kalman.FILTER), tuning_of(VEHICLE, replace(DESIGN, **changes)), tables)
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 200.0, 150.0, 100.0, 10.0, T_EN)
    return k


def handover():
    """The five noises while torque is handed over from clutch 2 in second gear to clutch 1, sliding, in first.

    Both torques then have the rate of a sliding clutch, and at the wheel first gear's counts.
    """
    rate, at_wheel = DESIGN.sliding_torque_rate_nm_per_s, VEHICLE.gear(1).total_ratio
    tyre = 15.0**2 + 2.0 * DESIGN.torque_rate_time_s * (DESIGN.tyre_torque_share * at_wheel * rate) ** 2
    engine = DESIGN.engine_torque_error_nm**2 + 0.25 * (DESIGN.engine_torque_error_share * T_EN) ** 2
    return rate**2, rate**2, tyre, DESIGN.road_load_rate_nm_per_sqrt_s**2, engine


def as_the_filter_has_them(k, seconds):
    """The five noises of its next prediction, in this state."""
    f, tuning = k.state.copy()[0], k.tuning[0]
    kalman_noise.decide_rates(f, tuning, SLIPPING, LOCKED, seconds)
    return kalman_noise.process_noise(f, tuning, SLIPPING, LOCKED)


def model(k, step, noises):
    """F, b and Q of one step in first and second gear."""
    of_step = k.tables.steps[k.tables.row[2, 3] + 3, step]
    return of_step["phi"], of_step["input"], process_covariance(of_step, noises)


def with_errors(F, b, lagged, step):
    """F with what a gain and both lags of the nominal torque do in a step; ``lagged`` is carried to its end."""
    F, h = F.copy(), STEPS_US[step] * 1e-6
    F[:, State.GAIN] += b * (lagged[0] - 5.0**2 / lagged[0])
    for m, state in enumerate((State.LAG_1, State.LAG_2)):
        lag = engine.LAGS[m]
        before, lagged[m] = lagged[m], T_EN + (lagged[m] - T_EN) * np.exp(-h / lag)
        F[:, state] -= b * (lagged[m] - before) / h * max(1.0 - (2.0 / (T_EN - before)) ** 2, 0.0)
    return F


def predict(k, t_us):
    kalman.predict(k.state[0], k.tables, k.tuning[0], SLIPPING, LOCKED, False, False, t_us)


def test_each_speed_has_its_noise_and_its_resolution():
    resolutions = (0.0, 0.3, 0.6, 0.0, 0.06, 0.0, 0.0)
    design = replace(DESIGN, speed_resolutions_rad_s=resolutions, shaft_speed_noise_rad_s=0.2)
    variance = tuning_of(VEHICLE, replace(design, wheel_speed_noise_rad_s=0.01))["speed_variance"][0]
    np.testing.assert_allclose(variance[1:], (0.0475, 0.07, 1e-4, 4e-4, 1e-4, 1e-4))
    assert variance[0] == pytest.approx(design.engine_speed_noise_rad_s**2)


def test_one_step_is_that_of_plain_matrices(tables):
    """5 ms are a step of 4 and one of 1 ms; then a speed and a difference of two are taken."""
    k = new_filter(tables)
    f = k.state[0]
    root = np.random.default_rng(3).normal(0.0, 1.0, (N, N)) * np.sqrt(np.diag(f["P"]))[:, None]
    x, P = f["x"] + root @ np.ones(N), root @ root.T / N
    x[[State.R_1, State.R_2]], x[State.W_W] = 0.0, x[State.W_B]  # else the tyres would slip with them
    f["x"][:], f["P"][:] = x, P
    lagged = np.array([50.0, 20.0])
    f["lagged"][:], f["torque_noise"] = lagged, 0.3
    predict(k, 5000)
    for step in (STEPS_US.index(4000), STEPS_US.index(1000)):
        F, b, Q = model(k, step, handover())
        F = with_errors(F, b, lagged, step)
        x, P = F @ x + b * T_EN, F @ P @ F.T + Q
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(f["x"], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(f["P"] / size, P / size, atol=1e-9)
    for i, z, R in ((State.W_E, 203.0, 0.09), (State.T_C1, 40.0, 2.0)):
        H = np.eye(N)[i]
        x, P = dense_update(x, P, H, z, R)
        kalman.measure(f, i, z, R)
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(f["x"], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(f["P"] / size, P / size, atol=1e-9)
    assert (f["P"] == f["P"].T).all()


SPEEDS = (State.W_E, State.W_C1, State.W_C2, State.W_W, State.W_B)


def test_consistent_on_data_of_its_own_model(tables):
    """30 drives of 0.4 s drawn from the model: NIS of each sensor and NEES of the torques are within chi-square.

    The limits enclose 99.9 %; the torques' errors are counted once a drive, since they are correlated in time. How
    large the noises are is the filter's own choice at each step; what they should be is for the other tests.
    """
    random = np.random.default_rng(11)
    noise = np.array([0.3, 0.3, 0.3, 0.02, 0.02])
    step = STEPS_US.index(4000)
    runs, samples = 30, 100
    squares, nees_torques, nees_all = np.zeros(5), 0.0, 0.0
    for _ in range(runs):
        k = new_filter(tables, gate_sigma=1000.0)
        f = k.state[0]
        x = f["x"] + np.sqrt(np.diag(f["P"])) * random.standard_normal(N)
        lagged = np.array([40.0, 10.0])
        f["lagged"][:], f["torque_noise"] = lagged, 0.3
        for n in range(samples):
            F, b, Q = model(k, step, as_the_filter_has_them(k, 0.004))
            scale = np.sqrt(np.diag(Q))  # else rounding of the large ones is noise of the small ones
            scale[scale == 0.0] = 1.0
            values, vectors = np.linalg.eigh(Q / np.outer(scale, scale))
            disturbance = scale * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * random.standard_normal(N)))
            x = with_errors(F, b, lagged, step) @ x + b * T_EN + disturbance
            predict(k, 4000 * (n + 1))
            for sensor, state in enumerate(SPEEDS):
                z = sensor_row(f, state) @ x + noise[sensor] * random.standard_normal()
                faults.measure_gated(f, k.tuning[0], sensor, state, z, noise[sensor] ** 2, 1e9)
        squares += f["squares"]
        error = x - f["x"]
        torques = [State.T_C1, State.T_C2]
        nees_torques += error[torques] @ np.linalg.solve(f["P"][np.ix_(torques, torques)], error[torques])
        size = np.sqrt(np.diag(f["P"]))
        nees_all += (error / size) @ np.linalg.solve(f["P"] / np.outer(size, size), error / size)
    for total, freedom in (
        (nees_torques, 2 * runs),
        (nees_all, N * runs),
        *((s, runs * samples) for s in squares),
    ):
        assert chi2.ppf(0.0005, freedom) < total < chi2.ppf(0.9995, freedom)


def take(k, sensor, values, variance=0.01, fastest=1e5):
    """Measurements every 10 ms of a shaft that keeps its speed; returns the faults, and what the state became."""
    f, state = k.state[0], SPEEDS[sensor]
    found = []
    for value in values:
        f["t_us"] += 10_000
        faults.measure_gated(f, k.tuning[0], sensor, state, value, variance, fastest)
        found.append(SensorFault(int(f["fault"][sensor])))
    return found, float(f["x"][state])


SENSORS = range(len(SPEEDS))


@pytest.mark.parametrize("sensor", SENSORS)
def test_spikes_are_not_taken(tables, sensor):
    """±50 rad/s in turn lie on no line; the first good sample ends the fault."""
    k = new_filter(tables)
    before = k.state[0]["x"].copy()
    x = before[SPEEDS[sensor]]
    faults, after = take(k, sensor, [x + 50.0, x - 50.0, x + 50.0, x - 50.0])
    assert faults == [SensorFault.SPIKE] * 4
    assert (k.state[0]["x"] == before).all()
    assert take(k, sensor, [after])[0] == [SensorFault.NONE]


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_bias_is_not_taken_until_patience_ends(tables, sensor):
    """50 rad/s beside the prediction is a sensor's fault for 0.5 s; then it is the filter that was wrong."""
    k = new_filter(tables)
    x = float(k.state[0]["x"][SPEEDS[sensor]])
    faults, after = take(k, sensor, [x + 50.0] * 50)
    assert faults == [SensorFault.SPIKE] + [SensorFault.BIASED] * 49
    assert after == x
    faults, after = take(k, sensor, [x + 50.0] * 2)
    assert faults[-1] == SensorFault.NONE
    assert after == pytest.approx(x + 50.0, abs=0.1)


def test_a_motion_that_the_model_does_not_expect_is_taken(tables):
    """An engine that loses 1500 rad/s² is believed at the third sample on its line, and its torque doubted."""
    k = new_filter(tables)
    f = k.state[0]
    doubt = f["P"][State.DT_E, State.DT_E]
    faults, after = take(k, 0, [185.0, 170.0, 155.0])
    assert faults == [SensorFault.SPIKE, SensorFault.SPIKE, SensorFault.NONE]
    assert after == pytest.approx(155.0, abs=0.5)
    assert f["P"][State.DT_E, State.DT_E] > doubt + 100.0**2


def test_no_shaft_jumps_however_wide_the_gate_is(tables):
    """500 rad/s² is 5 rad/s in 10 ms, and 0.7 rad/s are left for noise: 5 σ of a difference of two."""
    k = new_filter(tables)
    f = k.state[0]
    take(k, 0, [200.0], fastest=500.0)
    for value, fault in ((206.0, SensorFault.SPIKE), (205.5, SensorFault.NONE)):
        f["rejected"][0] = f["fault"][0] = 0
        f["t_us"] = f["accepted_us"][0]
        f["P"][State.W_E, State.W_E] = 100.0**2
        assert take(k, 0, [value], fastest=500.0)[0] == [fault]


def test_a_synchroniser_may_do_anything(tables):
    """What jumps while its shaft is in neutral is taken at once."""
    k = new_filter(tables)
    faults, after = take(k, 1, [400.0], fastest=np.inf)
    assert faults == [SensorFault.NONE]
    assert after == pytest.approx(400.0, abs=0.1)


def stuck(k, values, state=State.W_E, signal=0):
    """Whether each value is held to be stuck while the prediction stays."""
    return [faults.is_stuck(k.state[0], k.tuning[0], signal, state, value, 0.01) for value in map(float, values)]


def among_others(k, values):
    """The same while both shafts change."""
    found = []
    for value in values:
        k.state[0]["t_us"] += 1
        for signal, state in ((1, State.W_C1), (2, State.W_C2)):
            stuck(k, [100.0 + 0.001 * float(k.state[0]["t_us"])], state, signal)
        found += stuck(k, [value])
    return found


def test_stuck_is_what_the_shaft_has_left(tables):
    """A repeated value is stuck once the prediction has moved by 4 σ, and no longer when it changes."""
    k = new_filter(tables)
    f = k.state[0]
    f["P"][State.W_E, State.W_E] = 0.01  # with the sensor's own 0.01: σ is 0.14
    assert among_others(k, [200.0, 200.0]) == [False, False]
    f["x"][State.W_E] = 200.5
    assert among_others(k, [200.0]) == [False]
    f["x"][State.W_E] = 200.6
    assert stuck(k, [200.0]) == [True]
    assert among_others(k, [200.0, 200.1]) == [True, False]
    alone = new_filter(tables)
    stuck(alone, [200.0, 200.0])
    alone.state[0]["x"][State.W_E] = 250.0
    assert stuck(alone, [200.0]) == [False]  # where all is constant nothing is


def test_stuck_is_what_repeats_itself_more_than_it_does_otherwise(tables):
    """A sensor that hardly repeats itself may do so 8 times, one of which nothing is known 19 times: 2⁻²⁰ < 10⁻⁶.

    That is so while others change. At rest a speed of zero says nothing, nor does one when all are constant.
    """
    fresh = new_filter(tables)
    assert among_others(fresh, [200.0] * 21) == [False] * 20 + [True]
    busy = new_filter(tables)
    assert not any(among_others(busy, 200.0 + 0.001 * np.arange(1000)))
    assert among_others(busy, [200.0] * 10) == [False] * 9 + [True]
    assert not any(among_others(new_filter(tables), [0.0] * 1000))
    assert not any(stuck(new_filter(tables), [200.0] * 1000))


def test_the_odd_wheel_is_told(tables):
    """Left and right differ by 0.5 rad/s in a bend. Then one jumps, or falls behind and repeats itself."""
    k = new_filter(tables)
    f = k.state[0]

    def odd(left, right):
        f["t_us"] += 10_000
        return faults.odd_wheel(f, k.tuning[0], 0, State.W_W, left, right, 0.001)

    assert [odd(10.25, 9.75) for _ in range(3)] == [0, 0, 0]
    assert odd(12.25, 9.75) == 1
    assert odd(10.25, 7.75) == 2
    assert odd(10.25, 9.75) == 0
    f["repeats"][4] = 5  # FR, though nearer to the prediction
    assert odd(10.75, 9.75) == 2
    assert [odd(12.25, 9.75) for _ in range(60)][-1] == 0  # for half a second: so they differ now


def test_a_frame_that_is_late_says_less(tables):
    """A speed that changes by 300 rad/s² and may be 1 ms old has 0.3 rad/s of noise on top of its own 0.1."""
    k = new_filter(tables, timing_error_s=0.001)
    f = k.state[0]
    f["rate"][State.W_E] = 300.0
    x, P = dense_update(f["x"].copy(), f["P"].copy(), np.eye(N)[State.W_E], 201.0, 0.1**2 + 0.3**2)
    faults.measure_gated(f, k.tuning[0], 0, State.W_E, 201.0, 0.1**2, 1e9)
    np.testing.assert_allclose(f["x"], x)
    np.testing.assert_allclose(f["P"], P, atol=1e-12)


@pytest.mark.parametrize(("speed", "counts"), [(0.0, 0), (-1e-14, 0), (0.01, 1)])
def test_what_is_told_as_zero_is_no_innovation(tables, speed, counts):
    """Nor does it teach that the sensor had no noise."""
    k = new_filter(tables)
    f = k.state[0]
    f["x"][State.W_B], f["torque_rate"][:] = 0.0, 0.0
    faults.measure_gated(f, k.tuning[0], 4, State.W_B, speed, 0.01, 1e9)
    assert f["taken"][4] == counts
    assert (f["noise_ratio"][4] != 1.0) == bool(counts)
