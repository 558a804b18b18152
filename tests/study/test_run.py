"""Runs: the same whatever makes them; results that can be gone on with."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.analysis.errors import compare
from dctorque_can.chain import Chain
from dctorque_can.errors import DctorqueError
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.simulation.truth import TRUTH
from dctorque_can.study.draw import draw, noise_seed
from dctorque_can.study.plan import load_study
from dctorque_can.study.pool import finished_runs
from dctorque_can.study.results import Results
from dctorque_can.study.run import Bench, Setup, check_drive

IDENTITY = {"study": "s", "vehicle": "v", "version": "1"}


def test_the_nominal_run_is_the_drive_of_the_demo(write_study) -> None:
    study = load_study(write_study())
    record = Bench(Setup.of(study)).run(0, {})
    drive = simulate_car(study.config, DriveName.PAPER, ProfileName.PRODUCTION, noise_seed(7, 0), 3.0)
    errors = compare(Chain(study.config).feed(drive.frames).rows, drive.truth)
    assert record["rms"] == pytest.approx({name: error.rms for name, error in errors.items()}, rel=1e-12)


def test_a_run_does_not_depend_on_the_number_of_processes(write_study) -> None:
    study = load_study(write_study())
    values = dict(enumerate(draw(study)))
    one, two = (
        {record["run"]: record for record in finished_runs(Setup.of(study), values, jobs)} for jobs in (1, 2)
    )
    assert sorted(one) == [0, 1, 2, 3]
    assert one == two
    alone = Bench(Setup.of(study)).run(2, values[2])
    assert json.dumps(alone) == json.dumps(one[2])  # to the last digit
    assert len({record["rms"]["clutch1_nm"] for record in one.values()}) == 4


def test_a_known_error_has_its_known_effect(write_study) -> None:
    """In a launch clutch 1 carries engine torque less what turns the engine: an offset goes through (oh2014)."""
    bench = Bench(Setup.of(load_study(write_study(duration_s=6), {"estimator.method": "oh2014"})))
    plain = bench.run(0, {})
    wrong = bench.run(0, {"engine_torque_offset_nm": 20.0})
    assert wrong["bias"]["clutch1_nm"] - plain["bias"]["clutch1_nm"] == pytest.approx(20.0, rel=0.25)


def test_a_car_that_does_not_drive_is_a_failure_with_a_reason(write_study) -> None:
    bench = Bench(Setup.of(load_study(write_study(duration_s=6))))
    assert "it cannot climb" in bench.run(1, {"grade_offset_rad": 0.5})["error"]
    truth = np.zeros(10, TRUTH)
    with pytest.raises(DctorqueError, match=r"never was faster than 0\.00 m/s"):
        check_drive(truth, 0.3)
    truth["undriven_wheel_speed_rad_s"][5] = np.nan
    with pytest.raises(DctorqueError, match="went astray"):
        check_drive(truth, 0.3)


def open_results(path: Path, remarks: list[str] | None = None, anew: bool = False, **identity: str) -> Results:
    return Results(path, IDENTITY | identity, anew, (remarks if remarks is not None else []).append)


def test_results_are_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "new" / "results.jsonl"
    with open_results(path) as results:
        results.append({"run": 4, "rms": 0.1})
        results.append({"run": 2, "error": "§"})
    with open_results(path) as results:
        assert results.records == {4: {"run": 4, "rms": 0.1}, 2: {"run": 2, "error": "§"}}
    assert path.read_bytes().count(b"\n") == 3


@pytest.mark.parametrize("left", [1, 20, 60, 100, 126])
def test_a_torn_last_line_is_dropped_with_a_word(tmp_path: Path, left: int) -> None:
    path, remarks = tmp_path / "results.jsonl", list[str]()
    with open_results(path) as results:
        results.append({"run": 1, "rms": 0.125, "bias": 0.5, "peak": 0.25})
    whole = path.read_bytes()
    assert len(whole) > 127
    path.write_bytes(whole[:left])
    with open_results(path, remarks) as results:
        assert results.records == {}
        assert ["cut off" in remark for remark in remarks] == [True]
        results.append({"run": 1, "rms": 0.125, "bias": 0.5, "peak": 0.25})
    assert path.read_bytes() == whole


def test_foreign_and_damaged_results_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    with open_results(path) as results:
        results.append({"run": 1})
        with pytest.raises(DctorqueError, match="another study is writing it"):
            open_results(path)
    content = path.read_bytes()
    with pytest.raises(DctorqueError, match=r"results of another study.*and dctorque 1 \(this is 2\).*--force"):
        open_results(path, study="x", version="2")
    path.write_bytes(content + b"{\n")
    with pytest.raises(DctorqueError, match=r"results\.jsonl:3: this line is damaged"):
        open_results(path)
    for foreign in (b"precious", b"precious\n", b"[1]\n", b'{"run": 1}\n'):
        path.write_bytes(foreign)
        with pytest.raises(DctorqueError, match="holds no results of a study"):
            open_results(path)
        assert path.read_bytes() == foreign
    with open_results(path, anew=True) as results:
        assert results.records == {}


def test_a_worker_that_is_ended_is_told(write_study, monkeypatch) -> None:
    study = load_study(write_study())
    monkeypatch.setattr("dctorque_can.study.pool._begin", os._exit)  # ends every worker as it begins
    values = {1: {}, 2: {}}
    with pytest.raises(DctorqueError, match="worker process was ended"):
        list(finished_runs(Setup.of(study), values, 2))
