"""The buses under `can:`, one or a list of them, and whether channels that are named elsewhere are among them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from dctorque_can.config.document import Document
from dctorque_can.config.edges import CanSection
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import validate

_CAN: KeyPath = ("can",)
_WITH_CHANNELS = ("databases", "inputs", "gears", "clutch_phase", "protection")


def read_buses(document: Document) -> tuple[CanSection, ...] | None:
    """Return the buses, each with its number; None when there is an error.

    A channel number elsewhere in the file that no bus has is a warning, if `can` is given: live, it is silent.
    """
    given = document.value(_CAN)
    if given == []:
        document.problems.append(document.problem(_CAN, "is an empty list: name a bus, or leave it out"))
        return None
    places: list[KeyPath] = [(*_CAN, n) for n in range(len(given))] if isinstance(given, list) else []
    sections = [validate(document, place, CanSection) for place in places or [_CAN]]
    buses: list[CanSection] = []
    errors = 0
    for n, section in enumerate(sections):
        if section is None:
            errors += 1
            continue
        bus = section.model_copy(update={"number": n if section.number is None else section.number})
        at = places[n] if places else _CAN
        for other in buses:
            if other.number == bus.number:
                reason = f"{other} has the number {bus.number} already; give another one"
                document.problems.append(document.problem((*at, "number"), reason))
                errors += 1
            if str(other) == str(bus):
                document.problems.append(document.problem((*at, "channel"), f"{other} is in the list twice"))
                errors += 1
        buses.append(bus)
    if errors:
        return None
    if given:
        _note_unknown_channels(document, buses)
    return tuple(buses)


def output_channel(document: Document, buses: tuple[CanSection, ...]) -> int:
    """Return the number of the bus that estimates are sent on; report one that there is not, or only listens."""
    numbers = [bus.number for bus in buses if bus.number is not None]
    channel = document.value(("output", "channel"))
    if isinstance(channel, int) and channel not in numbers:
        reason = f"no bus under can has this number; there is {', '.join(map(str, numbers))}"
        document.problems.append(document.problem(("output", "channel"), reason))
    number = channel if isinstance(channel, int) else numbers[0]
    bus = next((bus for bus in buses if bus.number == number), None)
    if bus is not None and bus.listen_only and document.value(("output", "enabled")) is True:
        reason = f"{bus} is listen_only: send on another bus (output.channel), or set one of both to false"
        document.problems.append(document.problem(("output", "enabled"), reason))
    return number


def _note_unknown_channels(document: Document, buses: list[CanSection]) -> None:
    numbers = [bus.number for bus in buses]
    for section in _WITH_CHANNELS:
        for path, channel in _channels(document.value((section,)), (section,)):
            if channel not in numbers:
                reason = (
                    f"no bus under can has this number (there is {', '.join(map(str, numbers))}): live, nothing "
                    "comes from it"
                )
                document.problems.append(document.problem(path, reason, warning=True))


def _channels(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, int]]:
    """Yield every key `channel` below a section with its number."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        if key == "channel" and isinstance(item, int):
            yield (*path, key), item
        else:
            yield from _channels(item, (*path, key))
