"""What the equations of motion say at each moment of a recording, linear in what is not known.

Measured speeds and torques are smoothed by a Gaussian, and their rates are those of the smoothed ones: every term
of an equation is smoothed alike, so that the equation holds as it did before (a weak form, or modulating
functions: Preisig and Rippin, Computers and Chemical Engineering 17, 1993, 1). So what is fitted is what acts on
driving, not how a sensor shakes.

Why not the innovations of the Kalman filter? It is told to expect more than one car does, so that it never is too
sure. To its likelihood that is evidence: larger inertias let it expect less, and come out 20 % too large.

**Car**, while one clutch alone has the torque of the engine, slipping or not, and no brake is on:

    M ω̇_b = R (1 + g) T_en(t − lag) − R λ |T| − R J_E ω̇_e − R_1 J_1 ω̇_c1 − R_2 J_2 ω̇_c2 − L

with R = i_t i_f, λ what gears lose of the torque T behind the clutch, J_E = J_e + J_d, M = m r² + J_w. L is
grade, wind and rolling: it walks (`regression`). The acceleration of the wheels has the most noise of all terms.
So it is what the others are fitted to, times the M that is believed; the share of that which fits is what is
looked for. A noisy term among the others would be found too small.

**Damper**, while clutch i is locked:  ω_e − ω_ci = Ṫ_d/k_d.

**Output**, while shaft i drives:      ω_ci/R − ω_w = c_g ω_w + Ṫ_o (1/k_o + 1/(k_ti i_f²)).

**Tyres**:                             ω_w − ω_b = c ω_w + T_o ω_w/(r F).

A signal that is late by x more than it is told has x times its rate too little. So the equations know the delays
as differences; of all together they know what was believed of each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from dctorque_can.evidence.moments import SHAFTS, STEP_S, WHEELS, Mask, Moments, lasting, rate, smooth
from dctorque_can.evidence.torques import carrier
from dctorque_can.pipeline.samples import Quantity

Floats = NDArray[np.float64]
SLOW_S, FAST_S = 0.08, 0.08
"""Standard deviations of the smoothing: of the car's motion, and of the twist of shafts."""
_REACH = 3.0  # standard deviations that a smoothed value reaches to either side
_ROLLS = 3.0  # rad/s at the wheel: slower ones are not measured well


@dataclass(frozen=True, slots=True)
class Equations:
    """One kind of equation at several moments.

    Attributes:
        name: car, damper, output or tyres.
        t_s: times ``[n]``, s.
        y: known side ``[n]``.
        columns: by the name of what is not known, what it is multiplied with ``[n]``.
        walks: whether what is left walks, as the load of the road does.
    """

    name: str
    t_s: Floats
    y: Floats
    columns: dict[str, Floats]
    walks: bool = False

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class Guess:
    """What equations need that is itself a result: they are set up anew with what was found.

    Attributes:
        engine_inertia_kgm2: J_e + J_d, or J_e alone in front of the damper.
        damper_inertia_kgm2: J_d.
        shaft_inertia_kgm2: of both shafts with their gears ``[2]``.
        spin_loss: N·m and N·m·s/rad of both shafts ``[2][2]``.
        loss: λ, of gear and final drive.
        car_inertia_kgm2: M.
        lag_s: of the engine behind its nominal torque.
    """

    engine_inertia_kgm2: float
    damper_inertia_kgm2: float
    shaft_inertia_kgm2: tuple[float, float]
    spin_loss: tuple[tuple[float, float], tuple[float, float]]
    loss: float
    car_inertia_kgm2: float
    lag_s: float = 0.0


def _second(values: Floats, sigma_s: float) -> Floats:
    """Return the second derivative of smoothed values ``[n]``, 1/s²."""
    found = gaussian_filter1d(values, sigma_s / STEP_S, order=2, truncate=_REACH + 1.0)
    return np.asarray(found / STEP_S**2, np.float64)


def _thinned(where: Mask, every_s: float) -> NDArray[np.intp]:
    """Return moments of a mask, so far apart that they tell new things."""
    step = max(round(every_s / STEP_S), 1)
    rows = np.flatnonzero(where)
    return np.asarray(rows[rows % step == 0], np.intp)


@dataclass(frozen=True)
class Drive:
    """A recording with what all equations need.

    Attributes:
        m: the recording at its moments.
        guess: see there.
        has: which clutch alone has the engine's torque ``[n]``: 0, 1; −1 none, −2 not known.
        ratio: R of it ``[n]``; 0 where there is none.
        message: by quantity, how the delay of its message is called.
    """

    m: Moments
    guess: Guess
    has: NDArray[np.int64]
    ratio: Floats
    message: Mapping[Quantity, str]

    @classmethod
    def of(cls, m: Moments, guess: Guess, message: Mapping[Quantity, str]) -> Drive:
        """Return the drive of a recording."""
        has = carrier(m)
        row = np.arange(len(m.t_s))
        ratio = np.where(has >= 0, m.ratio[np.maximum(has, 0), row], 0.0)
        return cls(m, guess, has, ratio, message)

    @property
    def rolls_in_front(self) -> bool:
        """Whether the wheels that tell of the body are the front ones."""
        return self.m.knows_body and not self.m.driven_fronts[0]

    def clutch_torque(self, sigma_s: float) -> Floats:
        """Return the torque behind the clutch that has all of it ``[n]``, N·m, smoothed."""
        m, g = self.m, self.guess
        torque = smooth(m.torque, sigma_s) - g.lag_s * rate(m.torque, sigma_s)
        return torque - g.engine_inertia_kgm2 * rate(m.engine, sigma_s)

    def output_torque(self, sigma_s: float) -> Floats:
        """Return the torque of the output shaft ``[n]``, N·m, smoothed."""
        i = np.maximum(self.has, 0)
        row = np.arange(len(self.m.t_s))
        shaft = np.nan_to_num(self.m.shaft)[i, row]
        spin = np.asarray(self.guess.spin_loss)[i]
        net = self.clutch_torque(sigma_s) - np.asarray(self.guess.shaft_inertia_kgm2)[i] * rate(shaft, sigma_s)
        net -= spin[:, 0] + spin[:, 1] * np.abs(smooth(shaft, sigma_s))
        return self.ratio * (net - self.guess.loss * np.abs(net))

    def steady(self, sigma_s: float) -> Mask:
        """Where one clutch alone has carried in one gear for as long as the smoothing reaches ``[n]``."""
        state = np.where((self.has >= 0) & (self.ratio > 0.0), self.ratio, 0.0)
        same = np.concatenate([[True], np.diff(state) == 0.0])
        reach = _REACH * sigma_s + 0.1
        return lasting(same & (state > 0.0), reach, reach)

    def late(self, quantities: Sequence[Quantity], column: Floats) -> dict[str, Floats]:
        """Return a column ``[n]`` for the delay of each message that quantities come in, which count alike."""
        found: dict[str, Floats] = {}
        for quantity in quantities:
            name = self.message[quantity]
            found[name] = found.get(name, 0.0) + column / len(quantities)
        return found


def _sum(*columns: dict[str, Floats]) -> dict[str, Floats]:
    """Return columns together; those of one name are added."""
    found: dict[str, Floats] = {}
    for each in columns:
        for name, column in each.items():
            found[name] = found[name] + column if name in found else column
    return found


def car(drive: Drive) -> Equations:
    """Return the balance of the car."""
    m, g, s = drive.m, drive.guess, SLOW_S
    torque, torque_rate = smooth(m.torque, s), rate(m.torque, s)
    engine, body = rate(m.engine, s), rate(m.body, s)
    shafts = [rate(np.nan_to_num(m.shaft[i]), s) for i in range(2)]
    geared = [np.where(m.ratio[i] > 0.0, m.ratio[i], 0.0) for i in range(2)]
    row, i = np.arange(len(m.t_s)), np.maximum(drive.has, 0)
    spin = np.zeros(len(m.t_s))
    for n in range(2):
        loss = g.spin_loss[n][0] + g.spin_loss[n][1] * np.abs(smooth(np.nan_to_num(m.shaft[n]), s))
        spin += geared[n] * loss
    behind = np.abs(drive.clutch_torque(s) - np.asarray(g.shaft_inertia_kgm2)[i] * np.stack(shafts)[i, row])
    force = (
        drive.ratio * (torque - g.lag_s * torque_rate - g.loss * behind - g.engine_inertia_kgm2 * engine) - spin
    )
    force -= sum(geared[n] * g.shaft_inertia_kgm2[n] * shafts[n] for n in range(2))
    where = drive.steady(s) & lasting(m.free, _REACH * s, _REACH * s) & (smooth(m.wheels, s) > _ROLLS)
    rolling = [each for each in WHEELS if m.has(each) and (each in WHEELS[:2]) == drive.rolls_in_front]
    columns = _sum(
        {
            "car_share": force,
            "gain": drive.ratio * torque,
            "lag_s": -drive.ratio * torque_rate,
            "loss": -drive.ratio * behind,
            "engine_inertia_kgm2": -drive.ratio * engine,
            "shaft1_inertia_kgm2": -geared[0] * shafts[0],
            "shaft2_inertia_kgm2": -geared[1] * shafts[1],
        },
        drive.late([Quantity.ENGINE_TORQUE], drive.ratio * torque_rate),
        drive.late(rolling, -drive.ratio * torque_rate),
    )
    return _at(m, "car", where, 0.2, g.car_inertia_kgm2 * body - force, columns, walks=True)


def damper(drive: Drive) -> list[Equations]:
    """Return the twist of the damper, of each clutch that is locked."""
    m, g, found = drive.m, drive.guess, []
    primary = g.engine_inertia_kgm2 - g.damper_inertia_kgm2
    torque = rate(m.torque, FAST_S) - primary * _second(m.engine, FAST_S)
    engine = rate(m.engine, FAST_S)
    for i in range(2):
        if not m.has(SHAFTS[i]):
            continue
        where = drive.steady(FAST_S) & (drive.has == i) & lasting(m.locked[i], 0.2, 0.2)
        late = drive.late([SHAFTS[i]], engine), drive.late([Quantity.ENGINE_SPEED], -engine)
        y = smooth(m.engine - np.nan_to_num(m.shaft[i]), FAST_S)
        found.append(_at(m, "damper", where, 0.04, y, _sum({"damper_compliance": torque}, *late)))
    return found


def output(drive: Drive) -> list[Equations]:
    """Return the twist between each input shaft and the driven wheels."""
    m, found = drive.m, []
    if not m.measures_driven:
        return []
    twist = np.gradient(np.nan_to_num(drive.output_torque(FAST_S)), STEP_S)
    speed, acceleration = smooth(m.wheels, FAST_S), rate(m.wheels, FAST_S)
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
                },
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


def _at(
    m: Moments,
    name: str,
    where: Mask,
    every_s: float,
    y: Floats,
    columns: dict[str, Floats],
    walks: bool = False,
) -> Equations:
    known = where & np.isfinite(y)
    for column in columns.values():
        known &= np.isfinite(column)
    rows = _thinned(known, every_s)
    return Equations(name, m.t_s[rows], y[rows], {key: column[rows] for key, column in columns.items()}, walks)
