"""``dctorque warm-up``: after it, no command compiles anything."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import json, sys
from dctorque_can.cli.main import main
from dctorque_can.compiling import watch
sys.argv = ["dctorque", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    sys.stderr.write(json.dumps([end.code or 0, watch.so_far.functions]))
"""
COMMANDS = [
    ["demo", "--duration", "2", "-o", "out"],
    ["simulate", "--duration", "2", "--profile", "production", "-o", "car.mcap"],
    ["simulate", "--duration", "2", "--profile", "inertial", "-o", "car.blf"],
    ["replay", "car.mcap", "-o", "again.mcap", "--signals", "--frames", "--truth"],
    ["replay", "car.mcap", "-o", "smooth.mcap", "--smooth"],
    ["replay", "car.mcap", "-o", "2014.mcap", "--set", "estimator.method=oh2014"],
    ["replay", "car.blf", "-c", "paper_car", "-o", "blf.mcap"],
    ["compare", "--duration", "16"],
    ["run", "paper_car", "-i", "virtual", "--channel", "warm", "--duration", "0.2", "--no-log"],
    ["check", "paper_car"],
    ["recover", "again.mcap"],
]


def run(folder: Path, *arguments: str) -> tuple[int, int, str]:
    """Return exit code, number of compiled functions and standard output of one command, in its own process."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], cwd=folder, capture_output=True, text=True, timeout=1800
    )
    code, compiled = json.loads(done.stderr.splitlines()[-1])
    return code, compiled, done.stdout


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("warm")
    assert run(folder, "warm-up", "--all")[0] == 0
    return folder


def test_the_second_time_there_is_nothing_to_do(warm: Path) -> None:
    code, compiled, out = run(warm, "warm-up", "--all", "--json")
    assert (code, compiled) == (0, 0)
    said = json.loads(out)
    assert (said["compiled"], said["cpu_seconds"], said["kept"]) == (0, 0.0, True)
    assert Path(said["folder"]).is_dir()


def test_afterwards_no_command_compiles(warm: Path) -> None:
    found = {" ".join(command): run(warm, *command)[:2] for command in COMMANDS}
    assert found == {" ".join(command): (0, 0) for command in COMMANDS}


def test_the_service_of_a_vehicle_file_needs_less(warm: Path) -> None:
    for method in ("kalman", "oh2014"):
        assert run(warm, "warm-up", "--method", method)[:2] == (0, 0)
    assert run(warm, "warm-up", "avante_dct7")[:2] == (0, 0)


def test_a_vehicle_file_has_one_method(dctorque) -> None:
    done = dctorque("warm-up", "paper_car", "--all")
    assert done.code == 2
    assert "leave out --all or CONFIG" in done.err
