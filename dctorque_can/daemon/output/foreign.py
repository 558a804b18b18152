"""Identifiers of ours on which somebody else sends: refused while he is heard, and for a while after."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from dctorque_can.pipeline.frames import EXTENDED_ID

LONGER = 1.2  # so much longer than it must a silence may be, by chance
FIRST = 10  # refusals of an identifier that are told one by one


@dataclass(slots=True)
class ForeignId:
    """What somebody else did on one of our identifiers.

    Attributes:
        frames: that he sent.
        refusals: times that we stopped sending on it.
        heard_us: when he was heard last, listened time.
    """

    frames: int = 0
    refusals: int = 0
    heard_us: int = 0


class ForeignIds:
    """Which of our identifiers are refused.

    Two services that refused each other would come back together, and again and again. So the silence that each
    waits for is drawn by chance, up to `LONGER` as long, anew with the first identifier that is refused.

    Args:
        silence_s: see below.
        tell: is told when a refusal begins and ends; of many, fewer and fewer: ``tell(is_error, text)``.
        chance: draws the silence.

    Attributes:
        refused: identifiers on which we do not send now.
        silence_s: without a foreign frame, after which an identifier is ours again; None: never. May be changed.
    """

    def __init__(self, silence_s: float | None, tell: Callable[[bool, str], None], chance: Random) -> None:
        self.refused: set[int] = set()
        self.silence_s = silence_s
        self._tell = tell
        self._chance = chance
        self._longer = 1.0
        self._known: dict[int, ForeignId] = {}

    def hear(self, frames: Mapping[int, int], listened_us: int) -> None:
        """Note foreign frames on our identifiers: how many of each, and how long we have listened by now."""
        if not self.refused:
            self._longer = self._chance.uniform(1.0, LONGER)
        new = []
        for can_id in sorted(frames):
            known = self._known.setdefault(can_id, ForeignId())
            known.frames += frames[can_id]
            known.heard_us = listened_us
            if can_id not in self.refused:
                self.refused.add(can_id)
                known.refusals += 1
                new.append(can_id)
        if worth := self._worth_telling(new):
            until = (
                "until the next start"
                if self.silence_s is None
                else f"until nobody else does for {self.silence_s:g} s"
            )
            self._tell(
                True, f"someone else sends on {shown(worth)}: nothing is sent there {until} (set output.ids)"
            )

    def listen(self, listened_us: int) -> None:
        """Note how long we have listened by now; what was silent for long enough is ours again."""
        if not self.refused or self.silence_s is None:
            return
        silent_us = listened_us - round(1e6 * self._longer * self.silence_s)
        ours = [can_id for can_id in sorted(self.refused) if self._known[can_id].heard_us <= silent_us]
        self.refused.difference_update(ours)
        if worth := self._worth_telling(ours):
            self._tell(False, f"nobody else sends on {shown(worth)} any more: it is sent there again")

    def as_json(self) -> dict[str, dict[str, Any]]:
        """Return what somebody else did on each identifier, by its hexadecimal number."""
        return {
            f"{can_id & ~EXTENDED_ID:X}": {
                "frames": each.frames,
                "refusals": each.refusals,
                "refused": can_id in self.refused,
            }
            for can_id, each in sorted(self._known.items())
        }

    def _worth_telling(self, can_ids: Iterable[int]) -> list[int]:
        """Return those of which this is one of the first refusals, or a power of two."""
        counts = {can_id: self._known[can_id].refusals for can_id in can_ids}
        return [can_id for can_id, n in counts.items() if n <= FIRST or not n & (n - 1)]


def shown(can_ids: Iterable[int]) -> str:
    """Return identifiers for people."""
    return ", ".join(f"0x{can_id & ~EXTENDED_ID:X}" for can_id in can_ids)
