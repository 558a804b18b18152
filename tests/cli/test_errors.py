"""Bad input of every kind: one readable error, the right exit code, no traceback."""

import os
import stat
from pathlib import Path

import pytest

from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.resources import shipped_config, shipped_dbc

PAPER = shipped_config("paper_car")


def assert_clear(outcome, *texts: str, code: int = 1) -> None:
    assert outcome.code == code, outcome.err
    assert "Traceback" not in outcome.err + outcome.out
    flat = " ".join(outcome.err.split())
    for text in texts:
        assert text in flat


@pytest.fixture
def log(dctorque, tmp_path: Path) -> Path:
    path = tmp_path / "drive.mcap"
    assert dctorque("simulate", "-o", path, "--duration", 2).code == 0
    return path


def test_missing_files(dctorque) -> None:
    assert_clear(dctorque("replay", "none.blf", "-c", PAPER, "-o", "x.mcap"), "none.blf", "no such file")
    assert_clear(dctorque("run", "none.yaml"), "none.yaml", "cannot be read", code=ExitCode.CONFIG)
    assert_clear(dctorque("recover", "none.mcap"), "none.mcap")
    assert_clear(dctorque("simulate", "none.yaml", "-o", "x.mcap"), "none.yaml")


def test_a_wrong_dbc(dctorque, tmp_path: Path) -> None:
    text = PAPER.read_text().replace("../dbc/demo_car.dbc", "wrong.dbc")
    (tmp_path / "wrong.dbc").write_bytes(shipped_dbc("dctorque").read_bytes())
    (tmp_path / "car.yaml").write_text(text)
    outcome = dctorque("run", "car.yaml", "-i", "virtual", "--channel", "x")
    assert_clear(outcome, "car.yaml", "EngineData", code=ExitCode.CONFIG)


def test_a_file_that_is_no_log(dctorque, tmp_path: Path) -> None:
    (tmp_path / "noise.mcap").write_bytes(bytes(range(256)) * 8)
    (tmp_path / "noise.txt").write_text("hello")
    assert_clear(dctorque("replay", "noise.mcap", "-o", "x.mcap"), "noise.mcap", "is no .mcap file")
    assert_clear(dctorque("replay", "noise.txt", "-o", "x.mcap"), "known are .asc")


def test_an_output_that_exists(dctorque, log: Path, tmp_path: Path) -> None:
    (tmp_path / "old.mcap").write_text("precious")
    assert_clear(dctorque("replay", log, "-o", "old.mcap"), "old.mcap: exists already", "--force")
    assert_clear(dctorque("simulate", "-o", "old.mcap"), "old.mcap: exists already")
    assert_clear(dctorque("run", PAPER, "--log", "old.mcap"), "old.mcap: exists already")
    assert (tmp_path / "old.mcap").read_text() == "precious"
    assert_clear(dctorque("replay", log, "-o", log, "--force"), "is an input too")
    assert dctorque("replay", log, "-o", "old.mcap", "--force").code == 0


def test_a_full_disk(dctorque, log: Path, tmp_path: Path) -> None:
    (tmp_path / "full.mcap").symlink_to("/dev/full")
    assert_clear(dctorque("replay", log, "-o", "full.mcap", "--force"), "full.mcap", "No space left on device")
    assert_clear(dctorque("simulate", "-o", "full.mcap", "--force"), "full.mcap", "No space left on device")


def test_a_full_disk_for_the_log_of_the_service(dctorque, tmp_path: Path) -> None:
    try:  # no symbolic link: the service follows none
        os.mknod(tmp_path / "full.mcap", stat.S_IFCHR | 0o600, os.makedev(1, 7))
    except PermissionError:
        pytest.skip("only root may make a device that is full")
    outcome = dctorque(
        "run", PAPER, "-i", "virtual", "--channel", "x", "--log", "full.mcap", "--force", "--duration", 0.1
    )
    assert_clear(outcome, "no log", "full.mcap", "No space left on device")


def test_buses_that_are_not_there(dctorque) -> None:
    run = ("run", PAPER, "--no-log")
    assert_clear(dctorque(*run, "-i", "socketcan", "--channel", "can99"), "socketcan:can99 cannot be opened")
    assert_clear(dctorque(*run, "-i", "nonsense", "--channel", "x"), "Unknown interface type", "socketcan")
    outcome = dctorque("simulate", "--interface", "socketcan", "--channel", "can99", "--duration", 1)
    assert_clear(outcome, "socketcan:can99 cannot be opened")


def test_wrong_usage(dctorque, log: Path) -> None:
    assert_clear(dctorque("replay", log), "-o OUT.mcap", code=2)
    assert_clear(dctorque("replay", log, "-o", "x.blf"), ".mcap", code=2)
    assert_clear(dctorque("run"), "vehicle file", code=2)
    assert_clear(dctorque("run", PAPER, "--set", "nonsense"), "KEY=VALUE", code=2)
    assert_clear(dctorque("run", PAPER, "-c", PAPER), "once", code=2)
    assert_clear(dctorque("run", PAPER, "--log", "x.asc"), ".mcap", code=2)
    assert_clear(dctorque("simulate"), "-o LOG", code=2)
    assert_clear(dctorque("no-such-command"), "No such command", code=2)


def test_a_log_of_an_unknown_format_is_refused_before_the_simulation(
    dctorque, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("dctorque_can.offline.simulated_car.simulate_car", None)
    assert_clear(dctorque("simulate", "-o", "x.foo"), "x.foo", ".asc", code=2)
    assert list(tmp_path.iterdir()) == []


def test_a_truth_that_is_not_there(dctorque, log: Path, tmp_path: Path) -> None:
    replay = ("replay", "-c", PAPER, "-o", "x.mcap", "--truth")
    for name in ("lone.blf", "lone.asc"):
        assert dctorque("simulate", "-o", name, "--duration", 1).code == 0
        (tmp_path / "lone.truth.mcap").unlink()
        assert_clear(dctorque(*replay, name), name, "lone.truth.mcap")
    text = (tmp_path / "lone.asc").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(("date", "Begin Triggerblock"))]
    (tmp_path / "lone.asc").write_text("\n".join(lines) + "\n")
    assert_clear(dctorque(*replay, "lone.asc"), "lone.asc: names no date", "simulate to .mcap, .blf")
    assert dctorque("replay", log, "--frames", "-o", "bare.mcap").code == 0
    assert_clear(dctorque(*replay, "bare.mcap"), "/dctorque/truth", "needs a log of `dctorque simulate`")
    assert not (tmp_path / "x.mcap").exists()


def test_a_wrong_value_on_the_command_line(dctorque) -> None:
    outcome = dctorque("run", PAPER, "--set", "vehicle.engine_inertia_kgm2=-1")
    assert_clear(outcome, "--set", "vehicle.engine_inertia_kgm2", code=ExitCode.CONFIG)


def test_debug_shows_where(dctorque_process) -> None:
    outcome = dctorque_process("replay", "none.blf", "-c", PAPER, "-o", "x.mcap", "--debug")
    assert outcome.code == 1
    assert "Traceback" in outcome.err
    assert "LogReadError" in outcome.err


def test_an_error_of_our_own_is_one_line_too(dctorque, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise RuntimeError("impossible")

    monkeypatch.setattr("dctorque_can.cli.configuration.load", fail)
    assert_clear(dctorque("run", PAPER), "unexpected RuntimeError: impossible", "--debug")


def test_line_100_is_a_number(dctorque, tmp_path: Path) -> None:
    """rich would take ":100:" for the name of an emoji."""
    broken = tmp_path / "broken.yaml"
    broken.write_text("# \n" * 99 + "colour: red\n", encoding="utf-8")
    assert_clear(dctorque("check", broken), "broken.yaml:100: colour")
