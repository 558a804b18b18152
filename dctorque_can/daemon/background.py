"""Calls that may never return, each in a thread of its own: whoever asked looks for the result, or goes away."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, wait
from threading import Thread
from typing import Any, TypeVar

T = TypeVar("T")


def in_background(call: Callable[[], T], name: str) -> Future[T]:
    """Begin ``call`` in a thread that does not hold up the end of the process, and return its result to come."""
    future: Future[T] = Future()

    def work() -> None:
        settle(future, call)

    Thread(target=work, name=name, daemon=True).start()
    return future


def settle(future: Future[T], call: Callable[[], T]) -> None:
    """Make ``call`` and put what it returns or raises into ``future``."""
    try:
        result = call()
    except BaseException as error:  # noqa: BLE001  raised again where the result is fetched
        future.set_exception(error)
    else:
        future.set_result(result)


def finished(future: Future[Any], timeout_s: float) -> bool:
    """Wait up to ``timeout_s`` and return whether there is a result."""
    wait([future], timeout_s)
    return future.done()
