"""Several buses under `can:`, and the channels that name them."""

import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.config.overview import input_rows
from dctorque_can.pipeline.frames import Address

TWO = [{"interface": "virtual", "channel": "a"}, {"interface": "virtual", "channel": "b", "number": 7}]


def said(problems) -> dict[str, str]:
    return {problem.key: problem.reason for problem in problems}


def test_one_bus_or_a_list_of_them(load, write) -> None:
    assert [(str(bus), bus.number) for bus in load({}).buses] == [("socketcan:can0", 0)]
    config: Config = load({"can": TWO, "output.channel": 7})
    assert [(str(bus), bus.number) for bus in config.buses] == [("virtual:a", 0), ("virtual:b", 7)]
    assert config.output.channel == 7
    assert load({"can": TWO[::-1]}).output.channel == 7
    assert "number" not in config.buses[1].arguments()
    overridden = load_config(write({"can": TWO}), {"can.channel": "c", "can.1.number": "3", "can.fd": "true"})
    assert [(str(bus), bus.number, bus.fd) for bus in overridden.buses] == [
        ("virtual:c", 0, True),
        ("virtual:b", 3, False),
    ]


def test_all_errors_of_a_list_at_once(errors) -> None:
    twice = [*TWO, {"interface": "virtual", "channel": "a", "number": 7}, {"interfac": "virtual"}]
    found = said(errors({"can": twice}))
    assert found["can.2.number"] == "virtual:b has the number 7 already; give another one"
    assert found["can.2.channel"] == "virtual:a is in the list twice"
    assert "did you mean interface?" in found["can.3.interfac"]
    assert said(errors({"can": TWO, "output.channel": 1})) == {
        "output.channel": "no bus under can has this number; there is 0, 7"
    }


def test_a_channel_that_no_bus_has_is_a_warning(load) -> None:
    config = load({"can": TWO, "databases.0.channel": 7, "inputs.brake.channel": 2})
    assert list(said(config.warnings)) == ["inputs.brake.channel"]
    assert "there is 0, 7" in said(config.warnings)["inputs.brake.channel"]


def test_an_input_may_name_its_channel(load, errors) -> None:
    wheels = {f"inputs.wheel_speeds.{wheel}.channel": 7 for wheel in ("fl", "fr", "rl", "rr")}
    config = load({"can": TWO, "databases.0.channel": 0} | wheels)
    assert config.addresses["EngineData"] == Address(0x100, channel=0)
    channels = {term.channel for given in config.inputs for term in given.terms if "Wheel" in term.message}
    assert channels == {7}
    assert config.warnings == ()
    found = said(errors({"can": TWO, "inputs.wheel_speeds.fl.channel": 7}))
    (key, reason) = next(iter(found.items()))
    assert key == "inputs.wheel_speeds.fl.signal"
    assert reason.startswith(
        "WheelSpeedsFront is read from channel 7 and from any channel; give each of its inputs"
    )


@pytest.mark.parametrize(("channel", "expected"), [(0, None), (3, "protection.EngineData.channel")])
def test_a_protection_may_name_its_channel(load, channel, expected) -> None:
    config = load({"databases.0.channel": 0, "protection.EngineData.channel": channel})
    keys = [warning.key for warning in config.warnings if "no input" in warning.reason]
    assert keys == ([] if expected is None else [expected])


def test_a_dbc_that_is_listed_twice_changes_nothing(load) -> None:
    config = load({"databases.0.channel": 0, "databases.1": {"file": "demo_car.dbc", "channel": 7}, "can": TWO})
    assert {name: address.channel for name, address in config.addresses.items() if address.channel != 0} == {}
    reasons = [warning.reason for warning in config.warnings]
    assert any("EngineData is taken from channel 0 already, as demo_car.dbc says" in each for each in reasons)


def test_an_output_id_may_be_that_of_another_bus(load, errors) -> None:
    taken = {"output.enabled": True, "output.ids": {"DctTorque": 0x100}, "databases.0.channel": 7, "can": TWO}
    ids = [m.name for m in load({}).output.database.messages]
    taken["output.ids"] = {ids[0]: 0x100}
    assert load(taken).output.ids == {ids[0]: 0x100}
    (reason,) = said(errors(taken | {"output.channel": 7})).values()
    assert reason == "0x100 is the id of EngineData, which the vehicle sends"


def test_check_tells_the_channel(load) -> None:
    config = load({"databases.0.channel": 0, "inputs.brake": {"signal": "EngineData.BrakeActive", "channel": 5}})
    rows = {row["quantity"]: row for row in input_rows(config)}
    assert rows["engine_speed"]["taken_from"] == ["channel 0"]
    assert rows["brake"]["taken_from"] == ["channel 5"]
    assert all(row["taken_from"] == [] for row in input_rows(load({})) if row["present"])
