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
    solved = np.linalg.solve(constrained(s, masses), np.vstack((force, np.zeros(len(t)))))
    torque[s.locked - 1] = solved[BODIES]
    return solved[:BODIES], torque


def constrained(s, masses):
    """Return the matrix [7, 7] of accelerations and the multiplier that keeps a locked clutch together."""
    system = np.diag([*masses, 0.0])
    side = SHAFT1 if s.locked == 1 else SHAFT2
    system[DAMPER, BODIES], system[side, BODIES] = 1.0, -1.0  # the multiplier is the clutch torque
    system[BODIES, DAMPER], system[BODIES, side] = 1.0, -1.0  # ω̇_d = ω̇_ci
    return system


def rounding(s, t, y):
    """Return by how much rounding alone may part two ways to the inertia torques [6, n] and clutch torques [2, n].

    Angles of 100 rad times stiffnesses of 3e5 N·m/rad are 1e8 N·m that cancel to torques of some hundred: a sum is
    known to γ_k = k u / (1 − k u) of the sum of its absolute terms, u = 2⁻⁵³, where k is the number of roundings
    on the way of any term, in whatever order the terms are added (Higham, Accuracy and Stability of Numerical
    Algorithms, 2nd ed., section 3.1). With a locked clutch these errors go through the inverse of the matrix, with
    those of the elimination, γ_3n |L||U| (theorem 9.4); its pivots are the inertias, so that |L||U| is its size.
    """
    masses, g, k, b = matrices(s)
    angles, speeds = np.abs(y[:BODIES]), np.abs(y[BODIES : 2 * BODIES])
    terms = np.abs(g).T @ (k[:, None] * (np.abs(g) @ angles) + b[:, None] * (np.abs(g) @ speeds))
    terms[ENGINE] += np.abs(s.engine_torque(t))
    terms[WHEEL] += np.abs(road(s, speeds[WHEEL]))
    for i, shaft in enumerate((SHAFT1, SHAFT2)):
        if s.locked != i + 1:
            terms[[DAMPER, shaft]] += np.abs(s.capacity(i + 1, t))
    forces = gamma(LAGRANGE_ROUNDINGS + EQUATION_ROUNDINGS) * terms
    torques = np.zeros((2, len(t)))
    if not s.locked:
        return forces, torques
    system = np.abs(constrained(s, masses))
    inverse = np.abs(np.linalg.inv(constrained(s, masses)))
    largest = inverse @ np.vstack((terms, np.zeros(len(t))))
    errors = inverse @ (np.vstack((forces, np.zeros(len(t)))) + gamma(3 * len(system)) * system @ largest)
    torques[s.locked - 1] = errors[BODIES]
    inertia = masses[:, None] * errors[:BODIES]
    inertia[[DAMPER, SHAFT1 if s.locked == 1 else SHAFT2]] += errors[BODIES]  # the equations go by this torque
    return inertia, torques


LAGRANGE_ROUNDINGS = 18  # g twice 1, g q 6, k 1, + b 1, gᵀ 1 + 3, clutches and engine or road 3, / mass and back 2
EQUATION_ROUNDINGS = 12  # θ / i_t − i_f θ 2, k 1, + b 1, / i_t or i_f 1, three torques 2, / J and back 2, locked 3


def gamma(k):
    """Return γ_k of double precision."""
    return k * 2.0**-53 / (1.0 - k * 2.0**-53)
