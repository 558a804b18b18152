"""A tie-up: one clutch stays locked while the other is pressed against it, as an overlap that is too long does.

The drive for section 2.2's backward torque recirculation: what the slipping clutch carries beyond the engine's
torque comes back from the wheels through the locked one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.simulation.gears import engage
from dctorque_can.simulation.layout import BODY, CLUTCH1, DAMPER, ENGINE, OUTPUT, SHAFT1, SHAFT2, WHEEL
from dctorque_can.simulation.mechanism import FREE, STUCK, Floats, Loads, Mechanism, Motion, Scratch
from dctorque_can.simulation.plant import move, new_state, position_for, record
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, Parameters, Powertrain, parameters
from dctorque_can.simulation.truth import TRUTH

SETTLE_S = 1.0  # before the first row: the driveline winds up
_CLOSED = 2.0  # capacity of the locked clutch over the largest torque it may have to hold


def tie_up(
    vehicle: Vehicle,
    speed_m_s: float,
    engine_torque_nm: float,
    pressed_nm: float,
    press_at_s: float = 0.3,
    ramp_s: float = 0.1,
    release_at_s: float = 0.9,
    duration_s: float = 1.3,
    powertrain: Powertrain = DEMO_POWERTRAIN,
) -> NDArray[np.void]:
    """Drive in first gear on the level, clutch 1 locked, second gear in, and press clutch 2.

    Args:
        vehicle: the car.
        speed_m_s: at the first row.
        engine_torque_nm: constant net torque of the engine.
        pressed_nm: capacity that clutch 2 is commanded to from ``press_at_s`` on, within ``ramp_s``.
        press_at_s: see there.
        ramp_s: see there; its release takes as long.
        release_at_s: when clutch 2 is let go.
        duration_s: length.
        powertrain: of the reference plant.

    Returns:
        `TRUTH` ``[n]``, 1 ms apart, of the reference plant.
    """
    p = parameters(vehicle, powertrain, 0.0)
    n = round(duration_s * 1000) + 1
    settle = round(SETTLE_S * 1000)
    t = (np.arange(n + settle) - settle) / 1000.0
    pressed = np.interp(
        t,
        [press_at_s, press_at_s + ramp_s, release_at_s, release_at_s + ramp_s],
        [0.0, pressed_nm, pressed_nm, 0.0],
    )
    mechanism, motion, loads, scratch, actuation, control, _ = new_state(p)
    w_w = speed_m_s / p.r_w
    total = p.ratio * p.final_drive
    motion.speed[[OUTPUT, WHEEL]] = w_w
    motion.speed[BODY] = speed_m_s
    motion.speed[[ENGINE, DAMPER, SHAFT1]] = total[1] * w_w
    motion.speed[SHAFT2] = total[2] * w_w
    motion.mode[:] = FREE
    motion.mode[CLUTCH1] = STUCK
    locked = _CLOSED * (abs(engine_torque_nm) + pressed_nm)
    control["gear_command"] = actuation["engaged"]
    control["engine_command"] = actuation["T_e"] = engine_torque_nm
    actuation["position"][0, 0] = position_for(p, 0, locked, True)
    rows = np.zeros(n, TRUTH)
    _press(p, mechanism, motion, loads, scratch, actuation, control, locked, pressed, rows)
    rows["t_us"] = 1000 * np.arange(n)
    return rows


@compiled
def _press(
    p: Parameters,
    mechanism: Mechanism,
    motion: Motion,
    loads: Loads,
    scratch: Scratch,
    actuation: NDArray[np.void],
    control: NDArray[np.void],
    locked: float,
    pressed: Floats,
    rows: NDArray[np.void],
) -> None:
    a, c = actuation[0], control[0]
    first = pressed.size - rows.size
    for shaft in range(2):
        engage(p, mechanism, motion, a, shaft, a.engaged[shaft])
    for k in range(pressed.size):
        c.capacity[0] = locked
        c.capacity[1] = pressed[k]
        c.ready[1] = True
        if k >= first:
            record(p, mechanism, motion, a, c, rows[k - first])
        move(p, mechanism, motion, loads, scratch, a, c, 0.0, 0.0)
