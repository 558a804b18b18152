"""The one compiler switch of the package: scalar loops over arrays, compiled by numba and kept on disk.

``fastmath`` and ``parallel`` stay off so that a result does not depend on how a log was cut into batches. Where
compiled code is kept, and when it is still good, is said in `compiling.places`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import update_wrapper
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

_making = threading.RLock()


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function`` compiled to machine code, bit-identical for every batch length."""
    return cast(Callable[P, R], CompiledFunction(function, {}))


def compiled_without_allocation(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function`` compiled as by `compiled`, for one that makes, slices and returns no array.

    Numba otherwise counts references of every array that is passed from function to function, with atomic
    instructions that cost a loop over small steps five times its work. All functions it calls must be so too.
    """
    return cast(Callable[P, R], CompiledFunction(function, {"_nrt": False}))


class CompiledFunction:
    """A function that numba gets to see when it is called, by Python or by another that is compiled.

    Most are never seen: where the machine code of a function is on disk, it has in it all that the function calls.

    Args:
        function: as it is written.
        options: of numba, beside those of all functions.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, bool]) -> None:
        update_wrapper(self, function)
        self._function = function
        self._options = options
        self._machine_code: Any = None

    def __call__(self, *args: Any, **kws: Any) -> Any:
        """Call the machine code."""
        return (self._machine_code or self._made())(*args, **kws)

    def __getattr__(self, name: str) -> Any:
        """Return what numba's own compiled function has: its answers to the compiler among others."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._made(), name)

    def __reduce__(self) -> str:
        return self._function.__qualname__

    def _made(self) -> Any:
        with _making:
            if self._machine_code is None:
                self._machine_code = _machine_code(self._function, self._options)
            return self._machine_code


def entry(function: Callable[..., R], arguments: tuple[Any, ...]) -> Callable[..., R]:
    """Return the machine code of a compiled function for arguments of the very types of these.

    Calling the function itself finds out which machine code fits, and that costs more than a few samples do.
    Arguments of other types, or arrays that are not contiguous, would be misread.
    """
    from numba import typeof

    type_of: Callable[[Any], Any] = typeof
    return cast(Callable[..., R], cast(Any, function).compile(tuple(type_of(each) for each in arguments)))


def _machine_code(function: Callable[..., Any], options: dict[str, bool]) -> Any:
    """Return what Python and compiled code call, for each of which a function is compiled apart.

    Only what Python enters has a way in for it and is kept on disk: it holds all that it calls. Those are most of
    the functions, and would otherwise take twice as long.
    """
    from numba import njit, types
    from numba.core import config

    from dctorque_can.compiling.kept_code import OURS, KeptCode

    if cast(Any, config).DISABLE_JIT:
        return function
    entered = cast(Any, njit)(error_model="numpy", **options)(function)
    entered._cache = KeptCode(function)
    called = cast(Any, njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, error_model="numpy", **options)(
        function
    )
    unliteral: Callable[[Any], Any] = types.unliteral

    def get_call_template(args: Any, kws: Any) -> Any:
        # once for a type, instead of anew for each constant that is given
        plain = {name: unliteral(arg) for name, arg in kws.items()}
        return called.get_call_template(tuple(unliteral(arg) for arg in args), plain)

    entered.get_call_template = get_call_template
    entered.get_overload = called.get_overload
    for made in (entered, called):
        setattr(made, OURS, True)
    return entered
