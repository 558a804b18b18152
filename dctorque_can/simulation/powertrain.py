"""What the simulated car has beyond its `Vehicle`: engine, actuators, synchronisers, tyres."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import AIR_DENSITY, STANDARD_GRAVITY, Gear, Vehicle

Floats = NDArray[np.float64]
RPM = pi / 30.0
MPH = 0.44704


@dataclass(frozen=True, slots=True)
class Powertrain:
    """Parts of a simulated car that no estimator is told about.

    The engine's full-load torque is P/ω_P (a + b x − c x²) with x = ω/ω_P, the usual polynomial of a spark
    ignition engine. Shift speeds are those of the published example model Simscape-Dual-Clutch; its file states
    no unit, and miles per hour put the shifts at sensible engine speeds (1-2 at 3300 rpm with half pedal).
    """

    max_power_w: float
    max_power_speed_rad_s: float
    full_load_coefficients: tuple[float, float, float]  # a, b, c
    idle_speed_rad_s: float
    speed_limit_rad_s: float
    drag_nm: float  # engine braking with the fuel cut: drag_nm + drag_nms · ω
    drag_nms: float
    pedal_exponent: float  # share of full load at pedal p: 1 − (1 − p)^exponent
    torque_lag_s: float
    kissing_point_mm: float
    full_position_mm: float
    ready_position_mm: float  # waiting just short of the kissing point
    force_exponent: float  # normal force = maximum · ((x − kissing)/(full − kissing))^exponent
    friction_over_assumed: float  # clutch friction over the one that the gearbox control reckons with
    actuator_lag_s: float
    synchroniser_friction_static: float
    synchroniser_friction_kinetic: float
    synchroniser_lever_m: float  # mean cone radius over the sine of the cone angle
    synchroniser_max_force_n: float
    synchroniser_time_s: float  # the force is chosen for this time, as far as it reaches
    sleeve_time_s: float  # from one gear to the cone of the next
    slip_stiffness_per_load: float  # driven axle: longitudinal force per slip and per axle load
    driven_axle_load_share: float
    tyre_relaxation_m: float
    tyre_damping_ns_per_m: float
    driven_wheel_inertia_share: float
    shift_pedal: tuple[float, ...]
    up_shift_m_s: tuple[tuple[float, ...], ...]  # per gear, at `shift_pedal`
    shift_hysteresis_m_s: float
    clutch_fading: float  # share of its friction that a hot clutch has lost
    clutch_fading_heat_j: float  # stored in a clutch when it has lost that; less heat takes in proportion
    clutch_cooling_s: float  # time constant of what is stored


DEMO_POWERTRAIN = Powertrain(
    max_power_w=100e3,
    max_power_speed_rad_s=5500 * RPM,
    full_load_coefficients=(0.6526, 1.6948, 1.3474),
    idle_speed_rad_s=800 * RPM,
    speed_limit_rad_s=6000 * RPM,
    drag_nm=12.0,
    drag_nms=0.05,
    pedal_exponent=2.0,
    torque_lag_s=0.2,
    kissing_point_mm=3.0,
    full_position_mm=10.0,
    ready_position_mm=2.5,
    force_exponent=1.5,
    friction_over_assumed=1.0,
    actuator_lag_s=0.025,
    synchroniser_friction_static=0.35,
    synchroniser_friction_kinetic=0.30,
    synchroniser_lever_m=0.44,  # 50 mm over sin 6.5°
    synchroniser_max_force_n=200.0,
    synchroniser_time_s=0.2,
    sleeve_time_s=0.05,
    slip_stiffness_per_load=20.0,
    driven_axle_load_share=0.5,
    tyre_relaxation_m=0.3,
    tyre_damping_ns_per_m=1000.0,
    driven_wheel_inertia_share=0.5,
    shift_pedal=(0.1, 0.4, 0.5, 0.9),
    up_shift_m_s=tuple(
        tuple(speed * MPH for speed in row)
        for row in (
            (11.5, 14.5, 17.5, 20.5),
            (23.5, 26.5, 29.5, 32.5),
            (35.5, 38.5, 41.5, 44.5),
            (45.5, 48.5, 51.5, 54.5),
            (55.5, 58.5, 61.5, 64.5),  # gears 6 and 7 continue the table
            (65.5, 68.5, 71.5, 74.5),
        )
    ),
    shift_hysteresis_m_s=3.0 * MPH,
    clutch_fading=0.0,
    clutch_fading_heat_j=70e3,
    clutch_cooling_s=60.0,
)
"""A 100 kW engine (idle 800 rpm, lag 0.2 s), cones .35/.30 as in section 4.1, and ordinary values for the rest."""


class Parameters(NamedTuple):
    """`Vehicle` and `Powertrain` as the compiled plant and control read them. SI units, positions in mm.

    Gear tables are indexed by gear number 1..n; index 0 is neutral, index -1 (the last) reverse: ratio 0 if none.
    """

    J_e: float
    J_d: float
    J_shaft: Floats  # [2] J_c with all gears of the shaft: they turn with it
    J_o: float
    J_w: float  # driven wheels
    J_w_undriven: float
    mass: float
    r_w: float
    k_d: float
    b_d: float
    k_t: Floats  # [2]
    b_t: Floats
    k_o: float
    b_o: float
    drag: Floats  # [2]
    spin_loss: Floats  # [3, 2] of both input shafts and the output shaft: N·m, and N·m·s/rad
    capacity_full: Floats  # [2] kinetic torque capacity at full normal force
    capacity_assumed: Floats  # [2] … with the friction that the gearbox control reckons with
    static_ratio: Floats  # [2] static over kinetic
    n_gears: int
    gear_shaft: NDArray[np.int64]  # 0 or 1
    ratio: Floats
    final_drive: Floats
    gear_efficiency: float
    final_drive_efficiency: float
    weight: float  # m g
    driven_load: float  # of the driven axle, N
    rolling: float
    air: float  # ½ ρ C_d A
    slip_stiffness: float  # N
    tyre_relaxation: float
    tyre_damping: float
    power_torque: float  # P/ω_P
    power_speed: float
    full_load: Floats  # [3]
    idle: float
    speed_limit: float
    drag_nm: float
    drag_nms: float
    pedal_exponent: float
    torque_lag: float
    kiss: float
    full: float
    ready: float
    force_exponent: float
    actuator_lag: float
    cone_static_ratio: float
    cone_max: float  # kinetic, N·m
    cone_time: float
    sleeve_time: float
    shift_pedal: Floats
    up_shift: Floats  # [gears, pedals]
    shift_hysteresis: float
    fading: float
    fading_heat: float
    cooling: float


def parameters(vehicle: Vehicle, powertrain: Powertrain, payload_kg: float) -> Parameters:
    """Return the flat parameters of a loaded car."""
    forward = {gear.number: gear for gear in vehicle.gears if gear.number > 0}
    n = max(forward)
    reverse = next((gear for gear in vehicle.gears if gear.number == -1), Gear(-1, 1, 0.0, 0.0, 0.0))
    numbered = [forward[i] for i in range(1, n + 1)]
    chassis = vehicle.chassis
    mass = chassis.mass_kg + payload_kg
    clutches, shafts = vehicle.clutches, vehicle.shafts
    capacity_full = np.array(
        [c.surfaces * c.friction_kinetic * c.effective_radius_m * c.max_normal_force_n for c in clutches]
    )
    share = powertrain.driven_wheel_inertia_share
    load = mass * STANDARD_GRAVITY * powertrain.driven_axle_load_share
    return Parameters(
        J_e=vehicle.engine_inertia_kgm2,
        J_d=vehicle.damper.inertia_kgm2,
        J_shaft=np.array([vehicle.shaft_inertia_kgm2(shaft) for shaft in (1, 2)]),
        J_o=vehicle.output_shaft.inertia_kgm2,
        J_w=chassis.wheel_inertia_kgm2 * share,
        J_w_undriven=chassis.wheel_inertia_kgm2 * (1.0 - share),
        mass=mass,
        r_w=chassis.wheel_radius_m,
        k_d=vehicle.damper.stiffness_nm_per_rad,
        b_d=vehicle.damper.damping_nms_per_rad,
        k_t=np.array([shaft.transfer_stiffness_nm_per_rad for shaft in shafts]),
        b_t=np.array([shaft.transfer_damping_nms_per_rad for shaft in shafts]),
        k_o=vehicle.output_shaft.stiffness_nm_per_rad,
        b_o=vehicle.output_shaft.damping_nms_per_rad,
        drag=np.array([clutch.drag_nms_per_rad for clutch in clutches]),
        spin_loss=np.array([(s.spin_loss_nm, s.spin_loss_nms_per_rad) for s in (*shafts, vehicle.output_shaft)]),
        capacity_full=capacity_full,
        capacity_assumed=capacity_full / powertrain.friction_over_assumed,
        static_ratio=np.array([c.friction_static / c.friction_kinetic for c in clutches]),
        n_gears=n,
        gear_shaft=np.array([0, *(gear.shaft - 1 for gear in (*numbered, reverse))], np.int64),
        ratio=np.array([0.0, *(gear.ratio for gear in (*numbered, reverse))]),
        final_drive=np.array([0.0, *(gear.final_drive for gear in (*numbered, reverse))]),
        gear_efficiency=vehicle.gear_efficiency,
        final_drive_efficiency=vehicle.final_drive_efficiency,
        weight=mass * STANDARD_GRAVITY,
        driven_load=load,
        rolling=chassis.rolling_resistance,
        air=0.5 * AIR_DENSITY * chassis.drag_coefficient * chassis.frontal_area_m2,
        slip_stiffness=powertrain.slip_stiffness_per_load * load,
        tyre_relaxation=powertrain.tyre_relaxation_m,
        tyre_damping=powertrain.tyre_damping_ns_per_m,
        power_torque=powertrain.max_power_w / powertrain.max_power_speed_rad_s,
        power_speed=powertrain.max_power_speed_rad_s,
        full_load=np.array(powertrain.full_load_coefficients),
        idle=powertrain.idle_speed_rad_s,
        speed_limit=powertrain.speed_limit_rad_s,
        drag_nm=powertrain.drag_nm,
        drag_nms=powertrain.drag_nms,
        pedal_exponent=powertrain.pedal_exponent,
        torque_lag=powertrain.torque_lag_s,
        kiss=powertrain.kissing_point_mm,
        full=powertrain.full_position_mm,
        ready=powertrain.ready_position_mm,
        force_exponent=powertrain.force_exponent,
        actuator_lag=powertrain.actuator_lag_s,
        cone_static_ratio=powertrain.synchroniser_friction_static / powertrain.synchroniser_friction_kinetic,
        cone_max=powertrain.synchroniser_friction_kinetic
        * powertrain.synchroniser_lever_m
        * powertrain.synchroniser_max_force_n,
        cone_time=powertrain.synchroniser_time_s,
        sleeve_time=powertrain.sleeve_time_s,
        shift_pedal=np.array(powertrain.shift_pedal),
        up_shift=np.array(powertrain.up_shift_m_s),
        shift_hysteresis=powertrain.shift_hysteresis_m_s,
        fading=powertrain.clutch_fading,
        fading_heat=powertrain.clutch_fading_heat_j,
        cooling=powertrain.clutch_cooling_s,
    )
