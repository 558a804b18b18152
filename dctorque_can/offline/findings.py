"""What a comparison of estimators found, as one object for scripts: with the ratio to the bound and the spread."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

from dctorque_can.analysis.comparison import Figures, TorqueFigures
from dctorque_can.analysis.consistency import LEVELS, Bands, Nees, Nis
from dctorque_can.offline.comparison import VariantResult


def as_report(
    name: str, drives: Sequence[str], shifts: int, results: Sequence[VariantResult], bound: VariantResult
) -> dict[str, Any]:
    """Return everything that was found, with units in the keys."""
    return {
        "name": name,
        "drives": list(drives),
        "shift_count": shifts,
        "variants": {
            result.variant.name: {"set": dict(result.variant.overrides), "smoothed": result.variant.smooth}
            | _variant(result, bound)
            for result in results
        },
        "bound": _variant(bound, bound),
    }


def _variant(result: VariantResult, bound: VariantResult) -> dict[str, Any]:
    found, least = result.comparison, bound.comparison
    return {
        "all": _figures(found.everything, least.everything),
        "shifts": _figures(found.shifts, least.shifts) if found.shifts and least.shifts else None,
        "transmission": result.transmission,
        "sensors": {name: _nis(nis) for name, nis in result.sensors.items()},
    }


def _figures(figures: Figures, bound: Figures) -> dict[str, Any]:
    torques = {name: _torque(torque, bound.torques[name]) for name, torque in figures.torques.items()}
    clutches = None if figures.clutches is None else _nees(figures.clutches)
    return {"samples": figures.samples, **torques, "clutches": clutches}


def _torque(torque: TorqueFigures, bound: TorqueFigures) -> dict[str, Any]:
    each = [rms for rms in torque.rms_each_nm if rms is not None]
    return {
        "rms_nm": torque.rms_nm,
        "rms_over_bound": torque.rms_nm / bound.rms_nm if bound.rms_nm else None,
        "rms_by_drive_nm": list(torque.rms_each_nm),
        "rms_mean_nm": statistics.mean(each),
        "rms_std_nm": statistics.stdev(each) if len(each) > 1 else None,
        "bias_nm": torque.bias_nm,
        "peak_nm": torque.peak_nm,
        "lag_ms": torque.lag_ms,
        "bands": None if torque.bands is None else _bands(torque.bands),
        "confidently_wrong_ms": torque.wrong_ms,
    }


def _bands(bands: Bands) -> dict[str, Any]:
    coverage = {f"{level:.0%}": share for level, share in zip(LEVELS, bands.coverage, strict=True)}
    return {"samples": bands.samples, "coverage": coverage, "log_score": bands.log_score}


def _nees(nees: Nees) -> dict[str, Any]:
    return {
        "samples": nees.samples,
        "nees": nees.mean,
        "independent_samples": nees.independent_samples,
        "nees_low": nees.low,
        "nees_high": nees.high,
        "log_score": nees.log_score,
    }


def _nis(nis: Nis) -> dict[str, Any]:
    low, high = nis.limits
    return {
        "samples": nis.samples,
        "rejected": nis.rejected,
        "nis": nis.mean,
        "nis_low": low,
        "nis_high": high,
    }
