"""Conditions (73) to (76) of the observer's stability, and where the proof is weaker than it reads."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dctorque_can.estimators.oh2014 import stability
from dctorque_can.estimators.oh2014.design import RoadLoad
from dctorque_can.estimators.oh2014.driving_conditions import DrivingCondition

if TYPE_CHECKING:
    from dctorque_can.design.judgement import Design

Pair = tuple[int, int]
MAX_ENGINE_SPEED = 700.0  # rad/s, 6700 rpm
ROUNDING = 1e-12  # cross terms that cancel leave less, relative


def checks(design: Design) -> list[dict[str, Any]]:
    """Return each condition, whether it holds, and its numbers."""
    every = list(design.gains.values())
    g = every[0]
    smallest = min(min(g.l_1, g.l_2, g.l_3, g.l_4, g.L, g.g_e, g.g_t, g.g_l) for g in every)
    remainder = max(stability.rate_spread(g) for g in every)
    cancels = remainder < ROUNDING
    rates = [
        np.linalg.eigvalsh(
            stability.lyapunov_rate(
                stability.error_matrix(design.gains[pair], q.engine_speed_rad_s, q.wheel_acceleration_rad_s2),
                stability.lyapunov_weights(design.gains[pair]),
            )
        )
        for pair, q in _points(design)
    ]
    rounding = ROUNDING * float(np.abs(rates[0]).max())
    zeros = int(np.sum(np.abs(rates[0]) < rounding))
    negative = f"{-2 * g.l_1:.3g}, {-2 * g.l_3:.3g}, {-2 * g.g_l:.3g}, {-2 * g.g_l:.3g}"
    ranks = sorted(
        {
            stability.observability(design.gains[pair], q.engine_speed_rad_s, q.wheel_acceleration_rad_s2).rank
            for pair, q in _points(design)
        }
    )
    return [
        _check("(73) all l, γ > 0", smallest > 0.0, f"smallest {smallest:.3g}", smallest=smallest),
        _check(
            "(75) ε_e = J_e l_1 ω̃_e, ε_o = J_e1 l_3 ω̃_c1",
            cancels,
            f"cross terms cancel, {remainder:.0e} of them is left",
            remainder=remainder,
        ),
        _check(
            "(76) dV/dt ≤ 0, frozen",
            max(float(rate[-1]) for rate in rates) <= rounding,
            f"AᵀP+PA: {negative}, {zeros} × 0 1/s",
            eigenvalues_per_s=rates[0].tolist(),
            zeros=zeros,
        ),
        _check("V serves any ω_e(t), dω_w/dt(t) of a pair", cancels, "P has neither in it; A is affine in both"),
        *_gear_change_check(design),
        _loss_check(design, every),
        *_road_load_check(design, g),
        *_sampled_checks(design),
        _check(
            "the data alone tell all six states",
            ranks == [6],
            f"rank {' or '.join(map(str, ranks))} of 6, tolerance {stability.RANK_TOLERANCE:.0e}",
            ranks=ranks,
        ),
    ]


def _points(design: Design) -> list[tuple[Pair, DrivingCondition]]:
    return [(pair, condition) for pair in design.pairs for condition in design.conditions[pair]]


def _gear_change_check(design: Design) -> list[dict[str, Any]]:
    """Return what happens to V where one gear of a pair is exchanged and the other stays."""
    jumps: list[dict[str, Any]] = []
    for i, before in enumerate(design.pairs):
        for after in design.pairs[i + 1 :]:
            if (before[0] == after[0]) != (before[1] == after[1]):
                ratio = stability.weight_jump(design.gains[before], design.gains[after])
                jumps.append({"from": pair_name(before), "to": pair_name(after), "weight_ratio": ratio})
    if not jumps:
        return []
    worst = max(jumps, key=lambda jump: jump["weight_ratio"])
    text = f"a weight jumps × {worst['weight_ratio']:.3g} from {worst['from']} to {worst['to']}"
    return [_check("V serves all pairs", worst["weight_ratio"] < 1.0 + ROUNDING, text, gear_changes=jumps)]


def _loss_check(design: Design, every: list[stability.Gains]) -> dict[str, Any]:
    limit = min(stability.acceleration_limit(g, design.efficiency) for g in every)
    lossy = math.isfinite(limit)
    text = (
        f"dV/dt ≤ 0 up to |dω_w/dt| = {limit:.3g}, tyres give {design.grip:.3g} rad/s²" if lossy else "no losses"
    )
    return _check(
        "gear losses, not in (74)",
        limit > design.grip,
        text,
        acceleration_limit_rad_s2=limit if lossy else None,
        tyre_limit_rad_s2=design.grip,
    )


def _road_load_check(design: Design, g: stability.Gains) -> list[dict[str, Any]]:
    if design.design.road_load is not RoadLoad.LEARNED:
        return []
    product = g.l_3 * design.design.road_load_time_s
    return [_check("learned road load: l_3 T_road > 1", product > 1.0, f"{product:.3g}", l_3_t_road=product)]


def _sampled_checks(design: Design) -> list[dict[str, Any]]:
    sampled = [design.errors(pair, condition, 1.0, ()) for pair, condition in _points(design)]
    radius = max(errors.spectral_radius() for errors in sampled)
    slowest = -math.log(radius) / sampled[0].period_s  # negative: it grows
    growth = max(
        design.errors(pair, condition, 1.0, ()).lyapunov_growth(stability.lyapunov_weights(design.gains[pair]))
        for pair in design.pairs
        for condition in _extremes(design, pair)
    )
    return [
        _check(
            "sampled at the given periods, frozen",
            radius < 1.0,
            f"slowest error {'dies out' if radius < 1.0 else 'GROWS'} at {abs(slowest):.3g} 1/s",
            spectral_radius=radius,
            slowest_per_s=slowest,
        ),
        _check(
            "V serves the sampled form too",
            growth < 1.0,
            f"× {growth:.4f} a sample at most, |ω_e| ≤ {MAX_ENGINE_SPEED:g}, |dω_w/dt| ≤ {design.grip:.3g}",
            largest_factor_per_sample=growth,
        ),
    ]


def _extremes(design: Design, pair: Pair) -> list[DrivingCondition]:
    """Return points up to the limits of engine and tyres, driving and coasting; both sides are not coupled."""
    shares = np.linspace(0.0, 1.0, 8).tolist()
    condition = design.shift_condition(pair)
    return [
        replace(
            condition,
            engine_speed_rad_s=share * MAX_ENGINE_SPEED,
            wheel_acceleration_rad_s2=share * design.grip,
            output_torque_nm=sign,
        )
        for share in shares
        for sign in (-1.0, 1.0)
    ]


def limits_of_the_proof(design: Design) -> list[dict[str, Any]]:
    """Return where the proof is weaker than it reads, one text each, with the numbers of this design."""
    pair = design.pairs[0]
    g = design.gains[pair]
    w_e = max(q.engine_speed_rad_s for q in design.conditions[pair])
    wide = stability.engine_bound(g, MAX_ENGINE_SPEED), stability.shaft_bound(g, design.grip, design.efficiency)
    near = stability.engine_bound(g, w_e)
    A = stability.error_matrix(g, w_e, 0.0)
    moving = stability.stationary_errors(A, g, dT_c=design.rate)[3]
    wrong = stability.stationary_errors(A, g, tau_e=10.0 / w_e)[3]
    slow = stability.eigenvalues(A)[0][0].real
    decay = min(bound.decay_rate for bound in wide)
    wrong_bound, moving_bound = 10.0 / w_e * near.torque_per_adaptive, design.rate * near.torque_per_rate
    return [
        _limit(
            "T̃_c and T̃_a1 are not in (76): it gives stability, not convergence. "
            + (
                f"With leakage every error dies out at {decay:.2g} 1/s or faster"
                if decay > 0.0
                else "No rate is sure"
            )
            + f" for any |ω_e| ≤ {MAX_ENGINE_SPEED:g} rad/s and |dω_w/dt| ≤ {design.grip:.2g} rad/s² "
            "(by V + ε ω̃ T̃); without leakage only if excitation persists.",
            engine_decay_rate_per_s=wide[0].decay_rate,
            shaft_decay_rate_per_s=wide[1].decay_rate,
        ),
        _limit(
            f"(76) takes T_c and T_a1 as constant. A ramp of T_c by {design.rate:g} N·m/s ends in an error of "
            f"(2/p_e)(1 + γ_e ω_e²/γ_l) times that: {moving:.3g} N·m at {w_e:g} rad/s, at most "
            f"{moving_bound:.3g} however ω_e varies below.",
            ramp_error_nm=float(moving),
            ramp_bound_nm=moving_bound if math.isfinite(moving_bound) else None,
        ),
        _limit(
            "γ_l τ̃ (τ - τ_n) is zero only for τ_e = 0 and τ_o = τ_on. Else T̂_c ends wrong by all of ω_e τ_e, "
            "T̂_a1 by (τ_o - τ_on)(dω_w/dt)/R_1: 10 N·m of engine torque make "
            f"{wrong:.3g} N·m, at most {wrong_bound:.3g} however ω_e varies below.",
            engine_error_nm=10.0,
            sum_error_nm=float(wrong),
            sum_bound_nm=wrong_bound if math.isfinite(wrong_bound) else None,
        ),
        _limit(
            "The adaptation time is no error's time constant: beside an unknown T_c, τ_e moves with the pole "
            f"{slow:.3g} 1/s, near -γ_l p_e²/(p_e² + l_1 γ_e ω_e²), to its prior; without leakage not at all.",
            slow_pole_per_s=float(slow),
        ),
        _limit("A gear change exchanges P and sets T̂_a1 anew by (61): V may jump there; (76) is silent on it."),
    ]


def pair_name(pair: Pair) -> str:
    """Return the gears of a pair as people write them, lower one first: 1-2, R-1."""
    return "-".join("R" if gear < 0 else str(gear) for gear in sorted(pair))


def _check(name: str, holds: bool, text: str, **numbers: Any) -> dict[str, Any]:
    return {"condition": name, "holds": bool(holds), "text": text, **numbers}


def _limit(text: str, **numbers: Any) -> dict[str, Any]:
    return {"text": text, **numbers}
