"""The compiled decoder with all its tables and states in one piece of memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.belief import CHANGE_STATE
from dctorque_can.bus.frame_check import MESSAGE_STATE
from dctorque_can.bus.loop import SCRATCH, TERM_STATE, decode_frames
from dctorque_can.bus.packing import packed
from dctorque_can.bus.tables import CONDITION, EXTENDED, FIELD, GROUP, INPUT, MESSAGE, RAW, TERM, DecoderTables
from dctorque_can.compiled import compiled


def decoder_memory(tables: DecoderTables) -> NDArray[np.int64]:
    """Return the memory of a decoder before the first frame."""
    return packed(
        *(tables.standard, tables.extended, tables.groups, tables.messages, tables.pairs, tables.inputs),
        *(tables.terms, tables.conditions, tables.fields, tables.raws),
        np.zeros(len(tables.messages), MESSAGE_STATE),
        np.zeros(len(tables.terms), TERM_STATE),
        np.zeros(len(tables.inputs), CHANGE_STATE),
        np.zeros(1, SCRATCH),
    )


def message_states(memory: NDArray[np.int64]) -> NDArray[np.void]:
    """Return the `MESSAGE_STATE` rows in the memory of a decoder."""
    return memory[memory[10] : memory[11]].view(MESSAGE_STATE)


def term_states(memory: NDArray[np.int64]) -> NDArray[np.void]:
    """Return the `TERM_STATE` rows in the memory of a decoder."""
    return memory[memory[11] : memory[12]].view(TERM_STATE)


def change_states(memory: NDArray[np.int64]) -> NDArray[np.void]:
    """Return the `CHANGE_STATE` rows in the memory of a decoder."""
    return memory[memory[12] : memory[13]].view(CHANGE_STATE)


@compiled
def decode_batch(
    t_us: NDArray[np.int64],
    can_id: NDArray[np.uint32],
    length: NDArray[np.uint8],
    flags: NDArray[np.uint8],
    channel: NDArray[np.uint8],
    data: NDArray[np.uint8],
    memory: NDArray[np.int64],
    out_t_us: NDArray[np.int64],
    out_quantity: NDArray[np.uint8],
    out_value: NDArray[np.float64],
    out_status: NDArray[np.uint8],
    out_last: NDArray[np.bool_],
) -> int:
    """Decode frames as `decode_frames` does, with the tables and states of a `decoder_memory`."""
    return decode_frames(
        t_us,
        can_id,
        length,
        flags,
        channel,
        data,
        memory[memory[0] : memory[1]],
        memory[memory[1] : memory[2]].view(EXTENDED),
        memory[memory[2] : memory[3]].view(GROUP),
        memory[memory[3] : memory[4]].view(MESSAGE),
        memory[memory[4] : memory[5]],
        memory[memory[5] : memory[6]].view(INPUT),
        memory[memory[6] : memory[7]].view(TERM),
        memory[memory[7] : memory[8]].view(CONDITION),
        memory[memory[8] : memory[9]].view(FIELD),
        memory[memory[9] : memory[10]].view(RAW),
        memory[memory[10] : memory[11]].view(MESSAGE_STATE),
        memory[memory[11] : memory[12]].view(TERM_STATE),
        memory[memory[12] : memory[13]].view(CHANGE_STATE),
        memory[memory[13] : memory[14]].view(SCRATCH),
        out_t_us,
        out_quantity,
        out_value,
        out_status,
        out_last,
    )
