"""AUTOSAR profiles 1 (all modes), 4, 5, 6, 7 and 11 against the ``autosar-e2e`` package, both ways."""

from dataclasses import dataclass, field, replace
from typing import Any

import e2e.p01
import e2e.p04
import e2e.p05
import e2e.p06
import e2e.p07
import e2e.p11
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.problems import protection_problems
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

OK, BAD_CRC = SampleStatus.OK, SampleStatus.BAD_CRC


@dataclass(frozen=True)
class Profile:
    """One profile: who knows it, and where its fields lie behind its first byte, in bytes and bits."""

    kind: str
    module: Any
    crc: tuple[int, int]
    counter: tuple[int, int]
    header: int  # bytes
    modulus: int
    big_endian: bool
    data_id: int
    mode: str = "both"
    oracle: dict[str, int] = field(default_factory=dict)

    def protect(self, payload, offset, increment=True):
        data = bytearray(payload)
        protect = getattr(self.module, f"{self.kind}_protect")
        protect(data, self.data_id, offset=offset, increment_counter=increment, **self.oracle)
        return bytes(data)

    def accepts(self, payload, offset):
        check = getattr(self.module, f"{self.kind}_check")
        return check(bytearray(payload), self.data_id, offset=offset, **self.oracle)


P01, P11 = e2e.p01, e2e.p11
PROFILES = {
    "p01 low": Profile(
        *("e2e_p01", P01, (0, 8), (8, 4), 2, 15, False, 0x1234, "low"),
        {"data_id_mode": P01.E2E_P01_DATAID_LOW},
    ),
    "p01 alternating": Profile(
        *("e2e_p01", P01, (0, 8), (8, 4), 2, 15, False, 0x1234, "alternating"),
        {"data_id_mode": P01.E2E_P01_DATAID_ALT},
    ),
    "p01 nibble": Profile(
        *("e2e_p01", P01, (0, 8), (8, 4), 2, 15, False, 0x0B34, "nibble"),
        {"data_id_mode": P01.E2E_P01_DATAID_NIBBLE},
    ),
    "p04": Profile("e2e_p04", e2e.p04, (64, 32), (16, 16), 12, 2**16, True, 0x0A0B0C0D),
    "p05": Profile("e2e_p05", e2e.p05, (0, 16), (16, 8), 3, 256, False, 0xABCD),
    "p06": Profile("e2e_p06", e2e.p06, (0, 16), (32, 8), 5, 256, True, 0xABCD),
    "p07": Profile("e2e_p07", e2e.p07, (0, 64), (96, 32), 20, 2**32, True, 0x0A0B0C0D),
    "p11": Profile("e2e_p11", P11, (0, 8), (8, 4), 2, 15, False, 0x1234),
    "p11 nibble": Profile(
        *("e2e_p11", P11, (0, 8), (8, 4), 2, 15, False, 0x0B34, "nibble"),
        {"data_id_mode": P11.E2E_P11_DATAID_NIBBLE},
    ),
}
CASES = [
    pytest.param(profile, length, offset, id=f"{name}, {length} bytes, offset {offset}")
    for name, profile in PROFILES.items()
    for length, offset in ((8, 0), (16, 3), (24, 0), (64, 0), (64, 20))
    if offset + profile.header <= length
]


def signal(name, bit, bits, big_endian):
    """Return a signal whose lowest bit in the order of the bytes is ``bit``."""
    if big_endian and bits >= 8:
        return Signal(name, bit + 7, bits, "big_endian")
    return Signal(name, bit, bits)


def made(profile, length, offset):
    """Return the message: checksum, counter, and a signal for each byte outside of the header."""
    fields = [("Crc", *profile.crc), ("Counter", *profile.counter)]
    signals = [signal(name, 8 * offset + bit, bits, profile.big_endian) for name, bit, bits in fields]
    others = [byte for byte in range(length) if not offset <= byte < offset + profile.header]
    signals += [Signal(f"V{byte}", 8 * byte, 8) for byte in others]
    if not others:
        signals.append(Signal("V", 8 * offset, 1))
    message = Message(0x123, "M", length, signals, strict=False)
    protection = Protection(
        *("M", "Counter", profile.modulus, 3, profile.kind, "Crc", profile.data_id),
        data_id_mode=profile.mode,
    )
    assert list(protection_problems(message, protection)) == []
    return message, protection


def decoder_of(message, protection):
    value = Term("M", message.signals[-1].name)
    return Decoder(
        Database([message], strict=False), [Input(Quantity.BRAKE, (value,), 0.0, 255.0, 10**6)], [protection]
    )


@pytest.mark.parametrize(("profile", "length", "offset"), CASES)
def test_what_the_reference_implementation_sends_is_accepted(profile, length, offset):
    """Forty frames on, so that each counter that has fewer values goes round."""
    decoder = decoder_of(*made(profile, length, offset))
    rng = np.random.default_rng(length)
    payload = bytes(length)
    for k in range(40):
        fresh = bytearray(rng.integers(0, 256, length, dtype=np.uint8).tobytes())
        fresh[offset : offset + profile.header] = payload[offset : offset + profile.header]
        payload = profile.protect(fresh, offset)
        assert decoder.decode_one(1000 * k, 0x123, payload).status.tolist() == [OK]


@pytest.mark.parametrize(("profile", "length", "offset"), CASES)
def test_what_is_encoded_passes_the_reference_implementation(profile, length, offset):
    message, protection = made(profile, length, offset)
    rng = np.random.default_rng(length)
    names = [s.name for s in message.signals if s.name.startswith("V") and s.name != "V"]
    rows = MessageEncoder(message, protection).encode({name: rng.integers(0, 256, 300) for name in names})
    assert all(profile.accepts(bytes(row), offset) for row in rows)
    counters = [message.decode(bytes(row))["Counter"] for row in rows]
    assert counters == [k % profile.modulus for k in range(len(rows))]


@pytest.mark.parametrize(("profile", "length", "offset"), CASES)
def test_each_flipped_bit_is_refused_by_both(profile, length, offset):
    message, protection = made(profile, length, offset)
    fresh = np.random.default_rng(length).integers(0, 256, length, dtype=np.uint8)
    fresh[offset : offset + profile.header] = 0
    payload = profile.protect(bytearray(fresh.tobytes()), offset)
    decoder = decoder_of(message, protection)
    for bit in range(8 * length):
        damaged = bytearray(payload)
        damaged[bit // 8] ^= 1 << bit % 8
        assert not profile.accepts(damaged, offset)
        assert decoder.decode_one(0, 0x123, bytes(damaged)).status.tolist() == [BAD_CRC]
    assert decoder_of(message, protection).decode_one(0, 0x123, payload).status.tolist() == [OK]


@pytest.mark.parametrize("name", ["p04", "p05", "p06", "p07", "p11"])
def test_a_frame_for_another_receiver_is_refused(name):
    """Its checksum is right for its own data id."""
    profile = PROFILES[name]
    other = replace(profile, data_id=profile.data_id ^ 1)
    decoder = decoder_of(*made(profile, 32, 0))
    assert decoder.decode_one(0, 0x123, other.protect(bytes(32), 0)).status.tolist() == [BAD_CRC]
    assert decoder.decode_one(0, 0x123, profile.protect(bytes(32), 0)).status.tolist() == [OK]


@pytest.mark.parametrize("name", ["p04", "p06", "p07"])
def test_a_frame_that_tells_another_length_is_refused(name):
    """The reference implementation protects the first 24 of 32 bytes, and says so in the frame."""
    profile = PROFILES[name]
    data = bytearray(32)
    getattr(profile.module, f"{profile.kind}_protect")(data, profile.data_id, length=24)
    message, protection = made(profile, 32, 0)
    assert decoder_of(message, protection).decode_one(0, 0x123, bytes(data)).status.tolist() == [BAD_CRC]
    shorter = replace(protection, crc_bytes=24)
    assert decoder_of(message, shorter).decode_one(0, 0x123, bytes(data)).status.tolist() == [OK]
