"""Times at which the service did not run: stopped, starved, or asleep with the computer."""

from __future__ import annotations

from collections.abc import Callable

from dctorque_can.daemon.wire.socketcan import MOST

STALL_S = 0.5  # from one look at the buses to the next, which are never further apart than a tenth of a second
FIRST = 10  # stalls that are told one by one


class StallWatch:
    """Notices that the receive loop did not run, and which frames have waited for it.

    What has waited is estimated and logged as always. What would be sent in answer is of the past: it is late
    until a look finds less than it can take, or until as much time has gone as the stall took.

    Args:
        tell: is told of the first stalls, and then of fewer and fewer: ``tell(is_error, text)``.

    Attributes:
        count: stalls.
        longest_s: the longest of them.
    """

    def __init__(self, tell: Callable[[bool, str], None]) -> None:
        self.count = 0
        self.longest_s = 0.0
        self._tell = tell
        self._looked_s: float | None = None
        self._late_until_s: float | None = None

    def look(self, now_s: float, frames: int) -> bool:
        """Note that a look at the buses found so many frames; return whether they have waited."""
        gap_s = 0.0 if self._looked_s is None else now_s - self._looked_s
        self._looked_s = now_s
        if gap_s > STALL_S:
            self.count += 1
            self.longest_s = max(self.longest_s, gap_s)
            self._late_until_s = now_s + gap_s
            if self.count <= FIRST or not self.count & (self.count - 1):
                self._tell(True, f"the service did not run for {gap_s:.1f} s: what it would have sent is left out")
        late = self._late_until_s is not None and now_s <= self._late_until_s
        if not late or frames < MOST:
            self._late_until_s = None
        return late
