"""The checksums of the makers against vectors of opendbc, an independent implementation.

Vectors: random payloads with the checksum that opendbc's functions give them (repository commaai/opendbc, commit
7343a66d46213d5f73528afc6c6db713ebd88a9d: ``opendbc/car/*/*can*.py``; the sums of Hyundai's nibbles and bits out of
``opendbc/safety/modes/hyundai.h``, compiled). Frames recorded in cars come from its tests,
``opendbc/can/tests/test_checksums.py``.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.problems import protection_problems
from dctorque_can.bus.vw_mqb import DATA_IDS
from dctorque_can.pipeline.frames import EXTENDED_ID
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

OK, BAD_CRC = SampleStatus.OK, SampleStatus.BAD_CRC
LAST = -1  # the last byte


@dataclass(frozen=True)
class Case:
    name: str
    crc: str
    byte: int  # of the checksum
    vectors: tuple[tuple[int, str], ...]
    bits: int = 8
    shift: int = 0
    keys: dict[str, Any] = field(default_factory=dict)


CASES = [
    Case(
        *("hyundai_crc8, byte 6", "hyundai_crc8", 6),
        ((0x340, "38b4e652e44d1ff2"), (0x340, "370d9e260e279b65"), (0x340, "50a4a3a6d07f060c")),
    ),
    Case("hyundai_crc8, byte 7", "hyundai_crc8", 7, ((0x38D, "332f8b1224083fa3"), (0x38D, "2b902f8911e818d3"))),
    Case(
        *("hyundai, 6 bytes", "sum8", 6),
        ((0x340, "f8c99d5d5d98b095"), (0x340, "7504d90e945d51e8"), (0x340, "f54ee781cc75ec36")),
        keys={"crc_bytes": 6},
    ),
    Case(
        *("hyundai, 7 bytes", "sum8", 6),
        ((0x340, "d85099095aa3dd16"), (0x340, "5a67036f9b548d6b"), (0x340, "8f0be2112417053d")),
    ),
    Case(
        *("hyundai, lower nibble", "nibble_sum", 7),
        ((0x260, "d9f73817ce6e1189"), (0x260, "264aad6cb6dd2103"), (0x260, "af94acd3cf92c198")),
        bits=4,
    ),
    Case(
        *("hyundai, upper nibble", "nibble_sum", 7),
        ((0x421, "237cb11f5d108c32"), (0x421, "5930263938b370a1"), (0x421, "b5769fa0f1483fe5")),
        *(4, 4),
    ),
    Case(
        *("hyundai, without byte 7", "nibble_sum", 6),
        ((0x394, "a90d9df2f130d90f"), (0x394, "cf04bd93f50ae195"), (0x394, "14da8c659ce2b50c")),
        bits=4,
        keys={"crc_bytes": 7},
    ),
    Case(
        *("hyundai_canfd", "hyundai_canfd", 0),
        (
            (0xA0, "5c2fed24ec636a8ac0a1271e5866279238aaf84e58056d8f"),
            (0x35, "10c3edd094ba97ae8b15442ee2db611a91bfe39469733a9247d58fa3c5501830"),
            (0x12A, "5360555fd235f11829fb388c22e44cb6"),
            (0x1CF, "baf31210c3707a90"),
            (0x105, "8a49420fb169779edfb5b9342405157f54b12eae62d11e887eb0766d1877f8c6"),
        ),
        bits=16,
    ),
    Case(
        *("honda", "honda", LAST),
        (
            *((0x1A3, "eff26b5010af3171"), (0x158, "d161e79587a766e8"), (0x1D0, "30e4037458a99059")),
            *((0x191, "ad87bd4c77e2983d"), (0x17C, "27745ccb26")),
        ),
        bits=4,
    ),
    Case(
        *("honda, 29 bits", "honda", LAST),
        ((0x18DAB0F1, "944cf1b220eaa2c4"), (0xEF81218, "fb1b7d3e3f73f41f"), (0x18FEF100, "af6e0d93dd41")),
        bits=4,
    ),
    Case(
        *("toyota", "toyota", LAST),
        (
            *((0x25, "2147738606f2bf45"), (0x1D2, "c70209e0cd05ee4d")),
            *((0x2E4, "20edbcba6e"), (0x260, "084ab649fcbce457")),
        ),
    ),
    Case(
        *("subaru", "subaru", 0),
        (
            *((0x40, "cabdecface4abd12"), (0x13A, "758f391ebc070e83")),
            *((0x48, "01180a6bd4f43a2a"), (0x122, "c0fcd3c12ef89057")),
        ),
    ),
    Case(
        *("tesla", "tesla", 0),
        ((0x118, "2175e826e2cbeaee"), (0x155, "e2af2c7d696cf46b"), (0x145, "e67c090af4e146f6")),
    ),
    Case(
        *("chrysler", "chrysler", LAST),
        ((0x124, "d03110ab86efde6f"), (0x140, "9eeabac37a0ddedb"), (0x2A6, "f2d3b19202d1")),
    ),
    Case(
        *("fca_giorgio, recorded", "crc8_j1850", LAST),
        (
            (0xFE, "7e38007d10318032"),
            (0xFE, "7e38007d1031812f"),
            (0xFE, "7e38007d20318220"),
            (0x1FC, "ccc1515042421234"),
        ),
        keys={"crc_start": 0, "crc_xor": 0x0A},
    ),
    Case(
        *("fca_giorgio, steering, recorded", "crc8_j1850", LAST),
        ((0xDE, "175197cc00df"), (0xDE, "175197c901a3"), (0xDE, "175197cc02e5")),
        keys={"crc_start": 0, "crc_xor": 0x10},
    ),
    Case(
        *("rivian", "crc8_j1850", 0),
        ((0x120, "1ee0feb17b4aa559"), (0x120, "319f28984b14267f")),
        keys={"crc_start": 0, "crc_xor": 0x63},
    ),
    Case("nissan", "crc8_j1850", 7, ((0x169, "1b037494dd1c01f4"), (0x169, "6adfc974d1729a5b"))),
    Case("vw_pq, last byte", "xor8", 7, ((0x1A0, "fe2008d737e8f52b"), (0xC2, "d69ed6f181bd1a49"))),
    Case("vw_pq, first byte", "xor8", 0, ((0xD0, "66825e7971b2"),)),
    Case(
        *("vw_mlb", "xor8", 0),
        ((0x109, "91e105aab2d6a310"), (0x109, "5c08880f0f422dbb")),
        keys={"crc_start": 0x08},
    ),
    Case(
        *("psa", "nibble_sum", 7),
        ((0x305, "36fb94b3cb6d42ef"), (0x305, "813caaa5b348f403"), (0x305, "0b893bfe338f65ee")),
        *(4, 4),
        {"crc_start": 0xB},
    ),
    Case(
        *("psa, 0x452", "nibble_sum", 7),
        ((0x452, "a5a969d270831575"), (0x452, "af40db4852eb74bd")),
        bits=4,
        keys={"crc_start": 0x4},
    ),
]
VECTORS = [
    pytest.param(case, *vector, id=f"{case.name}, 0x{vector[0]:X}") for case in CASES for vector in case.vectors
]


def made(case, can_id, payload):
    """Return the message of a case, with a signal for the checksum and one for each byte and nibble beside it."""
    byte = case.byte % len(payload)
    own = set(range(8 * byte + case.shift, 8 * byte + case.shift + case.bits))
    others = [Signal(f"N{k}", 4 * k, 4) for k in range(2 * len(payload)) if 4 * k not in own]
    crc = Signal("Crc", min(own), case.bits)
    message = Message(can_id, "M", len(payload), [crc, *others], is_extended_frame=can_id > 0x7FF)
    return message, Protection("M", crc=case.crc, crc_signal="Crc", **case.keys)


def status_of(message, protection, payload):
    inputs = [Input(Quantity.BRAKE, (Term("M", message.signals[-1].name),), 0.0, 1e9, 100_000)]
    can_id = message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)
    samples = Decoder(Database([message]), inputs, [protection]).decode_one(0, can_id, bytes(payload))
    return samples.status.tolist()


@pytest.mark.parametrize(("case", "can_id", "text"), VECTORS)
def test_a_vector_is_accepted_and_no_other_checksum_is(case, can_id, text):
    payload = bytes.fromhex(text)
    message, protection = made(case, can_id, payload)
    assert list(protection_problems(message, protection)) == []
    assert status_of(message, protection, payload) == [OK]
    raws = message.decode(payload, decode_choices=False)
    for wrong in {*range(16), raws["Crc"] ^ (1 << case.bits - 1)} - {raws["Crc"]}:
        damaged = message.encode(raws | {"Crc": wrong}, strict=False)
        assert status_of(message, protection, damaged) == [BAD_CRC]


@pytest.mark.parametrize(("case", "can_id", "text"), VECTORS)
def test_the_encoder_gives_a_payload_the_checksum_of_the_vector(case, can_id, text):
    payload = bytes.fromhex(text)
    message, protection = made(case, can_id, payload)
    raws = message.decode(payload)
    encoded = MessageEncoder(message, protection).encode({n: v for n, v in raws.items() if n != "Crc"})
    assert bytes(encoded[0]) == payload


WHEELS = Message(
    0x386,
    "WHL_SPD11",
    8,
    [
        *(Signal(f"WHL_SPD_{name}", 16 * k, 14) for k, name in enumerate(("FL", "FR", "RL", "RR"))),
        *(Signal("AliveCounter_LSB", 14, 2), Signal("AliveCounter_MSB", 30, 2)),
        *(Signal("Checksum_LSB", 46, 2), Signal("Checksum_MSB", 62, 2)),
    ],
)
WHEELS_PROTECTION = Protection(
    "WHL_SPD11",
    crc="hyundai_bits",
    crc_signal="Checksum_LSB",
    crc_high_signal="Checksum_MSB",
    counter_signal="AliveCounter_LSB",
    counter_high_signal="AliveCounter_MSB",
)
WHEEL_VECTORS = {
    15: "ccdaebf990919838",
    3: "b0d7ec0b3e17814e",
    14: "cb96c4dbadbe1762",
    7: "96d5234a42724c2b",
}
"""By the counter, which has two parts as the checksum has."""


SPEEDS = {f"WHL_SPD_{name}": Quantity[f"WHEEL_SPEED_{name}"] for name in ("FL", "FR", "RL", "RR")}


def wheels():
    inputs = [Input(quantity, (Term("WHL_SPD11", name),), 0.0, 1e5, 100_000) for name, quantity in SPEEDS.items()]
    return Decoder(Database([WHEELS]), inputs, [WHEELS_PROTECTION])


@pytest.mark.parametrize(("counter", "text"), WHEEL_VECTORS.items())
def test_wheel_speeds_of_hyundai_with_counter_and_checksum_in_two_parts(counter, text):
    payload = bytes.fromhex(text)
    assert list(protection_problems(WHEELS, WHEELS_PROTECTION)) == []
    samples = wheels().decode_one(0, 0x386, payload)
    assert samples.status.tolist() == [OK] * 4
    decoded = WHEELS.decode(payload)
    speeds = {name: decoded[name] for name in SPEEDS}
    assert samples.value.tolist() == list(speeds.values())
    encoder = MessageEncoder(WHEELS, WHEELS_PROTECTION)
    rows = encoder.encode({name: np.full(16, value) for name, value in speeds.items()})
    assert bytes(rows[counter]) == payload


def test_a_counter_in_two_parts_is_followed_over_both():
    """Its step from 3 to 4 is in both parts; a repeated one, and one five further, are rejected."""
    rows = MessageEncoder(WHEELS, WHEELS_PROTECTION).encode({"WHL_SPD_FL": np.arange(20)})
    assert [WHEELS.decode(bytes(row))["AliveCounter_MSB"] for row in rows[:9]] == [0] * 4 + [1] * 4 + [2]
    decoder = wheels()
    sent = [2, 3, 4, 4, 9, 10, 15, 16, 17]
    statuses = [int(decoder.decode_one(1000 * k, 0x386, bytes(rows[n])).status[0]) for k, n in enumerate(sent)]
    bad = int(SampleStatus.BAD_COUNTER)
    assert statuses == [OK, OK, OK, bad, bad, OK, bad, OK, OK]


def recorded():
    lines = (Path(__file__).parent / "vw_mqb_frames.txt").read_text().splitlines()
    return {name: (int(can_id, 16), rows) for name, can_id, *rows in map(str.split, lines) if name != "#"}


@pytest.mark.parametrize("name", DATA_IDS)
def test_recorded_frames_of_volkswagen_with_known_data_ids(name):
    """Every data id has a frame; none of them is accepted with the checksum of the next one."""
    can_id, rows = recorded()[name]
    signals = [Signal("CHECKSUM", 0, 8), Signal("COUNTER", 8, 4), Signal("V", 56, 8)]
    message = Message(can_id, name, 8, signals)
    protection = Protection(name, "COUNTER", 16, 3, "vw_mqb", "CHECKSUM")
    assert list(protection_problems(message, protection)) == []
    inputs = [Input(Quantity.BRAKE, (Term(name, "V"),), 0.0, 255.0, 100_000)]
    decoder = Decoder(Database([message]), inputs, [protection])
    payloads = [bytes.fromhex(row) for row in rows]
    assert [payload[1] & 0xF for payload in payloads] == list(range(16))
    assert [decoder.decode_one(0, can_id, payload).status.tolist() for payload in payloads] == [[OK]] * 16
    damaged = [bytes([payload[0] ^ 1]) + payload[1:] for payload in payloads]
    assert [decoder.decode_one(0, can_id, payload).status.tolist() for payload in damaged] == [[BAD_CRC]] * 16
