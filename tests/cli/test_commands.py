"""What the commands do when all is well, and when only part of it is."""

import gzip
import json
import os
import signal
import subprocess
import time
from contextlib import nullcontext
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from dctorque_can import __version__
from dctorque_can.cli.options import DriveChoice
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.simulated_car import DriveName
from dctorque_can.pipeline.estimates import SENSORS
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.manoeuvres import MANOEUVRES

from ..signed_speeds import OPTIONS as SIGNED

PAPER = shipped_config("paper_car")
HANG_S = 900  # so late that no load of the machine explains it
COMMANDS = ("run", "replay", "simulate", "demo", "study", "check", "design", "recover", "convert")


def test_help_names_every_command_and_the_exit_codes(dctorque_process) -> None:
    outcome = dctorque_process("--help")
    assert outcome.code == 0
    for word in (*COMMANDS, "Exit codes", "130"):
        assert word in outcome.out


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(dctorque, name: str) -> None:
    outcome = dctorque(name, "--help")
    assert outcome.code == 0
    assert "Usage" in outcome.out


def test_version(dctorque) -> None:
    assert dctorque("--version").out.strip() == f"dctorque {__version__}"


def test_simulate_a_manoeuvre_without_signs(dctorque) -> None:
    made = dctorque("simulate", "-o", "back.mcap", "--drive", "roll_back", "--unsigned", "wheels", "--duration", 3)
    assert made.code == 0
    assert "roll_back drive, production signals, seed 1, unsigned wheels" in made.err
    missing = dctorque("simulate", "-o", "reverse.mcap", "--drive", "reverse")
    assert missing.code == 1
    assert "does not have: reverse" in missing.err


def test_simulate_and_replay_in_every_format_give_the_same_estimates(dctorque, tmp_path: Path) -> None:
    counts = set()
    for suffix in ("mcap", "blf", "log"):
        made = dctorque("simulate", "-o", f"drive.{suffix}", "--duration", 2, "--force", "--json")
        assert made.code == 0
        described = json.loads(made.out)
        assert described["frames"] == 800
        assert Path(described["truth"]).exists()
        config = () if suffix == "mcap" else ("-c", PAPER)
        replayed = dctorque("replay", f"drive.{suffix}", *config, "-o", f"{suffix}.mcap", "--force", "--json")
        assert replayed.code == 0
        result = json.loads(replayed.out)
        assert result["frames"] == 800
        counts.add(result["estimates"])
        assert len(read_table(tmp_path / f"{suffix}.mcap", ESTIMATES)) == result["estimates"]
    assert len(counts) == 1


@pytest.mark.parametrize("name", ["drive.blf", "drive.log.gz", "drive.asc"])
def test_the_truth_beside_a_log_is_found(dctorque, tmp_path: Path, name: str) -> None:
    plain = name.removesuffix(".gz")
    dctorque("simulate", "-o", plain, "--duration", 3)
    if name != plain:
        (tmp_path / name).write_bytes(gzip.compress((tmp_path / plain).read_bytes()))
    outcome = dctorque("replay", name, "-c", PAPER, "--truth", "-o", "x.mcap", "--json")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["errors"]["clutch1_nm"]["rms"] < 10


def test_replay_names_the_inputs_that_never_came_and_counts_what_is_valid(dctorque, tmp_path: Path) -> None:
    dctorque("simulate", "-o", "drive.mcap", "--duration", 3)
    whole = dctorque("replay", "drive.mcap", "-o", "whole.mcap", "--json")
    result = json.loads(whole.out)
    assert result["never_received"] == []
    assert 0.5 * result["estimates"] < result["valid_estimates"] <= result["estimates"]
    assert "warning" not in whole.err
    with open_log(tmp_path / "drive.mcap") as log:
        frames = Frames.concatenate(log.frames())
    write_frames(tmp_path / "engine_only.blf", frames[frames.can_id == frames.can_id[0]])
    partly = dctorque("replay", "engine_only.blf", "-c", PAPER, "-o", "part.mcap", "--json")
    result = json.loads(partly.out)
    assert "shaft1_speed" in result["never_received"]
    assert "engine_speed" not in result["never_received"]
    assert result["valid_estimates"] == 0
    assert "never received a usable value of: " in partly.err
    assert "shaft1_speed" in partly.err
    assert ("none of the" in partly.err) == bool(result["estimates"])


def test_a_log_of_which_nothing_can_be_used_is_told(dctorque, tmp_path: Path) -> None:
    """Exit code 3, and one sentence that says what is there and what is missing."""
    (tmp_path / "other.log").write_text("(1700000000.000000) can0 7E8#0102\n(1700000000.010000) can0 7E8#0102\n")
    told = dctorque("replay", "other.log", "-c", PAPER, "-o", "x.mcap")
    assert told.code == 3
    assert (
        "none of the 2 frames has a mapped identifier: the log holds 7E8 (2); mapped are 100 EngineData"
        in told.err
    )
    told = dctorque("replay", "x.mcap", "-c", PAPER, "-o", "y.mcap")
    assert told.code == 3
    assert "x.mcap: the log holds no frames; it holds /dctorque/" in told.err


def test_frames_out_of_order_and_a_clock_that_goes_back_are_told(dctorque, tmp_path: Path) -> None:
    dctorque("simulate", "-o", "drive.blf", "--duration", 2)
    with open_log(tmp_path / "drive.blf") as log:
        frames = Frames.concatenate(log.frames())
    order = np.arange(len(frames)).reshape(-1, 4)[:, ::-1].ravel()
    write_frames(tmp_path / "shuffled.mcap", frames[order])
    told = dctorque("replay", "shuffled.mcap", "-c", PAPER, "-o", "x.mcap")
    assert told.code == 0, told.err
    assert "frames stood behind frames of a later time, by up to" in told.err
    whole = dctorque("replay", "drive.blf", "-c", PAPER, "-o", "y.mcap")
    assert "stood behind" not in whole.err
    one, two = (read_table(tmp_path / name, ESTIMATES) for name in ("x.mcap", "y.mcap"))
    assert one.tobytes() == two.tobytes()
    told = dctorque(
        "replay", "shuffled.mcap", "-c", PAPER, "-o", "x.mcap", "--force", "--set", "estimator.reorder_ms=0"
    )
    assert told.code == 3
    assert "mapped frames (" in told.err
    assert "are late" in told.err
    told = dctorque("replay", "drive.blf", "drive.blf", "-c", PAPER, "-o", "x.mcap", "--force")
    assert told.code == 3
    assert "the clock of the log went back once" in told.err


def test_a_log_of_two_buses(dctorque, tmp_path: Path) -> None:
    dctorque("simulate", "-o", "one.blf", "--duration", 2)
    with open_log(tmp_path / "one.blf") as log:
        frames = Frames.concatenate(log.frames())
    other = frames[np.arange(len(frames))]
    other.channel[:] = 1
    other.t_us[:] += 500
    other.data[:] ^= 0x5A
    both = Frames.concatenate([frames, other]).sorted_by_time()
    write_frames(tmp_path / "both.blf", both)
    told = dctorque("replay", "both.blf", "-c", PAPER, "-o", "x.mcap")
    assert told.code == 3
    assert "channels 0 and 1 both carry mapped identifiers: 100 EngineData" in told.err
    told = dctorque("replay", "both.blf", "-c", PAPER, "-o", "x.mcap", "--force", "--set", "databases.0.channel=0")
    assert told.code == 0, told.err
    dctorque("replay", "one.blf", "-c", PAPER, "-o", "y.mcap")
    one, two = (read_table(tmp_path / name, ESTIMATES) for name in ("x.mcap", "y.mcap"))
    assert one.tobytes() == two.tobytes()


def test_replay_smooths(dctorque, tmp_path: Path) -> None:
    """File in, file out, a clutch less wrong than online; a method that cannot be smoothed: one line, no file."""
    observer = ("--set", "estimator.method=oh2014")
    assert dctorque("simulate", "-o", "drive.blf", "--duration", 3).code == 0
    run = ("replay", "drive.blf", "-c", PAPER, *SIGNED, "--truth", "--json")
    online = json.loads(dctorque(*run, "-o", "online.mcap").out)
    outcome = dctorque(*run, "--smooth", "-o", "smoothed.mcap")
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    assert (online["smoothed"], result["smoothed"]) == (False, True)
    assert result["estimates"] == online["estimates"] == len(read_table(tmp_path / "smoothed.mcap", ESTIMATES))
    for torque, offset in (("clutch1_nm", 1.0), ("output_nm", 1.1)):  # of an output torque in 3 s, one draw
        assert result["errors"][torque]["rms"] < offset * online["errors"][torque]["rms"]
    told = dctorque("replay", "smoothed.mcap", "-o", "again.mcap")
    assert "the log holds no frames" in told.err
    told = dctorque("replay", "drive.blf", "-c", PAPER, "--smooth", "-o", "told.mcap")
    assert f"{result['estimates']} smoothed estimates" in told.err
    wrong = dctorque("replay", "drive.blf", "-c", PAPER, *observer, "--smooth", "-o", "wrong.mcap")
    assert wrong.code == 1
    assert [line for line in wrong.err.splitlines() if "error" in line] == wrong.err.splitlines()
    assert "oh2014 cannot be smoothed" in wrong.err
    assert "--set estimator.method=kalman" in wrong.err
    assert not (tmp_path / "wrong.mcap").exists()


def test_the_same_seed_gives_the_same_file(dctorque, tmp_path: Path) -> None:
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        dctorque("simulate", "-o", f"{name}.blf", "--duration", 1, "--seed", seed)
        dctorque("replay", f"{name}.blf", "-c", PAPER, "-o", f"{name}.mcap")
    a, b, c = (read_table(tmp_path / f"{name}.mcap", ESTIMATES).tobytes() for name in "abc")
    assert a == b != c


def test_a_damaged_log_is_used_and_said_so(dctorque, tmp_path: Path) -> None:
    dctorque("simulate", "-o", "whole.mcap", "--duration", 3)
    content = (tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) - 2000])
    outcome = dctorque("replay", "cut.mcap", "-o", "out.mcap", "--json")
    assert outcome.code == 3
    assert "warning:" in outcome.err
    assert json.loads(outcome.out)["frames"] > 0
    recovered = dctorque("recover", "cut.mcap", "--json")
    assert recovered.code == 0
    assert json.loads(recovered.out)["messages"] > 0
    assert dctorque("replay", "cut.recovered.mcap", "-o", "out2.mcap").code == 0
    assert dctorque("recover", "cut.mcap").code == 1  # its output exists by now


def test_a_long_simulation_ends_at_once_when_interrupted(
    dctorque, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The signal comes when the first piece of the drive is done: a short one, or it would have to wait."""
    done: list[float] = []

    def interrupt(fraction: float) -> None:
        done.append(fraction)
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("dctorque_can.cli.simulate.progress_bar", lambda text: nullcontext(interrupt))
    outcome = dctorque("simulate", "-o", "x.mcap", "--drive", "mixed", "--duration", 1500)
    assert outcome.code == 130, outcome.err
    assert "Traceback" not in outcome.err
    assert len(done) == 1
    assert 0 < done[0] * 1500 < 5  # s of the drive
    assert not (tmp_path / "x.mcap").exists()


@pytest.mark.parametrize(
    ("profile", "limits"), [("laboratory", (1.3, 3.4, 40.0)), ("production", (2.4, 3.4, 40.0))]
)
def test_the_demo_keeps_the_promised_errors(
    dctorque, tmp_path: Path, profile: str, limits: tuple[float, float, float]
) -> None:
    """Limits of the paper's drive; the paper's own figures are 2.1, 3.4 and 67 N·m (Table 1)."""
    outcome = dctorque("demo", "--json", "--profile", profile)
    assert outcome.code == 0
    result = json.loads(outcome.out)
    assert result["rms"]["clutch1_nm"] < limits[0]
    assert result["rms"]["clutch2_nm"] < limits[1]
    assert result["rms"]["output_nm"] < limits[2]
    assert result["frames"] == (80_000 if profile == "laboratory" else 6_400)
    assert len(read_table(Path(result["log"]), ESTIMATES)) == result["estimates"] > 5000
    assert (tmp_path / result["plot"]).read_bytes().startswith(b"\x89PNG")
    replayed = dctorque("replay", result["log"], "-o", "again.mcap", "--truth", "--json")
    assert json.loads(replayed.out)["errors"]["clutch1_nm"]["rms"] == result["rms"]["clutch1_nm"]


def test_replay_says_what_the_innovations_are_worth(dctorque) -> None:
    assert dctorque("simulate", "-o", "drive.mcap", "--duration", 2).code == 0
    plain = dctorque("replay", "drive.mcap", "-o", "plain.mcap", "--set", "estimator.method=oh2014")
    assert "innovations" not in plain.err
    assert "engine torque" not in plain.err
    often = ("--set", "estimator.health_period_ms=10")  # the last record tells of nearly all
    kalman = ("replay", "drive.mcap", "-o", "kalman.mcap", "--force", *often)
    shown = dctorque(*kalman)
    assert "normalised innovations squared (1 is right): engine 0." in " ".join(shown.err.split())
    assert "engine torque against the nominal one: " in " ".join(shown.err.split())
    health = json.loads(dctorque(*kalman, "--json").out)["health"]
    last = read_table(Path("kalman.mcap"), HEALTH)[-1]
    assert list(health["nis"]) == list(SENSORS)
    assert health["nis"]["engine"] == pytest.approx(
        last["innovation_squares"][0] / last["innovations"][0], rel=0.02
    )
    assert health["engine_torque"] == pytest.approx(
        {name: last[f"engine_torque_{name}"] for name in health["engine_torque"]}, rel=0.05, abs=1e-3
    )
    assert 0.0 < health["engine_torque"]["lag_sigma_s"] < 0.06


def test_the_demo_shows_a_table_to_people(dctorque_process, tmp_path: Path) -> None:
    outcome = dctorque_process("demo", "-o", "shown", "--duration", "3", "--profile", "production")
    assert outcome.code == 0, outcome.err
    for text in ("clutch 1", "RMS error", "demo.png", "demo.mcap"):
        assert text in outcome.out
    assert (tmp_path / "shown" / "demo.png").exists()


def test_run_ends_after_its_duration_with_a_closed_log(dctorque, tmp_path: Path) -> None:
    outcome = dctorque(
        "run", PAPER, "-i", "virtual", "--channel", "quiet", "--log", "x.mcap", "--duration", 0.3, "--json"
    )
    assert outcome.code == 0, outcome.err
    summary = json.loads(outcome.out)
    assert summary["frames"] == 0
    assert summary["log"]["paths"] == ["x.mcap"]
    assert (tmp_path / "x.mcap").read_bytes().endswith(b"\x89MCAP0\r\n")


def test_run_stopped_at_once_gives_no_share_of_the_processor(dctorque) -> None:
    outcome = dctorque("run", PAPER, "-i", "virtual", "--channel", "quiet", "--no-log", "--duration", 0)
    assert outcome.code == 0
    assert "0 frames in" in outcome.err
    assert "processor" not in outcome.err


def test_run_interrupted_while_it_loads_ends_in_order(dctorque, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dctorque_can.cli.configuration.load", interrupted)
    outcome = dctorque("run", PAPER, "-i", "virtual", "--channel", "quiet", "--no-log")
    assert outcome.code == 0
    assert outcome.err.strip() == "stopped before it began"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 0)])
def test_run_stops_cleanly_on_a_signal_and_rotates_on_sigusr1(
    command: list[str], environment: dict[str, str], tmp_path: Path, number: int, code: int
) -> None:
    arguments = ["run", str(PAPER), "-i", "virtual", "--channel", "quiet", "--log", "x.mcap"]
    process = subprocess.Popen(
        [*command, *arguments], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    lines = [process.stderr.readline(), process.stderr.readline()]
    assert any("estimating on virtual:quiet" in line for line in lines), lines
    os.kill(process.pid, signal.SIGUSR1)
    assert "logging to x_" in process.stderr.readline()
    os.kill(process.pid, number)
    _, err = process.communicate(timeout=HANG_S)
    assert process.returncode == code
    assert "Traceback" not in err
    logs = sorted(tmp_path.glob("*.mcap"))
    assert len(logs) == 2
    assert all(log.read_bytes().endswith(b"\x89MCAP0\r\n") for log in logs)


def test_a_killed_service_leaves_a_closed_log(
    command: list[str], environment: dict[str, str], tmp_path: Path
) -> None:
    """The log writer is a process of its own and ends in order when its pipe does."""
    arguments = ["run", str(PAPER), "-i", "virtual", "--channel", "quiet", "--log", "x.mcap"]
    process = subprocess.Popen(
        [*command, *arguments], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    while "logging to x.mcap" not in process.stderr.readline():
        assert process.poll() is None
    process.kill()
    process.communicate(timeout=HANG_S)
    limit = time.monotonic() + HANG_S
    while not (tmp_path / "x.mcap").read_bytes().endswith(b"\x89MCAP0\r\n"):
        assert time.monotonic() < limit
        time.sleep(0.05)


def test_systemd_is_told_ready_alive_and_stopping(
    command: list[str], environment: dict[str, str], tmp_path: Path
) -> None:
    import socket

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(HANG_S)
        told = environment | {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "300000"}
        process = subprocess.Popen(
            [*command, "run", str(PAPER), "-i", "virtual", "--channel", "quiet", "--no-log"],
            cwd=tmp_path,
            env=told,
            stderr=subprocess.DEVNULL,
        )
        messages: list[str] = []
        while messages.count("WATCHDOG=1") < 3:
            messages.append(listener.recv(4096).decode())
            states = sum(message.startswith("STATUS=") for message in messages)
            assert states <= messages.count("WATCHDOG=1")  # whenever the one is due, so is the other
        process.terminate()
        while messages[-1] != "STOPPING=1":
            messages.append(listener.recv(4096).decode())
        assert process.wait(HANG_S) == 0
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):  # that was the last word
            listener.recv(4096)
    assert messages[0] == "READY=1"
    assert any(message.startswith("STATUS=") and "frames/s" in message for message in messages)


def test_every_manoeuvre_can_be_asked_for():
    """`cli` may not import what it would take the names from."""
    choices, _ = get_args(DriveChoice)
    assert get_args(choices) == tuple(DriveName) == ("paper", "mixed", *MANOEUVRES, "friction_drift")
