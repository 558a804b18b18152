"""The vehicle file with what was identified: the user's own text, with a comment at each number that changed."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

from dctorque_can.config.load import Config
from dctorque_can.evidence.draft import number
from dctorque_can.evidence.yaml_edits import Edit, edited, old_value
from dctorque_can.identify.results import Result


def changes(config: Config, results: Sequence[Result]) -> list[Edit]:
    """Return what changes in the text of a vehicle file: each number with its standard deviation."""
    text = config.documents[config.path.name].decode("utf-8-sig")
    edits = []
    for result in results:
        if not result.changes:
            continue
        was = old_value(text, result.key)
        digits = _digits(result)
        value = f"{{value: {number(result.after.value, digits)}, sigma: {number(result.after.sigma, 2)}}}"
        comment = f"identify: {'was ' + was if was else 'not in the file before'}; {result.told:.0%} told"
        edits.append(Edit(result.key, value, comment))
    return edits


def _digits(result: Result) -> int:
    """Return how many digits of a value its standard deviation leaves, and one more."""
    value, sigma = abs(result.after.value), result.after.sigma
    if value <= 0.0 or sigma <= 0.0:
        return 4
    return min(max(floor(log10(value / sigma)) + 3, 3), 8)


def identified_text(config: Config, edits: Sequence[Edit]) -> str:
    """Return the text of the vehicle file with changes."""
    return edited(config.documents[config.path.name].decode("utf-8-sig"), list(edits))
