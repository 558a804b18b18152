"""The corrected vehicle file: the user's own text with a comment at each change."""

from pathlib import Path

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.errors import DctorqueError
from dctorque_can.evidence.findings import Finding
from dctorque_can.evidence.fixed_file import write_fixed
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config

RATIO = Finding("error", "vehicle.gears.2.ratio", "gears.2: …", 2.1, 0.01, (("vehicle.gears.2.ratio", "2.1"),))
UNCERTAIN = Finding("error", "inputs.engine_torque", "torque, or mass")
HINT = Finding("hint", "vehicle.gears.3.ratio", "look", 9.0, None, (("vehicle.gears.3.ratio", "9"),))


def test_what_is_certain_is_written(tmp_path: Path) -> None:
    config = load_config(shipped_config("paper_car"))
    out = tmp_path / "deeper" / "fixed.yaml"
    out.parent.mkdir()
    fixed = write_fixed(config, [RATIO, UNCERTAIN, HINT], out)
    assert [edit.key for edit in fixed.changes] == ["vehicle.gears.2.ratio"]
    assert fixed.left == [UNCERTAIN]
    again = load_config(out)  # its DBC is found from the other folder, too
    assert again.settings.vehicle.gear(2).ratio == 2.1
    assert again.settings.vehicle.gear(3) == config.settings.vehicle.gear(3)
    text = out.read_text()
    assert "# was 2.18: check --log measured 2.100 ± 0.010" in text
    lines = shipped_config("paper_car").read_text().splitlines()
    assert len([line for line in lines if line not in text.splitlines()]) == 2  # the ratio and the path


def test_what_changes_with_it_says_so(tmp_path: Path) -> None:
    config = load_config(shipped_config("paper_car"))
    key, other = "inputs.engine_speed.delay_ms", "inputs.shaft1_speed.delay_ms"
    late = Finding("warning", key, "…", 0.0, 0.3, ((key, "0"),), also=((other, "7.5"),))
    fixed = write_fixed(config, [late], tmp_path / "fixed.yaml")
    assert [(edit.key, edit.value) for edit in fixed.changes] == [(key, "0"), (other, "7.5")]
    assert f"grows with {key}, all are relative" in fixed.path.read_text()
    delays_us = {given.quantity: given.delay_us for given in load_config(fixed.path).inputs}
    assert delays_us[Quantity.SHAFT1_SPEED] == 7500


def test_the_file_itself_and_others_stay(tmp_path: Path) -> None:
    config = load_config(shipped_config("paper_car"))
    with pytest.raises(DctorqueError, match="is the vehicle file itself"):
        write_fixed(config, [RATIO], config.path, force=True)
    there = tmp_path / "there.yaml"
    there.write_text("mine")
    with pytest.raises(DctorqueError, match="exists already"):
        write_fixed(config, [RATIO], there)
    assert there.read_text() == "mine"
    assert write_fixed(config, [RATIO], there, force=True).path == there
    with pytest.raises(DctorqueError, match="cannot be written"):
        write_fixed(config, [RATIO], tmp_path / "none" / "file.yaml")
