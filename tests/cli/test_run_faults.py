"""What ``dctorque run`` says and returns when there is nothing to estimate from, or nowhere to log."""

import json
from pathlib import Path

from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.resources import shipped_config

QUIET = ["run", shipped_config("paper_car"), "-i", "virtual", "--channel", "quiet run"]


def test_a_bus_that_never_says_anything_is_told_and_no_success(dctorque) -> None:
    outcome = dctorque(*QUIET, "--no-log", "--duration", 5, "--json")
    assert outcome.code == ExitCode.INCOMPLETE
    (missing,) = json.loads(outcome.out)["missing"]
    assert missing.startswith("no frame at all for 2 s on ")
    flat = " ".join(outcome.err.split())
    assert f"error: {missing}" in flat
    assert f"warning: {missing}" in flat


def test_no_folder_for_the_log_is_told_and_no_end(dctorque) -> None:
    outcome = dctorque(*QUIET, "--set", "logging.directory=/proc/nowhere", "--duration", 0.3)
    assert outcome.code == ExitCode.INCOMPLETE
    flat = " ".join(outcome.err.split())
    assert "log: /proc/nowhere: No such file or directory; trying a new log in 10 s" in flat
    assert "estimating without a log until one can be written" in flat
    assert "0.3 s: 0 frames in" in flat


def test_a_log_of_a_given_name_may_come_later_with_wait(dctorque, tmp_path: Path) -> None:
    (tmp_path / "full.mcap").symlink_to("/dev/full")
    outcome = dctorque(*QUIET, "--log", "full.mcap", "--force", "--wait", "--duration", 0.3)
    assert outcome.code == ExitCode.INCOMPLETE
    assert "estimating without a log" in " ".join(outcome.err.split())


def test_an_output_that_fits_nothing_is_an_error_of_the_vehicle_file(dctorque) -> None:
    outcome = dctorque(*QUIET, "--no-log", "--set", "output.ids={DctTorqu: 0x100}")
    assert outcome.code == ExitCode.CONFIG


def test_listening_only_is_said(dctorque) -> None:
    outcome = dctorque(*QUIET, "--no-log", "--listen-only", "--duration", 0.3, "--json")
    assert outcome.code == 0
    assert "only listening to virtual:quiet run" in outcome.err
    summary = json.loads(outcome.out)
    assert (summary["output"], summary["buses"][0]["listen_only"]) == (None, True)


def test_simulated_frames_are_not_played_onto_a_bus_that_is_only_listened_to(dctorque) -> None:
    outcome = dctorque(
        *("simulate", shipped_config("paper_car"), "-i", "virtual", "--channel", "x", "--duration", 1),
        *("--set", "can.listen_only=true", "--set", "output.enabled=false"),
    )
    assert outcome.code == ExitCode.ERROR
    assert "nothing can be played onto it" in " ".join(outcome.err.split())
