"""The `can:`, `output:`, `logging:` and `status:` sections: what the service connects to. These have defaults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any

from cantools.database.can import Database
from pydantic import Field

from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.config.signals import ChannelNumber

LAST_PORT = 65_535
LONGEST_SOCKET = 107  # bytes
LAST_STANDARD_ID = 0x7FF
LAST_EXTENDED_ID = 0x1FFF_FFFF


class CanSection(Section):
    """The bus, in the words of python-can."""

    interface: str = "socketcan"
    """Interface of python-can, such as socketcan, pcan, vector, virtual."""
    channel: str | int = "can0"
    """Channel of the interface, such as can0."""
    number: ChannelNumber | None = None
    """Number of its channel for `databases` and in the log; default: its place in the list, from 0."""
    bitrate: Annotated[int, Field(ge=1_000, le=10_000_000)] | None = None
    """Bit rate, 1/s; default: as the interface is set up."""
    fd: bool = False
    """Receive CAN FD frames too."""
    data_bitrate: Annotated[int, Field(ge=1_000, le=20_000_000)] | None = None
    """Bit rate of the data phase of CAN FD, 1/s."""
    receive_own_messages: bool = False
    """Also receive what this node sends (never used for estimates, but logged)."""
    listen_only: bool = False
    """Never send on this bus; adapters that can are told not even to acknowledge."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Further arguments of python-can's Bus for this interface, passed as they are."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        for name in self.options:
            if name in CanSection.model_fields:
                yield ("options", name), f"has a key of its own: can.{name}"
        if self.data_bitrate is not None and not self.fd:
            yield ("data_bitrate",), "needs fd: true"

    def arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of ``can.Bus``; what was not given is left to the interface."""
        ours = ("options", "fd", "number", "listen_only")
        given = {name: value for name, value in dict(self).items() if name not in ours}
        arguments = {name: value for name, value in given.items() if value is not None}
        return arguments | ({"fd": True} if self.fd else {}) | self.options

    def __str__(self) -> str:
        return f"{self.interface}:{self.channel}"


class OutputSection(Section):
    """The estimates on the bus."""

    enabled: bool = False
    """Send the estimates on the bus."""
    database: str | None = None
    """DBC of the messages to be sent, relative to this file; default: the dctorque.dbc that ships."""
    ids: dict[str, Annotated[int, Field(ge=0, le=LAST_EXTENDED_ID)]] = Field(default_factory=dict)
    """Message name to arbitration id, instead of the DBC's; ids above 0x7FF are extended (29 bit)."""
    channel: ChannelNumber | None = None
    """Number of the bus that they are sent on, of several under `can`; default: the first one."""
    foreign_silence_s: Annotated[float, Field(ge=0.5, le=86_400)] | None = 5.0
    """Send again on an id once nobody else was heard on it for so long, s; null: not before the next start."""


class LoggingSection(Section):
    """The MCAP log."""

    enabled: bool = True
    """Write a log."""
    directory: str = "logs"
    """Where logs are written, relative to the working directory."""
    flush_ms: Annotated[float, Field(ge=10, le=60_000)] = 200.0
    """After this time, ms, the operating system has what was received: no killed process loses more."""
    fsync_s: Annotated[float, Field(ge=0.1, le=3600)] | None = None
    """Have the disk itself take everything at this interval, s; null: when the operating system does so."""
    rotate_mb: Annotated[float, Field(gt=0)] | None = 1000.0
    """Begin a new file at this size, MB; null: never."""
    rotate_s: Annotated[float, Field(gt=0)] | None = 3600.0
    """Begin a new file after this time, s; null: never."""
    keep_mb: Annotated[float, Field(gt=0)] | None = None
    """Delete the oldest logs of this vehicle in the directory beyond this total, MB; null: keep all."""
    least_free_mb: Annotated[float, Field(gt=0)] | None = None
    """Leave at least this much of the disk free, MB: with keep_mb the oldest logs go, else no more is written."""
    frames: bool = True
    """Log every CAN frame."""
    signals: bool = False
    """Log the decoded signals of every DBC message."""
    estimates: bool = True
    """Log estimates and health."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.keep_mb is not None and (self.rotate_mb is None or self.rotate_mb > self.keep_mb):
            yield ("keep_mb",), "must be at least rotate_mb, or nothing could ever be deleted"


class StatusSection(Section):
    """Where the status of the service can be read while it runs."""

    socket: str | None = None
    """Path of a Unix socket for `dctorque status`; default: status.sock in `$RUNTIME_DIRECTORY`, if set."""
    metrics: str | None = None
    """Loopback address and port for Prometheus, such as 127.0.0.1:9642; default: none."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.socket is not None and not 0 < len(self.socket.encode()) <= LONGEST_SOCKET:
            yield ("socket",), f"must be a path of at most {LONGEST_SOCKET} bytes: the kernel takes no longer one"
        if self.metrics is not None and self.metrics_address() is None:
            yield (
                ("metrics",),
                "must be a loopback address and a port, such as 127.0.0.1:9642 or [::1]:9642: on any other "
                "everybody in the network could read it; a proxy may pass it on with a password",
            )

    def metrics_address(self) -> tuple[str, int] | None:
        """Return address and port of `metrics`; None where there is none, or no loopback address."""
        host, _, port = (self.metrics or "").rpartition(":")
        try:
            address = ip_address(host.removeprefix("[").removesuffix("]"))
        except ValueError:
            return None
        bracketed = host.startswith("[") and host.endswith("]")
        if not address.is_loopback or bracketed != (address.version == 6):
            return None
        digits = port.isascii() and port.isdecimal() and len(port) <= len("65535")
        return (str(address), int(port)) if digits and 1 <= int(port) <= LAST_PORT else None


class DatabaseSection(Section):
    """One DBC."""

    file: str
    """Path of the DBC, relative to this file."""
    strict: bool = True
    """false: accept overlapping signals and signals beyond the end of a message."""
    channel: ChannelNumber | None = None
    """Channel that its messages are on, of a log or a live bus, from 0; default: any."""
    j1939: bool | None = None
    """Whether its messages of 29 bits are known by their parameter group number; default: as the DBC says."""
    source_addresses: dict[str, Annotated[int, Field(ge=0, le=255)]] = Field(default_factory=dict)
    """Message name to the one J1939 source address from which it is taken; default: any."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.source_addresses and self.j1939 is False:
            yield ("source_addresses",), "needs messages of J1939: leave j1939: false out"


@dataclass(frozen=True, slots=True)
class OutputSettings:
    """What is sent on the bus.

    Attributes:
        enabled: whether anything is sent.
        path: where the DBC came from.
        database: the messages to be sent.
        ids: message name to arbitration id, where it differs from the DBC; above 0x7FF extended.
        channel: number of the bus that they are sent on.
        foreign_silence_s: how long nobody else must have been heard on an identifier; None: for ever.
    """

    enabled: bool
    path: Path
    database: Database
    ids: dict[str, int]
    channel: int
    foreign_silence_s: float | None
