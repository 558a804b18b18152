"""What a recording says against a vehicle file: one finding for each contradiction, with the key to look at."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Literal

from dctorque_can.config.input_builder import InputEntry
from dctorque_can.config.load import Config
from dctorque_can.config.problems import Problem
from dctorque_can.evidence.intervals import Interval
from dctorque_can.evidence.series import Floats

MANY = 0.01
"""Share of the frames of an input from which it is told that something is wrong with them."""
OFTEN_STALE = 1.0
"""A timeout of less than so many usual intervals makes an input stale in between."""
ROOM = 3.0
"""Usual intervals that a proposed timeout has room for."""
OTHER_PERIOD = 1.5
"""Times as long, or as short, as the DBC says."""
_WORDS = {
    "bad_crc": (
        "the checksum of {share:.0%} of the frames is wrong: look at its kind (crc), data_id and crc_signal, and "
        "whether the DBC fits the car"
    ),
    "bad_counter": (
        "the counter of {share:.0%} of the frames does not step as told: look at counter_signal, counter_modulus "
        "and max_counter_delta; or frames are lost"
    ),
    "not_believed": (
        "{share:.0%} of the frames are right and not believed, since many others of their message are not"
    ),
    "bad_rate": "{share:.0%} of the values change faster than max_rate says: is that what this quantity can do?",
    "bad_length": "{share:.0%} of the frames are too short for the counter or checksum: does the DBC fit the car?",
    "out_of_range": (
        "{share:.0%} of the values are beyond the plausible range: look at unit, factor and offset, at "
        "not_available, and at the range"
    ),
    "not_available": (
        "{share:.0%} of the frames have no value (a raw value that means none, or that `values` does not name, or "
        "a multiplier that is missing)"
    ),
}
_OF_THE_FRAME = ("bad_crc", "bad_counter", "bad_length", "not_believed")

Severity = Literal["error", "warning", "hint"]


@dataclass(frozen=True, slots=True)
class Picture:
    """What shows a finding: points as they were recorded, and lines for what the file and what the recording says.

    Attributes:
        x_label, y_label: of the axes, with units.
        x, y: the points ``[n]``.
        lines: name, and the points of each.
    """

    x_label: str
    y_label: str
    x: Floats
    y: Floats
    lines: tuple[tuple[str, Floats, Floats], ...]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that a recording says of a vehicle file.

    Attributes:
        severity: error: torques are not valid, or nothing comes; warning: something is wrong; hint: worth a look.
        key: dotted key to look at first.
        text: what was found, and what would be right.
        value: number to set at that key, where one was measured; None else.
        sigma: its standard deviation, where that is known; None else.
        fix: the values that correct it, as YAML by their dotted keys; empty where it is not certain what would be
            right.
        explains: findings of the monitor (`plausibility.findings`) that have the same cause.
        picture: what shows it, if anything does.
        also: the values that have to change with those of ``fix``, although nothing is wrong with them.
    """

    severity: Severity
    key: str
    text: str
    value: float | None = None
    sigma: float | None = None
    fix: tuple[tuple[str, str], ...] = ()
    explains: frozenset[str] = frozenset()
    picture: Picture | None = field(default=None, compare=False)
    also: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the fields for a JSON report."""
        return {name: getattr(self, name) for name in ("severity", "key", "text", "value", "sigma")}


def findings(
    config: Config,
    health: Mapping[str, Any],
    never_received: Sequence[str],
    intervals: Mapping[str, Interval],
) -> list[Finding]:
    """Return what a recording says, the worst first.

    Args:
        config: what the vehicle file says; its warnings become findings.
        health: of `analysis.health.health_counts`.
        never_received: quantities of which there is no usable value, in lower case.
        intervals: by name of the message; none at all is a recording without any mapped frame, of which nothing
            more is said.
    """
    found = [_doubt(problem) for problem in config.warnings]
    for entry in config.entries if intervals else ():
        name = entry.input.quantity.name.lower()
        if name in never_received and not any(term.message in intervals for term in entry.input.signals):
            messages = list(dict.fromkeys(term.message for term in entry.input.signals))
            text = f"not in the recording: {', '.join(messages)}"
            found.append(Finding("error", entry.key, text))
            continue
        found += _counted(entry, health)
    found += _periods(config.entries, intervals)
    found += [_contradiction(each) for each in health["findings"]]
    found += [Finding("hint", each["key"], each["says"], each["value"]) for each in health["hints"]]
    return sorted(dict.fromkeys(found), key=lambda finding: ("error", "warning", "hint").index(finding.severity))


def _doubt(problem: Problem) -> Finding:
    return Finding("warning" if problem.key.startswith("vehicle.") else "hint", problem.key, problem.reason)


def _counted(entry: InputEntry, health: Mapping[str, Any]) -> Iterator[Finding]:
    name = entry.input.quantity.name.lower()
    counts = {fault: health[fault].get(name, 0) for fault in _WORDS}
    total = health["accepted"].get(name, 0) + sum(counts.values())
    for fault, count in counts.items():
        share = count / max(total, 1)
        if share < MANY:
            continue
        of_frame = fault in _OF_THE_FRAME
        messages = dict.fromkeys(term.message for term in entry.input.terms)
        severity: Severity = "error" if count == total else "hint" if fault == "not_available" else "warning"
        for key in [f"protection.{message}" for message in messages] if of_frame else [entry.key]:
            yield Finding(severity, key, _WORDS[fault].format(share=share))


def _periods(entries: Sequence[InputEntry], intervals: Mapping[str, Interval]) -> Iterator[Finding]:
    for entry in entries:
        timeout_ms = entry.input.timeout_us / 1000
        for term, told_ms in zip(entry.input.terms, entry.periods_ms, strict=True):
            measured = intervals.get(term.message)
            if measured is None or measured.median_ms == 0.0:
                continue
            usual = measured.longest_usual_ms
            if not entry.input.learns_timeout and timeout_ms < OFTEN_STALE * usual:
                text = (
                    f"{term.message} comes every {measured.median_ms:g} ms, with up to {usual:g} ms in between: "
                    f"after timeout_ms = {timeout_ms:g} it is stale"
                )
                value = float(ceil(ROOM * measured.median_ms))
                key = f"{entry.key}.timeout_ms"
                yield Finding("warning", key, text, value, fix=((key, f"{value:g}"),))
            if told_ms and not 1 / OTHER_PERIOD <= measured.median_ms / told_ms <= OTHER_PERIOD:
                text = f"{term.message} comes every {measured.median_ms:g} ms, the DBC says {told_ms:g} ms"
                yield Finding("hint", "databases", text)


def _contradiction(found: Mapping[str, Any]) -> Finding:
    severity: Severity = "error" if found["torques_not_valid"] else "warning"
    return Finding(severity, found["key"], found["says"])
