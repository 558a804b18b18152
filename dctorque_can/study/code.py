"""Which code made a result: a source tree changes between releases, and its version does not."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
SIMULATION = ("driveline", "bus", "simulation")
"""Rooms that frames and truth of a car come from."""
EVERYTHING = (
    *SIMULATION,
    "estimators",
    "plausibility",
    "pipeline",
    "config",
    "chain.py",
    "analysis",
    "offline",
    "study",
)
"""… and the figures of its estimates."""


@cache
def code(rooms: tuple[str, ...]) -> str:
    """Return a hash of the sources of these rooms, as they were when this process asked for the first time.

    Args:
        rooms: folders of the package, or files at its top.
    """
    digest = hashlib.sha256()
    for path in sorted(path for room in rooms for path in _sources(_PACKAGE / room)):
        digest.update(f"{path.relative_to(_PACKAGE)}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def _sources(room: Path) -> list[Path]:
    return [room] if room.suffix else list(room.rglob("*.py"))
