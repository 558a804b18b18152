"""A run in Markdown."""

from __future__ import annotations

from collections.abc import Iterable

from .account import Account
from .run import Run
from .verdicts import Verdict

WORDS = {True: "holds", False: "BROKEN", None: "not judged"}


def verdict_lines(verdicts: Iterable[Verdict]) -> list[str]:
    return [f"{WORDS[each.holds]:10}  {each.name}: {each.text}" for each in verdicts]


def report(run: Run, account: Account, verdicts: list[Verdict], command: str, facts: dict[str, str]) -> str:
    """Return the report of a run; ``facts`` are of it and its computer."""
    lines = ["# Soak", "", "```sh", command, "```", ""]
    lines += ["| | |", "|---|---|", *(f"| {name} | {fact} |" for name, fact in facts.items()), ""]
    lines += ["## Invariants", "", "| invariant | | figures |", "|---|---|---|"]
    lines += [f"| {each.name} | {WORDS[each.holds]} | {each.text} |" for each in verdicts]
    lines += ["", "## Recovery", "", *_recovery(run, account)]
    return "\n".join(lines) + "\n"


def _recovery(run: Run, account: Account) -> list[str]:
    lines = [
        "Seconds from the end of the fault, of a kill from the kill, to the next frame of the service on the bus,",
        "to valid torques of both clutches, and to the next frame in a log. Median and longest.",
        "",
        "| fault | times | on the bus | valid | in a log |",
        "|---|---|---|---|---|",
    ]
    logged = dict(zip(map(id, run.events), account.log_again_s, strict=True))
    for name in dict.fromkeys(event.name for event in run.events):
        events = [event for event in run.events if event.name == name]
        cells = [_spread(event.heard_after_s for event in events)]
        cells.append(_spread(event.valid_after_s for event in events))
        cells.append(_spread(logged[id(event)] for event in events))
        lines.append(f"| {name} | {len(events)} | {' | '.join(cells)} |")
    return lines


def _spread(times: Iterable[float | None]) -> str:
    given = list(times)
    known = sorted(time for time in given if time is not None)
    never = f", {len(given) - len(known)} never" if len(known) < len(given) else ""
    if not known:
        return "never"
    return f"{known[len(known) // 2]:.2f}, {known[-1]:.2f}{never}"
