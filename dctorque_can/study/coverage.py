"""What both methods and the bound are worth over all cars of a study: errors, bands and innovations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dctorque_can.analysis.consistency import LEVELS
from dctorque_can.analysis.errors import TORQUES
from dctorque_can.study.run import BOUND, ESTIMATORS, Record

PARTS = ("all", "shifts")
"""The whole drive, and the windows of the shifts."""
HONEST = 0.9
"""Errors last and shifts are short: of a 95 % band no more is asked than that it holds this share in a run."""
_WIDEST = len(LEVELS) - 1


@dataclass(frozen=True, slots=True)
class Coverage:
    """How the stated bands hold over all runs, by `LEVELS`.

    Attributes:
        pooled: share of all errors within the band; every estimate counts the same.
        least: the smallest share of a run.
        honest: share of the runs whose 95 % band holds at least `HONEST`.
        wrong_ms: for how long a torque was confidently wrong (`analysis.confidence`), in all runs together.
        wrong_worst_ms: … in the worst run.
    """

    pooled: tuple[float, ...]
    least: tuple[float, ...]
    honest: float
    wrong_ms: float
    wrong_worst_ms: float


@dataclass(frozen=True, slots=True)
class TorqueSpread:
    """One torque of one estimator over one part of all runs.

    Attributes:
        runs: that have such a part.
        median: RMS error, N·m.
        p90: … that nine runs of ten do not exceed.
        worst: … of any run.
        over_bound: median over the runs of the RMS error over that of the bound.
        coverage: None when the estimator states no standard deviations.
    """

    runs: int
    median: float
    p90: float
    worst: float
    over_bound: float
    coverage: Coverage | None


@dataclass(frozen=True, slots=True)
class SensorSpread:
    """Normalised innovations squared of one speed; 1 is right.

    Attributes:
        mean: over the samples of all runs.
        p10: tenth of the runs whose mean is below.
        p90: tenth of the runs whose mean is above.
        rejected: share of all samples that were beyond the gate.
    """

    mean: float
    p10: float
    p90: float
    rejected: float


@dataclass(frozen=True, slots=True)
class EstimatorSpread:
    """One estimator over all runs.

    Attributes:
        parts: by part (`PARTS`) and torque; a part that no run has is missing.
        sensors: by name; empty where there are no innovations.
    """

    parts: dict[str, dict[str, TorqueSpread]]
    sensors: dict[str, SensorSpread]

    def as_json(self) -> dict[str, Any]:
        """Return it for scripts."""
        parts = {
            part: {torque: _as_json(spread) for torque, spread in self.parts[part].items()}
            if part in self.parts
            else None
            for part in PARTS
        }
        sensors = {
            name: {"nis": s.mean, "nis_p10": s.p10, "nis_p90": s.p90, "rejected": s.rejected}
            for name, s in self.sensors.items()
        }
        return {**parts, "sensors": sensors}


def _as_json(spread: TorqueSpread) -> dict[str, Any]:
    held = spread.coverage
    return {
        "runs": spread.runs,
        "rms_median_nm": spread.median,
        "rms_p90_nm": spread.p90,
        "rms_worst_nm": spread.worst,
        "rms_over_bound": spread.over_bound,
        "coverage": None if held is None else _by_level(held.pooled),
        "coverage_least": None if held is None else _by_level(held.least),
        "honest_runs": None if held is None else held.honest,
        "confidently_wrong_ms": None if held is None else held.wrong_ms,
        "confidently_wrong_worst_ms": None if held is None else held.wrong_worst_ms,
    }


def _by_level(shares: Sequence[float]) -> dict[str, float]:
    return {f"{level:.0%}": share for level, share in zip(LEVELS, shares, strict=True)}


def spreads(records: Sequence[Record]) -> dict[str, EstimatorSpread]:
    """Return what each of `ESTIMATORS` is worth over runs that did not fail; nothing without any."""
    return {name: _spread(name, records) for name in ESTIMATORS if records}


def _spread(name: str, records: Sequence[Record]) -> EstimatorSpread:
    parts = {}
    for part in PARTS:
        there = [e for record in records if (e := record["estimators"])[name][part] and e[BOUND][part]]
        if there:
            parts[part] = {
                torque: _torque([e[name][part][torque] for e in there], [e[BOUND][part][torque] for e in there])
                for torque in TORQUES
            }
    found = [record["estimators"][name]["sensors"] for record in records]
    names = dict.fromkeys(sensor for sensors in found for sensor in sensors)
    return EstimatorSpread(
        parts, {sensor: _sensor([sensors[sensor] for sensors in found if sensor in sensors]) for sensor in names}
    )


def _torque(runs: Sequence[dict[str, Any]], bounds: Sequence[dict[str, Any]]) -> TorqueSpread:
    rms = np.array([run["rms"] for run in runs])
    least = np.array([bound["rms"] for bound in bounds])
    stating = [run for run in runs if "coverage" in run]
    return TorqueSpread(
        runs=len(runs),
        median=float(np.median(rms)),
        p90=float(np.quantile(rms, 0.9)),
        worst=float(rms.max()),
        over_bound=float(np.median(rms / np.maximum(least, 1e-12))),
        coverage=_coverage(stating) if stating else None,
    )


def _coverage(runs: Sequence[dict[str, Any]]) -> Coverage:
    shares = np.array([run["coverage"] for run in runs])
    pooled = np.average(shares, axis=0, weights=[run["samples"] for run in runs])
    honest = np.mean(shares[:, _WIDEST] >= HONEST)
    wrong_ms = [run["wrong_ms"] for run in runs]
    return Coverage(
        pooled=tuple(map(float, pooled)),
        least=tuple(map(float, shares.min(axis=0))),
        honest=float(honest),
        wrong_ms=float(sum(wrong_ms)),
        wrong_worst_ms=float(max(wrong_ms)),
    )


def _sensor(runs: Sequence[dict[str, Any]]) -> SensorSpread:
    means = np.array([run["nis"] for run in runs])
    samples = np.array([run["samples"] for run in runs])
    rejected = sum(run["rejected"] for run in runs)
    return SensorSpread(
        mean=float(np.average(means, weights=samples)),
        p10=float(np.quantile(means, 0.1)),
        p90=float(np.quantile(means, 0.9)),
        rejected=float(rejected / (samples.sum() + rejected)),
    )
