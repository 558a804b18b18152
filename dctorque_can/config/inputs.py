"""The `inputs:` section: which quantities a vehicle file can give, and what is plausible of them."""

from __future__ import annotations

from collections.abc import Iterator

from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.config.signals import DirectionSection, InputSection, SpeedSection
from dctorque_can.pipeline.samples import Quantity

ANY = (-1e12, 1e12)
PLAUSIBLE = {
    Quantity.ENGINE_SPEED: (0.0, 1100.0),  # 10 500 rpm
    Quantity.ENGINE_TORQUE: (-1000.0, 2000.0),
    Quantity.SHAFT1_SPEED: (-1500.0, 1500.0),
    Quantity.SHAFT2_SPEED: (-1500.0, 1500.0),
    Quantity.WHEEL_SPEED_FL: (-350.0, 350.0),  # about 390 km/h
    Quantity.WHEEL_SPEED_FR: (-350.0, 350.0),
    Quantity.WHEEL_SPEED_RL: (-350.0, 350.0),
    Quantity.WHEEL_SPEED_RR: (-350.0, 350.0),
    Quantity.CLUTCH1_COMMAND: (-1000.0, 4000.0),
    Quantity.CLUTCH2_COMMAND: (-1000.0, 4000.0),
    Quantity.ACCELERATION: (-30.0, 30.0),
    Quantity.GRADE: (-0.8, 0.8),
    Quantity.TRANSMISSION_TORQUE: (-1000.0, 4000.0),
    Quantity.DRIVING_SHAFT_SPEED: (-1500.0, 1500.0),
}
"""Range of an input that gives none, SI; any value where the quantity is not listed."""


class WheelSpeedsSection(Section):
    """The wheels that the bus tells; front left, front right, rear left, rear right."""

    fl: SpeedSection | None = None
    """Speed of the front left wheel."""
    fr: SpeedSection | None = None
    """Speed of the front right wheel."""
    rl: SpeedSection | None = None
    """Speed of the rear left wheel."""
    rr: SpeedSection | None = None
    """Speed of the rear right wheel."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if all(wheel is None for wheel in (self.fl, self.fr, self.rl, self.rr)):
            yield (), "missing: at least one of fl, fr, rl, rr"


class InputsSection(Section):
    """The measured quantities, apart from gears and clutch phase."""

    engine_speed: InputSection
    """Engine speed."""
    engine_torque: InputSection
    """Nominal net engine torque T_en at the flywheel (indicated minus friction)."""
    shaft1_speed: SpeedSection | None = None
    """Speed of input shaft 1, behind clutch 1; only the method kalman can do without it."""
    shaft2_speed: SpeedSection | None = None
    """Speed of input shaft 2, behind clutch 2; only the method kalman can do without it."""
    driving_shaft_speed: SpeedSection | None = None
    """Instead of both: the one input shaft speed that is told, that of the clutch that drives; only kalman."""
    wheel_speeds: WheelSpeedsSection
    """Wheel speeds fl, fr, rl, rr; a road speed (km/h) is divided by the wheel radius."""
    direction: DirectionSection | None = None
    """Which way the car goes, for speeds without sign; one signal, or one of each wheel."""
    acceleration: InputSection | None = None
    """Longitudinal acceleration as an accelerometer has it, dv/dt + g sin(grade)."""
    grade: InputSection | None = None
    """Inclination of the road, positive uphill."""
    brake: InputSection | None = None
    """Any measure of braking, positive when braking."""
    clutch1_command: InputSection | None = None
    """Torque capacity that clutch 1 is commanded to; with clutch_phase.source: command it is given there."""
    clutch2_command: InputSection | None = None
    """Torque capacity that clutch 2 is commanded to."""
    transmission_torque: InputSection | None = None
    """What the transmission itself believes of the clutch that drives: compared with, never used."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        for name in ("shaft1_speed", "shaft2_speed"):
            if self.driving_shaft_speed is not None and getattr(self, name) is not None:
                yield (name,), "give either the speed of each shaft or driving_shaft_speed, not both"


QUANTITY_AT: dict[KeyPath, Quantity] = {
    ("engine_speed",): Quantity.ENGINE_SPEED,
    ("engine_torque",): Quantity.ENGINE_TORQUE,
    ("shaft1_speed",): Quantity.SHAFT1_SPEED,
    ("shaft2_speed",): Quantity.SHAFT2_SPEED,
    ("wheel_speeds", "fl"): Quantity.WHEEL_SPEED_FL,
    ("wheel_speeds", "fr"): Quantity.WHEEL_SPEED_FR,
    ("wheel_speeds", "rl"): Quantity.WHEEL_SPEED_RL,
    ("wheel_speeds", "rr"): Quantity.WHEEL_SPEED_RR,
    ("acceleration",): Quantity.ACCELERATION,
    ("grade",): Quantity.GRADE,
    ("brake",): Quantity.BRAKE,
    ("clutch1_command",): Quantity.CLUTCH1_COMMAND,
    ("clutch2_command",): Quantity.CLUTCH2_COMMAND,
    ("transmission_torque",): Quantity.TRANSMISSION_TORQUE,
    ("driving_shaft_speed",): Quantity.DRIVING_SHAFT_SPEED,
}
