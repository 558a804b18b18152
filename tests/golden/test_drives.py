"""Six stored drives give the estimates that are stored with them; drives/README.md says how these were made."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
NAMES = (
    "paper_car_laboratory",
    "paper_car_production",
    "avante_laboratory",
    "avante_production",
    "paper_car_delays",
    "avante_without_shafts",
)
CASES = [
    (name, method)
    for name in NAMES
    for method in ("kalman", "oh2014")
    if (name, method) != ("avante_without_shafts", "oh2014")  # that one needs the shaft speeds
]


@pytest.fixture(scope="module")
def golden():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOOLS))
        return importlib.import_module("golden_drives")


@pytest.fixture(scope="module")
def drives(golden):
    return {drive.name: drive for drive in sys.modules["replayed_drives"].DRIVES}


class ThisProcess:
    """``dctorque`` in this process, where its code is compiled already."""

    def __init__(self, monkeypatch):
        self._monkeypatch = monkeypatch

    def dctorque(self, *arguments):
        from dctorque_can.cli.main import main

        self._monkeypatch.setattr(sys, "argv", ["dctorque", *arguments])
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code


@pytest.mark.parametrize(("name", "method"), CASES)
def test_estimates_are_the_stored_ones(golden, drives, name, method, monkeypatch, tmp_path):
    """Within a millionth of each column's scale; integers, such as phases and status, must be equal."""
    ours = golden.estimate(ThisProcess(monkeypatch), drives[name], method, tmp_path)
    stored = golden.load()[name, method]
    found = golden.moved(stored, ours, golden.load_scales())
    assert found.found == ()
    assert found.compared == len(stored)


def test_all_drives_are_stored_and_exercise_both_clutches(golden, drives):
    """Each has a launch and a shift: both clutches slip with a valid torque, the first one locks between."""
    assert {(d.name, m) for d in drives.values() for m in golden.METHODS if m in d.methods} == set(CASES)
    stored = golden.load()
    assert set(stored) == set(CASES)
    for columns in stored.values():
        assert {1, 2} <= set(columns["estimates.phase1"])
        assert {0, 1} <= set(columns["estimates.phase2"])
        assert np.abs(columns["estimates.clutch2_torque_nm"]).max() > 50.0
        assert np.count_nonzero(columns["estimates.status"] & 3 == 3) > 60


def test_a_change_of_two_millionths_is_seen(golden):
    stored, scales = golden.load()["avante_production", "kalman"], golden.load_scales()
    name = "estimates.clutch2_torque_nm"
    for share, found in ((0.5e-6, 0), (2e-6, 1)):
        changed = dict(stored)
        changed[name] = stored[name] + share * scales[name] * (np.arange(len(stored[name])) == 30)
        assert len(golden.moved(stored, changed, scales).found) == found
