"""All records that change while an estimator is fed, in one piece of memory: one copy keeps them all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.estimators import kalman, oh2014, oh2014_model
from dctorque_can.estimators.kalman import Kalman
from dctorque_can.estimators.tape import TAPE
from dctorque_can.pipeline import core_state, derived
from dctorque_can.pipeline.estimates import HEALTH

_NEVER_AT_FIRST = ("t_us", "settled_us", "estimate_us", "health_us", "implausible_us", "seen_us", "candidate_us")


class Parts(NamedTuple):
    """The state of an estimator; each record is an array ``[1]`` of its dtype.

    Attributes:
        core: `core_state.CORE`.
        state: `oh2014.STATE`.
        pair: `oh2014_model.PAIR`.
        health: `HEALTH`.
        derived: `derived.DERIVED`.
        kalman: the filter.
        memory: int64 ``[n]``, in which all of these stand, but for the filter's tape.
    """

    core: NDArray[np.void]
    state: NDArray[np.void]
    pair: NDArray[np.void]
    health: NDArray[np.void]
    derived: NDArray[np.void]
    kalman: Kalman
    memory: NDArray[np.int64]


def new(filter_: Kalman, coolant_c: NDArray[np.float64]) -> Parts:
    """Return the parts of an estimator that has seen nothing yet, with tuning and tables of ``filter_``.

    Args:
        filter_: its state is not used.
        coolant_c: temperature of both clutches at the start ``[2]``.
    """
    # the filter comes last, since its tape is not part of what is kept
    dtypes = (core_state.CORE, oh2014.STATE, oh2014_model.PAIR, HEALTH, derived.DERIVED, kalman.FILTER)
    ends = np.cumsum([dtype.itemsize for dtype in dtypes])
    everything = np.zeros(ends[-1] // 8, np.int64)
    records = [
        everything[(end - dtype.itemsize) // 8 : end // 8].view(dtype)
        for dtype, end in zip(dtypes, ends, strict=True)
    ]
    core, state, pair, health, derived_, filter_state = records
    for name in _NEVER_AT_FIRST:
        core[name] = core_state.NEVER
    core["slip_small_us"] = core_state.NEVER
    core["closed"] = True
    derived_[:] = derived.new(coolant_c)
    memory = everything[: (ends[-1] - TAPE.itemsize) // 8]
    return Parts(core, state, pair, health, derived_, filter_._replace(state=filter_state), memory)
