"""The plain filter that `tools/bench` times does what the compiled one does, with the operations of a drive."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import tape
from dctorque_can.estimators.kalman.model import STEPS_US, N, State
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SLIPPING, OPEN = 1, 0


@pytest.fixture
def plain(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("plain_kalman")


def test_its_steps_are_those_of_the_compiled_filter(plain):
    settings = load_config(shipped_config("paper_car")).settings
    k = kalman.new(settings.vehicle, replace(settings.kalman, parameter_error_share=0.0))
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 200.0, 150.0, 100.0, 10.0, 80.0)
    x, P = f["x"].copy(), f["P"].copy()
    kalman.predict(f, k.tables, k.tuning[0], SLIPPING, OPEN, False, False, STEPS_US[2])
    kalman.measure(f, State.W_E, 203.0, 0.09)
    factors = plain.kalman_noise.process_noise(f, k.tuning[0], SLIPPING, OPEN)
    step = plain.dense(k.tables, int(k.tables.row[2, 3]) + 3, 2)
    x, P = plain.predict(x, P, 80.0, f["per_error"], step, factors)
    x, P = plain.measure(x, P, State.W_E, 203.0, 0.09)
    size = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(f["x"], x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(f["P"] / size, P / size, atol=1e-9)


def test_it_does_the_operations_of_a_drive(plain):
    """Each frame of production CAN is bridged by at least a step, and each of its speeds is an update."""
    configs = {
        method: load_config(shipped_config("paper_car"), {"estimator.method": method})
        for method in ("oh2014", "kalman")
    }
    config = configs["kalman"]
    vehicle = config.settings.vehicle
    frames = emit_frames(simulate(vehicle, replace(PAPER, duration_s=4.0)), vehicle, PRODUCTION, config.database)
    found = plain.cost(configs, frames)
    assert 2.0 < found["operations"] < 20.0
    assert found["plain_over_kalman"] == pytest.approx(found["plain_us"] / found["kalman_us"])
    estimator = plain.Estimator(config.settings)
    samples = plain.Decoder(config.database, config.inputs, config.protections).decode(frames)
    work = plain.operations(estimator, samples)
    measured = [state for what, state, _ in work if what == tape.MEASURE]
    assert measured.count(State.W_E) > 0.9 * np.count_nonzero(samples.quantity == 0)
    assert set(measured) <= set(range(N))
