"""What compiled code depends on, as one word: another word means that it must be made anew.

Numba itself looks at the file of the outermost function alone. What that one calls in other files is part of the
same machine code, and so are the constants of every file it imports.
"""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
COMPILED_ROOMS = ("driveline", "estimators", "plausibility", "pipeline", "bus", "logs", "simulation")
"""Rooms that compiled code can come from; the architecture test counts them."""
COMPILERS = ("compiled.py", "compiling/kept_code.py")
"""What compiles and keeps it."""
SETTINGS = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LOOP_VECTORIZE", "SLP_VECTORIZE")
"""Numba's settings that change the code that it makes."""


def compiled_sources(package: Path = PACKAGE) -> list[Path]:
    """Return all files of ``package`` that compiled code can come from."""
    rooms = [path for room in COMPILED_ROOMS for path in (package / room).rglob("*.py")]
    return sorted([*rooms, *(package / name for name in COMPILERS)])


def digest_of(package: Path, circumstances: str) -> str:
    """Return a word for the sources of ``package`` and what else the code depends on: 16 hexadecimal digits."""
    digest = hashlib.sha256(circumstances.encode())
    for path in compiled_sources(package):
        digest.update(f"\n{path.relative_to(package)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def code_digest() -> str:
    """Return the word for this package, this Python, this numba and its settings."""
    import numba  # late: it takes a while, and many commands compile nothing

    settings = (f"{name}={getattr(numba.config, name)!s}" for name in SETTINGS)
    return digest_of(PACKAGE, " ".join((str(sys.implementation.cache_tag), numba.__version__, *settings)))
