"""`dctorque check --log`: a vehicle file held against a recorded drive."""

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return 16 s of the paper's drive."""
    from dctorque_can.config.load import load_config
    from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car, write_log
    from dctorque_can.resources import shipped_config

    config = load_config(shipped_config("paper_car"))
    path = tmp_path_factory.mktemp("check") / "drive.blf"
    write_log(config, simulate_car(config, DriveName.PAPER, ProfileName.PRODUCTION, 1, None), path)
    return path


def test_a_right_file(dctorque, log: Path) -> None:
    outcome = dctorque("check", "paper_car", "--log", log)
    assert outcome.code == 0, outcome.out
    assert "nothing found in 16 s of traffic" in outcome.out


def test_a_wrong_file(dctorque, log: Path) -> None:
    """A wrong ratio, a mass in tonnes and a checksum of another message, each by its key."""
    wrong = ("vehicle.gears.2.ratio=2.5", "vehicle.chassis.mass_kg=1.6", "protection.WheelSpeedsRear.data_id=7")
    options = [part for each in wrong for part in ("--set", each)]
    outcome = dctorque("check", "paper_car", "--log", log, *options, "--json")
    assert outcome.code == 3
    result = json.loads(outcome.out)
    assert result["ok"]
    told = {finding["key"]: finding for finding in result["findings"]}
    assert told["vehicle.chassis.mass_kg"]["severity"] == "warning"
    assert told["vehicle.gears.2.ratio"]["severity"] == "error"
    assert told["protection.WheelSpeedsRear"]["severity"] == "error"
    assert "100%" in told["protection.WheelSpeedsRear"]["text"]
    assert set(result["findings"][0]) == {"severity", "key", "text", "value", "sigma"}
    shown = dctorque("check", "paper_car", "--log", log, *options)
    assert shown.code == 3
    assert "error: vehicle.gears.2.ratio: gears.2: the log has 2.180 ± 0.0" in shown.out


def test_what_a_log_lacks(dctorque, log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.blf"
    cut.write_bytes(log.read_bytes()[:1000])
    outcome = dctorque("check", "paper_car", "--log", cut)
    assert outcome.code == 3
    assert "cut.blf" in outcome.err
    told = dctorque("check", "paper_car", "--log", cut, "--json")
    assert told.code == 3
    assert any("cut.blf" in line for line in json.loads(told.out)["incomplete"])
    missing = dctorque("check", "paper_car", "--log", tmp_path / "none.blf")
    assert missing.code == 1
    assert missing.err.startswith("error: ")


def test_fix_and_plots(dctorque, log: Path, tmp_path: Path) -> None:
    """A wrong ratio is put right in another file, and a picture shows it."""
    from dctorque_can.resources import shipped_config

    dbc = shipped_config("paper_car").parent.parent / "dbc" / "demo_car.dbc"
    text = shipped_config("paper_car").read_text().replace("../dbc/demo_car.dbc", str(dbc))
    text = text.replace("ratio: 2.18,", "ratio: 2.5,")
    (tmp_path / "wrong.yaml").write_text(text)
    options = ("--log", log, "--fix", "right.yaml", "--plots", "plots")
    outcome = dctorque("check", "wrong.yaml", *options, "--json")
    assert outcome.code == 3, outcome.err
    result = json.loads(outcome.out)
    (finding,) = result["findings"]
    assert finding["key"] == "vehicle.gears.2.ratio"
    assert finding["value"] == pytest.approx(2.18, abs=0.01)
    assert [Path(plot).read_bytes()[:4] for plot in result["plots"]] == [b"\x89PNG"]
    (change,) = result["fixed"]["changes"]
    assert change["key"] == "vehicle.gears.2.ratio"
    assert float(change["value"]) == pytest.approx(2.18, abs=0.01)
    assert result["fixed"]["findings"] == []
    assert (tmp_path / "wrong.yaml").read_text() == text
    assert dctorque("check", "right.yaml", "--log", log).code == 0
    again = dctorque("check", "wrong.yaml", *options)
    assert again.code == 1
    assert "right.yaml: exists already" in again.err
    shown = dctorque("check", "wrong.yaml", *options, "--force")
    assert "1 values corrected; the same drive contradicts nothing more" in shown.out


def test_options_that_need_others(dctorque, log: Path) -> None:
    assert dctorque("check", "paper_car", "--fix", "out.yaml").code == 2
    assert dctorque("check", "paper_car", "--plots", "out").code == 2
    assert dctorque("check", "paper_car", "--log", log, "--fix", "out.yaml", "--set", "name=x").code == 2
