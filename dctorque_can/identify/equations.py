"""What the equations of motion say at each moment of a recording, linear in what is not known.

Measured speeds and torques are smoothed by a Gaussian, and their rates are those of the smoothed ones: every term
of an equation is smoothed alike, so that the equation holds as it did before (a weak form, or modulating
functions: Preisig and Rippin, Computers and Chemical Engineering 17, 1993, 1). So what is fitted is what acts on
driving, not how a sensor shakes.

Why not the innovations of the Kalman filter? It is told to expect more than one car does, so that it never is too
sure. To its likelihood that is evidence: larger inertias let it expect less, and come out 20 % too large.

**Car**, while one clutch alone has the torque of the engine, slipping or not, and no brake is on:

    M ω̇_b = R (1 + g) T_en(t − lag) − R λ |T| − R J_E ω̇_e − R_1 J_1 ω̇_c1 − R_2 J_2 ω̇_c2 − r³ ρ C_d A ω_b²/2 − L

with R = i_t i_f, λ what gears lose of the torque T behind the clutch, J_E = J_e + J_d, M = m r² + J_w. What shafts
lose by spinning and the open clutch by its drag is taken off, as the file has it. L is
grade, wind and rolling: it walks (`regression`). Air drag grows while a car gathers speed, as if it had more mass.
The acceleration of the wheels has the most noise of all terms. So it is what the others are fitted to, times the M
that is believed; the share of that which fits is what is looked for. A noisy term among the others would be found
too small.

**Damper**, while clutch i is locked:  ω_e − ω_ci = (Ṫ_d − τ_d T̈_d)/k_d.

**Output**, while shaft i drives:      ω_ci/R − ω_w = c_g ω_w + Ṫ_o (1/k_o + 1/(k_ti i_f²)) − τ_o T̈_o/k_o.

**Wheels** of one axle:                ω_l − ω_r = c ω_b; curves to the left and to the right are alike.

τ = b/k is the time by which a twist follows its torque. A torque that is told late does the same; how late it is,
the car tells; and the torque of the shaft is that of the engine less its inertia, which is one of the unknowns.

**Tyres**:                             ω_w − ω_b = c ω_w + T_o ω_w/(r F).

Of what these leave out, two are set up with all that they have found:

**Free shaft**, out of gear and with its clutch open:  J_i ω̇_ci = −s_i − s'_i ω_ci + d_i (ω_e − ω_ci).

**Road**, while no brake is on:                        L = r m g (K_rr + slope) + r³ ρ C_d A ω_b²/2.

A signal that is late by x more than it is told has x times its rate too little. So the equations know the delays
as differences; of all together they know what was believed of each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import AIR_DENSITY, STANDARD_GRAVITY
from dctorque_can.evidence.moments import (
    RUNS_RAD_S,
    SHAFTS,
    STEP_S,
    WHEELS,
    Mask,
    Moments,
    lasting,
    smooth,
)
from dctorque_can.identify.drive import REACH, Drive, Floats, rate
from dctorque_can.pipeline.samples import Quantity

BLOCK_S, HILL_S = 4.0, 60.0
"""For how long errors hang together: those of the motion, and the slope of the road."""
SLOW_S, FAST_S = 0.08, 0.08
"""Standard deviations of the smoothing: of the car's motion, and of the twist of shafts."""
_ROLLS = 3.0  # rad/s at the wheel: slower ones are not measured well
_TURNS = 20.0  # rad/s of an input shaft, likewise
_MOST_LOSS = 3.0  # times what is believed of the losses of a free shaft; a synchroniser takes more


@dataclass(frozen=True, slots=True)
class Equations:
    """One kind of equation at several moments.

    Attributes:
        name: car, damper, output, tyres, wheels, free shaft or road.
        t_s: times ``[n]``, s.
        y: known side ``[n]``.
        columns: by the name of what is not known, what it is multiplied with ``[n]``.
        walks: whether what is left walks, as the load of the road does.
        block_s: for how long errors hang together at most, s.
    """

    name: str
    t_s: Floats
    y: Floats
    columns: dict[str, Floats]
    walks: bool = False
    block_s: float = BLOCK_S

    def __len__(self) -> int:
        return len(self.t_s)

    def at(self, rows: NDArray[np.intp] | Mask) -> Equations:
        """Return some of the equations."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return replace(self, t_s=self.t_s[rows], y=self.y[rows], columns=columns)


def _thinned(where: Mask, every_s: float) -> NDArray[np.intp]:
    """Return moments of a mask, so far apart that they tell new things."""
    step = max(round(every_s / STEP_S), 1)
    rows = np.flatnonzero(where)
    return np.asarray(rows[rows % step == 0], np.intp)


def _sum(*columns: dict[str, Floats]) -> dict[str, Floats]:
    """Return columns together; those of one name are added."""
    found: dict[str, Floats] = {}
    for each in columns:
        for name, column in each.items():
            found[name] = found[name] + column if name in found else column
    return found


@dataclass(frozen=True, slots=True)
class _Force:
    """What the engine leaves to the car, smoothed over `SLOW_S`.

    Attributes:
        total: torque at the wheel ``[n]``, N·m.
        torque_rate: of the engine ``[n]``, N·m/s.
        engine: acceleration of the engine ``[n]``, rad/s².
        shafts: accelerations of the input shafts ``[2][n]``, rad/s².
        geared: ratios of the gears that are in ``[2][n]``, 0 where there is none.
        behind: magnitude of the torque behind the clutch that has it ``[n]``, N·m.
    """

    total: Floats
    torque_rate: Floats
    engine: Floats
    shafts: list[Floats]
    geared: list[Floats]
    behind: Floats

    @classmethod
    def of(cls, drive: Drive) -> _Force:
        """Return it for a drive; without a clutch that has the torque, the shafts alone take from the car."""
        m, g, s = drive.m, drive.guess, SLOW_S
        torque, torque_rate, engine = smooth(m.torque, s), rate(m.torque, s), rate(m.engine, s)
        shafts = [rate(np.nan_to_num(m.shaft[i]), s) for i in range(2)]
        geared = [np.where(m.ratio[i] > 0.0, m.ratio[i], 0.0) for i in range(2)]
        row, i = np.arange(len(m.t_s)), np.maximum(drive.has, 0)
        behind = np.abs(drive.clutch_torque(s) - np.asarray(g.shaft_inertia_kgm2)[i] * np.stack(shafts)[i, row])
        total = drive.ratio * (torque - g.lag_s * torque_rate - g.loss * behind - g.engine_inertia_kgm2 * engine)
        output = m.vehicle.output_shaft
        total -= output.spin_loss_nm + output.spin_loss_nms_per_rad * smooth(m.wheels, s)
        for n in range(2):
            loss = g.spin_loss[n][0] + g.spin_loss[n][1] * np.abs(smooth(np.nan_to_num(m.shaft[n]), s))
            drag = np.where(drive.has == n, 0.0, g.drag[n] * smooth(m.engine - np.nan_to_num(m.shaft[n]), s))
            total -= geared[n] * (loss + g.shaft_inertia_kgm2[n] * shafts[n] - drag) + drive.ratio * drag
        return cls(total, torque_rate, engine, shafts, geared, behind)


def _air(drive: Drive) -> Floats:
    """Return the torque of air drag at the wheel over C_d A ``[n]``, N/m."""
    radius = drive.m.vehicle.chassis.wheel_radius_m
    return np.asarray(0.5 * AIR_DENSITY * radius**3 * smooth(drive.m.body, SLOW_S) ** 2, np.float64)


def car(drive: Drive) -> Equations:
    """Return the balance of the car."""
    m, s, chassis = drive.m, SLOW_S, drive.m.vehicle.chassis
    body, force, air = rate(m.body, s), _Force.of(drive), _air(drive)
    where = drive.steady(s) & lasting(m.free, REACH * s, REACH * s) & (smooth(m.wheels, s) > _ROLLS)
    rolling = [each for each in WHEELS if m.has(each) and (each in WHEELS[:2]) == drive.rolls_in_front]
    columns = _sum(
        {
            "car_share": force.total,
            "gain": drive.ratio * smooth(m.torque, s),
            "lag_s": -drive.ratio * force.torque_rate,
            "loss": -drive.ratio * force.behind,
            "air_m2": -air,
            "engine_inertia_kgm2": -drive.ratio * force.engine,
            "shaft1_inertia_kgm2": -force.geared[0] * force.shafts[0],
            "shaft2_inertia_kgm2": -force.geared[1] * force.shafts[1],
        },
        drive.late([Quantity.ENGINE_TORQUE], drive.ratio * force.torque_rate),
        drive.late(rolling, -drive.ratio * force.torque_rate),
    )
    y = (
        drive.guess.car_inertia_kgm2 * body
        - force.total
        + chassis.drag_coefficient * chassis.frontal_area_m2 * air
    )
    return _at(m, "car", where, 0.2, y, columns, walks=True)


def damper(drive: Drive) -> list[Equations]:
    """Return the twist of the damper, of each clutch that is locked."""
    m, g, found = drive.m, drive.guess, []
    primary = g.engine_inertia_kgm2 - g.damper_inertia_kgm2
    torque = rate(m.torque, FAST_S) - primary * np.gradient(rate(m.engine, FAST_S), STEP_S)
    engine, later = rate(m.engine, FAST_S), g.compliance[0] * np.gradient(rate(m.torque, FAST_S), STEP_S)
    twist = {
        "damper_compliance": torque,
        "damper_damping_s": -g.compliance[0] * np.gradient(torque, STEP_S),
        "lag_s": -later,
    }
    for i in range(2):
        if not m.has(SHAFTS[i]):
            continue
        where = drive.steady(FAST_S) & (drive.has == i) & lasting(m.locked[i], 0.2, 0.2)
        late = drive.late([SHAFTS[i]], engine), drive.late([Quantity.ENGINE_SPEED], -engine)
        y = smooth(m.engine - np.nan_to_num(m.shaft[i]), FAST_S)
        columns = _sum(twist, drive.late([Quantity.ENGINE_TORQUE], later), *late)
        found.append(_at(m, "damper", where, 0.04, y, columns))
    return found


def output(drive: Drive) -> list[Equations]:
    """Return the twist between each input shaft and the driven wheels."""
    m, found = drive.m, []
    if not m.measures_driven:
        return []
    twist = np.gradient(np.nan_to_num(drive.output_torque(FAST_S)), STEP_S)
    speed, acceleration = smooth(m.wheels, FAST_S), rate(m.wheels, FAST_S)
    compliance = drive.guess.compliance[1]
    later = compliance * drive.ratio * np.gradient(rate(m.torque, FAST_S), STEP_S)
    turning = compliance * drive.ratio * np.gradient(rate(m.engine, FAST_S), STEP_S)
    driven = [each for each in WHEELS if m.has(each) and (each in WHEELS[:2]) in m.driven_fronts]
    for i in range(2):
        for gear in m.vehicle.gears_on(i + 1) if m.has(SHAFTS[i]) else ():
            if gear.number < 0:
                continue
            where = drive.steady(FAST_S) & (drive.has == i) & np.isclose(drive.ratio, gear.total_ratio)
            where &= speed > _ROLLS
            columns = _sum(
                {
                    f"ratio_{gear.number}": speed,
                    "radius": -speed,
                    "output_compliance": twist,
                    f"transfer{i + 1}_compliance": twist / gear.final_drive**2,
                    "output_damping_s": -compliance * np.gradient(twist, STEP_S),
                    "lag_s": -later,
                    "engine_inertia_kgm2": -turning,
                },
                drive.late([Quantity.ENGINE_TORQUE], later),
                drive.late(driven, acceleration),
                drive.late([SHAFTS[i]], -acceleration),
            )
            y = smooth(np.nan_to_num(m.shaft[i]) / gear.total_ratio - m.wheels, FAST_S)
            found.append(_at(m, "output", where, 0.04, y, columns))
    return found


def tyres(drive: Drive) -> list[Equations]:
    """Return the slip of the driven wheels against the others."""
    m = drive.m
    if not m.knows_body or not m.measures_driven:
        return []
    where = drive.steady(SLOW_S) & lasting(m.free, 0.3, 0.3)
    speed, acceleration = smooth(m.wheels, SLOW_S), rate(m.body, SLOW_S)
    where &= speed > _ROLLS
    sides = [[w for w in WHEELS if m.has(w) and (w in WHEELS[:2]) == front] for front in (True, False)]
    rolling, driven = (sides[0], sides[1]) if drive.rolls_in_front else (sides[1], sides[0])
    columns = _sum(
        {"axles": speed, "slip_per_nm": speed * drive.output_torque(SLOW_S), "tyre_lag_s": acceleration},
        drive.late(rolling, acceleration),
        drive.late(driven, -acceleration),
    )
    return [_at(m, "tyres", where, 0.2, smooth(m.wheels - m.body, SLOW_S), columns)]


def pairs(drive: Drive) -> list[Equations]:
    """Return the difference of the wheels of each axle, which tells how late they come against each other."""
    m, found = drive.m, []
    speed, acceleration = smooth(m.body, SLOW_S), rate(m.body, SLOW_S)
    for name, (left, right) in (("front", WHEELS[:2]), ("rear", WHEELS[2:])):
        if m.has(left, right) and drive.message[left] != drive.message[right]:
            columns = _sum(
                {f"{name}_wheels": speed}, drive.late([left], -acceleration), drive.late([right], acceleration)
            )
            y = smooth(m.speed(left) - m.speed(right), SLOW_S)
            found.append(_at(m, "wheels", speed > _ROLLS, 0.2, y, columns))
    return found


def free_shafts(drive: Drive) -> list[Equations]:
    """Return what slows down or drags along each input shaft that is out of gear, with its clutch open."""
    m, g, found = drive.m, drive.guess, []
    for i in range(2):
        if not m.has(SHAFTS[i]):
            continue
        speed = smooth(m.shaft[i], SLOW_S)
        slip = smooth(m.engine, SLOW_S) - speed
        y = g.shaft_inertia_kgm2[i] * rate(m.shaft[i], SLOW_S)
        loss = g.spin_loss[i][0] + g.spin_loss[i][1] * np.abs(speed) + g.drag[i] * np.abs(slip)
        free = m.neutral[i] & (m.closed_told[i] == 0) & (np.abs(y) < _MOST_LOSS * loss)
        where = lasting(free, REACH * SLOW_S, REACH * SLOW_S) & (speed > _TURNS) & (m.engine > RUNS_RAD_S)
        columns = {
            f"spin{i + 1}_nm": -np.ones(len(y)),
            f"spin{i + 1}_nms_per_rad": -speed,
            f"drag{i + 1}_nms_per_rad": slip,
            f"shaft{i + 1}_share": -y,
        }
        found.append(_at(m, "free shaft", where, 0.04, y, columns))
    return found


def road(drive: Drive, name: str) -> Equations:
    """Return what the road takes while no brake is on, with the losses of what turns.

    Args:
        drive: a recording.
        name: how its mean slope is called among the unknowns.
    """
    m, s, chassis = drive.m, SLOW_S, drive.m.vehicle.chassis
    force, wheels = _Force.of(drive), smooth(m.wheels, s)
    sailing = lasting(drive.has == -1, REACH * s + 0.1, REACH * s + 0.1)
    where = (drive.steady(s) | sailing) & lasting(m.free, REACH * s, REACH * s) & (wheels > _ROLLS)
    inertia = drive.guess.car_inertia_kgm2 * rate(m.body, s)
    y = force.total - inertia
    weight = np.full(len(y), STANDARD_GRAVITY * chassis.mass_kg * chassis.wheel_radius_m)
    speeds = [smooth(np.nan_to_num(m.shaft[n]), s) for n in range(2)]
    columns = {
        "rolling": weight,
        "air_m2": _air(drive),
        name: weight,
        "gain": -drive.ratio * smooth(m.torque, s),
        "torque_nm": -drive.ratio,
        "loss": drive.ratio * force.behind,
        "car_share": inertia,
        "spin1_nm": force.geared[0],
        "spin1_nms_per_rad": force.geared[0] * speeds[0],
        "spin2_nm": force.geared[1],
        "spin2_nms_per_rad": force.geared[1] * speeds[1],
        "output_spin_nm": np.ones(len(y)),
        "output_spin_nms_per_rad": wheels,
    }
    return _at(m, "road", where, 1.0, y, columns, block_s=HILL_S)


def equations(drive: Drive) -> list[Equations]:
    """Return all that are solved together."""
    return [car(drive), *damper(drive), *output(drive), *tyres(drive), *pairs(drive)]


def _at(
    m: Moments,
    name: str,
    where: Mask,
    every_s: float,
    y: Floats,
    columns: dict[str, Floats],
    walks: bool = False,
    block_s: float = BLOCK_S,
) -> Equations:
    known = where & np.isfinite(y)
    for column in columns.values():
        known &= np.isfinite(column)
    return Equations(name, m.t_s, y, columns, walks, block_s).at(_thinned(known, every_s))
