"""What is wrong with the protection of a message, for the kinds with a header, with nibbles, and of the makers."""

from dataclasses import replace

import pytest
from cantools.database import load_string
from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.problems import input_problems
from dctorque_can.bus.protection import declared_protections
from dctorque_can.pipeline.samples import Protection

SIGNALS = [
    *(Signal("Byte0", 0, 8), Signal("Byte1", 8, 8), Signal("Nibble2", 16, 4), Signal("Two2", 20, 2)),
    *(Signal("Word3", 24, 16), Signal("Byte5", 40, 8), Signal("Two6", 48, 2), Signal("Three6", 50, 3)),
    *(Signal("Motorola8", 71, 32, "big_endian"), Signal("Motorola12", 103, 16, "big_endian")),
    *(Signal("Counter14", 119, 16, "big_endian"), Signal("Intel16", 128, 16), Signal("Counter18", 144, 8)),
]
MESSAGE = Message(0x123, "M", 32, SIGNALS)
P05 = Protection("M", "Counter18", 256, 3, "e2e_p05", "Intel16", 0x1234)
P04 = Protection("M", "Counter14", 65536, 3, "e2e_p04", "Motorola8", 0x12345678)
NIBBLE = Protection("M", crc="nibble_sum", crc_signal="Nibble2")
P01 = Protection("M", "Nibble2", 15, 3, "e2e_p01", "Byte1", 0x123)


def texts(protection, message=MESSAGE):
    return [str(problem) for problem in input_problems(Database([message]), (), (protection,))]


@pytest.mark.parametrize(
    "sound",
    [
        *(P05, NIBBLE, P01, replace(P01, data_id_mode="nibble"), replace(P01, data_id_mode="low")),
        Protection("M", crc="nibble_sum", crc_signal="Two2", crc_high_signal="Two6"),
        Protection("M", "Two2", 16, 3, "sum8", "Byte0", counter_high_signal="Two6"),
        Protection("M", "Two2", 32, 3, counter_high_signal="Three6"),
        replace(NIBBLE, crc="sum8", crc_signal="Byte5", crc_bytes=5, crc_start=255, crc_xor=1),
        Protection("M", "Nibble2", 16, 3, "vw_mqb", "Byte1", data_ids=tuple(range(16))),
    ],
)
def test_nothing_is_wrong(sound):
    assert texts(sound) == []


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (
            replace(P05, crc_signal="Motorola12"),
            "has 16 bits from bit 103, big_endian; the CRC of e2e_p05 is 2 whole bytes, little",
        ),
        (
            replace(P05, crc_signal="Byte0"),
            "M.Byte0 has 8 bits from bit 0, little_endian; the CRC of e2e_p05 is 2 wh",
        ),
        (
            replace(P05, counter_signal="Byte5"),
            "M.Byte5 is not where e2e_p05 has it: 8 bits from byte 18",
        ),
        (
            replace(P05, counter_modulus=16),
            "M.Counter18 has 8 bits and the modulus 16; e2e_p05 has 8 bits and 256",
        ),
        (replace(P05, data_id=0x10000), "has the data id 65536; it has 16 bits, 0..65535"),
        (replace(P05, data_id_mode="low"), "has no effect with e2e_p05; it belongs to e2e_p01 and e2e_p11"),
        (
            replace(P05, crc_start=0),
            "cannot be chosen with e2e_p05; it can with crc8_j1850, sum8, xor8, nibble_sum",
        ),
        (replace(P05, crc_bytes=33), "are 33 bytes; the message has 32"),
        (
            replace(P04, crc_signal="Intel16"),
            "has 16 bits from bit 128, little_endian; the CRC of e2e_p04 is 4 whole bytes, big_endian (@0)",
        ),
        (
            replace(P04, counter_signal="Counter14"),
            "M.Counter14 is not where e2e_p04 has it: 16 bits from byte 2, big endian (@0)",
        ),
        (replace(P04, data_id=2**32, counter_signal=""), "has the data id 4294967296; it has 32 bits"),
        (replace(NIBBLE, crc_signal="Byte0"), "M.Byte0 has 8 bits; nibble_sum has 4"),
        (replace(NIBBLE, crc_high_signal="Two6"), "M.Nibble2 has 6 bits; nibble_sum has 4"),
        (replace(NIBBLE, crc_start=16), "is 16; the checksum has 4 bits, 0..15"),
        (replace(NIBBLE, crc_high_signal="Two9"), "M.Two9 is not a signal of M; did you mean Two"),
        (replace(NIBBLE, crc_high_signal="Nibble2"), "M.Nibble2 is given twice"),
        (
            Protection("M", crc="sum8", crc_signal="Nibble2", crc_high_signal="Two6"),
            "M.Nibble2 is one of two parts; the checksum of sum8 is in one signal",
        ),
        (
            Protection("M", counter_high_signal="Two6"),
            "M.Two6 has the upper bits alone; counter_signal has the lower",
        ),
        (
            Protection("M", "Two2", 64, 3, counter_high_signal="Three6"),
            "M.Two2 has 5 bits; the counter modulus 64 must be 2..32",
        ),
        (replace(NIBBLE, crc="hyundai_bits"), "has the CRC hyundai_bits, which needs a counter signal"),
        (replace(P01, data_id_mode="nibble", data_id=0x1000), "has the data id 4096; it has 12 bits, 0..4095"),
        (replace(P01, data_id_mode="high"), "is 'high'; known are both, low, alternating, nibble"),
        (
            replace(P01, data_id_mode="alternating", counter_signal=""),
            "has the CRC e2e_p01, which needs a counter signal",
        ),
        (
            replace(P01, crc="vw_mqb", counter_modulus=16),
            "are missing, and those of M are not known; known are ESP_02",
        ),
    ],
)
def test_one_thing_is_wrong(bad, reason):
    (text,) = texts(bad)
    assert text.startswith("protection M: M")
    assert reason in text


def test_a_header_that_does_not_fit():
    """Profile 4 has 8 bytes in front of its checksum, profile 6 the length in the two bytes behind it."""
    front = Message(0x123, "M", 32, [Signal("Crc", 39, 32, "big_endian")])
    (text,) = texts(Protection("M", crc="e2e_p04", crc_signal="Crc"), front)
    assert "begins in byte 4, so that the header of e2e_p04 would be in bytes -4..3 of 32" in text
    end = Message(0x123, "M", 8, [Signal("Crc", 47, 16, "big_endian")])
    (text,) = texts(Protection("M", crc="e2e_p06", crc_signal="Crc"), end)
    assert "begins in byte 5, so that the header of e2e_p06 would be in bytes 7..8 of 8" in text
    last = Message(0x123, "M", 8, [Signal("Crc", 56, 8), Signal("Counter", 0, 4)])
    (text,) = texts(Protection("M", "Counter", 15, 3, "e2e_p01", "Crc", 1, data_id_mode="nibble"), last)
    assert "begins in byte 7, so that the header of e2e_p01 would be in bytes 8..8 of 8" in text


def test_an_identifier_of_29_bits_with_the_checksum_of_11():
    signals = [Signal("Crc", 0, 16), Signal("Counter", 16, 8)]
    message = Message(0x12345, "M", 8, signals, is_extended_frame=True)
    (text,) = texts(Protection("M", "Counter", 256, 3, "hyundai_canfd", "Crc"), message)
    assert "hyundai_canfd is known for 11. Give e2e_p05 and its data_id" in text


def test_a_database_declares_kinds_and_parts():
    text = """VERSION ""
BO_ 1 M: 8 X
 SG_ A : 0|2@1+ (1,0) [0|0] "" X
 SG_ B : 8|2@1+ (1,0) [0|0] "" X
 SG_ C : 16|8@1+ (1,0) [0|0] "" X
BA_DEF_ BO_ "E2EProfile" STRING ;
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_ BO_ "E2EDataIds" STRING ;
BA_DEF_ SG_ "E2ERole" STRING ;
BA_ "E2EProfile" BO_ 1 "vw_mqb";
BA_ "E2EDataId" BO_ 1 7;
BA_ "E2EDataIds" BO_ 1 "0, 1, 2, 3, 4, 5, 6, 7, 0x08 0x09 0x0A 0x0B 0x0C 0x0D 0x0E 0x0F";
BA_ "E2ERole" SG_ 1 A "counter";
BA_ "E2ERole" SG_ 1 B "counter_high";
BA_ "E2ERole" SG_ 1 C "crc";
"""
    (found,) = declared_protections(load_string(text, "dbc"))
    assert found == Protection("M", "A", 16, 3, "vw_mqb", "C", 7, tuple(range(16)), counter_high_signal="B")
