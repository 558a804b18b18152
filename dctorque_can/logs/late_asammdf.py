"""asammdf only for MF4: python-can imports it, pandas and lxml with it, whatever it is itself imported for.

That takes three quarters of a second. A program of its own, such as the command line, keeps it away; where a file
turns out to be MF4 it is given.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_NAME = "asammdf"
_kept_away = False


@contextmanager
def late_asammdf() -> Iterator[None]:
    """Let an import of asammdf inside the block fail as if it were not installed, until `give_asammdf`.

    Does nothing where it has been imported already.
    """
    global _kept_away
    if _NAME in sys.modules:
        yield
        return
    _kept_away = True
    sys.modules[_NAME] = None  # type: ignore[assignment]  # what the import system takes for "there is none"
    try:
        yield
    finally:
        _unlock()


def give_asammdf() -> None:
    """Let the MF4 classes of python-can have asammdf if it is installed, also those that were imported before."""
    _unlock()
    module = importlib.import_module("can.io.mf4")
    if module.asammdf is None:
        importlib.reload(module)  # within the same namespace, which is where the classes of before look


def _unlock() -> None:
    global _kept_away
    if _kept_away:
        _kept_away = False
        del sys.modules[_NAME]
