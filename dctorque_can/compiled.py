"""The one compiler switch of the package: scalar loops over arrays, compiled by numba and cached on disk.

``fastmath`` and ``parallel`` stay off so that a result does not depend on how a log was cut into batches.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit, typeof, types

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


def entry(function: Callable[..., R], arguments: tuple[Any, ...]) -> Callable[..., R]:
    """Return the machine code of a compiled function for arguments of the very types of these.

    Calling the function itself finds out which machine code fits, and that costs more than a few samples do.
    Arguments of other types, or arrays that are not contiguous, would be misread.
    """
    type_of: Callable[[Any], Any] = typeof
    return cast(Callable[..., R], cast(Any, function).compile(tuple(type_of(each) for each in arguments)))


def _compile(function: Callable[P, R], **options: bool) -> Callable[P, R]:
    try:
        machine_code = cast(Any, njit)(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no place for a cache: a service user without a home; it compiles at every start
        machine_code = cast(Any, njit)(error_model="numpy", **options)(function)
    machine_code.get_call_template = _once_for_all_literals(machine_code.get_call_template)
    return cast(Callable[P, R], machine_code)


def _once_for_all_literals(get_call_template: Callable[..., Any]) -> Callable[..., Any]:
    """Let a function be compiled once for an argument of a type, instead of anew for each constant given to it."""

    unliteral: Callable[[Any], Any] = types.unliteral

    def plain(args: Any, kws: Any) -> Any:
        return get_call_template(
            tuple(unliteral(arg) for arg in args), {name: unliteral(arg) for name, arg in kws.items()}
        )

    return plain
