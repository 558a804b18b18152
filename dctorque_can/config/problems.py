"""What is wrong in a vehicle file, where, and what would be right."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from dctorque_can.errors import DctorqueError

KeyPath = tuple[str | int, ...]

_LONGEST_VALUE = 60


def dotted(path: KeyPath) -> str:
    """Return ``("vehicle", "gears", 1)`` as ``vehicle.gears.1``."""
    return ".".join(str(step) for step in path)


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong (or, as a warning, doubtful) in a vehicle file.

    Attributes:
        file: the file as the user named it, or "--set" for a value from the command line.
        line: 1-based, 0 when unknown.
        key: dotted key path, "" for the file as a whole.
        value: the offending value as text, "" when there is none (a missing key).
        reason: what is wrong and what would be right.
        severity: an error stops everything, a warning is only shown.
    """

    file: str
    line: int
    key: str
    value: str
    reason: str
    severity: Literal["error", "warning"] = "error"

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        shown = self.value if len(self.value) <= _LONGEST_VALUE else self.value[: _LONGEST_VALUE - 1] + "…"
        what = f"{self.key} = {shown}" if self.key and shown else self.key or shown
        prefix = "warning: " if self.severity == "warning" else ""
        return f"{place}: {prefix}{what + ': ' if what else ''}{self.reason}"

    def as_json(self) -> dict[str, str | int]:
        """Return the fields for a JSON report."""
        return {
            "file": self.file,
            "line": self.line,
            "key": self.key,
            "value": self.value,
            "reason": self.reason,
            "severity": self.severity,
        }


class ConfigError(DctorqueError):
    """A vehicle file that cannot be used: all its errors (and warnings) at once.

    Attributes:
        problems: in order of their place in the file.
    """

    def __init__(self, problems: Iterable[Problem]):
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))
