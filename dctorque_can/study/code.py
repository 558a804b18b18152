"""Which code made a result: a source tree changes between releases, and its version does not."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
SIMULATION = ("driveline", "bus", "simulation")
"""Rooms that frames and truth of a car come from."""
EVERYTHING = (*SIMULATION, "estimators", "pipeline", "config", "analysis", "daemon", "study")
"""… and the figures of its estimates."""


@cache
def code(rooms: tuple[str, ...]) -> str:
    """Return a hash of the sources of these rooms, as they were when this process asked for the first time."""
    digest = hashlib.sha256()
    for path in sorted(path for room in rooms for path in (_PACKAGE / room).rglob("*.py")):
        digest.update(f"{path.relative_to(_PACKAGE)}\n".encode() + path.read_bytes())
    return digest.hexdigest()
