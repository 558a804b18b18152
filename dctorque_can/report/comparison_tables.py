"""Compared estimators as tables, at most 100 columns wide."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dctorque_can.analysis.consistency import LEVELS
from dctorque_can.report.torque_table import by_torque, table

_PARTS = {"all": "whole drive", "shifts": "shifts ± 100 ms"}


def comparison_tables(report: dict[str, Any]) -> Group:
    """Return what `findings.as_report` made of a comparison."""
    return Group(*(part for title, filled in _tables(report) for part in (Text(title, style="italic"), filled)))


def _tables(report: dict[str, Any]) -> Iterator[tuple[str, Table]]:
    """Yield the errors, then, where a variant states them, the tables of standard deviations; all with titles."""
    drives = report["drives"]
    what = drives[0] if len(drives) == 1 else f"{len(drives)} drives, {drives[0]} … {drives[-1]}"
    shifts = report["shift_count"]
    title = f"{report['name']}: {what}, {shifts} shift{'' if shifts == 1 else 's'}"
    if len(drives) == 1:
        yield title, by_torque(("RMS", "/bound"), ("N·m", ""), _rows(report), _rms_cells)
    else:
        yield (
            title,
            by_torque(("RMS", "mean ± sd", "/bound"), ("N·m", "N·m", ""), _rows(report), _rms_and_spread_cells),
        )
    yield "The same errors", by_torque(("bias", "peak", "lag"), ("N·m", "N·m", "ms"), _rows(report), _error_cells)
    title = (
        "Errors within the stated bands (nominal: the heading), and mean negative log density;\n"
        "wrong: confidently so, valid but beyond 5 σ and 10 N·m (output 100 N·m), in all drives together"
    )
    headings = (*(f"{level:.0%}" for level in LEVELS), "score", "wrong")
    yield title, by_torque(headings, ("%", "%", "%", "nats", "ms"), _rows(report), _band_cells)
    title = "Both clutch torques together: mean NEES (2 is right), 95 % limits of an honest estimator"
    yield title, _nees_table(report)
    if any(parts["transmission"] for parts in _rows(report).values()):
        yield "Driving clutch against the transmission's own torque", _transmission_table(report)
    title = "Innovations of each speed: mean NIS (1 is right), 95 % limits of an honest filter"
    yield title, _nis_table(report)


def _rows(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what has a row in every table: the variants, and the bound below them."""
    return {**report["variants"], "bound": report["bound"]}


def _rms_cells(torque: dict[str, Any]) -> tuple[str, ...]:
    ratio = torque["rms_over_bound"]
    return f"{torque['rms_nm']:.2f}", "–" if ratio is None else f"{ratio:.2f}"


def _rms_and_spread_cells(torque: dict[str, Any]) -> tuple[str, ...]:
    rms, ratio = _rms_cells(torque)
    spread = torque["rms_std_nm"]
    return rms, f"{torque['rms_mean_nm']:.2f} ± " + ("–" if spread is None else f"{spread:.2f}"), ratio


def _error_cells(torque: dict[str, Any]) -> tuple[str, ...]:
    lag = torque["lag_ms"]
    return (
        f"{torque['bias_nm']:+.2f}",
        f"{torque['peak_nm']:.1f}",
        "–" if lag is None else f"{lag:+.1f}",
    )


def _band_cells(torque: dict[str, Any]) -> tuple[str, ...] | None:
    bands = torque["bands"]
    if bands is None:
        return None
    shares = (f"{100 * share:.1f}" for share in bands["coverage"].values())
    return (*shares, f"{bands['log_score']:.2f}", f"{torque['confidently_wrong_ms']:.0f}")


def _nees_table(report: dict[str, Any]) -> Table:
    filled = table()
    filled.add_column("variant", no_wrap=True)
    filled.add_column("over", no_wrap=True)
    for heading in ("NEES", "limits", "estimates", "independent", "σ are", "score"):
        filled.add_column(heading, justify="right", no_wrap=True)
    for variant, parts in _rows(report).items():
        for part, where in _PARTS.items():
            found = parts[part] and parts[part]["clutches"]
            if not found:
                continue
            low, high = found["nees_low"], found["nees_high"]
            filled.add_row(
                Text(variant),
                where,
                f"{found['nees']:.2f}",
                f"{low:.2f} … {high:.2f}",
                f"{found['samples']}",
                f"{found['independent_samples']:.0f}",
                _verdict(found["nees"], low, high),
                f"{found['log_score']:.2f}",
            )
    return filled


def _transmission_table(report: dict[str, Any]) -> Table:
    filled = table()
    filled.add_column("variant", no_wrap=True)
    for heading in ("RMS\nN·m", "bias\nN·m", "told\nN·m", "estimates\n%"):
        filled.add_column(heading, justify="right", no_wrap=True)
    for variant, parts in _rows(report).items():
        found = parts["transmission"]
        if found:
            figures = (found["rms_nm"], found["bias_nm"], found["told_rms_nm"], 100 * found["share"])
            filled.add_row(Text(variant), *(f"{figure:.1f}" for figure in figures))
    return filled


def _nis_table(report: dict[str, Any]) -> Table:
    filled = table()
    filled.add_column("variant", no_wrap=True)
    filled.add_column("speed of", no_wrap=True)
    for heading in ("NIS", "limits", "samples", "rejected", "σ are"):
        filled.add_column(heading, justify="right", no_wrap=True)
    for variant, parts in _rows(report).items():
        for n, (sensor, found) in enumerate(parts["sensors"].items()):
            low, high = found["nis_low"], found["nis_high"]
            filled.add_row(
                Text("" if n else variant),
                sensor.replace("_", " "),
                f"{found['nis']:.2f}",
                f"{low:.2f} … {high:.2f}",
                f"{found['samples']}",
                f"{found['rejected']}",
                _verdict(found["nis"], low, high),
            )
    return filled


def _verdict(mean: float, low: float, high: float) -> str:
    """Return what a mean of normalised squares says of the standard deviations."""
    return "too large" if mean < low else "too small" if mean > high else "plausible"
