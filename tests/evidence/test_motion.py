"""Brake, acceleration, grade and direction against the speeds: a right file, mistakes, and poor signals."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_documents
from dctorque_can.evidence.draft import Draft
from dctorque_can.evidence.measured import measure
from dctorque_can.evidence.moments import moments
from dctorque_can.evidence.motion import acceleration, grade
from dctorque_can.evidence.motion_verdicts import accelerations, brakes, brakes_untold, grades, told_direction
from dctorque_can.evidence.series import decoded
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.pipeline.samples import Quantity

KINDS = ("brake", "acceleration", "grade", "direction")
ALONE = {"inputs.acceleration": "null"}
STEPS = (brakes, brakes_untold, accelerations, grades, told_direction)


def told_of(signals, config):
    """Return the keys of what is told of the signals of a drive."""
    m = moments(signals)
    return [each.key for step in STEPS for each in step(m, Draft(config))]


@pytest.fixture(scope="module")
def telling(cars):
    config, frames = cars["telling"]
    return config, decoded([frames], config, any_value=True)


def with_signal(series, quantity, change):
    return replace(series, signals={**series.signals, quantity: change(series.signals[quantity])})


@pytest.mark.parametrize("car", ["avante", "telling"])
def test_each_mistake_is_named_and_put_right(cars, tools, car):
    """It is the one that is told, and nothing is left to be told of the corrected file."""
    config, frames = cars[car]
    named = 0
    for name, kind, laid in tools["check_mistakes"].mistakes(config):
        if kind in KINDS:
            found, draft = measure([frames], load_documents(config.documents, dict(laid)))
            assert [finding.key.split(".")[1] for finding in found] == [kind], name
            assert measure([frames], draft.config).findings == [], name
            named += 1
    assert named == {"avante": 2, "telling": 10}[car]


@pytest.mark.parametrize(("key", "factor"), [("acceleration", 0.5), ("acceleration", -0.5), ("grade", 3.0)])
def test_the_factor_that_corrects(cars, key, factor):
    config, frames = cars["telling"]
    wrong = load_documents(config.documents, {f"inputs.{key}.factor": str(factor)})
    (finding,) = measure([frames], wrong).findings
    assert finding.value == pytest.approx(1.0 / factor, rel=0.1)
    assert 0.0 < finding.sigma < 0.05 / abs(factor)
    assert ("sign is reversed" in finding.text) == (factor < 0.0)


def test_units_are_guessed(cars):
    """What is told in g and read as m/s² has to be multiplied with 9.81, not with what pitch makes of it."""
    config, frames = cars["telling"]
    wrong = load_documents(config.documents, {"inputs.acceleration.factor": "0.1019716"})
    found, draft = measure([frames], wrong)
    assert "g instead of m/s²?" in found[0].text
    assert draft.value("inputs.acceleration.factor") == pytest.approx(1.0, rel=1e-3)


def test_a_grade_by_engine_torque(cars):
    """Without an accelerometer; mass and torque then share its scale."""
    config, frames = cars["telling"]
    right = load_documents(config.documents, ALONE)
    assert Quantity.ACCELERATION not in decoded([frames], right).signals
    assert measure([frames], right).findings == []
    (finding,) = measure(
        [frames], load_documents(config.documents, ALONE | {"inputs.grade.factor": "-1"})
    ).findings
    assert finding.key == "inputs.grade"
    assert finding.value == pytest.approx(-1.0, abs=0.15)


def test_an_accelerometer_is_that_of_the_car(telling):
    """It has 4 % of pitch, by the simulation; a grade is late by half a second and has no such error."""
    _, series = telling
    m = moments(series)
    found = acceleration(m).slope
    assert found.number.value == pytest.approx(1.0 / 1.04, abs=0.05)
    assert found.correlation > 0.95
    assert grade(m).slope.number.value == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("case", ["late grade", "level grade", "coarse grade", "late acceleration", "late brake"])
def test_poor_signals_are_no_mistakes(telling, case):
    config, series = telling
    random = np.random.default_rng(5)
    quantity, change = {
        "late grade": (Quantity.GRADE, lambda s: s.sooner(-3.0)),
        "level grade": (Quantity.GRADE, lambda s: replace(s, value=random.normal(0.0, 1e-3, len(s)))),
        "coarse grade": (Quantity.GRADE, lambda s: replace(s, value=0.02 * np.round(50.0 * s.value))),
        "late acceleration": (Quantity.ACCELERATION, lambda s: s.sooner(-0.3)),
        "late brake": (Quantity.BRAKE, lambda s: s.sooner(-0.4)),
    }[case]
    assert told_of(with_signal(series, quantity, change), config) == []


def test_another_signal_than_that_along_the_car(telling):
    config, series = telling
    random = np.random.default_rng(6)
    strange = with_signal(
        series, Quantity.ACCELERATION, lambda s: replace(s, value=random.normal(0.0, 1.0, len(s)))
    )
    (finding,) = accelerations(moments(strange), Draft(config))
    assert "another signal" in finding.text
    assert finding.fix == ()
    assert told_of(strange, config) == ["inputs.acceleration"]  # the grade is then held against the engine's force


def test_a_brake_that_is_stuck_or_never_told(cars, telling):
    config, series = telling
    stuck = with_signal(series, Quantity.BRAKE, lambda s: replace(s, value=np.ones(len(s))))
    (finding,) = brakes(moments(stuck), Draft(config))
    assert "100%" in finding.text
    assert finding.fix == ()
    avante, _ = cars["avante"]
    stop = simulate_car(avante, DriveName.HARD_BRAKING, ProfileName.PRODUCTION, 1, None).frames
    assert measure([stop], avante).findings == []
    untold = load_documents(avante.documents, {"inputs.brake": "{signal: EngineData.BrakeActive, factor: 0}"})
    assert [finding.key for finding in measure([stop], untold).findings] == ["inputs.brake"]


def test_a_pressure_that_falls(cars):
    """Negative while the car is braked, so that none is ever told; or less than at rest, so that one always is."""
    config, frames = cars["invented"]
    key = "inputs.brake"
    for offset, text in ((0.0, "its sign is reversed"), (20.0, "on and off are exchanged")):
        laid = {f"{key}.factor": "-1", f"{key}.offset": str(offset)}
        found, draft = measure([frames], load_documents(config.documents, laid))
        assert [each.key for each in found] == [key]
        assert text in found[0].text
        assert (draft.value(f"{key}.factor"), draft.value(f"{key}.offset")) == (1.0, 0.0)


def test_a_direction_that_says_forward_in_reverse(cars):
    config, frames = cars["telling"]
    back = simulate_car(config, DriveName.REVERSE, ProfileName.PRODUCTION, 1, None).frames
    assert measure([frames, back], config).findings == []
    values = Draft(config).value("inputs.direction.values")
    other = {"backward": "forward", "unknown": "backward"}
    laid = {"inputs.direction.values": str({raw: other.get(way, way) for raw, way in values.items()})}
    (finding,) = measure([frames, back], load_documents(config.documents, laid)).findings
    assert finding.key == "inputs.direction"
    assert "in reverse" in finding.text
    silent = {raw: {"forward": "unknown", "unknown": "forward"}.get(way, way) for raw, way in values.items()}
    laid = {"inputs.direction.values": str(silent)}
    (finding,) = measure([frames, back], load_documents(config.documents, laid)).findings
    assert "look at values" in finding.text
