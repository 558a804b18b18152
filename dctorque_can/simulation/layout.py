"""The parts of the simulated driveline by number, the mechanism they make, and its actuators."""

from __future__ import annotations

import numpy as np

from dctorque_can.simulation.mechanism import Mechanism
from dctorque_can.simulation.powertrain import Parameters

ENGINE, DAMPER, SHAFT1, SHAFT2, OUTPUT, WHEEL, BODY = range(7)
TWIST_DAMPER, TWIST_TRANSFER1, TWIST_TRANSFER2, TWIST_OUTPUT, TYRE, DRAG1, DRAG2, AIR = range(8)
CLUTCH1, CLUTCH2, CONE1, CONE2, ROAD = range(5)
N_SPEEDS, N_SPRINGS, N_CONTACTS = 7, 8, 5
DIFFERENCE, TYRE_RIGHT = N_SPEEDS, N_SPRINGS  # of a car with two driven wheels: one more of each

SUBSTEPS = 10
STEP = 1e-4
PERIOD = SUBSTEPS * STEP

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
        ("factor", "f8", (2,)),  # of the capacity, at the beginning of this millisecond
        ("next_factor", "f8", (2,)),  # … at its end
        ("kiss_shift", "f8", (2,)),  # mm, of the kissing point
        ("stored", "f8", (2,)),  # heat in the clutch, J
        ("last_heat", "f8", (2,)),
        ("friction", "f8", (2,)),  # share of the friction that the heat has left
    ],
    align=True,
)


def new_mechanism(p: Parameters, two_wheels: bool = False) -> Mechanism:
    """Return the driveline with both shafts in neutral; with two driven wheels, or with one for both."""
    more = 1 if two_wheels else 0
    n, s = N_SPEEDS + more, N_SPRINGS + more
    rates = np.zeros((s, n))
    rates[TWIST_DAMPER, [ENGINE, DAMPER]] = 1.0, -1.0
    rates[TWIST_OUTPUT, [OUTPUT, WHEEL]] = 1.0, -1.0
    rates[TYRE, [WHEEL, BODY]] = p.r_w, -1.0
    rates[DRAG1, [DAMPER, SHAFT1]] = 1.0, -1.0
    rates[DRAG2, [DAMPER, SHAFT2]] = 1.0, -1.0
    rates[AIR, BODY] = 1.0
    if two_wheels:
        rates[TYRE, DIFFERENCE] = p.r_w
        rates[TYRE_RIGHT, [WHEEL, BODY, DIFFERENCE]] = p.r_w, -1.0, -p.r_w
    contact = np.zeros((N_CONTACTS, n))
    contact[CLUTCH1, [DAMPER, SHAFT1]] = 1.0, -1.0
    contact[CLUTCH2, [DAMPER, SHAFT2]] = 1.0, -1.0
    contact[ROAD, BODY] = 1.0
    tyre_stiffness = p.slip_stiffness / p.tyre_relaxation / (1 + more)
    body = p.mass + p.J_w_undriven / p.r_w**2
    mass = [p.J_e, p.J_d, p.J_shaft[0], p.J_shaft[1], p.J_o, p.J_w, body]
    stiffness = [p.k_d, 0.0, 0.0, p.k_o, tyre_stiffness, 0.0, 0.0, 0.0]
    damping = [p.b_d, 0.0, 0.0, p.b_o, p.tyre_damping, p.drag[0], p.drag[1], 0.0]
    return Mechanism(
        mass=np.array(mass + more * [p.J_w]),  # ½ J_w (mean² + difference²) = ¼ J_w (left² + right²)
        spring_speed=rates,
        spring_torque=rates.copy(),
        stiffness=np.array(stiffness + more * [tyre_stiffness]),
        damping=np.array(damping + more * [p.tyre_damping]),
        leak=np.zeros(s),
        contact=contact,
    )
