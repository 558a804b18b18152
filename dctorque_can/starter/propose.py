"""From DBCs and logs to proposals for every key of a vehicle file: the one way through this room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.pipeline.frames import Frames
from dctorque_can.starter.catalogue import Entry, by_message, catalogue
from dctorque_can.starter.chassis import find_acceleration, find_brake, find_direction, find_grade
from dctorque_can.starter.clutches import driving_clutch, find_clutches
from dctorque_can.starter.databases import Dbc, addresses, join, own_channels
from dctorque_can.starter.gears import find_gears
from dctorque_can.starter.material import Material
from dctorque_can.starter.motion import Motion
from dctorque_can.starter.naming import is_odd
from dctorque_can.starter.proposal import Gap, Proposal
from dctorque_can.starter.protection import ProtectionFound, find_protection
from dctorque_can.starter.recording import Recording
from dctorque_can.starter.rotation import find_engine, find_shafts, rad_s
from dctorque_can.starter.starter import Starter
from dctorque_can.starter.torques import Locked, find_engine_torque, find_transmission_torque
from dctorque_can.starter.wheels import find_wheels

_UNITS_OF_WHEELS = ("km/h", "m/s", "rpm", "mph", "rad/s")
_ANY_GEAR = (1.2, 32.0)  # total ratios of any gear of any car
_LOWEST_GEAR, _HIGHEST_GEAR = (8.0, 24.0), (1.5, 6.5)  # total ratios of cars


def propose(dbcs: Sequence[Dbc], frames: Frames | None) -> Starter:
    """Return proposals for a vehicle file.

    Args:
        dbcs: of the car.
        frames: of all logs, one after another (`recording.joined`); None without any.
    """
    own = own_channels(dbcs, frames)
    joined = join(dbcs, own)
    remarks = [*(remark for dbc in dbcs for remark in dbc.remarks), *(str(remark) for remark in joined.remarks)]
    known = addresses(dbcs, frames, own)
    entries = catalogue([dbc.database for dbc in dbcs])
    recording = Recording(joined.database, known.by_name, frames) if frames is not None else None
    remarks += _about_the_log(recording, entries)
    if recording is not None and not recording.messages:
        recording = None
    material = Material(entries, recording)
    wheels, motion = find_wheels(material)
    engine = find_engine(material, motion)
    engine_speed = _live(material, engine)
    locked = (
        Locked.of(engine_speed, motion)
        if engine_speed is not None and motion is not None and motion.drives
        else None
    )
    shafts = find_shafts(material, motion, engine)
    if doubt := _unit_doubt(locked):
        wheels, shafts = [_doubted(each, doubt) for each in wheels], [_doubted(each, doubt) for each in shafts]
        engine = _doubted(engine, doubt)
    torque = find_engine_torque(material, motion, engine_speed)
    two = [
        s
        for each in shafts
        if each.key != "inputs.driving_shaft_speed" and (s := _live(material, each)) is not None
    ]
    gears = find_gears(material, locked, motion, two)
    drives = driving_clutch(two, engine_speed, gears.gear, motion)
    clutches = find_clutches(material, drives, locked, motion)
    taken = {e.name for each in (torque, *clutches.found) if isinstance(each, Proposal) for e in each.entries}
    acceleration = find_acceleration(material, motion)
    found: list[Proposal | Gap] = [
        *(engine, torque, *shafts, *wheels),
        find_direction(material, motion),
        *(
            acceleration,
            find_grade(material, motion, acceleration),
            find_brake(material, motion),
            *clutches.commands,
        ),
        find_transmission_torque(material, motion, engine_speed, taken),
        *gears.found,
        *clutches.found,
    ]
    source = gears.source or ("ratio" if len([e for e in shafts if isinstance(e, Proposal)]) == 2 else "")
    if source == "ratio":
        found = [each for each in found if each.key != "gears.actual"]
    starter = Starter(
        tuple(dbcs), known.j1939, {}, tuple(_once(found)), source, clutches.source, ratios=gears.ratios
    )
    return _completed(starter, material, motion, engine_speed, remarks)


def _unit_doubt(locked: Locked | None) -> str:
    """Return why the units of the speeds cannot be right, by the ratios of engine to wheels; "" where they can."""
    ratios = locked.ratio[locked.where] if locked is not None else np.zeros(0)
    if not len(ratios):
        return ""
    longest, shortest = np.percentile(ratios, [98, 2])
    if longest <= _ANY_GEAR[1] and shortest >= _ANY_GEAR[0]:
        return ""
    return f"engine to wheels would be {longest:.3g} to {shortest:.3g}, as in no car: is a unit wrong?"


def _doubted(each: Proposal | Gap, why: str) -> Proposal | Gap:
    if isinstance(each, Gap):
        return each
    return replace(each, level="likely" if each.level == "sure" else each.level, why=(*each.why, why))


def _live(material: Material, each: Proposal | Gap) -> Any:
    if isinstance(each, Proposal) and material.lives(each.entry) and each.entry.layout.bits > 4:
        return rad_s(material, each.entry)
    return None


def _once(found: Sequence[Proposal | Gap]) -> list[Proposal | Gap]:
    """Return what was found, a signal for one key alone: that with the most merit."""
    best: dict[str, Proposal] = {}
    for each in found:
        if isinstance(each, Proposal) and (
            each.entry.name not in best or best[each.entry.name].merit < each.merit
        ):
            best[each.entry.name] = each
    result: list[Proposal | Gap] = []
    for each in found:
        if isinstance(each, Proposal) and best[each.entry.name] is not each:
            why = f"the best signal for it, {each.entry.name}, is {best[each.entry.name].key} rather"
            result.append(Gap(each.key, why, each.key in ("inputs.engine_speed", "inputs.engine_torque")))
        else:
            result.append(each)
    return result


def _about_the_log(recording: Recording | None, entries: Sequence[Entry]) -> list[str]:
    if recording is None:
        return ["without a log nothing could be held against a drive: hardly anything is sure"]
    if not recording.frames:
        return ["the log holds no frame: it says nothing"]
    if not recording.messages:
        count = len({entry.message.name for entry in entries})
        return [
            f"none of the {recording.frames} frames of the log is one of the {count} messages of the DBCs: "
            "do they fit the car?"
        ]
    return []


def _completed(
    starter: Starter, material: Material, motion: Motion | None, engine_speed: Any, remarks: list[str]
) -> Starter:
    """Return the starter with what goes with the signals: protections, periods, units, values that mean none."""
    recording = material.recording
    grouped = by_message(material.entries)
    used = list({e.name: e for p in starter.proposals for e in p.entries}.values())
    others = [c.entry for p in starter.proposals for c in p.alternatives]  # an answer of the user may take one
    possible = list({e.name: e for e in (*used, *others)}.values())
    messages = list(dict.fromkeys(e.message.name for e in possible))
    protections, unprotected, periods = [], {}, {}
    for name in messages:
        result = find_protection(grouped[name], recording)
        if isinstance(result, ProtectionFound):
            protections.append(result)
        elif result:
            unprotected[name] = result
        period = recording.period(name) if recording is not None else None
        if period is not None:
            periods[name] = period
    if recording is not None and (motion is None or not motion.drives):
        remarks = [*remarks, "the car hardly moves in the log: names could not be held against a drive"]
    channels, told = _channels(starter, recording, used)
    return replace(
        starter,
        protections=tuple(protections),
        unprotected=unprotected,
        periods=periods,
        channels=channels,
        no_value={e.name: values for e in possible if (values := _no_value(e, recording))},
        units={
            e.name: unit
            for p in starter.proposals
            for e in (*p.entries, *(c.entry for c in p.alternatives))
            if (unit := _unit(p, e, material, motion, engine_speed))
        },
        seconds=recording.seconds if recording is not None else 0.0,
        remarks=(*remarks, *told),
    )


def _no_value(entry: Entry, recording: Recording | None) -> tuple[int, ...]:
    seen = recording is not None and recording.has(entry) and recording.has_stray_top(entry)
    return tuple(sorted({*entry.no_value, *((entry.layout.raw_range[1],) if seen else ())}))


def _unit(
    proposal: Proposal, entry: Entry, material: Material, motion: Motion | None, engine_speed: Any
) -> tuple[str, str] | None:
    """Return the unit that fits a signal without one, and why; None where the DBC tells it or none fits."""
    if entry.unit and not is_odd(entry):
        return None
    key = proposal.key
    if key.endswith(("engine_speed", "shaft_speed", "shaft1_speed", "shaft2_speed")):
        return "rpm", "as engine speeds mostly are"
    if key.startswith("inputs.wheel_speeds"):
        return _wheel_unit(entry, material, motion, engine_speed)
    if "torque" in key or key.endswith("_command"):
        low, high = entry.span
        if not entry.unit and high > 200.0:
            return "Nm", f"it reaches from {low:g} to {high:g}: too far for per cent"
        return "%", f"it reaches from {low:g} to {high:g}"
    if key == "inputs.acceleration":
        return "m/s^2", "as most are"
    return None


def _wheel_unit(
    entry: Entry, material: Material, motion: Motion | None, engine_speed: Any
) -> tuple[str, str] | None:
    """Return the unit with which the ratios of engine to wheels are those of a car."""
    if material.recording is None or not material.lives(entry) or motion is None or engine_speed is None:
        return None
    locked = Locked.of(engine_speed, Motion(material.recording.on_grid(entry)))
    ratios = locked.ratio[locked.where]
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios) < 50:
        return None
    longest, shortest = np.percentile(ratios, [98, 2])
    for unit in _UNITS_OF_WHEELS:
        factor = entry.factor(Dimension.WHEEL, unit) or 1.0
        if (
            _LOWEST_GEAR[0] < longest / factor < _LOWEST_GEAR[1]
            and _HIGHEST_GEAR[0] < shortest / factor < _HIGHEST_GEAR[1]
        ):
            return (
                unit,
                f"with it engine to wheels is {longest / factor:.1f} to {shortest / factor:.1f}, as in cars",
            )
    return None


def _channels(
    starter: Starter, recording: Recording | None, used: Sequence[Entry]
) -> tuple[dict[int, int], list[str]]:
    """Return the channel of each DBC where the log has several, and what is doubtful of that."""
    if recording is None or starter.channels:
        return starter.channels, []
    seen = {e.message.name: recording.channels(e.message.name) for e in used if recording.has(e)}
    if len({channel for counts in seen.values() for channel in counts}) < 2:
        return {}, []
    chosen: dict[int, int] = {}
    told = []
    for number in range(len(starter.dbcs)):
        of_dbc = [seen[e.message.name] for e in used if e.database == number and e.message.name in seen]
        total: dict[int, int] = {}
        for counts in of_dbc:
            for channel, count in counts.items():
                total[channel] = total.get(channel, 0) + count
        if not total:
            continue
        best = max(total, key=lambda channel: (sum(channel in counts for counts in of_dbc), total[channel]))
        name = starter.dbcs[number].path.name
        if all(best in counts for counts in of_dbc):
            chosen[number] = best
            others = sorted(set(total) - {best})
            if others:
                also = " and ".join(map(str, others))
                told.append(
                    f"messages of {name} come on channel {also} too: channel {best} is proposed, where most are"
                )
        else:
            told.append(
                f"messages of {name} come on several channels, on none all of them: give channel: to the inputs"
            )
    return chosen, told
