"""How a vehicle file describes the signals that an input is made of."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.config.vehicle import gear_number

LEARNED = "learned"  # of a timeout: from how often the input comes
LONGEST_MS = 60_000
_SIGNAL = re.compile(r"^[A-Za-z_]\w*\.[A-Za-z_]\w*$")


def _signal_name(text: str) -> str:
    if not _SIGNAL.match(text):
        raise ValueError("must be Message.Signal, by the names of the DBC")
    return text


def _raw_key(key: Any) -> Any:
    if isinstance(key, bool) or not isinstance(key, int | str):
        raise ValueError("must be a raw value (whole number) or a name of the DBC's value table")
    return key


def _timeout(value: Any) -> Any:
    is_time = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= LONGEST_MS
    if not is_time and value != LEARNED:
        raise ValueError(f"must be greater than 0 and at most {LONGEST_MS}, or the word {LEARNED}")
    return value


def _gear(value: Any) -> Any:
    return 0 if value in (0, "neutral", "N") else gear_number(value)


def _yes_or_no(value: Any) -> Any:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value


def _listed(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


ChannelNumber = Annotated[int, Field(ge=0, le=255)]
SignalName = Annotated[str, AfterValidator(_signal_name)]
RawKey = Annotated[int | str, BeforeValidator(_raw_key)]
NotAvailable = Annotated[list[RawKey], BeforeValidator(_listed)]
VALUE_TABLE = "value_table"  # among what is not available: all that the value table of the DBC names
TimeoutMs = Annotated[float, Field(gt=0, le=LONGEST_MS)]
InputTimeout = Annotated[float | Literal["learned"], BeforeValidator(_timeout)]
DelayMs = Annotated[float, Field(ge=0, le=200)]
DEFAULT_TIMEOUT_MS = 100.0


class TermSection(Section):
    """One DBC signal of a sum."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    factor: float = 1.0
    """Coefficient of the signal in the sum: -1 subtracts it."""
    offset: float = 0.0
    """Added after ``factor``, in the unit of the signal."""
    unit: str | None = None
    """Unit of the signal; default: the unit of the DBC."""
    reference_nm: Annotated[float, Field(gt=0)] | None = None
    """Torque that is 100 %, N·m, for a torque in %."""
    not_available: NotAvailable | None = None
    """Raw values, or names of the DBC's value table, that mean "no value"; value_table: all that it names."""

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        return {"signal": value} if isinstance(value, str) else value


class MultiplierSection(Section):
    """One DBC signal that an input is multiplied with, or divided by."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    factor: float = 1.0
    """Multiplies the signal."""
    offset: float = 0.0
    """Added after ``factor``, in the unit of the signal."""
    unit: str | None = None
    """Unit of the signal, % or 1 for a share; default: the unit of the DBC."""
    not_available: NotAvailable | None = None
    """Raw values, or names of the DBC's value table, that mean "no value"; value_table: all that it names."""
    timeout_ms: TimeoutMs = 5000.0
    """Age up to which its latest value counts, ms."""

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        return {"signal": value} if isinstance(value, str) else value

    def term(self) -> TermSection:
        """Return what it has in common with a signal of a sum."""
        common = {name: getattr(self, name) for name in ("signal", "factor", "offset", "unit", "not_available")}
        return TermSection(**common)


class ValiditySection(Section):
    """One DBC signal that says whether an input is valid."""

    signal: SignalName
    """Message.Signal, by the names of the DBC; the section may be just this text."""
    values: Annotated[list[RawKey], Field(min_length=1)] = [1]  # noqa: RUF012
    """Raw values, or names of the DBC's value table, that mean valid; all others do not."""
    timeout_ms: TimeoutMs = 5000.0
    """Age up to which its latest value counts, ms."""

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        return {"signal": value} if isinstance(value, str) else value


class ConditionalSection(Section):
    """What an input of any form may have."""

    valid_if: ValiditySection | None = None
    """Signal that says whether the value is valid, in the same message or another one."""


class InputSection(ConditionalSection):
    """One input: a signal, or a sum of signals; times another one, or divided by it."""

    signal: SignalName | None = None
    """Message.Signal, by the names of the DBC; the section may be just this text."""
    sum: Annotated[list[TermSection], Field(min_length=1)] | None = None
    """Instead of ``signal``: the signals to be added, each with its own factor."""
    times: MultiplierSection | None = None
    """Signal that the value is multiplied with: one of both has the unit, the other one is a share."""
    divided_by: MultiplierSection | None = None
    """Signal that the value is divided by: a share."""
    factor: float = 1.0
    """Multiplies the signal; -1 turns its sign."""
    offset: float = 0.0
    """Added after ``factor``, in the unit of the signal."""
    unit: str | None = None
    """Unit of the signal (of all signals of a sum); default: the unit of the DBC."""
    reference_nm: Annotated[float, Field(gt=0)] | None = None
    """Torque that is 100 %, N·m, for a torque in %."""
    not_available: NotAvailable | None = None
    """Raw values, or names of the value table, that mean "no value", for every signal of a sum; or value_table."""
    range: Annotated[list[float], Field(min_length=2, max_length=2)] | None = None
    """[lowest, highest] plausible value in the input's unit; default: the plausible range of the quantity."""
    max_rate: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    """Largest plausible change in the input's unit per second; default: any."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the input is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""

    @model_validator(mode="before")
    @classmethod
    def _shorthand(cls, value: Any) -> Any:
        return {"signal": value} if isinstance(value, str) else value

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.signal is None and self.sum is None:
            yield ("signal",), "missing: give signal: Message.Signal, or sum: [ … ]"
        if self.signal is not None and self.sum is not None:
            yield ("sum",), "give either signal or sum, not both"
        if self.sum is not None:
            for name, neutral in (("factor", 1.0), ("offset", 0.0)):
                if getattr(self, name) != neutral:
                    yield (name,), f"belongs to the signals of the sum: put {name} into each of them"
        if self.range is not None and self.range[0] >= self.range[1]:
            yield ("range",), "must be [lowest, highest]"
        if self.times is not None and self.divided_by is not None:
            yield ("divided_by",), "give either times or divided_by, not both"

    @property
    def multiplier(self) -> tuple[str, MultiplierSection] | None:
        """The signal of ``times`` or ``divided_by``, with that key."""
        if self.times is not None:
            return "times", self.times
        return None if self.divided_by is None else ("divided_by", self.divided_by)

    @property
    def has_signals(self) -> bool:
        """Whether it is clear which signals are meant."""
        return (self.signal is None) != (self.sum is None)

    def terms(self) -> list[tuple[KeyPath, TermSection]]:
        """Return the signals with their key path below this section, with shared keys filled in."""
        if self.sum is None:
            assert self.signal is not None
            terms: list[tuple[KeyPath, TermSection]] = [
                ((), TermSection(signal=self.signal, factor=self.factor, offset=self.offset))
            ]
        else:
            terms = [(("sum", n), term) for n, term in enumerate(self.sum)]
        shared = {"unit": self.unit, "reference_nm": self.reference_nm, "not_available": self.not_available}
        return [
            (path, term.model_copy(update={k: v for k, v in shared.items() if getattr(term, k) is None}))
            for path, term in terms
        ]


class SpeedSection(InputSection):
    """The speed of a wheel or a shaft."""

    signed: bool | None = None
    """Whether it is negative when the car rolls backwards; default: no, until a negative value comes."""


class GearSignalSection(ConditionalSection):
    """The signal with the gear that is engaged on one shaft."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    values: Annotated[
        dict[RawKey, Annotated[int | Literal["neutral", "reverse", "R", "N"], BeforeValidator(_gear)]],
        Field(min_length=1),
    ]
    """Raw value, or name of the DBC's value table, to gear: a number, neutral or reverse; others: no value."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the gear is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""


class ShiftFlagSection(ConditionalSection):
    """A flag that says whether a shift is in progress."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    values: Annotated[
        dict[RawKey, Annotated[Literal["yes", "no"], BeforeValidator(_yes_or_no)]], Field(min_length=1)
    ]
    """Raw value, or name of the DBC's value table, to yes or no; others: no value."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the flag is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""


class ClutchStateSection(ConditionalSection):
    """One state for both clutches together."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    values: Annotated[dict[RawKey, Literal["open", "slipping", "closed"]], Field(min_length=1)]
    """Raw value, or name of the DBC's value table, to open, slipping or closed; others: no value."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the state is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""


class DirectionSection(ConditionalSection):
    """Which way the car goes, as its brakes or its gearbox tell it."""

    signal: SignalName | None = None
    """Message.Signal, by the names of the DBC."""
    signals: Annotated[list[SignalName], Field(min_length=1)] | None = None
    """Instead of ``signal``: one of each wheel; more than half of them must agree."""
    values: Annotated[dict[RawKey, Literal["forward", "backward", "standstill", "unknown"]], Field(min_length=1)]
    """Raw value, or name of the value table, to forward, backward, standstill or unknown; others: no value."""
    measured: bool = False
    """Whether wheels measure it; else it may come from the lever, until it tells a car that rolls against it."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the direction is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.signal is None and self.signals is None:
            yield ("signal",), "missing: give signal: Message.Signal, or signals: [ … ] with one of each wheel"
        if self.signal is not None and self.signals is not None:
            yield ("signals",), "give either signal or signals, not both"
        for way in ("forward", "backward"):
            if way not in self.values.values():
                yield ("values",), f"no raw value means {way}: a signal that cannot say so tells no direction"

    @property
    def names(self) -> list[str]:
        """The signals, one or several."""
        return [*([] if self.signal is None else [self.signal]), *(self.signals or ())]


class FlagSection(ConditionalSection):
    """A flag that says whether one clutch is open."""

    signal: SignalName
    """Message.Signal, by the names of the DBC."""
    values: Annotated[dict[RawKey, Literal["open", "closed"]], Field(min_length=1)]
    """Raw value, or name of the DBC's value table, to open or closed; others: no value."""
    timeout_ms: InputTimeout = DEFAULT_TIMEOUT_MS
    """Age at which the flag is stale, ms, or learned."""
    delay_ms: DelayMs = 0.0
    """Known time from the sample to its frame (filter, computing, gateway), ms."""
    channel: ChannelNumber | None = None
    """Channel of the signal's message, of a log or a live bus, from 0; default: that of its database."""


class PositionSection(InputSection):
    """The actuator position of one clutch."""

    kissing_point: float
    """Position at which the clutch begins to carry torque, in the unit of the position."""
    hysteresis: Annotated[float, Field(ge=0)]
    """Full width of the band around the kissing point, in the unit of the position."""
    kissing_point_error: Annotated[float, Field(ge=0)] | None = None
    """How much earlier the clutch may touch, in the unit of the position; by default a fifth of that point."""
    closes: Literal["increasing", "decreasing"]
    """Whether the clutch closes with increasing or decreasing position."""


class CommandSection(InputSection):
    """The commanded torque of one clutch."""

    threshold_nm: Annotated[float, Field(ge=0)]
    """Commanded torque above which the clutch carries torque, N·m."""
    hysteresis_nm: Annotated[float, Field(ge=0)]
    """Full width of the band around the threshold, N·m."""
