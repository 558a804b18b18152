"""A third estimator: a package of its own plugs in by the contract alone (docs/architecture.md)."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import ENGINE_SPEED, ENGINE_TORQUE, usable
from dctorque_can.pipeline.estimates import ONLY_KALMAN, ONLY_OH2014, Status
from dctorque_can.pipeline.estimator import Estimator

from ..pipeline.drives import SETTINGS, Q, cruise, traffic

VALID = int(Status.CLUTCH1_VALID | Status.CONVERGED)


class Lazy(NamedTuple):
    """Believes that clutch 1 transmits what the engine control unit says, while there is an engine speed."""

    state: NDArray[np.void]


STATE = np.dtype([("T", "f8"), ("frames", "i8")])


@compiled_without_allocation
def start(e: Any, answer: Any) -> None:
    e.state[0].T = answer.T_c[0] = 0.0


@compiled_without_allocation
def stop(e: Any, answer: Any) -> None:
    answer.running = False


@compiled_without_allocation
def advance(e: Any, inputs: Any, answer: Any, t_us: int) -> None:
    pass


@compiled_without_allocation
def act(e: Any, inputs: Any, answer: Any) -> None:
    e.state[0].T = answer.T_c[0] = inputs.value[ENGINE_TORQUE]
    e.state[0].frames += 1
    answer.running, answer.w_e = usable(inputs, ENGINE_SPEED), inputs.value[ENGINE_SPEED]
    for i in range(2):
        answer.w_c[i] = inputs.w_c[i]


@compiled_without_allocation
def conclude(e: Any, inputs: Any, answer: Any, row: Any) -> int:
    row.clutch1_torque_nm = e.state[0].T
    return VALID


@compiled_without_allocation
def is_finite(e: Any) -> bool:
    return bool(np.isfinite(e.state[0].T))


@compiled_without_allocation
def report(e: Any, row: Any) -> None:
    row.innovations[0] = e.state[0].frames


contract.implement(Lazy, contract.Functions(start, stop, advance, act, conclude, is_finite, report))


def test_it_estimates():
    """Its torque is published within the limits, valid where gears and speeds are; all else is NaN."""
    estimator = Estimator(SETTINGS, Lazy(np.zeros(1, STATE)))
    found = estimator.feed(traffic(1.0, lambda t: cruise() | {Q.ENGINE_TORQUE: 50.0 if t < 0.5 else 900.0}))
    early, late = found.rows[found.rows["t_us"] < 500_000][-1], found.rows[-1]
    assert early["clutch1_torque_nm"] == 50.0
    assert early["status"] & VALID == VALID
    assert late["clutch1_torque_nm"] == estimator.torque_limits[0]
    assert late["status"] & (VALID | Status.LIMITED) == Status.CONVERGED | Status.LIMITED
    for name in (*ONLY_KALMAN, *ONLY_OH2014):
        assert np.isnan(found.rows[name]).all(), name
    assert estimator.health["innovations"][0, 0] == estimator.chosen.state["frames"][0] == 400


def test_its_state_is_kept_in_a_snapshot_and_starts_anew_when_it_is_no_number():
    estimator = Estimator(SETTINGS, Lazy(np.zeros(1, STATE)))
    estimator.feed(traffic(0.1, lambda t: cruise()))
    before = estimator.snapshot()
    rows = estimator.feed(traffic(0.1, lambda t: cruise(), 100_000)).rows
    estimator.restore(before)
    assert estimator.chosen.state["frames"][0] == 40
    assert estimator.feed(traffic(0.1, lambda t: cruise(), 100_000)).rows.tobytes() == rows.tobytes()
    estimator.feed(traffic(0.1, lambda t: cruise() | {Q.ENGINE_TORQUE: np.nan}, 200_000))
    assert estimator.health["numeric_resets"][0] == 0  # NaN is out of every range
