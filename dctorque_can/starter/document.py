"""The text of a proposed vehicle file: every key with how sure it is and why, every gap marked."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from dctorque_can.resources import shipped_classes
from dctorque_can.starter.catalogue import NOMINAL_RADIUS_M, Entry
from dctorque_can.starter.proposal import Gap, Proposal
from dctorque_can.starter.starter import Starter

_WIDTH = 118
_GEARS = {0: "neutral", -1: "reverse"}
_HINTS = {
    "values": "raw value to its meaning",
    "reference_nm": "the torque that is 100 %, N·m",
    "kissing_point": "position at which the clutch begins to carry torque: log a slow engagement at standstill",
    "hysteresis": "full width of the band around it, such as a fiftieth of the way",
    "closes": "increasing or decreasing",
    "threshold_nm": "commanded torque above which the clutch carries torque",
    "hysteresis_nm": "full width of the band around it",
}
_HEADER = """\
Proposed by `dctorque init` from {sources}.
sure: name and unit are clear, the log agrees, and no other signal is nearly as good. likely: most of that.
guess: look at it before you use it. GAP: not found, or nothing on a bus can tell it.
Go on with: dctorque check {file}{log}"""


def vehicle_file(starter: Starter, path: Path, logs: Iterable[Path]) -> str:
    """Return the text of a vehicle file that will stand at ``path``."""
    names = [dbc.path.name for dbc in starter.dbcs] + [log.name for log in logs]
    hint = "".join(f" --log {log}" for log in logs)
    lines = [
        *_comment(_HEADER.format(sources=", ".join(names), file=path, log=hint).split("\n"), 0),
        *_comment(starter.remarks[:20], 0),
        f"name: {_flow(path.stem)}",
        "",
        *_vehicle(starter),
        "",
        *_databases(starter, path),
        "",
        *_inputs(starter),
        "",
        *_protection(starter),
        *_section(starter, "gears", starter.gear_source or "gearbox"),
        "",
        *_section(starter, "clutch_phase", starter.phase_source),
    ]
    return "\n".join(lines) + "\n"


def _comment(texts: Iterable[str], indent: int) -> list[str]:
    """Return texts as comments, wrapped; what continues one is indented."""
    lines = []
    pad = " " * indent + "# "
    for text in texts:
        lines += textwrap.wrap(
            " ".join(text.split()),
            _WIDTH,
            initial_indent=pad,
            subsequent_indent=pad + "  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
    return lines


def _flow(value: Any) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return text.removesuffix("...\n").strip()


def _vehicle(starter: Starter) -> list[str]:
    """Return the section that a brochure tells, and a class of cars."""
    classes = ", ".join(path.stem for path in shipped_classes())
    gears = sorted(gear for gear in _gears_of(starter) if gear > 0) or list(range(1, 8))
    lines = [
        "vehicle:",
        *_comment([f"GAP: what no brochure tells. The nearest one of: {classes}"], 2),
        "  class: GAP",
        *_comment(["GAP: the driven axle: front, rear or all"], 2),
        "  # driven_axle: front",
        *_comment(["GAP: mass and rolling radius of the wheels; without them those of the class count"], 2),
        "  # chassis: {mass_kg: 1500, wheel_radius_m: 0.31}",
        *_comment(["GAP: ratio and final drive of each gear, and its shaft: that with gear 1 is shaft 1"], 2),
    ]
    if starter.ratios:
        what = f"ratio times final drive as the log has it, of road speeds with wheels of {NOMINAL_RADIUS_M} m"
        lines += _comment(
            [f"{what}: " + ", ".join(f"{gear}: {ratio:.2f}" for gear, ratio in starter.ratios.items())], 2
        )
    lines.append("  # gears:")
    lines += [f"  #   {gear}: {{shaft: {2 - gear % 2}, ratio: 0.0, final_drive: 0.0}}" for gear in gears]
    return [*lines, "  #   R: {shaft: 2, ratio: 0.0, final_drive: 0.0}"]


def _gears_of(starter: Starter) -> set[int]:
    found = [
        p.fields.get("values") or {}
        for p in starter.proposals
        if p.key.startswith("gears.") and "shift" not in p.key
    ]
    return {gear for values in found for gear in values.values()}


def _databases(starter: Starter, path: Path) -> list[str]:
    lines = ["databases:"]
    for number, dbc in enumerate(starter.dbcs):
        entry: dict[str, Any] = {"file": os.path.relpath(dbc.path, path.parent)}
        if not dbc.strict:
            entry["strict"] = False
        if number in starter.channels:
            entry["channel"] = starter.channels[number]
        if number in starter.j1939:
            entry["j1939"] = True
        lines.append(f"  - {_flow(entry)}")
    return lines


def _inputs(starter: Starter) -> list[str]:
    lines = ["inputs:"]
    wheels = [each for each in starter.found if each.key.startswith("inputs.wheel_speeds.")]
    for each in starter.found:
        if not each.key.startswith("inputs."):
            continue
        if each in wheels:
            if each is wheels[0]:
                any_wheel = any(isinstance(wheel, Proposal) for wheel in wheels)
                lines.append("  wheel_speeds:" if any_wheel else "  wheel_speeds: {}")
                for wheel in wheels:
                    lines += _lines(starter, wheel, 4)
            continue
        lines += _lines(starter, each, 2)
    return lines


def _section(starter: Starter, section: str, source: str) -> list[str]:
    """Return a section with a source."""
    lines = [f"{section}:"]
    if section == "clutch_phase" and source == "none":
        why = "guess: no position, torque or state of the clutches was found: the speeds say what a clutch carries"
        lines += _comment([why], 2)
    if section == "gears" and source == "ratio":
        lines += _comment(["guess: no gear signal was found: the speeds of shafts and wheels tell the gears"], 2)
    lines.append(f"  source: {_flow(source)}")
    for each in starter.found:
        if each.key.startswith(f"{section}."):
            lines += _lines(starter, each, 2)
    return lines


def _lines(starter: Starter, each: Proposal | Gap, indent: int) -> list[str]:
    pad = " " * indent
    key = each.key.rpartition(".")[2]
    if isinstance(each, Gap):
        word = "GAP, needed" if each.needed else "GAP"
        return [*_comment([f"{word}: {each.why}"], indent), f"{pad}# {key}: {{signal: Message.Signal}}"]
    told = [f"{each.level}: {'; '.join(each.why)}"]
    if each.entry.message.name in starter.periods:
        period = starter.periods[each.entry.message.name]
        told[0] += f"; comes every {period.median_ms:g} ms, seldom after {period.longest_usual_ms:g} ms"
    if each.entry.name in starter.no_value:
        by_table = set(starter.no_value[each.entry.name]) == set(each.entry.no_value)
        told.append(
            "no value: " + ("by the value table" if by_table else "all bits are set in the log, far from the rest")
        )
    if each.entry.name in starter.units:
        unit, why = starter.units[each.entry.name]
        told.append(f"unit: the DBC has none; {unit}: {why}")
    if each.alternatives:
        others = ", ".join(f"{c.entry.name}{_speaks_against(c.verdict.why)}" for c in each.alternatives)
        told.append(f"others: {others}")
    fields = key_fields(starter, each)
    missing = [name for name, value in fields.items() if value is None]
    there = {name: value for name, value in fields.items() if value is not None}
    line = f"{pad}{key}: {_flow(there)}"
    if not missing and len(line) <= _WIDTH:
        return [*_comment(told, indent), line]
    block = [f"{pad}  {name}: {_flow(value)}" for name, value in there.items()]
    gaps = [f"{pad}  # {name}:   # GAP: {_HINTS[name]}" for name in missing]
    return [*_comment(told, indent), f"{pad}{key}:", *block, *gaps]


def _speaks_against(why: str) -> str:
    return f" ({why})" if why else ""


def key_fields(starter: Starter, proposal: Proposal) -> dict[str, Any]:
    """Return what stands at the key of a proposal, in order; None for a gap within it."""
    given = dict(proposal.fields)
    entry = proposal.entry
    measured = proposal.key.startswith("inputs.") and proposal.key != "inputs.direction"
    measured = measured or proposal.key.startswith("clutch_phase.clutch")
    fields: dict[str, Any] = {}
    if "sum" in given:
        by_name = {each.name: each for each in proposal.entries}
        fields["sum"] = [term | _special(starter, by_name[term["signal"]], measured) for term in given.pop("sum")]
    elif "signals" in given:
        fields["signals"] = given.pop("signals")
    else:
        fields["signal"] = entry.name
    if entry.name in starter.units and measured:
        fields["unit"] = starter.units[entry.name][0]
    if "times" in given:
        by_name = {each.name: each for each in proposal.entries}
        times = given.pop("times")
        fields["times"] = times | _special(starter, by_name[times["signal"]], measured)
    if "values" in given:
        fields["values"] = _values(proposal.key, given.pop("values"))
    if "sum" not in fields:
        fields |= _special(starter, entry, measured)
    timeouts = [
        t
        for each in proposal.entries
        if "times" not in fields or each is not proposal.extra[-1]
        for t in [starter.timeout_ms(each)]
        if t
    ]
    if timeouts:
        fields["timeout_ms"] = max(timeouts)
    return fields | given


def _special(starter: Starter, entry: Entry, measured: bool) -> dict[str, Any]:
    values = starter.no_value.get(entry.name)
    return {"not_available": list(values)} if values and measured else {}


def _values(key: str, values: Mapping[int, Any] | None) -> dict[int, Any] | None:
    if values is None:
        return None
    gears = key.startswith("gears.") and "shift" not in key
    return {raw: _GEARS.get(meaning, meaning) if gears else meaning for raw, meaning in values.items()}


def _protection(starter: Starter) -> list[str]:
    used = starter.messages
    lines: list[str] = []
    for found in starter.protections:
        if found.message in used:
            lines += _comment([f"{found.level}: {'; '.join(found.why)}"], 2)
            line = f"  {found.message}: {_flow(found.fields)}"
            block = [
                f"  {found.message}:",
                *(f"    {name}: {_flow(value)}" for name, value in found.fields.items()),
            ]
            lines += [line] if len(line) <= _WIDTH else block
    for message, why in starter.unprotected.items():
        if message in used:
            lines += _comment([f"GAP: {message}: {why}"], 2)
    if not lines:
        return []
    live = any(not line.lstrip().startswith("#") for line in lines)
    return ["protection:" if live else "protection: {}", *lines, ""]
