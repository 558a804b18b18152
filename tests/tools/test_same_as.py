"""``tools/same-as``: what counts as a difference, and its command line."""

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SAME_AS = TOOLS / "same-as"
HANG_S = 900  # so late that no load of the machine explains it


@pytest.fixture
def differences(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("column_differences").differences


def columns(**changes):
    return {
        "estimates.t_us": np.arange(3),
        "estimates.torque_nm": np.array([0.0, 100.0, -200.0]),
        "health.accepted": np.arange(6, dtype=np.uint32).reshape(3, 2),
    } | {name.replace("__", "."): np.asarray(value) for name, value in changes.items()}


def test_equal_columns_do_not_differ(differences):
    nothing_known = columns(estimates__torque_nm=[np.nan, 1.0, np.inf])
    assert differences(nothing_known, nothing_known).found == ()
    assert differences(columns(), columns()).compared == 3


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"estimates__torque_nm": [0.0, np.nextafter(100.0, 200.0), -200.0]},
            "by up to 1.4e-14 in 1 of 3 rows, first 1",
        ),
        ({"estimates__torque_nm": [-0.0, 100.0, -200.0]}, "in the bits of zero or not-a-number in 1 of 3 rows"),
        ({"estimates__torque_nm": [0.0, np.nan, -200.0]}, "known on one side only in 1 of 3 rows, first 1"),
        ({"estimates__torque_nm": [0.0, 100.0, -np.inf]}, "by up to inf in 1 of 3 rows, first 2"),
        ({"estimates__torque_nm": [0.0, 100.0]}, "shape 2 instead of 3"),
        ({"estimates__torque_nm": np.float32([0.0, 100.0, -200.0])}, "type float32 instead of float64"),
        ({"health__accepted": np.uint32([[0, 1], [2, 9], [4, 5]])}, "other values in 1 of 3 rows, first 1"),
        ({"health__extra": [1, 2, 3]}, "new"),
    ],
)
def test_one_change_is_one_difference(differences, changes, said):
    name = next(iter(changes)).replace("__", ".")
    (found,) = differences(columns(), columns(**changes)).found
    assert found.startswith(f"{name}: {said}")


def test_tolerance_is_a_share_of_the_largest_value_of_a_column(differences):
    moved = columns(estimates__torque_nm=[1.5e-4, 100.0, -200.0])
    assert differences(columns(), moved, tolerance=1e-6).found == ()
    assert len(differences(columns(), moved, tolerance=0.5e-6).found) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"health__accepted": np.uint32([[0, 1], [2, 4], [4, 5]])},
        {"estimates__torque_nm": [0.0, np.nan, -200.0]},
        {"estimates__torque_nm": [0.0, 100.0, -np.inf]},
    ],
)
def test_no_tolerance_excuses_integers_and_what_is_no_number(differences, change):
    assert len(differences(columns(), columns(**change), tolerance=0.9).found) == 1


def test_a_column_of_one_side_counts_unless_it_is_allowed(differences):
    fewer = {name: column for name, column in columns().items() if name != "estimates.torque_nm"}
    assert differences(columns(), fewer).found == ("estimates.torque_nm: gone",)
    for pattern in ("torque_nm", "torque*", "estimates.torque_nm"):
        result = differences(columns(), fewer, allow=["other", pattern])
        assert (result.found, result.allowed) == ((), ("estimates.torque_nm",))


def test_allowed_columns_that_both_have_are_compared(differences):
    moved = columns(estimates__torque_nm=[0.0, 100.0, -201.0])
    assert len(differences(columns(), moved, allow=["torque_nm"]).found) == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "required: COMMIT"),
        (["HEAD", "--drives", "uphill"], "unknown: uphill"),
        (["HEAD", "--methods", "kalman,luenberger"], "unknown: luenberger"),
        (["HEAD", "--tolerance", "-1"], "no such tolerance"),
        (["no-such-commit"], "exit code"),
    ],
)
def test_wrong_usage_exits_with_2(arguments, complaint):
    command = [sys.executable, SAME_AS, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr
