"""The car of section 2.2 written as Lagrange's equations: the truth for the equations under test."""

from __future__ import annotations

import numpy as np

from .segments import BODIES, GRADE

ENGINE, DAMPER, SHAFT1, SHAFT2, OUTPUT, WHEEL = range(BODIES)


def matrices(s):
    """Return masses [6], spring directions [4, 6], stiffness [4] and damping [4] of the paper's figure."""
    v, p = s.vehicle, s.pair
    (one, two), shaft, damper = v.shafts, v.output_shaft, v.damper
    masses = [v.engine_inertia_kgm2, damper.inertia_kgm2, p.J_1, p.J_2, shaft.inertia_kgm2, v.chassis.inertia_kgm2]
    directions = np.zeros((4, BODIES))
    directions[0, [ENGINE, DAMPER]] = 1.0, -1.0
    directions[1, [SHAFT1, OUTPUT]] = 1.0 / p.i_t1, -p.i_f1
    directions[2, [SHAFT2, OUTPUT]] = 1.0 / p.i_t2, -p.i_f2
    directions[3, [OUTPUT, WHEEL]] = 1.0, -1.0
    sides = (one.transfer_stiffness_nm_per_rad, two.transfer_stiffness_nm_per_rad)
    losses = (one.transfer_damping_nms_per_rad, two.transfer_damping_nms_per_rad)
    stiffness = np.array([damper.stiffness_nm_per_rad, *sides, shaft.stiffness_nm_per_rad])
    damping = np.array([damper.damping_nms_per_rad, *losses, shaft.damping_nms_per_rad])
    return np.array(masses), directions, stiffness, damping


def road(s, w_w):
    """Resistance force of a car that rolls forward, times the wheel radius."""
    c = s.vehicle.chassis
    grade = c.mass_kg * 9.80665 * (np.sin(GRADE) + c.rolling_resistance * np.cos(GRADE))
    return c.wheel_radius_m * (
        grade + 0.5 * 1.2 * c.frontal_area_m2 * c.drag_coefficient * (c.wheel_radius_m * w_w) ** 2
    )


def lagrange(s, t, y):
    """Return accelerations [6, n] and both clutch torques [2, n]; a locked clutch is a constraint's multiplier."""
    masses, g, k, b = matrices(s)
    angles, speeds = y[:BODIES], y[BODIES : 2 * BODIES]
    force = -g.T @ (k[:, None] * (g @ angles) + b[:, None] * (g @ speeds))  # -∂V/∂q - ∂D/∂q̇
    force[ENGINE] += s.engine_torque(t)
    force[WHEEL] -= road(s, speeds[WHEEL])
    torque = np.zeros((2, len(t)))
    for i, shaft in enumerate((SHAFT1, SHAFT2)):
        if s.locked != i + 1:
            torque[i] = np.where(speeds[DAMPER] > speeds[shaft], 1.0, -1.0) * s.capacity(i + 1, t)
            force[DAMPER] -= torque[i]
            force[shaft] += torque[i]
    if not s.locked:
        return force / masses[:, None], torque
    system = np.diag([*masses, 0.0])
    side = SHAFT1 if s.locked == 1 else SHAFT2
    system[DAMPER, BODIES], system[side, BODIES] = 1.0, -1.0  # the multiplier is the clutch torque
    system[BODIES, DAMPER], system[BODIES, side] = 1.0, -1.0  # ω̇_d = ω̇_ci
    solved = np.linalg.solve(system, np.vstack((force, np.zeros(len(t)))))
    torque[s.locked - 1] = solved[BODIES]
    return solved[:BODIES], torque
