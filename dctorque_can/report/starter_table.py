"""What is proposed for a vehicle file, as a table and in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich import box
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from dctorque_can.starter.starter import Starter

_STYLES = {"sure": "green", "likely": "yellow", "guess": "red"}
_NARROW = 110  # columns of a terminal that has no place for reasons


def starter_table(starter: Starter, width: int) -> Table:
    """Return a row for each proposal and protection, for a terminal of ``width`` columns."""
    table = Table(box=box.SIMPLE_HEAD, title="proposed", title_justify="left")
    table.add_column("key", no_wrap=True)
    table.add_column("signal", overflow="fold")
    table.add_column("sure?", no_wrap=True)
    if width >= _NARROW:
        table.add_column("why", overflow="fold")
    for each in starter.proposals:
        signals = " + ".join(entry.name for entry in each.entries)
        sure = f"[{_STYLES[each.level]}]{each.level}[/]"
        cells = [escape(each.key), escape(signals), sure, escape("; ".join(each.why))]
        table.add_row(*cells[: len(table.columns)])
    for found in starter.protections:
        if found.message in starter.messages:
            kind = str(found.fields.get("crc", "counter alone"))
            sure = f"[{_STYLES[found.level]}]{found.level}[/]"
            cells = [escape(f"protection.{found.message}"), escape(kind), sure, escape("; ".join(found.why))]
            table.add_row(*cells[: len(table.columns)])
    return table


def gap_lines(starter: Starter) -> list[str]:
    """Return what was not found, one line each, as markup."""
    lines = [
        f"[{'red' if gap.needed else 'yellow'}]gap[/]: {escape(gap.key)}: {escape(gap.why)}"
        for gap in starter.gaps
    ]
    lines += [
        f"[yellow]gap[/]: {escape(each.key)}.{name}: not known"
        for each in starter.proposals
        for name, value in each.fields.items()
        if value is None
    ]
    lines.append("[red]gap[/]: vehicle: class of the car, driven axle, ratios and final drives: no bus tells them")
    return lines


def summary(starter: Starter, file: str) -> str:
    """Return how much was found, in one sentence."""
    levels: list[str] = [each.level for each in starter.proposals]
    counts = ", ".join(f"{levels.count(level)} {level}" for level in _STYLES)
    source = f"{starter.seconds:.0f} s of log" if starter.seconds else "no log"
    return f"{file}: {len(levels)} proposals ({counts}) from {source}; {len(starter.gaps)} keys not found"


def starter_json(starter: Starter, file: str, problems: list[str]) -> dict[str, Any]:
    """Return all of it for scripts."""
    from dctorque_can.starter.document import key_fields

    return {
        "file": file,
        "seconds": starter.seconds,
        "proposals": [
            {
                "key": each.key,
                "signals": [entry.name for entry in each.entries],
                "level": each.level,
                "merit": round(each.merit, 2),
                "why": list(each.why),
                "fields": {str(name): value for name, value in key_fields(starter, each).items()},
                "alternatives": [c.entry.name for c in each.alternatives],
            }
            for each in starter.proposals
        ],
        "gaps": [{"key": gap.key, "why": gap.why, "needed": gap.needed} for gap in starter.gaps],
        "gears_source": starter.gear_source or None,
        "clutch_phase_source": starter.phase_source,
        "protections": [
            {"message": each.message, "level": each.level, "why": list(each.why), "fields": each.fields}
            for each in starter.protections
            if each.message in starter.messages
        ],
        "total_ratios": {str(gear): round(ratio, 3) for gear, ratio in starter.ratios.items()},
        "remarks": list(starter.remarks),
        "incomplete": problems,
    }
