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


def _compile(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Return what Python and compiled code call, for each of which a function is compiled apart.

    Only what Python enters has a way in for it and is kept on disk: it holds all that it calls. Those are most of
    the functions, and would otherwise take twice as long.
    """
    try:
        entered = cast(Any, njit)(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no place for a cache: a service user without a home; it compiles at every start
        entered = cast(Any, njit)(error_model="numpy", **options)(function)
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
    return cast(Callable[P, R], entered)
