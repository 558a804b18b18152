"""What is believed of frames that are right by themselves: after many that were not, and when a value jumps.

A checksum of eight bits lets one damaged frame in 256 pass. So a message of which most frames are damaged is not
believed at all until several right ones follow each other, as in the state machine of AUTOSAR E2E (error and OK
counters with a window).

Times are those of frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.samples import SampleStatus

FAULT_COST = 2
"""A bad frame costs so much, a right one gives one back: so a third of bad frames is borne for ever."""
FAULTS_BORNE = 3
"""So many bad frames in a row are too many."""
RIGHT_IN_A_ROW = 3
"""So many right frames in a row make a message believed again."""
AGREEING = 3
"""So many values in a row that fit each other are believed although they do not fit the one before."""

N_STATUSES = len(SampleStatus)

BELIEF = [
    ("faults", "i8"),  # what bad frames have cost
    ("right", "i8"),  # frames in a row, while it is not believed
    ("doubted", "i8"),  # 1: not believed
    ("doubts", "i8"),  # how often that began
    ("counts", "i8", (N_STATUSES,)),  # frames by their worst `SampleStatus`
]
"""Fields of the state of a message."""

CHANGE_STATE = np.dtype(
    [
        ("value", "f8"),  # the last one that was believed, SI
        ("t_us", "i8"),
        ("span_us", "i8"),  # from the one before it
        ("known", "i8"),
        ("other", "f8"),  # the last one that was not
        ("other_us", "i8"),
        ("others", "i8"),  # how many of them fit each other
    ],
    align=True,
)
"""Latest values of an input."""

OK = int(SampleStatus.OK)
NOT_BELIEVED, BAD_RATE = int(SampleStatus.NOT_BELIEVED), int(SampleStatus.BAD_RATE)


@compiled_without_allocation
def believe(state: Any, status: int) -> int:
    """Return the status of a protected frame by what became of those before it, and remember this one.

    Args:
        state: record with the fields of `BELIEF`.
        status: of the frame by itself.
    """
    if status != OK:
        state.right = 0
        state.faults = min(max(state.faults, 0) + FAULT_COST, FAULT_COST * FAULTS_BORNE)
        if state.faults == FAULT_COST * FAULTS_BORNE and state.doubted == 0:
            state.doubted = 1
            state.doubts += 1
        return status
    if state.doubted == 0:
        state.faults = max(state.faults - 1, 0)
        return OK
    state.right += 1
    if state.right < RIGHT_IN_A_ROW:
        return NOT_BELIEVED
    state.doubted = state.faults = state.right = 0
    return OK


@compiled_without_allocation
def may_change(value: float, t_us: int, given: Any, state: Any) -> bool:
    """Return whether an input can have become ``value`` since the last one that was believed, and remember it.

    Frames come with jitter, so two values may be as far apart as in the longer one of the last two intervals. A
    value that is older than the timeout of its input is not compared.
    """
    ago_us = t_us - state.t_us
    fits = state.known == 0 or not 0 <= ago_us < given.timeout_us
    if fits:
        ago_us = 0
    else:
        most = given.most_per_s * 1e-6 * max(ago_us, state.span_us) + given.resolution
        fits = abs(value - state.value) <= most
    if not fits:
        since_us = t_us - state.other_us
        most = given.most_per_s * 1e-6 * max(since_us, state.span_us) + given.resolution
        agrees = state.others > 0 and since_us >= 0 and abs(value - state.other) <= most
        state.others = min(max(state.others, 0), AGREEING) + 1 if agrees else 1
        state.other, state.other_us = value, t_us
        fits = state.others >= AGREEING
        ago_us = 0
    if fits:
        state.value, state.t_us, state.span_us = value, t_us, ago_us
        state.known, state.others = 1, 0
    return bool(fits)


@compiled_without_allocation
def doubt_jumps(
    first: int,
    n: int,
    t_us: int,
    message: Any,
    pairs: NDArray[np.int64],
    inputs: NDArray[Any],
    states: NDArray[Any],
    quantity: NDArray[np.uint8],
    value: NDArray[np.float64],
    status: NDArray[np.uint8],
) -> None:
    """Refuse what changes faster than it can, among the samples ``first`` to ``n`` of one frame of a message."""
    for pair in range(message.first_pair, message.first_pair + message.n_pairs):
        given = inputs[pairs[pair]]
        if given.most_per_s == np.inf:
            continue
        for k in range(first, n):
            if quantity[k] != given.quantity or status[k] != OK:
                continue
            if not may_change(value[k], t_us, given, states[pairs[pair]]):
                status[k], value[k] = BAD_RATE, 0.0


@compiled_without_allocation
def worst_of(first: int, n: int, frame_status: int, status: NDArray[np.uint8]) -> int:
    """Return the worst status of a frame and of its samples ``first`` to ``n``."""
    worst = frame_status
    for k in range(first, n):
        worst = max(worst, int(status[k]))
    return worst
