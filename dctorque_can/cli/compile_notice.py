"""Says that something has to be compiled: at once, and once more when it is over."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from dctorque_can.cli.console import STDERR, activity, is_shown, say, shown_note, warn
from dctorque_can.compiling import watch

_ONCE = "compiling for this machine, once"


class CompileNotice:
    """Tells people what `compiling.watch` tells: a running figure on a terminal, else a line at either end."""

    def __init__(self) -> None:
        self._said = False
        self._finished = 0
        self._began_s = 0.0
        self._seconds = 0.0
        self._display = ExitStack()
        self._lock = threading.Lock()

    def begins(self) -> None:
        """Say that it takes a while now."""
        with self._lock:
            self._began_s = time.monotonic()
            if STDERR.is_terminal:
                self._display.enter_context(shown_note(self._figure))
                if not is_shown():
                    self._display.enter_context(activity("waiting"))
            elif not self._said:
                say(f"{_ONCE} (`dctorque warm-up` does so beforehand)")
            self._said = True

    def ends(self) -> None:
        """Go on with what was shown before."""
        with self._lock:
            self._seconds += time.monotonic() - self._began_s
            self._display.close()

    def problem(self, text: str) -> None:
        """Warn."""
        warn(text)

    def finish(self) -> None:
        """Say what was compiled since the last time, if anything was."""
        functions = watch.so_far.functions - self._finished
        if functions:
            kept = ", ".join(str(folder) for folder in sorted(watch.so_far.folders)) or "no file"
            say(f"compiled {functions} functions in {self._seconds:.0f} s; they are kept in {kept}")
        self._finished, self._seconds, self._said = watch.so_far.functions, 0.0, False

    def _figure(self) -> str:
        seconds = self._seconds + time.monotonic() - self._began_s
        return f"{_ONCE}: {watch.so_far.functions - self._finished} functions, {seconds:.0f} s so far"


_notice = CompileNotice()


@contextmanager
def compiling_is_told() -> Iterator[None]:
    """Tell people of every compilation, and at the end what was compiled."""
    with watch.telling(_notice):
        try:
            yield
        finally:
            _notice.finish()


def compiling_is_over() -> None:
    """Say what was compiled so far; for a command that goes on for long."""
    _notice.finish()
