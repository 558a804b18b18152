"""Every mistake in inputs and protections is found, all at once, with what would be right."""

from dataclasses import replace

import pytest
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.problems import InputError, input_problems
from dctorque_can.pipeline.samples import Input, Protection, Quantity, Term

from .demo import DATABASE, INPUTS, PROTECTIONS

GOOD = Input(Quantity.ENGINE_SPEED, (Term("EngineData", "EngineSpeed"),), 0.0, 1000.0, 100_000)
P01 = PROTECTIONS["EngineData"]
P02 = Protection("EngineData", "EngineDataCounter", 16, 3, "e2e_p02", "EngineDataCrc", 0, tuple(range(16)))


def texts(inputs=(), protections=(), database=DATABASE):
    return [str(problem) for problem in input_problems(database, inputs, protections)]


def of_term(**changes):
    return texts([replace(GOOD, terms=(replace(GOOD.terms[0], **changes),))])


def test_the_demo_vehicle_has_no_problems():
    assert texts(INPUTS, tuple(PROTECTIONS.values())) == []
    assert texts([], [P02]) == []


def test_a_misspelt_message_and_a_misspelt_signal_are_both_told_with_the_nearest_names():
    bad = [
        replace(GOOD, terms=(Term("EngineDat", "EngineSpeed"),)),
        Input(Quantity.ENGINE_TORQUE, (Term("EngineData", "enginetorque"),), 0.0, 1.0, 1),
    ]
    assert texts(bad) == [
        "input engine_speed: EngineDat is not a message of the DBC; did you mean EngineData?",
        "input engine_torque: EngineData.enginetorque is not a signal of EngineData; did you mean EngineTorque?",
    ]
    with pytest.raises(InputError) as caught:
        Decoder(DATABASE, bad)
    assert len(caught.value.problems) == 2


def test_a_signal_of_another_message_is_found_there():
    (text,) = of_term(signal="Clutch1Position")
    assert text.endswith("did you mean Gearbox.Clutch1Position?")


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ([GOOD, GOOD], "is given 2 times"),
        ([replace(GOOD, terms=())], "has no signal"),
        ([replace(GOOD, terms=GOOD.terms * 2)], "EngineData.EngineSpeed is summed 2 times"),
        ([replace(GOOD, minimum=2.0, maximum=1.0)], "empty range [2.0, 1.0]"),
        ([replace(GOOD, maximum=float("nan"))], "empty range"),
        ([replace(GOOD, timeout_us=0)], "timeout of 0 µs"),
    ],
)
def test_mistakes_of_an_input(bad, reason):
    (text,) = texts(bad)
    assert text.startswith("input engine_speed: ")
    assert reason in text


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"factor": float("inf")}, "factor inf"),
        ({"offset": float("nan")}, "offset nan"),
        ({"not_available": frozenset([65536])}, "raw value 65536 of `not_available`; it holds 0..65535"),
        ({"not_available": frozenset([-1])}, "raw value -1 of `not_available`"),
        ({"values": {70000: 1.0}}, "raw value 70000 of `values`"),
        ({"values": {1: float("nan")}}, "has the value nan for raw 1"),
    ],
)
def test_mistakes_of_a_term(changes, reason):
    (text,) = of_term(**changes)
    assert reason in text


def test_signals_that_cannot_be_read():
    half = BaseConversion.factory(is_float=True)
    message = Message(
        0x50,
        "M",
        32,
        [
            Signal("Long", 0, 72),
            Signal("Half", 80, 16, conversion=half),
            Signal("Outside", 250, 16),
            Signal("Flat", 112, 8, conversion=BaseConversion.factory(scale=0.0)),
        ],
        strict=False,
    )
    inputs = [
        Input(Quantity(k), (Term("M", signal.name),), 0.0, 1.0, 1) for k, signal in enumerate(message.signals)
    ]
    found = texts(inputs, database=Database([message], strict=False))
    reasons = ("has 72 bits", "is a float of 16 bits", "scale 0", "does not fit in the 32 bytes")
    assert len(found) == 4
    for text, reason in zip(found, reasons, strict=True):
        assert reason in text


def test_two_messages_of_one_identifier():
    messages = [Message(0x50, name, 8, [Signal("S", 0, 8)]) for name in "AB"]
    inputs = [Input(Quantity.GRADE, (Term("A", "S"),), 0.0, 1.0, 1)]
    (text,) = texts(inputs, database=Database(messages))
    assert "same identifier 0x50 as B" in text


def selected(name, selector, start):
    return Signal(name, start, 8, is_multiplexer=True, multiplexer_ids=[1], multiplexer_signal=selector)


@pytest.mark.parametrize(
    ("signals", "reason"),
    [
        ([selected("A", "Nobody", 0)], "is multiplexed by 'Nobody', which does not select it"),
        ([selected("A", "B", 0), selected("B", "A", 8)], "is multiplexed by 'A', which does not select it"),
        ([selected("A", "B", 0), Signal("B", 60, 8)], "is multiplexed by B, which does not fit"),
    ],
)
def test_a_multiplexer_that_cannot_be_followed(signals, reason):
    message = Message(1, "M", 8, [])
    message.signals.extend(signals)  # cantools itself fails on such a message
    inputs = [Input(Quantity.GRADE, (Term("M", "A"),), 0.0, 1.0, 1)]
    (found,) = texts(inputs, database=Database([message], strict=False))
    assert reason in found


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (replace(P01, message="EngineDatum"), "is not a message of the DBC; did you mean EngineData?"),
        (replace(P01, crc_signal="EngineDatCrc"), "is not a signal of EngineData; did you mean EngineDataCrc"),
        (replace(P01, counter_signal="Counter"), "is not a signal of EngineData"),
        (replace(P01, crc_signal="EngineDataCounter", counter_signal=""), "a CRC is one whole byte"),
        (replace(P01, crc_signal="EngineTorque"), "has 12 bits from bit 32; a CRC is one whole byte"),
        (replace(P01, crc_signal=""), "has the CRC e2e_p01 but no CRC signal"),
        (replace(P01, crc="none"), "is a CRC signal, but the kind of CRC is none"),
        (replace(P01, crc="crc16"), "unknown CRC 'crc16'; known are none, crc8_j1850, e2e_p01, e2e_p02"),
        (replace(P01, data_id=0x10000), "data id 65536"),
        (replace(P01, counter_modulus=16), "runs 0..14, modulus 15"),
        (replace(P01, max_counter_delta=0), "largest step must be 1..14"),
        (replace(P01, max_counter_delta=15), "largest step must be 1..14"),
        (replace(P01, crc="crc8_j1850", counter_modulus=17), "modulus 17 must be 2..16"),
        (replace(P02, data_ids=()), "has 0 data ids; e2e_p02 needs 16"),
        (replace(P02, data_ids=(256,) * 16), "data ids outside 0..255"),
        (replace(P02, counter_signal=""), "needs a counter signal"),
        (replace(P02, counter_modulus=15), "e2e_p02 has 4 bits and 16"),
    ],
)
def test_mistakes_of_a_protection(bad, reason):
    (text,) = texts(protections=[bad])
    assert text.startswith(f"protection {bad.message}: ")
    assert reason in text


def test_a_message_protected_twice():
    (text,) = texts(protections=[P01, P02])
    assert "is protected 2 times" in text


def test_multiplexed_and_float_protection_signals():
    message = Message(
        0x50,
        "M",
        8,
        [
            Signal("Mux", 0, 4, is_multiplexer=True),
            Signal("Crc", 8, 8, multiplexer_ids=[1], multiplexer_signal="Mux"),
            Signal("Counter", 32, 32, conversion=BaseConversion.factory(is_float=True)),
        ],
    )
    found = texts(
        protections=[Protection("M", "Counter", 16, 3, "crc8_j1850", "Crc")], database=Database([message])
    )
    assert len(found) == 2
    assert all("not multiplexed" in text for text in found)
