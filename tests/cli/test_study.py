"""``dctorque study`` from end to end, on three seconds of the paper's drive."""

import json
import signal
import subprocess
import time
from pathlib import Path

import yaml

from dctorque_can.pipeline.estimates import SENSORS

from ..signed_speeds import OPTIONS as SIGNED

HANG_S = 900  # so late that no load of the machine explains it
SMALL = {
    "vehicle": "paper_car",
    "duration_s": 3,
    "runs": 3,
    "vary": {"engine_torque_offset_nm": {"uniform": {"low": -20, "high": 20}}},
}


def study(folder: Path, **changes: object) -> Path:
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(SMALL | changes))
    return path


def lines(path: Path) -> list[str]:
    """Return the header and the runs in order of their numbers."""
    header, *runs = path.read_text().splitlines()
    return [header, *sorted(runs, key=lambda line: json.loads(line)["run"])]


def test_three_runs_then_more(dctorque, tmp_path: Path) -> None:
    outcome = dctorque("study", study(tmp_path), *SIGNED, "-o", "three", "--json", "-j", 1)
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    assert (result["runs"], result["used"], result["failed"], result["sensitivity"]) == (3, 3, [], {})
    assert 0 < result["nominal_rms"]["clutch1_nm"] < 10
    assert result["rms"]["clutch1_nm"]["p5"] < result["rms"]["clutch1_nm"]["p95"]
    assert "6 good runs would be needed" in outcome.err
    assert not (tmp_path / "three" / "sensitivity.png").exists()
    first = lines(tmp_path / "three" / "results.jsonl")

    outcome = dctorque("study", study(tmp_path), *SIGNED, "-o", "three", "--runs", 12, "--json", "-j", 1)
    assert outcome.code == 0, outcome.err
    assert "4 runs are there already, 9 are missing" in outcome.err
    result = json.loads(outcome.out)
    (best,) = result["sensitivity"]["clutch1_nm"]["ranking"]
    assert best["factor"] == "engine_torque_offset_nm"
    assert best["significant"]
    assert best["shape"] == "∪"
    assert Path(result["files"]["plot"]).read_bytes().startswith(b"\x89PNG")
    assert lines(tmp_path / "three" / "results.jsonl")[:5] == first
    summary = json.loads((tmp_path / "three" / "summary.json").read_text())
    assert summary == {key: value for key, value in result.items() if key != "files"}

    shown = dctorque("study", study(tmp_path), *SIGNED, "-o", "three", "--runs", 12)
    assert "all 12 runs are there already" in shown.err
    for text in (
        "RMS error of kalman [N·m]",
        "nominal",
        "95 %",
        "clutch 1",
        "engine_torque_offset_nm",
        "sensitivity.png",
    ):
        assert text in shown.out


def test_both_methods_and_the_bound_are_judged(dctorque, tmp_path: Path) -> None:
    run = (
        "study",
        study(tmp_path, runs=2),
        "--vehicle",
        "avante_dct7",
        "--duration",
        6,
        "-j",
        1,
        "--drives",
        "kept",
    )
    outcome = dctorque(*run, "--json")
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    assert (result["vehicle"], result["duration_s"]) == ("Avante DCT7", 6)
    assert Path(result["files"]["results"]) == Path("out/study_small_6.0_avante_dct7/results.jsonl")
    assert list(result["estimators"]) == ["oh2014", "kalman", "bound"]
    for name, found in result["estimators"].items():
        assert found["shifts"]["clutch1_nm"]["runs"] == 2
        assert (found["all"]["clutch1_nm"]["coverage"] is None) == (name == "oh2014")
        assert list(found["sensors"]) == ([] if name == "oh2014" else list(SENSORS))
    bound = result["estimators"]["bound"]["all"]["output_nm"]
    assert bound["rms_over_bound"] == 1.0
    assert bound["rms_median_nm"] <= bound["rms_p90_nm"] <= bound["rms_worst_nm"]
    assert len(list((tmp_path / "kept").iterdir())) == 3

    shown = dctorque(*run)
    assert shown.code == 0, shown.err
    for text in ("/bound", "≥ 90%", "2/2", "driven wheels", "worst"):
        assert text in shown.out
    tables = shown.out.split("RMS error of the drawn cars")[1].splitlines()
    assert max(map(len, tables)) <= 100


def test_other_results_are_not_mixed_in(dctorque, tmp_path: Path) -> None:
    assert dctorque("study", study(tmp_path), "-o", "x", "-j", 1, "--runs", 1).code == 0
    outcome = dctorque("study", study(tmp_path, seed=2), "-o", "x", "-j", 1, "--runs", 1)
    assert outcome.code == 1
    assert "holds results of another study" in " ".join(outcome.err.split())
    outcome = dctorque("study", study(tmp_path), "-o", "x", "--set", "vehicle.chassis.mass_kg=1700", "--runs", 1)
    assert "another vehicle file, DBC or --set" in " ".join(outcome.err.split())
    assert dctorque("study", study(tmp_path, seed=2), "-o", "x", "-j", 1, "--runs", 1, "--force").code == 0


def test_runs_that_fail_are_counted_and_named(dctorque, tmp_path: Path) -> None:
    steep = {"grade_offset_rad": {"uniform": {"low": 0.0, "high": 0.3}}}
    path = study(tmp_path, vary=steep, duration_s=5, runs=4)
    outcome = dctorque("study", path, "-o", "steep", "-j", 1, "--json")
    assert outcome.code == 3, outcome.err
    result = json.loads(outcome.out)
    assert len(result["failed"]) + result["used"] == 4
    assert 0 < result["used"] < 4
    assert all("the car" in failed["error"] for failed in result["failed"])
    assert "failed: the car" in outcome.err
    assert dctorque("study", path, "-o", "steep", "-j", 1).code == 3  # also when nothing is left to do


def test_mistakes_are_told_and_leave_nothing_behind(dctorque, tmp_path: Path) -> None:
    outcome = dctorque("study", study(tmp_path, vary={"payload": {"uniform": {"low": 0, "high": 1}}}))
    assert outcome.code == 1
    assert "did you mean payload_kg" in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "out").exists()
    assert dctorque("study", "none.yaml").code == 1
    uphill = {"grade_offset_rad": {"uniform": {"low": 0.0, "high": 0.1}}}
    outcome = dctorque("study", study(tmp_path, vary=uphill), "--set", "vehicle.chassis.mass_kg=9000", "-j", 1)
    assert outcome.code == 1
    assert "the car with nothing varied fails already: the car" in " ".join(outcome.err.split())


def test_an_interrupted_study_goes_on_to_the_same_results(
    dctorque, command: list[str], environment: dict[str, str], tmp_path: Path
) -> None:
    assert dctorque("study", study(tmp_path, runs=6).name, "-o", "whole", "-j", 1).code == 0
    arguments = ["study", "small.yaml", "-o", "cut", "--runs", "100000", "-j", "2"]
    process = subprocess.Popen(
        [*command, *arguments], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, start_new_session=True
    )
    results = tmp_path / "cut" / "results.jsonl"
    deadline = time.monotonic() + HANG_S
    while process.poll() is None and time.monotonic() < deadline:
        if results.exists() and results.read_bytes().count(b"\n") > 3:
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=HANG_S)
    assert process.returncode == 130, err
    assert b"runs are kept" in err
    assert b"Traceback" not in err
    kept = results.read_text().splitlines()
    assert len(kept) > 3
    torn = kept[0][:30]  # as if a crash had cut off the line after the third run
    results.write_text("\n".join([*kept[:4], torn]))
    outcome = dctorque("study", "small.yaml", "-o", "cut", "-j", 1)
    assert outcome.code == 0, outcome.err
    assert "cut off" in outcome.err
    assert lines(results)[:8] == lines(tmp_path / "whole" / "results.jsonl")
    summaries = [json.loads((tmp_path / name / "summary.json").read_text()) for name in ("cut", "whole")]
    assert summaries[0] == summaries[1]


def test_a_catalogue_of_one_drive(dctorque, tmp_path: Path) -> None:
    """Made, shown, and gone on with; options that it has no use for are refused."""
    path = tmp_path / "catalogue.yaml"
    vary = {"engine_torque_offset_nm": {"uniform": {"low": -5, "high": 5}}}
    catalogue = {"vehicles": ["paper_car"], "drives": ["wheel_spin"], "runs": 1, "signals": {"usual": {}}}
    path.write_text(yaml.safe_dump(catalogue | {"vary": vary}))
    outcome = dctorque("study", path, "-o", "one", "-j", 1, "--json")
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    (row,) = result["rows"]
    assert (row["vehicle"], row["drive"], row["signals"], row["draws"]) == ("paper_car", "wheel_spin", "usual", 1)
    assert 0 < row["torques"]["clutch1_nm"]["rms_nm"] < 50
    summary = json.loads((tmp_path / "one" / "summary.json").read_text())
    assert summary == {key: value for key, value in result.items() if key != "files"}
    shown = dctorque("study", path, "-o", "one", "-j", 1)
    assert shown.code == 0
    assert "all drives are there already" in shown.err
    assert "wheel_spin" in shown.out
    assert "Within the 95 % band" in shown.out
    refused = dctorque("study", path, "--drive", "paper")
    assert refused.code == 1
    assert "--drive" in refused.err
