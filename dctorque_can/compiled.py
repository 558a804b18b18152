"""The one compiler switch of the package: scalar loops over arrays, compiled by numba and cached on disk.

``fastmath`` and ``parallel`` stay off so that a result does not depend on how a log was cut into batches.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function`` compiled to machine code, bit-identical for every batch length."""
    return _compile(function)


def compiled_without_allocation(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function`` compiled as by `compiled`, for one that makes, slices and returns no array.

    Numba otherwise counts references of every array that is passed from function to function, with atomic
    instructions that cost a loop over small steps five times its work. All functions it calls must be so too.
    """
    return _compile(function, _nrt=False)


def _compile(function: Callable[P, R], **options: bool) -> Callable[P, R]:
    try:
        machine_code = cast(Any, njit)(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no place for a cache: a service user without a home; it compiles at every start
        machine_code = cast(Any, njit)(error_model="numpy", **options)(function)
    return cast(Callable[P, R], machine_code)
