"""``dctorque compare`` from end to end, on the first seconds of the paper's drive."""

import json
from pathlib import Path

import pytest

from dctorque_can.analysis.errors import TORQUES
from dctorque_can.pipeline.estimates import SENSORS

from ..signed_speeds import OPTIONS as SIGNED

SHORT = ("--duration", 8)  # its first shift is within


def assert_one_line(outcome, *texts: str, code: int = 1) -> None:
    """Demand one error line; above it may only stand what was going on."""
    assert outcome.code == code, outcome.err
    assert outcome.out == ""
    assert "Traceback" not in outcome.err
    lines = [line for line in outcome.err.splitlines() if "error:" in line]
    assert len(lines) == 1, outcome.err
    for text in texts:
        assert text in lines[0]


def assert_wrong_usage(outcome, *texts: str) -> None:
    assert outcome.code == 2, outcome.err
    flat = " ".join(outcome.err.replace("│", " ").split())
    for text in texts:
        assert text in flat


@pytest.fixture
def log(dctorque, tmp_path: Path) -> Path:
    path = tmp_path / "drive.mcap"
    assert dctorque("simulate", "-o", path, *SHORT).code == 0
    return path


def test_a_simulated_drive_and_its_log_give_the_same(dctorque, log: Path) -> None:
    outcome = dctorque("compare", *SHORT, "--json", "-o", "compare.png")
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    assert result["name"] == "paper car"
    assert result["drives"] == ["paper drive, production signals, seed 1"]
    assert result["shift_count"] == 1
    assert Path(result["plot"]).read_bytes().startswith(b"\x89PNG")
    assert list(result["variants"]) == ["oh2014", "kalman"]
    for name, variant in (result["variants"] | {"bound": result["bound"]}).items():
        assert variant["all"]["samples"] > variant["shifts"]["samples"] > 100
        for part in ("all", "shifts"):
            for torque in TORQUES:
                figures = variant[part][torque]
                assert abs(figures["bias_nm"]) <= figures["rms_nm"] <= figures["peak_nm"]
                assert (figures["bands"] is None) == (name == "oh2014")
                bound = result["bound"][part][torque]
                assert figures["rms_over_bound"] * bound["rms_nm"] == pytest.approx(figures["rms_nm"])
                assert figures["rms_by_drive_nm"] == [figures["rms_nm"]] == [figures["rms_mean_nm"]]
                assert figures["rms_std_nm"] is None
            assert (variant[part]["clutches"] is None) == (name == "oh2014")
        assert list(variant["sensors"]) == ([] if name == "oh2014" else list(SENSORS))
    bands = result["variants"]["kalman"]["all"]["clutch1_nm"]["bands"]
    assert list(bands["coverage"]) == ["50%", "90%", "95%"]
    nees = result["variants"]["kalman"]["all"]["clutches"]
    assert nees["nees_low"] < 2 < nees["nees_high"]
    assert 1 <= nees["independent_samples"] < nees["samples"]

    recorded = dctorque("compare", log, "--json")
    assert recorded.code == 0, recorded.err
    again = json.loads(recorded.out)
    assert again["drives"] == [str(log)]
    assert again["variants"] == result["variants"]
    assert again["bound"] == result["bound"]


def test_the_bound_is_that_of_the_car_that_drove(dctorque, log: Path) -> None:
    """A log says which car that was, whatever the estimators are told; a copy of the truth elsewhere does not."""
    heavy = ("--set", "vehicle.chassis.mass_kg=2400", "--set", "vehicle.engine_inertia_kgm2=0.25")
    right, wrong = (json.loads(dctorque("compare", log, "--json", *more).out) for more in ((), heavy))
    assert wrong["bound"] == right["bound"]
    assert wrong["variants"]["kalman"] != right["variants"]["kalman"]
    assert dctorque("replay", log, "--frames", "--truth", "-o", "copy.mcap", *heavy).code == 0
    copy = dctorque("compare", "copy.mcap", "--json")
    assert copy.code == 0, copy.err
    assert "copy.mcap does not say which vehicle drove" in " ".join(copy.err.split())
    assert json.loads(copy.out)["bound"] != right["bound"]


def test_the_spread_over_seeds(dctorque) -> None:
    run = ("compare", "--duration", 3, "--json")
    ones = [json.loads(dctorque(*run, "--seed", seed).out) for seed in (5, 6)]
    outcome = dctorque(*run, "--seed", 5, "--seeds", 2)
    assert outcome.code == 0, outcome.err
    both = json.loads(outcome.out)
    for torque in TORQUES:
        each = [one["variants"]["kalman"]["all"][torque]["rms_nm"] for one in ones]
        found = both["variants"]["kalman"]["all"][torque]
        assert found["rms_by_drive_nm"] == each
        assert found["rms_mean_nm"] == pytest.approx(sum(each) / 2)
        assert found["rms_std_nm"] == pytest.approx(abs(each[0] - each[1]) / 2**0.5)
    nis = [one["variants"]["kalman"]["sensors"]["engine"] for one in (*ones, both)]
    assert nis[2]["samples"] == nis[0]["samples"] + nis[1]["samples"]
    assert min(nis[0]["nis"], nis[1]["nis"]) <= nis[2]["nis"] <= max(nis[0]["nis"], nis[1]["nis"])
    shown = dctorque("compare", "--duration", 3, "--seed", 5, "--seeds", 2)
    assert "mean ± sd" in shown.out
    assert " ± " in shown.out


def test_the_tables(dctorque) -> None:
    outcome = dctorque("compare", "--duration", 3, "--variant", "as:100:told=vehicle.mass_kg=2000")
    assert_wrong_usage(outcome, "the name must be")
    outcome = dctorque("compare", "--duration", 3, "--profile", "laboratory")
    assert outcome.code == 0, outcome.err
    for text in (
        "laboratory signals, seed 1, 0 shifts",
        "clutch 1",
        "oh2014",
        "kalman",
        "RMS",
        "NEES",
        "score",
        "bound",
        "NIS",
        "shaft2",
    ):
        assert text in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 100


def test_more_variants_and_seeds(dctorque) -> None:
    same = "same=estimator.method=kalman,estimator.kalman.gate_patience_s=2"
    run = ("compare", "--duration", 3, "--json", "--variant", same, "--seeds", 2, "--seed", 5)
    outcome = dctorque(*run)
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    assert [name[-6:] for name in result["drives"]] == ["seed 5", "seed 6"]
    assert list(result["variants"]) == ["oh2014", "kalman", "same"]
    variants = result["variants"]
    assert variants["same"]["set"] == {"estimator.method": "kalman", "estimator.kalman.gate_patience_s": "2"}
    assert variants["same"]["all"] == variants["kalman"]["all"]
    assert variants["same"]["shifts"] is None
    assert variants["kalman"]["all"] != variants["oh2014"]["all"]


EXACT = ("--set", "estimator.kalman.parameter_error_share=0")  # the simulated car is that of the file


def test_the_smoother_as_third(dctorque) -> None:
    same = "same=estimator.method=kalman"
    command = ("compare", *SHORT, *EXACT, *SIGNED, "--smooth", "--json", "--variant", same, "-o", "compare.png")
    outcome = dctorque(*command)
    assert outcome.code == 0, outcome.err
    variants = json.loads(outcome.out)["variants"]
    assert list(variants) == ["oh2014", "kalman", "kalman smoothed", "same"]
    assert [found["smoothed"] for found in variants.values()] == [False, False, True, False]
    assert variants["same"]["all"] == variants["kalman"]["all"]
    for part in ("all", "shifts"):
        smoothed, online = (variants[name][part] for name in ("kalman smoothed", "kalman"))
        assert smoothed["samples"] == online["samples"]
        for torque in TORQUES:
            offset = 1.0 if part == "shifts" and torque != "output_nm" else 1.2  # of a short drive, one draw
            assert smoothed[torque]["rms_nm"] < offset * online[torque]["rms_nm"]
            if torque != "output_nm":
                assert smoothed[torque]["bands"]["log_score"] < online[torque]["bands"]["log_score"]
    told = dctorque("compare", "--duration", 3, "--smooth")
    assert told.code == 0, told.err
    assert "kalman smoothed" in told.out
    assert max(map(len, told.out.splitlines())) <= 100


def test_logs_without_truth(dctorque, log: Path, tmp_path: Path) -> None:
    assert dctorque("replay", log, "--frames", "-o", "plain.mcap").code == 0
    assert_one_line(dctorque("compare", "plain.mcap"), "plain.mcap: has no topic /dctorque/truth", "simulate")
    assert dctorque("simulate", "-o", "drive.blf", "--duration", 2).code == 0
    beside = dctorque("compare", "drive.blf", "--config", "paper_car")
    assert beside.code == 0, beside.err
    assert_one_line(dctorque("compare", "drive.blf"), "drive.blf: carries no configuration", "--config")
    (tmp_path / "drive.truth.mcap").unlink()
    outcome = dctorque("compare", "drive.blf", "--config", "paper_car")
    assert_one_line(outcome, "drive.blf: has no truth", "drive.truth.mcap")


def test_bad_input_is_one_clear_line(dctorque) -> None:
    assert_one_line(dctorque("compare", "none:100:.mcap"), "none:100:.mcap: there is no such file")
    assert_one_line(dctorque("compare", "--config", "none.yaml"), "none.yaml", "cannot be read")
    outcome = dctorque("compare", "--variant", "x=estimator.method=kalmann")
    assert_one_line(outcome, "variant x: --set: estimator.method = kalmann", "oh2014", "kalman")
    outcome = dctorque("compare", "--variant", "x=estimator.kalman.gate_sigmas=4")
    assert_one_line(outcome, "variant x: --set: estimator.kalman.gate_sigmas", "gate_sigma")
    for name in ("kalman", "bound"):
        assert_one_line(dctorque("compare", "--variant", f"{name}=name=x"), f"variant {name}: this name is taken")


def test_wrong_usage(dctorque, log: Path) -> None:
    assert_wrong_usage(dctorque("compare", log, "--seeds", 3), "--seeds is for simulated drives")
    assert_wrong_usage(dctorque("compare", "-o", "x.bmp"), "known are .png")
    assert_wrong_usage(dctorque("compare", "--variant", "x"), "KEY=VALUE")
    assert_wrong_usage(dctorque("compare", "--variant", "=a=b"), "the name must be")
    twice = ("--variant", "x=name=a", "--variant", "x=name=b")
    assert_wrong_usage(dctorque("compare", *twice), "there are two variants x")


def test_a_torn_log_is_used_as_far_as_it_can_be_read(dctorque, tmp_path: Path) -> None:
    assert dctorque("simulate", "-o", "drive.blf", "--duration", 3).code == 0
    log = tmp_path / "drive.blf"
    whole = json.loads(dctorque("compare", log, "-c", "paper_car", "--json").out)
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 6 // 10])
    outcome = dctorque("compare", log, "-c", "paper_car", "--json")
    assert outcome.code == 3, outcome.err
    assert f"warning: {log}: " in outcome.err
    torn = json.loads(outcome.out)
    samples = [result["variants"]["kalman"]["all"]["samples"] for result in (torn, whole)]
    assert 0.3 < samples[0] / samples[1] < 0.9
