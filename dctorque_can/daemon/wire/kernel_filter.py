"""Leaves to the kernel what nobody needs: on SocketCAN, where frames are not logged."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import can
from can.interfaces.socketcan import SocketcanBus
from can.typechecking import CanFilter

from dctorque_can.daemon.wire.socketcan import SocketcanReceiver
from dctorque_can.pipeline.frames import EXTENDED_ID, ID_MASK, Address, Frames

OPEN_S = 1.0  # without a frame: everything is received again, to tell a silent bus from one with other frames
MOST = 500  # the kernel takes 512


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which frames of a bus are needed when frames are not logged.

    Attributes:
        inputs: by what the messages are known that inputs come from.
        can_ids: others to be heard, with `EXTENDED_ID` where they are extended: those that we send ourselves.
    """

    inputs: Sequence[Address]
    can_ids: Collection[int] = ()

    def on_channel(self, number: int) -> Wanted:
        """Return what is wanted of a bus with this number."""
        return Wanted([each for each in self.inputs if each.channel in (None, number)], self.can_ids)

    def filters(self) -> list[CanFilter]:
        """Return it for ``can.BusABC.set_filters``."""
        addresses = [*self.inputs, *(Address(can_id) for can_id in sorted(self.can_ids))]
        return [
            {
                "can_id": each.can_id & ID_MASK,
                "can_mask": each.mask & ID_MASK,
                "extended": bool(each.can_id & EXTENDED_ID),
            }
            for each in addresses
        ]


class KernelFilter:
    """The filter of one bus: on while frames come that inputs read, off while none does.

    Everything is received until the first mapped frame, so that a bus with other frames alone is told as such.
    When nothing passes the filter for `OPEN_S`, everything is received again: a bus is silent only if nothing
    comes then. Error frames pass always; the kernel has a filter of its own for them.

    Args:
        bus: of python-can.
        wanted: None: everything. So it is where the bus has no such filter, or has one already.

    Attributes:
        on: whether the kernel leaves frames out.
        used: whether it ever did.
    """

    def __init__(self, bus: can.BusABC, wanted: Wanted | None) -> None:
        self.on = self.used = False
        self._bus = bus
        self._wanted = wanted
        fits = wanted is not None and SocketcanReceiver.fits(bus) and bus.filters is None
        self._filters = wanted.filters() if wanted is not None and fits else []
        if not wanted or not wanted.inputs or len(self._filters) > MOST:
            self._filters = []
        self._heard_s = 0.0

    def heard(self, frames: Frames, now_s: float) -> None:
        """Note that frames came that are no error frames."""
        self._heard_s = now_s
        if self._filters and not self.on and self._has_input(frames):
            self._bus.set_filters(self._filters)
            self.on = isinstance(self._bus, SocketcanBus) and bool(self._bus._is_filtered)
            self.used |= self.on
            if not self.on:
                self._give_up()

    def quiet(self, now_s: float) -> None:
        """Note that none has come."""
        if self.on and now_s - self._heard_s >= OPEN_S:
            self._bus.set_filters(None)
            self.on = False

    def _has_input(self, frames: Frames) -> bool:
        inputs = () if self._wanted is None else self._wanted.inputs
        return any(((frames.can_id ^ each.can_id) & each.mask == 0).any() for each in inputs)

    def _give_up(self) -> None:
        """Receive everything: this kernel has refused the filters, and python-can would filter by itself."""
        self._filters = []
        self._bus.set_filters(None)
