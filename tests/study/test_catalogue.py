"""A catalogue study: its file, one of its runs against figures made another way, and what all runs say."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from dctorque_can.analysis.honesty import honesty
from dctorque_can.chain import Chain
from dctorque_can.config.problems import ConfigError
from dctorque_can.offline.simulated_car import DriveName, ProfileName, drive_of, sensors_of
from dctorque_can.pipeline.estimates import Status
from dctorque_can.report.catalogue_table import CATALOGUE_WIDTH, catalogue_tables
from dctorque_can.resources import find_study
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.sensors import emit_frames
from dctorque_can.study.catalogue import load_catalogue
from dctorque_can.study.catalogue_run import CatalogueSetup
from dctorque_can.study.catalogue_smoothed import smoothing
from dctorque_can.study.catalogue_summary import summarise_catalogue
from dctorque_can.study.draw import noise_seed
from dctorque_can.study.factors import Car, varied

SMALL: dict[str, Any] = {
    "vehicles": ["paper_car"],
    "drives": ["creep", "wheel_spin", "reverse"],
    "signals": {
        "signed": {"set": {"databases.0.file": "../dbc/demo_car_signed.dbc"}},
        "magnitudes": {"unsigned": "all"},
    },
    "runs": 2,
    "vary": {"tyre_friction_factor": {"uniform": {"low": 0.8, "high": 1.25}}},
}


@pytest.fixture
def write_catalogue(tmp_path: Path) -> Callable[..., Path]:
    """Write the small catalogue with other or further keys."""

    def write(**changes: Any) -> Path:
        path = tmp_path / "small.yaml"
        path.write_text(yaml.safe_dump(SMALL | changes, sort_keys=False))
        return path

    return write


def test_the_shipped_catalogue_has_every_drive_of_both_cars() -> None:
    catalogue = load_catalogue(find_study("manoeuvres"))
    cases, values = catalogue.cases(), catalogue.values()
    assert cases.keys() == values.keys()
    for vehicle, missing in (("paper_car", {"reverse"}), ("avante_dct7", set())):
        own = [case for case in cases.values() if case.vehicle == vehicle]
        assert {case.drive for case in own} == set(DriveName) - missing
        assert len(own) == len(set(own)) == (len(DriveName) - len(missing)) * 3 * 2
    drawn: dict[tuple[str, int], Any] = {}
    for number, case in cases.items():  # the same car whatever its signals
        assert drawn.setdefault((case.drive, case.draw), values[number]) == values[number]
    assert len({str(one) for one in drawn.values()}) == len(DriveName) * 3


def test_every_mistake_of_a_catalogue_is_told_at_once(write_catalogue) -> None:
    path = write_catalogue(
        vehicles=["papercar"],
        drives=["creep", "rally"],
        runs=0,
        signals={"x": {"unsigned": "some"}},
        drive="paper",
    )
    with pytest.raises(ConfigError) as caught:
        load_catalogue(path)
    text = str(caught.value)
    for part in (
        "unknown drive; there is: paper, mixed, creep",
        "runs = 0",
        "none, wheels, shafts or all",
        "drive",
    ):
        assert part in text
    with pytest.raises(ConfigError, match="did you mean paper_car"):
        load_catalogue(write_catalogue(vehicles=["papercar"]))
    with pytest.raises(ConfigError, match="--drive"):
        load_catalogue(write_catalogue(), changes={"drive": "paper"})


def test_one_row_by_hand(write_catalogue) -> None:
    """Of spinning wheels of a drawn car: the same figures from its frames, rows and truth."""
    catalogue = load_catalogue(write_catalogue(seed=3))
    bench = CatalogueSetup.of(catalogue).bench()
    (number,) = (
        n for n, c in catalogue.cases().items() if (c.drive, c.signals, c.draw) == ("wheel_spin", "signed", 1)
    )
    values = catalogue.values()[number]
    record = bench.run(number, values)
    assert record["case"]["drive"] == "wheel_spin"

    config = catalogue.configs["paper_car", "signed"]
    sensors = sensors_of(config, ProfileName.PRODUCTION, noise_seed(3, 3))
    drive = drive_of(config, DriveName.WHEEL_SPIN, 0, None)
    factor = values["tyre_friction_factor"]
    drive = replace(drive, friction=tuple((t, factor * friction) for t, friction in drive.friction))
    truth = simulate(config.settings.vehicle, drive)
    rows = Chain(config).feed(emit_frames(truth, config.settings.vehicle, sensors, config.database)).rows
    rows = rows[rows["t_us"] <= truth["t_us"][-1]]
    for name, bit in (("clutch1", Status.CLUTCH1_VALID), ("output", Status.OUTPUT_VALID)):
        found = record["torques"][f"{name}_nm"]
        valid = rows[(rows["status"] & bit) != 0]
        error = valid[f"{name}_torque_nm"] - np.interp(valid["t_us"], truth["t_us"], truth[f"{name}_torque_nm"])
        sigma = valid[f"{name}_sigma_nm"]
        assert found["rows"] == len(valid)
        assert found["valid"] == pytest.approx(len(valid) / len(rows))
        assert found["rms_nm"] == pytest.approx(np.sqrt(np.mean(error**2)))
        assert found["held"] == pytest.approx(np.mean(np.abs(error) < 1.96 * sigma))
        far = np.flatnonzero((np.abs(error) > 5 * sigma) & (np.abs(error) > (100 if name == "output" else 10)))
        assert found["wrong_ms"] == pytest.approx(2.5 * len(far), rel=0.2, abs=5.0)  # 400 frames/s
        assert (found["episode"] is None) == (len(far) == 0)


def test_factors_of_the_catalogue_act(write_catalogue) -> None:
    catalogue = load_catalogue(write_catalogue())
    config = catalogue.configs["paper_car", "signed"]
    drive = drive_of(config, DriveName.SPLIT_MU, 0, None)
    sensors = sensors_of(config, ProfileName.PRODUCTION, 0)
    car = varied(
        Car(config.settings.vehicle, None, sensors, drive),  # type: ignore[arg-type]
        {"tyre_friction_factor": 0.5, "clutch_drag_nms_per_rad": 0.02},
    )
    assert car.drive.friction[0][1] == pytest.approx(0.05)
    assert car.drive.friction_right[0][1] == pytest.approx(0.45)
    assert [clutch.drag_nms_per_rad for clutch in car.vehicle.clutches] == pytest.approx([0.025, 0.025])


def torque(rows: int, held: float | None, wrong_ms: float = 0.0, rms: float | None = 1.0) -> dict[str, Any]:
    """Return figures of a torque of 200 rows."""
    episode = {"start_s": 3.0, "wrong_ms": wrong_ms, "error_nm": -40.0, "sigma_nm": 2.0} if wrong_ms else None
    return {
        "rows": rows,
        "valid": rows / 200,
        "rms_nm": rms,
        "held": held,
        "wrong_ms": wrong_ms,
        "episode": episode,
    }


def test_what_all_runs_say(write_catalogue) -> None:
    """Worst, pooled and mean figures of two draws by hand; what asks for too much trust is named."""
    catalogue = load_catalogue(write_catalogue(drives=["creep"]))
    records = {}
    for number, case in catalogue.cases().items():
        good = torque(100, 1.0)
        bad = torque(50, 0.4, 60.0, 4.0) if case.draw else torque(150, 0.8, 8.0, 2.0)
        never = torque(0, None, 0.0, None)
        torques = {"clutch1_nm": good, "clutch2_nm": bad if case.signals == "signed" else good, "output_nm": never}
        records[number] = {"run": number, "factors": {}, "case": {"draw": case.draw}, "torques": torques}
    summary = summarise_catalogue(catalogue, records)
    assert [(row.drive, row.signals, row.draws) for row in summary.rows] == [
        ("creep", "signed", 2),
        ("creep", "magnitudes", 2),
    ]
    figures = summary.rows[0].torques["clutch2_nm"]
    assert (figures.wrong_ms, figures.held_least) == (60.0, 0.4)
    assert figures.held == pytest.approx((0.8 * 150 + 0.4 * 50) / 200)
    assert figures.rms_nm == pytest.approx(np.sqrt((4 * 150 + 16 * 50) / 200))
    assert figures.valid == pytest.approx(0.5)
    assert figures.episode is not None
    assert figures.episode["draw"] == 1
    assert summary.rows[0].torques["output_nm"].rms_nm is None
    assert [(row.signals, name) for row, name in summary.beyond()] == [("signed", "clutch2_nm")]
    assert summary.pooled["clutch2_nm"] == pytest.approx((140 + 200) / 400)
    assert summary.pooled["output_nm"] is None

    console = Console(width=CATALOGUE_WIDTH, record=True, file=None, quiet=False)
    with console.capture() as shown:
        console.print(catalogue_tables(summary))
    assert "0 / 60 / 0" in shown.get()
    assert (
        "paper_car, creep, signed, clutch 2: 60 ms, band 40.0 %; draw 1 at 3.00 s: -40 N·m, σ 2.0" in shown.get()
    )
    assert summary.as_json()["beyond"] == [
        {"vehicle": "paper_car", "drive": "creep", "signals": "signed", "torque": "clutch2_nm"}
    ]


def smoothed_run(online: dict[str, Any], smoothed: dict[str, Any], drive: str = "creep") -> dict[str, Any]:
    """Return a record of one run with the same figures for each torque."""
    names = ("clutch1_nm", "clutch2_nm", "output_nm")
    return {
        "case": {"vehicle": "paper_car", "drive": drive, "signals": "signed", "draw": 0},
        "torques": dict.fromkeys(names, online),
        "smoothed": dict.fromkeys(names, smoothed),
    }


def test_figures_of_smoothing_by_hand() -> None:
    """2 N·m become 1 over 150 rows, 4 become 5 over 50; an open clutch and one never valid have no share."""
    records = [
        smoothed_run(torque(150, 0.9, 8.0, 2.0), torque(150, 0.96, 0.0, 1.0)),
        smoothed_run(torque(50, 0.8, 40.0, 4.0), torque(50, 0.92, 20.0, 5.0), "judder"),
        smoothed_run(torque(200, 1.0, 0.0, 0.1), torque(200, 1.0, 0.0, 0.3)),
        smoothed_run(torque(0, None, 0.0, None), torque(0, None, 0.0, None)),
    ]
    found = smoothing(records)["clutch2_nm"]
    online = 150 * 2.0**2 + 50 * 4.0**2 + 200 * 0.1**2
    assert found.share == pytest.approx(np.sqrt((150 * 1.0 + 50 * 25.0 + 200 * 0.09) / online))
    assert (found.drives, found.worse, found.worst) == (2, 1, 1.25)
    assert found.worst_case["drive"] == "judder"
    assert found.held == pytest.approx((150 * 0.96 + 50 * 0.92 + 200) / 400)
    assert (found.held_least, found.wrong_ms, found.wrong_online_ms) == (0.92, 20.0, 48.0)
    never = smoothing(records[3:])["clutch2_nm"]
    assert (never.share, never.worst, never.held, never.drives) == (None, None, None, 0)


def test_a_run_is_smoothed_when_that_is_asked_for(write_catalogue) -> None:
    """Its frames, smoothed here once more, give the same figures; online they are as without smoothing."""
    signals = {"signed": {"set": {"databases.0.file": "../dbc/demo_car_signed.dbc"}}}
    path = write_catalogue(drives=["creep"], runs=1, signals=signals)
    catalogue = load_catalogue(path, changes={"smooth": True})
    bench = CatalogueSetup.of(catalogue).bench()
    ((number, case),) = catalogue.cases().items()
    values = catalogue.values()[number]
    record = bench.run(number, values)

    plain = CatalogueSetup.of(load_catalogue(path)).bench().run(number, values)
    assert "smoothed" not in plain
    assert record["torques"] == plain["torques"]
    config = catalogue.configs["paper_car", "signed"]
    frames, truth = bench._driven(case, config, values)
    chain = Chain(config, smooth=True)
    chain.feed(frames)
    for name, one in honesty(chain.smoothed(), truth).items():
        assert record["smoothed"][name]["rms_nm"] == pytest.approx(one.rms_nm)
        assert record["smoothed"][name]["held"] == pytest.approx(one.held)

    summary = summarise_catalogue(catalogue, {number: record})
    console = Console(width=CATALOGUE_WIDTH)
    with console.capture() as shown:
        console.print(catalogue_tables(summary))
    assert f"{summary.smoothing['clutch1_nm'].share:.2f}" in shown.get()
    assert "RMS error over that online" in shown.get()
    assert summary.as_json()["smoothing"]["output_nm"]["drives"] == 1
