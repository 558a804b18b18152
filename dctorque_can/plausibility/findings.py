"""What can be found wrong with a vehicle file, and the sentence for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import IntFlag


class Finding(IntFlag):
    """Bits of ``findings`` in a health record; the first has place 0 in ``finding_measured``, and so on."""

    GEAR_RATIO = 1
    WHEEL_SPEEDS = 1 << 1
    AXLE_SPEEDS = 1 << 2
    SHAFTS_EXCHANGED = 1 << 3
    GEAR_SIGNAL = 1 << 4
    DRIVEN_AXLE = 1 << 5
    CLUTCHES_EXCHANGED = 1 << 6
    CLUTCH_DIRECTION = 1 << 7
    CLUTCH1_CALLED_OPEN = 1 << 8
    CLUTCH2_CALLED_OPEN = 1 << 9
    CLUTCH1_CALLED_CLOSED = 1 << 10
    CLUTCH2_CALLED_CLOSED = 1 << 11
    LAUNCH_CALLED_OPEN = 1 << 12
    ENGINE_TORQUE_SIGN = 1 << 13
    ENGINE_TORQUE_SCALE = 1 << 14
    ENGINE_TORQUE_OR_MASS = 1 << 15
    MASS = 1 << 16
    ENGINE_INERTIA = 1 << 17
    ENGINE_TORQUE_OFFSET = 1 << 18
    ROAD_LOAD = 1 << 19
    WHEELS_LATE = 1 << 20


N_FINDINGS = len(Finding)

CLUTCHES = int(
    Finding.CLUTCHES_EXCHANGED
    | Finding.CLUTCH_DIRECTION
    | Finding.CLUTCH1_CALLED_OPEN
    | Finding.CLUTCH2_CALLED_OPEN
    | Finding.CLUTCH1_CALLED_CLOSED
    | Finding.CLUTCH2_CALLED_CLOSED
    | Finding.LAUNCH_CALLED_OPEN
)
"""What is told of the clutches contradicts the speeds."""

_Words = Callable[[float, int], str]
"""The sentence of a finding, from the number that was measured and a gear."""


def _gear_ratio(share: float, gear: int) -> str:
    return (
        f"in gear {gear} the input shaft turns {100 * share:+.1f} % against what wheels and ratio say, in others "
        f"less so: the ratio is wrong. Look at vehicle.gears.{gear} (ratio, final_drive)"
    )


def _wheel_speeds(share: float, gear: int) -> str:
    return (
        f"in several gears the input shafts turn {100 * share:+.1f} % against what wheels and ratios say: the "
        "scale of the wheel speeds is wrong. Look at vehicle.chassis.wheel_radius_m and inputs.wheel_speeds "
        "(unit, factor)"
    )


def _axle_speeds(share: float, gear: int) -> str:
    return (
        f"without acceleration the driven wheels turn {100 * share:+.1f} % against the others: the scale of one "
        "axle is wrong. Look at inputs.wheel_speeds (unit, factor)"
    )


def _shafts_exchanged(share: float, gear: int) -> str:
    return (
        f"{100 * share:.0f} % of the time an input shaft turns as the gear of the other one wants it: they are "
        "exchanged. Look at inputs.shaft1_speed and inputs.shaft2_speed"
    )


def _gear_signal(share: float, gear: int) -> str:
    return (
        f"{100 * share:.0f} % of the time an input shaft turns as another gear than the one told wants it, such "
        f"as gear {gear}: the gear signal is misread. Look at gears (values of that shaft)"
    )


def _driven_axle(slope: float, gear: int) -> str:
    return (
        f"the harder the car accelerates, the slower the wheels called driven turn ({100 * slope:+.2f} % for each "
        "m/s²): the other axle is driven. Look at vehicle.driven_axle, and at front and rear in "
        "inputs.wheel_speeds"
    )


def _clutches_exchanged(way: float, gear: int) -> str:
    return (
        f"the engine kept the speed of an input shaft through {way:.0f} rad/s of changes while its clutch was "
        "called open and the other one closed: they are exchanged. Look at clutch_phase.clutch1 and "
        "clutch_phase.clutch2"
    )


def _clutch_direction(way: float, gear: int) -> str:
    return (
        f"the engine kept the speed of an input shaft through {way:.0f} rad/s of changes while its clutch was "
        "called open, and at rest both are called closed: the direction is wrong. Look at clutch_phase (closes, "
        "of both)"
    )


def _called_open(clutch: int) -> _Words:
    def words(way: float, gear: int) -> str:
        return (
            f"the engine kept the speed of input shaft {clutch} through {way:.0f} rad/s of changes while clutch "
            f"{clutch} was called open. Look at clutch_phase.clutch{clutch} (kissing_point, closes, the signal)"
        )

    return words


def _called_closed(clutch: int) -> _Words:
    def words(seconds: float, gear: int) -> str:
        return (
            f"clutch {clutch} was called closed for {seconds:.0f} s while it slipped and the other one held the "
            f"engine: it was open. Look at clutch_phase.clutch{clutch} (kissing_point, closes, the signal)"
        )

    return words


def _launch_called_open(seconds: float, gear: int) -> str:
    return (
        f"for {seconds:.1f} s the engine drove the car while both clutches were called open: they close earlier "
        "than told. Look at clutch_phase (kissing_point, closes, of both)"
    )


def _torque_sign(factor: float, gear: int) -> str:
    return (
        "the car speeds up as the engine torque falls, and slows down as it grows: its sign is wrong. "
        "Look at inputs.engine_torque (factor)"
    )


def _torque_scale(factor: float, gear: int) -> str:
    return (
        f"engine and car both accelerate as by {factor:.2g} times the engine torque that is told: its scale is "
        "wrong. Look at inputs.engine_torque (factor, unit, reference_nm)"
    )


def _torque_or_mass(factor: float, gear: int) -> str:
    return (
        f"the car accelerates as by {factor:.2g} times the engine torque that is told: its scale is wrong, or the "
        "mass. Look at inputs.engine_torque (factor, unit, reference_nm) and vehicle.chassis.mass_kg"
    )


def _mass(factor: float, gear: int) -> str:
    return (
        f"the car accelerates as with {factor:.2g} times the mass that is told, while the engine alone does as "
        "it should. Look at vehicle.chassis.mass_kg (load, trailer?)"
    )


def _engine_inertia(factor: float, gear: int) -> str:
    return (
        f"the engine accelerates as with {factor:.2g} times the inertia that is told, while the car does as it "
        "should. Look at vehicle.engine_inertia_kgm2"
    )


def _torque_offset(offset: float, gear: int) -> str:
    return (
        f"at idle with open clutches the engine torque is told as {offset:+.0f} N·m, where it must be nearly "
        "zero: it has an offset. Look at inputs.engine_torque (offset; is friction taken off?)"
    )


def _road_load(grade: float, gear: int) -> str:
    return (
        f"over a kilometre torque and accelerations mean a road of {100 * grade:+.0f} %, and none is so steep. "
        "Look at inputs.engine_torque (factor, offset, unit), vehicle.chassis (mass_kg, wheel_radius_m) and "
        "inputs.brake"
    )


def _wheels_late(seconds: float, gear: int) -> str:
    later = "later" if seconds > 0.0 else "earlier"
    return (
        f"the wheel speeds come {1e3 * abs(seconds):.0f} ms {later} than told, against those of the shafts: when "
        "which torque acted is not known. Look at delay_ms of inputs.wheel_speeds and of the shafts"
    )


_SENTENCES: Mapping[Finding, _Words] = {
    Finding.GEAR_RATIO: _gear_ratio,
    Finding.WHEEL_SPEEDS: _wheel_speeds,
    Finding.AXLE_SPEEDS: _axle_speeds,
    Finding.SHAFTS_EXCHANGED: _shafts_exchanged,
    Finding.GEAR_SIGNAL: _gear_signal,
    Finding.DRIVEN_AXLE: _driven_axle,
    Finding.CLUTCHES_EXCHANGED: _clutches_exchanged,
    Finding.CLUTCH_DIRECTION: _clutch_direction,
    Finding.CLUTCH1_CALLED_OPEN: _called_open(1),
    Finding.CLUTCH2_CALLED_OPEN: _called_open(2),
    Finding.CLUTCH1_CALLED_CLOSED: _called_closed(1),
    Finding.CLUTCH2_CALLED_CLOSED: _called_closed(2),
    Finding.LAUNCH_CALLED_OPEN: _launch_called_open,
    Finding.ENGINE_TORQUE_SIGN: _torque_sign,
    Finding.ENGINE_TORQUE_SCALE: _torque_scale,
    Finding.ENGINE_TORQUE_OR_MASS: _torque_or_mass,
    Finding.MASS: _mass,
    Finding.ENGINE_INERTIA: _engine_inertia,
    Finding.ENGINE_TORQUE_OFFSET: _torque_offset,
    Finding.ROAD_LOAD: _road_load,
    Finding.WHEELS_LATE: _wheels_late,
}


def sentences(findings: int, measured: Sequence[float], gear: int) -> Iterator[tuple[Finding, float, str]]:
    """Yield each finding of a mask with its number and its sentence.

    Args:
        findings: `Finding` bits.
        measured: the number of each ``[N_FINDINGS]``, in the unit of its sentence.
        gear: that `Finding.GEAR_RATIO` and `Finding.GEAR_SIGNAL` are about.
    """
    for place, finding in enumerate(Finding):
        if findings & finding:
            number = float(measured[place])
            yield finding, number, _SENTENCES[finding](number, gear)


_KEYS: Mapping[Finding, str] = {
    Finding.GEAR_RATIO: "vehicle.gears.{gear}.ratio",
    Finding.WHEEL_SPEEDS: "vehicle.chassis.wheel_radius_m",
    Finding.AXLE_SPEEDS: "inputs.wheel_speeds",
    Finding.SHAFTS_EXCHANGED: "inputs.shaft1_speed",
    Finding.GEAR_SIGNAL: "gears",
    Finding.DRIVEN_AXLE: "vehicle.driven_axle",
    Finding.CLUTCHES_EXCHANGED: "clutch_phase",
    Finding.CLUTCH_DIRECTION: "clutch_phase",
    Finding.CLUTCH1_CALLED_OPEN: "clutch_phase.clutch1",
    Finding.CLUTCH2_CALLED_OPEN: "clutch_phase.clutch2",
    Finding.CLUTCH1_CALLED_CLOSED: "clutch_phase.clutch1",
    Finding.CLUTCH2_CALLED_CLOSED: "clutch_phase.clutch2",
    Finding.LAUNCH_CALLED_OPEN: "clutch_phase",
    Finding.ENGINE_TORQUE_SIGN: "inputs.engine_torque",
    Finding.ENGINE_TORQUE_SCALE: "inputs.engine_torque",
    Finding.ENGINE_TORQUE_OR_MASS: "inputs.engine_torque",
    Finding.MASS: "vehicle.chassis.mass_kg",
    Finding.ENGINE_INERTIA: "vehicle.engine_inertia_kgm2",
    Finding.ENGINE_TORQUE_OFFSET: "inputs.engine_torque",
    Finding.ROAD_LOAD: "inputs.engine_torque",
    Finding.WHEELS_LATE: "inputs.wheel_speeds.fl.delay_ms",
}


def key_of(finding: Finding, gear: int) -> str:
    """Return the dotted key of the vehicle file to look at first; ``gear`` as for `sentences`."""
    return _KEYS[finding].format(gear="R" if gear < 0 else gear)
