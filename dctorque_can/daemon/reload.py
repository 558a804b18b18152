"""The vehicle file read anew while the service runs: what may take effect does so, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

from dctorque_can.config.changes import changed_keys, needs_restart
from dctorque_can.config.load import Config
from dctorque_can.daemon.background import in_background
from dctorque_can.errors import DctorqueError

_GOES_ON = "the configuration stays as it was"


class Reloader:
    """Reads the vehicle file when it is asked to, in a thread: a DBC may take a second.

    Args:
        read: reads it, as it was read at the start.
        tell: is told what comes of it: ``tell(is_error, text)``.

    Attributes:
        outcomes: how many wishes came to what.
    """

    def __init__(self, read: Callable[[], Config] | None, tell: Callable[[bool, str], None]) -> None:
        self.outcomes = {"done": 0, "unchanged": 0, "refused": 0}
        self._read = read
        self._tell = tell
        self._asked = False
        self._reading: Future[Config] | None = None

    def ask(self) -> None:
        """Ask for it; may be called from a signal handler or another thread."""
        self._asked = True

    def look(self, now: Config) -> Config | None:
        """Return the configuration that takes the place of ``now``, as soon as there is one. Never waits."""
        if self._asked and self._reading is None:
            self._asked = False
            if self._read is None:
                self._refuse("the vehicle file cannot be read anew here")
                return None
            self._reading = in_background(self._read, "reload")
        if self._reading is None or not self._reading.done():
            return None
        reading, self._reading = self._reading, None
        try:
            new = reading.result()
            changed = changed_keys(now, new)
        except DctorqueError as error:
            self._refuse(str(error))
            return None
        except Exception as error:  # noqa: BLE001  whatever a file does to its reader, the service goes on
            self._refuse(f"unexpected {type(error).__name__}: {error}")
            return None
        if late := [key for key in changed if needs_restart(key)]:
            self._refuse(f"{new.path}: needs a restart to take effect: {', '.join(late)}")
            return None
        if new.documents == now.documents:
            self.outcomes["unchanged"] += 1
            self._tell(False, f"{new.path}: has not changed")
            return None
        self.outcomes["done"] += 1
        for warning in new.warnings:
            self._tell(True, str(warning))
        what = ", ".join(changed) if changed else "nothing but its text"
        self._tell(False, f"{new.path}: read anew: {what}; a new log begins with it")
        return new

    def _refuse(self, why: str) -> None:
        self.outcomes["refused"] += 1
        for line in why.splitlines():
            self._tell(True, line)
        self._tell(True, _GOES_ON)
