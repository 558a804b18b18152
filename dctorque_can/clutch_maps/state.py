"""What is kept of the maps from one drive to the next, as plain numbers, and the maps begun from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.diagnostics import Extremes
from dctorque_can.clutch_maps.learner import FRICTION, STATES
from dctorque_can.clutch_maps.maps import ClutchMap, ClutchMaps
from dctorque_can.clutch_maps.settings import NODES
from dctorque_can.clutch_maps.windows import key_of

FORMAT = 1
"""Another one is another meaning of the numbers."""
_MOST = 1e12


_LARGEST_EXPONENT = 5.0  # of a friction coefficient: e⁵
_MOST_DOUBLED = 40  # times that a span may have been
_WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError)


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
            clutch.learner.rest()
            clutch.restored = True
    except _WRONG as error:
        raise BadStateError(f"it is no state of maps: {error}") from error


def moment(maps: ClutchMaps) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return all that changes in maps while they learn, for `go_on_from`: arrays of `LAYOUTS`, and numbers.

    That is what is `kept`, and what a restart forgets.
    """
    arrays, waiting = maps.join.kept()
    passing = {}
    for clutch in maps.clutches:
        learner, shown, warmth = clutch.learner, clutch.published, clutch.warmth
        passing[str(clutch.number)] = {
            "key": learner.key,
            "unrest": learner.unrest,
            "raw_nm": shown.raw_nm.tolist(),
            "sigma_nm": shown.sigma_nm.tolist(),
            "warmth": [warmth.stored_j, warmth.heat_j],
            "warmth_key": warmth.key,
            "restored": clutch.restored,
        }
    temperatures = [None if math.isnan(each) else each for each in maps.temperatures]
    clock = {"due": maps.due, "last": maps.last, "temperatures": temperatures}
    return arrays, {"kept": kept(maps), "passing": passing, "waiting": waiting, "clock": clock}


def go_on_from(maps: ClutchMaps, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
    """Let new maps go on as those did whose `moment` it was.

    Raises:
        BadStateError: it is none, or not of these clutches; the maps are of no use then.
    """
    try:
        begin_from(maps, values["kept"])
        for clutch in maps.clutches:
            learner, shown, warmth = clutch.learner, clutch.published, clutch.warmth
            _begin(clutch, values["kept"]["clutches"][str(clutch.number)])
            passing = values["passing"][str(clutch.number)]
            learner.key, learner.unrest = _key(passing["key"]), _number(passing["unrest"])
            shown.raw_nm, shown.sigma_nm = _array(passing["raw_nm"], NODES), _array(passing["sigma_nm"], NODES)
            warmth.stored_j, warmth.heat_j = map(_number, passing["warmth"])
            warmth.key, clutch.restored = _key(passing["warmth_key"]), passing["restored"] is True
        clock = values["clock"]
        maps.due = _key(clock["due"])
        maps.last = None if clock["last"] is None else (key_of(clock["last"][0]), key_of(clock["last"][1]))
        first, second = (math.nan if value is None else _number(value) for value in clock["temperatures"])
        maps.temperatures = [first, second]
        maps.join.go_on_from(arrays, values["waiting"])
    except _WRONG as error:
        raise BadStateError(f"it is no state of maps: {error}") from error


def _key(value: Any) -> int | None:
    return None if value is None else key_of(value)


def _begin(clutch: ClutchMap, state: Mapping[str, Any]) -> None:
    learner, shown, diagnostics = clutch.learner, clutch.published, clutch.diagnostics
    left, doubled = _number(state["left"]), math.log2(_number(state["span"]) / learner.span)
    if left != learner.left or doubled not in range(_MOST_DOUBLED):
        raise BadStateError("its nodes are none of this clutch")
    learner.span *= 2.0**doubled
    learner.x, learner.P = _array(state["x"], STATES), _array(state["P"], STATES, STATES)
    if not np.allclose(learner.P, learner.P.T) or np.diagonal(learner.P).min() < 0.0:
        raise BadStateError("its covariance is none")
    if abs(learner.x[FRICTION]) > _LARGEST_EXPONENT:
        raise BadStateError("its friction is none")
    learner.samples = _array(state["samples"], NODES)
    least, most = state["seen"]
    learner.seen = (
        math.inf if least is None else _number(least),
        -math.inf if most is None else _number(most),
    )
    learner.taken, learner.refused = int(state["taken"]), int(state["refused"])
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
