"""The kinds of checksum that a message may have: each one a few numbers, so that one loop forms them all.

A checksum is formed byte by byte, with a table of 256 numbers, in one of three ways (`Step`):

* a CRC whose low byte goes out first: those of 8 bits, which have no other one, and those of AUTOSAR profiles 4
  and 7, whose lowest bit goes first. XOR is one of them: its table holds the bytes themselves;
* a CRC of 16 bits whose high byte goes out first, as profiles 5 and 6 have it;
* a sum, of the bytes, of their nibbles or of their bits.

Kinds differ in what the register starts with, what is XORed to it at the end, and what goes in beside the payload.

Sources: AUTOSAR PRS E2E Protocol, sections on profiles 1, 2, 4, 5, 6, 7 and 11; AUTOSAR SWS CRC Library; SAE
J1850. The kinds of the makers are the findings of opendbc. Three of them are standards: ``chrysler`` is the CRC of
SAE J1850, ``vw_mqb`` is profile 2, and ``hyundai_canfd`` is profile 5 with the data id 0xF800 + identifier.
opendbc starts that with 0 and ends it with one XOR for each length, which comes to the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

LAST_STANDARD_ID = 0x7FF
HYUNDAI_CANFD_ID = 0xF800  # its data ids are this and the identifier of the message


class Step(IntEnum):
    """How a byte enters the register."""

    SUM = 0
    LOW_BYTE = 1
    HIGH_BYTE = 2


class Coverage(IntEnum):
    """What goes in beside the payload."""

    NOTHING = 0
    ID_BYTES = 1  # the sum of the bytes of the identifier
    ID_BYTES_AND_LENGTH = 2  # … and the length of the message
    ID_NIBBLES = 3  # the nibbles of the identifier; 3 more where it has 29 bits
    IDS_BY_COUNTER = 4  # behind the payload the data id that belongs to the counter
    DATA_ID_BEFORE = 5  # the data id in front of the payload, as its mode says
    DATA_ID_BEHIND = 6  # the data id behind the payload, low byte first
    DATA_ID_BEHIND_HIGH_FIRST = 7
    DATA_ID_IN_HEADER = 8  # nothing: the header has it


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of checksum.

    Attributes:
        bits: of the checksum: 4, 8, 16, 32 or 64.
        step: how a byte enters the register.
        table: row of `CRC_TABLES`.
        start: of the register.
        final: XOR at the end.
        beside: what goes in beside the payload.
        open: whether a vehicle file may give another ``start`` and ``final``.
        modulus: of the counter, unless told.
        needs_counter: whether there is none without an alive counter.
        counter_bits: so many bits it must have, 0 for any.
        counter_at: byte of the counter behind the first one of the checksum, None for any.
        leaves_counter_out: whether the bits of the counter do not count, as those of the checksum do not.
        data_id_bits: of the data id, 0 where none is to be told.
        big_endian: of a checksum of several bytes, whether the highest one comes first.
        length_at: the header's length behind the first byte of the checksum, and its bytes.
        data_id_at: the header's data id likewise.
    """

    bits: int
    step: Step
    table: int
    start: int = 0
    final: int = 0
    beside: Coverage = Coverage.NOTHING
    open: bool = False
    modulus: int = 16
    needs_counter: bool = False
    counter_bits: int = 0
    counter_at: int | None = None
    leaves_counter_out: bool = False
    data_id_bits: int = 0
    big_endian: bool = False
    length_at: tuple[int, int] | None = None
    data_id_at: tuple[int, int] | None = None


def _msb_first(bits: int, polynomial: int) -> list[int]:
    table = []
    for byte in range(256):
        register = byte << (bits - 8)
        for _ in range(8):
            register = (register << 1) ^ (polynomial if register >> (bits - 1) else 0)
            register &= (1 << bits) - 1
        table.append(register)
    return table


def _lsb_first(bits: int, polynomial: int) -> list[int]:
    reflected = int(f"{polynomial:0{bits}b}"[::-1], 2)
    table = []
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = (register >> 1) ^ (reflected if register & 1 else 0)
        table.append(register)
    return table


def _negative(numbers: Iterable[int]) -> list[int]:
    return [-number % 2**64 for number in numbers]


CRC_TABLES: NDArray[np.uint64] = np.array(
    [
        _msb_first(8, 0x1D),
        _msb_first(8, 0x2F),
        _msb_first(16, 0x1021),
        _lsb_first(32, 0xF4AC_FB13),
        _lsb_first(64, 0x42F0_E1EB_A9EA_3693),
        list(range(256)),
        _negative((byte & 0xF) + (byte >> 4) for byte in range(256)),
        [byte.bit_count() for byte in range(256)],
    ],
    np.uint64,
)
J1850, H2F, CCITT, P4, ECMA, BYTES, LESS_NIBBLES, BITS = range(len(CRC_TABLES))

_J1850 = Kind(8, Step.LOW_BYTE, J1850, 0xFF, 0xFF, open=True)
_SUM_WITH_ID = Kind(8, Step.SUM, BYTES, beside=Coverage.ID_BYTES)
_P01 = Kind(
    *(8, Step.LOW_BYTE, J1850),
    beside=Coverage.DATA_ID_BEFORE,
    modulus=15,
    needs_counter=True,
    data_id_bits=16,
)
_P02 = Kind(*(8, Step.LOW_BYTE, H2F, 0xFF, 0xFF, Coverage.IDS_BY_COUNTER), needs_counter=True, counter_bits=4)
_P05 = Kind(
    *(16, Step.HIGH_BYTE, CCITT, 0xFFFF),
    beside=Coverage.DATA_ID_BEHIND,
    modulus=256,
    needs_counter=True,
    counter_bits=8,
    counter_at=2,
    data_id_bits=16,
)

KINDS: dict[str, Kind] = {
    "crc8_j1850": _J1850,
    "e2e_p01": _P01,
    "e2e_p02": _P02,
    "e2e_p04": Kind(
        *(32, Step.LOW_BYTE, P4, 0xFFFF_FFFF, 0xFFFF_FFFF, Coverage.DATA_ID_IN_HEADER),
        modulus=2**16,
        needs_counter=True,
        counter_bits=16,
        counter_at=-6,
        data_id_bits=32,
        big_endian=True,
        length_at=(-8, 2),
        data_id_at=(-4, 4),
    ),
    "e2e_p05": _P05,
    "e2e_p06": Kind(
        *(16, Step.HIGH_BYTE, CCITT, 0xFFFF),
        beside=Coverage.DATA_ID_BEHIND_HIGH_FIRST,
        modulus=256,
        needs_counter=True,
        counter_bits=8,
        counter_at=4,
        data_id_bits=16,
        big_endian=True,
        length_at=(2, 2),
    ),
    "e2e_p07": Kind(
        *(64, Step.LOW_BYTE, ECMA, 2**64 - 1, 2**64 - 1, Coverage.DATA_ID_IN_HEADER),
        modulus=2**32,
        needs_counter=True,
        counter_bits=32,
        counter_at=12,
        data_id_bits=32,
        big_endian=True,
        length_at=(8, 4),
        data_id_at=(16, 4),
    ),
    "e2e_p11": _P01,
    "sum8": Kind(8, Step.SUM, BYTES, open=True),
    "xor8": Kind(8, Step.LOW_BYTE, BYTES, open=True),
    "nibble_sum": Kind(4, Step.SUM, LESS_NIBBLES, open=True),
    "chrysler": _J1850,
    "honda": Kind(4, Step.SUM, LESS_NIBBLES, 8, beside=Coverage.ID_NIBBLES, modulus=4),
    "hyundai_bits": Kind(4, Step.SUM, BITS, final=9, needs_counter=True, leaves_counter_out=True),
    "hyundai_canfd": replace(_P05, data_id_bits=0),
    "hyundai_crc8": Kind(8, Step.LOW_BYTE, J1850, 0x22, 0xDF),
    "subaru": _SUM_WITH_ID,
    "tesla": _SUM_WITH_ID,
    "toyota": Kind(8, Step.SUM, BYTES, beside=Coverage.ID_BYTES_AND_LENGTH),
    "vw_mqb": _P02,
}
"""The kinds by the name that a vehicle file gives them."""
