"""Alive counters and checksums of protected messages.

A checksum is the register of its `Kind` after these bytes: its data id if that goes first, the payload without the
checksum's own bytes, its data id if that goes last. Where a checksum has four bits, its byte counts without them.

Some profiles of AUTOSAR have constant bytes in the payload too, which a sender writes and a receiver compares: the
length of the message and its data id (profiles 4, 6 and 7), four bits of the data id (mode "nibble" of profiles 1
and 11).

Sources: those of `checksum_kinds`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from cantools.database.can import Database, Message
from numpy.typing import NDArray

from dctorque_can.bus.checksum_kinds import CRC_TABLES, HYUNDAI_CANFD_ID, KINDS, Coverage, Kind, Step
from dctorque_can.bus.layout import MAX_BYTES, SignalLayout
from dctorque_can.bus.vw_mqb import DATA_IDS
from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.samples import Protection

CRC_KINDS = ("none", *KINDS)
DATA_ID_MODES = ("both", "low", "alternating", "nibble")

CHECKSUM = [
    ("length", "i8"),  # bytes of the DBC message
    ("crc_bits", "i8"),  # of the checksum, 0: none
    ("crc_low_bits", "u8"),  # of them, how many are in the signal with the lower ones
    ("crc_step", "i8"),  # Step
    ("crc_table", "i8"),  # row of CRC_TABLES
    ("crc_start", "u8"),
    ("crc_final", "u8"),  # XOR at the end
    ("crc_mask", "u8"),  # the bits of the checksum
    ("crc_bytes", "i8"),  # so many first bytes of the payload are covered, but for …
    ("crc_covered", "u8"),  # … those whose bit is not set here
    ("crc_first_mask", "i8"),  # where masks of the bytes stand, eight in a row; -1: all bits count
    ("crc_first_id", "i8"),  # where the bytes of ids stand
    ("crc_n_ids", "i8"),  # how many go in
    ("crc_id_mask", "i8"),  # of the counter, which says where to begin
    ("crc_ids_first", "i8"),  # 1: in front of the payload
    ("crc_first_constant", "i8"),  # where constant bytes stand: mask and bits in ``bits``, the byte in ``value``
    ("crc_n_constants", "i8"),
]
"""Fields of a record that says how the checksum of a message is formed."""

Row = tuple[int, float]  # of the table of raw values, where all that is no single number stands
SUM, LOW_BYTE = int(Step.SUM), int(Step.LOW_BYTE)


def checksum_rule(message: Message, given: Protection, first_row: int) -> tuple[tuple[int, ...], list[Row]]:
    """Return the values of `CHECKSUM` for a protection that has no problems, and the rows that they point to.

    Args:
        message: the protected message.
        given: its protection.
        first_row: where the caller will keep the rows.
    """
    if given.crc == "none":
        return (message.length, *[0] * 9, -1, *[0] * 6), []
    kind = KINDS[given.crc]
    blank = [0] * MAX_BYTES  # bits that do not count, by byte
    not_covered = (*given.crc_signals, *(given.counter_signals if kind.leaves_counter_out else ()))
    for layout in _layouts(message, not_covered):
        _add_bits(blank, layout)
    covered = sum(1 << byte for byte, bits in enumerate(blank) if bits != 0xFF)
    masks = [sum((0xFF ^ blank[word + k]) << 8 * k for k in range(8)) for word in range(0, MAX_BYTES, 8)]
    has_masks = any(bits not in (0, 0xFF) for bits in blank)
    ids, id_mask, ids_first = _ids(kind, message, given)
    constants = constant_bytes(message, given)
    rows: list[Row] = [(each, 0.0) for each in (*(masks if has_masks else ()), *ids)]
    first_id = first_row + (len(masks) if has_masks else 0)
    start = _start(kind, message) if given.crc_start is None else given.crc_start
    values = (
        *(message.length, kind.bits, bits_of(message, given.crc_signal), int(kind.step), kind.table),
        *(start % 2**64, kind.final if given.crc_xor is None else given.crc_xor, (1 << kind.bits) - 1),
        *(given.crc_bytes or message.length, covered, first_row if has_masks else -1),
        *(first_id, 1 if id_mask else len(ids), id_mask, int(ids_first)),
        *(first_row + len(rows), len(constants)),
    )
    return values, rows + [(bits | mask << 8, float(byte)) for byte, (bits, mask) in constants.items()]


def bits_of(message: Message, signal: str) -> int:
    """Return the bits of a signal of a message; 0 for none."""
    return sum(layout.bits for layout in _layouts(message, filter(None, (signal,))))


def _layouts(message: Message, names: Iterable[str]) -> list[SignalLayout]:
    return [SignalLayout.of(message.get_signal_by_name(name)) for name in names]


def _add_bits(blank: list[int], layout: SignalLayout) -> None:
    """Set the bits of a signal in ``blank``, one number a byte."""
    bits = layout.mask << layout.shift
    for k, byte in enumerate(layout.byte_indices):
        blank[byte] |= bits >> 8 * k & 0xFF


def _start(kind: Kind, message: Message) -> int:
    """Return what the register starts with; for sums the identifier and the length are in it."""
    identifier = int(message.frame_id)
    if kind.beside in (Coverage.ID_BYTES, Coverage.ID_BYTES_AND_LENGTH):
        length = message.length if kind.beside is Coverage.ID_BYTES_AND_LENGTH else 0
        return sum(identifier.to_bytes(4, "little")) + int(length)
    if kind.beside is Coverage.ID_NIBBLES:
        nibbles = sum(int(digit, 16) for digit in f"{identifier:x}")
        return kind.start - nibbles + (3 if message.is_extended_frame else 0)
    return kind.start


def _ids(kind: Kind, message: Message, given: Protection) -> tuple[tuple[int, ...], int, bool]:
    """Return the bytes of ids, which bits of the counter choose one of them, and whether they go first."""
    data_id = data_id_of(message, given)
    low, high = data_id & 0xFF, data_id >> 8 & 0xFF
    if kind.beside is Coverage.IDS_BY_COUNTER:
        return data_ids_of(message, given), 15, False
    if kind.beside is Coverage.DATA_ID_BEHIND:
        return (low, high), 0, False
    if kind.beside is Coverage.DATA_ID_BEHIND_HIGH_FIRST:
        return (high, low), 0, False
    if kind.beside is not Coverage.DATA_ID_BEFORE:
        return (), 0, False
    if given.data_id_mode == "alternating":
        return (low, high), 1, True
    return {"both": (low, high), "low": (low,), "nibble": (low, 0)}[given.data_id_mode], 0, True


def data_id_of(message: Message, given: Protection) -> int:
    """Return the data id of a message: that of the identifier, where the kind says so."""
    return HYUNDAI_CANFD_ID + int(message.frame_id) if given.crc == "hyundai_canfd" else given.data_id


def data_ids_of(message: Message, given: Protection) -> tuple[int, ...]:
    """Return the data ids by counter: those that are given, else the known ones of a message of Volkswagen."""
    known = DATA_IDS.get(message.name, ()) if given.crc == "vw_mqb" else ()
    return tuple(given.data_ids or known)


def constant_bytes(message: Message, given: Protection) -> dict[int, tuple[int, int]]:
    """Return (bits, which of them) that the protection itself puts into the payload, by byte."""
    kind = KINDS.get(given.crc)
    if kind is None:
        return {}
    first = min(_layouts(message, (given.crc_signal,))[0].byte_indices)
    if kind.beside is Coverage.DATA_ID_BEFORE and given.data_id_mode == "nibble":
        return {first + 1: (given.data_id >> 8 << 4 & 0xF0, 0xF0)}
    constants: dict[int, tuple[int, int]] = {}
    length = given.crc_bytes or message.length
    for place, number in ((kind.length_at, length), (kind.data_id_at, given.data_id)):
        if place is not None:
            at, size = place
            digits = enumerate(int(number).to_bytes(size, "big"))
            constants |= {first + at + k: (byte, 0xFF) for k, byte in digits}
    return constants


def filled_in(message: Message, given: Protection) -> set[str]:
    """Return the signals that the protection writes: its own, and those that share a bit with constant bytes."""
    constants = constant_bytes(message, given)
    found = {*given.crc_signals, *given.counter_signals}
    for signal in message.signals:
        bits = [0] * MAX_BYTES
        _add_bits(bits, SignalLayout.of(signal))
        if any(bits[byte] & mask for byte, (_, mask) in constants.items()):
            found.add(str(signal.name))
    return found


@compiled_without_allocation
def _with_byte(register: np.uint64, byte: np.uint64, rule: Any) -> np.uint64:
    """Return the register after one byte more, 0..255, which keeps every index within the 256 of a table."""
    if rule.crc_step == LOW_BYTE:
        index = (register ^ byte) & np.uint64(0xFF)
        return (register >> np.uint64(8)) ^ CRC_TABLES[rule.crc_table, index]  # type: ignore[no-any-return]
    if rule.crc_step == SUM:
        return register + CRC_TABLES[rule.crc_table, byte]  # type: ignore[no-any-return]
    index = ((register >> np.uint64(8)) ^ byte) & np.uint64(0xFF)
    return (register << np.uint64(8)) ^ CRC_TABLES[rule.crc_table, index]  # type: ignore[no-any-return]


@compiled_without_allocation
def payload_checksum(
    data: NDArray[np.uint8], i: int, rule: Any, counter: np.int64, raws: NDArray[Any]
) -> np.uint64:
    """Return the checksum of payload ``i``.

    Args:
        data: uint8 ``[n, width]``.
        i: row of ``data``.
        rule: record with the fields of `CHECKSUM`.
        counter: alive counter of the payload.
        raws: the table that the rule points into.

    Bounds: the caller has found row ``i`` to be as wide as ``rule.length``, to which `protection_problems` holds
    ``crc_bytes``. Of ids that depend on the counter there are as many as ``crc_id_mask`` has numbers.
    """
    register = rule.crc_start
    first_id = rule.crc_first_id + (counter & rule.crc_id_mask)
    if rule.crc_ids_first == 1:
        for k in range(first_id, first_id + rule.crc_n_ids):
            register = _with_byte(register, raws[k].bits, rule)
    covered = rule.crc_covered
    for k in range(rule.crc_bytes):
        if covered & np.uint64(1) != np.uint64(0):
            byte = np.uint64(data[i, k])
            if rule.crc_first_mask >= 0:
                byte &= raws[rule.crc_first_mask + k // 8].bits >> np.uint64(8 * (k % 8)) & np.uint64(0xFF)
            register = _with_byte(register, byte, rule)
        covered >>= np.uint64(1)
    if rule.crc_ids_first == 0:
        for k in range(first_id, first_id + rule.crc_n_ids):
            register = _with_byte(register, raws[k].bits, rule)
    return (register ^ rule.crc_final) & rule.crc_mask  # type: ignore[no-any-return]


@compiled_without_allocation
def constants_hold(data: NDArray[np.uint8], i: int, rule: Any, raws: NDArray[Any]) -> bool:
    """Return whether the constant bytes of payload ``i`` are right; `protection_problems` holds them to it."""
    for k in range(rule.crc_first_constant, rule.crc_first_constant + rule.crc_n_constants):
        byte = np.uint64(data[i, np.int64(raws[k].value)])
        if (byte ^ raws[k].bits) & (raws[k].bits >> np.uint64(8)) & np.uint64(0xFF) != np.uint64(0):
            return False
    return True


@compiled_without_allocation
def write_constants(data: NDArray[np.uint8], i: int, rule: Any, raws: NDArray[Any]) -> None:
    """Write the constant bytes of payload ``i``, which `protection_problems` holds to it."""
    for k in range(rule.crc_first_constant, rule.crc_first_constant + rule.crc_n_constants):
        byte = np.int64(raws[k].value)
        mask = np.uint8(raws[k].bits >> np.uint64(8))
        data[i, byte] = (data[i, byte] & ~mask) | np.uint8(raws[k].bits & np.uint64(0xFF))


def declared_protections(database: Database) -> tuple[Protection, ...]:
    """Return the protections that a DBC declares itself.

    Read are the message attributes ``E2EProfile`` (one of `CRC_KINDS`), ``E2EDataId`` and ``E2EDataIds`` (16
    numbers as text), and the signal attribute ``E2ERole`` ("crc", "counter", and "crc_high" or "counter_high" for
    the upper bits of one in two parts), as in the DBCs that ship with this package.
    """
    return tuple(_declared(message) for message in database.messages if _attribute(message, "E2EProfile"))


def _declared(message: Message) -> Protection:
    profile = str(_attribute(message, "E2EProfile"))
    data_ids = re.findall(r"0x[0-9a-f]+|[0-9]+", str(_attribute(message, "E2EDataIds") or "").lower())
    return Protection(
        message=message.name,
        counter_signal=_named(message.signals, "counter"),
        counter_high_signal=_named(message.signals, "counter_high"),
        counter_modulus=KINDS[profile].modulus if profile in KINDS else 16,
        crc=profile,
        crc_signal=_named(message.signals, "crc"),
        crc_high_signal=_named(message.signals, "crc_high"),
        data_id=int(_attribute(message, "E2EDataId") or 0),
        data_ids=tuple(int(each, 16 if each.startswith("0x") else 10) for each in data_ids),
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
