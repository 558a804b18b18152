"""Sends the estimates on the bus, politely: listens first and never on an identifier that someone else uses."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.map_output import MapEncoder
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.daemon.output.cycles import CycleTimes
from dctorque_can.daemon.output.foreign import ForeignIds, shown
from dctorque_can.daemon.output.send_rate import SendRate
from dctorque_can.daemon.wire.link import BusLink
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import FrameFlag, Frames

LISTEN_US = 500_000  # five times the longest cycle of dctorque.dbc
LONGEST_WAIT_US = 100_000  # longer than that no frame is waited for: it was a step of the clock


class Publisher:
    """Encodes and sends.

    It listens for `LISTEN_US` of frames before it talks, once; whatever the clock of the frames does later, it
    goes on talking. A second instance on the same bus hears the first while it listens, and stays silent; so the
    first is not disturbed. An identifier that was heard from someone else is refused until he has been silent for
    long enough (`ForeignIds`).

    Nothing is sent twice, and nothing without a new estimate: where estimates stop, so do the frames.

    Args:
        encoder: makes the cyclic frames.
        maps: makes those of the learned maps, if they are sent.
        link: where to.
        tell: is told about refusals: ``tell(is_error, text)``.
        silence_s: how long someone else must have been silent; None: for ever.
        chance: see `ForeignIds`.
        live: the frames received are of now; only then there is a limit of frames per second.

    Attributes:
        can_ids: identifiers that are sent, with `EXTENDED_ID` where they are extended.
        late: frames that were due and left out, since what they would have told was of the past.
        limited: frames that were due and left out, since there were too many (`SendRate`).
    """

    def __init__(
        self,
        encoder: OutputEncoder,
        link: BusLink,
        tell: Callable[[bool, str], None],
        maps: MapEncoder | None = None,
        silence_s: float | None = 5.0,
        chance: Random | None = None,
        live: bool = True,
    ) -> None:
        self.late = 0
        self.limited = 0
        self._encoder, self._maps = encoder, maps
        periods_s = encoder.periods_s | ({} if maps is None else maps.periods_s)
        self.can_ids = frozenset(periods_s)
        self._foreign = ForeignIds(silence_s, tell, chance or Random())
        self._cycles = CycleTimes(periods_s)
        self._rate = SendRate(sum(1.0 / period_s for _, period_s in periods_s.values())) if live else None
        self._link = link
        self._tell = tell
        self._latest_us: int | None = None
        self._listened_us = 0

    @property
    def refused(self) -> set[int]:
        """Identifiers of ours that someone else uses."""
        return self._foreign.refused

    def change_silence(self, silence_s: float | None) -> None:
        """Change how long someone else must have been silent, also of what is refused already."""
        self._foreign.silence_s = silence_s

    def as_json(self) -> dict[str, Any]:
        """Return what was sent how evenly, and what was left out for what reason."""
        return {
            "foreign_ids": self._foreign.as_json(),
            "cycles": self._cycles.as_json(),
            "late": self.late,
            "limited": self.limited,
        }

    @property
    def in_words(self) -> str:
        """How evenly it sends and what it refuses, for behind a state; "" while there is nothing to tell."""
        jitter_ms, refused = self._cycles.worst_jitter_ms, shown(sorted(self.refused))
        return ("" if jitter_ms is None else f", cycle jitter {jitter_ms:.1f} ms") + (
            f", {refused} refused (someone else sends there)" if refused else ""
        )

    def hear(self, frames: Frames, channel: int | None = None) -> None:
        """Look whether someone else uses our identifiers.

        Args:
            frames: of all buses. Where nobody else talks on ours, the others tell how long it was listened.
            channel: of the bus on which we talk; None where there is only that.
        """
        if self._listened_us >= LISTEN_US and not self.refused:
            self._latest_us = None
        elif self._link.up:  # nobody could be heard on a bus that is away
            self._listen(frames)
            self._foreign.listen(self._listened_us)
        if channel is not None:
            frames = frames[frames.channel == channel]
        if self.can_ids.isdisjoint(frames.can_id.tolist()):
            return
        foreign = (frames.flags & (FrameFlag.SENT | FrameFlag.ERROR)) == 0
        counts = Counter(frames.can_id[foreign].tolist())
        self._foreign.hear({can_id: counts[can_id] for can_id in self.can_ids & counts.keys()}, self._listened_us)

    def renew_maps(self, rows: NDArray[np.void]) -> None:
        """Take the next `CLUTCH_MAP` rows ``[n]``, to be sent from now on."""
        if self._maps is not None:
            self._maps.renew(rows)

    def publish(self, rows: NDArray[np.void], late: bool = False) -> Frames:
        """Send what is due after ``rows`` (`ESTIMATE` ``[n]``) and return the frames that the bus took.

        Args:
            rows: in answer to what was received.
            late: they answer frames that have waited, so that what they tell is of the past: nothing is sent.
        """
        frames = self._encoder.encode(rows)  # always, so that the counters keep running
        if self._maps is not None and len(of_maps := self._maps.encode(rows["t_us"])):
            frames = Frames.concatenate([frames, of_maps]).sorted_by_time()
        if not len(frames) or self._listened_us < LISTEN_US:
            return frames[:0]
        if late:
            self.late += len(frames)
            return frames[:0]
        taken = np.zeros(len(frames), np.bool_)
        for i, can_id in enumerate(frames.can_id.tolist()):
            taken[i] = can_id not in self.refused and self._send(frames, i, can_id)
        return frames if taken.all() else frames[taken]

    def _send(self, frames: Frames, i: int, can_id: int) -> bool:
        now_s = time.monotonic()
        if self._rate is not None and not self._rate.admits(now_s):
            if not self.limited:
                self._tell(
                    True,
                    f"more than {self._rate.most_hz:.0f} frames/s are due on the bus, twice what their cycles ask "
                    "for: the times of the frames received jump; what is too much is left out",
                )
            self.limited += 1
            return False
        if not self._link.send(message_from_frame(frames, i)):
            return False
        self._cycles.sent(can_id, now_s)
        return True

    def _listen(self, frames: Frames) -> None:
        """Add up how long it listened; a step of the clock of the frames adds little, and takes nothing away."""
        for t_us in frames.t_us.tolist():
            if self._latest_us is None or t_us < self._latest_us - LONGEST_WAIT_US:
                self._latest_us = t_us
            elif t_us > self._latest_us:
                self._listened_us += min(t_us - self._latest_us, LONGEST_WAIT_US)
                self._latest_us = t_us
