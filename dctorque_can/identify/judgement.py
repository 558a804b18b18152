"""What the estimator makes of drives before and after, and how much it depends on what is left unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.health import health_counts
from dctorque_can.analysis.noise_hints import ENOUGH, LearnedNoise, key_of, learned_noises
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_documents
from dctorque_can.evidence.draft import number
from dctorque_can.evidence.yaml_edits import Edit
from dctorque_can.identify.identification import HELD_OUT_S
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.results import Result
from dctorque_can.pipeline.estimates import HEALTH, SENSORS, Status
from dctorque_can.pipeline.frames import Frames

SENSITIVE_S = 30.0
"""Seconds of a drive on which sensitivities are measured."""
_TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
_TOGETHER = ("delays", "ratios")  # of these differences are known far better than each one
_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID)


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the Kalman filter says of a vehicle file on drives that were not fitted.

    Attributes:
        nis: mean of the normalised innovations squared, by the name of the sensor; 1 is right.
        gain: share that it believes the engine's torque to be above the nominal one.
        valid: share of estimates with valid clutch torques.
        findings: sentences of the plausibility monitor.
        noises: what was learned of the noises of the speeds.
    """

    nis: dict[str, float]
    gain: float
    valid: float
    findings: list[str]
    noises: list[LearnedNoise]


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """What one standard deviation of a number does to the torques.

    Attributes:
        key: of the number, or what is moved together.
        torques_nm: root mean square of the change of clutch 1, clutch 2 and output, N·m.
    """

    key: str
    torques_nm: tuple[float, float, float]


def held_out(frames: Frames) -> list[Frames]:
    """Return the stretches of a recording that are not fitted, each from the begin of its minute."""
    if not len(frames):
        return []
    minute = ((frames.t_us - frames.t_us[0]) // round(1e6 * HELD_OUT_S)).astype(np.int64)
    return [frames[minute == n] for n in range(1, int(minute.max()) + 1, 2) if (minute == n).any()]


def judged(stretches: Sequence[Frames], config: Config) -> Judgement:
    """Return what the estimator makes of stretches, each begun anew."""
    squares, counts, gains = np.zeros(len(SENSORS)), np.zeros(len(SENSORS)), []
    rows, valid, findings, healths = 0, 0, [], [np.zeros(0, HEALTH)]
    for stretch in stretches:
        chain = Chain(config)
        estimates = chain.feed(stretch)
        health = chain.health
        healths.append(health.copy())
        squares += health["innovation_squares"][0]
        counts += health["innovations"][0]
        gains.append(float(health["engine_torque_gain_error"][0]))
        rows += len(estimates)
        valid += int(np.count_nonzero((estimates.rows["status"] & _VALID) == _VALID))
        findings += [found["says"] for found in health_counts(health)["findings"]]
    nis = {sensor: float(squares[n] / counts[n]) for n, sensor in enumerate(SENSORS) if counts[n] > 0}
    return Judgement(
        nis=nis,
        gain=float(np.mean(gains)) if gains else 0.0,
        valid=valid / max(rows, 1),
        findings=list(dict.fromkeys(findings)),
        noises=learned_noises(np.concatenate(healths)),
    )


def noise_results(now: Judgement) -> list[Result]:
    """Return the noises of the speeds that are clearly others than told, and those of which too little was seen.

    Args:
        now: with all other numbers as they are known now.
    """
    found = []
    for each in now.noises:
        before = Belief(each.told_rad_s, each.told_rad_s)  # a factor of two is usual
        if each.value is not None:
            after = Belief(each.value, each.value / sqrt(2.0 * each.samples))
        elif 0.0 < each.samples < ENOUGH:
            after = before
        else:
            continue
        found.append(Result(each.key, "noises", "rad/s", before, after, refused=False))
    return found


def without_help(noises: Sequence[Result], now: Judgement, then: Judgement) -> list[Result]:
    """Return the noises; those go back with which the innovations are no nearer to what the filter expects.

    Args:
        noises: of `noise_results`.
        now, then: what the filter says without and with them.
    """
    found = []
    for each in noises:
        sensors = [name for name in now.nis if key_of(name) == each.key]
        far = [float(np.mean([abs(log(max(some.nis[name], 1e-9))) for name in sensors])) for some in (now, then)]
        worse = each.changes and far[1] > far[0]
        found.append(replace(each, after=each.before, refused=True) if worse else each)
    return found


def sensitivities(
    stretch: Frames, config: Config, edits: Sequence[Edit], results: Sequence[Result]
) -> list[Sensitivity]:
    """Return what one standard deviation of each number does to the torques, the most first.

    Args:
        stretch: of a drive.
        config: the vehicle file before.
        edits: what was changed in it.
        results: numbers, each of which is moved by its standard deviation.
    """
    until_us = stretch.t_us[0] + round(1e6 * SENSITIVE_S) if len(stretch) else 0
    frames = stretch[stretch.t_us < until_us]
    found_values = {edit.key: edit.value for edit in edits}
    right = _torques(frames, load_documents(config.documents, found_values))
    found = []
    alone = {result.key: {result.key: _moved(result)} for result in results if result.group not in _TOGETHER}
    late = {each.key: _moved(each) for each in results if each.group == "delays" and each.key.endswith("delay_ms")}
    moves = alone | ({"all delays together": late} if late else {})
    for name, moved in moves.items():
        other = _torques(frames, load_documents(config.documents, found_values | moved))
        change = np.sqrt(np.mean((other - right) ** 2, axis=0)) if len(other) == len(right) else np.full(3, np.nan)
        found.append(Sensitivity(name, (float(change[0]), float(change[1]), float(change[2]))))
    return sorted(found, key=lambda each: -max(each.torques_nm[:2]))


def _moved(result: Result) -> str:
    """Return a number moved by its standard deviation, to where it can be."""
    value = result.after.value + result.after.sigma
    if result.key.endswith("efficiency") and value > 1.0:
        value = result.after.value - result.after.sigma
    return number(value, 8)


def _torques(frames: Frames, config: Config) -> NDArray[np.float64]:
    rows = Chain(config).feed(frames).rows
    return np.stack([rows[name] for name in _TORQUES], axis=1)
