"""What a command does not import before its work: each of these takes longer than a short log to replay."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    "scipy.stats",
    "scipy.optimize",
    "scipy.signal",
    "matplotlib",
    "pandas",
    "asammdf",
    "dctorque_can.simulation.plant",
    "dctorque_can.estimators.oh2014.stability",
)
NOT_FOR_HELP = (*HEAVY, "numpy", "numba", "scipy", "can", "cantools", "dctorque_can.config.load")
PROGRAM = """
import json, sys
from dctorque_can.cli.main import main
unwanted, sys.argv = json.loads(sys.argv[1]), ["dctorque", *sys.argv[2:]]
try:
    main()
except SystemExit as end:
    found = [name for name in sorted(unwanted) if sys.modules.get(name)]
    print(json.dumps([end.code or 0, found]))
"""


def run(unwanted: tuple[str, ...], *arguments: object) -> tuple[int, list[str]]:
    """Run one command in a process of its own; return its exit code and what it imported of ``unwanted``."""
    command = [sys.executable, "-c", PROGRAM, json.dumps(unwanted), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, found = json.loads(done.stdout.splitlines()[-1])
    return code, found


@pytest.fixture
def log(dctorque, tmp_path: Path) -> Path:
    assert dctorque("simulate", "--duration", 1, "-o", "drive.mcap").code == 0
    return tmp_path / "drive.mcap"


@pytest.mark.parametrize("arguments", [["--help"], ["replay", "--help"], ["run", "--help"], ["study", "--help"]])
def test_help_imports_nothing_that_computes(arguments: list[str]) -> None:
    assert run(NOT_FOR_HELP, *arguments) == (0, [])


def test_a_subcommand_is_imported_alone() -> None:
    others = [f"dctorque_can.cli.{name}" for name in ("check", "compare", "design", "run", "simulate", "study")]
    assert run(tuple(others), "replay", "--help") == (0, [])


def test_replay_and_check_import_nothing_heavy(log: Path, tmp_path: Path) -> None:
    assert run(HEAVY, "replay", log, "-o", tmp_path / "out.mcap") == (0, [])
    assert run((*HEAVY, "scipy.linalg", "scipy.special"), "check", "paper_car") == (0, [])


def test_a_log_brings_the_reader_of_its_format_alone(log: Path, tmp_path: Path) -> None:
    others = ("dctorque_can.logs.blf.file", "dctorque_can.logs.text.asc", "dctorque_can.logs.python_can")
    assert run(others, "replay", log, "-o", tmp_path / "out.mcap") == (0, [])


def test_what_is_compiled_is_loaded_without_a_compiler(log: Path, tmp_path: Path) -> None:
    run((), "replay", log, "-o", tmp_path / "out.mcap")
    compiler = ("numba.np.linalg", "numba.np.arraymath", "scipy.linalg")
    assert run(compiler, "replay", log, "-f", "-o", tmp_path / "out.mcap") == (0, [])


def test_the_heavy_ones_are_noticed(tmp_path: Path) -> None:
    code, found = run(HEAVY, "design", "paper_car", "-o", tmp_path / "plot.png")
    assert code == 0
    assert {"matplotlib", "dctorque_can.estimators.oh2014.stability"} <= set(found)


def test_an_mf4_gets_its_reader_all_the_same(tmp_path: Path) -> None:
    """asammdf is kept away until a file is MF4, written or read."""
    pytest.importorskip("asammdf")
    path = tmp_path / "drive.mf4"
    assert run(("asammdf",), "simulate", "--duration", 1, "-o", path) == (0, ["asammdf"])
    assert run(("asammdf",), "replay", path, "-c", "paper_car", "-o", tmp_path / "out.mcap") == (0, ["asammdf"])
