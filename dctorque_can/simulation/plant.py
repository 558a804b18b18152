"""The compliant driveline of section 2.2 as a mechanism of masses, springs and dry friction.

Speeds: engine, damper secondary side, input shafts 1 and 2, output shaft, driven wheels, body (undriven wheels
roll with it). Contacts: both clutches, the cones of both synchronisers, and brake plus rolling resistance on the
body: against its motion in either direction, and holding at rest. Brakes act on the body as if all were on the
undriven wheels, whose grip has no limit. Gear losses depend on the direction of the power: on that of the torque,
and where the car goes backwards also on that of the motion.

The driven tyres have the friction of the road at most. Their deflection then grows as in Dahl's model of friction
(1968), which needs no speed of the car: it holds from standstill on, forwards and backwards.

A synchroniser is a cone clutch between an input shaft and the output shaft (times the gear's total ratio); the
gear is engaged only once the cone sticks, so momentum is conserved and nothing is ever set to a speed. The
transfer shaft's spring starts untwisted then. The output shaft's own inertia is kept however small: the
integrator is L-stable, so neither a step limit nor a massless limit is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.simulation.control import CONTROL, decide
from dctorque_can.simulation.driver import follow
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
from dctorque_can.simulation.powertrain import Parameters
from dctorque_can.simulation.stick_slip import advance

ENGINE, DAMPER, SHAFT1, SHAFT2, OUTPUT, WHEEL, BODY = range(7)
TWIST_DAMPER, TWIST_TRANSFER1, TWIST_TRANSFER2, TWIST_OUTPUT, TYRE, DRAG1, DRAG2, AIR = range(8)
CLUTCH1, CLUTCH2, CONE1, CONE2, ROAD = range(5)
N_SPEEDS, N_SPRINGS, N_CONTACTS = 7, 8, 5

SUBSTEPS = 10
STEP = 1e-4
PERIOD = SUBSTEPS * STEP

_BACKWARDS = 0.01  # m/s
_LOSSES_TURN = 0.1  # rad/s of the output shaft, on either side of zero: within, the losses fade and turn round
_TYRE_DAMPING_SPEED = 1.0  # m/s; a rolling tyre is damped by its slip, its own damping is for standstill

ACTUATION = np.dtype(
    [
        ("T_e", "f8"),
        ("position", "f8", (2,)),
        ("engaged", "i8", (2,)),  # gear per shaft, 0 neutral
        ("changing", "u1", (2,)),
        ("target", "i8", (2,)),
        ("sleeve", "f8", (2,)),  # s on the way to the cone
        ("cone", "f8", (2,)),  # kinetic torque of the cone, on the input shaft
        ("went_back", "u1"),  # the car has gone backwards
        ("lost_j", "f8"),  # twist let go when a gear was disengaged
    ],
    align=True,
)


def new_mechanism(p: Parameters) -> Mechanism:
    """Return the driveline with both shafts in neutral."""
    rates = np.zeros((N_SPRINGS, N_SPEEDS))
    rates[TWIST_DAMPER, [ENGINE, DAMPER]] = 1.0, -1.0
    rates[TWIST_OUTPUT, [OUTPUT, WHEEL]] = 1.0, -1.0
    rates[TYRE, [WHEEL, BODY]] = p.r_w, -1.0
    rates[DRAG1, [DAMPER, SHAFT1]] = 1.0, -1.0
    rates[DRAG2, [DAMPER, SHAFT2]] = 1.0, -1.0
    rates[AIR, BODY] = 1.0
    contact = np.zeros((N_CONTACTS, N_SPEEDS))
    contact[CLUTCH1, [DAMPER, SHAFT1]] = 1.0, -1.0
    contact[CLUTCH2, [DAMPER, SHAFT2]] = 1.0, -1.0
    contact[ROAD, BODY] = 1.0
    tyre_stiffness = p.slip_stiffness / p.tyre_relaxation
    return Mechanism(
        mass=np.array(
            [p.J_e, p.J_d, p.J_shaft[0], p.J_shaft[1], p.J_o, p.J_w, p.mass + p.J_w_undriven / p.r_w**2]
        ),
        spring_speed=rates,
        spring_torque=rates.copy(),
        stiffness=np.array([p.k_d, 0.0, 0.0, p.k_o, tyre_stiffness, 0.0, 0.0, 0.0]),
        damping=np.array([p.b_d, 0.0, 0.0, p.b_o, p.tyre_damping, p.drag[0], p.drag[1], 0.0]),
        leak=np.zeros(N_SPRINGS),
        contact=contact,
    )


@compiled
def capacity(p: Parameters, clutch: int, position: float) -> float:
    """Return the kinetic torque capacity of a clutch at an actuator position in mm, N·m."""
    travel = min(1.0, max(0.0, (position - p.kiss) / (p.full - p.kiss)))
    return float(p.capacity_full[clutch] * travel**p.force_exponent)


@compiled
def position_for(p: Parameters, clutch: int, torque: float, ready: bool) -> float:
    """Return the position in mm that, for all the control knows, gives a capacity, or that of rest for none."""
    if torque <= 0.0:
        return p.ready if ready else 0.0
    share = min(1.0, torque / p.capacity_assumed[clutch])
    return float(p.kiss + (p.full - p.kiss) * share ** (1.0 / p.force_exponent))


@compiled
def engage(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any, shaft: int, gear: int) -> None:
    """Join a shaft to the output shaft through the transfer shaft of ``gear``, or let it go (gear 0)."""
    spring = TWIST_TRANSFER1 + shaft
    a.lost_j += 0.5 * mechanism.stiffness[spring] * motion.twist[spring] ** 2
    motion.twist[spring] = 0.0
    a.engaged[shaft] = gear
    rate_in = 1.0 / p.ratio[gear] if gear != 0 else 0.0
    mechanism.stiffness[spring] = p.k_t[shaft] if gear != 0 else 0.0
    mechanism.damping[spring] = p.b_t[shaft] if gear != 0 else 0.0
    mechanism.spring_speed[spring, SHAFT1 + shaft] = rate_in
    mechanism.spring_speed[spring, OUTPUT] = -p.final_drive[gear]


@compiled
def change_gears(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any, command: Any) -> None:
    """Move the sleeves: out of a gear, to the cone of the next, and in when the cone sticks.

    A gear is left only while its clutch has no capacity.
    """
    for shaft in range(2):
        cone = CONE1 + shaft
        if not a.changing[shaft]:
            if command[shaft] != a.engaged[shaft] and motion.mode[CLUTCH1 + shaft] == FREE:
                engage(p, mechanism, motion, a, shaft, 0)
                a.changing[shaft] = True
                a.target[shaft] = command[shaft]
                a.sleeve[shaft] = 0.0
            continue
        if a.target[shaft] != command[shaft]:
            a.target[shaft] = command[shaft]
            a.sleeve[shaft] = 0.0
            a.cone[shaft] = 0.0
        gear = a.target[shaft]
        a.sleeve[shaft] += PERIOD
        if a.sleeve[shaft] < p.sleeve_time:
            continue
        if gear == 0:
            a.changing[shaft] = False
            continue
        total = p.ratio[gear] * p.final_drive[gear]
        mechanism.contact[cone, SHAFT1 + shaft] = 1.0
        mechanism.contact[cone, OUTPUT] = -total
        if a.cone[shaft] == 0.0:
            distance = abs(motion.speed[SHAFT1 + shaft] - total * motion.speed[OUTPUT])
            wish = mechanism.mass[SHAFT1 + shaft] * distance / p.cone_time
            a.cone[shaft] = min(p.cone_max, max(1.0, wish))
        elif motion.mode[cone] == STUCK:
            engage(p, mechanism, motion, a, shaft, gear)
            a.cone[shaft] = 0.0
            a.changing[shaft] = False


@compiled
def _arms(p: Parameters, gear: int, driving: bool) -> tuple[float, float]:
    """Return the lever arms of input shaft and output shaft at the transfer shaft, losses included."""
    arm_in, arm_out = 1.0 / p.ratio[gear], p.final_drive[gear]
    if driving:
        return arm_in / p.gear_efficiency, arm_out * p.final_drive_efficiency
    return arm_in * p.gear_efficiency, arm_out / p.final_drive_efficiency


@compiled
def _losses(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any) -> None:
    """Set the lossy lever arms of both gears by the direction of their power (losses always against the flow).

    Until the car goes backwards for the first time the direction of the torque is enough.
    """
    if motion.speed[BODY] < -_BACKWARDS:
        a.went_back = True
    for shaft in range(2):
        gear = a.engaged[shaft]
        if gear == 0:
            mechanism.spring_torque[TWIST_TRANSFER1 + shaft, SHAFT1 + shaft] = 0.0
            mechanism.spring_torque[TWIST_TRANSFER1 + shaft, OUTPUT] = 0.0
            continue
        spring = TWIST_TRANSFER1 + shaft
        driving = spring_torque(mechanism, motion, spring) * p.ratio[gear] >= 0.0
        arm_in, arm_out = _arms(p, gear, driving)
        if a.went_back:
            forward = motion.speed[OUTPUT] if p.ratio[gear] > 0.0 else -motion.speed[OUTPUT]
            share = 0.5 - 0.5 * min(1.0, max(-1.0, forward / _LOSSES_TURN))
            other_in, other_out = _arms(p, gear, not driving)
            arm_in += share * (other_in - arm_in)
            arm_out += share * (other_out - arm_out)
        mechanism.spring_torque[spring, SHAFT1 + shaft] = arm_in
        mechanism.spring_torque[spring, OUTPUT] = -arm_out


@compiled
def move(
    p: Parameters,
    mechanism: Mechanism,
    motion: Motion,
    loads: Loads,
    scratch: Scratch,
    a: Any,
    c: Any,
    brake: float,
    grade: float,
    friction: float = np.inf,
) -> None:
    """Advance the car by one millisecond under the commands in ``c``; ``friction`` is that of the driven tyres."""
    grip = friction * p.driven_load * np.cos(grade)
    engine_share = 1.0 - np.exp(-STEP / p.torque_lag) if c.engine_on else 1.0  # without fuel there is only drag
    actuator_share = 1.0 - np.exp(-STEP / p.actuator_lag)
    gravity = -p.weight * np.sin(grade)
    hold = p.rolling * p.weight * np.cos(grade) + brake
    for _ in range(SUBSTEPS):
        _losses(p, mechanism, motion, a)
        v = abs(motion.speed[BODY])
        mechanism.damping[AIR] = p.air * v
        slip_speed = abs(p.r_w * motion.speed[WHEEL] - motion.speed[BODY])
        used = abs(mechanism.stiffness[TYRE] * motion.twist[TYRE]) / grip
        mechanism.leak[TYRE] = max(v / p.tyre_relaxation, slip_speed * mechanism.stiffness[TYRE] / grip)
        mechanism.damping[TYRE] = max(0.0, 1.0 - used) * p.tyre_damping / (1.0 + v / _TYRE_DAMPING_SPEED)
        loads.force[0, ENGINE] = a.T_e
        a.T_e += engine_share * (c.engine_command - a.T_e)
        loads.force[1, ENGINE] = a.T_e
        loads.force[:, BODY] = gravity
        for i in range(2):
            loads.kinetic[0, CLUTCH1 + i] = capacity(p, i, a.position[i])
            wanted = position_for(p, i, c.capacity[i], c.ready[i])
            a.position[i] += actuator_share * (wanted - a.position[i])
            loads.kinetic[1, CLUTCH1 + i] = capacity(p, i, a.position[i])
            loads.kinetic[:, CONE1 + i] = a.cone[i]
            for end in range(2):
                loads.static[end, CLUTCH1 + i] = p.static_ratio[i] * loads.kinetic[end, CLUTCH1 + i]
                loads.static[end, CONE1 + i] = p.cone_static_ratio * a.cone[i]
        loads.kinetic[:, ROAD] = hold
        loads.static[:, ROAD] = hold
        advance(mechanism, motion, loads, STEP, scratch)


@compiled
def record(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any, c: Any, row: Any) -> None:
    """Write the present state into one `TRUTH` record (time, pedal, brake and grade are the caller's)."""
    w = motion.speed
    row.engine_speed_rad_s = w[ENGINE]
    row.damper_speed_rad_s = w[DAMPER]
    row.shaft1_speed_rad_s = w[SHAFT1]
    row.shaft2_speed_rad_s = w[SHAFT2]
    row.output_speed_rad_s = w[OUTPUT]
    row.wheel_speed_rad_s = w[WHEEL]
    row.undriven_wheel_speed_rad_s = w[BODY] / p.r_w
    row.clutch1_torque_nm = motion.torque[CLUTCH1] + spring_torque(mechanism, motion, DRAG1)
    row.clutch2_torque_nm = motion.torque[CLUTCH2] + spring_torque(mechanism, motion, DRAG2)
    row.transfer1_torque_nm = spring_torque(mechanism, motion, TWIST_TRANSFER1)
    row.transfer2_torque_nm = spring_torque(mechanism, motion, TWIST_TRANSFER2)
    row.output_torque_nm = spring_torque(mechanism, motion, TWIST_OUTPUT)
    row.engine_torque_nm = a.T_e
    row.engine_torque_nominal_nm = a.T_e
    row.road_load_nm = p.r_w * (
        p.weight * np.sin(row.grade_rad) + motion.torque[ROAD] + p.air * w[BODY] * abs(w[BODY])
    )
    row.clutch1_position_mm = a.position[0]
    row.clutch2_position_mm = a.position[1]
    row.clutch1_command_nm = c.capacity[0]
    row.clutch2_command_nm = c.capacity[1]
    row.clutch1_capacity_nm = capacity(p, 0, a.position[0])
    row.clutch2_capacity_nm = capacity(p, 1, a.position[1])
    row.gear1 = a.engaged[0]
    row.gear2 = a.engaged[1]
    row.gear1_command = c.gear_command[0]
    row.gear2_command = c.gear_command[1]
    row.changing1 = a.changing[0]
    row.changing2 = a.changing[1]
    row.phase1 = phase_of(motion.mode[CLUTCH1])
    row.phase2 = phase_of(motion.mode[CLUTCH2])
    kinetic = 0.0
    for i in range(N_SPEEDS):
        kinetic += 0.5 * mechanism.mass[i] * w[i] * w[i]
    elastic = 0.0
    for k in range(N_SPRINGS):
        elastic += 0.5 * mechanism.stiffness[k] * motion.twist[k] ** 2
    row.kinetic_energy_j = kinetic
    row.elastic_energy_j = elastic
    row.engine_work_j = motion.work[ENGINE]
    row.grade_work_j = -motion.work[BODY]
    row.clutch1_heat_j = motion.contact_heat[CLUTCH1] + motion.spring_heat[DRAG1]
    row.clutch2_heat_j = motion.contact_heat[CLUTCH2] + motion.spring_heat[DRAG2]
    row.synchroniser_heat_j = motion.contact_heat[CONE1] + motion.contact_heat[CONE2]
    row.driveline_heat_j = a.lost_j + motion.spring_heat[TWIST_DAMPER] + motion.spring_heat[TWIST_OUTPUT]
    for shaft in range(2):
        row.driveline_heat_j += motion.spring_heat[TWIST_TRANSFER1 + shaft]
        row.driveline_heat_j += motion.gear_heat[TWIST_TRANSFER1 + shaft]
    row.tyre_heat_j = motion.spring_heat[TYRE]
    row.road_heat_j = motion.contact_heat[ROAD] + motion.spring_heat[AIR]


@compiled
def run(
    p: Parameters,
    mechanism: Mechanism,
    motion: Motion,
    loads: Loads,
    scratch: Scratch,
    actuation: Any,
    control: Any,
    driver: Floats,
    pedals: Floats,
    brakes: Floats,
    grades: Floats,
    frictions: Floats,
    levers: NDArray[np.int64],
    engines: NDArray[np.bool_],
    wanted_speed: Floats,
    rows: Any,
    start: int,
    end: int,
) -> None:
    """Simulate the milliseconds from ``start`` up to ``end`` of a drive of ``len(rows)``.

    Everything that lasts is in the state of `new_state`, so that pieces in a row give the same bits as one call.
    See `dctorque_can.simulation.drive.simulate`.
    """
    a = actuation[0]
    c = control[0]
    if start == 0:
        motion.torque[ROAD] = -p.weight * np.sin(grades[0])  # the brake holds the car from the first row on
        for shaft in range(2):
            engage(p, mechanism, motion, a, shaft, a.engaged[shaft])
    for k in range(start, end):
        row = rows[k]
        pedal, brake = pedals[k], brakes[k]
        if wanted_speed[k] >= 0.0:
            ahead = min(rows.size - 1, k + 500)
            aim, later = wanted_speed[k], wanted_speed[ahead]
            if later < 0.0:  # the pedals are given by then
                later = aim
            v = motion.speed[BODY]
            pedal, brake, memory = follow(p, aim, later, v, driver[0], driver[1], driver[2], PERIOD)
            driver[0], driver[1], driver[2] = memory, pedal, brake
        row.t_us = 1000 * k
        row.pedal = pedal
        row.grade_rad = grades[k]
        row.brake_n = max(brake, c.hold_n)
        record(p, mechanism, motion, a, c, row)
        c.lever = levers[k]
        c.engine_on = engines[k]
        decide(p, c, pedal, brake, motion.speed, a.T_e, motion.mode, a.engaged)
        change_gears(p, mechanism, motion, a, c.gear_command)
        held = max(brake, c.hold_n)
        move(p, mechanism, motion, loads, scratch, a, c, held, grades[k], frictions[k])


def new_state(
    p: Parameters,
) -> tuple[Mechanism, Motion, Loads, Scratch, np.ndarray[Any, Any], np.ndarray[Any, Any], Floats]:
    """Return a car at rest (engine idling, first gear in, the next preselected, brake held) and a calm driver."""
    mechanism = new_mechanism(p)
    motion = new_motion(N_SPEEDS, N_SPRINGS, N_CONTACTS)
    motion.speed[[ENGINE, DAMPER]] = p.idle
    motion.mode[:] = FREE
    motion.mode[ROAD] = STUCK
    actuation = np.zeros(1, ACTUATION)
    control = np.zeros(1, CONTROL)
    first = p.gear_shaft[1]
    actuation["engaged"][0, first] = 1
    actuation["engaged"][0, 1 - first] = 2
    control["gear"] = 1
    control["preselect"] = 2
    control["gear_command"] = actuation["engaged"]
    control["last_w_e"] = p.idle
    control["hold_n"] = 0.4 * p.weight
    control["holder"] = control["engine_on"] = True
    control["shifted"] = 10.0
    loads = new_loads(N_SPEEDS, N_CONTACTS)
    driver = np.zeros(3)  # the memory of `follow`, its last pedal and brake
    return mechanism, motion, loads, new_scratch(N_SPEEDS, N_SPRINGS, N_CONTACTS), actuation, control, driver
