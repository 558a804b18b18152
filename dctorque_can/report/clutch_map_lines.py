"""What was learned of the clutches, in sentences and as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.table import Table


def map_lines(found: dict[str, Any] | None) -> Iterator[str]:
    """Yield what a run has learned of each clutch, a line each.

    Args:
        found: ``start`` and ``clutches`` as `maps_json` has them, or None where nothing is learned.
    """
    if found is None:
        return
    if found["start"] not in ("new", "kept"):
        yield f"clutch maps: begun anew; there is a kept state, but {found['start']}"
    if not found["clutches"]:
        yield "clutch maps: nothing learned"
    for clutch in found["clutches"]:
        valid = [node for node in clutch["nodes"] if node["valid"]]
        line = f"clutch {clutch['clutch']}: {len(valid)} of {len(clutch['nodes'])} nodes of its map are valid"
        if clutch["touch_valid"]:
            line += f", touch point {_with_sigma(clutch['touch_point'], clutch['touch_sigma'])}"
        if clutch["friction_valid"]:
            line += f", friction {_percent(clutch['friction'], clutch['friction_sigma'])} of that at the beginning"
        yield line


def node_table(clutch: dict[str, Any]) -> Table:
    """Return the nodes of a map."""
    table = Table(title=f"Clutch {clutch['clutch']}")
    for heading in ("actuation", "torque N·m", "± N·m", "as learned N·m", "estimates", "valid"):
        table.add_column(heading, justify="right")
    for node in clutch["nodes"]:
        table.add_row(
            f"{node['actuation']:.3g}",
            f"{node['capacity_nm']:.1f}",
            f"{node['sigma_nm']:.1f}",
            f"{node['raw_nm']:.1f}",
            f"{node['samples']:.1f}",
            "yes" if node["valid"] else "no",
        )
    return table


def clutch_table(clutches: list[dict[str, Any]]) -> Table:
    """Return what is known of each clutch beside its map; a column each."""
    table = Table(title="What was learned")
    table.add_column("")
    for clutch in clutches:
        table.add_column(f"clutch {clutch['clutch']}", justify="right")
    for heading, of in _ROWS:
        table.add_row(heading, *(of(clutch) for clutch in clutches))
    for number, residual in enumerate(clutches[0]["residuals"] if clutches else ()):
        shown = [clutch["residuals"][number] for clutch in clutches]
        cells = ["–" if r["mean_nm"] is None else f"{r['mean_nm']:+.1f}, RMS {r['rms_nm']:.1f}" for r in shown]
        table.add_row(f"estimate minus map at {residual['torque_nm']:g} N·m", *cells)
    for name, unit, factor, what in (
        ("engagements", "kJ", 1e-3, "engagements"),
        ("temperature_s", "°C", 1.0, "seconds"),
    ):
        for number, one in enumerate(clutches[0][name] if clutches else ()):
            cells = [f"{clutch[name][number]['value']:g}" for clutch in clutches]
            table.add_row(f"{what} {_range(one, factor)} {unit}", *cells)
    return table


def error_lines(errors: dict[str, dict[str, Any] | None]) -> Iterator[str]:
    """Yield how far the map of each clutch was from the truth, a line each."""
    for clutch, found in errors.items():
        if found is None:
            yield f"clutch {clutch} against the truth: nothing to compare, no node became valid before it slipped"
            continue
        share = f"{100 * found['rms_share']:.1f} % of the largest engine torque"
        held = f"{100 * found['covered']:.1f} % within 2 σ (σ {found['sigma_nm']:.1f} N·m)"
        worst = f"worst {found['worst_nm']:+.1f} N·m"
        yield f"clutch {clutch} against the truth: RMS {found['rms_nm']:.1f} N·m, {share}, {worst}; {held}"


def _with_sigma(value: float | None, sigma: float | None, digits: int = 2) -> str:
    return "–" if value is None or sigma is None else f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _percent(value: float, sigma: float) -> str:
    return f"{100 * value:.0f} ± {100 * sigma:.0f} %"


def _range(one: dict[str, Any], factor: float) -> str:
    if one["from"] is None:
        return f"below {factor * one['to']:g}"
    return (
        f"above {factor * one['from']:g}"
        if one["to"] is None
        else f"{factor * one['from']:g} to {factor * one['to']:g}"
    )


def _span(clutch: dict[str, Any], name: str, factor: float, digits: int) -> str:
    least, most = clutch[f"{name}_least"], clutch[f"{name}_most"]
    return "–" if least is None else f"{factor * least:.{digits}f} … {factor * most:.{digits}f}"


def _drift(clutch: dict[str, Any]) -> str:
    drift = clutch["touch_per_1000_km"]
    return "–" if drift is None else f"{drift:+.2f}"


_ROWS = (
    (
        "touch point",
        lambda c: _with_sigma(c["touch_point"], c["touch_sigma"]) + ("" if c["touch_valid"] else " (not valid)"),
    ),
    ("… least … most", lambda c: _span(c, "touch", 1.0, 2)),
    ("… by 1000 km", _drift),
    ("slope, N·m per unit", lambda c: _with_sigma(c["slope_nm_per_unit"], c["slope_sigma"], 1)),
    ("hysteresis", lambda c: _with_sigma(c["hysteresis"], c["hysteresis_sigma"], 3)),
    ("friction over the first", lambda c: _percent(c["friction"], c["friction_sigma"])),
    ("… least … most, %", lambda c: _span(c, "friction", 100.0, 0)),
    ("… by 100 K (or 100 kJ)", lambda c: _percent(c["friction_by_heat"], c["friction_by_heat_sigma"])),
    ("… by an e-fold of the slip", lambda c: _percent(c["friction_by_slip"], c["friction_by_slip_sigma"])),
    ("torque behind actuation, ms", lambda c: _with_sigma(1e3 * c["lag_s"], 1e3 * c["lag_sigma_s"], 1)),
    ("actuations that taught", lambda c: _span(c, "seen", 1.0, 2)),
    ("windows that taught, refused", lambda c: f"{c['taken']}, {c['refused']}"),
    ("slip that taught, s", lambda c: f"{c['slipped_s']:.1f}"),
    ("friction work, kJ", lambda c: f"{1e-3 * c['energy_j']:.1f}"),
    ("distance, km", lambda c: f"{c['distance_km']:.1f}"),
)
