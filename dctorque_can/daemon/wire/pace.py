"""How often the buses are looked at: at once while few frames come, once a millisecond when many do."""

from __future__ import annotations

import time

REST_S = 0.001  # from one look at a busy bus to the next: what comes meanwhile is taken together
SPARE_LOOKS = 8  # beyond one each `REST_S` that need no rest, after a time with fewer


class Pace:
    """Rests from one look to the next, as far as there are more than one each `REST_S`.

    To wake up for each message of a full bus costs more than all that is done with it. A car that sends 400 frames
    a second sends some of them close together, and these need not wait: what counts is the mean over some looks.
    """

    def __init__(self) -> None:
        self._earned_s = 0.0  # until then the looks so far are what one each `REST_S` would be

    def rest(self) -> None:
        """Sleep until the next look may be."""
        rest_s = self._earned_s - SPARE_LOOKS * REST_S - time.monotonic()
        if rest_s > 0:
            time.sleep(min(rest_s, REST_S))

    def looked(self, now_s: float, full: bool) -> None:
        """Note a look that found something; ``full``: more than it could take, so that the next may be at once."""
        self._earned_s = now_s if full else max(self._earned_s, now_s) + REST_S
