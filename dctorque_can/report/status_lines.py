"""How often each torque was valid and something was wrong, and what contradicted the vehicle file, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dctorque_can.analysis.errors import VALID
from dctorque_can.analysis.status_shares import FAULTS, key_of
from dctorque_can.report.torque_table import TORQUE_NAMES

WORTH_TELLING = 0.01
"""Share of the estimates from which a fault is told."""


def status_lines(shares: Mapping[str, float]) -> list[str]:
    """Return the result of `StatusShares.as_json` for people, faults only where they are worth telling."""
    valid = ", ".join(f"{TORQUE_NAMES[name]} {100 * shares[key_of(bit)]:.1f} %" for name, bit in VALID.items())
    faults = {key_of(bit).replace("_", " "): shares[key_of(bit)] for bit in FAULTS}
    told = ", ".join(f"{name} {100 * share:.0f} %" for name, share in faults.items() if share > WORTH_TELLING)
    return [f"valid estimates: {valid}", *([f"share of estimates with: {told}"] if told else [])]


def finding_lines(findings: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the result of `analysis.health.findings` for people, one line each."""
    return [f"vehicle file: {finding['says']}{_standing(finding)}" for finding in findings]


def _standing(finding: Mapping[str, Any]) -> str:
    if not finding["stands"]:
        return " [no longer so at the end]"
    return " [no torque is valid]" if finding["torques_not_valid"] else ""
