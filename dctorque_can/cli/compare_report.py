"""The findings of ``dctorque compare``: as one object for scripts, and as tables at most 100 columns wide."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dctorque_can.analysis.consistency import LEVELS, Bands, Nees
from dctorque_can.cli.figures import TORQUE_NAMES

if TYPE_CHECKING:
    from dctorque_can.analysis.comparison import Figures
    from dctorque_can.daemon.comparison import VariantResult

WIDTH = 100
_PARTS = {"all": "whole drive", "shifts": "shifts ± 100 ms"}


def as_report(name: str, drives: Sequence[str], shifts: int, results: Sequence[VariantResult]) -> dict[str, Any]:
    """Return everything that was found, with units in the keys."""
    return {
        "name": name,
        "drives": list(drives),
        "shift_count": shifts,
        "variants": {
            result.variant.name: {
                "set": dict(result.variant.overrides),
                "smoothed": result.variant.smooth,
                "all": _figures(result.comparison.everything),
                "shifts": None if result.comparison.shifts is None else _figures(result.comparison.shifts),
            }
            for result in results
        },
    }


def _figures(figures: Figures) -> dict[str, Any]:
    torques = {
        name: {
            "rms_nm": torque.rms_nm,
            "bias_nm": torque.bias_nm,
            "peak_nm": torque.peak_nm,
            "lag_ms": torque.lag_ms,
            "bands": None if torque.bands is None else _bands(torque.bands),
        }
        for name, torque in figures.torques.items()
    }
    clutches = None if figures.clutches is None else _nees(figures.clutches)
    return {"samples": figures.samples, **torques, "clutches": clutches}


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


def show(report: dict[str, Any]) -> None:
    """Print a report on stdout."""
    console = Console(width=WIDTH, highlight=False, emoji=False)
    for title, table in _tables(report):
        console.print(Text(title, style="italic"))
        console.print(table)


def _tables(report: dict[str, Any]) -> Iterator[tuple[str, Table]]:
    """Yield the errors, then, where a variant states them, the tables of standard deviations; all with titles."""
    drives = report["drives"]
    what = drives[0] if len(drives) == 1 else f"{len(drives)} drives, {drives[0]} … {drives[-1]}"
    shifts = report["shift_count"]
    title = f"{report['name']}: {what}, {shifts} shift{'' if shifts == 1 else 's'}"
    yield title, _by_torque(("RMS", "bias", "peak", "lag"), ("N·m", "N·m", "N·m", "ms"), report, _error_cells)
    if any(variant["all"]["clutches"] for variant in report["variants"].values()):
        title = "Errors within the stated bands (nominal: the heading), and mean negative log density"
        headings = (*(f"{level:.0%}" for level in LEVELS), "score")
        yield title, _by_torque(headings, ("%", "%", "%", "nats"), report, _band_cells)
        title = "Both clutch torques together: mean NEES (2 is right), 95 % limits of an honest estimator"
        yield title, _nees_table(report)


def _table() -> Table:
    return Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)


Cells = Callable[[dict[str, Any]], tuple[str, ...] | None]


def _by_torque(headings: tuple[str, ...], units: tuple[str, ...], report: dict[str, Any], cells: Cells) -> Table:
    """Return one row per torque and variant: figures of the whole drive, then those of the shifts."""
    table = _table()
    table.add_column("torque", no_wrap=True)
    table.add_column("variant", no_wrap=True)
    for part in ("all", "shifts"):
        for n, (heading, unit) in enumerate(zip(headings, units, strict=True)):
            above = part if n == 0 else ""
            table.add_column(Text(f"{above}\n{heading}\n{unit}"), justify="right", no_wrap=True)
    for torque, name in TORQUE_NAMES.items():
        first = True
        for variant, parts in report["variants"].items():
            whole = cells(parts["all"][torque])
            if whole is None:
                continue
            shifts = cells(parts["shifts"][torque]) if parts["shifts"] else None
            row = (*whole, *(shifts or ("–",) * len(headings)))
            table.add_row(name if first else "", Text(variant), *row)
            first = False
        table.add_section()
    return table


def _error_cells(torque: dict[str, Any]) -> tuple[str, ...]:
    lag = torque["lag_ms"]
    return (
        f"{torque['rms_nm']:.2f}",
        f"{torque['bias_nm']:+.2f}",
        f"{torque['peak_nm']:.1f}",
        "–" if lag is None else f"{lag:+.1f}",
    )


def _band_cells(torque: dict[str, Any]) -> tuple[str, ...] | None:
    bands = torque["bands"]
    if bands is None:
        return None
    return (*(f"{100 * share:.1f}" for share in bands["coverage"].values()), f"{bands['log_score']:.2f}")


def _nees_table(report: dict[str, Any]) -> Table:
    table = _table()
    table.add_column("variant", no_wrap=True)
    table.add_column("over", no_wrap=True)
    for heading in ("NEES", "limits", "estimates", "independent", "σ are", "score"):
        table.add_column(heading, justify="right", no_wrap=True)
    for variant, parts in report["variants"].items():
        for part, where in _PARTS.items():
            found = parts[part] and parts[part]["clutches"]
            if not found:
                continue
            low, high = found["nees_low"], found["nees_high"]
            verdict = "too large" if found["nees"] < low else "too small" if found["nees"] > high else "plausible"
            table.add_row(
                Text(variant),
                where,
                f"{found['nees']:.2f}",
                f"{low:.2f} … {high:.2f}",
                f"{found['samples']}",
                f"{found['independent_samples']:.0f}",
                verdict,
                f"{found['log_score']:.2f}",
            )
    return table
