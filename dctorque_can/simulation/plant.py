"""The compliant driveline of section 2.2 as a mechanism of masses, springs and dry friction.

Speeds: engine, damper secondary side, input shafts 1 and 2, output shaft, driven wheels, body (undriven wheels
roll with it). Contacts: both clutches, the cones of both synchronisers, and brake plus rolling resistance on the
body: against its motion in either direction, and holding at rest. Brakes act on the body as if all were on the
undriven wheels, whose grip has no limit. Gear losses depend on the direction of the power: on that of the torque,
and where the car goes backwards also on that of the motion. Bearings, seals and churning oil take
from input shafts and output shaft whatever the load is (`gears.spin_loss`).

The driven tyres have the friction of the road at most. Their deflection then grows as in Dahl's model of friction
(1968), which needs no speed of the car: it holds from standstill on, forwards and backwards.

On a road whose sides differ there are two driven wheels: an open differential without friction gives both the same
torque, the output shaft turns with their mean, and half their difference is one more speed with one more tyre.

A clutch has more or less of its capacity than its position says (`faults.Disturbances`): its friction may have
faded with the heat that it stores, its plates may run out of true, its kissing point may have moved.

The output shaft's own inertia is kept however small: the
integrator is L-stable, so neither a step limit nor a massless limit is needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.control import CONTROL, TORQUE, decide
from dctorque_can.simulation.driver import follow
from dctorque_can.simulation.engine import CRANKED, told_without_fire
from dctorque_can.simulation.faults import Disturbances
from dctorque_can.simulation.gears import change_gears, engage, set_losses, spin_loss
from dctorque_can.simulation.layout import (
    ACTUATION,
    AIR,
    BODY,
    CLUTCH1,
    CLUTCH2,
    CONE1,
    CONE2,
    DAMPER,
    DIFFERENCE,
    DRAG1,
    DRAG2,
    ENGINE,
    N_CONTACTS,
    N_SPRINGS,
    OUTPUT,
    PERIOD,
    ROAD,
    SHAFT1,
    SHAFT2,
    STEP,
    SUBSTEPS,
    TWIST_DAMPER,
    TWIST_OUTPUT,
    TWIST_TRANSFER1,
    TWIST_TRANSFER2,
    TYRE,
    TYRE_RIGHT,
    WHEEL,
    new_mechanism,
)
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

_TYRE_DAMPING_SPEED = 1.0  # m/s; a rolling tyre is damped by its slip, its own damping is for standstill


@compiled_without_allocation
def capacity(p: Parameters, clutch: int, position: float) -> float:
    """Return the kinetic torque capacity of a clutch at an actuator position in mm, N·m."""
    travel = min(1.0, max(0.0, (position - p.kiss) / (p.full - p.kiss)))
    return float(p.capacity_full[clutch] * travel**p.force_exponent)


@compiled_without_allocation
def position_for(p: Parameters, clutch: int, torque: float, ready: bool) -> float:
    """Return the position in mm that, for all the control knows, gives a capacity, or that of rest for none."""
    if torque <= 0.0:
        return p.ready if ready else 0.0
    share = min(1.0, torque / p.capacity_assumed[clutch])
    return float(p.kiss + (p.full - p.kiss) * share ** (1.0 / p.force_exponent))


@compiled_without_allocation
def _available(p: Parameters, a: Any, clutch: int, fraction: float) -> float:
    """Return the kinetic capacity of a clutch now, ``fraction`` into the millisecond, N·m."""
    factor = a.factor[clutch] + fraction * (a.next_factor[clutch] - a.factor[clutch])
    return float(a.friction[clutch] * factor * capacity(p, clutch, a.position[clutch] - a.kiss_shift[clutch]))


@compiled_without_allocation
def _heat(p: Parameters, motion: Motion, a: Any) -> None:
    """Store the heat of the last millisecond in both clutches and let their friction fade."""
    if p.fading <= 0.0:
        return
    for i in range(2):
        heat = motion.contact_heat[CLUTCH1 + i]
        a.stored[i] += heat - a.last_heat[i] - a.stored[i] * PERIOD / p.cooling
        a.last_heat[i] = heat
        a.friction[i] = 1.0 - p.fading * min(1.0, a.stored[i] / p.fading_heat)


@compiled_without_allocation
def _roll(p: Parameters, mechanism: Mechanism, motion: Motion, tyre: int, v: float, grip: float) -> None:
    """Let one of the driven tyres forget its deflection, by its way and by its slip.

    Args:
        p: parameters.
        mechanism: its leakage and damping are set.
        motion: of now.
        tyre: `TYRE`, or `TYRE_RIGHT` where there are two.
        v: speed of the car, m/s, not negative.
        grip: greatest force, N.
    """
    wheel = motion.speed[WHEEL]
    damping = p.tyre_damping
    if mechanism.stiffness.size > N_SPRINGS:
        damping *= 0.5
        wheel += motion.speed[DIFFERENCE] if tyre == TYRE else -motion.speed[DIFFERENCE]
    slip_speed = abs(p.r_w * wheel - motion.speed[BODY])
    used = abs(mechanism.stiffness[tyre] * motion.twist[tyre]) / grip
    mechanism.leak[tyre] = max(v / p.tyre_relaxation, slip_speed * mechanism.stiffness[tyre] / grip)
    mechanism.damping[tyre] = max(0.0, 1.0 - used) * damping / (1.0 + v / _TYRE_DAMPING_SPEED)


@compiled_without_allocation
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
    right: float = np.inf,
) -> None:
    """Advance the car by one millisecond under the commands in ``c``.

    ``friction`` is that of the driven tyres; of the left one if there are two, and ``right`` that of the other.
    """
    two = mechanism.stiffness.size > N_SPRINGS
    grip = friction * p.driven_load * np.cos(grade)
    if two:
        grip *= 0.5
    grip_right = 0.5 * right * p.driven_load * np.cos(grade)
    _heat(p, motion, a)
    engine_share = 1.0 - np.exp(-STEP / p.torque_lag) if c.engine_on else 1.0  # without fuel there is only drag
    actuator_share = 1.0 - np.exp(-STEP / p.actuator_lag)
    loses = False
    for k in range(3):
        loses |= p.spin_loss[k, 0] > 0.0 or p.spin_loss[k, 1] > 0.0
    gravity = -p.weight * np.sin(grade)
    hold = p.rolling * p.weight * np.cos(grade) + brake
    for step in range(SUBSTEPS):
        set_losses(p, mechanism, motion, a)
        v = abs(motion.speed[BODY])
        mechanism.damping[AIR] = p.air * v
        _roll(p, mechanism, motion, TYRE, v, grip)
        if two:
            _roll(p, mechanism, motion, TYRE_RIGHT, v, grip_right)
        loads.force[0, ENGINE] = a.T_e
        a.T_e += engine_share * (c.engine_command - a.T_e)
        loads.force[1, ENGINE] = a.T_e
        for end in range(2):
            loads.force[end, BODY] = gravity
            if loses:
                loads.force[end, SHAFT1] = -spin_loss(p, 0, motion.speed[SHAFT1])
                loads.force[end, SHAFT2] = -spin_loss(p, 1, motion.speed[SHAFT2])
                loads.force[end, OUTPUT] = -spin_loss(p, 2, motion.speed[WHEEL])  # its own rings: it is light
        for i in range(2):
            loads.kinetic[0, CLUTCH1 + i] = _available(p, a, i, step / SUBSTEPS)
            wanted = position_for(p, i, c.capacity[i], c.ready[i])
            a.position[i] += actuator_share * (wanted - a.position[i])
            loads.kinetic[1, CLUTCH1 + i] = _available(p, a, i, (step + 1) / SUBSTEPS)
            for end in range(2):
                loads.kinetic[end, CONE1 + i] = a.cone[i]
                loads.static[end, CLUTCH1 + i] = p.static_ratio[i] * loads.kinetic[end, CLUTCH1 + i]
                loads.static[end, CONE1 + i] = p.cone_static_ratio * a.cone[i]
        for end in range(2):
            loads.kinetic[end, ROAD] = loads.static[end, ROAD] = hold
        advance(mechanism, motion, loads, STEP, scratch)


@compiled_without_allocation
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
    row.engine_torque_nominal_nm = (
        a.T_e if c.engine_on and w[ENGINE] >= CRANKED else told_without_fire(p, w[ENGINE])
    )
    row.road_load_nm = p.r_w * (
        p.weight * np.sin(row.grade_rad) + motion.torque[ROAD] + p.air * w[BODY] * abs(w[BODY])
    )
    row.clutch1_position_mm = a.position[0]
    row.clutch2_position_mm = a.position[1]
    row.clutch1_command_nm = c.capacity[0]
    row.clutch2_command_nm = c.capacity[1]
    row.clutch1_capacity_nm = _available(p, a, 0, 0.0)
    row.clutch2_capacity_nm = _available(p, a, 1, 0.0)
    row.gear1 = a.engaged[0]
    row.gear2 = a.engaged[1]
    row.gear1_command = c.gear_command[0]
    row.gear2_command = c.gear_command[1]
    row.changing1 = a.changing[0]
    row.changing2 = a.changing[1]
    row.phase1 = phase_of(motion.mode[CLUTCH1])
    row.phase2 = phase_of(motion.mode[CLUTCH2])
    kinetic = 0.0
    for i in range(mechanism.mass.size):
        kinetic += 0.5 * mechanism.mass[i] * w[i] * w[i]
    elastic = 0.0
    for k in range(mechanism.stiffness.size):
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
    row.driveline_heat_j -= motion.work[SHAFT1] + motion.work[SHAFT2] + motion.work[OUTPUT]
    row.tyre_heat_j = motion.spring_heat[TYRE]
    if mechanism.stiffness.size > N_SPRINGS:
        row.wheel_difference_rad_s = w[DIFFERENCE]
        row.tyre_heat_j += motion.spring_heat[TYRE_RIGHT]
    row.road_heat_j = motion.contact_heat[ROAD] + motion.spring_heat[AIR]


@compiled_without_allocation
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
    faults: Disturbances,
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
        for i in range(2):
            a.factor[i], a.kiss_shift[i] = a.next_factor[i], faults.kiss_shift[k, i]
            a.next_factor[i] = faults.factor[k, i]
        record(p, mechanism, motion, a, c, row)
        c.lever = levers[k]
        c.engine_on = engines[k]
        decide(p, c, pedal, brake, motion.speed, a.T_e, motion.mode, a.engaged)
        if c.state >= TORQUE:
            for i in range(2):
                c.capacity[i] = max(c.capacity[i], faults.overlap[k])
        change_gears(p, mechanism, motion, a, c.gear_command)
        held = max(brake, c.hold_n)
        move(p, mechanism, motion, loads, scratch, a, c, held, grades[k], frictions[k], faults.right[k])


def new_state(
    p: Parameters, two_wheels: bool = False
) -> tuple[Mechanism, Motion, Loads, Scratch, np.ndarray[Any, Any], np.ndarray[Any, Any], Floats]:
    """Return a car at rest (engine idling, first gear in, the next preselected, brake held) and a calm driver."""
    mechanism = new_mechanism(p, two_wheels)
    sizes = (mechanism.mass.size, mechanism.stiffness.size, N_CONTACTS)
    motion = new_motion(*sizes)
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
    actuation["factor"] = actuation["next_factor"] = actuation["friction"] = 1.0
    loads = new_loads(sizes[0], N_CONTACTS)
    driver = np.zeros(3)  # the memory of `follow`, its last pedal and brake
    return mechanism, motion, loads, new_scratch(*sizes), actuation, control, driver
