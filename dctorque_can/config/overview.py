"""What a vehicle file amounts to: which inputs the estimator gets from the bus, and what each of them is for."""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf
from typing import Any

from dctorque_can.bus.addresses import read_addresses
from dctorque_can.config.input_builder import InputEntry
from dctorque_can.config.load import Config
from dctorque_can.config.problems import Problem
from dctorque_can.config.signals import LEARNED
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.frames import EVERY_BIT, EXTENDED_ID, SOURCE, group_mask
from dctorque_can.pipeline.samples import SPEEDS, Quantity, Signs

NO_ESTIMATE = "no valid estimate"
BRIDGED = "no valid estimate after half a second"
AXLE = "other wheel of the axle"
PHASE = "validity: clutch counts as closed"
RECORDED = "nothing (recorded only)"
HINT = "a weak measurement of the load"
COMPARISON = "comparison with the transmission's own torque"
RESIDUAL = "residual of the clutch torque"
LOST = {
    "engine_speed": NO_ESTIMATE,
    "engine_torque": NO_ESTIMATE,
    "shaft1_speed": NO_ESTIMATE,
    "shaft2_speed": NO_ESTIMATE,
    "wheel_speed_fl": AXLE,
    "wheel_speed_fr": AXLE,
    "wheel_speed_rl": AXLE,
    "wheel_speed_rr": AXLE,
    "gear1": NO_ESTIMATE,
    "gear2": NO_ESTIMATE,
    "gear": NO_ESTIMATE,
    "target_gear": "knowledge of the gear that is shifted to",
    "shift_in_progress": "knowledge of shifts before the speeds show them",
    "clutch_state": PHASE,
    "clutch1_position": PHASE,
    "clutch2_position": PHASE,
    "clutch1_open": PHASE,
    "clutch2_open": PHASE,
    "clutch1_command": PHASE,
    "clutch2_command": PHASE,
    "direction": "knowledge of the direction, until the drive shows it",
    "transmission_torque": COMPARISON,
    "driving_shaft_speed": "knowledge of the driving shaft, beside engine and wheels",
    "acceleration": RECORDED,
    "grade": RECORDED,
    "brake": "mark of braking between clutches",
}
"""What is lost while an input is stale or missing, by quantity, with the 2014 observer."""

LOST_WITH_KALMAN = {name: BRIDGED for name, lost in LOST.items() if lost == NO_ESTIMATE} | {
    "acceleration": HINT,
    "grade": HINT,
    "brake": "allowance for what the brakes do; acceleration and grade",
}
"""What is another loss with the Kalman filter, whose model stands in for a while."""


def overview(file: str, problems: Sequence[Problem], config: Config | None) -> dict[str, Any]:
    """Return everything for scripts; ``config`` is None when it has errors."""
    errors = [problem.as_json() for problem in problems if problem.severity == "error"]
    warnings = [problem.as_json() for problem in problems if problem.severity == "warning"]
    return {
        "file": file,
        "name": "" if config is None else config.name,
        "method": "" if config is None else method_name(config),
        "ok": not errors,
        "errors": errors,
        "warnings": warnings,
        "inputs": [] if config is None else input_rows(config),
        "of_class": [] if config is None else list(config.of_class),
    }


def method_name(config: Config) -> str:
    """Return the estimator as the vehicle file calls it."""
    return config.settings.method.name.lower()


def input_rows(config: Config) -> list[dict[str, Any]]:
    """Return one row per input that is given, then one per quantity that is not."""
    given = {entry.input.quantity: entry for entry in config.entries}
    rows = [_row(entry, config) for _, entry in sorted(given.items())]
    of_source = {q for q in Quantity if Quantity.CLUTCH1_POSITION <= q <= Quantity.CLUTCH2_COMMAND}
    of_source |= {Quantity.CLUTCH_STATE, Quantity.DRIVING_SHAFT_SPEED}
    one_gear = {Quantity.GEAR, Quantity.TARGET_GEAR, Quantity.SHIFT_IN_PROGRESS}
    of_source |= one_gear if config.settings.one_gear is None else {Quantity.GEAR1, Quantity.GEAR2}
    for quantity in Quantity:
        if quantity not in given and quantity not in of_source:
            rows.append(_missing_row(quantity.name.lower(), config))
    return rows


def _row(entry: InputEntry, config: Config) -> dict[str, Any]:
    protections = {protection.message: protection for protection in config.protections}
    periods = [period for period in entry.periods_ms if period]
    kinds = []
    for message in dict.fromkeys(term.message for term in entry.input.signals):
        protection = protections.get(message)
        kind = "none" if protection is None else protection.crc
        counted = protection is not None and protection.counter_signal
        kinds.append(f"{kind}, counter" if counted else kind)
    name = entry.input.quantity.name.lower()
    return {
        "quantity": name,
        "key": entry.key,
        "present": True,
        "signals": [f"{term.message}.{term.signal}" for term in entry.input.terms],
        "taken_from": _taken_from(entry, config),
        "units": list(entry.units),
        "factors": [term.factor for term in entry.input.terms],
        "offsets": [term.offset for term in entry.input.terms],
        "mapped": [{str(raw): value for raw, value in term.values.items()} for term in entry.input.terms],
        "not_available": [sorted(term.not_available) for term in entry.input.terms],
        "multiplier": _multiplier(entry),
        "valid_if": _validity(entry),
        "minimum": entry.input.minimum,
        "maximum": entry.input.maximum,
        "most_per_s": None if isinf(entry.input.most_per_s) else entry.input.most_per_s,
        "period_ms": max(periods) if periods else None,
        "timeout_ms": LEARNED if entry.input.learns_timeout else entry.input.timeout_us / 1000,
        "delay_ms": entry.input.delay_us / 1000,
        "sign": _sign(entry),
        "protection": kinds,
        "lost": RESIDUAL if entry.key.startswith("inputs.clutch") else _lost(name, config),
    }


def _taken_from(entry: InputEntry, config: Config) -> list[str]:
    """Return by what the messages of an input are known, where it is not their identifier on any channel."""
    found = []
    for _, address in read_addresses(config.database, [entry.input], config.addresses):
        words = []
        if address.mask != EVERY_BIT:
            number = (address.can_id & group_mask(address.can_id) & ~EXTENDED_ID) >> 8
            source = f" from 0x{address.can_id & SOURCE:02X}" if address.mask & SOURCE else ""
            words.append(f"J1939 {number}{source}")
        if address.channel is not None:
            words.append(f"channel {address.channel}")
        if words:
            found.append(", ".join(words))
    return list(dict.fromkeys(found))


def _multiplier(entry: InputEntry) -> dict[str, Any] | None:
    """Return what an input is multiplied with, or divided by."""
    given = entry.input.multiplier
    if given is None:
        return None
    return {
        "signal": f"{given.term.message}.{given.term.signal}",
        "divides": given.divides,
        "unit": entry.multiplier_unit,
        "factor": given.term.factor,
        "offset": given.term.offset,
        "not_available": sorted(given.term.not_available),
        "timeout_ms": given.timeout_us / 1000,
    }


def _validity(entry: InputEntry) -> dict[str, Any] | None:
    """Return what says whether an input is valid."""
    given = entry.input.validity
    if given is None:
        return None
    return {
        "signal": f"{given.term.message}.{given.term.signal}",
        "values": sorted(given.term.values),
        "timeout_ms": given.timeout_us / 1000,
    }


def _sign(entry: InputEntry) -> str:
    """Return whether a speed of wheels or shafts has a sign, in words; "" for any other input."""
    quantity = entry.input.quantity
    if quantity not in (*SPEEDS, Quantity.DRIVING_SHAFT_SPEED) or quantity is Quantity.ENGINE_SPEED:
        return ""
    return {
        Signs.SIGNED: "signed",
        Signs.UNSIGNED: "no sign",
        Signs.UNTOLD: "sign not told: none until a negative value comes",
    }[entry.input.signs]


def _missing_row(name: str, config: Config) -> dict[str, Any]:
    lost = _lost(name, config)
    if name.startswith("gear") and config.settings.gear_inference is not None:
        lost = "nothing: inferred from the ratio of shaft to wheel speed"
    if name in ("shaft1_speed", "shaft2_speed"):  # only the method kalman lets them be missing
        lost = "its slip and torque are known from engine and wheels alone"
    return {"quantity": name, "key": "", "present": False, "signals": [], "lost": lost}


def _lost(name: str, config: Config) -> str:
    with_kalman = LOST_WITH_KALMAN if config.settings.method is Method.KALMAN else {}
    return with_kalman.get(name, LOST[name])
