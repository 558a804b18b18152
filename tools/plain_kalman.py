"""The Kalman filter's linear algebra as one would write it first: plain numpy, F @ P @ F.T.

`tools/bench` lets it do the predictions and scalar updates of the compiled filter on a drive, by the filter's
tape, and times both. The decisions between them (gears, phases, faults) cost it nothing here.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.estimators.kalman import noise as kalman_noise
from dctorque_can.estimators.kalman import tape
from dctorque_can.estimators.kalman.model import GAIN, N, Tables, process_covariance
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames

Floats = NDArray[np.float64]
Operations = list[tuple[int, int, int]]  # what, and on which model and step, or on which state
FACTORS = 5  # of `kalman_noise.process_noise`
SAMPLES = 500  # whose operations surely have room on the tape


class Dense(NamedTuple):
    """One step of one model as plain matrices: F ``[N, N]``, response ``[N]``, process noises ``[6, N, N]``."""

    F: Floats
    b: Floats
    noises: Floats


def dense(tables: Tables, model: int, step: int) -> Dense:
    """Return a step of the compiled filter's tables; all but its first noise are per unit of their factor."""
    of_step = tables.steps[model, step]
    always = process_covariance(of_step, np.zeros(FACTORS))
    others = [process_covariance(of_step, factors) - always for factors in np.eye(FACTORS)]
    return Dense(of_step["phi"], of_step["input"], np.array([always, *others]))


def predict(
    x: Floats, P: Floats, T_en: float, per_error: Floats, step: Dense, factors: tuple[float, ...]
) -> tuple[Floats, Floats]:
    """Return state and covariance one step on.

    ``per_error`` is that of `filter.FILTER`, ``factors`` those of `noise.process_noise`.
    """
    Q = step.noises[0] + sum(q * noise for q, noise in zip(factors, step.noises[1:], strict=True))
    F = step.F.copy()
    F[:, GAIN : GAIN + 3] += np.outer(step.b, per_error)
    return F @ x + step.b * T_en, F @ P @ F.T + Q


def measure(x: Floats, P: Floats, i: int, z: float, variance: float) -> tuple[Floats, Floats]:
    """Return state and covariance after a measurement z of x_i, in Joseph's form."""
    H = np.zeros((1, N))
    H[0, i] = 1.0
    S = H @ P @ H.T + variance
    K = P @ H.T / S
    rest = np.eye(N) - K @ H
    return x + K[:, 0] * (z - x[i]), rest @ P @ rest.T + variance * K @ K.T


def operations(estimator: Estimator, samples: Any) -> Operations:
    """Feed samples and return what the filter did with its matrices."""
    found: Operations = []
    reel = estimator.chosen.state["tape"]
    for begin in range(0, len(samples), SAMPLES):
        tape.rewind(reel, on=True)
        estimator.feed(samples[begin : begin + SAMPLES])
        if reel["full"][0]:
            raise RuntimeError(f"what {SAMPLES} samples do has no room on the tape")
        for n in range(int(reel["operations"][0])):
            what, (a, b) = int(reel["what"][0, n]), reel["which"][0, n]
            if what in (tape.PREDICT, tape.MEASURE):
                times = int(reel["times"][0, n]) if what == tape.PREDICT else 1
                found += [(what, int(a), int(b))] * times
    tape.rewind(reel, on=False)
    return found


def cost(configs: dict[str, Config], frames: Frames) -> dict[str, float]:
    """Return µs per frame of both methods and of the plain filter, and how many matrix operations a frame needs.

    Time is that of the processor, so that other work on the machine does not count. That of a method is the whole
    estimator's, with its inputs, decisions and derived values; that of the plain filter is its matrices' alone.

    Args:
        configs: of the methods ``oh2014`` and ``kalman``.
        frames: of one drive.
    """
    decoded = configs["kalman"]
    samples = Decoder(decoded.database, decoded.inputs, decoded.protections).decode(frames)
    us = {}
    for name, config in configs.items():
        took = []
        for _ in range(5):
            estimator = Estimator(config.settings)
            start = time.thread_time()
            estimator.feed(samples)
            took.append(time.thread_time() - start)
        us[name] = 1e6 * min(took) / len(frames)
    estimator = Estimator(decoded.settings)
    work = operations(estimator, samples)
    k = estimator.chosen
    f, tuning = k.state[0], k.tuning[0]
    x, P = f["x"].copy(), f["P"].copy()
    steps = {(a, b): dense(k.tables, a, b) for what, a, b in work if what == tape.PREDICT}
    start = time.thread_time()
    for what, a, b in work:
        if what == tape.PREDICT:
            factors = kalman_noise.process_noise(f, tuning, 1, 0)
            x, P = predict(x, P, 100.0, f["per_error"], steps[a, b], factors)
        else:
            x, P = measure(x, P, a, x[a], 0.01)
    us["plain"] = 1e6 * (time.thread_time() - start) / len(frames)
    return {
        "oh2014_us": us["oh2014"],
        "kalman_us": us["kalman"],
        "plain_us": us["plain"],
        "operations": len(work) / len(frames),
        "kalman_over_oh2014": us["kalman"] / us["oh2014"],
        "plain_over_kalman": us["plain"] / us["kalman"],
    }
