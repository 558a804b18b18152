"""Nothing that a file says reaches the terminal as a command."""

from pathlib import Path

from dctorque_can.cli.console import harmless
from dctorque_can.resources import shipped_config


def test_control_characters_are_written_out_and_all_else_stays() -> None:
    assert harmless("N·m\t60 Ω\n→ …") == "N·m\t60 Ω\n→ …"
    assert harmless("\x1b[2J\r\x07\x9b\u202e") == "\\x1b[2J\\r\\x07\\x9b\\u202e"


def test_a_vehicle_file_cannot_write_to_the_terminal(dctorque, tmp_path: Path) -> None:
    text = shipped_config("paper_car").read_text()
    (tmp_path / "car.yaml").write_text(text + '"\\e]0;owned\\a": 1\n')
    outcome = dctorque("check", "car.yaml")
    assert outcome.code == 1
    assert "owned" in outcome.err
    assert "\x1b]" not in outcome.err
