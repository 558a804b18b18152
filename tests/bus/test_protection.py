"""CRC and counters against the ``autosar-e2e`` package and a plain model of the rules."""

import e2e.crc
import e2e.p01
import e2e.p02
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.protection import declared_protections
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

from .demo import DATABASE, INPUTS, PROTECTIONS, frames_of

IDS = tuple(range(0x10, 0x20))
OK, BAD_CRC, BAD_COUNTER = SampleStatus.OK, SampleStatus.BAD_CRC, SampleStatus.BAD_COUNTER


def protected(kind, length=8, crc_byte=0, data_id=0x1234):
    """Return a message of one byte of value and free bytes, and its protection."""
    others = [*range(crc_byte + 1, length), *range(crc_byte)]  # profiles 1 and 2 count in the byte after the CRC
    signals = [
        Signal("Crc", 8 * crc_byte, 8),
        Signal("Counter", 8 * others[0], 4),
        *(Signal(f"V{byte}", 8 * byte, 8) for byte in others[1:]),
    ]
    message = Message(0x200, "M", length, signals)
    modulus = 15 if kind == "e2e_p01" else 16
    ids = IDS if kind == "e2e_p02" else ()
    return message, Protection("M", "Counter", modulus, 3, kind, "Crc", data_id, ids)


def oracle(kind, payload, data_id, crc_byte):
    """Return whether the ``autosar-e2e`` package accepts a payload."""
    if kind == "e2e_p01":
        return e2e.p01.e2e_p01_check(bytearray(payload), data_id, offset=crc_byte)
    if kind == "e2e_p02":
        return e2e.p02.e2e_p02_check(bytes(payload), bytes(IDS), length=len(payload))
    covered = bytes(payload[:crc_byte]) + bytes(payload[crc_byte + 1 :])
    return e2e.crc.calculate_crc8(covered) == payload[crc_byte]


def decoder_of(message, protection):
    values = [s.name for s in message.signals if s.name.startswith("V")][:3]
    inputs = [Input(Quantity(k), (Term("M", name),), -1e9, 1e9, 100_000) for k, name in enumerate(values)]
    return Decoder(Database([message]), inputs, [protection])


@pytest.mark.parametrize(
    ("kind", "crc_byte"),
    [("crc8_j1850", 0), ("crc8_j1850", 7), ("e2e_p01", 0), ("e2e_p01", 3), ("e2e_p02", 0)],
)
@pytest.mark.parametrize("length", [8, 48])
def test_signed_payloads_pass_the_reference_implementation(kind, crc_byte, length):
    message, protection = protected(kind, length, crc_byte)
    n = 40
    rng = np.random.default_rng(1)
    columns = {s.name: rng.integers(0, 256, n) for s in message.signals if s.name.startswith("V")}
    encoder = MessageEncoder(message, protection)
    payloads = np.concatenate(
        [encoder.encode({name: column[a:b] for name, column in columns.items()}) for a, b in ((0, 7), (7, n))]
    )
    assert all(oracle(kind, bytearray(row), 0x1234, crc_byte) for row in payloads)
    counters = [message.decode(bytes(row))["Counter"] for row in payloads]
    assert counters == [k % protection.counter_modulus for k in range(n)]
    samples = decoder_of(message, protection).decode(frames_of(payloads, 0x200))
    assert set(samples.status) == {OK}


@pytest.mark.parametrize("kind", ["crc8_j1850", "e2e_p01", "e2e_p02"])
def test_a_flipped_bit_anywhere_is_rejected(kind):
    message, protection = protected(kind)
    payload = MessageEncoder(message, protection).encode({"V2": 0x5A, "V3": 0xC3})[0]
    decoder = decoder_of(message, protection)
    for bit in range(64):
        damaged = payload.copy()
        damaged[bit // 8] ^= 1 << (bit % 8)
        assert not oracle(kind, bytearray(damaged), 0x1234, 0)
        samples = decoder.decode(frames_of(damaged, 0x200))
        assert samples.status.tolist() == [BAD_CRC] * 3
        assert samples.value.tolist() == [0.0] * 3
        assert samples.last.tolist() == [False, False, True]
    # the damaged ones changed nothing, but that right ones have to earn belief
    payloads = MessageEncoder(message, protection).encode({"V2": [0x5A] * 3, "V3": [0xC3] * 3})
    samples = decoder.decode(frames_of(payloads, 0x200))
    assert samples.status[::3].tolist() == [SampleStatus.NOT_BELIEVED] * 2 + [OK]


@settings(max_examples=40)
@given(st.binary(min_size=7, max_size=7), st.sampled_from(["crc8_j1850", "e2e_p01", "e2e_p02"]))
def test_of_all_256_crcs_those_are_accepted_that_the_reference_implementation_accepts(rest, kind):
    payloads = [[crc, *rest] for crc in range(256)]
    samples = decoder_of(*protected(kind)).decode(frames_of(payloads, 0x200))
    passed = (OK, SampleStatus.NOT_BELIEVED)  # after so many that did not
    accepted = [crc for crc, status in enumerate(samples.status[::3]) if status in passed]
    assert accepted == [crc for crc in range(256) if oracle(kind, payloads[crc], 0x1234, 0)]


@pytest.mark.parametrize("kind", ["e2e_p01", "e2e_p02"])
def test_payloads_of_the_reference_implementation_are_accepted_with_their_own_counter(kind):
    message, protection = protected(kind)
    buffer = bytearray(8)
    payloads = []
    for k in range(40):
        buffer[2] = k
        if kind == "e2e_p01":
            e2e.p01.e2e_p01_protect(buffer, 0x1234)
        else:
            e2e.p02.e2e_p02_protect(buffer, bytes(IDS))
        payloads.append(list(buffer))
    samples = decoder_of(message, protection).decode(frames_of(payloads, 0x200))
    assert set(samples.status) == {OK}
    assert samples.value[::3].tolist() == list(range(40))


class CounterModel:
    """The rules of the decoder's docstring, written down plainly."""

    def __init__(self, modulus, most, timeout_us):
        self.modulus, self.most, self.timeout_us = modulus, most, timeout_us
        self.last = self.seen_us = None
        self.longest_us = 0  # of a step
        self.faults = 0
        self.right = None  # in a row, while it is not believed

    def fits(self, t_us, counter):
        """Return whether a frame is right, None if it is the last one once more."""
        if counter >= self.modulus:
            return False
        last, ago_us = self.last, None if self.seen_us is None else t_us - self.seen_us
        self.last, self.seen_us = counter, t_us
        if last is None or abs(ago_us) >= self.timeout_us:
            return True
        step = (counter - last) % self.modulus
        if step == 0:
            return None
        if step > self.most or 0 < self.longest_us * (step + self.modulus // 2) < ago_us:
            return False
        self.longest_us = max(ago_us // step, self.longest_us - self.longest_us // 64)
        return True

    def status(self, t_us, counter):
        fits = self.fits(t_us, counter)
        if fits is None:
            return BAD_COUNTER
        if not fits:
            self.faults = min(self.faults + 2, 6)
            if self.faults == 6 or self.right is not None:
                self.right = 0
            return BAD_COUNTER
        if self.right is None:
            self.faults = max(self.faults - 1, 0)
            return OK
        self.right += 1
        if self.right < 3:
            return SampleStatus.NOT_BELIEVED
        self.right, self.faults = None, 0
        return OK


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0, 1_000, 10_000, 99_999, 100_000, 500_000, -7_000, -200_000]), st.integers(0, 15)
        ),
        max_size=40,
    ),
    st.integers(1, 5),
    st.sampled_from([15, 16]),
)
def test_counters_follow_the_stated_rules(steps, most, modulus):
    message, _ = protected("none")
    protection = Protection("M", "Counter", modulus, most)
    t_us = np.cumsum([1_000_000, *(dt for dt, _ in steps)])[1:]
    payloads = np.zeros((len(steps), 8), np.uint8)
    payloads[:, 1] = [counter for _, counter in steps]
    model = CounterModel(modulus, most, 100_000)
    expected = [model.status(int(t), counter) for t, (_, counter) in zip(t_us, steps, strict=True)]
    samples = decoder_of(message, protection).decode(frames_of(payloads, 0x200, t_us))
    assert samples.status[::3].tolist() == expected


def test_a_sender_that_repeats_one_frame_is_never_accepted_again():
    message = DATABASE.get_message_by_name("EngineData")
    payload = MessageEncoder(message, PROTECTIONS["EngineData"]).encode({"EngineSpeed": 900.0})[0]
    frames = frames_of(np.tile(payload, (100, 1)), 0x100, np.arange(100) * 10_000)
    status = Decoder(DATABASE, INPUTS, PROTECTIONS.values()).decode(frames).status[::2]
    assert status.tolist() == [OK] + [BAD_COUNTER] * 99


def test_lost_frames_then_a_jump_then_agreement():
    """Two lost frames are within the step of 3; three lost ones cost one more frame."""
    message, protection = protected("e2e_p01")
    payloads = MessageEncoder(message, protection).encode({"V2": np.arange(30)})
    decoder = decoder_of(message, protection)
    received = [0, 1, 4, 5, 9, 10, 11]
    samples = decoder.decode(frames_of(payloads[received], 0x200))
    assert samples.status[::3].tolist() == [OK, OK, OK, OK, BAD_COUNTER, OK, OK]


def test_the_shipped_databases_declare_their_protection():
    assert PROTECTIONS["EngineData"] == Protection(
        "EngineData", "EngineDataCounter", 15, 3, "e2e_p01", "EngineDataCrc", 0x100
    )
    assert [each.data_id for each in declared_protections(DATABASE)] == [0x100, 0x110, 0x120, 0x130, 0x131, 0x140]
