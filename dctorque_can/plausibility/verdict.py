"""How a verdict is kept: told, strong, over."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.plausibility.findings import Finding

_N = len(Finding)


@compiled_without_allocation
def decide(m: Any, bit: int, measured: float, told: bool, stays: bool, strong: bool) -> None:
    """Let a finding begin, stand or end.

    Args:
        m: `MONITOR`.
        bit: of the `Finding`.
        measured: its number, kept while it stands and afterwards.
        told: whether it begins.
        stays: whether it goes on if it stands already.
        strong: whether torques are not valid while it stands.
    """
    stands = told or (stays and m.findings & bit != 0)
    if stands:
        m.findings |= bit
        m.ever |= bit
        for place in range(_N):
            if bit >> place == 1:
                m.measured[place] = measured
    else:
        m.findings &= ~bit
    if stands and (strong or (stays and m.strong & bit != 0)):
        m.strong |= bit
    else:
        m.strong &= ~bit
