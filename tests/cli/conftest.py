"""The command line in this process (quick) and in one of its own (as users run it)."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from dctorque_can.cli.main import main


@dataclass
class Outcome:
    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def dctorque(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run ``dctorque`` with arguments in this process, in a directory of its own."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["dctorque", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return Outcome(int(end.value.code or 0), captured.out, captured.err)

    return run


@pytest.fixture
def command() -> list[str]:
    """Start of a command line that runs ``dctorque`` in a process of its own."""
    return [sys.executable, "-W", "error", "-m", "dctorque_can.cli"]


@pytest.fixture
def environment() -> dict[str, str]:
    return os.environ | {"COLUMNS": "200", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


@pytest.fixture
def dctorque_process(command: list[str], environment: dict[str, str], tmp_path: Path) -> Run:
    """Run ``dctorque`` with arguments in a process of its own."""

    def run(*arguments: object) -> Outcome:
        done = subprocess.run(
            [*command, *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=900,  # compiles, perhaps on a busy machine
            cwd=tmp_path,
            env=environment,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run
