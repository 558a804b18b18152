"""What was identified, as tables and lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dctorque_can.identify.command import Identified
    from dctorque_can.identify.regression import Belief

_SENSITIVE = 5  # numbers that are shown


def tables(found: Identified) -> Iterator[Table]:
    """Yield the numbers, and what the estimator makes of what was held out."""
    table = Table(title="Numbers of the vehicle file")
    for name in ("Number", "before", "now", "unit", "told"):
        table.add_column(name, justify="left" if name in ("Number", "unit") else "right", no_wrap=name == "Number")
    for each in found.results:
        told = "refused" if each.refused else f"{each.told:.0%}" if each.changes else "-"
        table.add_row(each.key, _shown(each.before), _shown(each.after), each.unit, told)
    yield table
    table = Table(title="What was held out")
    table.add_column("")
    table.add_column("before", justify="right")
    table.add_column("now", justify="right")
    for sensor, value in found.before.nis.items():
        table.add_row(
            f"normalised innovations squared, {sensor} (1 is right)",
            f"{value:.2f}",
            f"{found.after.nis.get(sensor, float('nan')):.2f}",
        )
    table.add_row("engine torque against the nominal one", f"{found.before.gain:+.1%}", f"{found.after.gain:+.1%}")
    table.add_row("estimates with valid clutch torques", f"{found.before.valid:.1%}", f"{found.after.valid:.1%}")
    yield table


def _shown(belief: Belief) -> str:
    """Return value ± sigma to the digits that sigma leaves."""
    sigma = belief.sigma
    if sigma <= 0.0:
        return f"{belief.value:.4g}"
    digits = 0
    while digits < 9 and sigma * 10**digits < 2.0:
        digits += 1
    return f"{belief.value:.{digits}f} ± {sigma:.{digits}f}"


def summary_lines(found: Identified) -> list[str]:
    """Return what else there is to say."""
    lines = []
    if "delays" in found.common:
        together, apart = found.common["delays"]
        lines.append(
            f"delays are known to {apart:.1f} ms against each other, and all together to {together:.1f} ms"
        )
    if "ratios" in found.common:
        together, apart = found.common["ratios"]
        lines.append(f"ratios and wheel radius: to {apart:.3%} against each other, and together to {together:.2%}")
    lines += [
        f"{first} and {second} hang together ({together:+.2f}): who knows one from elsewhere knows both"
        for first, second, together in found.correlations
    ]
    for each in found.sensitivities[:_SENSITIVE]:
        one, two, out = each.torques_nm
        lines.append(
            f"one standard deviation of {each.key} changes clutch 1, clutch 2 and output by "
            f"{one:.1f}, {two:.1f} and {out:.1f} N·m"
        )
    lines += [f"with the new numbers: {sentence}" for sentence in found.after.findings]
    refused = [each.key for each in found.results if each.refused]
    if refused:
        lines.append(f"back to what was believed, as they suit only what was fitted: {', '.join(refused)}")
    untold = [each.key for each in found.results if not each.changes and not each.refused]
    if untold:
        lines.append(f"not told by these drives, so left as they are: {', '.join(untold)}")
    lines += map(str, found.missing)
    if found.unclear:
        lines.append(f"hardly told, though these logs hold what could tell: {', '.join(found.unclear)}")
    counts = ", ".join(f"{kind} {fitted} and {held}" for kind, (fitted, held) in found.equations.items())
    lines.append(f"equations fitted and held out: {counts}")
    if not any(held for _, held in found.equations.values()):
        lines.append("nothing was held out, so nothing shows an overfit: of a recording each second minute is")
    where = f"written to {found.output}" if found.output is not None else "nothing written (-o FILE)"
    lines.append(f"{len(found.edits)} numbers changed; {where}")
    return lines


def plan_lines(found: Identified | None) -> list[str]:
    """Return which drives to record: for everything, or for what is lacking."""
    from dctorque_can.identify.plan import DRIVES, lacking

    if found is None:
        return [f"{group}: {drive}" for group, drive in DRIVES.items()]
    missing = lacking(found.results)
    if not missing:
        return ["nothing is lacking: each number was told by half at least"]
    return [f"{group} ({', '.join(keys)}): {DRIVES[group]}" for group, keys in missing.items()]
