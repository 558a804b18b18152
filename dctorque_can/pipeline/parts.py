"""All records that change while an estimator is fed, in one piece of memory: one copy keeps them all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.estimators import contract
from dctorque_can.pipeline import derived
from dctorque_can.pipeline.estimates import HEALTH
from dctorque_can.pipeline.rules import CORE, first_core, first_inputs
from dctorque_can.pipeline.settings import Settings
from dctorque_can.plausibility.state import MONITOR, first


class Parts(NamedTuple):
    """The state of an estimator and what goes with it; each record is an array ``[1]`` of its dtype.

    Attributes:
        core: `CORE`.
        inputs: `contract.INPUTS`.
        answer: `contract.ANSWER`.
        health: `HEALTH`.
        derived: `derived.DERIVED`.
        monitor: `MONITOR`.
        chosen: the estimator (`contract`).
        memory: int64 ``[n]``, in which all of these stand, but for the estimator's tape.
    """

    core: NDArray[np.void]
    inputs: NDArray[np.void]
    answer: NDArray[np.void]
    health: NDArray[np.void]
    derived: NDArray[np.void]
    monitor: NDArray[np.void]
    chosen: Any
    memory: NDArray[np.int64]


class Records(NamedTuple):
    """The records of `Parts`: what one compiled function hands over to another sooner than arrays."""

    core: Any
    inputs: Any
    answer: Any
    health: Any
    derived: Any
    monitor: Any
    chosen: Any


def new(chosen: Any, settings: Settings, coolant_c: NDArray[np.float64]) -> Parts:
    """Return the parts of an estimator that has seen nothing yet.

    Args:
        chosen: the estimator as it is before the first frame; its own state is copied.
        settings: what the inputs are.
        coolant_c: temperature of both clutches at the start ``[2]``.
    """
    state = chosen.state.dtype
    # the estimator comes last, since its tape is not part of what is kept
    dtypes = (CORE, contract.INPUTS, contract.ANSWER, HEALTH, derived.DERIVED, MONITOR, state)
    ends = np.cumsum([-(-dtype.itemsize // 8) for dtype in dtypes])
    everything = np.zeros(ends[-1], np.int64)
    core, inputs, answer, health, derived_, monitor, own = (
        everything[end - -(-dtype.itemsize // 8) : end].view(np.uint8)[: dtype.itemsize].view(dtype)
        for dtype, end in zip(dtypes, ends, strict=True)
    )
    first_core(core)
    first_inputs(settings, inputs)
    derived_[:] = derived.new(coolant_c)
    first(monitor)
    tape = state["tape"].itemsize if "tape" in (state.names or ()) else 0
    for name in state.names or ():
        if name != "tape":
            own[name] = chosen.state[name]
    kept = everything[: ends[-1] - tape // 8]
    return Parts(core, inputs, answer, health, derived_, monitor, chosen._replace(state=own), kept)


def dtypes(parts: Parts) -> tuple[np.dtype[np.void], ...]:
    """Return the dtypes of all records in the memory, in their order."""
    records = (parts.core, parts.inputs, parts.answer, parts.health, parts.derived, parts.monitor)
    return tuple(record.dtype for record in (*records, parts.chosen.state))
