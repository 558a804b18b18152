"""Directions, products, and one speed for both shafts: what the sections of a vehicle file become."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from dctorque_can.config.load import Config
from dctorque_can.pipeline.samples import Input, Quantity, Signs
from dctorque_can.resources import shipped_dbc

Load = Callable[..., Config]


def one(config: Config, quantity: Quantity) -> Input:
    (found,) = [each for each in config.inputs if each.quantity is quantity]
    return found


def more(*extra: dict[str, Any]) -> dict[str, Any]:
    """Return changes that add demo_car_more.dbc, and ``extra`` ones."""
    changes: dict[str, Any] = {"databases.1": str(shipped_dbc("demo_car_more"))}
    for each in extra:
        changes |= each
    return changes


def test_a_direction_of_the_car_and_of_its_wheels(load: Load) -> None:
    values = {"forward": "forward", 2: "backward", 0: "standstill", 3: "unknown"}
    one_signal = {"signal": "WheelDirections.VehicleDirection", "values": values, "delay_ms": 40}
    config = load(more({"inputs.direction": one_signal, "inputs.wheel_speeds.fl.signed": False}))
    direction = one(config, Quantity.DIRECTION)
    assert direction.terms[0].values == {1: 1.0, 2: -1.0, 0: 0.0, 3: 0.0}
    assert (direction.minimum, direction.maximum, direction.delay_us) == (-1.0, 1.0, 40_000)
    assert config.settings.direction_measured is False
    wheels = [f"WheelDirections.WheelDirection{wheel}" for wheel in ("FL", "FR", "RL")]
    config = load(more({"inputs.direction": {"signals": wheels, "values": values, "measured": True}}))
    raw = {"WheelDirectionFL": 1, "WheelDirectionFR": 1, "WheelDirectionRL": 2}
    total = sum(t.factor * t.values[raw[t.signal]] for t in one(config, Quantity.DIRECTION).terms)
    assert total == pytest.approx(1 / 3)
    assert config.settings.direction_measured is True


def test_a_direction_has_no_effect_on_speeds_with_a_sign(load: Load) -> None:
    values = {1: "forward", 2: "backward"}
    signed = {f"inputs.wheel_speeds.{wheel}.signed": True for wheel in ("fl", "fr", "rl", "rr")}
    signed |= {f"inputs.shaft{i}_speed.signed": True for i in (1, 2)}
    direction = {"inputs.direction": {"signal": "WheelDirections.VehicleDirection", "values": values}}
    told = [w for w in load(more(signed, direction)).warnings if w.key == "inputs.direction"]
    assert ["no effect" in warning.reason for warning in told] == [True]
    assert not [w for w in load(more(direction)).warnings if w.key == "inputs.direction"]


@pytest.mark.parametrize(
    ("direction", "key", "reason"),
    [
        ({"values": {1: "forward", 2: "backward"}}, "signal", "missing: give signal"),
        (
            {"signal": "WheelDirections.VehicleDirection", "values": {1: "forward"}},
            "values",
            "no raw value means backward",
        ),
        (
            {"signal": "WheelDirections.VehicleDirection", "values": {1: "forwards", 2: "backward"}},
            "values.1",
            "must be one of: forward, backward, standstill or unknown",
        ),
        (
            {"signal": "WheelDirections.VehicleDirection", "values": {"ahead": "forward", 2: "backward"}},
            "values.ahead",
            "'ahead' is not in the value table",
        ),
        (
            {"signals": ["WheelDirections.WheelDirectionXX"], "values": {1: "forward", 2: "backward"}},
            "signals.0",
            "is not a signal of WheelDirections",
        ),
        (
            {"signal": "A.B", "signals": ["A.B"], "values": {1: "forward", 2: "backward"}},
            "signals",
            "give either signal or signals",
        ),
    ],
)
def test_a_direction_that_is_wrong(errors, direction: dict[str, Any], key: str, reason: str) -> None:
    (problem,) = errors(more({"inputs.direction": direction}))
    assert problem.key == f"inputs.direction.{key}"
    assert reason in problem.reason


SHARE = {
    "sum": ["EngineShare.IndicatedTorque", {"signal": "EngineShare.FrictionTorque", "factor": -1}],
    "not_available": [4095],
}
REFERENCE = {"signal": "EngineReference.ReferenceTorque", "not_available": ["not available"]}


def test_a_share_times_its_reference_torque(load: Load) -> None:
    """(60 % − 12 %) · 400 N·m; the range is in N·m, as the reference is."""
    torque = SHARE | {"times": REFERENCE, "range": [-200, 500]}
    config = load(more({"inputs.engine_torque": torque}))
    given = one(config, Quantity.ENGINE_TORQUE)
    shares = (60.0, 12.0)
    share = sum(t.factor * s + t.offset for t, s in zip(given.terms, shares, strict=True))
    assert share == pytest.approx(0.48)
    assert given.multiplier is not None
    assert share * 400.0 * given.multiplier.term.factor == pytest.approx(192.0)
    assert (given.multiplier.timeout_us, given.multiplier.divides) == (5_000_000, False)
    assert given.multiplier.term.not_available == {65535}
    assert (given.minimum, given.maximum) == (-200.0, 500.0)
    assert [w for w in config.warnings if w.key.startswith("inputs.engine_torque")] == []


def test_a_torque_times_a_share_and_a_speed_divided_by_one(load: Load) -> None:
    changes = {
        "inputs.engine_torque.times": {"signal": "EngineShare.IndicatedTorque", "not_available": [4095]},
        "inputs.shaft1_speed.divided_by": {"signal": "EngineData.BrakeActive", "unit": "1", "timeout_ms": 50},
    }
    config = load(more(changes))
    torque, speed = one(config, Quantity.ENGINE_TORQUE).multiplier, one(config, Quantity.SHAFT1_SPEED).multiplier
    assert torque is not None
    assert speed is not None
    assert (torque.term.factor, torque.divides) == (0.01, False)
    assert (speed.term.factor, speed.divides, speed.timeout_us) == (1.0, True, 50_000)
    assert one(config, Quantity.ENGINE_TORQUE).terms[0].factor == 1.0


def test_a_reference_that_comes_more_seldom_than_it_counts_is_told(load: Load) -> None:
    config = load(more({"inputs.engine_torque": SHARE | {"times": REFERENCE | {"timeout_ms": 1500}}}))
    told = [w for w in config.warnings if w.key == "inputs.engine_torque.times.timeout_ms"]
    assert [w.reason for w in told] == [
        "is less than two periods of 1000 ms: one lost frame makes the input stale"
    ]


@pytest.mark.parametrize(
    ("torque", "key", "reason"),
    [
        (SHARE | {"times": REFERENCE, "reference_nm": 400}, "reference_nm", "leave reference_nm or times out"),
        (SHARE | {"times": REFERENCE, "divided_by": REFERENCE}, "divided_by", "give either times or divided_by"),
        (
            {"signal": "EngineData.EngineTorque", "not_available": [4095], "times": REFERENCE},
            "unit",
            "the unit 'Nm' does not fit here: one of both must be a share",
        ),
        (
            {"signal": "EngineData.EngineTorque", "not_available": [4095], "divided_by": REFERENCE},
            "divided_by.unit",
            "the unit 'Nm' does not fit here: one of both must be a share",
        ),
        (
            {
                "signal": "EngineShare.IndicatedTorque",
                "not_available": [4095],
                "times": {"signal": "EngineData.EngineSpeed", "not_available": [65535]},
            },
            "times.unit",
            "the unit 'rpm' does not fit here: use N·m",
        ),
        (
            SHARE | {"times": {"signal": "EngineReference.ReferenceTorqu", "unit": "Nm"}},
            "times.signal",
            "is not a signal of EngineReference; did you mean ReferenceTorque?",
        ),
    ],
)
def test_a_product_that_is_wrong(errors, torque: dict[str, Any], key: str, reason: str) -> None:
    (problem,) = errors(more({"inputs.engine_torque": torque}))
    assert problem.key == f"inputs.engine_torque.{key}"
    assert reason in (problem.reason + str(problem))


def test_one_speed_for_both_shafts(load: Load, errors, removed: object) -> None:
    """Its resolution, a quarter of a revolution per minute, is that of both."""
    speed = {"signal": "DrivingShaft.InputShaftSpeed", "not_available": [65535]}
    without = {f"inputs.shaft{i}_speed": removed for i in (1, 2)} | {"protection.InputShafts": removed}
    config = load(more({"inputs.driving_shaft_speed": speed}, without))
    assert config.warnings == ()
    assert one(config, Quantity.DRIVING_SHAFT_SPEED).signs is Signs.UNSIGNED
    assert config.settings.kalman.speed_resolutions_rad_s[1:3] == pytest.approx([math.pi / 120] * 2)
    both = errors(more({"inputs.driving_shaft_speed": speed}))
    assert {problem.key for problem in both} == {"inputs.shaft1_speed", "inputs.shaft2_speed"}
    assert all("give either" in problem.reason for problem in both)
    oh2014 = errors(more({"inputs.driving_shaft_speed": speed}, without, {"estimator.method": "oh2014"}))
    assert all("needs the speeds of both input shafts" in problem.reason for problem in oh2014)
