"""What a run or a replay amounted to: what its health record counts, and whether its estimates can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.consistency import nis
from dctorque_can.analysis.noise_hints import noise_hints
from dctorque_can.analysis.speed_hints import speed_hints
from dctorque_can.pipeline.samples import Input, Quantity
from dctorque_can.plausibility.findings import key_of, sentences

COUNTERS = ("gap_resets", "clock_resets", "numeric_resets", "late_frames")
FAULTS = (
    "not_available",
    "out_of_range",
    "bad_length",
    "bad_crc",
    "bad_counter",
    "not_believed",
    "bad_rate",
    "timeouts",
)
"""Why samples were not used, as fields of `HEALTH`, and how often inputs went stale."""
_NAMES = [(int(quantity), quantity.name.lower()) for quantity in Quantity]
_LEARNED = ("gain_error", "gain_sigma", "lag_error_s", "lag_sigma_s")
_OF_SPEEDS = (
    "wheel_scale_error",
    "wheel_scale_sigma",
    "wheels_late_s",
    "wheels_late_sigma_s",
)


def health_counts(health: NDArray[np.void]) -> dict[str, Any]:
    """Return what a `HEALTH` record ``[1]`` has counted, and what was learned and found."""
    record = health[0]
    counts: dict[str, Any] = {name: int(record[name]) for name in COUNTERS}
    counts |= {fault: by_quantity(health, fault) for fault in FAULTS}
    sensors = nis(health)
    counts["nis"] = {name: sensor.mean for name, sensor in sensors.items()}
    counts["rejected"] = {name: sensor.rejected for name, sensor in sensors.items() if sensor.rejected}
    learned = {name: float(record[f"engine_torque_{name}"]) for name in _LEARNED}
    counts["accepted"] = by_quantity(health, "accepted")
    counts["engine_torque"] = learned if sensors else {}
    counts["speeds"] = {name: float(record[name]) for name in _OF_SPEEDS} if sensors else {}
    counts["findings"] = findings(health)
    counts["hints"] = [*noise_hints(health), *speed_hints(health)]
    return counts


def by_quantity(health: NDArray[np.void], name: str) -> dict[str, int]:
    """Return a field of a `HEALTH` record ``[1]`` that counts for each quantity, without zeros."""
    values = health[name][0].tolist()
    return {quantity: values[q] for q, quantity in _NAMES if values[q]}


def findings(health: NDArray[np.void]) -> list[dict[str, Any]]:
    """Return what contradicted the vehicle file at any time up to a `HEALTH` record ``[1]``.

    Each has its name, the ``key`` of the vehicle file to look at first, whether it ``stands`` at the end, whether
    no torque is valid while it does so, the number that was ``measured`` last, and what it ``says`` in a sentence.
    """
    record = health[0]
    gear = int(record["finding_gear"])
    told = sentences(int(record["findings_ever"]), record["finding_measured"], gear)
    return [
        {
            "finding": str(finding.name).lower(),
            "key": key_of(finding, gear),
            "stands": bool(record["findings"] & finding),
            "torques_not_valid": bool(record["findings_strong"] & finding),
            "measured": measured,
            "says": sentence,
        }
        for finding, measured, sentence in told
    ]


def never_received(inputs: Sequence[Input], health: NDArray[np.void]) -> list[str]:
    """Return the mapped quantities of which a `HEALTH` record ``[1]`` counts no usable value, in lower case."""
    accepted = health[0]["accepted"]
    return [entry.quantity.name.lower() for entry in inputs if not accepted[entry.quantity]]


def doubts(missing: Sequence[str], estimates: int, valid: int) -> list[str]:
    """Return warnings, one line each, for the result of `never_received` and how many estimates are valid."""
    lines = []
    if missing:
        lines.append(f"never received a usable value of: {', '.join(missing)} (see `dctorque check`)")
    if estimates and not valid:
        lines.append(f"none of the {estimates} estimates has valid clutch torques")
    return lines
