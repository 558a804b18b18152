"""Several buses as one: their frames in order of time, each with the number of its channel."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import can

from dctorque_can.daemon.wire.kernel_filter import Wanted
from dctorque_can.daemon.wire.link import BusError, BusLink, LinkCounts
from dctorque_can.daemon.wire.pace import Pace
from dctorque_can.daemon.wire.reception import NOTHING
from dctorque_can.daemon.wire.socketcan import MOST
from dctorque_can.pipeline.frames import Frames

DOWN_S = 0.02  # from one look at a bus that is away to the next
MOST_HELD = 4096  # frames; for whatever reason they wait, these are enough
READY_S = 0.001  # for a bus whose interface says that something waits, or cannot say so
CLOCKS_APART_US = 500_000
CLOCKS_APART_S = 2.0  # for so long: told


@dataclass(frozen=True, slots=True)
class NamedBus:
    """One bus of a service.

    Attributes:
        name: for people.
        number: of its channel.
        connect: opens it.
        listen_only: nothing may be sent on it.
        wanted: frames that are needed; None: all.
    """

    name: str
    number: int
    connect: Callable[[], can.BusABC]
    listen_only: bool = False
    wanted: Wanted | None = None


class BusLinks:
    """Receives on several buses, each of which comes back by itself.

    One bus is received as `BusLink` does it. Of several, the frames that one look finds are merged in order of
    time. What came while the look went on waits for the next one: so a frame is given behind a later one only if
    its interface gave it away more than a look late. Nothing is held for longer than to the next look, but for a
    bus of which more waits than one look takes; and about `MOST_HELD` frames at most.

    Args:
        buses: at least one.
        tell: is told what happens, in one line: ``tell(is_error, text)``.
    """

    def __init__(self, buses: Sequence[NamedBus], tell: Callable[[bool, str], None]) -> None:
        self.buses = tuple(buses)
        self._tell = tell
        several = len(buses) > 1
        self.links = [
            BusLink(bus.connect, _named(bus.name, tell) if several else tell, bus.listen_only, bus.wanted)
            for bus in buses
        ]
        self._held = NOTHING
        self._pace = Pace()
        self._offsets_us: list[int | None] = [None] * len(buses)  # time of the frames less the steady clock
        self._apart_since_s: float | None = None
        self._apart_told = False

    @property
    def counts(self) -> LinkCounts:
        """What happened on all wires together."""
        names = [field.name for field in fields(LinkCounts)]
        return LinkCounts(**{name: sum(getattr(link.counts, name) for link in self.links) for name in names})

    @property
    def away(self) -> list[str]:
        """Names of the buses that are not open."""
        return [bus.name for bus, link in zip(self.buses, self.links, strict=True) if not link.up]

    @property
    def mute(self) -> list[str]:
        """Of each bus of which nothing has come: that it is away, or what to look at."""
        texts = []
        for bus, link in zip(self.buses, self.links, strict=True):
            if not link.up and not link.counts.received:
                texts.append(f"{bus.name} is not there")
            elif (text := link.mute) is not None:
                texts.append(text)
        return texts

    def open(self, given_up: Callable[[], bool], wait: bool) -> None:
        """Open all buses for the first time.

        Args:
            given_up: says that they are not wanted any more.
            wait: a bus that cannot be opened is told, and waited for.

        Raises:
            BusError: some cannot be opened; all of them are named. Those that can are closed.
        """
        errors = []
        for link in self.links:
            try:
                link.open(given_up)
            except BusError as error:
                errors.append(str(error))
        if errors and not wait:
            self.close()
            raise BusError("\n".join(errors))
        for text in errors:
            self._tell(True, f"{text}; waiting for it")

    def close(self) -> None:
        """Close all buses."""
        for link in self.links:
            link.close()

    def receive(self, timeout_s: float) -> Frames:
        """Return the messages that wait on any bus, or wait for the first up to ``timeout_s``.

        The columns are only valid until the next call.
        """
        if len(self.links) == 1:
            frames = self.links[0].receive(timeout_s)
            frames.channel[:] = self.buses[0].number
            return frames
        self._pace.rest()
        parts = self._look(set())
        if not len(self._held) and not any(map(len, parts)):
            parts = self._look(self._wait(timeout_s))
        if not len(self._held) and not any(map(len, parts)):
            return NOTHING
        self._pace.looked(time.monotonic(), full=any(len(part) >= MOST for part in parts))
        return self._merged(parts)

    def _look(self, ready: set[int]) -> list[Frames]:
        """Return what each bus has, in memory of its own."""
        return [
            self._of_bus(n, self.links[n].look(READY_S if n in ready else 0.0)) for n in range(len(self.links))
        ]

    def _of_bus(self, n: int, frames: Frames) -> Frames:
        if not len(frames):
            return NOTHING
        frames.channel[:] = self.buses[n].number
        return frames.copy()

    def _merged(self, parts: list[Frames]) -> Frames:
        """Return what is due of a look and of what was held before; hold the rest.

        The frames of a bus that was looked at early may go on while others are looked at. So these are looked at
        once more, and what is later than all that the first look found is held until the next.
        """
        self._watch_clocks(parts)
        ends = [int(part.t_us.max()) for part in parts if len(part)]
        last = max((n for n, part in enumerate(parts) if len(part)), default=0)
        again = [self._of_bus(n, self.links[n].look(0.0)) for n in range(last) if len(parts[n]) < MOST]
        full = [int(part.t_us.max()) for part in (*parts, *again) if len(part) >= MOST]  # more waits behind these
        horizon_us = max([*ends, *self._held.t_us.tolist()])
        if full and len(self._held) < MOST_HELD:
            horizon_us = min(horizon_us, *full)
        found = [part for part in (self._held, *parts, *again) if len(part)]
        frames = found[0] if len(found) == 1 else Frames.concatenate(found).sorted_by_time()
        due = frames.t_us <= horizon_us
        if due.all():
            self._held = NOTHING
            return frames
        self._held = frames[~due]
        return frames[due]

    def _wait(self, timeout_s: float) -> set[int]:
        """Wait until something comes; return the buses to be asked with some patience.

        These are the ones on which something came, and those whose interface cannot be waited for: to ask them is
        to wait, and only so `spin` notices one that does not.
        """
        files = [link.file_number for link in self.links]
        blind = {n for n, link in enumerate(self.links) if link.up and files[n] < 0}
        numbers = {file: n for n, file in enumerate(files) if file >= 0}
        longest_s = 0.0 if blind else min([timeout_s, *(DOWN_S for link in self.links if not link.up)])
        if not numbers:
            time.sleep(longest_s)
            return blind
        if not hasattr(select, "poll"):  # Windows
            return blind | set(numbers.values())
        poll = select.poll()
        for file in numbers:
            poll.register(file, select.POLLIN)
        return blind | {numbers[file] for file, _ in poll.poll(math.ceil(1000.0 * longest_s))}

    def _watch_clocks(self, parts: Sequence[Frames]) -> None:
        """Tell, once, when the times of two buses do not fit together."""
        if self._apart_told:
            return
        now_s = time.monotonic()
        for n, part in enumerate(parts):
            if 0 < len(part) < MOST:
                self._offsets_us[n] = int(part.t_us.max()) - round(1e6 * now_s)
        known = [(offset, n) for n, offset in enumerate(self._offsets_us) if offset is not None]
        if len(known) < 2 or max(known)[0] - min(known)[0] < CLOCKS_APART_US:
            self._apart_since_s = None
            return
        if self._apart_since_s is None:
            self._apart_since_s = now_s
        elif now_s - self._apart_since_s >= CLOCKS_APART_S:
            self._apart_told = True
            (least, behind), (most, ahead) = min(known), max(known)
            self._tell(
                True,
                f"the times of {self.buses[behind].name} are {(most - least) / 1e6:.1f} s behind those of "
                f"{self.buses[ahead].name}: their frames cannot be put in order, and estimates suffer",
            )


def _named(name: str, tell: Callable[[bool, str], None]) -> Callable[[bool, str], None]:
    return lambda is_error, text: tell(is_error, f"{name}: {text}")
