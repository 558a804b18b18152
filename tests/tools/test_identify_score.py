"""What an owner knows of an invented car, and how a score is told."""

import importlib.util
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

from dctorque_can.config.load import load_documents
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.results import Result
from dctorque_can.study.invented_car import invent_car

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "identify-score"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    loader = SourceFileLoader("identify_score", str(SCRIPT))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return module


def test_an_owner_knows_no_delay_and_the_class(tool: ModuleType) -> None:
    car = invent_car(3)
    truth = load_documents(car.documents)
    known = tool.owners_file(car, truth, 3, 0.0)
    assert "delay_ms" not in str(known)
    assert known["vehicle"]["class"] == car.class_name
    assert known["vehicle"]["chassis"] == {"wheel_radius_m": truth.settings.vehicle.chassis.wheel_radius_m}
    points = [known["clutch_phase"][f"clutch{n}"]["kissing_point"] for n in (1, 2)]
    assert points == pytest.approx([each.threshold for each in truth.settings.phases.clutches])
    worn = tool.owners_file(invent_car(3), truth, 3, 0.1)
    assert worn["clutch_phase"]["clutch1"]["kissing_point"] != pytest.approx(points[0], abs=0.01)


def test_a_score_is_told(tool: ModuleType) -> None:
    off = {"vehicle.chassis.mass_kg": (0.5, "1240 ± 20 kg, true 1230"), "b": (-2.5, "1 ± 0.4 , true 2")}
    score = tool.Score(3, "some_class", (4.0, 4.0, 40.0), (2.2, 2.0, 20.0), (2.0, 2.0, 16.0), 0.008, off, 31.0)
    assert score.row() == (
        "| 3 | `some_class` | 4.0 / 4.0 / 40.0 | 2.2 / 2.0 / 20.0 | 2.0 / 2.0 / 16.0 | 1.10 / 1.00 / 1.25 | +0.8% "
        "| 1 of 2 | 31 |"
    )
    assert list(score.lines()) == ["    car 3: b: 1 ± 0.4 , true 2 (-2.5 σ)"]


@pytest.mark.parametrize(
    "key",
    [
        "vehicle.chassis.mass_kg",
        "inputs.engine_speed.delay_ms",
        "estimator.kalman.engine_torque_lag_ms",
        "clutch_phase.clutch2.kissing_point",
    ],
)
def test_errors_are_told_in_standard_deviations(tool: ModuleType, key: str) -> None:
    truth = load_documents(invent_car(3).documents)
    true = tool.true_value(truth, key)
    result = Result(key, "", "", Belief(0.0, 1.0), Belief(true - 1.0, 0.5), refused=False)
    assert tool.off(result, truth)[0] == pytest.approx(-2.0)
