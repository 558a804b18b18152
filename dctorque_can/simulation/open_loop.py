"""The paper's two driveline models driven open loop, by what a gearbox control unit knows: its own commands.

Both are the mechanism of engine, damper, two input shafts, output shaft and car, with two clutches. In the
*conventional* one (1)–(11) an engaged gear is rigid, so both input shafts and the output shaft turn as one body;
in the *compliant* one (12)–(17) a transfer shaft stands in between. Nothing is fed back: nominal engine torque,
actuator positions, gear commands, brake and grade go in, speeds and torques come out. One thing more is taken from
the car: when a gear is in.

Neither has the reference plant's tyre, and all losses of gears and final drive sit in one factor at the output
shaft. Both share one physical output shaft: k_o of (17), which is k_o/i_f² where (10) has it, before the final
drive.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.simulation.mechanism import (
    FREE,
    STUCK,
    Floats,
    Loads,
    Mechanism,
    Motion,
    Scratch,
    new_loads,
    new_motion,
    new_scratch,
    phase_of,
    spring_torque,
)
from dctorque_can.simulation.plant import capacity
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, Parameters, Powertrain, parameters
from dctorque_can.simulation.stick_slip import advance

ENGINE, DAMPER, SHAFT1, SHAFT2, OUTPUT, CAR = range(6)
TWIST_DAMPER, TWIST_TRANSFER1, TWIST_TRANSFER2, TWIST_OUTPUT, DRAG1, DRAG2, AIR = range(7)
CLUTCH1, CLUTCH2, MESH1, MESH2, ROAD = range(5)
_MASSLESS = 1e-9  # kg·m²; (3) has no J_o
_RIGID = 1e6  # N·m, more than any gear carries
_SUBSTEPS = 10
_PERIOD = 1e-3


class DrivelineModel(IntEnum):
    """Which of the paper's models."""

    CONVENTIONAL = 0  # lumped, section 2.1
    COMPLIANT = 1  # transfer shafts, section 2.2


MODELLED = np.dtype(
    [
        ("t_us", "i8"),
        ("engine_speed_rad_s", "f8"),
        ("damper_speed_rad_s", "f8"),
        ("shaft1_speed_rad_s", "f8"),
        ("shaft2_speed_rad_s", "f8"),
        ("output_speed_rad_s", "f8"),
        ("wheel_speed_rad_s", "f8"),
        ("clutch1_torque_nm", "f8"),
        ("clutch2_torque_nm", "f8"),
        ("transfer1_torque_nm", "f8"),  # T_t1, behind the gear; conventional: what the rigid gear carries
        ("transfer2_torque_nm", "f8"),
        ("output_torque_nm", "f8"),  # T_o of (17), after the final drive
        ("phase1", "u1"),
        ("phase2", "u1"),
    ],
    align=True,
)
"""One instant of a model, one row per millisecond."""


def run_open_loop(
    vehicle: Vehicle,
    model: DrivelineModel,
    truth: NDArray[np.void],
    powertrain: Powertrain = DEMO_POWERTRAIN,
    payload_kg: float = 0.0,
) -> NDArray[np.void]:
    """Run a model from the state of the first row of a drive, on the drive's inputs alone.

    Args:
        vehicle: parameters of both models.
        model: which one.
        truth: `TRUTH` ``[n]``, 1 ms apart. Read of every row: nominal engine torque, actuator positions, gears and
            gear commands, brake, grade. Read of the first rows only: speeds and torques, for the initial state.
        powertrain: gives the actuators' capacity and the synchronisers.
        payload_kg: on top of the vehicle's mass.

    Returns:
        `MODELLED` ``[n]`` at the times of ``truth``.
    """
    p = parameters(vehicle, powertrain, payload_kg)
    mechanism = _mechanism(p, model)
    motion = _initial(p, mechanism, model, truth)
    rows = np.zeros(len(truth), MODELLED)
    rows["t_us"] = truth["t_us"]
    _run(
        p,
        model == DrivelineModel.COMPLIANT,
        mechanism,
        motion,
        new_loads(6, 5),
        new_scratch(6, 7, 5),
        truth,
        rows,
    )
    return rows


def _mechanism(p: Parameters, model: DrivelineModel) -> Mechanism:
    """Return the model with both shafts in neutral."""
    speed = np.zeros((7, 6))
    speed[TWIST_DAMPER, [ENGINE, DAMPER]] = 1.0, -1.0
    speed[TWIST_OUTPUT, [OUTPUT, CAR]] = 1.0, -1.0
    speed[DRAG1, [DAMPER, SHAFT1]] = 1.0, -1.0
    speed[DRAG2, [DAMPER, SHAFT2]] = 1.0, -1.0
    speed[AIR, CAR] = 1.0
    contact = np.zeros((5, 6))
    contact[CLUTCH1, [DAMPER, SHAFT1]] = 1.0, -1.0
    contact[CLUTCH2, [DAMPER, SHAFT2]] = 1.0, -1.0
    contact[ROAD, CAR] = 1.0
    J_o = p.J_o if model is DrivelineModel.COMPLIANT else _MASSLESS
    J_v = p.mass * p.r_w**2 + p.J_w + p.J_w_undriven
    return Mechanism(
        mass=np.array([p.J_e, p.J_d, p.J_shaft[0], p.J_shaft[1], J_o, J_v]),
        spring_speed=speed,
        spring_torque=speed.copy(),
        stiffness=np.array([p.k_d, 0.0, 0.0, p.k_o, 0.0, 0.0, 0.0]),
        damping=np.array([p.b_d, 0.0, 0.0, p.b_o, p.drag[0], p.drag[1], 0.0]),
        leak=np.zeros(7),
        contact=contact,
    )


@compiled
def set_gear(p: Parameters, compliant: bool, mechanism: Mechanism, shaft: int, gear: int) -> None:
    """Put ``gear`` (0: neutral) in on a shaft: a transfer shaft, or the lever arms of a rigid mesh."""
    ratio, final = p.ratio[gear], p.final_drive[gear]
    if compliant:
        spring = TWIST_TRANSFER1 + shaft
        engaged = gear != 0
        mechanism.stiffness[spring] = p.k_t[shaft] if engaged else 0.0
        mechanism.damping[spring] = p.b_t[shaft] if engaged else 0.0
        mechanism.spring_speed[spring, SHAFT1 + shaft] = 1.0 / ratio if engaged else 0.0  # (15), (16)
        mechanism.spring_speed[spring, OUTPUT] = -final
        mechanism.spring_torque[spring] = mechanism.spring_speed[spring]
    elif gear != 0:
        _set_mesh(mechanism, shaft, ratio * final)


@compiled
def _set_mesh(mechanism: Mechanism, shaft: int, total: float) -> None:
    mechanism.contact[MESH1 + shaft, SHAFT1 + shaft] = 1.0
    mechanism.contact[MESH1 + shaft, OUTPUT] = -total


def _initial(p: Parameters, mechanism: Mechanism, model: DrivelineModel, truth: NDArray[np.void]) -> Motion:
    """Return the state of the first row: its speeds, and the twists that carry its torques."""
    row = truth[0]
    motion = new_motion(6, 7, 5)
    names = ("engine", "damper", "shaft1", "shaft2", "output", "wheel")
    motion.speed[:] = [row[f"{name}_speed_rad_s"] for name in names]
    motion.mode[:] = FREE
    T_d = row["engine_torque_nm"] - p.J_e * _rate(truth, "engine_speed_rad_s")
    motion.twist[TWIST_DAMPER] = (T_d - p.b_d * (motion.speed[ENGINE] - motion.speed[DAMPER])) / p.k_d
    motion.twist[TWIST_OUTPUT] = (
        row["output_torque_nm"] - p.b_o * (motion.speed[OUTPUT] - motion.speed[CAR])
    ) / p.k_o
    for shaft in range(2):
        name = f"shaft{shaft + 1}_speed_rad_s"
        clutch_torque = row[f"clutch{shaft + 1}_torque_nm"]
        motion.torque[CLUTCH1 + shaft] = clutch_torque - p.drag[shaft] * (
            motion.speed[DAMPER] - motion.speed[SHAFT1 + shaft]
        )
        gear = int(row[f"gear{shaft + 1}"])
        set_gear(p, model == DrivelineModel.COMPLIANT, mechanism, shaft, gear)
        if row[f"phase{shaft + 1}"] == ClutchPhase.LOCKED:
            motion.mode[CLUTCH1 + shaft] = STUCK
            motion.speed[SHAFT1 + shaft] = motion.speed[DAMPER]
        if gear == 0:
            continue
        torque = clutch_torque - p.J_shaft[shaft] * _rate(truth, name)  # (12), (13): T_ti/i_ti
        if model is DrivelineModel.COMPLIANT:
            rate = motion.speed[SHAFT1 + shaft] / p.ratio[gear] - p.final_drive[gear] * motion.speed[OUTPUT]
            motion.twist[TWIST_TRANSFER1 + shaft] = (p.ratio[gear] * torque - p.b_t[shaft] * rate) / p.k_t[shaft]
        else:  # one body: its parts turn at exactly one speed, that of the driven wheels' side
            motion.mode[MESH1 + shaft] = STUCK
            motion.torque[MESH1 + shaft] = torque
            motion.speed[SHAFT1 + shaft] = p.ratio[gear] * p.final_drive[gear] * motion.speed[OUTPUT]
            if row[f"phase{shaft + 1}"] == ClutchPhase.LOCKED:
                motion.speed[DAMPER] = motion.speed[SHAFT1 + shaft]
    return motion


def _rate(truth: NDArray[np.void], name: str) -> float:
    """Return the derivative of a column at its start."""
    if len(truth) < 2:
        return 0.0
    return float((truth[name][1] - truth[name][0]) / ((truth["t_us"][1] - truth["t_us"][0]) * 1e-6))


@compiled
def _record(
    compliant: bool, p: Parameters, mechanism: Mechanism, motion: Motion, gears: NDArray[np.int64], row: Any
) -> None:
    w = motion.speed
    row.engine_speed_rad_s = w[ENGINE]
    row.damper_speed_rad_s = w[DAMPER]
    row.shaft1_speed_rad_s = w[SHAFT1]
    row.shaft2_speed_rad_s = w[SHAFT2]
    row.output_speed_rad_s = w[OUTPUT]
    row.wheel_speed_rad_s = w[CAR]
    row.clutch1_torque_nm = motion.torque[CLUTCH1] + spring_torque(mechanism, motion, DRAG1)
    row.clutch2_torque_nm = motion.torque[CLUTCH2] + spring_torque(mechanism, motion, DRAG2)
    if compliant:
        row.transfer1_torque_nm = spring_torque(mechanism, motion, TWIST_TRANSFER1)
        row.transfer2_torque_nm = spring_torque(mechanism, motion, TWIST_TRANSFER2)
    else:
        row.transfer1_torque_nm = p.ratio[gears[0]] * motion.torque[MESH1]
        row.transfer2_torque_nm = p.ratio[gears[1]] * motion.torque[MESH2]
    row.output_torque_nm = spring_torque(mechanism, motion, TWIST_OUTPUT)
    row.phase1 = phase_of(motion.mode[CLUTCH1])
    row.phase2 = phase_of(motion.mode[CLUTCH2])


@compiled
def _run(
    p: Parameters,
    compliant: bool,
    mechanism: Mechanism,
    motion: Motion,
    loads: Loads,
    scratch: Scratch,
    truth: NDArray[np.void],
    rows: NDArray[np.void],
) -> None:
    gears = np.zeros(2, np.int64)
    gears[0], gears[1] = truth[0].gear1, truth[0].gear2
    sleeve = np.zeros(2)  # s on the way to the cone
    cone = np.zeros(2)  # its torque, on the input shaft
    efficiency = p.gear_efficiency * p.final_drive_efficiency
    n = len(rows)
    for k in range(n):
        _record(compliant, p, mechanism, motion, gears, rows[k])
        if k + 1 == n:
            break
        now, later = truth[k], truth[k + 1]
        for shaft in range(2):
            gear = now.gear1 if shaft == 0 else now.gear2
            goal = now.gear1_command if shaft == 0 else now.gear2_command
            if gear != gears[shaft]:
                gears[shaft] = gear
                sleeve[shaft] = cone[shaft] = 0.0
                motion.twist[TWIST_TRANSFER1 + shaft] = 0.0
                set_gear(p, compliant, mechanism, shaft, gear)
            if gear != 0:
                torque = 0.0 if compliant else _RIGID
            else:
                _synchronise(p, mechanism, motion, sleeve, cone, shaft, goal)
                torque = cone[shaft]
            loads.kinetic[:, MESH1 + shaft] = torque
            loads.static[:, MESH1 + shaft] = torque * p.cone_static_ratio
        for j in range(_SUBSTEPS):
            for end in range(2):
                x = (j + end) / _SUBSTEPS
                _load(p, now, later, x, end, loads)
            driving = spring_torque(mechanism, motion, TWIST_OUTPUT) >= 0.0
            mechanism.spring_torque[TWIST_OUTPUT, OUTPUT] = 1.0 / efficiency if driving else efficiency
            mechanism.damping[AIR] = p.air * p.r_w**3 * abs(motion.speed[CAR])  # (11)
            advance(mechanism, motion, loads, _PERIOD / _SUBSTEPS, scratch)


@compiled
def _synchronise(
    p: Parameters, mechanism: Mechanism, motion: Motion, sleeve: Floats, cone: Floats, shaft: int, goal: int
) -> None:
    """Move a sleeve to the cone of the gear asked for and press it as hard as the reference plant does."""
    if goal == 0:
        cone[shaft] = 0.0
        return
    total = p.ratio[goal] * p.final_drive[goal]
    if mechanism.contact[MESH1 + shaft, OUTPUT] != -total:
        _set_mesh(mechanism, shaft, total)
        motion.mode[MESH1 + shaft] = FREE  # whatever stuck before, it was another gear
        sleeve[shaft] = cone[shaft] = 0.0
    sleeve[shaft] += _PERIOD
    if sleeve[shaft] >= p.sleeve_time and cone[shaft] == 0.0:
        distance = abs(motion.speed[SHAFT1 + shaft] - total * motion.speed[OUTPUT])
        cone[shaft] = min(p.cone_max, max(1.0, mechanism.mass[SHAFT1 + shaft] * distance / p.cone_time))


@compiled
def _load(p: Parameters, now: Any, later: Any, x: float, end: int, loads: Loads) -> None:
    """Set the loads of one end of a step at ``x`` between two rows."""
    loads.force[end, ENGINE] = now.engine_torque_nominal_nm + x * (
        later.engine_torque_nominal_nm - now.engine_torque_nominal_nm
    )
    grade = now.grade_rad + x * (later.grade_rad - now.grade_rad)
    loads.force[end, CAR] = -p.r_w * p.weight * np.sin(grade)  # (11): grade here, the rest as friction and damping
    hold = p.r_w * (p.rolling * p.weight * np.cos(grade) + now.brake_n + x * (later.brake_n - now.brake_n))
    loads.kinetic[end, ROAD] = hold
    loads.static[end, ROAD] = hold
    position = now.clutch1_position_mm + x * (later.clutch1_position_mm - now.clutch1_position_mm)
    loads.kinetic[end, CLUTCH1] = capacity(p, 0, position)  # (8)
    position = now.clutch2_position_mm + x * (later.clutch2_position_mm - now.clutch2_position_mm)
    loads.kinetic[end, CLUTCH2] = capacity(p, 1, position)  # (9)
    for i in range(2):
        loads.static[end, CLUTCH1 + i] = p.static_ratio[i] * loads.kinetic[end, CLUTCH1 + i]
