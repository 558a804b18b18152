"""`dctorque init`: a vehicle file for a new car, from its DBC and a drive."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

from dctorque_can.config.load import ConfigError, load_config

SHIPPED = Path(__file__).parents[2] / "dbc" / "demo_car_one_gear.dbc"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return 60 s of the demo car."""
    from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car, write_log
    from dctorque_can.resources import shipped_config

    config = load_config(shipped_config("paper_car"), {"databases.0.file": str(SHIPPED)})
    path = tmp_path_factory.mktemp("init") / "drive.blf"
    write_log(config, simulate_car(config, DriveName.PAPER, ProfileName.ONE_GEAR, 1, None), path)
    return path


def test_a_file_is_written_and_only_its_gaps_are_wrong(dctorque, log: Path, tmp_path: Path) -> None:
    outcome = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--log", log)
    assert outcome.code == 0, outcome.err
    assert "inputs.engine_speed" in outcome.out
    assert "next: fill the gaps, then dctorque check car.yaml --log" in outcome.err
    text = (tmp_path / "car.yaml").read_text()
    assert "# sure: " in text
    assert "# GAP: " in text
    with pytest.raises(ConfigError) as wrong:
        load_config(tmp_path / "car.yaml")
    errors = [problem for problem in wrong.value.problems if problem.severity == "error"]
    assert [problem.key for problem in errors if not problem.key.startswith("clutch_phase")] == ["vehicle"]
    assert {problem.key.rpartition(".")[2] for problem in errors[1:]} <= {"kissing_point", "hysteresis"}
    assert "no such class of cars" in errors[0].reason


def test_with_its_gaps_filled_the_file_can_be_used(dctorque, log: Path, tmp_path: Path) -> None:
    assert dctorque("init", "car.yaml", "--dbc", SHIPPED, "--log", log).code == 0
    text = (tmp_path / "car.yaml").read_text()
    ratios = {1: 14.0, 2: 9.0, 3: 6.0, 4: 4.5, 5: 3.6, 6: 3.0, 7: 2.5, "R": 13.0}
    shafts = {gear: 2 if gear == "R" else 2 - int(gear) % 2 for gear in ratios}
    gears = {gear: {"shaft": shafts[gear], "ratio": ratio, "final_drive": 1.0} for gear, ratio in ratios.items()}
    filled = text.replace("class: GAP", f"class: compact_dct7_dry\n  driven_axle: front\n  gears: {gears}")
    for name, value in (("kissing_point", 3), ("hysteresis", 0.2)):
        filled = filled.replace(f"# {name}:", f"{name}: {value}")
    (tmp_path / "car.yaml").write_text(filled)
    assert dctorque("check", "car.yaml").code == 0


def test_json_has_the_same(dctorque, log: Path) -> None:
    outcome = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--log", log, "--json")
    assert outcome.code == 0
    result = json.loads(outcome.out)
    found = {each["key"]: each for each in result["proposals"]}
    assert found["inputs.engine_speed"]["signals"] == ["EngineData.EngineSpeed"]
    assert found["inputs.wheel_speeds.rl"]["signals"] == ["WheelSpeedsRear.WheelSpeedRL"]
    assert set(found["inputs.engine_speed"]) == {
        "key",
        "signals",
        "level",
        "merit",
        "why",
        "fields",
        "alternatives",
    }
    assert result["seconds"] == pytest.approx(16, abs=0.5)
    protections = {each["message"]: each["fields"]["crc"] for each in result["protections"]}
    assert protections["EngineData"] == "e2e_p01"
    assert {"key", "why", "needed"} == set(result["gaps"][0])


def test_nothing_is_overwritten_by_accident(dctorque, tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text("mine")
    refused = dctorque("init", "car.yaml", "--dbc", SHIPPED)
    assert refused.code == 1
    assert "exists already" in refused.err
    assert (tmp_path / "car.yaml").read_text() == "mine"
    assert dctorque("init", "car.yaml", "--dbc", SHIPPED, "--force").code == 0
    assert (tmp_path / "car.yaml").read_text() != "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["car.yaml"]


def test_what_cannot_be_read(dctorque, tmp_path: Path) -> None:
    assert dctorque("init", "car.yaml", "--dbc", "none.dbc").code == 1
    (tmp_path / "bad.dbc").write_text("hello")
    told = dctorque("init", "car.yaml", "--dbc", "bad.dbc")
    assert (told.code, told.err.startswith("error: bad.dbc")) == (1, True)
    missing = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--log", "none.blf")
    assert (missing.code, missing.err.startswith("error: ")) == (1, True)
    assert dctorque("init", "car.yaml").code == 2
    assert not (tmp_path / "car.yaml").exists()


def test_a_damaged_log_is_told(dctorque, log: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.blf").write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    outcome = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--log", "cut.blf", "--json")
    assert outcome.code == 3
    assert any("cut.blf" in line for line in json.loads(outcome.out)["incomplete"])
    assert (tmp_path / "car.yaml").exists()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_questions_need_a_terminal(dctorque, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    refused = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--ask")
    assert refused.code == 2
    assert "terminal" in refused.err
    assert not (tmp_path / "car.yaml").exists()


def test_answers_are_taken(dctorque, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Without a log much is doubtful: the first is left out, all others are confirmed."""
    monkeypatch.setattr(sys, "stdin", Terminal("9\n0\n" + "1\n" * 40))
    outcome = dctorque("init", "car.yaml", "--dbc", SHIPPED, "--ask")
    assert outcome.code == 0, outcome.err
    text = (tmp_path / "car.yaml").read_text()
    assert "confirmed when asked" in text
    assert "left out when asked" in text
    assert "# likely: name" not in text
