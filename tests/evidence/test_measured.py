"""A right file and wrong ones against simulated drives: each mistake is told where it is, with the right value."""

import math

import numpy as np
import pytest

from dctorque_can.config.load import load_documents
from dctorque_can.evidence.clutches import kissing_point
from dctorque_can.evidence.delays import delays
from dctorque_can.evidence.draft import Draft
from dctorque_can.evidence.measured import measure
from dctorque_can.evidence.moments import moments
from dctorque_can.evidence.series import decoded
from dctorque_can.evidence.torques import factors, idle_torque, overrun_torque
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.simulation.sensors import PRODUCTION
from dctorque_can.study.invented_car import invent_car

OF_THE_FRAME = ("data id", "checksum", "counter modulus", "timeout too short")
"""Told by what the estimator counts (test_findings.py)."""
BY_THE_MONITOR = ("kissing point of 1: sooner", "kissing point of 1 and 2: sooner")
"""Told by the monitor too; measured only where launches show it."""


@pytest.mark.parametrize("car", ["avante", "invented", "telling"])
def test_nothing_on_a_right_file(cars, car):
    config, frames = cars[car]
    assert measure([frames], config).findings == []


@pytest.mark.parametrize("car", ["avante", "invented"])
def test_each_mistake_is_named(cars, tools, car):
    """The first that is told has a key of the mistake, and the corrected file contradicts nothing any more."""
    config, frames = cars[car]
    missed, named = [], 0
    for name, kind, laid in tools["check_mistakes"].mistakes(config):
        if name in OF_THE_FRAME or name in BY_THE_MONITOR:
            continue
        found, _ = measure([frames], load_documents(config.documents, dict(laid)))
        told = tools["check_mistakes"].is_named(kind, [finding.key for finding in found])
        named += told
        missed += [] if told else [(name, [(finding.key, finding.text) for finding in found])]
    assert missed == []
    assert named >= 30


def test_the_right_values(cars):
    """What is to be set is what the right file has."""
    config, frames = cars["avante"]
    vehicle = config.settings.vehicle
    wrong = {
        "vehicle.gears.3.ratio": (str(0.96 * vehicle.gear(3).ratio), vehicle.gear(3).ratio, 0.01),
        "vehicle.chassis.mass_kg": (str(8 * vehicle.chassis.mass_kg), vehicle.chassis.mass_kg, 0.25),
        "vehicle.chassis.wheel_radius_m": (
            str(1.06 * vehicle.chassis.wheel_radius_m),
            vehicle.chassis.wheel_radius_m,
            0.02,
        ),
        "inputs.engine_speed.delay_ms": ("25", 0.7, math.inf),
    }
    for key, (value, right, share) in wrong.items():
        (finding,) = measure([frames], load_documents(config.documents, {key: value})).findings
        assert finding.key == key
        assert abs(finding.value - right) < min(share * right, 4.0 * finding.sigma + 1e-9), finding.text
        assert finding.text.startswith(
            ("gears.3: the log has", "mass: ", "the wheel speeds are", "engine_speed: ")
        )


def test_a_radius_is_told_that_is_hardly_off(cars):
    """A third of a percent, far less than any tyre wears; the torques are wrong by tens of N·m with it."""
    config, frames = cars["invented"]
    right = config.settings.vehicle.chassis.wheel_radius_m
    wrong = load_documents(config.documents, {"vehicle.chassis.wheel_radius_m": str(1.003 * right)})
    told = {each.key: each for each in measure([frames], wrong).findings}
    found = told["vehicle.chassis.wheel_radius_m"]
    assert found.severity == "warning"
    assert found.value == pytest.approx(right, rel=5e-4)


def test_several_mistakes_at_once(cars):
    config, frames = cars["avante"]
    wrong = {
        "inputs.engine_torque.factor": "-1",
        "vehicle.driven_axle": "rear",
        "vehicle.gears.2.ratio": "2.7",
        "clutch_phase.clutch2.closes": "decreasing",
    }
    found, draft = measure([frames], load_documents(config.documents, wrong))
    keys = ["vehicle.driven_axle", "vehicle.gears.2.ratio", "clutch_phase.clutch2.closes", "inputs.engine_torque"]
    assert [finding.key for finding in found] == keys
    assert found[-1].text.startswith("engine_torque: sign is reversed (correlation with J·ω̇ -0.")
    assert measure([frames], draft.config).findings == []


def test_friction_that_is_not_taken_off(cars):
    """Net torque and the engine's drag, 12 N·m and 0.05 N·m·s/rad, are what burns."""
    config, frames = cars["avante"]
    rpm = 0.05 * math.pi / 30
    torque = "{signal: EngineData.EngineTorque, offset: 12}"
    drag = f"{{signal: EngineData.EngineSpeed, unit: Nm, factor: {rpm}}}"
    wrong = load_documents(config.documents, {"inputs.engine_torque": f"{{sum: [{torque}, {drag}]}}"})
    (finding,) = measure([frames], wrong).findings
    assert finding.key == "inputs.engine_torque"
    assert "friction is not taken off" in finding.text


def test_delays_are_those_of_the_bus(cars):
    """Each message is late by its delay and, on average, half its jitter."""
    config, frames = cars["avante"]
    late_ms = {
        name: 1e-3 * (timing.delay_us + 0.5 * timing.jitter_us) for name, timing in PRODUCTION.timing.items()
    }
    found = {each.quantities[0]: each for each in delays(moments(decoded([frames], config)))}
    engine = found[Quantity.ENGINE_SPEED].late_s.value
    for quantity, message in (
        (Quantity.SHAFT1_SPEED, "InputShafts"),
        (Quantity.SHAFT2_SPEED, "InputShafts"),
        (Quantity.WHEEL_SPEED_FL, "WheelSpeedsFront"),
    ):
        late = found[quantity]
        difference = 1e3 * (late.late_s.value - engine) - (late_ms[message] - late_ms["EngineData"])
        assert abs(difference) < 3e3 * math.hypot(late.late_s.sigma, late.model_s), quantity


def test_pictures_show_delays_and_signs(cars):
    """The points lie on the line of the log: a speed that is 20 ms late lags by 20 ms times its rate."""
    config, frames = cars["avante"]
    wrong = {"inputs.engine_speed.delay_ms": "25", "inputs.shaft2_speed.factor": "-1"}
    found, _ = measure([frames], load_documents(config.documents, wrong))
    sign, late = (next(each for each in found if key in each.key) for key in ("shaft2", "engine"))
    assert np.quantile(sign.picture.y, 0.9) <= 0.0
    name, x, y = late.picture.lines[1]
    assert name.startswith("the log: 2")
    slope = np.polyfit(late.picture.x, late.picture.y, 1)[0]
    assert slope == pytest.approx((y[-1] - y[0]) / (x[-1] - x[0]), rel=0.1)
    assert slope == pytest.approx(-25e-3, abs=3e-3)


def test_a_delay_that_would_be_negative_lets_all_others_grow(cars, tmp_path):
    """Delays are relative: the engine comes sooner than with none at all, so the others get what it lacks."""
    config, frames = cars["telling"]
    told = {given.quantity: 1e-3 * given.delay_us for given in config.inputs}
    late = told[Quantity.ENGINE_SPEED] + 12.0
    draft = Draft(config)
    laid = {}
    for quantity, right in told.items():
        sooner = max(right - late, 0.0) if quantity is not Quantity.ENGINE_TORQUE else 0.0
        laid |= dict(draft.with_key(quantity, "delay_ms", f"{sooner:g}"))
    found, corrected = measure([frames], load_documents(config.documents, laid))
    assert {finding.key.split(".")[-1] for finding in found} == {"delay_ms"}
    assert [finding.key for finding in found if finding.also] == [found[0].key]
    delays_us = {given.quantity: given.delay_us for given in corrected.config.inputs}
    assert min(delays_us.values()) == 0
    for one, other in (
        (Quantity.SHAFT1_SPEED, Quantity.ENGINE_SPEED),
        (Quantity.WHEEL_SPEED_FL, Quantity.ENGINE_SPEED),
    ):
        between = 1e-3 * (delays_us[one] - delays_us[other])
        assert between == pytest.approx(told[one] - told[other], abs=3.0)
    assert measure([frames], corrected.config).findings == []


def test_torques_and_kissing_point_are_those_of_the_car(cars):
    config, frames = cars["avante"]
    m = moments(decoded([frames], config))
    found = factors(m)
    assert abs(found.mass.value - 1.0) < 3.0 * found.mass.sigma < 0.4
    assert found.correlation > 0.7
    assert abs(idle_torque(m).value) < 1.0
    drag = DEMO_POWERTRAIN.drag_nm + DEMO_POWERTRAIN.drag_nms * 200.0
    assert -1.5 * drag < overrun_torque(m).value < -0.7 * drag
    kiss = kissing_point(m, 1, True)
    assert abs(kiss.point.value - DEMO_POWERTRAIN.kissing_point_mm) < 0.4


@pytest.mark.parametrize("car", ["invented", "telling"])
@pytest.mark.parametrize("drive", [DriveName.KICK_DOWN, DriveName.BRAKED_COAST_DOWN, DriveName.SAILING])
def test_slip_on_a_level_road_is_no_delay(cars, car, drive):
    """Without hills the acceleration is that of the force: what its slip does looks like a delay of 80 ms."""
    config, _ = cars[car]
    frames = simulate_car(config, drive, ProfileName.PRODUCTION, 1, None).frames
    assert measure([frames], config).findings == []


def test_reverse_is_no_reversed_sign():
    """A drive in nothing but reverse, of a car whose wheels have a sign."""
    config = load_documents(invent_car(21).documents)
    frames = simulate_car(config, DriveName.REVERSE, ProfileName.PRODUCTION, 1, None).frames
    assert np.nanmin(moments(decoded([frames], config)).wheels) < -5.0
    assert measure([frames], config).findings == []
