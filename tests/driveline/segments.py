"""Smooth pieces of a drive, integrated with the equations under test: no clutch changes its phase or sign."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from dctorque_can.config.load import load_config
from dctorque_can.driveline import compliant, conventional
from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
PAPER, DESIGN = SETTINGS.vehicle, SETTINGS.observer
AVANTE = load_config(shipped_config("avante_dct7")).settings.vehicle
SECONDS = 0.3
TIGHT = {"method": "Radau", "rtol": 1e-9, "atol": 1e-9}
GRADE = 0.05
BODIES = 6  # engine, damper, input shafts 1 and 2, output shaft, wheel: angles, then speeds, in the state


@dataclass(frozen=True)
class Segment:
    """A vehicle with two gears; ``locked`` is the clutch that sticks, 0 for none."""

    vehicle: Vehicle
    gears: tuple[int, int]
    locked: int
    T_c: tuple[float, float]  # mean capacities; that of the locked clutch is not used
    slip: float = 0.0  # of the engine over the faster shaft, when none is locked
    wheel: float = 15.0  # rad/s

    @property
    def pair(self) -> GearPair:
        return GearPair.of(self.vehicle, *self.gears)

    def engine_torque(self, t):
        return 120.0 + 40.0 * np.sin(15.0 * t)

    def capacity(self, clutch, t):
        return self.T_c[clutch - 1] * (1.0 + 0.3 * np.sin(20.0 * t + clutch))

    def speeds(self):
        """Return the speeds [6] of an untwisted start."""
        w_c = np.array([self.pair.R_1, self.pair.R_2]) * self.wheel
        w_d = w_c[self.locked - 1] if self.locked else w_c.max() + self.slip
        return np.array([w_d, w_d, *w_c, self.wheel, self.wheel])

    def stiffened(self, factor):
        """The same car with transfer shafts ``factor`` as stiff, equally damped in proportion."""
        shafts = tuple(
            replace(
                shaft,
                transfer_stiffness_nm_per_rad=factor * shaft.transfer_stiffness_nm_per_rad,
                transfer_damping_nms_per_rad=factor**0.5 * shaft.transfer_damping_nms_per_rad,
            )
            for shaft in self.vehicle.shafts
        )
        return replace(self, vehicle=replace(self.vehicle, shafts=shafts))


SEGMENTS = {
    "paper, 1 locked": Segment(PAPER, (1, 2), 1, (0.0, 60.0)),
    "paper, 2 locked": Segment(PAPER, (1, 2), 2, (30.0, 0.0)),
    "paper, both slip": Segment(PAPER, (3, 2), 0, (50.0, 40.0), slip=120.0),
    "avante, 1 locked": Segment(AVANTE, (1, 2), 1, (0.0, 60.0)),
    "avante, 2 locked": Segment(AVANTE, (3, 2), 2, (40.0, 0.0)),
    "avante, both slip": Segment(AVANTE, (3, 2), 0, (50.0, 40.0), slip=120.0),
}


def compliant_torques(s: Segment, t, y):
    """Return (T_d, T_t1, T_t2, T_o, T_v, T_c1, T_c2) of section 2.2 at time ``t`` and state ``y`` [12, …]."""
    v, p = s.vehicle, s.pair
    th_e, th_d, th_1, th_2, th_o, th_w, w_e, w_d, w_1, w_2, w_o, w_w = y[: 2 * BODIES]
    damper, (one, two), shaft = v.damper, v.shafts, v.output_shaft
    T_d = conventional.damper_torque(
        th_e - th_d, w_e, w_d, damper.stiffness_nm_per_rad, damper.damping_nms_per_rad
    )
    T_t1, T_t2 = (
        compliant.transfer_shaft_torque(
            th / i_t - i_f * th_o,
            w,
            w_o,
            i_t,
            i_f,
            side.transfer_stiffness_nm_per_rad,
            side.transfer_damping_nms_per_rad,
        )
        for th, w, i_t, i_f, side in ((th_1, w_1, p.i_t1, p.i_f1, one), (th_2, w_2, p.i_t2, p.i_f2, two))
    )
    T_o = compliant.output_torque(th_o - th_w, w_o, w_w, shaft.stiffness_nm_per_rad, shaft.damping_nms_per_rad)
    T_v = conventional.road_load(v.chassis, GRADE, w_w)
    T_c1 = conventional.slipping_clutch_torque(s.capacity(1, t), w_d - w_1)
    T_c2 = conventional.slipping_clutch_torque(s.capacity(2, t), w_d - w_2)
    # A locked clutch: both of its sides accelerate alike.
    J_d = damper.inertia_kgm2
    if s.locked == 1:
        T_c1 = (p.J_1 * (T_d - T_c2) + J_d * T_t1 / p.i_t1) / (J_d + p.J_1)
    if s.locked == 2:
        T_c2 = (p.J_2 * (T_d - T_c1) + J_d * T_t2 / p.i_t2) / (J_d + p.J_2)
    return T_d, T_t1, T_t2, T_o, T_v, T_c1, T_c2


def compliant_accelerations(s: Segment, t, y):
    """Return the accelerations [6] or [6, n] by (1), (2), (12)–(14), (17)."""
    v, p = s.vehicle, s.pair
    T_d, T_t1, T_t2, T_o, T_v, T_c1, T_c2 = compliant_torques(s, t, y)
    return np.array(
        [
            conventional.engine_acceleration(s.engine_torque(t), T_d, v.engine_inertia_kgm2),
            conventional.damper_acceleration(T_d, T_c1, T_c2, v.damper.inertia_kgm2),
            compliant.input_shaft_acceleration(T_c1, T_t1, p.i_t1, p.J_1),
            compliant.input_shaft_acceleration(T_c2, T_t2, p.i_t2, p.J_2),
            compliant.output_shaft_acceleration(T_t1, T_t2, T_o, p, v.output_shaft.inertia_kgm2),
            compliant.wheel_acceleration(T_o, T_v, v.chassis.inertia_kgm2),
        ]
    )


def lumped_torques(s: Segment, t, y, pair: GearPair | None = None):
    """Return (T_d, T_o, T_v, T_c1, T_c2) of section 2.1, T_o before final drive 1.

    State: angles of engine, damper, input shaft 1 and wheel, then their speeds.
    """
    v, p = s.vehicle, pair or s.pair
    th_e, th_d, th_1, th_w, w_e, w_d, w_1, w_w = y[:8]
    damper, shaft = v.damper, v.output_shaft
    T_d = conventional.damper_torque(
        th_e - th_d, w_e, w_d, damper.stiffness_nm_per_rad, damper.damping_nms_per_rad
    )
    k_o, b_o = (
        conventional.before_final_drive(x, p.i_f1) for x in (shaft.stiffness_nm_per_rad, shaft.damping_nms_per_rad)
    )
    T_o = conventional.output_torque(th_1 / p.i_t1 - p.i_f1 * th_w, w_1, w_w, p.i_t1, p.i_f1, k_o, b_o)
    T_v = conventional.road_load(v.chassis, GRADE, w_w)
    r = p.R_2 / p.R_1
    T_c1 = conventional.slipping_clutch_torque(s.capacity(1, t), w_d - w_1)
    T_c2 = conventional.slipping_clutch_torque(s.capacity(2, t), w_d - r * w_1)
    J_d = damper.inertia_kgm2
    if s.locked == 1:  # ω_d = ω_c1
        T_c1 = (p.J_e1 * (T_d - T_c2) - J_d * (r * T_c2 - T_o / p.i_t1)) / (J_d + p.J_e1)
    if s.locked == 2:  # ω_d = ω_c2
        T_o2 = T_o * p.i_f1 / p.i_f2
        T_c2 = (p.J_e2 * (T_d - T_c1) - J_d * (T_c1 / r - T_o2 / p.i_t2)) / (J_d + p.J_e2)
    return T_d, T_o, T_v, T_c1, T_c2


def lumped_accelerations(s: Segment, t, y, pair: GearPair | None = None):
    """Return the accelerations of engine, damper, input shaft 1 and wheel by (1)–(3), (5)."""
    v, p = s.vehicle, pair or s.pair
    T_d, T_o, T_v, T_c1, T_c2 = lumped_torques(s, t, y, p)
    return np.array(
        [
            conventional.engine_acceleration(s.engine_torque(t), T_d, v.engine_inertia_kgm2),
            conventional.damper_acceleration(T_d, T_c1, T_c2, v.damper.inertia_kgm2),
            conventional.input_shaft1_acceleration(T_c1, T_c2, T_o, p),
            conventional.wheel_acceleration(T_o, T_v, p.i_f1, v.chassis.inertia_kgm2),
        ]
    )


def integrate(right_hand_side, start, points=301):
    """Return times [n] and states [·, n] over one segment."""
    t = np.linspace(0.0, SECONDS, points)
    solution = solve_ivp(right_hand_side, (0.0, SECONDS), start, t_eval=t, **TIGHT)
    assert solution.success, solution.message
    return t, solution.y


@cache
def compliant_run(s: Segment):
    """Integrate section 2.2 from an untwisted start."""

    def right_hand_side(t, y):
        return np.concatenate((y[BODIES : 2 * BODIES], compliant_accelerations(s, t, y)))

    return integrate(right_hand_side, [*np.zeros(BODIES), *s.speeds()])


@cache
def lumped_run(s: Segment, pair: GearPair | None = None):
    """Integrate section 2.1 from an untwisted start."""

    def right_hand_side(t, y):
        return np.concatenate((y[4:8], lumped_accelerations(s, t, y, pair)))

    return integrate(right_hand_side, lumped_start(s))


def lumped_start(s: Segment):
    return [0.0, 0.0, 0.0, 0.0, *s.speeds()[[0, 1, 2, 5]]]
