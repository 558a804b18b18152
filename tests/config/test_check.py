"""`dctorque check`: what people see, what scripts read, and the exit codes."""

import json
import re

import pytest
import typer
from typer.testing import CliRunner

from dctorque_can.cli.check import check
from dctorque_can.config.overview import LOST
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_dbc

APP = typer.Typer()
APP.command()(check)


def run(*arguments: object):
    return CliRunner().invoke(APP, [str(argument) for argument in arguments], env={"COLUMNS": "200"})


def test_a_good_file_shows_its_inputs() -> None:
    result = run("paper_car")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    rows = {cells[0]: cells for line in lines if len(cells := re.split(r"\s{2,}", line.strip())) > 1}
    assert rows["engine_speed"][1:7] == [
        *("EngineData.EngineSpeed", "rpm · 0.1047", "0 … 1100", "10 ms", "100 ms", "e2e_p01, counter"),
    ]
    assert rows["wheel_speed_rr"][2:6] == ["km/h · 0.8903", "-350 … 350", "20 ms", "200 ms"]
    assert rows["gear2"][2] == "0→0 14→0 2→2 4→4"
    assert rows["grade"][1] == "not given"
    assert "no errors" in result.stdout
    assert "estimator kalman; driven axle front" in result.stdout
    assert result.stderr == ""


def test_the_method_is_named_and_what_it_does_without_an_input() -> None:
    """The model of the Kalman filter bridges half a second; the 2014 observer holds at once."""
    for method, lost in (("kalman", "no valid estimate after half a second"), ("oh2014", "no valid estimate")):
        report = json.loads(run("paper_car", "--json", "--set", f"estimator.method={method}").stdout)
        assert report["method"] == method
        rows = {row["quantity"]: row["lost"] for row in report["inputs"]}
        assert rows["engine_speed"] == rows["gear1"] == lost
        assert rows["wheel_speed_fl"] == LOST["wheel_speed_fl"]


def test_json_for_scripts() -> None:
    result = run("avante_dct7", "--json", "--set", "inputs.engine_speed.timeout_ms=15")
    report = json.loads(result.stdout)
    assert (result.exit_code, report["ok"], report["name"], report["errors"]) == (0, True, "Avante DCT7", [])
    assert [warning["key"] for warning in report["warnings"]] == ["inputs.engine_speed.timeout_ms"]
    (speed,) = [row for row in report["inputs"] if row["quantity"] == "shaft1_speed"]
    assert (speed["signals"], speed["units"], speed["period_ms"]) == (
        ["InputShafts.InputShaft1Speed"],
        ["rpm"],
        10,
    )
    assert [row["quantity"] for row in report["inputs"] if not row["present"]] == [
        "acceleration",
        "grade",
        "direction",
        "transmission_torque",
    ]


def test_errors_go_to_stderr_and_end_with_1(write) -> None:
    path = write({"vehicle.engine_inertia_kgm2": -1, "inputs.engine_speed": "EngineData.EngineSped"})
    result = run(path)
    assert result.exit_code == 1
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert re.fullmatch(rf"{path}:\d+: vehicle\.engine_inertia_kgm2 = -1: must be greater than 0", lines[0])
    assert "did you mean EngineSpeed" in lines[1]
    assert lines[-1] == f"{path}: 2 errors"


def test_errors_as_json(write) -> None:
    path = write({"vehicle.engine_inertia_kgm2": -1})
    result = run(path, "--json")
    report = json.loads(result.stdout)
    assert (result.exit_code, report["ok"], report["inputs"]) == (1, False, [])
    assert report["errors"][0] == {
        "file": str(path),
        "line": 3,
        "key": "vehicle.engine_inertia_kgm2",
        "value": "-1",
        "reason": "must be greater than 0",
        "severity": "error",
    }


def test_what_a_command_is_for_depends_on_where_it_stands(write) -> None:
    """As an input it gives the residual, as the source of the phases their validity."""
    signal = {"signal": "EngineData.EngineTorque", "not_available": [4095]}
    phase = signal | {"threshold_nm": 5, "hysteresis_nm": 2}
    beside = write({"inputs.clutch1_command": signal})
    report = json.loads(run(beside, "--json").stdout)
    lost = {row["quantity"]: row["lost"] for row in report["inputs"]}
    assert lost["clutch1_command"] == "residual of the clutch torque"
    report = json.loads(
        run(write({"clutch_phase": {"source": "command", "clutch1": phase, "clutch2": phase}}), "--json").stdout
    )
    lost = {row["quantity"]: row["lost"] for row in report["inputs"]}
    assert lost["clutch1_command"] == LOST["clutch1_command"] != "residual of the clutch torque"


def test_inferred_gears_are_not_missing(write) -> None:
    result = run(write({"gears": {"source": "ratio"}}))
    assert result.exit_code == 0
    assert "inferred from the ratio" in result.stdout


@pytest.mark.parametrize("arguments", [(), ("paper_car", "--set", "can.channel")])
def test_wrong_usage_ends_with_2(arguments) -> None:
    assert run(*arguments).exit_code == 2


def test_a_file_that_is_not_there() -> None:
    result = run("no_such_car.yaml")
    assert result.exit_code == 1
    assert result.stderr.startswith("no_such_car.yaml: cannot be read: No such file or directory")


def test_every_quantity_says_what_is_lost_without_it() -> None:
    assert set(LOST) == {quantity.name.lower() for quantity in Quantity}


def test_a_product_is_shown(write) -> None:
    torque = {
        "signal": "EngineShare.IndicatedTorque",
        "not_available": [4095],
        "times": {"signal": "EngineReference.ReferenceTorque", "not_available": [65535]},
    }
    path = write({"databases.1": str(shipped_dbc("demo_car_more")), "inputs.engine_torque": torque})
    shown = run(path).stdout
    assert "× EngineReference.ReferenceTorque" in shown
    assert "× 5000 ms" in shown
    (row,) = [r for r in json.loads(run(path, "--json").stdout)["inputs"] if r["quantity"] == "engine_torque"]
    assert row["multiplier"] == {
        "signal": "EngineReference.ReferenceTorque",
        "divides": False,
        "unit": "Nm",
        "factor": 1.0,
        "offset": 0.0,
        "not_available": [65535],
        "timeout_ms": 5000.0,
    }
    assert len(row["protection"]) == 2
