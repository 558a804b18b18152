"""The signals of the DBCs with what their names, comments, units and ranges say: everything but the log."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.layout import SignalLayout, layout_problem, selector_problem
from dctorque_can.config.units import Dimension, UnitError, factor_to_si
from dctorque_can.starter.words import Word, plain, words

NOMINAL_RADIUS_M = 0.31
"""Rolling radius of cars, within 15 %: for telling units apart, never for a number of the vehicle file."""
_NAME = re.compile(r"^[A-Za-z_]\w*\.[A-Za-z_]\w*$")  # that a vehicle file can name
_NO_UNIT = {"", "-", "none", "unitless", "xxx", "tbd", "unit", "sed", "1", "raw", "unit_none"}
_NO_VALUE = (
    *(
        "invalid",
        "unavail",
        "not avail",
        "notavail",
        "no value",
        "undefined",
        "unknown",
        "reserved",
        "fault",
        "error",
    ),
    *(
        "sna",
        "fehler",
        "ungueltig",
        "nicht verfueg",
        "nichtverfueg",
        "init",
        "defekt",
        "unbekannt",
        "not used",
        "notused",
    ),
    *(
        "not valid",
        "notvalid",
        "unplausib",
        "not_avail",
        "not_valid",
        "failure",
        "signal not",
        "no signal",
        "indispon",
    ),
)
_SPECIAL_ABBREVIATIONS = {"na", "n/a", "snv", "sna", "err", "inv", "nv", "inval"}


@dataclass(frozen=True)
class Entry:
    """One readable signal of a DBC.

    Attributes:
        message: that it is in.
        signal: as cantools has it.
        database: number of its DBC, in the order in which they were given.
    """

    message: Message
    signal: Signal
    database: int = 0

    @property
    def name(self) -> str:
        """``Message.Signal``, as a vehicle file has it."""
        return f"{self.message.name}.{self.signal.name}"

    @cached_property
    def layout(self) -> SignalLayout:
        """Where its bits are."""
        return SignalLayout.of(self.signal)

    @cached_property
    def own(self) -> frozenset[Word]:
        """The notions of its own name."""
        return words(self.signal.name)

    @cached_property
    def around(self) -> frozenset[Word]:
        """The notions of its comment, of its message and of who sends that."""
        texts = (_text(self.signal.comment), self.message.name, *self.message.senders, _text(self.message.comment))
        return frozenset().union(*(words(text) for text in texts)) - {Word.VEHICLE}

    @cached_property
    def comment(self) -> frozenset[Word]:
        """The notions of its comment alone."""
        return words(_text(self.signal.comment))

    @property
    def unit(self) -> str:
        """As the DBC has it; "" for none."""
        text = (self.signal.unit or "").strip()
        return "" if plain(text).lower() in _NO_UNIT else text

    @property
    def span(self) -> tuple[float, float]:
        """The smallest and the largest physical value that its bits can code; ±inf of a float."""
        if self.layout.is_float:
            return (-float("inf"), float("inf"))
        ends = sorted(self.layout.scale * raw + self.layout.offset for raw in self.layout.raw_range)
        return ends[0], ends[1]

    @property
    def steps(self) -> float:
        """How many values it can have."""
        return float("inf") if self.layout.is_float else 2.0**self.layout.bits

    def factor(self, dimension: Dimension, unit: str | None = None) -> float | None:
        """Return the factor of its unit (or another one) to SI; None of a unit that is none of that dimension.

        Road speeds become those of a wheel with `NOMINAL_RADIUS_M`; per cent stay per cent.
        """
        try:
            return factor_to_si(
                self.unit if unit is None else unit, dimension, wheel_radius_m=NOMINAL_RADIUS_M, reference_nm=100.0
            )
        except UnitError:
            return None

    @cached_property
    def choices(self) -> dict[int, str]:
        """Its value table: raw value to text."""
        return {int(raw): str(text) for raw, text in (self.signal.choices or {}).items()}

    @cached_property
    def no_value(self) -> tuple[int, ...]:
        """Raw values that its value table names as no value."""
        return tuple(sorted(raw for raw, text in self.choices.items() if says_no_value(text)))


def says_no_value(text: str) -> bool:
    """Return whether the text of a value table means that there is no value."""
    flat = plain(text).lower().strip()
    spaced = flat.replace("_", " ")
    return spaced in _SPECIAL_ABBREVIATIONS or any(each in flat or each in spaced for each in _NO_VALUE)


def catalogue(databases: Iterable[Database]) -> list[Entry]:
    """Return every signal that can be read, in the order of the DBCs; of two messages of one name the first."""
    entries: list[Entry] = []
    seen: set[str] = set()
    for number, database in enumerate(databases):
        for message in database.messages:
            if message.name in seen:
                continue
            seen.add(message.name)
            entries += [
                Entry(message, signal, number)
                for signal in message.signals
                if _NAME.match(f"{message.name}.{signal.name}")
                and not (layout_problem(signal, message.length) or selector_problem(message, signal))
            ]
    return entries


def by_message(entries: Iterable[Entry]) -> Mapping[str, list[Entry]]:
    """Return the signals of each message, by its name."""
    found: dict[str, list[Entry]] = {}
    for entry in entries:
        found.setdefault(entry.message.name, []).append(entry)
    return found


def _text(comment: object) -> str:
    """Return a comment that cantools may have in several languages, or none."""
    if isinstance(comment, dict):
        return " ".join(str(each) for each in comment.values())
    return str(comment or "")
