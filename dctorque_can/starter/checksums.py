"""Checksums of many frames at once, to try kinds on a log; the loop that checks frames is in `bus.protection`.

Both read one rule, which `checksum_rule` of `bus.protection` makes.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from cantools.database.can import Message
from numpy.typing import NDArray

from dctorque_can.bus.checksum_kinds import CRC_TABLES, Step
from dctorque_can.bus.protection import CHECKSUM, checksum_rule
from dctorque_can.pipeline.samples import Protection

Words = NDArray[np.uint64]


@dataclass(frozen=True)
class Payloads:
    """Frames of one message.

    Attributes:
        data: uint8 ``[n, length]``.
        counter: int64 ``[n]``; zero where there is none.
    """

    data: NDArray[np.uint8]
    counter: NDArray[np.int64]


def checksums(message: Message, protection: Protection, payloads: Payloads) -> Words:
    """Return the checksum that each payload should have, uint64 ``[n]``.

    Args:
        message: of the payloads, which are as long as it.
        protection: without problems.
        payloads: ``[n]``.
    """
    values, rows = checksum_rule(message, protection, 0)
    rule = SimpleNamespace(**dict(zip((name for name, _ in CHECKSUM), values, strict=True)))
    numbers = np.array([bits for bits, _ in rows] or [0], np.uint64)
    register = np.full(len(payloads.data), rule.crc_start % 2**64, np.uint64)
    ids = rule.crc_first_id + (payloads.counter & rule.crc_id_mask)
    steps = range(rule.crc_n_ids)
    if rule.crc_ids_first == 1:
        for k in steps:
            register = _with_bytes(register, numbers[ids + k], rule)
    for k in range(rule.crc_bytes):
        if rule.crc_covered >> k & 1:
            byte = payloads.data[:, k].astype(np.uint64)
            if rule.crc_first_mask >= 0:
                mask = int(numbers[rule.crc_first_mask + k // 8]) >> 8 * (k % 8) & 0xFF
                byte &= np.uint64(mask)
            register = _with_bytes(register, byte, rule)
    if rule.crc_ids_first == 0:
        for k in steps:
            register = _with_bytes(register, numbers[ids + k], rule)
    return (register ^ np.uint64(rule.crc_final % 2**64)) & np.uint64(rule.crc_mask)


def _with_bytes(register: Words, byte: Words, rule: SimpleNamespace) -> Words:
    """Return the registers after one byte more each, as `_with_byte` of `bus.protection` does it."""
    table: Words = CRC_TABLES[rule.crc_table]
    if rule.crc_step == Step.LOW_BYTE:
        stepped: Words = (register >> np.uint64(8)) ^ table[(register ^ byte) & np.uint64(0xFF)]
    elif rule.crc_step == Step.SUM:
        stepped = register + table[byte]
    else:
        stepped = (register << np.uint64(8)) ^ table[((register >> np.uint64(8)) ^ byte) & np.uint64(0xFF)]
    return stepped
