"""What systemd is told: ready, alive, state (sd_notify). Elsewhere all of this does nothing."""

from __future__ import annotations

import os
from collections.abc import Callable

from sdnotify import SystemdNotifier

STATUS_PERIOD_S = 2.0


class Systemd:
    """Notifications of one service."""

    def __init__(self) -> None:
        # Without systemd the notifier would open a socket for nothing, and never close it.
        self._notifier = SystemdNotifier() if "NOTIFY_SOCKET" in os.environ else None
        self._watchdog_s = int(os.environ.get("WATCHDOG_USEC", "0")) / 1e6 / 3
        self._next_watchdog_s = 0.0
        self._next_status_s = 0.0
        self._frames = 0

    def ready(self) -> None:
        """Tell that the service runs."""
        self._notify("READY=1")

    def stopping(self) -> None:
        """Tell that the service ends."""
        self._notify("STOPPING=1")

    def keep_time(self, now_s: float, frames: int, state: Callable[[], str]) -> None:
        """Feed the watchdog and tell the state, when it is time; ``frames`` counts since the start."""
        if self._watchdog_s and now_s >= self._next_watchdog_s:
            self._next_watchdog_s = now_s + self._watchdog_s
            self._notify("WATCHDOG=1")
        if now_s >= self._next_status_s:
            rate = (frames - self._frames) / STATUS_PERIOD_S
            self._frames = frames
            self._next_status_s = now_s + STATUS_PERIOD_S
            self._notify(f"STATUS={state()}, {rate:.0f} frames/s, {frames} in all")

    def _notify(self, state: str) -> None:
        if self._notifier is not None:
            self._notifier.notify(state)
