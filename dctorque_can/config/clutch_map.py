"""The `clutch_map:` and `state:` sections: what is learned of each clutch, and where it is kept."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from pydantic import Field

from dctorque_can.bus.map_output import MAP_MESSAGES
from dctorque_can.clutch_maps.settings import Actuation, MapSettings
from dctorque_can.config.document import Document
from dctorque_can.config.edges import LAST_EXTENDED_ID
from dctorque_can.config.estimation import microseconds
from dctorque_can.config.section import Section, nearest
from dctorque_can.driveline.parameters import GEARS, Clutch
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.samples import Input, Quantity
from dctorque_can.pipeline.settings import Settings

_COMMAND_ERROR_SHARE = 0.03
"""Of a clutch's capacity: up to this commanded torque it may carry none."""
_TOUCH_SHARE = 0.05
"""Of a kissing point for which neither an error nor a hysteresis is given."""


class ClutchMapSection(Section):
    """The torque of each clutch by its position or command, learned while driving."""

    enabled: bool = False
    """Learn the maps of both clutches."""
    use_as_command: bool = False
    """Use the map that was kept as a weak measurement of the torques, as a commanded torque is."""
    ids: dict[str, Annotated[int, Field(ge=0, le=LAST_EXTENDED_ID)]] = Field(default_factory=dict)
    """Message name of dctorque_map.dbc to arbitration id, instead of the DBC's, where estimates are sent."""
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0
    """Time between two rows of the maps in the log, s."""
    least_slip_rad_s: Annotated[float, Field(ge=1, le=1000)] = 10.0
    """A clutch teaches while it slips by more than this, rad/s."""
    friction_drift_share: Annotated[float, Field(gt=0, le=2)] = 0.25
    """By how much the friction may change within an hour, as a share: how fast the map forgets."""
    touch_drift_share: Annotated[float, Field(gt=0, le=100)] = 3.5
    """By how much the touch point may move within an hour, in kissing_point_error."""
    shape_drift_share: Annotated[float, Field(gt=0, le=1)] = 0.01
    """By how much the shape of the map may change within an hour, as a share."""
    least_samples: Annotated[float, Field(ge=1, le=1000)] = 2.0
    """Independent estimates, of 0.2 s each, that make a node of the map valid."""
    largest_sigma_share: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Standard deviation of a node up to which it is valid, as a share of the clutch's capacity."""
    node_speed_nm_s: Annotated[float, Field(gt=0, le=10_000)] = 40.0
    """By how much a node may move in a second of slipping, N·m."""


class StateSection(Section):
    """What the service keeps over a restart."""

    directory: str | None = None
    """Where the maps are kept, relative to the working directory; default: nowhere."""
    save_s: Annotated[float, Field(ge=1, le=86_400)] = 60.0
    """Time after which they are written again, s; they are also at a stop."""


def map_settings(document: Document, section: ClutchMapSection, settings: Settings) -> MapSettings | None:
    """Return what learning the maps needs, or None when they are not wanted; errors go to the document."""
    for name in section.ids:
        if name not in MAP_MESSAGES:
            reason = f"dctorque_map.dbc has no such message{nearest(name, MAP_MESSAGES)}"
            document.problems.append(document.problem(("clutch_map", "ids", name), reason))
    if not section.enabled:
        return None
    if settings.method is not Method.KALMAN:
        reason = "clutch_map needs standard deviations of the torques: set estimator.method: kalman"
        document.problems.append(document.problem(("estimator", "method"), reason))
    one, two = (_actuation(settings, i) for i in range(2))
    if one is None and two is None:
        reason = (
            "clutch_map needs the position, pressure or command of a clutch: give source: position or command, "
            "with clutch1 and clutch2; or inputs.clutch1_command and inputs.clutch2_command"
        )
        document.problems.append(document.problem(("clutch_phase", "source"), reason))
    given = {entry.quantity for entry in settings.inputs}
    if section.use_as_command and given & {Quantity.CLUTCH1_COMMAND, Quantity.CLUTCH2_COMMAND}:
        reason = "a command is among the inputs already: leave that or this out"
        document.problems.append(document.problem(("clutch_map", "use_as_command"), reason))
    ratios = [0.0] * GEARS
    for gear in settings.vehicle.gears:
        ratios[gear.number + 1] = gear.total_ratio
    first, second = settings.vehicle.clutches
    return MapSettings(
        clutches=(one, two),
        capacity_nm=(_capacity(first), _capacity(second)),
        coolant_c=(_coolant(first), _coolant(second)),
        ratios=tuple(ratios),
        wheel_radius_m=settings.vehicle.chassis.wheel_radius_m,
        least_slip_rad_s=section.least_slip_rad_s,
        max_step_back_us=settings.max_step_back_us,
        period_us=microseconds(section.period_s * 1000.0),
        used=section.use_as_command,
        torque_error_nm=settings.kalman.engine_torque_error_nm,
        torque_error_share=settings.kalman.engine_torque_error_share,
        friction_drift_per_sqrt_h=section.friction_drift_share,
        touch_drift_per_sqrt_h=section.touch_drift_share,
        shape_drift_per_sqrt_h=section.shape_drift_share,
        least_samples=section.least_samples,
        largest_sigma_share=section.largest_sigma_share,
        node_speed_nm_s=section.node_speed_nm_s,
    )


def _actuation(settings: Settings, i: int) -> Actuation | None:
    """Return what closes clutch i: its position before its command; None where neither is told."""
    position = _given(settings.inputs, Quantity(Quantity.CLUTCH1_POSITION + i))
    if position is not None:
        clutch = settings.phases.clutches[i]
        told = clutch.source is PhaseSource.POSITION
        touch = clutch.threshold if told else 0.0
        error = max(clutch.touches_before, clutch.hysteresis) or _TOUCH_SHARE * abs(touch) or 1.0
        sign = 1.0 if clutch.closes_increasing else -1.0
        return Actuation(position.quantity, sign, touch, error, position.timeout_us, position.delay_us)
    command = _given(settings.inputs, Quantity(Quantity.CLUTCH1_COMMAND + i))
    if command is None:
        return None
    error = _COMMAND_ERROR_SHARE * _capacity(settings.vehicle.clutches[i])
    return Actuation(command.quantity, 1.0, 0.0, error, command.timeout_us, command.delay_us)


def _given(inputs: Iterable[Input], quantity: Quantity) -> Input | None:
    return next((given for given in inputs if given.quantity is quantity), None)


def _capacity(clutch: Clutch) -> float:
    return clutch.surfaces * clutch.friction_kinetic * clutch.effective_radius_m * clutch.max_normal_force_n


def _coolant(clutch: Clutch) -> float:
    return clutch.thermal.coolant_c if clutch.thermal is not None else 0.0
