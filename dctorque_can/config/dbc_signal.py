"""What a DBC says of one signal that an input is made of."""

from __future__ import annotations

from cantools.database.can import Signal

from dctorque_can.pipeline.samples import Term


def can_be_negative(signal: Signal | None, term: Term) -> bool:
    """Return whether a term of a speed can be negative: yes where the DBC is not known."""
    if signal is None or signal.conversion.is_float:
        return signal is None or signal.minimum is None or signal.minimum < 0
    n = signal.length
    ends = (-(2 ** (n - 1)), 2 ** (n - 1) - 1) if signal.is_signed else (0, 2**n - 1)
    return any(term.factor * (signal.scale * raw + signal.offset) + term.offset < 0.0 for raw in ends)
