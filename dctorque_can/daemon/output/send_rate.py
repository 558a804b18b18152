"""How many frames may be sent: a service whose clock is no clock must not fill the bus."""

from __future__ import annotations

HEADROOM = 2.0  # times the frames that the cycles ask for
BURST_S = 5.0  # that may be sent at once: what is played faster than in real time is no clock that jumps


class SendRate:
    """A limit for all frames together, by a clock that nobody sets.

    The cycles are those of the frames' own time. When that jumps back and forth, as a driver's stamps may, each
    jump begins the cycles anew, and all messages are due with every frame received.

    Args:
        nominal_hz: frames per second that the cycles ask for.

    Attributes:
        most_hz: frames per second that may be sent.
    """

    def __init__(self, nominal_hz: float) -> None:
        self.most_hz = HEADROOM * nominal_hz
        self._room = self._most = self.most_hz * BURST_S
        self._looked_s: float | None = None

    def admits(self, now_s: float) -> bool:
        """Return whether one more frame may be sent now; it then counts as sent."""
        if self._looked_s is not None:
            self._room = min(self._room + self.most_hz * (now_s - self._looked_s), self._most)
        self._looked_s = now_s
        if self._room < 1.0:
            return False
        self._room -= 1.0
        return True
