"""A prediction, for every model and step, and a measurement against plain numpy; and what is left of many."""

import numpy as np
import pytest

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import arithmetic
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman.model import GAIN, STEPS_US, N, State, process_covariance
from dctorque_can.resources import shipped_config

from .with_past import sensor_row

CARS = {car: load_config(shipped_config(car)).settings for car in ("paper_car", "avante_dct7")}
SIZES = np.array([*7 * [0.5], *4 * [0.02], 300.0, 40.0, 40.0, 900.0, 900.0, 200.0, 8.0, 0.03, 0.04, 0.05])  # σ
SIZES = np.append(SIZES, [0.002, 0.002, 0.002, 0.005])
FACTORS = (9e6, 4e4, 400.0, 3600.0, 25.0)
TORQUE = 80.0


def new_filter(car):
    return kalman.new(CARS[car].vehicle, CARS[car].kalman)


def fill(f, random, per_error=(60.0, -150.0, 40.0)):
    """A state with all states correlated, and errors of the nominal engine torque."""
    f["ratio"][:] = 14.0, 8.0
    f["rate"][:] = 10.0 * random.standard_normal(N)
    root = SIZES[:, None] * random.standard_normal((N, N))
    f["x"][:], f["P"][:] = 100.0 * SIZES * random.standard_normal(N), root @ root.T
    f["P"][:] = 0.5 * (f["P"] + f["P"].T)
    f["per_error"][:] = per_error


def assert_same(P, expected, tolerance=1e-12):
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(P / size, expected / size, rtol=0.0, atol=tolerance)
    np.testing.assert_array_equal(P, P.T)


@pytest.mark.parametrize("car", list(CARS))
def test_a_prediction_is_that_of_plain_matrices(car):
    """For each pair of gears, neutral among them, direction of losses and step."""
    k, random = new_filter(car), np.random.default_rng(5)
    f = k.state[0]
    for of_model in k.tables.steps:
        for step in of_model:
            fill(f, random)
            x, P = f["x"].copy(), f["P"].copy()
            F, b = step["phi"].copy(), step["input"]
            F[:, GAIN : GAIN + 3] += np.outer(b, f["per_error"])
            arithmetic.carry_on(f, step, TORQUE, FACTORS)
            scale = np.abs(F) @ np.abs(x) + np.abs(b) * TORQUE
            np.testing.assert_allclose(f["next"] / scale, (F @ x + b * TORQUE) / scale, rtol=0.0, atol=1e-13)
            assert_same(f["P"], F @ P @ F.T + process_covariance(step, FACTORS))


@pytest.mark.parametrize("i", list(State))
@pytest.mark.parametrize("share", [1e-6, 1.0, 1e6], ids=["sure", "as the state", "vague"])
def test_a_measurement_is_the_textbook_s_in_joseph_s_form(i, share):
    k = new_filter("paper_car")
    f = k.state[0]
    fill(f, np.random.default_rng(6))
    x, P = f["x"].copy(), f["P"].copy()
    H = sensor_row(f, i)
    variance = share * P[i, i]
    S = H @ P @ H + variance
    K = P @ H / S
    rest = np.eye(N) - np.outer(K, H)
    kalman.measure(f, i, H @ x + 2.0 * np.sqrt(S), variance)
    np.testing.assert_allclose(f["x"], x + 2.0 * np.sqrt(S) * K, rtol=1e-12)
    np.testing.assert_allclose(f["K"], K, rtol=1e-12 if np.count_nonzero(H) > 1 else 1e-14)
    expected = rest @ P @ rest.T + variance * np.outer(K, K)
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(f["P"] / size, expected / size, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(f["P"], f["P"].T)
    # no small difference of large numbers, but for what the errors of speeds add to the row
    rest, rounding = P @ H * variance / S, np.abs(f["P"]) @ (np.abs(H) - np.eye(N)[i])
    assert (np.abs(f["P"] @ H - rest) <= 1e-14 * (np.abs(rest) + rounding)).all()


@pytest.mark.parametrize("clutch", [0, 1])
@pytest.mark.parametrize("share", [1e-6, 1.0, 1e6], ids=["sure", "as the state", "vague"])
def test_drag_and_rate_of_an_open_clutch_are_one_measurement_after_the_other(clutch, share):
    k = new_filter("paper_car")
    f, other = k.state[0], k.state.copy()[0]
    fill(f, np.random.default_rng(8))
    other["x"][:], other["P"][:] = f["x"], f["P"]
    i, j = State.T_C1 + clutch, State.R_1 + clutch
    P, drag = f["P"].copy(), f["x"][i] + SIZES[i]
    kalman.measure(other, i, drag, share * P[i, i])
    kalman.measure(other, j, 0.0, share * P[j, j])
    kalman.measure_open(f, clutch, drag, share * P[i, i], 1.0, share * P[j, j])
    np.testing.assert_allclose(f["x"], other["x"], rtol=1e-11)
    np.testing.assert_allclose(f["K"], other["K"], rtol=1e-9, atol=1e-12 * np.abs(other["K"]).max())
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(f["P"] / size, other["P"] / size, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(f["P"], f["P"].T)
    np.testing.assert_allclose(f["P"][j], other["P"][j], rtol=1e-9, atol=1e-14 * size[j].max() * share)


def test_a_drag_that_is_lastingly_another_moves_the_state_as_its_sensitivity_says():
    """Two filters, one told 3 N·m more drag in every frame: their states differ by three times the sensitivity."""
    told, other = (new_filter("paper_car") for _ in range(2))
    random = np.random.default_rng(9)
    states = [k.state[0] for k in (told, other)]
    for f in states:
        fill(f, np.random.default_rng(8))
        f["x"][State.SCALE :] = f["P"][State.SCALE :] = f["P"][:, State.SCALE :] = 0.0  # else nothing is linear
        f["lasting"][:] = 0.0
        f["per_error"][:] = (3.0, 40.0, -20.0)
    for n in range(300):  # first and second gear, losses either way
        step = told.tables.steps[told.tables.row[2, 3] + n // 100, n % 3]
        z = states[0]["x"] + SIZES * random.standard_normal(N)
        for f, error in zip(states, (0.0, 3.0), strict=True):
            arithmetic.carry_on(f, step, TORQUE, FACTORS)
            f["x"][:] = f["next"]
            kalman.measure_open(f, 1, 0.5 + error, 1.0, 1.0, 100.0)
            for state in (State.W_E, State.W_C1, State.W_B):
                kalman.measure(f, state, z[state], 0.01)
            if n == 150:
                kalman.forget(f, State.W_C2, 7.0, 1e4)
        difference = states[1]["x"] - states[0]["x"]
        sensitivity = states[0]["lasting"][1]
        size = np.abs(states[0]["x"]).max()
        np.testing.assert_allclose(difference, 3.0 * sensitivity, rtol=1e-6, atol=1e-9 * size)
    assert states[0]["lasting"][1, State.T_C2] > 0.5
    assert abs(states[0]["lasting"][1, State.T_C1]) > 0.1
    np.testing.assert_array_equal(states[0]["lasting"][0], 0.0)


@pytest.mark.parametrize("i", [State.W_E, State.W_C1, State.W_W, State.W_B, State.T_C2])
def test_a_measurement_takes_of_a_lasting_error_what_its_sensor_sees_of_it(i):
    k = new_filter("paper_car")
    f, random = k.state[0], np.random.default_rng(11)
    fill(f, random)
    f["lasting"][:] = SIZES * random.standard_normal((2, N))
    f["lasts"][:] = True, False
    s, H = f["lasting"].copy(), sensor_row(f, i)
    kalman.measure(f, i, 1.0, 0.01)
    np.testing.assert_allclose(f["lasting"][0], s[0] - f["K"] * (H @ s[0]), rtol=1e-12)
    np.testing.assert_array_equal(f["lasting"][1], s[1])


SENSORS = np.array([State.W_E, State.W_C1, State.W_C2, State.W_W, State.W_B])


@compiled_without_allocation
def feed(state, steps, model, first, end, factors, variance):
    """Frames from ``first`` up to ``end`` of one model, with a step and a speed each, some with an open clutch."""
    f = state[0]
    for n in range(first, end):
        arithmetic.carry_on(f, steps[model, n % len(STEPS_US)], TORQUE, factors)
        for i in range(N):
            f.x[i] = f.next[i]
        i = SENSORS[n % 5]
        kalman.measure(f, i, kalman.told(f, i), variance)
        if n % 3 == 0:
            kalman.measure_open(f, 0, 0.0, variance, 1.0, variance)


@pytest.mark.parametrize(
    ("noise", "variance"), [(1e-6, 1e-10), (1.0, 1e-4), (1e6, 1e-10), (1e6, 1e8), (1e-6, 1e8)]
)
def test_the_covariance_stays_one_however_extreme_the_noises_are(noise, variance):
    """10 000 frames of gear pairs in turn: symmetric to the last bit, and positive within the arithmetic."""
    k, random = new_filter("avante_dct7"), np.random.default_rng(7)
    f = k.state[0]
    fill(f, random)
    models = random.integers(0, len(k.tables.steps), 10)
    factors = tuple(noise * factor for factor in FACTORS)
    for first in range(0, 10_000, 100):
        feed(k.state, k.tables.steps, models[first // 1000], first, first + 100, factors, variance)
        np.testing.assert_array_equal(f["P"], f["P"].T)
        sigma = np.sqrt(np.diag(f["P"]))
        assert (sigma > 0.0).all()
        assert np.linalg.eigvalsh(f["P"] / np.outer(sigma, sigma)).min() > -1e-9
