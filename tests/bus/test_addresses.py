"""Which frames are a message: channels, and the parameter groups of J1939."""

import numpy as np
import pytest
from cantools import j1939
from cantools.database import load_string
from cantools.database.can import Database, Message, Signal
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.bus.addresses import is_j1939, j1939_addresses
from dctorque_can.bus.columns import MessageColumns
from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.problems import InputError
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, Frames, group_mask
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

from .demo import frames_of, identical
from .j1939_car import j1939_dbc

TSC1, EEC1, ETC1 = 0x0C00_0003, 0x0CF0_0400, 0x0CF0_0203  # SAE J1939-71: numbers 0, 61444 and 61442
identifiers = st.integers(0, 0x1FFF_FFFF)


def message(name, frame_id, length=8, extended=True):
    signals = [Signal("Speed", 24, 16), Signal("Counter", 0, 4)]
    return Message(frame_id, name, length, signals, is_extended_frame=extended)


def one(quantity, name, channel=None):
    return Input(quantity, (Term(name, "Speed", channel=channel),), 0.0, 1e6, 100_000)


def told(samples):
    return [(Quantity(q), v) for q, v in zip(samples.quantity, samples.value.tolist(), strict=True)]


def sent(*rows):
    """Return a frame for each (identifier, channel, speed, counter), 10 ms apart."""
    data = np.array([[counter, 0, 0, *divmod(speed, 256)[::-1], 0, 0, 0] for _, _, speed, counter in rows])
    frames = frames_of(data, [row[0] for row in rows], np.arange(len(rows)) * 10_000)
    frames.channel[:] = [row[1] for row in rows]
    return frames


@given(identifiers, identifiers)
def test_identifiers_of_one_number_agree_as_cantools_reads_them(one, other):
    """Any two, and two that differ in as little as a priority, a source address or a destination."""
    for a, b in ((one, other), (one, one ^ (other & 0x1C00_00FF)), (one, one ^ (other & 0xFF00))):
        same = j1939.pgn_from_frame_id(a) == j1939.pgn_from_frame_id(b)
        assert Address(a, group_mask(a)).has(b, 0) == same


def test_numbers_of_the_standard():
    """Of SAE J1939-71: 0 has a destination, 61444 and 61442 have none."""
    assert [j1939.pgn_from_frame_id(i) for i in (TSC1, EEC1, ETC1)] == [0, 61444, 61442]
    assert Address(TSC1, group_mask(TSC1)).has(0x1800_0B11, 0)
    assert not Address(TSC1, group_mask(TSC1)).has(0x1801_0003, 0)
    assert Address(EEC1, group_mask(EEC1)).has(0x18F0_0427, 0)
    assert not Address(EEC1, group_mask(EEC1)).has(0x18F0_0500, 0)


def test_the_printed_engine_speed_from_any_sender():
    """0x1368 in bytes 4 and 5 of EEC1, 0.125 rpm a bit, is 621 rpm: the example of CSS Electronics."""
    eec1 = Message(0x0CF004FE, "EEC1", 8, [Signal("Speed", 24, 16)], is_extended_frame=True)
    term = Term("EEC1", "Speed", factor=0.125)
    inputs = [Input(Quantity.ENGINE_SPEED, (term,), 0.0, 1e6, 100_000)]
    decoder = Decoder(Database([eec1]), inputs, (), j1939_addresses([eec1], {}))
    for can_id in (0x0CF00400, 0x18F00431, 0x00F004FE):
        assert decoder.decode_one(0, can_id | EXTENDED_ID, bytes.fromhex("FFFFFF6813FFFFFF")).value == [621.0]
    for can_id in (0x0CF00400, 0x0CF00300 | EXTENDED_ID, 0x1CF10400 | EXTENDED_ID):
        assert len(decoder.decode_one(0, can_id, bytes(8))) == 0


def test_a_source_address_that_is_told_is_the_only_one():
    eec1 = message("EEC1", EEC1)
    addresses = j1939_addresses([eec1], {"EEC1": 0x27})
    decoder = Decoder(Database([eec1]), [one(Quantity.ENGINE_SPEED, "EEC1")], (), addresses)
    frames = sent(*((0x18F0_0400 | EXTENDED_ID | source, 0, source, 0) for source in (0, 0x27, 3)))
    assert told(decoder.decode(frames)) == [(Quantity.ENGINE_SPEED, 0x27)]


def test_two_messages_of_one_number_are_known_by_their_senders():
    both = [message("Engine", EEC1), message("Motor", EEC1 + 5)]
    inputs = [one(Quantity.ENGINE_SPEED, "Engine"), one(Quantity.SHAFT1_SPEED, "Motor")]
    decoder = Decoder(Database(both), inputs, (), j1939_addresses(both, {}))
    frames = sent(*((0x14F0_0400 | EXTENDED_ID | source, 0, source + 1, 0) for source in (5, 0, 9)))
    assert told(decoder.decode(frames)) == [(Quantity.SHAFT1_SPEED, 6.0), (Quantity.ENGINE_SPEED, 1.0)]


def test_two_messages_of_one_number_and_sender_are_known_by_their_destination():
    both = [message("ToEngine", TSC1), message("ToRetarder", TSC1 | 0x0F00)]
    inputs = [one(Quantity.ENGINE_SPEED, "ToEngine"), one(Quantity.SHAFT1_SPEED, "ToRetarder")]
    decoder = Decoder(Database(both), inputs, (), j1939_addresses(both, {}))
    ids = (0x0000_0F03, 0x1C00_0003, 0x0C00_1003)
    frames = sent(*((can_id | EXTENDED_ID, 0, n, 0) for n, can_id in enumerate(ids)))
    assert told(decoder.decode(frames)) == [(Quantity.SHAFT1_SPEED, 0.0), (Quantity.ENGINE_SPEED, 1.0)]


def test_messages_that_differ_in_priority_alone_are_an_error():
    both = [message("One", EEC1), message("Other", EEC1 | 0x1000_0000)]
    inputs = [one(Quantity.ENGINE_SPEED, "One"), one(Quantity.SHAFT1_SPEED, "Other")]
    with pytest.raises(InputError, match="same J1939 number and source address as Other"):
        Decoder(Database(both), inputs, (), j1939_addresses(both, {}))


def test_a_counter_is_of_one_message_whoever_sends_it():
    """Two senders that count for themselves do not fit; known by their senders, each has its own counter."""
    protections = [Protection(name, "Counter", 16, 1) for name in ("Engine", "Motor")]
    rows = [(EEC1 | EXTENDED_ID | (5 * (n % 2)), 0, n, (n // 2 + 7 * (n % 2)) % 16) for n in range(40)]
    alone = [message("Engine", EEC1)]
    inputs = [one(Quantity.ENGINE_SPEED, "Engine"), one(Quantity.SHAFT1_SPEED, "Motor")]
    mixed = Decoder(Database(alone), inputs[:1], protections[:1], j1939_addresses(alone, {})).decode(sent(*rows))
    assert mixed.status.tolist() == [SampleStatus.OK] + [SampleStatus.BAD_COUNTER] * 39
    both = [*alone, message("Motor", EEC1 + 5)]
    apart = Decoder(Database(both), inputs, protections, j1939_addresses(both, {})).decode(sent(*rows))
    assert apart.value.tolist() == list(range(40))
    assert not apart.status.any()


def channel_decoder():
    """Return one of two databases that have an identifier in common, and a message that two inputs read."""
    engine, radio = message("Engine", 0x100, extended=False), message("Radio", 0x100, extended=False)
    addresses = {"Engine": Address(0x100, channel=0), "Radio": Address(0x100, channel=3)}
    inputs = [
        one(Quantity.ENGINE_SPEED, "Engine"),
        one(Quantity.SHAFT1_SPEED, "Radio"),
        one(Quantity.SHAFT2_SPEED, "Engine", channel=7),
    ]
    protections = [Protection("Engine", "Counter", 16, 1)]
    return Decoder(Database([engine, radio]), inputs, protections, addresses)


def channel_traffic():
    return sent(*((0x100, n % 9, n, n // 9 % 16) for n in range(9 * 40)))


def test_messages_are_told_by_their_channel():
    frames = channel_traffic()
    expected = [
        ({0: Quantity.ENGINE_SPEED, 3: Quantity.SHAFT1_SPEED, 7: Quantity.SHAFT2_SPEED}[n % 9], float(n))
        for n in range(len(frames))
        if n % 9 in (0, 3, 7)
    ]
    assert told(channel_decoder().decode(frames)) == expected  # no counter is out of step: each has its own


@given(st.lists(st.integers(0, 360), max_size=8))
def test_random_cuts_give_identical_bits(cuts):
    frames, decoder = channel_traffic(), channel_decoder()
    whole, done = channel_decoder().decode(frames), 0
    cuts = sorted(cuts)
    for a, b in zip([0, *cuts], [*cuts, len(frames)], strict=True):
        part = decoder.decode(frames[a:b])
        assert identical(part, whole[done : done + len(part)])
        done += len(part)
    assert done == len(whole)


def test_any_channel_and_one_of_them_are_an_error():
    engine = message("Engine", 0x100, extended=False)
    inputs = [one(Quantity.ENGINE_SPEED, "Engine"), one(Quantity.SHAFT1_SPEED, "Engine", channel=1)]
    with pytest.raises(InputError, match="is read from any channel and from channel 1"):
        Decoder(Database([engine]), inputs)


def test_the_attribute_of_a_dbc_counts_for_29_bits():
    declared, plain = (load_string(j1939_dbc(declared=each)) for each in (True, False))
    assert {m.name for m in declared.messages if not is_j1939(m)} == {"Inertial"}  # of 11 bits
    assert not any(map(is_j1939, plain.messages))


def test_rows_are_the_frames_that_an_address_has():
    frames = Frames.empty(200)
    random = np.random.default_rng(4)
    frames.can_id[:] = random.choice([0x100, EEC1 | EXTENDED_ID, EEC1 + 3 | EXTENDED_ID, EEC1], 200)
    frames.channel[:] = random.integers(0, 3, 200)
    for address in (
        Address(0x100),
        Address(0x100, channel=2),
        Address(EEC1 | EXTENDED_ID, group_mask(EEC1) | EXTENDED_ID, 1),
    ):
        rows = address.rows(frames).tolist()
        assert rows == [address.has(*each) for each in zip(frames.can_id.tolist(), frames.channel, strict=True)]
        assert 0 < sum(rows) < 200


def test_signals_of_whole_logs_are_told_by_channel_and_number():
    eec1, tsc1 = message("EEC1", EEC1), message("TSC1", TSC1)
    names = ("Engine", "Radio")
    engine, radio = (message(name, 0x100, extended=False) for name in names)
    database = Database([eec1, tsc1, engine, radio])
    addresses = j1939_addresses([eec1, tsc1], {"TSC1": 0x03})
    addresses |= {name: Address(0x100, channel=channel) for name, channel in zip(names, (0, 3), strict=True)}
    j1939_ids = [0x14F0_0431, 0x0C00_1103, 0x0CF0_0400, 0x0C00_1104]
    rows = [(can_id | EXTENDED_ID, 9, n, 0) for n, can_id in enumerate(j1939_ids)]
    rows += [(0x100, channel, 10 + channel, 0) for channel in range(4)]
    found = MessageColumns(database, addresses).decode(sent(*rows))
    assert {name: each["Speed"].tolist() for name, each in found.items()} == {
        "EEC1": [0.0, 2.0],
        "TSC1": [1.0],
        "Engine": [10.0],
        "Radio": [13.0],
    }
    assert found["EEC1"]["t_us"].tolist() == [0, 20_000]
