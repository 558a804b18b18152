"""How a vehicle file describes the checksum and the counter of a message."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from dctorque_can.bus.checksum_kinds import KINDS, Coverage
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.config.signals import ChannelNumber
from dctorque_can.pipeline.samples import Protection


class ProtectionSection(Section):
    """How one received message is protected."""

    crc: Literal[
        "none",
        "crc8_j1850",
        "e2e_p01",
        "e2e_p02",
        "e2e_p04",
        "e2e_p05",
        "e2e_p06",
        "e2e_p07",
        "e2e_p11",
        "sum8",
        "xor8",
        "nibble_sum",
        "chrysler",
        "honda",
        "hyundai_bits",
        "hyundai_canfd",
        "hyundai_crc8",
        "subaru",
        "tesla",
        "toyota",
        "vw_mqb",
    ] = "none"
    """Kind of checksum, see [below](#kinds-of-checksum)."""
    crc_signal: str = ""
    """The checksum signal of the message."""
    crc_high_signal: str = ""
    """The signal with the upper bits of a checksum in two parts; ``crc_signal`` has the lower ones."""
    counter_signal: str = ""
    """The alive counter signal of the message."""
    counter_high_signal: str = ""
    """The signal with the upper bits of a counter in two parts; ``counter_signal`` has the lower ones."""
    counter_modulus: Annotated[int, Field(ge=2, le=2**32)] | None = None
    """The counter runs 0..modulus-1; default: that of the kind of checksum, else 16."""
    max_counter_delta: Annotated[int, Field(ge=1, le=255)] = 3
    """Largest accepted step of the counter; a step of 3 means that two frames were lost."""
    data_id: Annotated[int, Field(ge=0, le=0xFFFF_FFFF)] | None = None
    """AUTOSAR data id of the message, for the kinds that need one."""
    data_id_mode: Literal["both", "low", "alternating", "nibble"] = "both"
    """Which part of the data id counts, for e2e_p01 and e2e_p11: both bytes, low, alternating or nibble."""
    data_ids: Annotated[list[Annotated[int, Field(ge=0, le=0xFF)]], Field(min_length=16, max_length=16)] | None = (
        None
    )
    """The 16 data ids by counter, for e2e_p02 and vw_mqb."""
    crc_start: Annotated[int, Field(ge=0, le=0xFF)] | None = None
    """What the checksum starts with; default: that of its kind."""
    crc_xor: Annotated[int, Field(ge=0, le=0xFF)] | None = None
    """What is XORed to the checksum at the end; default: that of its kind."""
    crc_bytes: Annotated[int, Field(ge=1, le=64)] | None = None
    """How many first bytes of the message the checksum covers; default: all."""
    channel: ChannelNumber | None = None
    """Channel on which the message is protected so, where a gateway copies it otherwise; default: all."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        kind = KINDS.get(self.crc)
        if kind is None and not self.counter_signal:
            yield ("counter_signal",), "missing: a protection has a crc, a counter_signal, or both"
        if kind is not None and not self.crc_signal:
            yield ("crc_signal",), f"missing: {self.crc} needs the signal that carries the checksum"
        if kind is None and self.crc_signal:
            yield ("crc_signal",), "has no effect without crc, the kind of checksum"
        if kind is not None and kind.needs_counter and not self.counter_signal:
            yield ("counter_signal",), f"missing: {self.crc} has an alive counter"
        if kind is not None and kind.data_id_bits and self.data_id is None:
            yield ("data_id",), f"missing: {self.crc} needs the data id of the message"
        if self.crc == "e2e_p02" and self.data_ids is None:
            yield ("data_ids",), "missing: e2e_p02 needs the 16 data ids of the message"
        if self.max_counter_delta >= self.modulus:
            yield ("max_counter_delta",), f"must be less than the counter's modulus ({self.modulus})"

    def idle(self) -> Iterator[str]:
        """Yield the keys that are given and have no effect with this kind of checksum."""
        kind = KINDS.get(self.crc)
        if self.data_id is not None and not (kind is not None and kind.data_id_bits):
            yield "data_id"
        if self.data_ids is not None and not (kind is not None and kind.beside is Coverage.IDS_BY_COUNTER):
            yield "data_ids"
        if self.crc_bytes is not None and kind is None:
            yield "crc_bytes"

    def protection(self, message: str) -> Protection:
        """Return the protection of a message, as the decoder is told it."""
        return Protection(
            message,
            counter_signal=self.counter_signal,
            counter_modulus=self.modulus,
            max_counter_delta=self.max_counter_delta,
            crc=self.crc,
            crc_signal=self.crc_signal,
            data_id=self.data_id or 0,
            data_ids=tuple(self.data_ids or ()),
            counter_high_signal=self.counter_high_signal,
            crc_high_signal=self.crc_high_signal,
            data_id_mode=self.data_id_mode,
            crc_start=self.crc_start,
            crc_xor=self.crc_xor,
            crc_bytes=self.crc_bytes or 0,
            channel=self.channel,
        )

    @property
    def modulus(self) -> int:
        """The counter's modulus with its default."""
        return self.counter_modulus or (KINDS[self.crc].modulus if self.crc in KINDS else 16)
