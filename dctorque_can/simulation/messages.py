"""What each message of the simulated car says at the instants at which it samples: columns in the DBC's units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.simulation.one_gear import one_gear

if TYPE_CHECKING:
    from dctorque_can.simulation.sensors import DirectionErrors, SensorProfile, Speeds

Floats = NDArray[np.float64]

_RPM_PER_RAD_S = 30.0 / pi
_KMH_PER_M_S = 3.6
_GEAR_REVERSE = 13  # raw values of demo_car.dbc
_GEAR_CHANGING = 14
_SAID = {"forward": 1, "backward": 2, "unknown": 3}  # of demo_car_more.dbc; 0 is standstill
_TURNS = 0.3  # rad/s at which a wheel counts as turning
_FRICTION_NM, _FRICTION_NMS = 12.0, 0.05  # of the engine, at rest and for each rad/s
_ACCELERATION_US = 20_000  # over which the acceleration is a mean


@dataclass(frozen=True, slots=True)
class Sampled:
    """Truth at the sample instants of one message."""

    truth: NDArray[np.void]
    at_us: NDArray[np.int64]  # on the time of the truth
    profile: SensorProfile
    wheel_radius_m: float
    random: np.random.Generator
    lasting: np.random.Generator  # always at its beginning: for what is the same for the whole life of a car

    def value(self, name: str, sigma: float = 0.0, late_us: int = 0) -> Floats:
        """Return a column of the truth, with noise of a standard deviation, as it was ``late_us`` earlier."""
        clean = np.interp(self.at_us - late_us, self.truth["t_us"], self.truth[name])
        noise = sigma * self.random.standard_normal(len(clean)) if sigma else 0.0
        return np.asarray(clean + noise, np.float64)

    def speed(self, name: str, group: Speeds, sigma: float, difference: float = 0.0) -> Floats:
        """Return a speed of ``group``, as it is sent: maybe unsigned; ``difference`` is 1 left and -1 right."""
        signed = self.value(name)
        if difference != 0.0:
            signed = signed + difference * self.value("wheel_difference_rad_s")
        noise = sigma * self.random.standard_normal(len(signed)) if sigma else 0.0
        if group in self.profile.unsigned:
            return np.asarray(np.maximum(0.0, np.abs(signed) + noise), np.float64)
        return np.asarray(signed + noise, np.float64)

    def rate(self, name: str, late_us: int = 0) -> Floats:
        """Return by how much a value changes in a second."""
        step_us = 1000  # that of the truth
        value, before = self.value(name, late_us=late_us), self.value(name, late_us=late_us + step_us)
        return (value - before) * (1e6 / step_us)

    def state(self, name: str) -> NDArray[np.int64]:
        """Return a column of the truth that has steps."""
        rows = np.searchsorted(self.truth["t_us"], self.at_us, side="right") - 1
        return np.asarray(self.truth[name][rows], np.int64)


def _engine(s: Sampled) -> dict[str, Floats]:
    profile = s.profile
    torque = nominal_torque(s)
    speed = s.value("engine_speed_rad_s", profile.noise.engine_speed_rad_s)
    noise = profile.noise.engine_torque_nm * s.random.standard_normal(len(torque))
    return {
        "EngineSpeed": speed * _RPM_PER_RAD_S,
        "EngineTorque": torque + noise,
        "AcceleratorPedal": 100.0 * s.value("pedal"),
        "BrakeActive": (s.value("brake_n") > 0.0).astype(float),
    }


def _shafts(s: Sampled) -> dict[str, Floats]:
    sigma = s.profile.noise.shaft_speed_rad_s
    return {
        f"InputShaft{i}Speed": s.speed(f"shaft{i}_speed_rad_s", "shafts", sigma) * _RPM_PER_RAD_S for i in (1, 2)
    }


def _gearbox(s: Sampled) -> dict[str, Floats]:
    columns: dict[str, Floats] = {}
    for i in (1, 2):
        gear = s.state(f"gear{i}")
        raw = np.where(gear < 0, _GEAR_REVERSE, gear)
        columns[f"GearShaft{i}"] = np.where(s.state(f"changing{i}") == 1, _GEAR_CHANGING, raw).astype(float)
        columns[f"Clutch{i}Position"] = s.value(f"clutch{i}_position_mm", s.profile.noise.clutch_position_mm)
    return columns


def _transmission(s: Sampled) -> dict[str, Floats]:
    told = one_gear(s.truth, s.profile.gear_changes)
    rows = np.searchsorted(s.truth["t_us"], s.at_us, side="right") - 1
    actual, target = (np.where(gear < 0, _GEAR_REVERSE, gear)[rows] for gear in (told.actual, told.target))
    columns = {
        "ActualGear": actual,
        "TargetGear": target,
        "ShiftInProgress": told.shifting[rows],
        "ClutchState": told.state[rows],
    }
    return {name: column.astype(float) for name, column in columns.items()}


def _axle(front: bool) -> Callable[[Sampled], dict[str, Floats]]:
    def columns(s: Sampled) -> dict[str, Floats]:
        driven = s.profile.driven_axle in ("all", "front" if front else "rear")
        name = "wheel_speed_rad_s" if driven else "undriven_wheel_speed_rad_s"
        scale = s.wheel_radius_m * _KMH_PER_M_S
        sigma = s.profile.noise.wheel_speed_rad_s
        return {
            f"WheelSpeed{wheel}": s.speed(name, "wheels", sigma, half if driven else 0.0) * scale
            for wheel, half in ((("FL", 1.0), ("FR", -1.0)) if front else (("RL", 1.0), ("RR", -1.0)))
        }

    return columns


def _inertial(s: Sampled) -> dict[str, Floats]:
    offset, grade_offset = s.lasting.standard_normal(2)
    return {
        "LongAcceleration": acceleration(s, offset),
        "RoadGrade": np.degrees(grade(s, grade_offset)),
    }


def acceleration(s: Sampled, offset: float) -> Floats:
    """Return what an accelerometer measures along the car, m/s²; its lasting offset in standard deviations."""
    errors, half_us = s.profile.inertial, _ACCELERATION_US // 2
    name = "undriven_wheel_speed_rad_s"
    later, earlier = (s.value(name, late_us=errors.delay_us + sign * half_us) for sign in (-1, 1))
    dv_dt = s.wheel_radius_m * (later - earlier) / (_ACCELERATION_US * 1e-6)
    gravity = STANDARD_GRAVITY * np.sin(s.value("grade_rad", late_us=errors.delay_us))
    noise = errors.noise_m_s2 * s.random.standard_normal(len(dv_dt))
    return np.asarray((1.0 + errors.pitch) * dv_dt + gravity + errors.offset_m_s2 * offset + noise, np.float64)


def grade(s: Sampled, offset: float) -> Floats:
    """Return the grade that a control unit believes in, rad; its lasting offset in standard deviations."""
    errors = s.profile.inertial
    return s.value("grade_rad", late_us=errors.grade_delay_us) + errors.grade_offset_rad * offset


def _directions(s: Sampled) -> dict[str, Floats]:
    errors = s.profile.direction
    driven = s.value("wheel_speed_rad_s", late_us=errors.delay_us)
    half = s.value("wheel_difference_rad_s", late_us=errors.delay_us)
    rolling = s.value("undriven_wheel_speed_rad_s", late_us=errors.delay_us)
    columns = {"VehicleDirection": driven if s.profile.driven_axle == "all" else rolling}
    for front, wheels in ((True, ("FL", "FR")), (False, ("RL", "RR"))):
        drives = s.profile.driven_axle in ("all", "front" if front else "rear")
        for wheel, sign in zip(wheels, (1.0, -1.0), strict=True):
            columns[f"WheelDirection{wheel}"] = driven + sign * half if drives else rolling
    return {name: _direction(speed, errors) for name, speed in columns.items()}


def _direction(speed: Floats, errors: DirectionErrors) -> Floats:
    """Return what is said of a wheel at each of its speeds."""
    if errors.stuck:
        return np.full(len(speed), float(_SAID[errors.stuck]))
    said = np.where(speed > _TURNS, _SAID["forward"], np.where(speed < -_TURNS, _SAID["backward"], 0))
    if errors.freezes:
        last = np.maximum.accumulate(np.where(said != 0, np.arange(len(said)), -1))
        said = np.where(last < 0, _SAID["forward"], said[np.maximum(last, 0)])
    return said.astype(float)


def nominal_torque(s: Sampled) -> Floats:
    """Return the torque of the engine as its control unit tells it, but for noise."""
    profile = s.profile
    torque = s.value("engine_torque_nominal_nm", late_us=profile.torque_delay_us)
    if profile.torque_lag_s > 0.0:
        torque += profile.torque_lag_s * s.rate("engine_torque_nominal_nm", late_us=profile.torque_delay_us)
    return profile.torque_gain * torque + profile.torque_offset_nm


def friction_torque(s: Sampled) -> Floats:
    """Return the friction of the engine as its control unit reckons with it, N·m, positive."""
    return _FRICTION_NM + _FRICTION_NMS * s.value("engine_speed_rad_s")


def _engine_share(s: Sampled) -> dict[str, Floats]:
    torque = nominal_torque(s)
    torque += s.profile.noise.engine_torque_nm * s.random.standard_normal(len(torque))
    friction = friction_torque(s)
    per_cent = 100.0 / s.profile.reference_torque_nm
    return {"IndicatedTorque": (torque + friction) * per_cent, "FrictionTorque": friction * per_cent}


def _engine_reference(s: Sampled) -> dict[str, Floats]:
    return {"ReferenceTorque": np.full(len(s.at_us), s.profile.reference_torque_nm)}


def driving_clutch_torque(s: Sampled) -> Floats:
    """Return what the transmission control believes of the clutch that drives, N·m."""
    first = s.value("clutch1_capacity_nm") >= s.value("clutch2_capacity_nm")
    torque = np.where(first, s.value("clutch1_torque_nm"), s.value("clutch2_torque_nm"))
    return s.profile.clutch_torque_gain * torque


def _driving_clutch(s: Sampled) -> dict[str, Floats]:
    return {"ClutchTorque": driving_clutch_torque(s)}


def driving_shaft_speed(s: Sampled) -> Floats:
    """Return the magnitude of the speed of the shaft whose clutch has the greater capacity, rad/s.

    It goes over late, and at once.
    """
    late_us = s.profile.driving_shaft_delay_us
    capacity = (s.value(f"clutch{i}_capacity_nm", late_us=late_us) for i in (1, 2))
    first = np.greater_equal(*capacity)
    sigma = s.profile.noise.shaft_speed_rad_s
    speed = np.where(first, s.value("shaft1_speed_rad_s"), s.value("shaft2_speed_rad_s"))
    noisy = np.abs(speed) + sigma * s.random.standard_normal(len(speed))
    return np.maximum(noisy, 0.0)


def _driving_shaft(s: Sampled) -> dict[str, Floats]:
    return {"InputShaftSpeed": driving_shaft_speed(s) * _RPM_PER_RAD_S}


COLUMNS: dict[str, Callable[[Sampled], dict[str, Floats]]] = {
    "EngineData": _engine,
    "InputShafts": _shafts,
    "Gearbox": _gearbox,
    "WheelSpeedsFront": _axle(front=True),
    "WheelSpeedsRear": _axle(front=False),
    "Inertial": _inertial,
    "Transmission": _transmission,
    "WheelDirections": _directions,
    "EngineShare": _engine_share,
    "EngineReference": _engine_reference,
    "DrivingClutch": _driving_clutch,
    "DrivingShaft": _driving_shaft,
}
