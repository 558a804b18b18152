"""Numba's cache, kept by our rules: a file for each function and the types of its arguments.

A file holds the key it was kept by and what numba needs to load the function. Loading does not import what numba
needs only to compile, which takes half a second.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from numba.core import event
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from dctorque_can.compiling import watch
from dctorque_can.compiling.places import REMEDY, own_place, shipped
from dctorque_can.compiling.processor import kinds
from dctorque_can.compiling.trust import UntrustedError, read_trusted

SUFFIX = ".nbc"
OURS = "of_dctorque_can"
"""Attribute of what numba compiles for us."""
_DAMAGED = (
    *(pickle.UnpicklingError, EOFError, AttributeError, ImportError),
    *(IndexError, KeyError, TypeError, ValueError, MemoryError),
)
"""What pickle raises when it reads anything."""


class KeptCode(_Cache):
    """The cache of one function.

    Args:
        function: as it is written, not compiled.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder that new code is kept in."""
        return str(own_place().folder)

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the function for the types ``sig``, or None if it must be compiled."""
        if not self._enabled:
            return None
        reduced = self._find(sig, target_context)
        if reduced is None:
            return None
        rtsys.initialize(target_context)
        return cast(CompileResult, cast(Any, CompileResult)._rebuild(target_context, *reduced))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a function that was compiled for the types ``sig``, or tell why not."""
        if not self._enabled:
            return
        if data.library.has_dynamic_globals or any(not part.can_cache for part in data.lifted):
            warnings.warn(f"{self._function.__qualname__} cannot be kept compiled", RuntimeWarning, stacklevel=2)
            return
        place = own_place()
        if place.problem is not None:
            watch.problem(f"{place.problem}; {REMEDY}")
            return
        key = self._key(sig, data.codegen.magic_tuple())
        try:
            _write(place.folder / self._name(key), cast(Any, dumps)((key, data._reduce())))
        except OSError as error:
            reason = error.strerror
            watch.problem(f"compiled code cannot be kept in {place.folder}: {reason}; {REMEDY}")
            return
        watch.so_far.folders.add(place.folder)

    def enable(self) -> None:
        """Use kept code."""
        self._enabled = True

    def disable(self) -> None:
        """Use no kept code."""
        self._enabled = False

    def flush(self) -> None:
        """Forget what the user's folder has of this function."""
        for path in own_place().folder.glob(f"{self._stem}-*{SUFFIX}"):
            path.unlink(missing_ok=True)

    def _find(self, sig: Any, target_context: Any) -> Any:
        inside = shipped()
        if inside.is_dir():
            for kind in kinds():
                key = self._key(sig, kind)
                found = self._read(inside / self._name(key), key, Path.read_bytes)
                if found is not None:
                    return found
        place = own_place()
        if place.problem is not None:
            return None
        key = self._key(sig, target_context.codegen().magic_tuple())
        return self._read(place.folder / self._name(key), key, read_trusted)

    def _read(self, path: Path, key: Any, read: Callable[[Path], bytes]) -> Any:
        """Return what was kept by ``key`` in a file, or None."""
        try:
            kept_by, reduced = pickle.loads(read(path))
        except FileNotFoundError:
            return None
        except UntrustedError as error:
            watch.problem(f"compiled code is not used: {error}, and could put other code there; delete it")
            return None
        except OSError as error:
            watch.problem(f"compiled code cannot be read: {path}: {error.strerror}")
            return None
        except _DAMAGED:
            watch.problem(f"compiled code in {path} is damaged; it is compiled anew")
            return None
        return reduced if kept_by == key else None

    def _key(self, sig: Any, kind: tuple[str, str, str]) -> Any:
        """Return what tells one compiled function from every other: types, processor, code and its closure."""
        closure = self._function.__closure__
        cells = b"" if closure is None else cast(Any, dumps)(tuple(cell.cell_contents for cell in closure))
        code = hashlib.sha256(self._function.__code__.co_code + cells).hexdigest()
        return tuple(sig), kind, code

    @property
    def _stem(self) -> str:
        module = self._function.__module__.removeprefix("dctorque_can.")
        name = self._function.__qualname__.replace("<", "").replace(">", "")
        return f"{module}.{name}-{self._function.__code__.co_firstlineno}"

    def _name(self, key: Any) -> str:
        return f"{self._stem}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}{SUFFIX}"


class _Counted(event.Listener):
    """Passes on what numba says of compiling functions of ours."""

    def on_start(self, event: Any) -> None:
        if hasattr(event.data["dispatcher"], OURS):
            watch.begins()

    def on_end(self, event: Any) -> None:
        if hasattr(event.data["dispatcher"], OURS):
            watch.ends(failed=event._exc_details is not None)


cast(Any, event).register("numba:compile", _Counted())


def _write(path: Path, content: bytes) -> None:
    """Write a file such that whoever reads it finds it whole, and nobody else may change it."""
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, suffix=".part", delete=False) as file:
        try:
            file.write(content)
            file.flush()
            os.fchmod(file.fileno(), 0o644)
            Path(file.name).replace(path)
        except BaseException:
            Path(file.name).unlink()
            raise
