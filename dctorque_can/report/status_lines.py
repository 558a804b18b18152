"""How often each torque was valid and something was wrong, and what contradicted the vehicle file, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dctorque_can.analysis.errors import VALID
from dctorque_can.analysis.status_shares import FAULTS, key_of
from dctorque_can.report.torque_table import TORQUE_NAMES

WORTH_TELLING = 0.01
"""Share of the time from which a fault is told."""


def status_lines(shares: Mapping[str, float], time_shares: Mapping[str, float]) -> list[str]:
    """Return the results of `StatusShares` for people, faults only where they are worth telling.

    Args:
        shares: of the estimates.
        time_shares: of the time.
    """
    keys = {TORQUE_NAMES[name]: key_of(bit) for name, bit in VALID.items()}
    valid = ", ".join(
        f"{name} {100 * shares[key]:.1f} % ({100 * time_shares[key]:.1f} % of the time)"
        for name, key in keys.items()
    )
    faults = {key_of(bit).replace("_", " "): time_shares[key_of(bit)] for bit in FAULTS}
    told = ", ".join(f"{name} {100 * share:.0f} %" for name, share in faults.items() if share > WORTH_TELLING)
    return [f"valid estimates: {valid}", *([f"share of the time with: {told}"] if told else [])]


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the result of `analysis.health.findings` for people, one line each."""
    return [f"vehicle file: {finding['says']}{_standing(finding)}" for finding in findings]


def hint_lines(hints: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the result of `analysis.noise_hints` for people, one line each."""
    return [f"hint: {hint['says']}" for hint in hints]


def transmission_line(figures: Mapping[str, float]) -> str:
    """Return `TransmissionFigures.as_json` as a sentence."""
    return (
        f"driving clutch against the transmission's own torque: RMS {figures['rms_nm']:.1f} N·m, "
        f"bias {figures['bias_nm']:+.1f} N·m, of {figures['told_rms_nm']:.0f} N·m, "
        f"in {100 * figures['share']:.0f} % of the estimates"
    )


def _standing(finding: Mapping[str, Any]) -> str:
    if not finding["stands"]:
        return " [no longer so at the end]"
    return " [no torque is valid]" if finding["torques_not_valid"] else ""
