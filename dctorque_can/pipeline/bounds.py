"""What the memory of an estimator can hold: a state from outside, as out of a log, is taken over within this.

Compiled code finds places of tables by gears, phases and values, and goes on from time to time in steps. So every
whole number has limits here, and each clock is near the others. Floating-point numbers may be anything: an
estimator whose state is no number starts anew.

Without an entry in `LIMITS`, the name and the type say what a field is: ``…_us`` a time, ``…gear…`` a gear, a
byte yes or no, all other numbers counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import MAX_GEAR
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators import contract
from dctorque_can.pipeline.core import LATEST_US
from dctorque_can.pipeline.hindsight import LASTING_US, MOVEMENTS
from dctorque_can.pipeline.parts import Parts
from dctorque_can.pipeline.samples import SPEEDS, Quantity, Signs
from dctorque_can.pipeline.thresholds import WIDEST

_SPEEDS = [*SPEEDS, Quantity.DRIVING_SHAFT_SPEED]
_APART_US = 1_000_000  # that clocks may be, so that none takes long to come to the others
_COUNTS = (0, 2**53)
_GEARS = (-1, MAX_GEAR)
_WAYS = (-1, 1)
_TIMES = (NEVER, LASTING_US)
LIMITS: contract.Limits = {
    # core
    "actual": _GEARS,
    "former": _GEARS,
    "said": _WAYS,
    "counted": _WAYS,
    "way": _WAYS,
    "foretold_way": _WAYS,
    "foretold": (0, MOVEMENTS),
    "shaft": (-1, 1),
    "spoke": _TIMES,
    # inputs
    "signs": (0, int(max(Signs))),
    "direction": _WAYS,
    "heading": _WAYS,
    "called": _WAYS,
    "phase": (0, 2),
    # monitor
    "carrier": (-1, 2),
}


def problem(parts: Parts, like: Parts, rules: Any) -> str:
    """Return what is wrong with the state of an estimator, "" if nothing is.

    Args:
        parts: the state in question.
        like: one of the same settings, to compare with what never changes.
        rules: `RULES` record of both.
    """
    special = {**LIMITS, **contract.limits_of(type(parts.chosen))}
    records = {name: getattr(parts, name) for name in ("core", "inputs", "answer", "health", "derived", "monitor")}
    for name, record in {**records, "estimator": parts.chosen.state}.items():
        for field, values in _whole_numbers(record):
            least, most = _limits(field, values, special)
            if values.size and not (least <= int(values.min()) and int(values.max()) <= most):
                return f"{name}: {field} is none"
    for field in contract.BY_FILE:
        if parts.inputs[field].tobytes() != like.inputs[field].tobytes():
            return f"inputs: {field} is not that of the vehicle file"
    return _wrong_value(parts.inputs, rules) or _wrong_clock(parts, rules)


def waiting_problem(waiting: NDArray[np.void], arrived_us: int, rules: Any) -> str:
    """Return what is wrong with the samples that wait, "" if nothing is.

    Args:
        waiting: `delays.SAMPLES` ``[n]``.
        arrived_us: time of the last frame.
        rules: `RULES` record.
    """
    if not len(waiting):
        return ""
    oldest_us = arrived_us - int(rules["longest_delay_us"]) - int(rules["max_step_back_us"])
    t_us = waiting["t_us"]
    if not oldest_us <= int(t_us.min()) or int(t_us.max()) > arrived_us or (np.diff(t_us) < 0).any():
        return "the times of the samples that wait are none"
    if (waiting["there"] > 1).any():
        return "what waits is none"
    least, most = _ranges(rules)
    value = waiting["value"]
    if ((waiting["there"] > 0) & ~((value >= least) & (value <= most))).any():
        return "a value that waits is out of range"
    return ""


def _whole_numbers(record: NDArray[Any], name: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and values of every field that holds no floating-point numbers, but for a tape."""
    if record.dtype.names is None:
        if record.dtype.kind != "f":
            yield name, record.view(np.uint8) if record.dtype.kind == "b" else record
        return
    for field in record.dtype.names:
        if field != "tape":
            yield from _whole_numbers(record[field], field)


def _limits(field: str, values: NDArray[Any], special: contract.Limits) -> tuple[int, int]:
    if field in special:
        return special[field]
    if field.endswith("_us"):
        return _TIMES
    if "gear" in field and values.dtype.itemsize > 1:
        return _GEARS
    if values.dtype.itemsize == 1:
        return 0, 1
    return (0, int(np.iinfo(values.dtype).max)) if values.dtype.kind == "u" else _COUNTS


def _ranges(rules: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return least and largest value of each input; speeds may have got the other sign, or be those of a gear."""
    least, most = rules["minimum"].copy(), rules["maximum"].copy()
    least[_SPEEDS], most[_SPEEDS] = -WIDEST, WIDEST
    return least, most


def _wrong_value(inputs: NDArray[np.void], rules: Any) -> str:
    least, most = _ranges(rules)
    value, there = inputs["value"][0], inputs["available"][0] > 0
    if (there & ~((value >= least) & (value <= most))).any():
        return "inputs: a value is out of range"
    return ""


def _wrong_clock(parts: Parts, rules: Any) -> str:
    arrived_us, now_us = int(parts.core["arrived_us"][0]), int(parts.inputs["t_us"][0])
    state = parts.chosen.state
    running = bool(parts.answer["running"][0] or ("running" in state.dtype.names and state["running"][0]))
    if arrived_us == NEVER:
        return "it runs, but no frame has come" if running else ""
    longest_us = int(rules["longest_delay_us"]) + int(rules["max_gap_us"])
    if abs(arrived_us) > LATEST_US or not arrived_us - longest_us <= now_us <= arrived_us:
        return "the clock of the inputs is wrong"
    if running and "t_us" in state.dtype.names and abs(int(state["t_us"][0]) - now_us) > _APART_US:
        return "the clock of the estimator is wrong"
    return ""
