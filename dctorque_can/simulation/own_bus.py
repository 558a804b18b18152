"""The bus of any car, by the DBC and the inputs of its vehicle file: every mapped signal, encoded back.

What is not mapped is sent as the DBC's start value, or not at all where nothing of a message is mapped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.layout import SignalLayout, selectors
from dctorque_can.driveline.phases import ClutchActuation
from dctorque_can.pipeline.samples import Input, Protection, Quantity, Term
from dctorque_can.simulation.measured import ONE_GEAR, Measured
from dctorque_can.simulation.messages import Floats, Sampled, friction_torque
from dctorque_can.simulation.one_gear import one_gear
from dctorque_can.simulation.sensors import SensorProfile, Sent, Timing

_WHEELS = {
    Quantity.WHEEL_SPEED_FL,
    Quantity.WHEEL_SPEED_FR,
    Quantity.WHEEL_SPEED_RL,
    Quantity.WHEEL_SPEED_RR,
}
_TORQUES = {
    Quantity.ENGINE_TORQUE,
    Quantity.CLUTCH1_COMMAND,
    Quantity.CLUTCH2_COMMAND,
    Quantity.TRANSMISSION_TORQUE,
}
_GEARS = {Quantity.GEAR1, Quantity.GEAR2}
_FLOATS_END = 1e6
_PERIOD_US, _WHEELS_PERIOD_US, _RARE_US = 10_000, 20_000, 1_000_000  # of messages without a cycle time
_STAGGERED_US = 700  # between the first samples of one message and the next
_LATE_US, _JITTER_US = 1_500, 400  # of inputs of which no delay is told, and of every message
_LARGEST_SHARE = 20.0  # what is sent is a share of a torque if it cannot be more


def own_bus(
    inputs: Sequence[Input],
    protections: Sequence[Protection],
    clutches: tuple[ClutchActuation, ClutchActuation],
    mass_kg: float,
    database: Database,
    profile: SensorProfile,
) -> Sent:
    """Return what a car sends whose bus is read by these inputs.

    A message has the cycle time of its DBC. An input with a delay is as old as that in its frame.

    Args:
        inputs: of the vehicle file; their signals are in ``database``.
        protections: of messages.
        clutches: what tells of the clutches.
        mass_kg: of the car.
        database: all DBCs of the vehicle file.
        profile: how the car measures; its ``own_period_us`` is that of all messages, unless it is None.
    """
    by_message: dict[str, list[Input]] = {}
    for given in inputs:
        for term in given.signals:
            mapped = by_message.setdefault(term.message, [])
            if given not in mapped:
                mapped.append(given)
    timing, columns = {}, {}
    for k, (name, mapped) in enumerate(by_message.items()):
        message = database.get_message_by_name(name)
        columns[name] = _Sender(message, mapped, clutches, mass_kg, database).columns
        timing[name] = _timing(message, mapped, k, profile)
    return Sent(timing, columns, {each.message: each for each in protections if each.message in columns})


def _timing(message: Message, mapped: Sequence[Input], k: int, profile: SensorProfile) -> Timing:
    late_us = min(_late_us(given, profile) for given in mapped)
    if profile.own_period_us is not None:
        return Timing(profile.own_period_us, delay_us=late_us)
    quantities = {given.quantity for given in mapped}
    sums = any(term.message == message.name for given in mapped for term in given.terms)
    period_us = _RARE_US if not sums else _WHEELS_PERIOD_US if quantities <= _WHEELS else _PERIOD_US
    if message.cycle_time:
        period_us = 1000 * int(message.cycle_time)
    jitter_us = min(_JITTER_US, period_us - 1)
    return Timing(period_us, k * _STAGGERED_US % period_us, late_us, jitter_us)


def _late_us(given: Input, profile: SensorProfile) -> int:
    """Return how old an input is in its frame."""
    return given.delay_us or (_LATE_US if profile.own_period_us is None else 0)


@dataclass(frozen=True)
class _Sender:
    """One control unit: makes the signals of one message.

    Attributes:
        message: that is sent.
        mapped: inputs that have a signal in it.
        clutches: what tells of the clutches.
        mass_kg: of the car.
        database: with the other messages of these inputs.
    """

    message: Message
    mapped: Sequence[Input]
    clutches: tuple[ClutchActuation, ClutchActuation]
    mass_kg: float
    database: Database

    def columns(self, sampled: Sampled) -> dict[str, Floats]:
        """Return physical values of its signals ``[n]``; one of several inputs has what the first one says."""
        late_us = [_late_us(given, sampled.profile) for given in self.mapped]
        gearbox = one_gear(sampled.truth, sampled.profile.gear_changes) if self._tells_one_gear() else None
        result: dict[str, Floats] = {}
        for given, own_us in zip(self.mapped, late_us, strict=True):
            at = Measured(sampled, self.mass_kg, self.clutches, gearbox).late(own_us - min(late_us))
            for term, values in (*self._signals(given, at), *self._validity(given, len(sampled.at_us))):
                if term.message == self.message.name:
                    result.setdefault(term.signal, values)
        return self._with_selectors(result, len(sampled.at_us))

    def _tells_one_gear(self) -> bool:
        return any(given.quantity in ONE_GEAR or self._shared(given) for given in self.mapped)

    def _signals(self, given: Input, at: Measured) -> list[tuple[Term, Floats]]:
        """Return the physical values of all signals of an input."""
        if given.terms[0].values:
            shared = self._shared(given)
            wanted = at.value(Quantity.GEAR if shared else given.quantity, given.signs, (0.0, 0.0))
            return [(term, self._raw_values(term, shared or term.values, wanted)) for term in given.terms]
        multiplier = self._multiplier(given, at.sampled.profile)
        extent = self._extent(given.terms)
        value = at.value(given.quantity, given.signs, (multiplier * extent[0], multiplier * extent[1]))
        friction = friction_torque(at.sampled) if given.quantity is Quantity.ENGINE_TORQUE else 0.0 * value
        signals = _summands(given.terms, value / multiplier, friction / multiplier)
        if given.multiplier is not None:
            term = given.multiplier.term
            factor = 1.0 / multiplier if given.multiplier.divides else multiplier
            signals.append((term, np.full(len(value), (factor - term.offset) / term.factor)))
        return signals

    def _validity(self, given: Input, n: int) -> list[tuple[Term, Floats]]:
        """Return what says that an input is valid: it always is."""
        if given.validity is None:
            return []
        term = given.validity.term
        return [(term, self._raw_values(term, term.values, np.ones(n)))]

    def _multiplier(self, given: Input, profile: SensorProfile) -> float:
        """Return what the sum of an input is multiplied with: a torque, if only a share of one can be sent."""
        if given.multiplier is None or given.multiplier.divides or given.quantity not in _TORQUES:
            return 1.0
        is_share = max(map(abs, self._extent(given.terms))) <= _LARGEST_SHARE
        return profile.reference_torque_nm if is_share else 1.0

    def _extent(self, terms: Sequence[Term]) -> tuple[float, float]:
        """Return the smallest and the largest sum that can be sent, SI."""
        low = high = 0.0
        for term in terms:
            ends = [term.factor * each + term.offset for each in _limits(self._signal(term))]
            low, high = low + min(ends), high + max(ends)
        return low, high

    def _signal(self, term: Term) -> Signal:
        return self.database.get_message_by_name(term.message).get_signal_by_name(term.signal)

    def _shared(self, given: Input) -> dict[int, float]:
        """Return what the raw values of a signal mean that both shafts' gears are read from; else nothing."""
        if given.quantity not in _GEARS:
            return {}
        both = [
            term.values
            for each in self.mapped
            if each.quantity in _GEARS
            for term in each.terms
            if (term.message, term.signal) == (given.terms[0].message, given.terms[0].signal)
        ]
        if len(both) < 2:
            return {}
        raws = sorted(set(both[0]) | set(both[1]))
        return {raw: both[0].get(raw, 0.0) or both[1].get(raw, 0.0) for raw in raws}

    def _raw_values(self, term: Term, meaning: Mapping[int, float], wanted: Floats) -> Floats:
        """Return physical values of raw ones that mean what is wanted, or nothing where none does."""
        layout = SignalLayout.of(self._signal(term))
        first, last = layout.raw_range
        unused = next((raw for raw in range(last, max(first, last - 300) - 1, -1) if raw not in meaning), last)
        raws = np.full(len(wanted), float(unused))
        for raw, means in reversed(list(meaning.items())):  # of several the first
            raws[wanted == means] = raw
        return raws * layout.scale + layout.offset

    def _with_selectors(self, columns: dict[str, Floats], n: int) -> dict[str, Floats]:
        """Add the multiplexers: one frame after the other selects what is mapped, in turn."""
        turns: list[dict[str, float]] = []
        for name in columns:
            chosen = {
                selector.name: SignalLayout.of(selector).scale * ids[0] + SignalLayout.of(selector).offset
                for selector, ids in selectors(self.message, self.message.get_signal_by_name(name))
            }
            if chosen and chosen not in turns:
                turns.append(chosen)
        for name in {name for turn in turns for name in turn}:
            values = np.array([turn.get(name, 0.0) for turn in turns])
            columns[name] = values[np.arange(n) % len(turns)]
        return columns


def _summands(terms: Sequence[Term], value: Floats, friction: Floats) -> list[tuple[Term, Floats]]:
    """Return physical values of the signals whose sum is ``value``: what is taken off is the engine's friction."""
    added = [term for term in terms if term.factor > 0.0] or list(terms)
    taken = [term for term in terms if term not in added]
    result = [(term, (-friction / len(taken) - term.offset) / term.factor) for term in taken]
    rest = value + friction if taken else value
    offset, factor = sum(term.offset for term in added), sum(term.factor for term in added)
    return result + [(term, (rest - offset) / factor) for term in added]


def _limits(signal: Signal) -> tuple[float, float]:
    """Return the smallest and the largest physical value of a signal."""
    if signal.minimum is not None and signal.maximum is not None and signal.minimum < signal.maximum:
        return float(signal.minimum), float(signal.maximum)
    layout = SignalLayout.of(signal)
    if layout.is_float:
        return -_FLOATS_END, _FLOATS_END
    ends = sorted(layout.scale * raw + layout.offset for raw in layout.raw_range)
    return ends[0], ends[1]
