"""How sections of signals become the inputs of the decoder: units, raw values, ranges."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.addresses import read_addresses
from dctorque_can.bus.problems import input_problems, shared_frames
from dctorque_can.config.dbc_signal import can_be_negative
from dctorque_can.config.document import Document
from dctorque_can.config.input_limits import InputLimits
from dctorque_can.config.problems import KeyPath, dotted
from dctorque_can.config.protection import ProtectionSection
from dctorque_can.config.section import nearest
from dctorque_can.config.signals import (
    VALUE_TABLE,
    ClutchStateSection,
    ConditionalSection,
    DirectionSection,
    FlagSection,
    GearSignalSection,
    InputSection,
    InputTimeout,
    ShiftFlagSection,
    SpeedSection,
    TermSection,
)
from dctorque_can.config.units import DIMENSIONS, Dimension, UnitError, factor_to_si, same_unit, share_of
from dctorque_can.pipeline.frames import Address
from dctorque_can.pipeline.samples import (
    LONGEST_LEARNED_US,
    Input,
    Multiplier,
    Protection,
    Quantity,
    Signs,
    Term,
    Validity,
)

SAYS_NOT_AVAILABLE = ("not available", "notavailable", "sna", "invalid", "no value", "fault", "error")


@dataclass(frozen=True, slots=True)
class InputEntry:
    """One input of the decoder with what the vehicle file says about it.

    Attributes:
        key: dotted key path.
        input: what the decoder is told.
        units: unit of each term, as given or as in the DBC; "" where the value is kept or mapped.
        periods_ms: cycle time of each term's message, None where the DBC has none.
        multiplier_unit: unit of the multiplier, if there is one.
        resolution: SI, rounding has the variance resolution²/12; 0 of floats, and where a value is mapped.
    """

    key: str
    input: Input
    units: tuple[str, ...]
    periods_ms: tuple[float | None, ...]
    resolution: float = 0.0
    multiplier_unit: str = ""


class _Factored(NamedTuple):
    """A multiplier, its unit and the factor of that to SI, and whether it has the unit of the quantity."""

    multiplier: Multiplier
    unit: str
    factor: float
    has_unit: bool


class InputBuilder:
    """Turns the sections of signals into inputs; whatever does not fit the DBC goes to the document's problems."""

    def __init__(
        self,
        document: Document,
        database: Database | None,
        addresses: Mapping[str, Address],
        wheel_radius_m: float,
    ):
        self._document = document
        self._addresses = addresses
        self._messages: dict[str, Message] = {m.name: m for m in database.messages} if database else {}
        self._database = database
        self._wheel_radius_m = wheel_radius_m
        self.entries: list[InputEntry] = []

    def add(self, path: KeyPath, quantity: Quantity, section: InputSection) -> None:
        """Add a linear combination of signals."""
        dimension = DIMENSIONS[quantity]
        terms: list[Term] = []
        units: list[str] = []
        factors: list[float] = []
        factored = self._multiplier(path, section, dimension)
        for below, term in section.terms():
            at = (*path, *below)
            shares = factored is not None and factored.has_unit
            unit, factor = self._share(at, term) if shares else self._unit(at, term, dimension)
            message, signal = term.signal.split(".")
            terms.append(
                Term(
                    message,
                    signal,
                    factor=term.factor * factor,
                    offset=term.offset * factor,
                    not_available=frozenset(self._not_available(at, term)),
                    channel=section.channel,
                )
            )
            units.append(unit)
            factors.append(factor)
        if factored is not None and factored.has_unit:
            factors = [factored.factor]
        limits = InputLimits(path, section, quantity, factors, self._wheel_radius_m, self._complain)
        lowest, highest = limits.range()
        timeout, learned, delay = *_timeout(section.timeout_ms), _us(section.delay_ms)
        signs = self._signs(path, section, [*terms, *([] if factored is None else [factored.multiplier.term])])
        multiplier = None if factored is None else factored.multiplier
        valid = self._validity(path, section, section.channel)
        resolution = self._resolution(terms)
        if factored is not None and factored.has_unit:
            resolution *= max(abs(lowest), abs(highest))  # of a share
        change = limits.most_per_s(), resolution
        bounds = lowest, highest, timeout
        given = Input(quantity, tuple(terms), *bounds, delay, signs, multiplier, valid, *change, learned)
        if factored is None:
            self._append(path, given, units, given.resolution)
        else:
            self._append(path, given, units, multiplier_unit=factored.unit)

    def add_mapped(
        self,
        path: KeyPath,
        quantity: Quantity,
        section: GearSignalSection | FlagSection | ShiftFlagSection | ClutchStateSection | DirectionSection,
        values: Mapping[int | str, float],
    ) -> None:
        """Add a signal whose raw values mean something else (a gear, a flag, a state), or the mean of several."""
        names = section.names if isinstance(section, DirectionSection) else [section.signal]
        terms = []
        for name in names:
            message, signal = name.split(".")
            known = {
                raw: value for key, value in values.items() for raw in self._raw((*path, "values", key), name, key)
            }
            terms.append(Term(message, signal, 1.0 / len(names), values=known, channel=section.channel))
        lowest, highest = min(values.values()), max(values.values())
        timeout, learned, delay = *_timeout(section.timeout_ms), _us(section.delay_ms)
        valid = self._validity(path, section, section.channel)
        bounds = float(lowest), float(highest), timeout
        given = Input(quantity, tuple(terms), *bounds, delay, validity=valid, learns_timeout=learned)
        self._append(path, given, [""] * len(terms))

    def protect(self, path: KeyPath, message: str, section: ProtectionSection) -> Protection:
        """Return the protection of one message."""
        protection = section.protection(message)
        for key in section.idle():
            self._warn((*path, key), f"has no effect with crc: {section.crc}")
        if self._database is not None:
            reported = {dotted((*path, *below)) for below, _ in section.contradictions()}
            reported |= {problem.key for problem in self._document.problems}
            for problem in input_problems(self._database, (), (protection,)):
                if message not in self._messages:
                    self._complain(path, problem.reason, problem.suggestions)
                elif dotted((*path, problem.key)) not in reported:
                    self._complain((*path, problem.key), problem.reason, problem.suggestions)
            inputs = [entry.input for entry in self.entries]
            used = {key for key in read_addresses(self._database, inputs, self._addresses) if key[0] == message}
            if message in self._messages and not used:
                self._warn(path, "has no effect: no input comes from this message")
            elif used and all(section.channel not in (None, address.channel) for _, address in used):
                reason = "has no effect: no input comes from this message on that channel"
                self._warn((*path, "channel"), reason)
        return protection

    def check_together(self) -> None:
        """Report where one frame would be two of the messages that the inputs read."""
        if self._database is None:
            return
        inputs = [entry.input for entry in self.entries]
        for problem in shared_frames(self._database, inputs, self._addresses):
            of_message = (e for e in self.entries if any(t.message == problem.message for t in e.input.signals))
            path = tuple(next(of_message).key.split("."))
            self._complain(self._place(path, problem.message, ""), f"{problem.message} {problem.reason}")

    def _multiplier(self, path: KeyPath, section: InputSection, dimension: Dimension) -> _Factored | None:
        """Return what an input is multiplied with, or divided by."""
        if section.multiplier is None:
            return None
        key, given = section.multiplier
        at, term = (*path, key), given.term()
        unit, share = self._unit_of(term), share_of(self._unit_of(term))
        has_unit = share is None and key == "times" and dimension is not Dimension.AS_IS
        if has_unit:
            unit, factor = self._unit(at, term, dimension)
            if section.reference_nm is not None:
                reason = f"is what {given.signal} says: leave reference_nm or times out"
                self._complain((*path, "reference_nm"), reason)
        elif dimension is Dimension.AS_IS:
            factor = 1.0
        else:
            unit, factor = self._share(at, term)
        message, signal = given.signal.split(".")
        made = Term(
            message,
            signal,
            factor=given.factor * factor,
            offset=given.offset * factor,
            not_available=frozenset(self._not_available(at, term)),
            channel=section.channel,
        )
        self._check_age(at, message, given.timeout_ms)
        return _Factored(Multiplier(made, _us(given.timeout_ms), key == "divided_by"), unit, factor, has_unit)

    def _validity(self, path: KeyPath, section: ConditionalSection, channel: int | None) -> Validity | None:
        """Return what says whether an input is valid."""
        given = section.valid_if
        if given is None:
            return None
        at = (*path, "valid_if")
        message, signal = given.signal.split(".")
        raws = [
            raw for n, key in enumerate(given.values) for raw in self._raw((*at, "values", n), given.signal, key)
        ]
        self._check_age(at, message, given.timeout_ms)
        if not raws:
            return None
        term = Term(message, signal, values=dict.fromkeys(raws, 1.0), channel=channel)
        return Validity(term, _us(given.timeout_ms))

    def _check_age(self, path: KeyPath, message: str, timeout_ms: float) -> None:
        """Warn of a timeout that one lost frame of a message exceeds."""
        known = self._messages.get(message)
        if known is not None and known.cycle_time and timeout_ms < 2 * known.cycle_time:
            reason = f"is less than two periods of {known.cycle_time:g} ms: one lost frame makes the input stale"
            self._warn((*path, "timeout_ms"), reason)

    def _append(
        self,
        path: KeyPath,
        given: Input,
        units: Iterable[str],
        resolution: float = 0.0,
        multiplier_unit: str = "",
    ) -> None:
        if self._database is not None:
            for problem in input_problems(self._database, (given,), (), self._addresses):
                self._complain(
                    self._place(path, problem.message, problem.signal), problem.reason, problem.suggestions
                )
        messages = [self._messages.get(term.message) for term in given.terms]
        periods = tuple(m.cycle_time if m is not None and m.cycle_time else None for m in messages)
        longest = max((period for period in periods if period), default=0)
        if given.timeout_us < 2000 * longest:
            reason = f"is less than two periods of {longest:g} ms: one lost frame makes the input stale"
            self._warn((*path, "timeout_ms"), reason)
        entry = InputEntry(dotted(path), given, tuple(units), periods, resolution, multiplier_unit)
        self.entries.append(entry)

    def _place(self, path: KeyPath, message: str, signal: str) -> KeyPath:
        """Return the key path of the signal that a problem of the bus is about."""
        value = self._document.value(path)
        if isinstance(value, dict):
            for key in ("times", "divided_by", "valid_if"):
                factor = value.get(key)
                name = factor.get("signal") if isinstance(factor, dict) else factor
                if name == f"{message}.{signal}" or (not signal and str(name).startswith(f"{message}.")):
                    return (*path, key, "signal") if isinstance(factor, dict) else (*path, key)
            if "signal" in value:
                return (*path, "signal")
            for key in ("sum", "signals"):
                for n, term in enumerate(value.get(key) or ()):
                    name = term.get("signal") if isinstance(term, dict) else term
                    if name == f"{message}.{signal}" or (not signal and str(name).startswith(f"{message}.")):
                        return (*path, key, n, "signal") if isinstance(term, dict) else (*path, key, n)
        return path

    def _signal(self, name: str) -> Signal | None:
        message, signal = name.split(".")
        known = self._messages.get(message)
        return next((s for s in known.signals if s.name == signal), None) if known else None

    def _resolution(self, terms: Iterable[Term]) -> float:
        """Return the step of a signal that has the rounding errors of all terms together, SI."""
        steps = []
        for term in terms:
            signal = self._signal(f"{term.message}.{term.signal}")
            if signal is not None and not signal.conversion.is_float:
                steps.append(term.factor * signal.scale)
        return math.hypot(*steps)

    def _signs(self, path: KeyPath, section: InputSection, terms: Iterable[Term]) -> Signs:
        """Return whether a speed has a sign: as the key says, else as far as the DBC does."""
        if not isinstance(section, SpeedSection):
            return Signs.SIGNED
        possible = any(can_be_negative(self._signal(f"{term.message}.{term.signal}"), term) for term in terms)
        if section.signed and not possible:
            reason = "the DBC has no negative values for it: a car that rolls backwards is told as going forwards"
            self._warn((*path, "signed"), reason)
        if section.signed is None:
            return Signs.UNTOLD if possible else Signs.UNSIGNED
        return Signs.SIGNED if section.signed else Signs.UNSIGNED

    def _unit_of(self, term: TermSection) -> str:
        """Return the unit of a signal as it is given, else that of the DBC."""
        signal = self._signal(term.signal)
        return term.unit or ((signal.unit or "").strip() if signal else "")

    def _share(self, path: KeyPath, term: TermSection) -> tuple[str, float]:
        """Return the unit of a signal that must be a share, and its factor to a number."""
        unit = self._unit_of(term)
        share = share_of(unit)
        if share is None:
            reason = f"the unit {unit!r} does not fit here: one of both must be a share (%, or 1 for a number)"
            self._complain((*path, "unit"), reason)
        return unit, share or 1.0

    def _unit(self, path: KeyPath, term: TermSection, dimension: Dimension) -> tuple[str, float]:
        """Return the unit of a signal and its factor to SI; 1 where there is none to be found."""
        signal = self._signal(term.signal)
        of_dbc = (signal.unit or "").strip() if signal else ""
        unit = term.unit or of_dbc
        if term.unit and of_dbc and not same_unit(term.unit, of_dbc):
            self._warn((*path, "unit"), f"the DBC has the unit {of_dbc!r}; the one given here is used")
        if dimension is Dimension.AS_IS:
            return unit, 1.0
        if not unit:
            if signal is not None:
                reason = f"the DBC has no unit for {term.signal}: give unit: (to become {dimension.value})"
                self._complain((*path, "unit"), reason)
            return "", 1.0
        try:
            factor = factor_to_si(
                unit, dimension, wheel_radius_m=self._wheel_radius_m, reference_nm=term.reference_nm
            )
        except UnitError as error:
            source = "" if term.unit else f" (the unit of {term.signal} in the DBC; unit: here overrules it)"
            self._complain((*path, "unit"), f"{error}{source}")
            return unit, 1.0
        return unit, factor

    def _not_available(self, path: KeyPath, term: TermSection) -> Iterator[int]:
        signal = self._signal(term.signal)
        for n, key in enumerate(term.not_available or ()):
            if key != VALUE_TABLE:
                yield from self._raw((*path, "not_available", n), term.signal, key)
            elif signal is not None and signal.choices:
                yield from map(int, signal.choices)
            elif signal is not None:
                self._complain((*path, "not_available", n), f"the DBC has no value table for {term.signal}")
        if signal is not None and signal.choices and term.not_available is None:
            for raw, name in signal.choices.items():
                if str(name).casefold().replace("_", " ") in SAYS_NOT_AVAILABLE:
                    reason = (
                        f"the DBC says that raw {raw} of {term.signal} is {str(name)!r}: not_available: [{raw}]?"
                    )
                    self._warn(path, reason)

    def _raw(self, path: KeyPath, name: str, key: int | str) -> list[int]:
        """Return the raw value of a key that may be a name of the DBC's value table."""
        if isinstance(key, int):
            return [key]
        signal = self._signal(name)
        if signal is None:
            return []
        choices = {str(choice): raw for raw, choice in (signal.choices or {}).items()}
        if key in choices:
            return [int(choices[key])]
        has = nearest(key, choices) if choices else f"; the DBC has no value table for {name}"
        self._complain(path, f"{key!r} is not in the value table of {name}{has}")
        return []

    def _complain(self, path: KeyPath, reason: str, suggestions: Iterable[str] = ()) -> None:
        hint = " or ".join(suggestions)
        self._document.problems.append(
            self._document.problem(path, reason + (f"; did you mean {hint}?" if hint else ""))
        )

    def _warn(self, path: KeyPath, reason: str) -> None:
        self._document.problems.append(self._document.problem(path, reason, warning=True))


def _timeout(timeout_ms: InputTimeout) -> tuple[int, bool]:
    """Return a timeout in µs, and whether it is only the longest that can be learned."""
    return (LONGEST_LEARNED_US, True) if isinstance(timeout_ms, str) else (_us(timeout_ms), False)


def _us(milliseconds: float) -> int:
    return round(milliseconds * 1000)
