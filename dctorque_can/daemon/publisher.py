"""Sends the estimates on the bus, politely: listens first and never on an identifier that someone else uses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.map_output import MapEncoder
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.daemon.link import BusLink
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

LISTEN_US = 500_000  # five times the longest cycle of dctorque.dbc
LONGEST_WAIT_US = 100_000  # longer than that no frame is waited for: it was a step of the clock


class Publisher:
    """Encodes and sends.

    It listens for `LISTEN_US` of frames before it talks, once; whatever the clock of the frames does later, it
    goes on talking. A second instance on the same bus hears the first while it listens, and stays silent; so the
    first is not disturbed. An identifier that was heard from someone else stays refused until the next start.

    Args:
        encoder: makes the cyclic frames.
        maps: makes those of the learned maps, if they are sent.
        link: where to.
        tell: is told about a refusal: ``tell(is_error, text)``.

    Attributes:
        can_ids: identifiers that are sent, with `EXTENDED_ID` where they are extended.
        refused: those of them that someone else uses.
    """

    def __init__(
        self,
        encoder: OutputEncoder,
        link: BusLink,
        tell: Callable[[bool, str], None],
        maps: MapEncoder | None = None,
    ) -> None:
        self.refused: set[int] = set()
        self._encoder, self._maps = encoder, maps
        of_maps = {} if maps is None else maps.can_ids
        self.can_ids = frozenset([*encoder.can_ids.values(), *of_maps.values()])
        self._link = link
        self._tell = tell
        self._latest_us: int | None = None
        self._listened_us = 0

    def hear(self, frames: Frames, channel: int | None = None) -> None:
        """Look whether someone else uses our identifiers.

        Args:
            frames: of all buses. Where nobody else talks on ours, the others tell how long it was listened.
            channel: of the bus on which we talk; None where there is only that.
        """
        if self._listened_us < LISTEN_US:
            self._listen(frames)
        if channel is not None:
            frames = frames[frames.channel == channel]
        if self.can_ids.isdisjoint(frames.can_id.tolist()):
            return
        foreign = (frames.flags & (FrameFlag.SENT | FrameFlag.ERROR)) == 0
        for can_id in sorted(self.can_ids.intersection(frames.can_id[foreign].tolist()) - self.refused):
            self.refused.add(can_id)
            shown = f"0x{can_id & ~EXTENDED_ID:X}"
            self._tell(True, f"someone else sends on {shown}: nothing will be sent on it (set output.ids)")

    def renew_maps(self, rows: NDArray[np.void]) -> None:
        """Take the next `CLUTCH_MAP` rows ``[n]``, to be sent from now on."""
        if self._maps is not None:
            self._maps.renew(rows)

    def publish(self, rows: NDArray[np.void]) -> Frames:
        """Send what is due after ``rows`` (`ESTIMATE` ``[n]``) and return the frames that the bus took."""
        frames = self._encoder.encode(rows)  # always, so that the counters keep running
        if self._maps is not None and len(of_maps := self._maps.encode(rows["t_us"])):
            frames = Frames.concatenate([frames, of_maps]).sorted_by_time()
        if not len(frames) or self._listened_us < LISTEN_US:
            return frames[:0]
        taken = np.zeros(len(frames), np.bool_)
        for i, can_id in enumerate(frames.can_id.tolist()):
            taken[i] = can_id not in self.refused and self._link.send(message_from_frame(frames, i))
        return frames if taken.all() else frames[taken]

    def _listen(self, frames: Frames) -> None:
        """Add up how long it listened; a step of the clock of the frames adds little, and takes nothing away."""
        for t_us in frames.t_us.tolist():
            if self._latest_us is None or t_us < self._latest_us - LONGEST_WAIT_US:
                self._latest_us = t_us
            elif t_us > self._latest_us:
                self._listened_us += min(t_us - self._latest_us, LONGEST_WAIT_US)
                self._latest_us = t_us
