"""What is drawn, and what a draw changes in the car."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest, truncnorm, uniform

from dctorque_can.driveline.parameters import Gear, Shaft
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames
from dctorque_can.study.draw import draw, noise_seed
from dctorque_can.study.factors import FACTORS, Car, varied
from dctorque_can.study.plan import load_study

VARY = {
    "payload_kg": {"uniform": {"low": 100, "high": 300}},
    "engine_torque_offset_nm": {"normal": {"mean": 2, "std": 5}},
}


@pytest.fixture
def car(write_study) -> Car:
    return Car(load_study(write_study()).config.settings.vehicle, DEMO_POWERTRAIN, PRODUCTION, PAPER)


def differences(old: Any, new: Any, at: str = "") -> dict[str, tuple[Any, Any]]:
    if isinstance(old, dict):
        return {k: v for key in old for k, v in differences(old[key], new[key], f"{at}.{key}").items()}
    if isinstance(old, list | tuple) and not at.endswith("grade_rad"):
        return {
            k: v
            for n, pair in enumerate(zip(old, new, strict=True))
            for k, v in differences(*pair, f"{at}.{n}").items()
        }
    return {} if old == new else {at: (old, new)}


def test_run_k_does_not_depend_on_how_many_runs_there_are(write_study) -> None:
    few, many = (
        draw(load_study(write_study(vary=VARY, runs=5))),
        draw(load_study(write_study(vary=VARY, runs=300))),
    )
    assert few == many[:6]
    assert few[0] == {}
    assert draw(load_study(write_study(vary=VARY, seed=8)))[1] != few[1]
    assert len({noise_seed(7, run) for run in range(1000)} | {noise_seed(8, 0)}) == 1001


def test_the_draws_have_the_distributions_that_were_asked_for(write_study) -> None:
    runs = draw(load_study(write_study(vary=VARY, runs=1024)))[1:]
    load = [values["payload_kg"] for values in runs]
    offset = [values["engine_torque_offset_nm"] for values in runs]
    assert kstest(load, uniform(100, 200).cdf).statistic < 0.005  # random numbers would give about 0.03
    assert kstest(offset, truncnorm(-3, 3, loc=2, scale=5).cdf).statistic < 0.005
    assert abs(np.corrcoef(load, offset)[0, 1]) < 0.02


@pytest.mark.parametrize(
    ("name", "value", "changed"),
    [
        ("engine_inertia_factor", 1.2, {".vehicle.engine_inertia_kgm2": 0.24}),
        ("damper_inertia_factor", 0.5, {".vehicle.damper.inertia_kgm2": 0.015}),
        ("damper_stiffness_factor", 2.0, {".vehicle.damper.stiffness_nm_per_rad": 3000.0}),
        (
            "shaft_inertia_factor",
            2.0,
            {".vehicle.shafts.0.inertia_kgm2": 0.0046, ".vehicle.shafts.1.inertia_kgm2": 0.0018},
        ),
        (
            "transfer_stiffness_factor",
            0.5,
            {
                ".vehicle.shafts.0.transfer_stiffness_nm_per_rad": 5000.0,
                ".vehicle.shafts.1.transfer_stiffness_nm_per_rad": 11500.0,
            },
        ),
        ("gear_inertia_factor", 3.0, {f".vehicle.gears.{i}.inertia_kgm2": 0.003 for i in range(5)}),
        ("wheel_inertia_factor", 1.5, {".vehicle.chassis.wheel_inertia_kgm2": 3.0}),
        ("output_stiffness_factor", 0.8, {".vehicle.output_shaft.stiffness_nm_per_rad": 8000.0}),
        (
            "clutch_friction_factor",
            0.5,
            {f".vehicle.clutches.{i}.friction_static": 0.155 for i in (0, 1)}
            | {f".vehicle.clutches.{i}.friction_kinetic": 0.15 for i in (0, 1)}
            | {".powertrain.friction_over_assumed": 0.5},
        ),
        (
            "kissing_point_offset_mm",
            0.5,
            {
                ".powertrain.kissing_point_mm": 3.5,
                ".powertrain.full_position_mm": 10.5,
                ".powertrain.ready_position_mm": 3.0,
            },
        ),
        ("mass_factor", 1.25, {".vehicle.chassis.mass_kg": 2000.0}),
        ("payload_kg", 300.0, {".drive.payload_kg": 300.0}),
        ("tyre_radius_factor", 0.5, {".vehicle.chassis.wheel_radius_m": 0.156}),
        ("grade_offset_rad", 0.25, {".drive.grade_rad": ((0.0, 0.35),)}),
        ("engine_torque_gain", 1.1, {".sensors.torque_gain": 1.1}),
        ("engine_torque_offset_nm", -4.0, {".sensors.torque_offset_nm": -4.0}),
        ("engine_torque_delay_ms", 12.5, {".sensors.torque_delay_us": 12_500}),
        ("engine_speed_noise_factor", 2.0, {".sensors.noise.engine_speed_rad_s": 0.2}),
        ("shaft_speed_noise_factor", 2.0, {".sensors.noise.shaft_speed_rad_s": 0.2}),
        ("wheel_speed_noise_factor", 2.0, {".sensors.noise.wheel_speed_rad_s": 0.04}),
        (
            "sensor_noise_factor",
            2.0,
            {
                ".sensors.noise.engine_speed_rad_s": 0.2,
                ".sensors.noise.shaft_speed_rad_s": 0.2,
                ".sensors.noise.wheel_speed_rad_s": 0.04,
                ".sensors.noise.engine_torque_nm": 1.0,
                ".sensors.noise.clutch_position_mm": 0.02,
            },
        ),
        (
            "bus_delay_ms",
            2.0,
            {
                ".sensors.timing.EngineData.delay_us": 3500,
                ".sensors.timing.InputShafts.delay_us": 3000,
                ".sensors.timing.Gearbox.delay_us": 3000,
                ".sensors.timing.WheelSpeedsFront.delay_us": 4000,
                ".sensors.timing.WheelSpeedsRear.delay_us": 4000,
            },
        ),
    ],
)
def test_a_factor_changes_exactly_what_it_says(car: Car, name: str, value: float, changed: dict[str, Any]) -> None:
    found = {key: new for key, (_, new) in differences(asdict(car), asdict(varied(car, {name: value}))).items()}
    assert set(found) == set(changed)
    for key, new in changed.items():
        np.testing.assert_allclose(found[key], new, rtol=1e-12)


def test_the_nominal_value_of_every_factor_changes_nothing(car: Car) -> None:
    assert varied(car, {name: factor.nominal for name, factor in FACTORS.items()}) == car
    assert isinstance(car.vehicle.gears[0], Gear)
    assert isinstance(car.vehicle.shafts[0], Shaft)


def test_a_wrong_friction_gives_that_share_of_the_capacity_asked_for(car: Car) -> None:
    weak = varied(car, {"clutch_friction_factor": 0.8})
    truth = simulate(weak.vehicle, replace(weak.drive, duration_s=6.0), weak.powertrain)
    steady = np.abs(np.gradient(truth["clutch1_command_nm"])) < 0.02  # per millisecond: the actuator keeps up
    steady &= (truth["clutch1_command_nm"] > 50.0) & (truth["t_us"] > 2_000_000)
    assert steady.sum() > 200
    ratio = truth["clutch1_capacity_nm"][steady] / truth["clutch1_command_nm"][steady]
    np.testing.assert_allclose(ratio, 0.8, atol=0.01)


def test_wheel_signals_keep_the_true_speed_whatever_the_tyre(car: Car, write_study) -> None:
    """A tyre that is 10 % small turns the wheels 11 % faster; km/h are the control unit's own, coded radius."""
    database = load_study(write_study()).config.database
    small = varied(car, {"tyre_radius_factor": 0.9})
    truth = simulate(small.vehicle, replace(small.drive, duration_s=4.0), small.powertrain)
    frames = emit_frames(truth, car.vehicle, small.sensors, database)
    message = database.get_message_by_name("WheelSpeedsRear")
    last = frames.data[frames.can_id == message.frame_id][-1][: message.length].tobytes()
    speed = message.decode(last)["WheelSpeedRL"] / 3.6 / 0.312
    np.testing.assert_allclose(speed, truth["undriven_wheel_speed_rad_s"][-1], rtol=0.03)
