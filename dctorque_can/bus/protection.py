"""Alive counters and checksums of protected messages.

All three checksums are one 8-bit CRC over the payload without the CRC's own byte, in order of the bytes; they
differ in polynomial, start value, an id that is appended, and the final XOR:

* ``crc8_j1850``: SAE J1850, polynomial 0x1D, start 0xFF, final XOR 0xFF.
* ``e2e_p01``: AUTOSAR E2E profile 1 (data id mode "both"): the same polynomial, start 0, low and high byte of
  the data id before the payload, no final XOR; the counter runs 0..14.
* ``e2e_p02``: AUTOSAR E2E profile 2: polynomial 0x2F, start 0xFF, after the payload the data id that belongs to
  the counter, final XOR 0xFF; the counter runs 0..15.

Source: AUTOSAR PRS E2E Protocol, sections "Profile 1" and "Profile 2"; SAE J1850.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from cantools.database.can import Database, Message
from numpy.typing import NDArray

from dctorque_can.bus.layout import SignalLayout
from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.samples import Protection

CRC_KINDS = ("none", "crc8_j1850", "e2e_p01", "e2e_p02")
P01_MODULUS = 15
P02_MODULUS = 16


def _crc_table(polynomial: int) -> NDArray[np.uint8]:
    table = np.zeros(256, np.uint8)
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = ((register << 1) ^ polynomial) & 0xFF if register & 0x80 else register << 1
        table[byte] = register
    return table


CRC_TABLES = np.stack([_crc_table(0x1D), _crc_table(0x2F)])
J1850, H2F = 0, 1


CHECKSUM = [
    ("length", "i8"),  # payload bytes covered, those of the DBC message
    ("crc_table", "i8"),  # row of CRC_TABLES, -1: no CRC
    ("crc_start", "u1"),  # register before the first payload byte; the data id of profile 1 is already in it
    ("crc_final", "u1"),  # XOR at the end
    ("crc_byte", "i8"),  # the CRC's own byte, which is left out
    ("crc_first_id", "i8"),  # where the ids of profile 2 stand, -1: none
]
"""Fields of a record that says how the CRC of a message is formed."""


def checksum_rule(message: Message, protection: Protection, first_id: int) -> tuple[int, ...]:
    """Return the values of `CHECKSUM` for a protection that has no problems.

    Args:
        message: the protected message.
        protection: its protection.
        first_id: where the caller keeps ``protection.data_ids``.
    """
    if protection.crc == "none":
        return message.length, -1, 0, 0, 0, -1
    crc_byte = SignalLayout.of(message.get_signal_by_name(protection.crc_signal)).lsb_byte
    if protection.crc == "crc8_j1850":
        return message.length, J1850, 0xFF, 0xFF, crc_byte, -1
    if protection.crc == "e2e_p01":
        table = CRC_TABLES[J1850]
        start = int(table[int(table[protection.data_id & 0xFF]) ^ (protection.data_id >> 8)])
        return message.length, J1850, start, 0, crc_byte, -1
    return message.length, H2F, 0xFF, 0xFF, crc_byte, first_id


@compiled_without_allocation
def payload_crc(data: NDArray[np.uint8], i: int, rule: Any, counter: np.int64, ids: NDArray[Any]) -> np.uint8:
    """Return the CRC of payload ``i``.

    Args:
        data: uint8 ``[n, width]``.
        i: row of ``data``.
        rule: record with the fields of `CHECKSUM`.
        counter: alive counter of the payload.
        ids: records whose ``bits`` are ids, which ``rule.crc_first_id`` points into.

    Bounds: the caller has found row ``i`` to be as wide as ``rule.length``, to which `protection_problems` holds
    the CRC's byte. It also holds profile 2 to a counter of 4 bits and an id for each of its values.
    """
    register = rule.crc_start
    for byte in range(rule.length):
        if byte != rule.crc_byte:
            register = CRC_TABLES[rule.crc_table, register ^ data[i, byte]]
    if rule.crc_first_id >= 0:
        register = CRC_TABLES[rule.crc_table, register ^ np.uint8(ids[rule.crc_first_id + counter].bits)]
    return register ^ rule.crc_final  # type: ignore[no-any-return]


def declared_protections(database: Database) -> tuple[Protection, ...]:
    """Return the protections that a DBC declares itself.

    Read are the message attributes ``E2EProfile`` (one of `CRC_KINDS`) and ``E2EDataId`` and the signal attribute
    ``E2ERole`` ("crc" or "counter"), as in the DBCs that ship with this package.
    """
    return tuple(_declared(message) for message in database.messages if _attribute(message, "E2EProfile"))


def _declared(message: Message) -> Protection:
    profile = str(_attribute(message, "E2EProfile"))
    return Protection(
        message=message.name,
        counter_signal=_named(message.signals, "counter"),
        counter_modulus=P01_MODULUS if profile == "e2e_p01" else P02_MODULUS,
        crc=profile,
        crc_signal=_named(message.signals, "crc"),
        data_id=int(_attribute(message, "E2EDataId") or 0),
    )


def _named(signals: Sequence[Any], role: str) -> str:
    return next((str(s.name) for s in signals if _attribute(s, "E2ERole") == role), "")


def _attribute(item: Any, name: str) -> Any:
    """Return the value of a DBC attribute of a message or signal, an enumeration by its word; None if not set."""
    attribute = item.dbc.attributes.get(name) if item.dbc is not None else None
    if attribute is None:
        return None
    choices = attribute.definition.choices
    return choices[int(attribute.value)] if attribute.definition.type_name == "ENUM" else attribute.value
