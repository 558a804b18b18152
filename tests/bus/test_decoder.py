"""What the decoder does with whole frames: selection, bad data, sums, multiplexers, batches."""

import math
import sys
from dataclasses import replace

import cantools
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.decoder import Decoder
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames
from dctorque_can.pipeline.samples import Input, Protection, Quantity, Samples, SampleStatus, Term

from .demo import DATABASE, INPUTS, PROTECTIONS, frames_of, identical, traffic
from .layouts_strategy import messages

OK, NOT_AVAILABLE = SampleStatus.OK, SampleStatus.NOT_AVAILABLE
Q = Quantity


def demo_decoder():
    return Decoder(DATABASE, INPUTS, tuple(PROTECTIONS.values()))


def simple(*terms, low=-1e9, high=1e9, timeout_us=100_000, quantity=Q.ENGINE_TORQUE):
    return Input(quantity, terms, low, high, timeout_us)


def message_of(name, frame_id, *signals, length=8, extended=False):
    return Message(frame_id, name, length, list(signals), is_extended_frame=extended)


def joined(parts):
    return Samples(*(np.concatenate([getattr(p, name) for p in parts]) for name in Samples.__slots__))


def damaged_traffic(seed):
    """Return demo traffic with everything that may happen to it."""
    rng = np.random.default_rng(seed)
    frames = traffic(8, seed)
    n = len(frames)
    frames.data[rng.random(n) < 0.1, rng.integers(0, 8)] ^= np.uint8(1 << rng.integers(0, 8))
    frames.length[rng.random(n) < 0.1] = rng.integers(0, 8)
    frames.flags[rng.random(n) < 0.2] = rng.choice([*FrameFlag, 0])
    frames.can_id[rng.random(n) < 0.1] = rng.choice([0x7, 0x7FF, 0x100 | EXTENDED_ID, 0xFFFF_FFFF, 0x800])
    frames.data[rng.random(n) < 0.05] = 0
    frames.data[rng.random(n) < 0.05] = 0xFF
    frames.t_us[n // 2 :] += rng.integers(-300_000, 300_000)
    return frames[np.sort(rng.choice(n, n))]  # some lost, some twice


@pytest.mark.parametrize("column", ["can_id", "length", "flags", "data"])
def test_columns_of_other_lengths_are_refused(column):
    """The compiled loop would read behind the shorter one."""
    frames = damaged_traffic(0)
    with pytest.raises(ValueError, match="the columns of the frames differ in length"):
        demo_decoder().decode(replace(frames, **{column: getattr(frames, column)[:1]}))


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.data())
def test_random_cuts_give_identical_bits(seed, data):
    frames = damaged_traffic(seed)
    whole = demo_decoder().decode(frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(frames)), max_size=12)))
    decoder = demo_decoder()
    parts = [decoder.decode(frames[a:b]) for a, b in zip([0, *cuts], [*cuts, len(frames)], strict=True)]
    assert identical(joined(parts), whole)


@pytest.mark.parametrize("seed", range(5))
def test_one_frame_at_a_time_gives_identical_bits(seed):
    frames = damaged_traffic(seed)
    decoder = demo_decoder()
    parts = [
        decoder.decode_one(
            int(frames.t_us[i]),
            int(frames.can_id[i]),
            frames.data[i, : frames.length[i]].tobytes(),
            int(frames.flags[i]),
        )
        for i in range(len(frames))
    ]
    assert identical(joined(parts), demo_decoder().decode(frames))


@pytest.mark.parametrize("step", [1, -1])
def test_decoding_into_what_is_there_gives_identical_bits(step):
    """Also where the columns are none that stand in a row in memory."""
    frames = damaged_traffic(7)
    decoder = demo_decoder()
    samples = Samples.zeros(4 * decoder.most_per_frame)[::step]
    decode = decoder.into(samples)
    parts = []
    for start in range(0, len(frames), 4):
        n = decode(frames[start : start + 4])
        parts.append(Samples(*(getattr(samples, name)[:n].copy() for name in Samples.__slots__)))
    assert identical(joined(parts), demo_decoder().decode(frames))


def test_samples_for_which_there_is_no_room_are_refused():
    """Nothing is written behind the shortest column."""
    decoder, frames = demo_decoder(), traffic(5)
    room = Samples.zeros(5 * decoder.most_per_frame)
    for name in Samples.__slots__:
        with pytest.raises(ValueError, match="no room"):
            decoder.into(replace(room, **{name: getattr(room, name)[:3]}))(frames)


@given(st.integers(0, 10**6))
def test_frames_that_no_input_reads_change_nothing(seed):
    frames = traffic(4, seed)
    rng = np.random.default_rng(seed)
    others = traffic(4, seed + 1)
    kind = rng.integers(0, 4, len(others))
    others.can_id[kind == 0] = rng.integers(0x200, 0x800)
    others.can_id[kind == 1] |= EXTENDED_ID
    others.flags[kind == 2] = FrameFlag.REMOTE
    others.flags[kind == 3] = FrameFlag.SENT | FrameFlag.ERROR
    mixed = Frames.concatenate([others, frames]).sorted_by_time()
    assert identical(demo_decoder().decode(mixed), demo_decoder().decode(frames))


@given(st.binary(max_size=64), st.sampled_from([0x100, 0x110, 0x120, 0x130, 0x131]))
def test_any_payload_of_any_length_gives_finite_samples(payload, can_id):
    samples = demo_decoder().decode_one(0, can_id, payload)
    name = DATABASE.get_message_by_frame_id(can_id).name
    assert len(samples) == sum(each.terms[0].message == name for each in INPUTS)
    assert np.isfinite(samples.value).all()
    assert (samples.value[samples.status != OK] == 0.0).all()
    if len(payload) < 8:  # every message of the demo has a CRC
        assert set(samples.status) == {SampleStatus.BAD_LENGTH}


@pytest.mark.parametrize("fill", [0x00, 0xFF])
def test_frames_of_all_zeros_or_all_ones_are_flagged(fill):
    frames = Frames.concatenate([frames_of([[fill] * 8] * 3, message.frame_id) for message in DATABASE.messages])
    samples = demo_decoder().decode(frames)
    assert len(samples) == 3 * len(INPUTS)
    assert set(samples.status) == {SampleStatus.BAD_CRC}
    unprotected = Decoder(DATABASE, INPUTS).decode(frames)
    expected = NOT_AVAILABLE if fill else OK
    assert set(unprotected.status) == {expected}


def test_read_only_and_strided_columns_are_taken():
    frames = traffic(3)
    wide = np.zeros((len(frames), 24), np.uint8)
    wide[:, 5:13] = frames.data
    strided = replace(frames, data=wide[:, 5:13], t_us=np.repeat(frames.t_us, 2)[::2])
    strided.t_us.flags.writeable = False
    assert identical(demo_decoder().decode(strided), demo_decoder().decode(frames))


def test_no_memory_and_no_reference_is_kept():
    frame = traffic(1)[:1]
    decoder = demo_decoder()
    before = sys.getrefcount(frame.data)
    for _ in range(100):
        decoder.decode(frame)
    after = sys.getrefcount(frame.data)
    assert after == before


def test_longer_frames_are_accepted_and_their_padding_is_not_signed():
    frames = traffic(2)
    padded = replace(frames, data=np.pad(frames.data, ((0, 0), (0, 56)), constant_values=0xAA))
    padded.length[:] = 12
    assert identical(demo_decoder().decode(padded), demo_decoder().decode(frames))


def test_extended_identifiers_and_64_bytes():
    far = message_of("Far", 0x18FEF100, Signal("S", 511, 8, "big_endian"), length=64, extended=True)
    near = message_of("Near", 0x100, Signal("S", 0, 8))
    low = message_of("Low", 0x7, Signal("S", 0, 8), extended=True)
    inputs = [simple(Term(name, "S"), quantity=Q(k)) for k, name in enumerate(("Far", "Near", "Low"))]
    decoder = Decoder(Database([far, near, low]), inputs)
    assert decoder.can_ids == {0x18FEF100 | EXTENDED_ID, 0x100, 0x7 | EXTENDED_ID}
    payload = bytes(range(64))
    assert decoder.decode_one(0, 0x18FEF100 | EXTENDED_ID, payload).value.tolist() == [63.0]


def test_two_channels_are_taken_alike():
    frames = traffic(2)
    frames.channel[::2] = 1
    assert len(demo_decoder().decode(frames)) == len(demo_decoder().decode(traffic(2)))


class TestValues:
    message = message_of(
        "M", 0x10, Signal("U", 0, 8), Signal("S", 8, 8, is_signed=True), Signal("G", 16, 4), Signal("W", 24, 16)
    )

    def status_and_value(self, term, payload, **bounds):
        samples = Decoder(Database([self.message]), [simple(term, **bounds)]).decode_one(0, 0x10, bytes(payload))
        return SampleStatus(samples.status[0]), samples.value[0]

    def test_raw_values_that_mean_not_available(self):
        term = Term("M", "U", 2.0, 1.0, frozenset([255, 0]))
        assert self.status_and_value(term, [254, *[0] * 7]) == (OK, 509.0)
        assert self.status_and_value(term, [255, *[0] * 7]) == (NOT_AVAILABLE, 0.0)
        assert self.status_and_value(term, [0, *[0] * 7]) == (NOT_AVAILABLE, 0.0)

    @pytest.mark.parametrize("raw", [-1, 255])
    def test_a_signed_raw_value_may_be_given_as_number_or_as_bits(self, raw):
        term = Term("M", "S", not_available=frozenset([raw]))
        assert self.status_and_value(term, [0, 0xFF, *[0] * 6]) == (NOT_AVAILABLE, 0.0)
        assert self.status_and_value(term, [0, 0xFE, *[0] * 6]) == (OK, -2.0)

    def test_a_value_map_replaces_the_scaling(self):
        term = Term("M", "G", 1.0, 0.0, frozenset([15]), {0: 0.0, 1: 1.0, 13: -1.0})
        assert self.status_and_value(term, [0, 0, 13, *[0] * 5]) == (OK, -1.0)
        assert self.status_and_value(term, [0, 0, 2, *[0] * 5]) == (NOT_AVAILABLE, 0.0)
        assert self.status_and_value(term, [0, 0, 15, *[0] * 5]) == (NOT_AVAILABLE, 0.0)

    def test_range(self):
        term = Term("M", "U")
        assert self.status_and_value(term, [10, *[0] * 7], low=10, high=20) == (OK, 10.0)
        assert self.status_and_value(term, [20, *[0] * 7], low=10, high=20) == (OK, 20.0)
        assert self.status_and_value(term, [9, *[0] * 7], low=10, high=20) == (SampleStatus.OUT_OF_RANGE, 0.0)
        assert self.status_and_value(term, [21, *[0] * 7], low=10, high=20) == (SampleStatus.OUT_OF_RANGE, 0.0)

    @pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize(("bits", "dtype"), [(32, "<f4"), (64, "<f8")])
    def test_floats_that_are_no_number_are_not_available(self, number, bits, dtype):
        conversion = cantools.database.conversion.BaseConversion.factory(is_float=True)
        message = message_of("M", 0x10, Signal("F", 0, bits, conversion=conversion))
        decoder = Decoder(Database([message]), [simple(Term("M", "F"))])
        good = decoder.decode_one(0, 0x10, np.array([2.5], dtype).tobytes().ljust(8, b"\0"))
        bad = decoder.decode_one(0, 0x10, np.array([number], dtype).tobytes().ljust(8, b"\0"))
        assert (good.status[0], good.value[0]) == (OK, 2.5)
        assert (bad.status[0], bad.value[0]) == (NOT_AVAILABLE, 0.0)


class SumModel:
    """An input of three messages, by the words of `Input`: latest values, younger than the timeout."""

    def __init__(self, factors, timeout_us):
        self.factors, self.timeout_us, self.latest = factors, timeout_us, {}

    def feed(self, t_us, source, raw):
        if raw == 255:
            return NOT_AVAILABLE, 0.0
        self.latest[source] = (t_us, self.factors[source] * raw)
        young = [k for k, (t, _) in self.latest.items() if abs(t_us - t) < self.timeout_us]
        if len(young) < len(self.factors):
            return None
        total = 0.0
        for k in range(len(self.factors)):
            total += self.latest[k][1]
        return (OK, total) if -100 <= total <= 100 else (SampleStatus.OUT_OF_RANGE, 0.0)


@settings(max_examples=80)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0, 1_000, 20_000, 49_999, 50_000, 90_000, -10_000, -80_000]),
            st.integers(0, 2),
            st.integers(0, 60) | st.just(255),
        ),
        max_size=40,
    )
)
def test_sums_over_several_messages(steps):
    factors = (1.0, -1.0, 0.5)
    database = Database([message_of(f"M{k}", 0x20 + k, Signal("S", 0, 8)) for k in range(3)])
    terms = tuple(Term(f"M{k}", "S", factor, 0.0, frozenset([255])) for k, factor in enumerate(factors))
    decoder = Decoder(database, [simple(*terms, low=-100, high=100, timeout_us=50_000)])
    model = SumModel(factors, 50_000)
    t_us = 10**6
    for dt, source, raw in steps:
        t_us += dt
        samples = decoder.decode_one(t_us, 0x20 + source, bytes([raw, *[0] * 7]))
        expected = model.feed(t_us, source, raw)
        found = [(SampleStatus(s), v) for s, v in zip(samples.status, samples.value, strict=True)]
        assert found == ([] if expected is None else [expected])


def test_last_stands_on_the_final_sample_when_a_sum_is_incomplete():
    database = Database(
        [message_of("A", 1, Signal("X", 0, 8), Signal("Y", 8, 8)), message_of("B", 2, Signal("Z", 0, 8))]
    )
    inputs = [
        simple(Term("A", "Y"), Term("B", "Z"), quantity=Q.GRADE),
        simple(Term("A", "X"), quantity=Q.ENGINE_SPEED),
    ]
    samples = Decoder(database, inputs).decode_one(0, 1, bytes([7, 8, *[0] * 6]))
    assert (samples.quantity.tolist(), samples.last.tolist()) == ([Q.ENGINE_SPEED], [True])


NESTED = """VERSION ""
NS_ :
BS_:
BU_: E
BO_ 100 M: 8 E
 SG_ Outer M : 0|4@1+ (1,0) [0|0] "" E
 SG_ Inner m1M : 4|4@1+ (1,0) [0|0] "" E
 SG_ A m0 : 8|8@1+ (1,0) [0|0] "" E
 SG_ B m2 : 8|8@1- (0.5,0) [0|0] "" E
 SG_ C m3 : 16|16@1+ (1,0) [0|0] "" E
 SG_ Always : 56|8@1+ (1,0) [0|0] "" E
SG_MUL_VAL_ 100 Inner Outer 1-1;
SG_MUL_VAL_ 100 A Outer 0-0, 5-7;
SG_MUL_VAL_ 100 B Outer 2-2;
SG_MUL_VAL_ 100 C Inner 3-3, 9-9;
"""


@given(st.binary(min_size=8, max_size=8))
def test_multiplexed_signals_give_samples_when_selected(payload):
    database = cantools.database.load_string(NESTED, "dbc")
    names = ("A", "B", "C", "Always", "Inner")
    inputs = [simple(Term("M", name), quantity=Q(k)) for k, name in enumerate(names)]
    samples = Decoder(database, inputs).decode_one(0, 100, payload)
    outer, inner = payload[0] & 15, payload[0] >> 4
    expected = {"Always": float(payload[7])}
    if outer in (0, 5, 6, 7):
        expected["A"] = float(payload[1])
    if outer == 2:
        expected["B"] = 0.5 * int.from_bytes(payload[1:2], "little", signed=True)
    if outer == 1:
        expected["Inner"] = float(inner)
        if inner in (3, 9):
            expected["C"] = float(int.from_bytes(payload[2:4], "little"))
    found = {names[q]: v for q, v in zip(samples.quantity, samples.value, strict=True)}
    assert found == expected
    assert samples.last.tolist() == [False] * (len(expected) - 1) + [True]


def test_a_short_multiplexed_frame_gives_what_it_has_and_flags_the_rest():
    database = cantools.database.load_string(NESTED, "dbc")
    inputs = [simple(Term("M", name), quantity=Q(k)) for k, name in enumerate("ABC")]

    def found(payload):
        samples = Decoder(database, inputs, [Protection("M")]).decode_one(0, 100, payload)
        return {"ABC"[q]: SampleStatus(s) for q, s in zip(samples.quantity, samples.status, strict=True)}

    assert found(bytes([0x30, 7, 0, 0, 0, 0, 0])) == {"A": OK}
    assert found(bytes([0x30])) == {"A": NOT_AVAILABLE}
    assert found(bytes([0x31, 1, 0])) == {"C": NOT_AVAILABLE}
    assert found(b"") == dict.fromkeys("ABC", NOT_AVAILABLE)


def bits_of(signal):
    """Return the numbers of the bits of a signal, 8 * byte + bit; Motorola ones go along the rows."""
    if signal.byte_order == "little_endian":
        return [signal.start + k for k in range(signal.length)]
    row = [8 * byte + bit for byte in range(64) for bit in range(7, -1, -1)]
    first = row.index(signal.start)
    return row[first : first + signal.length]


@settings(max_examples=100)
@given(messages(floats=False), st.data())
def test_a_short_frame_gives_the_signals_that_lie_inside(message, data):
    database = Database(messages=[message])
    signals = message.signals[: len(Quantity)]
    inputs = [simple(Term("M", s.name), low=-1e25, high=1e25, quantity=Q(k)) for k, s in enumerate(signals)]
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    there = data.draw(st.integers(0, message.length))
    short = Decoder(database, inputs).decode_one(0, 0x123, payload[:there])
    whole = Decoder(database, inputs).decode_one(0, 0x123, payload)
    for k, signal in enumerate(signals):
        inside = max(bits_of(signal)) < 8 * there
        expected = (int(whole.status[k]), float(whole.value[k])) if inside else (int(NOT_AVAILABLE), 0.0)
        assert (int(short.status[k]), float(short.value[k])) == expected


@pytest.mark.parametrize("there", range(9))
@pytest.mark.parametrize("kind", ["none", "counter", "crc"])
def test_a_counter_or_crc_that_is_missing_stays_an_error(there, kind):
    """EngineTorque is in bytes 4 and 5 of the demo car's EngineData, CRC and counter in bytes 0 and 1."""
    name = "EngineData"
    protection = replace(
        PROTECTIONS[name],
        crc=PROTECTIONS[name].crc if kind == "crc" else "none",
        crc_signal=PROTECTIONS[name].crc_signal if kind == "crc" else "",
        counter_signal="" if kind == "none" else PROTECTIONS[name].counter_signal,
    )
    frames = traffic(8, 0)
    frames = frames[frames.can_id == 0x100][:1]
    payload = bytes(frames.data[0, :there])
    decoder = Decoder(DATABASE, [simple(Term(name, "EngineTorque"))], [protection])
    (status,) = decoder.decode_one(0, 0x100, payload).status.tolist()
    if (kind == "crc" and there < 8) or (kind == "counter" and there < 2):
        assert status == SampleStatus.BAD_LENGTH
    else:
        assert status == (OK if there >= 6 else NOT_AVAILABLE)
