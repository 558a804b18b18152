"""What is doubtful about the inputs of a vehicle file as a whole: what is missing, costly, or not told."""

from __future__ import annotations

import math

from dctorque_can.config.document import Document
from dctorque_can.config.estimation import EstimatorSection
from dctorque_can.config.input_builder import InputBuilder
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import absent
from dctorque_can.config.vehicle import VehicleSection
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phases import PhaseSettings, PhaseSource
from dctorque_can.pipeline.samples import Quantity, Signs

MOST_TAKEN_AGAIN_PER_S = 20_000  # frames; at 5 µs each (docs/kalman_accuracy.md) a tenth of a processor


def check_missing_shafts(document: Document, estimator: EstimatorSection, inferred: bool) -> None:
    """Report a shaft without a speed that the method, or the source of gears, cannot do without."""
    inputs = document.value(("inputs",))
    if not isinstance(inputs, dict):
        return
    one = not absent(inputs.get("driving_shaft_speed")) and estimator.method == "kalman" and not inferred
    for shaft in () if one else (1, 2):
        path: KeyPath = ("inputs", f"shaft{shaft}_speed")
        if not absent(document.value(path)):
            continue
        if estimator.method == "oh2014":
            reason = "missing: the method oh2014 needs the speeds of both input shafts; kalman can do without"
            document.problems.append(document.problem(path, reason))
        elif inferred:
            reason = (
                "missing: gears by ratio need the speeds of both input shafts; give gears: {source: signals, …}"
            )
            document.problems.append(document.problem(path, reason))
        else:
            reason = "missing: slip and torque of its clutch are then known from engine and wheels alone"
            document.problems.append(document.problem(path, reason, warning=True))


def check_phases(document: Document, estimator: EstimatorSection, phases: PhaseSettings | None) -> None:
    """Report that nothing tells of each clutch whether it is open, to the method that cannot do without."""
    if phases is None or estimator.method != "oh2014":
        return
    if phases.clutches[0].source in (PhaseSource.NONE, PhaseSource.STATE):
        reason = "the method oh2014 must be told of each clutch whether it is open: position, flag or command"
        document.problems.append(document.problem(("clutch_phase", "source"), f"{reason}; kalman can do without"))


def note_costly_delays(document: Document, builder: InputBuilder, estimator: EstimatorSection) -> None:
    """Warn when the estimates of a second take many frames again; without cycle times in the DBC nobody knows."""
    longest_s = max((entry.input.delay_us for entry in builder.entries), default=0) / 1e6
    periods_ms: dict[str, float] = {}
    for entry in builder.entries:
        for term, period_ms in zip(entry.input.terms, entry.periods_ms, strict=True):
            if period_ms:
                periods_ms[term.message] = period_ms
    frames_per_s = sum(1000 / period_ms for period_ms in periods_ms.values())
    estimates_per_s = min(frames_per_s, 1000 / estimator.period_ms)
    again = longest_s * frames_per_s  # by each estimate
    if again * estimates_per_s > MOST_TAKEN_AGAIN_PER_S:
        reason = (
            f"is costly: each estimate takes the frames of the last {1000 * longest_s:g} ms again (the longest "
            f"delay_ms), which are {again * estimates_per_s:.0f} a second; give "
            f"{math.ceil(1000 * again / MOST_TAKEN_AGAIN_PER_S)} or more"
        )
        document.problems.append(document.problem(("estimator", "period_ms"), reason, warning=True))


def note_untold_signs(document: Document, builder: InputBuilder) -> None:
    """Warn of speeds of which neither the file nor the DBC says whether they have a sign."""
    untold = [entry.key.removeprefix("inputs.") for entry in builder.entries if entry.input.signs is Signs.UNTOLD]
    if untold:
        reason = (
            f"give signed: true or false to {', '.join(untold)}: the DBC allows negative values, but does a car "
            "that rolls backwards send them? Until one comes, they count as without sign"
        )
        document.problems.append(document.problem(("inputs",), reason, warning=True))


def note_idle_direction(document: Document, builder: InputBuilder) -> None:
    """Warn of a direction that is told to speeds that all have a sign."""
    given = {entry.input.quantity: entry.input.signs for entry in builder.entries}
    if Quantity.DIRECTION in given and all(signs is Signs.SIGNED for signs in given.values()):
        reason = "has no effect: all speeds of wheels and shafts have a sign (signed: true)"
        document.problems.append(document.problem(("inputs", "direction"), reason, warning=True))


def note_missing_axle(document: Document, builder: InputBuilder, vehicle: VehicleSection | None) -> None:
    """Warn when the wheels of one axle have to stand in for the other."""
    wheels = {Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_FR}, {Quantity.WHEEL_SPEED_RL, Quantity.WHEEL_SPEED_RR}
    given = {entry.input.quantity for entry in builder.entries}
    if vehicle is None or vehicle.axle is DrivenAxle.ALL or not given & (wheels[0] | wheels[1]):
        return
    driven, undriven = wheels if vehicle.axle is DrivenAxle.FRONT else wheels[::-1]
    path: KeyPath = ("inputs", "wheel_speeds")
    if not given & undriven:
        reason = "no undriven wheel: the driven ones stand in, and their slip disturbs the output torque"
        document.problems.append(document.problem(path, reason, warning=True))
    if not given & driven:
        reason = "no driven wheel: the undriven ones stand in where gears are inferred and checked"
        document.problems.append(document.problem(path, reason, warning=True))
