"""Cars in traffic with the right vehicle file or a wrong one: what the plausibility monitor is measured on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dctorque_can.config.load import Config, load_config
from dctorque_can.offline.simulated_car import (
    START_US,
    DriveName,
    ProfileName,
    SimulatedDrive,
    drive_of,
    frames_of,
    sensors_of,
)
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.study.factors import Car, varied

CARS = ("paper_car", "avante_dct7")
Settings = dict[str, str]

HONEST: Mapping[str, Mapping[str, float]] = {
    "as told": {},
    "heavy, weak engine": {
        "mass_factor": 1.2,
        "engine_inertia_factor": 1.1,
        "damper_inertia_factor": 1.1,
        "engine_torque_gain": 0.92,
        "engine_torque_lag_ms": 60,
        "tyre_radius_factor": 1.02,
        "grade_offset_rad": 0.03,
    },
    "light, strong engine": {
        "mass_factor": 0.8,
        "engine_inertia_factor": 0.9,
        "damper_inertia_factor": 0.9,
        "engine_torque_gain": 1.08,
        "tyre_radius_factor": 0.98,
        "clutch_friction_factor": 0.8,
    },
    "light, weak engine, downhill": {
        "mass_factor": 0.8,
        "engine_inertia_factor": 0.9,
        "damper_inertia_factor": 0.9,
        "engine_torque_gain": 0.92,
        "engine_torque_lag_ms": 60,
        "grade_offset_rad": -0.03,
        "kissing_point_offset_mm": 0.2,
    },
    "heavy, strong engine, uphill": {
        "mass_factor": 1.2,
        "engine_inertia_factor": 1.1,
        "damper_inertia_factor": 1.1,
        "engine_torque_gain": 1.08,
        "grade_offset_rad": 0.05,
        "clutch_friction_factor": 1.2,
        "kissing_point_offset_mm": -0.2,
    },
    "noisy, torque 5 N·m too high": {
        "mass_factor": 0.85,
        "engine_torque_offset_nm": 5,
        "engine_torque_lag_ms": 60,
        "sensor_noise_factor": 2,
        "bus_delay_ms": 3,
    },
}
"""Errors of a file that fits."""


@dataclass(frozen=True)
class Road:
    """What makes a drive another one than usual.

    Attributes:
        drag: of both open clutches, N·m·s/rad; None: as in the file.
        hills: factor of the grade.
        creeps: whether the car creeps.
        driven_axle: of the car, and in its file.
    """

    drag: float | None = None
    hills: float = 1.0
    creeps: bool = False
    driven_axle: str = "front"


def in_traffic(
    name: str,
    seed: int,
    profile: ProfileName = ProfileName.PRODUCTION,
    seconds: float = 60.0,
    errors: Mapping[str, float] | None = None,
    road: Road | None = None,
) -> tuple[Config, Frames]:
    """Return the vehicle file of a car and the frames of its drive through traffic.

    Args:
        name: of a vehicle file that ships.
        seed: of drive and noise.
        profile: how it measures.
        seconds: length.
        errors: factors of `study.factors` by which the car is another one than its file says.
        road: what is unusual.
    """
    road = road or Road()
    config = load_config(shipped_config(name), {"vehicle.driven_axle": road.driven_axle})
    return config, drive_in_traffic(config, seed, seconds, errors, profile, road)


def drive_in_traffic(
    config: Config,
    seed: int,
    seconds: float,
    errors: Mapping[str, float] | None = None,
    profile: ProfileName = ProfileName.PRODUCTION,
    road: Road | None = None,
) -> Frames:
    """Return the frames of any car's drive through traffic; the arguments are those of `in_traffic`."""
    road = road or Road()
    vehicle = config.settings.vehicle
    drive = drive_of(config, DriveName.MIXED, seed, max(seconds, 180.0))
    drive = replace(
        drive,
        duration_s=seconds,
        creeps=road.creeps,
        grade_rad=tuple((t, road.hills * grade) for t, grade in drive.grade_rad),
    )
    car = varied(Car(vehicle, DEMO_POWERTRAIN, sensors_of(config, profile, seed), drive), errors or {})
    if road.drag is not None:
        clutches = tuple(replace(clutch, drag_nms_per_rad=road.drag) for clutch in car.vehicle.clutches)
        car = replace(car, vehicle=replace(car.vehicle, clutches=clutches))
    truth = simulate(car.vehicle, car.drive, car.powertrain)
    return frames_of(config, truth, car.sensors, START_US)


def manoeuvre(name: str, drive: DriveName, unsigned: bool) -> tuple[Config, Frames] | None:
    """Return the vehicle file of a car and the frames of one manoeuvre, None if it cannot do it."""
    from dctorque_can.errors import DctorqueError
    from dctorque_can.offline.simulated_car import Unsigned, simulate_car

    config = load_config(shipped_config(name))
    how = Unsigned.ALL if unsigned else Unsigned.NONE
    try:
        found: SimulatedDrive = simulate_car(config, drive, ProfileName.PRODUCTION, 1, None, unsigned=how)
    except DctorqueError:
        return None
    return config, found.frames


def mistakes(config: Config) -> dict[str, Settings]:
    """Return the mistakes of a vehicle file by name, each as what ``--set`` lays over the right one."""
    vehicle = config.settings.vehicle
    chassis, inertia = vehicle.chassis, vehicle.engine_inertia_kgm2
    torque, wheels, clutches = "inputs.engine_torque", "inputs.wheel_speeds", "clutch_phase"
    second, third = vehicle.gear(2).ratio, vehicle.gear(3).ratio
    exchanged = "".join(np.array(list(f"{second:.2f}"))[[0, 1, 3, 2]])

    def both(key: str, value: str) -> Settings:
        return {f"{clutches}.clutch{i}.{key}": value for i in (1, 2)}

    def scaled(factor: str, *names: str) -> Settings:
        return {f"{wheels}.{name}.factor": factor for name in names}

    return {
        "engine torque with the wrong sign": {f"{torque}.factor": "-1", f"{torque}.range": "[-1000, 500]"},
        "half the engine torque": {f"{torque}.factor": "0.5"},
        "twice the engine torque": {f"{torque}.factor": "2"},
        "engine torque +40 N·m": {f"{torque}.offset": "40"},
        "engine torque −40 N·m": {f"{torque}.offset": "-40"},
        "engine torque −300 N·m": {f"{torque}.offset": "-300", f"{torque}.range": "[-1000, 1000]"},
        "clutches exchanged": {
            f"{clutches}.clutch1.signal": "Gearbox.Clutch2Position",
            f"{clutches}.clutch2.signal": "Gearbox.Clutch1Position",
        },
        "positions close the other way": both("closes", "decreasing"),
        "position 1 closes the other way": {f"{clutches}.clutch1.closes": "decreasing"},
        "kissing points 5 instead of 3 mm": both("kissing_point", "5"),
        "kissing points 7 instead of 3 mm": both("kissing_point", "7"),
        "kissing points 1 instead of 3 mm": both("kissing_point", "1"),
        "kissing point of clutch 1 6 mm": {f"{clutches}.clutch1.kissing_point": "6"},
        "wrong driven axle": {"vehicle.driven_axle": "rear"},
        "mass × 10": {"vehicle.chassis.mass_kg": str(10 * chassis.mass_kg)},
        "mass / 10": {"vehicle.chassis.mass_kg": str(0.1 * chassis.mass_kg)},
        "engine inertia × 10": {"vehicle.engine_inertia_kgm2": str(10 * inertia)},
        "engine inertia / 10": {"vehicle.engine_inertia_kgm2": str(0.1 * inertia)},
        "wheel radius +5 %": {"vehicle.chassis.wheel_radius_m": str(1.05 * chassis.wheel_radius_m)},
        "wheel radius −5 %": {"vehicle.chassis.wheel_radius_m": str(0.95 * chassis.wheel_radius_m)},
        "front wheel speeds +5 %": scaled("1.05", "fl", "fr"),
        "rear wheel speeds −5 %": scaled("0.95", "rl", "rr"),
        "ratio of gear 2 +10 %": {"vehicle.gears.2.ratio": str(1.1 * second)},
        "ratio of gear 3 −10 %": {"vehicle.gears.3.ratio": str(0.9 * third)},
        "ratio of gear 2, two digits exchanged": {"vehicle.gears.2.ratio": exchanged},
        "shaft speeds exchanged": {
            "inputs.shaft1_speed.signal": "InputShafts.InputShaft2Speed",
            "inputs.shaft2_speed.signal": "InputShafts.InputShaft1Speed",
        },
        "gear signal shifted": {
            "gears.shaft1.values": "{neutral: neutral, changing: neutral, 1: 3, 3: 5, 5: 1}",
        },
    }
