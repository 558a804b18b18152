"""Saturation, "not available", multiplexers and mistakes of the encoder."""

import math

import cantools
import numpy as np
import pytest

from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.problems import InputError
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.samples import Protection

from .demo import DATABASE, PROTECTIONS
from .test_decoder import NESTED

ENGINE = DATABASE.get_message_by_name("EngineData")


def raws(message, payload):
    return message.decode(bytes(payload), scaling=False, decode_choices=False)


def encode(message=ENGINE, **columns):
    return [raws(message, row) for row in MessageEncoder(message).encode(columns)]


@pytest.mark.parametrize(
    ("speed", "raw"),
    [
        (800.0, 3200),
        (-5.0, 0),
        (16383.5, 65534),
        (16383.7, 65534),
        (math.inf, 65534),
        (-math.inf, 0),
        (math.nan, 65535),
    ],
)
def test_values_saturate_below_the_raw_value_for_not_available(speed, raw):
    (found,) = encode(EngineSpeed=speed)
    assert found["EngineSpeed"] == raw
    assert found["EngineTorque"] == 1000  # its start value: 0 N·m
    assert found["AcceleratorPedal"] == found["BrakeActive"] == 0


def test_the_limits_of_the_database_hold():
    found = encode(AcceleratorPedal=[100.0, 101.0, 40.1], EngineTorque=[-1000.4, -2000.0, 3095.0])
    assert [each["AcceleratorPedal"] for each in found] == [250, 250, 100]
    assert [each["EngineTorque"] for each in found] == [0, 0, 4094]


def test_nan_without_a_raw_value_for_not_available_is_refused():
    with pytest.raises(DctorqueError, match=r"EngineData\.EngineDataCounter: a value is NaN"):
        encode(EngineDataCounter=[1.0, math.nan])


def test_a_refused_call_does_not_count():
    gearbox = DATABASE.get_message_by_name("Gearbox")
    encoder = MessageEncoder(gearbox, PROTECTIONS["Gearbox"])
    with pytest.raises(DctorqueError):
        encoder.encode({"GearShaft3": 1.0})
    assert raws(gearbox, encoder.encode({"GearShaft1": 1.0})[0])["GearboxCounter"] == 0


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"EngineSped": 1.0}, "EngineSped is not a signal of EngineData; did you mean EngineSpeed"),
        ({"EngineDataCrc": 1.0}, r"EngineData\.EngineDataCrc is filled in by the protection"),
        ({"EngineSpeed": [1.0, 2.0], "EngineTorque": [1.0]}, r"columns must be of one length: EngineSpeed \(2,\)"),
        ({"EngineSpeed": [[1.0, 2.0]]}, "columns must be of one length"),
    ],
)
def test_mistakes_are_named(columns, reason):
    with pytest.raises(DctorqueError, match=reason):
        MessageEncoder(ENGINE, PROTECTIONS["EngineData"]).encode(columns)


def test_a_protection_that_does_not_fit_is_refused():
    with pytest.raises(InputError, match="is not a signal of EngineData"):
        MessageEncoder(ENGINE, Protection("EngineData", "Counter"))


def test_no_rows_and_constant_columns():
    encoder = MessageEncoder(ENGINE)
    assert encoder.encode({"EngineSpeed": np.zeros(0)}).shape == (0, 8)
    assert encoder.encode({"EngineSpeed": np.zeros(3), "EngineTorque": 5}).shape == (3, 8)


def test_multiplexed_signals_are_written_where_they_are_selected():
    message = cantools.database.load_string(NESTED, "dbc").messages[0]
    columns = {"Outer": [0, 2, 1, 1], "Inner": 9, "A": 17, "B": -3.5, "C": [1, 2, 515, 4], "Always": 255}
    a, b, c, d = MessageEncoder(message).encode(columns)
    assert raws(message, a) == {"Outer": 0, "A": 17, "Always": 255}
    assert raws(message, b) == {"Outer": 2, "B": -7, "Always": 255}
    assert raws(message, c) == {"Outer": 1, "Inner": 9, "C": 515, "Always": 255}
    assert raws(message, d)["C"] == 4
    assert bytes(a[2:7]) == bytes(5)
