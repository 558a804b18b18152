"""What people see: progress and remarks on stderr, results on stdout."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.text import Text

from dctorque_can.daemon.journal import Priority, is_journal, line

if TYPE_CHECKING:
    from rich.console import ConsoleOptions, RenderableType

# Control characters but tab and line feed, and what changes the direction of writing.
_COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def harmless(text: str) -> str:
    """Return a text in which nothing is a command to a terminal: such characters are written as Python does."""
    return _COMMANDS.sub(lambda found: ascii(found[0])[1:-1], text)


class HarmlessConsole(Console):
    """A console that a name in a vehicle file, a DBC or a log cannot give commands to."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as always, but for what is a command and not of rich itself."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=harmless(segment.text))


# A place such as car.yaml:100: is no emoji.
STDOUT = HarmlessConsole(highlight=False, emoji=False)
STDERR = HarmlessConsole(stderr=True, highlight=False, soft_wrap=True, emoji=False)


def say(text: str) -> None:
    """Print one remark on stderr."""
    STDERR.print(line(Priority.INFO, text), markup=False)


def warn(text: str) -> None:
    """Print one warning on stderr."""
    if is_journal():  # which colours by the priority
        STDERR.print(line(Priority.WARNING, text), markup=False)
        return
    STDERR.print(f"[yellow]warning:[/] {escape(text)}")


def fail(text: str) -> None:
    """Print one error on stderr."""
    if is_journal():
        STDERR.print(line(Priority.ERROR, text), markup=False)
        return
    STDERR.print(f"[bold red]error:[/] {escape(text)}")


def print_page(result: RenderableType, width: int) -> None:
    """Print tables that are made for ``width`` columns, however wide the terminal is."""
    HarmlessConsole(width=width, highlight=False, emoji=False).print(result)


def print_json(result: Mapping[str, Any]) -> None:
    """Print exactly one JSON object on stdout."""
    sys.stdout.write(json.dumps(result, indent=2, allow_nan=False) + "\n")
    sys.stdout.flush()


_note: Callable[[], str] | None = None  # what keeps the activity waiting that is shown
_shown = 0  # displays on the terminal


def is_shown() -> bool:
    """Return whether an activity or a progress bar is on the terminal."""
    return _shown > 0


@contextmanager
def shown_note(note: Callable[[], str]) -> Iterator[None]:
    """Show a text, anew with every drawing, beside what goes on."""
    global _note
    before, _note = _note, note
    try:
        yield
    finally:
        _note = before


class _WithNote:
    """A description and the note of the moment."""

    def __init__(self, description: str) -> None:
        self._description = description

    def __rich__(self) -> Text:
        return Text(self._description if _note is None else f"{self._description} ({_note()})")


class _DescriptionColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        return _WithNote(task.description).__rich__()


@contextmanager
def _displayed() -> Iterator[None]:
    global _shown
    _shown += 1
    try:
        yield
    finally:
        _shown -= 1


@contextmanager
def progress_bar(description: str, show: bool = True) -> Iterator[Callable[[float], None]]:
    """Give a function that takes the finished fraction (0..1); draws only when stderr is a terminal."""
    if not (show and STDERR.is_terminal):
        yield lambda fraction: None
        return
    columns = (_DescriptionColumn(), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with _displayed(), Progress(*columns, console=STDERR, transient=True) as progress:
        task = progress.add_task(description, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)


@contextmanager
def activity(description: str, show: bool = True) -> Iterator[None]:
    """Show that something of unknown length is going on: a spinner on a terminal, one line elsewhere."""
    if show and STDERR.is_terminal:
        with _displayed(), STDERR.status(_WithNote(description)):
            yield
        return
    if show:
        say(description)
    yield
