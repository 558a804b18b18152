"""The findings of ``dctorque design`` as tables for people, at most 100 columns wide."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table

from dctorque_can.design.conditions import pair_name

ENGINE_ERROR = 10.0  # N·m, example of what cannot be seen
OUTPUT_ERROR = 100.0  # N·m at the wheels


def design_tables(report: dict[str, Any]) -> Group:
    """Return what `judgement.Design.report` found, with the ``name`` of the vehicle."""
    parts = (_gains, _eigenvalues, _unobservable, _checks, _limits, _noise_and_lag, _sweep)
    return Group(*(part(report) for part in parts))


def _table(*headings: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for heading in headings:
        left = heading in ("gears", "condition", "drive", "detail")
        table.add_column(heading, justify="left" if left else "right", no_wrap=heading != "detail")
    return table


def _name(pair: dict[str, Any]) -> str:
    return pair_name((pair["gear1"], pair["gear2"]))


def _gains(report: dict[str, Any]) -> RenderableType:
    g = report["gains"]
    title = (
        f"{report['name']}: gains of the observer\n"
        f"l_1 = {g['l_1_per_s']:.4g} 1/s, l_2 = {g['l_2_nm_per_rad']:.5g} N·m/rad, "
        f"l_3 = {g['l_3_per_s']:.4g} 1/s, L_1 = L_2 = {g['L_per_s']:.4g} 1/s,\n"
        f"γ_e = {g['gamma_e_s_per_rad2']:.3g} s/rad², γ_l = {g['gamma_l_per_s']:.3g} 1/s; the others by gears:"
    )
    table = _table("gears", "R_1", "R_2", "J_e1 kg·m²", "l_4 N·m/rad", "γ_t s³/rad²")
    for pair in report["pairs"]:
        table.add_row(
            _name(pair),
            f"{pair['R_1']:.4g}",
            f"{pair['R_2']:.4g}",
            f"{pair['J_e1_kgm2']:.4g}",
            f"{pair['l_4_nm_per_rad']:.4g}",
            f"{pair['gamma_t_s3_per_rad2']:.3g}",
        )
    return Group(escape(title), table)


def _poles(values: list[list[float]]) -> str:
    """Return the slow pole and the pair; a double pole's imaginary part is rounding."""
    slow, (real, imaginary), _ = values
    if abs(imaginary) < 1e-3 * abs(real):
        pair = " ".join(f"{value[0]:.4g}" for value in values[1:])
    else:
        pair = f"{real:.4g}±{abs(imaginary):.3g}i"
    return f"{slow[0]:.3g}  {pair}"


def _eigenvalues(report: dict[str, Any]) -> RenderableType:
    table = _table("gears", "drive", "ω_e", "dω_w/dt", "τ_e, ω_e, T_c", "τ_o, ω_c1, T_a1", "rank", "leaky")
    for pair in report["pairs"]:
        for k, condition in enumerate(pair["conditions"]):
            table.add_row(
                "" if k else _name(pair),
                condition["name"],
                f"{condition['engine_speed_rad_s']:.0f}",
                f"{condition['wheel_acceleration_rad_s2']:.1f}",
                _poles(condition["engine_eigenvalues_per_s"]),
                _poles(condition["shaft_eigenvalues_per_s"]),
                f"{condition['rank']}/6",
                f"{condition['rank_with_leakage']}/6",
            )
    poles = -report["gains"]["L_per_s"]
    title = (
        f"Poles of the frozen error system, 1/s (of T_c1 and T_c2: {poles:g}), and rank of its observability;\n"
        "ω_e in rad/s, dω_w/dt in rad/s²"
    )
    return Group(title, table)


def _unobservable(report: dict[str, Any]) -> RenderableType:
    table = _table("gears", "engine: T_c", "T_c1", "T_c2", "output: T_a1", "T_c1", "T_c2")
    for pair in report["pairs"]:
        m = pair["misreading_nm_per_nm"]
        engine = (m["sum_per_engine"], m["clutch1_per_engine"], m["clutch2_per_engine"])
        output = (m["side_per_output"], m["clutch1_per_output"], m["clutch2_per_output"])
        table.add_row(
            _name(pair),
            *(f"{ENGINE_ERROR * share:+.1f}" for share in engine),
            *(f"{OUTPUT_ERROR * share:+.1f}" for share in output),
        )
    title = (
        f"What no data can tell: an engine torque {ENGINE_ERROR:g} N·m too high (δτ_e ω_e = δT_c), and an output "
        f"torque\n{OUTPUT_ERROR:g} N·m too high at the wheels (δτ_o dω_w/dt/R_1 = δT_a1), are read as, N·m:"
    )
    pair = report["pairs"][0]
    m = pair["misreading_nm_per_nm"]
    words = (
        f"In gears {_name(pair)} an engine torque error of {ENGINE_ERROR:g} N·m is read as {ENGINE_ERROR:g} N·m "
        f"of clutch torque sum, {ENGINE_ERROR * m['clutch1_per_engine']:+.1f} on clutch 1 and "
        f"{ENGINE_ERROR * m['clutch2_per_engine']:+.1f} on clutch 2. With leakage (leaky) the prior fills the "
        f"gap, at γ_l = {report['gains']['gamma_l_per_s']:.3g} 1/s to τ_e = 0 and τ_o = τ_on, not the data. "
        "At cruise τ_o moves nothing at all."
    )
    return Group(title, table, words, "")


def _checks(report: dict[str, Any]) -> RenderableType:
    table = _table("condition", "", "detail")
    for check in report["checks"]:
        word = "holds" if check["holds"] else "[yellow]violated[/]"
        table.add_row(escape(check["condition"]), word, escape(check["text"]))
    return Group("Conditions (73) to (76), and what they leave out", table)


def _limits(report: dict[str, Any]) -> RenderableType:
    rows = Table.grid(padding=(0, 1))
    for limit in report["limits_of_the_proof"]:
        rows.add_row("•", escape(limit["text"]))
    return Group(rows, "")


def _torques(noise: dict[str, Any], lag: dict[str, Any], at: int | None = None) -> list[str]:
    def number(values: dict[str, Any], name: str) -> str:
        value = values[name] if at is None else values[name][at]
        return "–" if value is None else f"{abs(value):.3g}"

    names = (
        "clutch_torque_sum_nm",
        "side_torque_nm",
        "output_torque_adaptive_nm",
        "clutch1_torque_uio_nm",
        "clutch2_torque_uio_nm",
        "clutch1_torque_nm",
        "clutch2_torque_nm",
    )
    return [*(number(noise, name) for name in names), *(number(lag, name) for name in names[-2:])]


TORQUE_HEADINGS = ("T_c", "T_a1", "T_o", "T_c1 uio", "T_c2 uio", "T_c1", "T_c2", "lag T_c1", "lag T_c2")


def _noise_and_lag(report: dict[str, Any]) -> RenderableType:
    s = report["sensors"]
    title = (
        f"Noise σ and lag, N·m, accelerating: sensors {s['engine_rad_s']:g}, {s['shaft_rad_s']:g}, "
        f"{s['wheel_rad_s']:g} rad/s every {s['engine_period_us'] / 1000:g}, {s['shaft_period_us'] / 1000:g}, "
        f"{s['wheel_period_us'] / 1000:g} ms\n(engine, shafts, wheel); lag of an upshift that hands over "
        f"{report['hand_over_nm_per_s']:g} N·m/s"
    )
    table = _table("gears", *TORQUE_HEADINGS)
    for pair in report["pairs"]:
        table.add_row(_name(pair), *_torques(pair["noise_nm"], pair["lag_nm"]))
    return Group(title, table)


def _sweep(report: dict[str, Any]) -> RenderableType:
    sweep = report["sweep"]
    table = _table("factor", *TORQUE_HEADINGS)
    for k, factor in list(enumerate(sweep["factors"]))[::2]:
        refused = factor > sweep["largest_factor_allowed"]
        mark = "*" if refused else "<" if factor == 1.0 else " "
        cells = _torques(sweep["noise_nm"], sweep["lag_nm"], k)
        table.add_row(f"{factor:.2f}{mark}", *cells, style="bold" if factor == 1.0 else "dim" if refused else None)
    varied = ", ".join(name.removesuffix("_bandwidth_rad_s").removesuffix("_rad_s") for name in sweep["varied"])
    title = f"Gears {_name(sweep)}: bandwidths times a factor ({varied})"
    balanced = sweep["balanced_factor"]
    words = (
        f"σ and lag of the worse clutch are equal at a factor of {balanced:.2g}."
        if balanced is not None
        else "σ and lag of the worse clutch do not meet within these factors."
    )
    if sweep["largest_factor_allowed"] < sweep["factors"][-1]:
        words += f" *: above {sweep['largest_factor_allowed']:.3g} too fast for step_ms, refused."
    return Group(title, table, words)
