"""What is kept of the maps from one drive to the next, as plain numbers, and the maps begun from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.diagnostics import Extremes
from dctorque_can.clutch_maps.learner import STATES
from dctorque_can.clutch_maps.maps import ClutchMap, ClutchMaps
from dctorque_can.clutch_maps.settings import NODES

FORMAT = 1
"""Another one is another meaning of the numbers."""
_MOST = 1e12


class BadStateError(ValueError):
    """Numbers that no map can have."""


def kept(maps: ClutchMaps) -> dict[str, Any]:
    """Return all that lasts of the maps, for `begin_from`."""
    clutches = {}
    for clutch in maps.clutches:
        learner, shown, diagnostics = clutch.learner, clutch.published, clutch.diagnostics
        clutches[str(clutch.number)] = {
            "left": learner.left,
            "span": learner.span,
            "x": learner.x.tolist(),
            "P": learner.P.tolist(),
            "samples": learner.samples.tolist(),
            "seen": [end if math.isfinite(end) else None for end in learner.seen],
            "taken": learner.taken,
            "refused": learner.refused,
            "slipped_s": clutch.slipped_s,
            "grid": shown.grid.tolist(),
            "capacity_nm": shown.capacity_nm.tolist(),
            "valid": shown.valid.astype(int).tolist(),
            "moved_s": shown.moved_s,
            "energy_j": diagnostics.energy_j,
            "warm_windows": diagnostics.warm_windows.tolist(),
            "engagements": diagnostics.engagements.tolist(),
            "residuals": diagnostics.residuals.tolist(),
            "drift": diagnostics.drift.tolist(),
            "touch": _extremes(diagnostics.touch),
            "friction": _extremes(diagnostics.friction),
        }
    return {"distance_km": maps.distance_km, "clutches": clutches}


def begin_from(maps: ClutchMaps, state: Mapping[str, Any]) -> None:
    """Let maps that have learned nothing go on from a kept state; how long ago that was is not known.

    Raises:
        BadStateError: the state is none, or not of these clutches; the maps are of no use then.
    """
    try:
        maps.distance_km = _number(state["distance_km"])
        if set(state["clutches"]) != {str(clutch.number) for clutch in maps.clutches}:
            raise BadStateError("it is of other clutches")
        for clutch in maps.clutches:
            _begin(clutch, state["clutches"][str(clutch.number)])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadStateError(f"it is no state of maps: {error}") from error


def _begin(clutch: ClutchMap, state: Mapping[str, Any]) -> None:
    learner, shown, diagnostics = clutch.learner, clutch.published, clutch.diagnostics
    learner.left, learner.span = _number(state["left"]), _number(state["span"])
    learner.x, learner.P = _array(state["x"], STATES), _array(state["P"], STATES, STATES)
    if learner.span <= 0.0 or np.diagonal(learner.P).min() < 0.0 or not np.allclose(learner.P, learner.P.T):
        raise BadStateError("its covariance is none")
    learner.samples = _array(state["samples"], NODES)
    least, most = state["seen"]
    learner.seen = (
        math.inf if least is None else _number(least),
        -math.inf if most is None else _number(most),
    )
    learner.taken, learner.refused = int(state["taken"]), int(state["refused"])
    learner.rest()
    clutch.slipped_s = _number(state["slipped_s"])
    shown.grid, shown.capacity_nm = _array(state["grid"], NODES), _array(state["capacity_nm"], NODES)
    shown.valid = _array(state["valid"], NODES) > 0.0
    shown.moved_s = _number(state["moved_s"])
    diagnostics.energy_j = _number(state["energy_j"])
    diagnostics.warm_windows = _array(state["warm_windows"], len(diagnostics.warm_windows)).astype(np.int64)
    diagnostics.engagements = _array(state["engagements"], len(diagnostics.engagements)).astype(np.int64)
    diagnostics.residuals = _array(state["residuals"], *diagnostics.residuals.shape)
    diagnostics.drift = _array(state["drift"], len(diagnostics.drift))
    for extremes, values in ((diagnostics.touch, state["touch"]), (diagnostics.friction, state["friction"])):
        first, least, most = (math.nan if value is None else _number(value) for value in values)
        extremes.first, extremes.least, extremes.most = first, least, most
    clutch.restored = True


def _extremes(extremes: Extremes) -> list[float | None]:
    values = (extremes.first, extremes.least, extremes.most)
    return [None if math.isnan(value) else value for value in values]


def _number(value: Any) -> float:
    number = float(value)
    if not abs(number) <= _MOST:
        raise BadStateError(f"{number} is no number that a map has")
    return number


def _array(values: Any, *shape: int) -> NDArray[np.float64]:
    array = np.array(values, np.float64)
    if array.shape != shape:
        raise BadStateError(f"{array.shape} numbers instead of {shape}")
    if not (np.abs(array) <= _MOST).all():
        raise BadStateError("a number of it is none")
    return array
