"""What a study says of both methods and the bound: against other ways to the same numbers."""

from pathlib import Path

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.offline.comparison import compare_bound, compare_variants, variants_of
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.resources import shipped_config
from dctorque_can.study.coverage import spreads
from dctorque_can.study.draw import noise_seed
from dctorque_can.study.plan import load_study
from dctorque_can.study.run import Bench, Setup

LENGTH_S = 8  # the first shift is within


@pytest.fixture
def bench(write_study) -> Bench:
    return Bench(Setup.of(load_study(write_study(duration_s=LENGTH_S))))


def test_the_nominal_run_is_a_comparison_of_the_same_drive(bench: Bench) -> None:
    found = bench.run(0, {})["estimators"]
    assert list(found) == ["oh2014", "kalman", "bound"]
    car = shipped_config("paper_car")
    drive = simulate_car(load_config(car), DriveName.PAPER, ProfileName.PRODUCTION, noise_seed(7, 0), LENGTH_S)
    results = [
        *compare_variants(variants_of(lambda more: load_config(car, more), {}), [drive]),
        compare_bound(load_config(car), [drive]),
    ]
    for name, result in zip(found, results, strict=True):
        for part, figures in (("all", result.comparison.everything), ("shifts", result.comparison.shifts)):
            assert figures is not None
            for torque, one in figures.torques.items():
                assert found[name][part][torque]["rms"] == pytest.approx(one.rms_nm, rel=1e-9)
                if one.bands is None:
                    assert found[name][part][torque].keys() == {"rms"}
                else:
                    assert found[name][part][torque]["coverage"] == pytest.approx(list(one.bands.coverage))
        sensors = {sensor: nis.mean for sensor, nis in result.sensors.items()}
        assert {sensor: one["nis"] for sensor, one in found[name]["sensors"].items()} == pytest.approx(sensors)


def test_the_bound_knows_the_drawn_car(write_study) -> None:
    """A car with a factor, and the same car in the file: both methods differ, the bound does not."""
    study = write_study(duration_s=LENGTH_S)
    drawn = Bench(Setup.of(load_study(study))).run(1, {"engine_inertia_factor": 1.1, "payload_kg": 300.0})
    same = {"vehicle.engine_inertia_kgm2": "0.22", "vehicle.chassis.mass_kg": "1900"}
    told = Bench(Setup.of(load_study(study, same))).run(1, {})

    def rms(record, name):
        return [one["rms"] for one in record["estimators"][name]["all"].values()]

    assert rms(drawn, "bound") == pytest.approx(rms(told, "bound"), rel=1e-6)
    assert rms(drawn, "kalman") != pytest.approx(rms(told, "kalman"), rel=1e-3)


def run(rms: float, shares: tuple[float, ...] | None, samples: int, nis: float = 1.0, shifts: bool = True) -> dict:
    """Return one estimator of a record, all its torques alike."""
    bands = {} if shares is None else {"samples": samples, "coverage": list(shares), "wrong_ms": 4.0 * samples}
    torques = dict.fromkeys(("clutch1_nm", "clutch2_nm", "output_nm"), {"rms": rms} | bands)
    sensors = {} if shares is None else {"engine": {"samples": samples, "rejected": samples // 3, "nis": nis}}
    return {"all": torques, "shifts": torques if shifts else None, "sensors": sensors}


def test_spreads_of_three_cars() -> None:
    records = [
        {
            "estimators": {
                "oh2014": run(8.0, None, 0),
                "kalman": run(rms, shares, samples, nis, shifts=n < 2),
                "bound": run(bound, (0.5, 0.9, 0.95), 100, shifts=n < 2),
            }
        }
        for n, (rms, bound, shares, samples, nis) in enumerate(
            [
                (2.0, 1.0, (0.4, 0.8, 0.90), 100, 0.5),
                (6.0, 2.0, (0.6, 1.0, 1.00), 300, 2.0),
                (3.0, 2.0, (0.5, 0.9, 0.85), 100, 1.0),
            ]
        )
    ]
    found = spreads(records)
    assert list(found) == ["oh2014", "kalman", "bound"]
    whole = found["kalman"].parts["all"]["clutch1_nm"]
    assert (whole.runs, whole.median, whole.worst, whole.over_bound) == (3, 3.0, 6.0, 2.0)
    assert whole.p90 == pytest.approx(3.0 + 0.8 * 3.0)
    assert whole.coverage is not None
    assert whole.coverage.pooled == pytest.approx((270 / 500, 470 / 500, 475 / 500))
    assert whole.coverage.least == (0.4, 0.8, 0.85)
    assert whole.coverage.honest == pytest.approx(2 / 3)
    assert (whole.coverage.wrong_ms, whole.coverage.wrong_worst_ms) == (2000.0, 1200.0)
    shifts = found["kalman"].parts["shifts"]["output_nm"]
    assert (shifts.runs, shifts.median, shifts.over_bound) == (2, 4.0, 2.5)
    assert found["oh2014"].parts["all"]["clutch1_nm"].coverage is None
    engine = found["kalman"].sensors["engine"]
    assert engine.mean == pytest.approx((50 + 600 + 100) / 500)
    assert (engine.p10, engine.p90) == pytest.approx((0.6, 1.8))
    assert engine.rejected == pytest.approx((33 + 100 + 33) / 666)
    json = found["kalman"].as_json()
    assert json["all"]["clutch2_nm"]["coverage"]["95%"] == pytest.approx(0.95)
    assert json["all"]["clutch2_nm"]["confidently_wrong_worst_ms"] == 1200.0
    assert json["sensors"]["engine"]["nis_p90"] == pytest.approx(1.8)
    assert spreads([]) == {}


def test_a_part_that_no_car_has() -> None:
    record = {
        "estimators": {name: run(1.0, (0.5, 0.9, 0.95), 9, shifts=False) for name in ("oh2014", "kalman", "bound")}
    }
    found = spreads([record])["bound"]
    assert list(found.parts) == ["all"]
    assert found.as_json()["shifts"] is None


def test_drives_that_are_kept_give_the_same(write_study, tmp_path: Path, monkeypatch) -> None:
    study = load_study(write_study())
    values = {"engine_torque_offset_nm": 7.0}
    folder = tmp_path / "kept" / "here"
    plain = Bench(Setup.of(study)).run(1, values)
    assert Bench(Setup.of(study, folder)).run(1, values) == plain
    (path,) = folder.iterdir()
    other = load_study(write_study(), {"estimator.oh2014.torque_crossover_rad_s": "90"})
    with monkeypatch.context() as patch:
        patch.setattr("dctorque_can.study.run.simulate", lambda *_: pytest.fail("it was simulated again"))
        assert Bench(Setup.of(study, folder)).run(1, values) == plain
        again = Bench(Setup.of(other, folder)).run(1, values)["estimators"]  # the same car for another estimator
        assert again["kalman"] == plain["estimators"]["kalman"]
        assert again["oh2014"] != plain["estimators"]["oh2014"]
    path.write_bytes(path.read_bytes()[:1000])
    assert Bench(Setup.of(study, folder)).run(1, values) == plain
    Bench(Setup.of(study, folder)).run(2, values)  # has noise of its own
    Bench(Setup.of(study, folder)).run(1, {"engine_torque_offset_nm": 8.0})
    Bench(Setup.of(load_study(write_study(), {"vehicle.chassis.mass_kg": "1601"}), folder)).run(1, values)
    assert len(list(folder.iterdir())) == 4


def test_a_folder_for_drives_that_cannot_be(write_study, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("precious")
    record = Bench(Setup.of(load_study(write_study()), file)).run(1, {})
    assert "cannot be written" in record["error"]
    assert file.read_text() == "precious"
