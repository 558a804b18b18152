"""Whether a frame counts: its length, its checksum, its alive counter, and what became of those before it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.belief import BELIEF, believe
from dctorque_can.bus.protection import constants_hold, payload_checksum
from dctorque_can.bus.raw_bits import lies_within, read_parts
from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.samples import SampleStatus

MESSAGE_STATE = np.dtype(
    [("counter", "i8"), ("t_us", "i8"), ("synchronised", "b1"), ("period_us", "i8"), *BELIEF], align=True
)
"""Alive counter of a message: the last one, when a frame with a correct CRC was last seen, and how long a step
usually takes at most; then whether the message is believed."""

REPEATED = -1
"""Status of a frame whose counter did not step, told as BAD_COUNTER."""

PERIOD_STEPS = 64
"""Steps of a counter after which the longest one is forgotten, mostly: frames may come in batches."""

OK, BAD_LENGTH = int(SampleStatus.OK), int(SampleStatus.BAD_LENGTH)
BAD_CRC, BAD_COUNTER = int(SampleStatus.BAD_CRC), int(SampleStatus.BAD_COUNTER)

Table = NDArray[Any]  # structured arrays of tables.py; their fields are numbers


@compiled_without_allocation
def _check_frame(
    t_us: int,
    there: int,
    data: NDArray[np.uint8],
    i: int,
    message: Any,
    state: Any,
    fields: Table,
    raws: Table,
) -> int:
    """Return the status of a frame as a whole, or `REPEATED`, and renew the counter of its message.

    ``there`` are the bytes of the frame that there are. A frame shorter than its message is as good as another,
    unless it lacks the counter or a byte that its CRC covers.

    The counter may step by 1..max_counter_delta. A repeated one is rejected. A larger step is rejected too, but
    the next step is measured from there. A counter that had time to run past itself may have made a larger step
    than it shows. After a silence of the message's timeout (or a step of the clock that large) any counter is
    accepted. Silence means: no frame with a correct CRC, so a sender that repeats one frame for ever is never
    accepted again.
    """
    if there < message.length:
        if message.crc_bits > 0:
            return BAD_LENGTH
        if message.counter_field >= 0 and not lies_within(fields[message.counter_field], there):
            return BAD_LENGTH
        if message.counter_high_field >= 0 and not lies_within(fields[message.counter_high_field], there):
            return BAD_LENGTH
    counter = np.int64(0)
    if message.counter_field >= 0:
        low, high = message.counter_field, message.counter_high_field
        counter = np.int64(read_parts(data, i, low, high, message.counter_low_bits, fields))
    if message.crc_bits > 0:
        sent = read_parts(data, i, message.crc_field, message.crc_high_field, message.crc_low_bits, fields)
        if payload_checksum(data, i, message, counter, raws) != sent or not constants_hold(data, i, message, raws):
            return BAD_CRC
    if message.counter_field < 0:
        return OK
    if counter >= message.counter_modulus:
        return BAD_COUNTER
    resynchronise = not state.synchronised or abs(t_us - state.t_us) >= message.timeout_us
    step = (counter - state.counter) % message.counter_modulus
    ago_us = t_us - state.t_us
    state.t_us = t_us
    state.counter = counter
    state.synchronised = True
    if resynchronise:
        return OK
    if step == 0:
        return REPEATED
    if step > message.max_counter_delta:
        return BAD_COUNTER
    around_us = state.period_us * (step + message.counter_modulus // 2)
    if 0 < around_us < ago_us:
        return BAD_COUNTER
    state.period_us = max(ago_us // step, state.period_us - state.period_us // PERIOD_STEPS)
    return OK


@compiled_without_allocation
def judge_frame(
    t_us: int,
    there: int,
    data: NDArray[np.uint8],
    i: int,
    message: Any,
    state: Any,
    fields: Table,
    raws: Table,
) -> int:
    """Return the status of a frame, of itself and by what became of those before it."""
    status = _check_frame(t_us, there, data, i, message, state, fields, raws)
    if message.crc_bits == 0 and message.counter_field < 0:
        return status
    if status == REPEATED:
        return BAD_COUNTER  # it speaks neither for its sender nor against it
    return believe(state, status)
