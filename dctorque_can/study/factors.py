"""What a study can vary: the true car, the road, the sensors and the bus. The estimator is told nothing of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.simulation.drive import Drive
from dctorque_can.simulation.powertrain import Powertrain
from dctorque_can.simulation.sensors import Noise, SensorProfile


@dataclass(frozen=True, slots=True)
class Car:
    """A true car on its road, with its signals.

    Attributes:
        vehicle: what the estimator has a belief about.
        powertrain: what it is never told.
        sensors: how the car measures and sends.
        drive: what driver and road do.
    """

    vehicle: Vehicle
    powertrain: Powertrain
    sensors: SensorProfile
    drive: Drive


@dataclass(frozen=True, slots=True)
class Factor:
    """One thing that a study can vary.

    Attributes:
        name: key below ``vary:``; it ends with the unit, or with ``factor`` or ``gain``, which multiply.
        meaning: what it does physically.
        nominal: the value that changes nothing.
        lowest: least value that makes sense.
        highest: greatest one.
        apply: returns the car with this factor at a value.
    """

    name: str
    meaning: str
    nominal: float
    lowest: float
    highest: float
    apply: Callable[[Car, float], Car]


def _vehicle(car: Car, **changes: Any) -> Car:
    return replace(car, vehicle=replace(car.vehicle, **changes))


def _engine_inertia(car: Car, factor: float) -> Car:
    return _vehicle(car, engine_inertia_kgm2=factor * car.vehicle.engine_inertia_kgm2)


def _damper_inertia(car: Car, factor: float) -> Car:
    damper = car.vehicle.damper
    return _vehicle(car, damper=replace(damper, inertia_kgm2=factor * damper.inertia_kgm2))


def _damper_stiffness(car: Car, factor: float) -> Car:
    damper = car.vehicle.damper
    stiffness = factor * damper.stiffness_nm_per_rad
    return _vehicle(car, damper=replace(damper, stiffness_nm_per_rad=stiffness))


def _shaft_inertia(car: Car, factor: float) -> Car:
    shafts = car.vehicle.shafts
    return _vehicle(car, shafts=tuple(replace(s, inertia_kgm2=factor * s.inertia_kgm2) for s in shafts))


def _transfer_stiffness(car: Car, factor: float) -> Car:
    shafts = tuple(
        replace(shaft, transfer_stiffness_nm_per_rad=factor * shaft.transfer_stiffness_nm_per_rad)
        for shaft in car.vehicle.shafts
    )
    return _vehicle(car, shafts=shafts)


def _gear_inertia(car: Car, factor: float) -> Car:
    gears = car.vehicle.gears
    return _vehicle(car, gears=tuple(replace(g, inertia_kgm2=factor * g.inertia_kgm2) for g in gears))


def _output_stiffness(car: Car, factor: float) -> Car:
    shaft = car.vehicle.output_shaft
    stiffness = factor * shaft.stiffness_nm_per_rad
    return _vehicle(car, output_shaft=replace(shaft, stiffness_nm_per_rad=stiffness))


def _wheel_inertia(car: Car, factor: float) -> Car:
    chassis = car.vehicle.chassis
    return _vehicle(car, chassis=replace(chassis, wheel_inertia_kgm2=factor * chassis.wheel_inertia_kgm2))


def _tyre_radius(car: Car, factor: float) -> Car:
    chassis = car.vehicle.chassis
    return _vehicle(car, chassis=replace(chassis, wheel_radius_m=factor * chassis.wheel_radius_m))


def _clutch_friction(car: Car, factor: float) -> Car:
    clutches = tuple(
        replace(
            clutch,
            friction_static=factor * clutch.friction_static,
            friction_kinetic=factor * clutch.friction_kinetic,
        )
        for clutch in car.vehicle.clutches
    )
    assumed = factor * car.powertrain.friction_over_assumed
    return replace(
        _vehicle(car, clutches=clutches), powertrain=replace(car.powertrain, friction_over_assumed=assumed)
    )


def _kissing_point(car: Car, offset_mm: float) -> Car:
    old = car.powertrain
    return replace(
        car,
        powertrain=replace(
            old,
            kissing_point_mm=old.kissing_point_mm + offset_mm,
            full_position_mm=old.full_position_mm + offset_mm,
            ready_position_mm=old.ready_position_mm + offset_mm,
        ),
    )


def _mass(car: Car, factor: float) -> Car:
    chassis = car.vehicle.chassis
    return _vehicle(car, chassis=replace(chassis, mass_kg=factor * chassis.mass_kg))


def _payload(car: Car, payload_kg: float) -> Car:
    return replace(car, drive=replace(car.drive, payload_kg=car.drive.payload_kg + payload_kg))


def _grade(car: Car, offset_rad: float) -> Car:
    grade = tuple((t, grade + offset_rad) for t, grade in car.drive.grade_rad)
    return replace(car, drive=replace(car.drive, grade_rad=grade))


def _sensors(car: Car, **changes: Any) -> Car:
    return replace(car, sensors=replace(car.sensors, **changes))


def _torque_lag(car: Car, lag_ms: float) -> Car:
    return _sensors(car, torque_lag_s=car.sensors.torque_lag_s + lag_ms / 1000.0)


def _torque_gain(car: Car, gain: float) -> Car:
    return _sensors(car, torque_gain=gain * car.sensors.torque_gain)


def _torque_offset(car: Car, offset_nm: float) -> Car:
    return _sensors(car, torque_offset_nm=car.sensors.torque_offset_nm + offset_nm)


def _torque_delay(car: Car, delay_ms: float) -> Car:
    return _sensors(car, torque_delay_us=car.sensors.torque_delay_us + round(1000 * delay_ms))


def _noise(*names: str) -> Callable[[Car, float], Car]:
    def apply(car: Car, factor: float) -> Car:
        noise = car.sensors.noise
        return _sensors(car, noise=replace(noise, **{name: factor * getattr(noise, name) for name in names}))

    return apply


def _tyre_friction(car: Car, factor: float) -> Car:
    left, right = (
        tuple((t, factor * friction) for t, friction in knots)
        for knots in (car.drive.friction, car.drive.friction_right)
    )
    return replace(car, drive=replace(car.drive, friction=left, friction_right=right))


def _clutch_drag(car: Car, drag_nms_per_rad: float) -> Car:
    clutches = tuple(
        replace(clutch, drag_nms_per_rad=clutch.drag_nms_per_rad + drag_nms_per_rad)
        for clutch in car.vehicle.clutches
    )
    return _vehicle(car, clutches=clutches)


def _spin_loss(car: Car, name: str, added: float) -> Car:
    shafts = tuple(replace(shaft, **{name: getattr(shaft, name) + added}) for shaft in car.vehicle.shafts)
    return _vehicle(car, shafts=shafts)


def _bus_delay(car: Car, delay_ms: float) -> Car:
    later = round(1000 * delay_ms)
    timing = {name: replace(t, delay_us=t.delay_us + later) for name, t in car.sensors.timing.items()}
    return _sensors(car, timing=timing)


_NOISES = tuple(Noise.__dataclass_fields__)

FACTORS: Mapping[str, Factor] = {
    factor.name: factor
    for factor in (
        Factor("engine_inertia_factor", "Inertia of engine and flywheel", 1, 0.2, 5, _engine_inertia),
        Factor("damper_inertia_factor", "Inertia of the damper's secondary side", 1, 0.2, 5, _damper_inertia),
        Factor("shaft_inertia_factor", "Inertia of both input shafts", 1, 0.2, 5, _shaft_inertia),
        Factor("gear_inertia_factor", "Inertia of every gear", 1, 0.2, 5, _gear_inertia),
        Factor("wheel_inertia_factor", "Inertia of all wheels", 1, 0.2, 5, _wheel_inertia),
        Factor("damper_stiffness_factor", "Stiffness of the torsional damper", 1, 0.2, 5, _damper_stiffness),
        Factor("transfer_stiffness_factor", "Stiffness of both transfer shafts", 1, 0.2, 5, _transfer_stiffness),
        Factor("output_stiffness_factor", "Stiffness of the output shaft", 1, 0.2, 5, _output_stiffness),
        Factor(
            "clutch_friction_factor",
            "Static and kinetic friction of both clutches; the gearbox control does not know either",
            1,
            0.3,
            3,
            _clutch_friction,
        ),
        Factor(
            "kissing_point_offset_mm",
            "Shift of both kissing points of the demo car; its gearbox control has learned it",
            0,
            -2,
            2,
            _kissing_point,
        ),
        Factor("mass_factor", "Mass of the vehicle file, which may be wrong", 1, 0.5, 2, _mass),
        Factor("payload_kg", "Load on top of the mass of the vehicle file", 0, 0, 40_000, _payload),
        Factor(
            "tyre_radius_factor",
            "True rolling radius; the wheel signals are made with the radius of the vehicle file",
            1,
            0.7,
            1.3,
            _tyre_radius,
        ),
        Factor("grade_offset_rad", "Added to the slope of the drive, positive uphill", 0, -0.3, 0.3, _grade),
        Factor("engine_torque_gain", "Nominal engine torque over the true one", 1, 0.1, 3, _torque_gain),
        Factor("engine_torque_offset_nm", "Added to the nominal engine torque", 0, -500, 500, _torque_offset),
        Factor(
            "engine_torque_delay_ms",
            "Further delay of the nominal engine torque behind the true one",
            0,
            0,
            1000,
            _torque_delay,
        ),
        Factor(
            "engine_speed_noise_factor",
            "Noise (σ) of the engine speed",
            1,
            0,
            100,
            _noise("engine_speed_rad_s"),
        ),
        Factor(
            "shaft_speed_noise_factor",
            "Noise (σ) of both input shaft speeds",
            1,
            0,
            100,
            _noise("shaft_speed_rad_s"),
        ),
        Factor(
            "wheel_speed_noise_factor",
            "Noise (σ) of the four wheel speeds",
            1,
            0,
            100,
            _noise("wheel_speed_rad_s"),
        ),
        Factor("sensor_noise_factor", "Noise (σ) of every sensor at once", 1, 0, 100, _noise(*_NOISES)),
        Factor("bus_delay_ms", "Further delay of every frame", 0, 0, 1000, _bus_delay),
        Factor(
            "engine_torque_lag_ms",
            "Lag of the engine behind the nominal torque, which is then a demand",
            0,
            0,
            1000,
            _torque_lag,
        ),
        Factor(
            "tyre_friction_factor",
            "Greatest force over load of the driven tyres, on drives on which they have a limit",
            1,
            0.1,
            10,
            _tyre_friction,
        ),
        Factor(
            "clutch_drag_nms_per_rad",
            "Added to the drag of both clutches; it acts while they are open, too",
            0,
            0,
            1,
            _clutch_drag,
        ),
        Factor(
            "spin_loss_nm",
            "Added to the loss of both input shafts whatever their load: bearings and seals",
            0,
            0,
            20,
            lambda car, added: _spin_loss(car, "spin_loss_nm", added),
        ),
        Factor(
            "spin_loss_nms_per_rad",
            "Added to the growth of that loss with the speed: churning oil",
            0,
            0,
            1,
            lambda car, added: _spin_loss(car, "spin_loss_nms_per_rad", added),
        ),
    )
}
"""Every factor by its name. Order matters: it decides which Sobol' dimension a factor draws from."""


def varied(car: Car, values: Mapping[str, float]) -> Car:
    """Return ``car`` with factors at the given values."""
    for name, value in values.items():
        car = FACTORS[name].apply(car, value)
    return car
