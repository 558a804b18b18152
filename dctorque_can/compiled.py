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
    return cast(Callable[P, R], cast(Any, njit)(cache=True, error_model="numpy")(function))
