"""The compiled loop from frames to samples: frame after frame, the same for one and for a million."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.belief import doubt_jumps, worst_of
from dctorque_can.bus.frame_check import judge_frame
from dctorque_can.bus.layout import Coding
from dctorque_can.bus.raw_bits import lies_within, read_bits
from dctorque_can.bus.tables import N_STANDARD_IDS
from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.frames import FrameFlag
from dctorque_can.pipeline.samples import SampleStatus

TERM_STATE = np.dtype([("value", "f8"), ("t_us", "i8"), ("known", "b1")], align=True)
"""Latest value of a term, SI."""

SCRATCH = np.dtype(
    {"names": ["bits", "as_f32", "as_f64"], "formats": ["<u8", "<f4", "<f8"], "offsets": [0, 0, 0], "itemsize": 8}
)
"""One word that is written as bits and read as a number."""

# Compiled code takes enum members as plain numbers.
OK = int(SampleStatus.OK)
NOT_AVAILABLE = int(SampleStatus.NOT_AVAILABLE)
OUT_OF_RANGE = int(SampleStatus.OUT_OF_RANGE)
UNSIGNED, SIGNED, FLOAT32 = int(Coding.UNSIGNED), int(Coding.SIGNED), int(Coding.FLOAT32)
IGNORED = int(FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.SENT)

Table = NDArray[Any]  # structured arrays of tables.py; their fields are numbers


@compiled_without_allocation
def _on_channel(m: int, channel: int, messages: Table) -> int:
    """Return which of the messages of one identifier counts on a channel, -1 for none.

    Bound: each message leads to one that stands behind it, or to none.
    """
    while m >= 0 and messages[m].channel >= 0 and messages[m].channel != channel:
        m = messages[m].next
    return m


@compiled_without_allocation
def _message_of(
    can_id: int, channel: int, standard: Table, extended: Table, groups: Table, messages: Table
) -> int:
    """Return the index of the message that a frame is, -1 when nothing reads it.

    Bounds: a binary search; then once over ``groups``, which has a row for each J1939 message.
    """
    if can_id < N_STANDARD_IDS:
        return _on_channel(standard[can_id], channel, messages)
    low, high = 0, len(extended)
    while low < high:
        middle = (low + high) // 2
        if extended[middle].can_id < can_id:
            low = middle + 1
        else:
            high = middle
    if low < len(extended) and extended[low].can_id == can_id:
        m = _on_channel(extended[low].message, channel, messages)
        if m >= 0:
            return m
    for row in range(len(groups)):
        group = groups[row]
        if (can_id ^ group.can_id) & group.mask == 0:
            expected = messages[group.message].channel
            if expected < 0 or expected == channel:
                return group.message  # type: ignore[no-any-return]
    return -1


@compiled_without_allocation
def find_raw(raws: Table, first: int, n: int, bits: np.uint64) -> int:
    """Return the row of ``raws`` with these bits, -1 for none; ``first`` and ``n`` are those of a table's row."""
    for row in range(first, first + n):
        if raws[row].bits == bits:
            return row
    return -1


@compiled_without_allocation
def _is_selected(
    data: NDArray[np.uint8], i: int, term: Any, conditions: Table, fields: Table, raws: Table
) -> bool:
    """Return whether the multiplexers of a signal select it in this frame."""
    for k in range(term.first_condition, term.first_condition + term.n_conditions):
        condition = conditions[k]
        bits = read_bits(data, i, fields[condition.field])
        if find_raw(raws, condition.first_raw, condition.n_raws, bits) < 0:
            return False
    return True


@compiled_without_allocation
def _selectors_lie_within(there: int, term: Any, conditions: Table, fields: Table) -> bool:
    """Return whether all multiplexers of a signal are among the first ``there`` bytes of a frame."""
    for k in range(term.first_condition, term.first_condition + term.n_conditions):
        if not lies_within(fields[conditions[k].field], there):
            return False
    return True


@compiled_without_allocation
def _physical(bits: np.uint64, term: Any, scratch: Any) -> float:
    """Return the physical value of raw bits in the DBC's unit."""
    if term.coding == UNSIGNED:
        number = np.float64(bits)
    elif term.coding == SIGNED:
        number = np.float64(np.int64(bits << term.unused_bits) >> np.int64(term.unused_bits))
    else:
        scratch.bits = bits
        number = np.float64(scratch.as_f32) if term.coding == FLOAT32 else scratch.as_f64
    return number * term.scale + term.offset  # type: ignore[no-any-return]


@compiled_without_allocation
def _renew_term(
    t_us: int,
    data: NDArray[np.uint8],
    i: int,
    term: Any,
    state: Any,
    fields: Table,
    raws: Table,
    scratch: Any,
) -> int:
    """Read one signal; only a usable value changes the state. Return its status."""
    bits = read_bits(data, i, fields[term.field])
    if find_raw(raws, term.first_not_available, term.n_not_available, bits) >= 0:
        return NOT_AVAILABLE
    if term.n_values > 0:
        row = find_raw(raws, term.first_value, term.n_values, bits)
        if row < 0:
            return NOT_AVAILABLE
        number = raws[row].value
    else:
        number = _physical(bits, term, scratch)
    value = term.factor * number + term.si_offset
    if not np.isfinite(value):
        return NOT_AVAILABLE
    state.value = value
    state.t_us = t_us
    state.known = True
    return OK


@compiled_without_allocation
def _renew_beside(
    t_us: int,
    there: int,
    whole: bool,
    data: NDArray[np.uint8],
    i: int,
    term: Any,
    state: Any,
    conditions: Table,
    fields: Table,
    raws: Table,
    scratch: Any,
) -> int:
    """Read what a sum is multiplied with, or what says whether it is valid. Return its status.

    Once it is not available, or behind the end of a frame, the latest value counts no more.
    """
    told = whole or _selectors_lie_within(there, term, conditions, fields)
    if told and not _is_selected(data, i, term, conditions, fields, raws):
        return OK
    status = NOT_AVAILABLE
    if told and (whole or lies_within(fields[term.field], there)):
        status = _renew_term(t_us, data, i, term, state, fields, raws, scratch)
    if status != OK:
        state.known = False
    return status


@compiled_without_allocation
def _counts(t_us: int, state: Any, timeout_us: int) -> bool:
    """Return whether a latest value still counts."""
    return state.known and abs(t_us - state.t_us) < timeout_us  # type: ignore[no-any-return]


@compiled_without_allocation
def _multiplied(value: float, t_us: int, given: Any, state: Any) -> float:
    """Return a sum times its multiplier, or divided by it; infinite without one."""
    if not _counts(t_us, state, given.multiplier_timeout_us):
        return np.inf
    if given.divides:
        return value / state.value if state.value != 0.0 else np.inf
    return value * state.value  # type: ignore[no-any-return]


@compiled_without_allocation
def _reject_whole_frame(first: int, n: int, value: NDArray[np.float64], status: NDArray[np.uint8]) -> None:
    """Trust nothing in a frame that has one value out of range."""
    rejected = False
    for k in range(first, n):
        rejected |= status[k] == OUT_OF_RANGE
    if rejected:
        for k in range(first, n):
            value[k] = 0.0
            status[k] = OUT_OF_RANGE


@compiled_without_allocation
def decode_frames(
    t_us: NDArray[np.int64],
    can_id: NDArray[np.uint32],
    length: NDArray[np.uint8],
    flags: NDArray[np.uint8],
    channel: NDArray[np.uint8],
    data: NDArray[np.uint8],
    standard: Table,
    extended: Table,
    groups: Table,
    messages: Table,
    pairs: Table,
    inputs: Table,
    terms: Table,
    conditions: Table,
    fields: Table,
    raws: Table,
    message_states: Table,
    term_states: Table,
    change_states: Table,
    scratch: Table,
    out_t_us: NDArray[np.int64],
    out_quantity: NDArray[np.uint8],
    out_value: NDArray[np.float64],
    out_status: NDArray[np.uint8],
    out_last: NDArray[np.bool_],
) -> int:
    """Decode frames in order and return the number of samples written.

    The tables are those of `DecoderTables`; the states and the one row of scratch belong to the caller; the
    outputs have room for every input of every frame.

    Bounds: all indices but the identifier come out of the tables, which `build_tables` makes, and point into them.
    Identifiers below `N_STANDARD_IDS` are the only ones that are an index. -1 is returned, and nothing is written
    there, when a column of the frames is shorter than the others, or one of the outputs has no room.
    """
    n = 0
    rows = len(t_us)
    if min(len(can_id), len(length), len(flags), len(channel), len(data)) < rows:
        return -1
    room = min(len(out_t_us), len(out_quantity), len(out_value), len(out_status), len(out_last))
    for i in range(rows):
        m = _message_of(can_id[i], channel[i], standard, extended, groups, messages)
        if m < 0 or flags[i] & IGNORED:
            continue
        message = messages[m]
        if n + message.n_pairs > room:
            return -1
        first = n
        there = min(np.int64(length[i]), data.shape[1])
        whole = there >= message.length
        belief = message_states[m]
        frame_status = judge_frame(t_us[i], there, data, i, message, belief, fields, raws)
        for pair in range(message.first_pair, message.first_pair + message.n_pairs):
            given = inputs[pairs[pair]]
            status, value, renewed = frame_status, 0.0, frame_status != OK
            if frame_status == OK:
                for k in range(given.first_term, given.first_term + given.n_terms):
                    if terms[k].message != m:
                        continue
                    told = whole or _selectors_lie_within(there, terms[k], conditions, fields)
                    if told and not _is_selected(data, i, terms[k], conditions, fields, raws):
                        continue
                    renewed = True
                    if not told or not (whole or lies_within(fields[terms[k].field], there)):
                        status = max(status, NOT_AVAILABLE)
                    else:
                        term_status = _renew_term(
                            t_us[i], data, i, terms[k], term_states[k], fields, raws, scratch[0]
                        )
                        status = max(status, term_status)
                for k in (given.multiplier, given.validity):
                    if k >= 0 and terms[k].message == m:
                        at = terms[k], term_states[k], conditions, fields, raws, scratch[0]
                        term_status = _renew_beside(t_us[i], there, whole, data, i, *at)
                        status = max(status, term_status)
                        renewed |= term_status != OK  # else it waits for the next sum
            if renewed and status == OK:
                for k in range(given.first_term, given.first_term + given.n_terms):
                    state = term_states[k]
                    value += state.value
                    renewed &= _counts(t_us[i], state, given.timeout_us)
                if given.multiplier >= 0:
                    value = _multiplied(value, t_us[i], given, term_states[given.multiplier])
                k = given.validity
                if k >= 0 and not _counts(t_us[i], term_states[k], given.validity_timeout_us):
                    value = np.inf
                if not np.isfinite(value):
                    status, value = NOT_AVAILABLE, 0.0
                elif not given.minimum <= value <= given.maximum:
                    status, value = OUT_OF_RANGE, 0.0
            if renewed:
                out_t_us[n] = t_us[i]
                out_quantity[n] = given.quantity
                out_value[n] = value
                out_status[n] = status
                out_last[n] = False
                n += 1
        if n > first:
            out_last[n - 1] = True
            _reject_whole_frame(first, n, out_value, out_status)
            samples = out_quantity, out_value, out_status
            doubt_jumps(first, n, t_us[i], message, pairs, inputs, change_states, *samples)
        belief.counts[worst_of(first, n, frame_status, out_status)] += 1
    return n
