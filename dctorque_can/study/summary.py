"""What all runs of a study say together."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dctorque_can.analysis.errors import TORQUES
from dctorque_can.study.coverage import EstimatorSpread, spreads
from dctorque_can.study.plan import Study
from dctorque_can.study.run import Record
from dctorque_can.study.sensitivity import Effect, Sensitivity, fewest_runs, sensitivity

QUANTILES = {"p5": 0.05, "p50": 0.50, "p95": 0.95}


@dataclass(frozen=True)
class StudySummary:
    """Figures of a whole study, N·m.

    Attributes:
        study: what was done.
        nominal: RMS error per torque of the car in which nothing is varied.
        rms: quantiles of the RMS error over all runs that did not fail, by torque and then name of the quantile.
        failed: run to its reason.
        used: runs that did not fail.
        least_valid: least share of valid estimates of any run.
        sensitivities: per torque, or nothing when there are too few runs.
        estimators: both methods and the bound over the same runs, by name; nothing when all failed.
    """

    study: Study
    nominal: dict[str, float]
    rms: dict[str, dict[str, float]]
    failed: dict[int, str]
    used: int
    least_valid: float | None
    sensitivities: dict[str, Sensitivity]
    estimators: dict[str, EstimatorSpread]

    @property
    def runs_for_ranking(self) -> int:
        """How many runs without failure a ranking needs."""
        return fewest_runs(len(self.study.vary))

    def ranking(self, torque: str) -> list[tuple[str, Effect]]:
        """Return the factors with their effects on one torque, the greatest first."""
        pairs = zip(self.study.vary, self.sensitivities[torque].effects, strict=True)
        return sorted(pairs, key=lambda pair: -pair[1].change)

    @property
    def method(self) -> str:
        """Name of the configured method, that of ``nominal``, ``rms`` and ``sensitivities``."""
        return self.study.config.settings.method.name.lower()

    def as_json(self) -> dict[str, Any]:
        """Return the summary for scripts."""
        plan = self.study.plan
        return {
            "study": str(self.study.path),
            "vehicle": self.study.config.name,
            "method": self.method,
            **{name: getattr(plan, name) for name in ("drive", "duration_s", "profile", "runs", "seed")},
            "identity": self.study.identity(),
            "used": self.used,
            "failed": [{"run": run, "error": error} for run, error in self.failed.items()],
            "least_valid": self.least_valid,
            "nominal_rms": self.nominal,
            "rms": self.rms,
            "estimators": {name: spread.as_json() for name, spread in self.estimators.items()},
            "sensitivity": {
                torque: {
                    "explained": self.sensitivities[torque].explained,
                    "ranking": [_effect(name, effect) for name, effect in self.ranking(torque)],
                }
                for torque in self.sensitivities
            },
        }

    def write(self, path: Path) -> None:
        """Write the summary as a file for scripts."""
        text = json.dumps(self.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")


def summarise(study: Study, records: Mapping[int, Record]) -> StudySummary:
    """Return the figures of the runs 1 .. ``runs``, all of which must be there, and of the nominal run 0."""
    drawn = [records[number] for number in range(1, study.plan.runs + 1)]
    good = [record for record in drawn if "error" not in record]
    rms = {name: np.array([record["rms"][name] for record in good]) for name in TORQUES}
    values = np.array([[record["factors"][name] for name in study.vary] for record in good])
    enough = len(good) >= fewest_runs(len(study.vary))
    return StudySummary(
        study=study,
        nominal=records[0]["rms"],
        rms={
            name: {key: float(np.quantile(errors, q)) for key, q in QUANTILES.items()}
            for name, errors in rms.items()
            if good
        },
        failed={record["run"]: record["error"] for record in drawn if "error" in record},
        used=len(good),
        least_valid=min((record["valid"] for record in good), default=None),
        sensitivities={
            name: sensitivity(values, errors, study.plan.seed) for name, errors in rms.items() if enough
        },
        estimators=spreads(good),
    )


def _effect(name: str, effect: Effect) -> dict[str, Any]:
    return {
        "factor": name,
        "change_nm": effect.change,
        "low_nm": effect.low,
        "high_nm": effect.high,
        "chance_nm": effect.chance,
        "significant": effect.significant,
        "curve_nm": list(effect.curve),
        "shape": effect.shape,
        "share": effect.share,
    }
