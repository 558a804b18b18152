"""What people see: progress and remarks on stderr, results on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

if TYPE_CHECKING:
    from rich.console import RenderableType

# A place such as car.yaml:100: is no emoji.
STDOUT = Console(highlight=False, emoji=False)
STDERR = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def say(text: str) -> None:
    """Print one remark on stderr."""
    STDERR.print(text, markup=False)


def warn(text: str) -> None:
    """Print one warning on stderr."""
    STDERR.print(f"[yellow]warning:[/] {escape(text)}")


def fail(text: str) -> None:
    """Print one error on stderr."""
    STDERR.print(f"[bold red]error:[/] {escape(text)}")


def print_page(result: RenderableType, width: int) -> None:
    """Print tables that are made for ``width`` columns, however wide the terminal is."""
    Console(width=width, highlight=False, emoji=False).print(result)


def print_json(result: Mapping[str, Any]) -> None:
    """Print exactly one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2, allow_nan=False) + "\n")
    sys.stdout.flush()


@contextmanager
def progress_bar(description: str, show: bool = True) -> Iterator[Callable[[float], None]]:
    """Give a function that takes the finished fraction (0..1); draws only when stderr is a terminal."""
    if not (show and STDERR.is_terminal):
        yield lambda fraction: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=STDERR, transient=True) as progress:
        task = progress.add_task(description, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)


@contextmanager
def activity(description: str, show: bool = True) -> Iterator[None]:
    """Show that something of unknown length is going on: a spinner on a terminal, one line elsewhere."""
    if show and STDERR.is_terminal:
        with STDERR.status(escape(description)):
            yield
        return
    if show:
        say(description)
    yield
