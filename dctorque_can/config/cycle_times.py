"""What timeouts stand on where a DBC has no cycle times."""

from __future__ import annotations

from collections.abc import Sequence

from dctorque_can.config.document import Document
from dctorque_can.config.input_builder import InputEntry

ATTRIBUTE = "GenMsgCycleTime"


def note_missing_cycle_times(document: Document, entries: Sequence[InputEntry]) -> None:
    """Warn, once, of the messages without a cycle time: nothing tells whether the timeouts of their inputs fit."""
    timeouts: dict[str, set[float]] = {}
    known = 0
    for entry in entries:
        for term, period in zip(entry.input.terms, entry.periods_ms, strict=True):
            if entry.input.learns_timeout:
                continue
            if period is None:
                timeouts.setdefault(term.message, set()).add(entry.input.timeout_us / 1000)
            else:
                known += 1
    if not timeouts:
        return
    listed = ", ".join(f"{message} {_shown(values)}" for message, values in sorted(timeouts.items()))
    which = "of some mapped messages" if known else "of any mapped message"
    reason = (
        f"no cycle time ({ATTRIBUTE}) {which} in the DBC: their timeouts stand on timeout_ms alone (100 where not "
        f"given), no period is known to hold them against. Timeouts: {listed}. Look in a log how often they come"
    )
    document.problems.append(document.problem(("databases",), reason, warning=True))


def _shown(values: set[float]) -> str:
    return " and ".join(f"{value:g} ms" for value in sorted(values))
