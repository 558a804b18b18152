"""``dctorque design``: the same numbers in tables and JSON, its options and its mistakes."""

import json
from dataclasses import astuple
from pathlib import Path

import pytest

from dctorque_can.cli import design as command
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.sensors import LABORATORY

PAPER = shipped_config("paper_car")


def found(dctorque, *arguments):
    outcome = dctorque("design", *arguments, "--json")
    assert outcome.code == 0, outcome.err
    return json.loads(outcome.out)


DESIGN = [  # of these tests, whatever the shipped file is tuned to
    word
    for name, value in (("engine_bandwidth", 200), ("shaft_bandwidth", 200), ("torque_crossover", 250))
    for word in ("--set", f"estimator.oh2014.{name}_rad_s={value}")
] + ["--set", "estimator.oh2014.acceleration_bandwidth_rad_s=65"]


def test_the_report_has_everything(dctorque) -> None:
    report = found(dctorque, "paper_car", *DESIGN)
    assert report["name"] == "paper car"
    assert report["gains"]["l_2_nm_per_rad"] == pytest.approx(200.0**2 * 0.23)
    assert [(pair["gear1"], pair["gear2"]) for pair in report["pairs"]] == [(1, 2), (3, 2), (3, 4), (5, 4)]
    for pair in report["pairs"]:
        assert pair["l_4_nm_per_rad"] == pytest.approx(200.0**2 * pair["J_e1_kgm2"])
        for condition in pair["conditions"]:
            assert condition["rank"] == 4
            assert condition["rank_with_leakage"] == (5 if condition["name"] == "cruise" else 6)
            assert len(condition["unobservable"]["tau_e"]) == 2
    checks = {check["condition"]: check for check in report["checks"]}
    violated = [name for name, check in checks.items() if not check["holds"]]
    assert violated == ["V serves all pairs", "the data alone tell all six states"]
    assert checks["(76) dV/dt ≤ 0, frozen"]["zeros"] == 2
    assert len(report["limits_of_the_proof"]) == 5


def test_the_defaults_are_the_laboratory(dctorque) -> None:
    sensors = found(dctorque, PAPER, *DESIGN)["sensors"]
    assert tuple(sensors.values()) == (*astuple(LABORATORY.noise)[:3], 1000, 1000, 1000)
    assert {timing.period_us for timing in LABORATORY.timing.values()} == {1000}


def test_noise_and_lag_follow_the_options(dctorque) -> None:
    base = found(dctorque, PAPER, *DESIGN)
    loud = found(dctorque, PAPER, *DESIGN, "--noise-engine", 0.6, "--noise-shaft", 0.6, "--noise-wheel", 0.04)
    fast = found(dctorque, PAPER, *DESIGN, "--vary", "wheel", "--pair", "4-3", "--ramp", 500)
    for name, sigma in base["pairs"][0]["noise_nm"].items():
        assert loud["pairs"][0]["noise_nm"][name] == pytest.approx(2 * sigma)
        assert loud["pairs"][0]["lag_nm"][name] == base["pairs"][0]["lag_nm"][name]
    sweep = base["sweep"]
    middle = sweep["factors"].index(1.0)
    for name, sigma in base["pairs"][0]["noise_nm"].items():
        assert sweep["noise_nm"][name][middle] == pytest.approx(sigma)
    noise, lag = (sweep[key]["clutch2_torque_nm"] for key in ("noise_nm", "lag_nm"))
    assert noise[4:] == sorted(noise[4:])  # below, the shaft model's own noise drifts for longer
    assert [abs(x) for x in lag] == sorted((abs(x) for x in lag), reverse=True)
    assert 2.0 < sweep["balanced_factor"] < 3.0
    assert sweep["largest_factor_allowed"] == pytest.approx(2.0)  # 500 rad/s at 1 ms, the crossover is 250
    assert (fast["sweep"]["gear1"], fast["sweep"]["gear2"]) == (3, 4)
    assert fast["sweep"]["varied"] == ["acceleration_bandwidth_rad_s"]
    assert fast["sweep"]["noise_nm"]["clutch_torque_sum_nm"] == pytest.approx(
        [base["pairs"][2]["noise_nm"]["clutch_torque_sum_nm"]] * 17
    )
    lags = (report["pairs"][2]["lag_nm"]["clutch1_torque_nm"] for report in (fast, base))
    assert next(lags) == pytest.approx(next(lags) / 2, rel=0.02)


def test_the_gains_follow_the_file(dctorque) -> None:
    key = "estimator.oh2014.engine_bandwidth_rad_s"
    assert found(dctorque, PAPER, *DESIGN, "--set", f"{key}=100")["gains"]["l_1_per_s"] == 200.0
    report = found(dctorque, PAPER, *DESIGN, "--set", "estimator.oh2014.road_load_time_s=0.002")
    checks = {check["condition"]: check["holds"] for check in report["checks"]}
    assert not checks["learned road load: l_3 T_road > 1"]


def test_it_is_about_the_observer_whatever_estimates(dctorque) -> None:
    methods = ("oh2014", "kalman")
    observer, other = (found(dctorque, PAPER, "--set", f"estimator.method={method}") for method in methods)
    assert observer == other


def test_an_unstable_design_is_told_and_has_no_noise(dctorque, tmp_path: Path) -> None:
    """Adaptation in 1 ms at samples of 10 ms: V̇ ≤ 0 still holds, the sampled form grows."""
    wild = ("--set", "estimator.oh2014.adaptation_time_s=0.001", "--set", "estimator.oh2014.leakage_time_s=600")
    report = found(dctorque, PAPER, *DESIGN, *wild, "--period-ms", 10)
    checks = {check["condition"]: check["holds"] for check in report["checks"]}
    assert checks["(76) dV/dt ≤ 0, frozen"]
    assert not checks["sampled at the given periods, frozen"]
    assert not checks["V serves the sampled form too"]
    assert set(report["pairs"][0]["noise_nm"].values()) == {None}
    outcome = dctorque("design", PAPER, *wild, "--period-ms", 10)
    assert outcome.code == 0
    assert "GROWS" in outcome.out
    outcome = dctorque("design", PAPER, *wild, "--period-ms", 10, "-o", "wild.png")
    assert outcome.code == 1
    assert "nothing to draw" in outcome.err
    assert not (tmp_path / "wild.png").exists()


def test_all_pairs_and_reverse(dctorque) -> None:
    report = found(dctorque, "avante_dct7", "--all-pairs", "--pair", "r-3", "--period-ms", "10,10,20")
    assert len(report["pairs"]) == 16
    assert (report["sweep"]["gear1"], report["sweep"]["gear2"]) == (3, -1)


def test_silent_sensors_are_no_mistake(dctorque, tmp_path: Path) -> None:
    silent = ("--noise-engine", 0, "--noise-shaft", 0, "--noise-wheel", 0)
    report = found(dctorque, PAPER, *DESIGN, *silent, "-o", "silent.png")
    assert set(report["pairs"][0]["noise_nm"].values()) == {0.0}
    assert report["sweep"]["balanced_factor"] is None
    assert (tmp_path / "silent.png").exists()


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
def test_people_get_tables_no_wider_than_100_columns(dctorque, tmp_path: Path, car: str) -> None:
    outcome = dctorque("design", car, "-o", "noise.png")
    assert outcome.code == 0
    for text in ("γ_e", "1-2", "accelerating", "4/6", "violated", "lag T_c1", "clutch torque sum", "noise.png"):
        assert text in outcome.out
    assert "…" not in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 104  # combining marks have no width
    assert (tmp_path / "noise.png").read_bytes().startswith(b"\x89PNG")


def test_mistakes_are_one_clear_line(dctorque, tmp_path: Path) -> None:
    def says(code: int, *arguments: object) -> str:
        outcome = dctorque("design", *arguments)
        assert outcome.code == code, outcome.err
        assert "Traceback" not in outcome.err
        return " ".join(outcome.err.replace("│", " ").split())

    assert "cannot be read" in says(1, "none.yaml")
    assert "not a gear of shaft 1 and one of shaft 2, such as 1-2" in says(2, PAPER, "--pair", "1-3")
    assert "one period or three" in says(2, PAPER, "--period-ms", "10,20")
    assert "one period or three" in says(2, PAPER, "--period-ms", "nan")
    assert "repeat only after" in says(1, PAPER, "--period-ms", "9.973,10.007,1")
    assert "no/x.png: the plot cannot be written" in says(1, PAPER, "-o", "no/x.png")
    assert "suffix" in says(2, PAPER, "-o", "x.foo")
    ratio = 3.78 * 3.7 / 3.7
    singular = says(1, PAPER, "--set", f"vehicle.gears.2.ratio={ratio}")
    assert "their torques cannot be told apart" in singular
    assert list(tmp_path.iterdir()) == []


def test_periods_are_read_to_the_microsecond() -> None:
    assert command._periods_us("2.5") == (2500, 2500, 2500)
    assert command._periods_us("10,5,20") == (10_000, 5_000, 20_000)
