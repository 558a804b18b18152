"""From the sections of a vehicle file to the settings of the estimator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from cantools.database.can import Database

from dctorque_can.config.cycle_times import note_missing_cycle_times
from dctorque_can.config.document import Document
from dctorque_can.config.estimation import (
    GEAR_SOURCES,
    PHASE_SOURCES,
    EstimatorSection,
    GearsFromGearbox,
    GearsFromRatio,
    GearsFromSignals,
    PhaseFromCommand,
    PhaseFromFlag,
    PhaseFromNothing,
    PhaseFromPosition,
    PhaseFromState,
    PhaseSection,
    RatioSection,
    microseconds,
)
from dctorque_can.config.input_builder import InputBuilder, InputEntry
from dctorque_can.config.input_doubts import (
    check_missing_shafts,
    check_phases,
    note_costly_delays,
    note_idle_direction,
    note_missing_axle,
    note_untold_signs,
)
from dctorque_can.config.inputs import QUANTITY_AT, InputsSection
from dctorque_can.config.magnitudes import note_magnitudes
from dctorque_can.config.plausibility import gear_doubts, gear_map_doubts, inference_doubts
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.protection import ProtectionSection
from dctorque_can.config.section import S, absent, nearest, sound_parts, validate
from dctorque_can.config.signals import (
    LEARNED,
    ClutchStateSection,
    CommandSection,
    DirectionSection,
    FlagSection,
    GearSignalSection,
    InputSection,
    PositionSection,
    ShiftFlagSection,
)
from dctorque_can.config.vehicle import GearSection, VehicleSection, build_gear, gear_number
from dctorque_can.driveline.parameters import Gear
from dctorque_can.driveline.phases import ClutchActuation, PhaseSettings, PhaseSource
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.frames import Address
from dctorque_can.pipeline.samples import SPEEDS, Protection, Quantity
from dctorque_can.pipeline.settings import GearInference, OneGear, Settings

_SHAFT_SPEEDS = {Quantity.SHAFT1_SPEED, Quantity.SHAFT2_SPEED, Quantity.DRIVING_SHAFT_SPEED}
_DIRECTIONS = {"forward": 1.0, "backward": -1.0, "standstill": 0.0, "unknown": 0.0}
CLUTCH_STATES = ("open", "slipping", "closed")
"""Of both clutches together, by the value of `Quantity.CLUTCH_STATE`."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What `build_parts` gives."""

    settings: Settings
    protections: tuple[Protection, ...]
    entries: tuple[InputEntry, ...]
    reorder_us: int | None


def build_parts(document: Document, database: Database | None, addresses: Mapping[str, Address]) -> Parts | None:
    """Build settings, inputs and protections; every error goes to ``document.problems``.

    Whatever is sound is checked further although something else has errors, so that one run shows all of them.

    Returns:
        None when there was an error.
    """
    vehicle = _section(document, ("vehicle",), VehicleSection)
    gears, complete = _gears(document)
    radius = document.value(("vehicle", "chassis", "wheel_radius_m"))
    sound_radius = (
        radius if isinstance(radius, int | float) and not isinstance(radius, bool) and radius > 0 else 1.0
    )
    builder = InputBuilder(document, database, addresses, sound_radius)
    _inputs(document, builder)
    gear_source = _gear_source(document, builder, gears, complete)
    phases = _clutch_phase(document, builder, isinstance(gear_source, OneGear))
    estimator = validate(document, ("estimator",), EstimatorSection)
    builder.check_together()
    protections = _protections(document, builder)
    note_magnitudes(document)
    note_missing_axle(document, builder, vehicle)
    note_untold_signs(document, builder)
    note_idle_direction(document, builder)
    if database is not None:
        note_missing_cycle_times(document, builder.entries)
    if estimator is not None:
        check_missing_shafts(document, estimator, isinstance(gear_source, GearInference))
        check_phases(document, estimator, phases)
        note_costly_delays(document, builder, estimator)
    errors = any(problem.severity == "error" for problem in document.problems)
    if errors or vehicle is None or estimator is None or phases is None:
        return None
    settings = Settings(
        vehicle=vehicle.build(),
        inputs=tuple(entry.input for entry in builder.entries),
        phases=phases,
        gear_inference=gear_source if isinstance(gear_source, GearInference) else None,
        one_gear=gear_source if isinstance(gear_source, OneGear) else None,
        method=Method[estimator.method.upper()],
        observer=estimator.oh2014.build(),
        kalman=_kalman_design(estimator, builder.entries),
        driven_axle=vehicle.axle,
        step_us=microseconds(estimator.step_ms),
        estimate_period_us=microseconds(estimator.period_ms),
        health_period_us=microseconds(estimator.health_period_ms),
        max_gap_us=microseconds(estimator.max_gap_ms),
        max_step_back_us=microseconds(estimator.max_step_back_ms),
        direction_measured=document.value(("inputs", "direction", "measured")) is True,
    )
    reorder_us = None if estimator.reorder_ms is None else microseconds(estimator.reorder_ms)
    return Parts(settings, protections, tuple(builder.entries), reorder_us)


def _kalman_design(estimator: EstimatorSection, entries: Iterable[InputEntry]) -> KalmanDesign:
    """Return the design of the Kalman filter; without the speed of a shaft nothing says that wheels are off."""
    design = estimator.kalman.build(_speed_resolutions(entries))
    if {entry.input.quantity for entry in entries} & _SHAFT_SPEEDS:
        return design
    return replace(design, wheel_scale_error_share=0.0, ratio_error_share=0.0, delay_error_s=0.0)


def _speed_resolutions(entries: Iterable[InputEntry]) -> tuple[float, ...]:
    """Return the resolution of each speed of `SPEEDS` on the bus, rad/s; 0 of one that is not there."""
    known = {entry.input.quantity: entry.resolution for entry in entries}
    one = known.get(Quantity.DRIVING_SHAFT_SPEED, 0.0)
    known = {Quantity.SHAFT1_SPEED: one, Quantity.SHAFT2_SPEED: one} | known
    return tuple(known.get(quantity, 0.0) for quantity in SPEEDS)


def _section(document: Document, path: KeyPath, model: type[S]) -> S | None:
    """Validate a required section; a missing one is reported elsewhere, in one line."""
    return None if absent(document.value(path)) else validate(document, path, model)


def _gears(document: Document) -> tuple[dict[int, Gear], bool]:
    """Return the sound gears and whether these are all, and report what is implausible about them."""
    places: dict[KeyPath, Gear] = {}
    for path, part in sound_parts(VehicleSection, document.value(("vehicle",)), ("vehicle",)):
        if isinstance(part, GearSection):
            try:
                places[path] = build_gear(gear_number(path[-1]), part)
            except ValueError:
                continue  # a gear of no valid number has been reported by the vehicle's own validation
    gears: dict[int, Gear] = {}
    for path, gear in places.items():
        if gear.number in gears:
            document.problems.append(document.problem(path, "reverse is given twice"))
        gears[gear.number] = gear
    complete = bool(gears) and len(gears) == len(document.value(("vehicle", "gears")) or ())
    if gears:
        for doubt in gear_doubts(places, complete):
            document.problems.append(document.problem(doubt.path, doubt.reason, warning=doubt.warning))
    return gears, complete


def _inputs(document: Document, builder: InputBuilder) -> None:
    path: KeyPath = ("inputs",)
    _section(document, path, InputsSection)
    for at, part in sound_parts(InputsSection, document.value(path), path, repair=True):
        quantity = QUANTITY_AT.get(at[1:])
        if quantity is not None and isinstance(part, InputSection) and part.has_signals:
            builder.add(at, quantity, part)
        elif isinstance(part, DirectionSection) and (part.signal is None) != (part.signals is None):
            ways = {raw: _DIRECTIONS[way] for raw, way in part.values.items()}
            builder.add_mapped(at, Quantity.DIRECTION, part, ways)


def _gear_source(
    document: Document, builder: InputBuilder, gears: dict[int, Gear], complete: bool
) -> GearInference | OneGear | None:
    path: KeyPath = ("gears",)
    model = _model_of_source(document, path, GEAR_SOURCES)
    if model is None:
        return None
    section = validate(document, path, model)
    if isinstance(section, GearsFromRatio | GearsFromGearbox):
        for doubt in inference_doubts(section, gears):
            document.problems.append(document.problem(doubt.path, doubt.reason, warning=doubt.warning))
    if isinstance(section, GearsFromRatio):
        return section.build()
    for at, part in sound_parts(model, document.value(path), path, repair=True):
        if isinstance(part, GearSignalSection):
            shaft = {"shaft1": 1, "shaft2": 2}.get(str(at[-1]))
            _map_gears(builder, at, _GEAR_QUANTITIES[str(at[-1])], part)
            for doubt in gear_map_doubts(at, shaft, part, gears, complete):
                document.problems.append(document.problem(doubt.path, doubt.reason, warning=doubt.warning))
        elif isinstance(part, ShiftFlagSection):
            flags = {raw: float(shifts == "yes") for raw, shifts in part.values.items()}
            builder.add_mapped(at, Quantity.SHIFT_IN_PROGRESS, part, flags)
    if isinstance(section, GearsFromGearbox):
        return OneGear(section.build())
    if isinstance(section, GearsFromSignals) and section.shaft1.signal == section.shaft2.signal:
        _map_gears(builder, (*path, "shaft1"), Quantity.GEAR, _shared_signal(section))
        return OneGear(RatioSection().build())
    return None


_KISSING_POINT_SHARE = 0.2
"""Of a kissing point, by which wear and heat may move it."""

_GEAR_QUANTITIES = {
    "shaft1": Quantity.GEAR1,
    "shaft2": Quantity.GEAR2,
    "actual": Quantity.GEAR,
    "target": Quantity.TARGET_GEAR,
}


def _map_gears(builder: InputBuilder, path: KeyPath, quantity: Quantity, section: GearSignalSection) -> None:
    builder.add_mapped(path, quantity, section, {raw: float(gear) for raw, gear in section.values.items()})


def _shared_signal(section: GearsFromSignals) -> GearSignalSection:
    """Return the gear that one signal of both shafts means: of the two maps the one that is not neutral."""
    one, two = section.shaft1, section.shaft2
    both = [*one.values.items(), *two.values.items()]
    values = dict(sorted(both, key=lambda item: item[1] != 0))  # what comes later counts
    given = [each.timeout_ms for each in (one, two) if each.timeout_ms != LEARNED]
    timeout_ms, delay_ms = min(given, default=LEARNED), min(one.delay_ms, two.delay_ms)
    return one.model_copy(update={"values": values, "timeout_ms": timeout_ms, "delay_ms": delay_ms})


def _clutch_phase(document: Document, builder: InputBuilder, one_gear: bool) -> PhaseSettings | None:
    path: KeyPath = ("clutch_phase",)
    model = _model_of_source(document, path, PHASE_SOURCES)
    if model is None:
        return None
    section = validate(document, path, model)
    if one_gear and isinstance(section, PhaseFromFlag) and section.clutch1 == section.clutch2:
        reason = f"{section.clutch1.signal} is one state of both clutches, and is taken so; better: source: state"
        document.problems.append(document.problem((*path, "source"), reason, warning=True))
        _map_state(builder, (*path, "clutch1"), section.clutch1)
        clutch = ClutchActuation(PhaseSource.STATE, 0.0, 0.0)
        return _phase_settings(section, (clutch, clutch))
    for at, part in sound_parts(model, document.value(path), path, repair=True):
        if isinstance(part, ClutchStateSection):
            _map_state(builder, at, part)
        elif at != path:
            index = 0 if at[-1] == "clutch1" else 1
            given = {entry.input.quantity for entry in builder.entries}
            if isinstance(part, CommandSection) and Quantity.CLUTCH1_COMMAND + index in given:
                reason = f"is the input {at[-1]}_command too: leave one of them out"
                document.problems.append(document.problem(at, reason))
            else:
                _clutch_input(builder, at, index, part)
    if section is None:
        return None
    assert isinstance(section, PhaseSection)
    return _phase_settings(section, _actuations(section))


def _map_state(builder: InputBuilder, path: KeyPath, section: ClutchStateSection | FlagSection) -> None:
    states = {raw: float(CLUTCH_STATES.index(state)) for raw, state in section.values.items()}
    builder.add_mapped(path, Quantity.CLUTCH_STATE, section, states)


def _phase_settings(section: PhaseSection, clutches: tuple[ClutchActuation, ClutchActuation]) -> PhaseSettings:
    return PhaseSettings(
        clutches=clutches,
        slip_locked_rad_s=section.slip_locked_rad_s,
        slip_released_rad_s=section.slip_released_rad_s,
        lock_time_us=microseconds(section.lock_time_ms),
    )


def _clutch_input(builder: InputBuilder, path: KeyPath, index: int, section: object) -> None:
    if isinstance(section, InputSection) and not section.has_signals:
        return
    if isinstance(section, PositionSection):
        builder.add(path, Quantity(Quantity.CLUTCH1_POSITION + index), section)
    elif isinstance(section, CommandSection):
        builder.add(path, Quantity(Quantity.CLUTCH1_COMMAND + index), section)
    elif isinstance(section, FlagSection):
        values = {raw: float(state == "open") for raw, state in section.values.items()}
        builder.add_mapped(path, Quantity(Quantity.CLUTCH1_OPEN + index), section, values)


def _actuations(section: PhaseSection) -> tuple[ClutchActuation, ClutchActuation]:
    match section:
        case PhaseFromPosition() | PhaseFromFlag() | PhaseFromCommand():
            return _actuation(section.clutch1), _actuation(section.clutch2)
        case PhaseFromState():
            source = PhaseSource.STATE
        case _:
            assert isinstance(section, PhaseFromNothing)
            source = PhaseSource.NONE
    return ClutchActuation(source, 0.0, 0.0), ClutchActuation(source, 0.0, 0.0)


def _actuation(section: PositionSection | FlagSection | CommandSection) -> ClutchActuation:
    match section:
        case PositionSection():
            increasing = section.closes == "increasing"
            error = section.kissing_point_error
            if error is None:
                error = _KISSING_POINT_SHARE * abs(section.kissing_point)
            return ClutchActuation(
                PhaseSource.POSITION, section.kissing_point, section.hysteresis, increasing, error
            )
        case CommandSection():
            return ClutchActuation(PhaseSource.COMMAND, section.threshold_nm, section.hysteresis_nm)
        case FlagSection():
            return ClutchActuation(PhaseSource.FLAG, 0.0, 0.0)


def _model_of_source(document: Document, path: KeyPath, models: dict[str, type[S]]) -> type[S] | None:
    """Return the model that the key `source` of a section chooses."""
    section = document.value(path)
    if absent(section):
        return None
    source = section.get("source") if isinstance(section, dict) else None
    if isinstance(source, str) and source in models:
        return models[source]
    at = (*path, "source")
    if isinstance(section, dict) and source is None:
        document.problems.append(document.problem(at, f"missing: one of {', '.join(models)}"))
    elif source is None:
        document.problems.append(document.problem(path, "must be a mapping of keys to values"))
    else:
        document.problems.append(document.problem(at, "unknown source" + nearest(str(source), models)))
    return None


def _protections(document: Document, builder: InputBuilder) -> tuple[Protection, ...]:
    path: KeyPath = ("protection",)
    section = document.value(path)
    if section is not None and not isinstance(section, dict):
        document.problems.append(document.problem(path, "must be a mapping of message names"))
        return ()
    protections = []
    for message, data in (section or {}).items():
        at = (*path, message)
        validate(document, at, ProtectionSection)
        for _, protection in sound_parts(ProtectionSection, data, at, repair=True):
            assert isinstance(protection, ProtectionSection)
            protections.append(builder.protect(at, str(message), protection))
    return tuple(protections)
