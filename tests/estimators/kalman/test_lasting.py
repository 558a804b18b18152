"""Errors that last, against a filter that carries its past along (`with_past`).

An error of one standard deviation is given to it alone: the truth is zero, the car gets what the error does to it,
and what is measured is what the error adds. What it then makes of its past is the error of the smoothed past.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import lasting, smoother
from dctorque_can.estimators.kalman.model import STEPS_US, N, State, continuous

from .test_smoother import DESIGN, NOISE, SPEEDS, VEHICLE, model, new_filter, predict, publish, torques_of
from .with_past import WithPast, sensor_row

S = State
SIGMA = np.array([1e-3, 2e-3, 3e-3, 1e-3, 0.1, 0.2, 0.1, 0.15, 5.0])
AGES = (lasting.AGE_ENGINE, lasting.AGE_SHAFTS, lasting.AGE_SHAFTS, lasting.AGE_DRIVEN, lasting.AGE_UNDRIVEN)
STEP_US = 4000


@pytest.fixture(scope="module")
def tables():
    return kalman.new(VEHICLE, DESIGN).tables


def constant_load(f, seconds):
    """What 1 N·m of another road load does to the state meanwhile, of the continuous model."""
    A, _ = continuous(VEHICLE, DESIGN, *(int(g) for g in f["gear"]), tuple(bool(d) for d in f["drives"]))
    whole = np.zeros((N + 1, N + 1))
    whole[:N, :N], whole[:N, N] = A, A[:, S.T_V]
    return expm(whole * seconds)[:N, N]


def effects(f, b, tuning, seconds):
    """What each error does to the car in a step ``[errors, N]``."""
    rate, g = f["rate"], np.zeros((lasting.ERRORS, N))
    g[lasting.ENGINE_TORQUE] = b * SIGMA[lasting.ENGINE_TORQUE]
    g[lasting.ENGINE_INERTIA] = -b * SIGMA[lasting.ENGINE_INERTIA] * VEHICLE.engine_inertia_kgm2 * rate[S.W_E]
    heavier = SIGMA[lasting.MASS] * tuning["J_b"] * rate[S.W_B]
    g[lasting.MASS] = constant_load(f, seconds) * heavier
    twists = SIGMA[lasting.TRANSFER_STIFFNESS] * seconds
    g[lasting.TRANSFER_STIFFNESS, [S.TH_T1, S.TH_T2]] = twists * rate[[S.TH_T1, S.TH_T2]]
    g[lasting.OUTPUT_STIFFNESS, S.TH_O] = SIGMA[lasting.OUTPUT_STIFFNESS] * seconds * rate[S.TH_O]
    return g


def test_a_correction_is_taken_as_far_as_it_is_worth(tables):
    """Sensitivities of every estimate, before and after smoothing; the weights of least variance; correlation.

    With speeds in every second of 12 steps, and a shaft whose speed is forgotten between.
    """
    random = np.random.default_rng(6)
    k = new_filter(tables)
    f, tuning = k.state[0], k.tuning[0]
    k.tuning["lasting"][0] = SIGMA
    dense, errors = WithPast(f), [WithPast(f) for _ in SIGMA]
    for error in errors:
        error.x[:] = 0.0
    M, filtered = torques_of(k), []
    for n in range(12):
        F, b, Q = model(k, STEPS_US.index(STEP_US))
        dense.predict(F, b * f["T_en"], Q)
        predict(k, STEP_US * (n + 1))
        for error, g in zip(errors, effects(f, b, tuning, 1e-6 * STEP_US), strict=True):
            error.predict(F, -g, Q)
        for age, state, noise in zip(AGES, SPEEDS, NOISE, strict=True) if n % 2 else ():
            z, H = f["x"][state] + random.normal(0.0, 4.0 * noise), sensor_row(f, state)
            for p, error in enumerate(errors):
                h = -f["rate"][state] * SIGMA[age] if p == age else 0.0
                error.measure(H, h, noise**2)
            dense.measure(H, z, noise**2)
            kalman.measure(f, state, z, noise**2)
        if n == 5:
            for one, value in ((dense, dense.x[S.W_C2]), *((error, 0.0) for error in errors)):
                one.forget(S.W_C2, value, 1.0)
            kalman.forget(f, S.W_C2, f["x"][S.W_C2], 1.0)
        publish(k)
        P = dense.P[:N, :N]
        filtered.append((M @ dense.x[:N], M @ P @ M.T, np.array([M @ error.x[:N] for error in errors])))
        for one in (dense, *errors):
            one.remember()
    lasting.go_forth(k.state, tables, k.tuning, np.zeros(1, lasting.SENSITIVITY))
    found = np.zeros(12, smoother.SMOOTHED)
    smoother.go_back(k.state, tables, np.zeros(1, smoother.ADJOINT), found)
    taken = []
    for n, (x, V, s) in enumerate(filtered):
        np.testing.assert_allclose(f["tape"]["lasting"][n].T, s, rtol=1e-5, atol=1e-6 * np.abs(s).max())
        past = slice(N * (n + 1), N * (n + 2))
        gain = V - M @ dense.P[past, past] @ M.T
        d = s - np.array([M @ error.x[past] for error in errors])
        worth, whole = np.diag(gain) + np.sum(s * d, axis=0), np.diag(gain) + np.sum(d * d, axis=0)
        w = np.clip(np.divide(worth, whole, out=np.ones(3), where=whole > 0.0), 1e-3, 1.0)
        change = np.sum(s * s, axis=0) - 2.0 * w * worth + w * w * whole
        torque = x + w * (M @ dense.x[past] - x)
        np.testing.assert_allclose(found["torque"][n], torque, rtol=1e-5, atol=1e-5 * np.sqrt(V[2, 2]))
        np.testing.assert_allclose(found["sigma"][n] ** 2, np.diag(V) + np.minimum(change, 0.0), rtol=1e-5)
        if n < 11:
            rest = s - w * d
            joint = V[0, 1] - (1.0 - (1.0 - w[0]) * (1.0 - w[1])) * gain[0, 1] + rest[:, 0] @ rest[:, 1]
            product = np.sqrt((V[0, 0] + change[0]) * (V[1, 1] + change[1]))
            assert found["correlation"][n] == pytest.approx(np.clip(joint / product, -1.0, 1.0), abs=1e-5)
            taken.append(w)
    assert np.min(taken) < 0.9  # the errors matter here


def test_no_lasting_error_takes_all_of_it(tables):
    """Then the smoother is the textbook's, to the last bit of what it was without them."""
    random = np.random.default_rng(7)
    k = new_filter(tables)
    f = k.state[0]
    for n in range(8):
        predict(k, STEP_US * (n + 1))
        for state, noise in zip(SPEEDS, NOISE, strict=True):
            kalman.measure(f, state, f["x"][state] + random.normal(0.0, noise), noise**2)
        publish(k)
    found = [np.zeros(8, smoother.SMOOTHED) for _ in range(2)]
    smoother.go_back(k.state, tables, np.zeros(1, smoother.ADJOINT), found[0])
    k.tuning["lasting"][0] = 0.0
    lasting.go_forth(k.state, tables, k.tuning, np.zeros(1, lasting.SENSITIVITY))
    smoother.go_back(k.state, tables, np.zeros(1, smoother.ADJOINT), found[1])
    assert found[0].tobytes() == found[1].tobytes()


def test_nothing_lasts_beyond_a_start(tables):
    """The state of a new start has no error from before it."""
    k = new_filter(tables)
    f = k.state[0]
    k.tuning["lasting"][0] = SIGMA
    predict(k, STEP_US)
    kalman.measure(f, S.W_E, f["x"][S.W_E] + 1.0, 0.09)
    kalman.start(f, k.tuning[0], 300.0, 20.0, 30.0, 4.0, 0.0)
    publish(k)
    sensitivity = np.zeros(1, lasting.SENSITIVITY)
    lasting.go_forth(k.state, tables, k.tuning, sensitivity)
    assert not sensitivity["s"].any()
    assert not f["tape"]["lasting"][0].any()


def test_deviations_are_those_of_the_vehicle_file():
    """No age, no share and no offset that a vehicle file does not give."""
    design = replace(DESIGN, timing_error_s=2e-3, parameter_error_share=0.1, engine_torque_error_nm=4.0)
    sigma = lasting.deviations(design)
    assert (sigma[: lasting.MASS] == sigma[0]).all()
    assert sigma[0] == pytest.approx(20 * 2e-3)
    assert (sigma[lasting.MASS : lasting.TRANSFER_STIFFNESS] == 0.1).all()
    assert (sigma[lasting.TRANSFER_STIFFNESS : lasting.ENGINE_TORQUE] == 0.2).all()
    assert sigma[lasting.ENGINE_TORQUE] == 4.0
    assert not lasting.deviations(replace(design, timing_error_s=0.0))[: lasting.MASS].any()
