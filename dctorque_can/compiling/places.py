"""Where compiled code is kept: the one rule.

1. Code that came inside the installed package (`shipped`), if it fits: these sources, this Python, numba and
   processor. It is trusted as the sources beside it are, and never written.
2. Else the user's own (`own_folder`): below ``NUMBA_CACHE_DIR`` if that is set, else below ``XDG_CACHE_HOME``,
   else below ``~/.cache``; there in ``dctorque/DIGEST``. The digest is that of `sources.code_digest`, so that code
   is never older than any source it was made from. It is used only where nobody else can write (`trust`).

Where there is no such place everything is compiled at each start, and that is told once, with the remedy.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

from dctorque_can.compiling.sources import PACKAGE, code_digest
from dctorque_can.compiling.trust import UntrustedError, check_folder

REMEDY = (
    "so it is compiled anew at each start; name a folder of your own in NUMBA_CACHE_DIR (CacheDirectory= in a "
    "systemd unit) and run `dctorque warm-up` once"
)


@dataclass(frozen=True)
class Place:
    """A folder for compiled code.

    Attributes:
        folder: where it is, or would be.
        problem: why it cannot be used, in words; None if it can.
    """

    folder: Path
    problem: str | None = None


def shipped() -> Path:
    """Return the folder of the code that came inside this package for its sources; it need not exist."""
    return PACKAGE / "shipped" / "machine_code" / code_digest()


def own_folder() -> Path:
    """Return the folder of the user that runs, by the rule above."""
    from numba.core import config

    named = cast(Any, config).CACHE_DIR
    if named:
        root = Path(named)
    else:
        xdg = Path(os.environ.get("XDG_CACHE_HOME", ""))
        home = Path(os.path.expanduser("~"))  # noqa: PTH111  without a home this stays "~", and is no error
        root = xdg if xdg.is_absolute() else home / ".cache"
    return root.absolute() / "dctorque" / code_digest()


@cache
def own_place() -> Place:
    """Make the user's own folder, if need be, and look whether it is safe; once in a process."""
    return checked(own_folder())


def checked(folder: Path) -> Place:
    """Make ``folder``, if need be, and look whether it is safe."""
    try:
        _make(folder)
        folder = folder.resolve()
        check_folder(folder)
    except OSError as error:
        return Place(folder, f"there is no place for compiled code: {folder}: {error.strerror}")
    except UntrustedError as error:
        return Place(folder, f"compiled code in {folder} is not used: {error}, and could put other code there")
    if os.access(folder, os.W_OK):
        os.utime(folder)  # when it was last of use; root's own, which all may read, stays as it is
    return Place(folder)


def _make(folder: Path) -> None:
    missing = []
    while not folder.is_dir():
        missing.append(folder)
        folder = folder.parent
    for path in reversed(missing):
        path.mkdir(mode=0o755, exist_ok=True)
        path.chmod(path.stat().st_mode & ~0o022)  # whatever the umask
