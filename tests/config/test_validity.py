"""Validity bits in other signals, and value tables of what is not available, in a vehicle file."""

from collections.abc import Callable
from io import StringIO
from typing import Any

import pytest
from rich.console import Console

from dctorque_can.config.load import Config
from dctorque_can.config.overview import input_rows
from dctorque_can.config.problems import Problem
from dctorque_can.pipeline.samples import Input, Quantity
from dctorque_can.report.inputs_table import inputs_table

Load = Callable[[dict[str, Any]], Config]
Errors = Callable[[dict[str, Any]], list[Problem]]
BRAKE = "EngineData.BrakeActive"


def one(config: Config, quantity: Quantity) -> Input:
    (found,) = [each for each in config.inputs if each.quantity is quantity]
    return found


def test_the_short_form_is_a_bit_that_is_one(load: Load) -> None:
    validity = one(load({"inputs.shaft1_speed.valid_if": BRAKE}), Quantity.SHAFT1_SPEED).validity
    assert validity is not None
    assert (validity.term.message, validity.term.signal) == ("EngineData", "BrakeActive")
    assert (validity.term.values, validity.timeout_us) == ({1: 1.0}, 5_000_000)


def test_names_of_the_value_table_and_a_timeout(load: Load) -> None:
    given = {"signal": BRAKE, "values": ["released", "pressed"], "timeout_ms": 250}
    config = load({"inputs.engine_speed.valid_if": given})
    validity = one(config, Quantity.ENGINE_SPEED).validity
    assert validity is not None
    assert (validity.term.values, validity.timeout_us) == ({0: 1.0, 1: 1.0}, 250_000)
    assert config.warnings == ()


@pytest.mark.parametrize(
    ("key", "quantity"),
    [
        ("gears.shaft2", Quantity.GEAR2),
        ("clutch_phase.clutch1", Quantity.CLUTCH1_POSITION),
        ("inputs.wheel_speeds.rl", Quantity.WHEEL_SPEED_RL),
    ],
)
def test_inputs_of_other_forms(load: Load, key: str, quantity: Quantity) -> None:
    assert one(load({f"{key}.valid_if": BRAKE}), quantity).validity is not None


def test_check_shows_it(load: Load) -> None:
    given = {"signal": BRAKE, "values": [0, "pressed"], "timeout_ms": 250}
    config = load({"inputs.shaft1_speed.valid_if": given})
    rows = input_rows(config)
    row = next(row for row in rows if row["quantity"] == "shaft1_speed")
    assert row["valid_if"] == {"signal": BRAKE, "values": [0, 1], "timeout_ms": 250.0}
    assert row["protection"] == ["e2e_p01, counter"] * 2
    console = Console(width=160, record=True, file=StringIO())
    console.print(inputs_table("car", rows, 160)[0])
    text = console.export_text()
    assert f"if {BRAKE} = 0 or 1" in text
    assert "if 250 ms" in text


@pytest.mark.parametrize(
    ("given", "key", "reason"),
    [
        ("BrakeActive", "valid_if", "must be Message.Signal"),
        ("EngineData.BrakeActiv", "valid_if", "is not a signal of EngineData; did you mean BrakeActive?"),
        ({"signal": "EngineDat.BrakeActive"}, "valid_if.signal", "did you mean EngineData?"),
        ({"signal": BRAKE, "values": ["valid"]}, "valid_if.values.0", "'valid' is not in the value table"),
        ({"signal": BRAKE, "values": [4]}, "valid_if.signal", "cannot have the raw value 4 of `values`"),
        ({"signal": BRAKE, "values": []}, "valid_if.values", "at least 1 item"),
        ({"signal": BRAKE, "value": [1]}, "valid_if.value", "unknown key; did you mean values?"),
        ({"signal": BRAKE, "timeout_ms": 0}, "valid_if.timeout_ms", "must be greater than 0"),
    ],
)
def test_a_validity_that_is_wrong(errors: Errors, given: Any, key: str, reason: str) -> None:
    (problem,) = errors({"inputs.engine_speed.valid_if": given})
    assert problem.key == f"inputs.engine_speed.{key}"
    assert reason in str(problem)


def test_a_validity_that_one_lost_frame_ends_is_told(load: Load) -> None:
    config = load({"inputs.engine_speed.valid_if": {"signal": "Gearbox.GearShaft1", "timeout_ms": 15}})
    assert [w.key for w in config.warnings] == ["inputs.engine_speed.valid_if.timeout_ms"]


def test_all_that_a_value_table_names_is_not_available(load: Load) -> None:
    """The brake has a name for each of its values, the engine speed for 65535 alone."""
    changes: dict[str, Any] = {
        "inputs.brake": {"signal": BRAKE, "not_available": ["value_table", 2]},
        "inputs.engine_speed.not_available": "value_table",
    }
    config = load(changes)
    assert one(config, Quantity.BRAKE).terms[0].not_available == {0, 1, 2, 3}
    assert one(config, Quantity.ENGINE_SPEED).terms[0].not_available == {65535}
    assert config.warnings == ()


def test_a_signal_without_a_value_table(errors: Errors) -> None:
    changes = {"inputs.grade": {"signal": "EngineData.EngineDataCounter", "unit": "rad"}}
    (problem,) = errors({**changes, "inputs.grade.not_available": "value_table"})
    assert problem.key == "inputs.grade.not_available"
    assert problem.reason == "the DBC has no value table for EngineData.EngineDataCounter"
