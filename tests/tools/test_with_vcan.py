"""``tools/with-vcan``: its command line. The tests marked ``socketcan`` show that it gives real interfaces."""

import subprocess
from pathlib import Path

import pytest

WITH_VCAN = Path(__file__).resolve().parents[2] / "tools" / "with-vcan"
HANG_S = 900  # so late that no load of the machine explains it


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "usage:"),
        (["--ifaces", "two", "true"], "not a positive number"),
        (["--timeout", "-1", "true"], "not a positive number of seconds"),
        (["--timeout"], "needs a value"),
        (["--can", "true"], "unknown option --can"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str], complaint: str) -> None:
    done = subprocess.run([WITH_VCAN, *arguments], capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr


def test_help_goes_to_stdout() -> None:
    done = subprocess.run([WITH_VCAN, "--help"], capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode, done.stderr) == (0, "")
    assert "exit code" in done.stdout
