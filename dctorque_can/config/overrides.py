"""Values from the command line (``--set can.channel=vcan0``) laid over a parsed file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dctorque_can.config.document import Document, parse, shown
from dctorque_can.config.problems import Problem

SOURCE = "--set"


def parse_overrides(settings: list[str]) -> dict[str, str]:
    """Return ``["can.channel=vcan0"]`` as ``{"can.channel": "vcan0"}``.

    Raises:
        ValueError: an entry is not of the form KEY=VALUE.
    """
    pairs: dict[str, str] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ValueError(f"{text!r} must be KEY=VALUE, such as can.channel=vcan0")
        pairs[key.strip()] = value
    return pairs


def apply_overrides(document: Document, overrides: Mapping[str, str]) -> None:
    """Lay each dotted key with its value, written as in YAML, over ``document.data``."""
    for key, text in overrides.items():
        parsed = parse(f"value: {text}".encode(), SOURCE)
        if parsed.problems:
            reason = f"the value is {parsed.problems[0].reason}"
            document.problems.append(Problem(SOURCE, 0, key, text, reason))
            continue
        _lay(document, _of_first_bus(document, key), parsed.data["value"])


def _of_first_bus(document: Document, key: str) -> str:
    """Return a key such as can.channel as can.0.channel, where `can` is a list of buses."""
    section, _, rest = key.partition(".")
    several = section == "can" and isinstance(document.data.get("can"), list)
    return f"can.0.{rest}" if several and rest and not rest.split(".")[0].isdigit() else key


def _lay(document: Document, key: str, value: Any) -> None:
    """Put ``value`` at the dotted ``key``, making mappings on the way where there are none."""
    here: Any = document.data
    path: tuple[str | int, ...] = ()
    steps = key.split(".")
    for n, text in enumerate(steps):
        step: str | int = int(text) if text.isdigit() else text
        last = n == len(steps) - 1
        if isinstance(here, list):
            if not isinstance(step, int) or step >= len(here):
                reason = f"{'.'.join(steps[:n])} is a list of {len(here)}: use 0 to {len(here) - 1} here"
                document.problems.append(Problem(SOURCE, 0, key, shown(value), reason))
                return
        elif not isinstance(here, dict):
            reason = f"{'.'.join(steps[:n])} is {shown(here)} and has no keys of its own"
            document.problems.append(Problem(SOURCE, 0, key, shown(value), reason))
            return
        elif not last and here.get(step) is None:
            here[step] = {}
        path = (*path, step)
        if last:
            here[step] = value
            document.places = {p: at for p, at in document.places.items() if p[: len(path)] != path}
            document.places[path] = (SOURCE, 0)
        else:
            here = here[step]
