"""Sensors and bus: from the truth of a drive to the CAN frames of the demo car (dbc/demo_car.dbc).

Speeds have no negative values there: what turns backwards is sent as 0. dbc/demo_car_signed.dbc has the same
messages with signed wheel and input shaft speeds.

Every message samples at its own instants, between the rows of the truth; what a sample's frame shows has the noise
of its sensors, the resolution of the DBC, and arrives later by the message's delay and jitter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from cantools.database.can import Database
from numpy.typing import NDArray

from dctorque_can.bus.addresses import address_of
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.layout import MAX_BYTES
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import Address, FrameFlag, Frames
from dctorque_can.pipeline.samples import Protection
from dctorque_can.simulation.messages import COLUMNS, Sampled
from dctorque_can.simulation.one_gear import GearChange
from dctorque_can.simulation.truth import TRUTH_PERIOD_US

Speeds = Literal["wheels", "shafts"]
_CLASSIC_BYTES = 8


@dataclass(frozen=True, slots=True)
class Timing:
    """When one message samples and how much later its frame is received.

    Attributes:
        period_us: between two samples.
        offset_us: of the first sample.
        delay_us: from sample to frame: filters, computing and waiting for the bus.
        jitter_us: greatest further delay, evenly distributed; less than the period.
    """

    period_us: int
    offset_us: int = 0
    delay_us: int = 0
    jitter_us: int = 0


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of white noise on every sample, before the resolution of the DBC."""

    engine_speed_rad_s: float
    shaft_speed_rad_s: float
    wheel_speed_rad_s: float
    engine_torque_nm: float = 0.0
    clutch_position_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class InertialErrors:
    """Errors of the message Inertial. What lasts is drawn from the seed, once for a car.

    Attributes:
        offset_m_s2: standard deviation of the accelerometer's lasting offset.
        noise_m_s2: standard deviation of its white noise on every sample.
        pitch: by how much of the acceleration the body's pitch, with gravity, adds to it.
        delay_us: of its filter.
        grade_offset_rad: standard deviation of the lasting error of the grade.
        grade_delay_us: of the grade's filter.
    """

    offset_m_s2: float = 0.15
    noise_m_s2: float = 0.05
    pitch: float = 0.04
    delay_us: int = 20_000
    grade_offset_rad: float = 0.01
    grade_delay_us: int = 500_000


@dataclass(frozen=True, slots=True)
class DirectionErrors:
    """Errors of the message WheelDirections.

    Attributes:
        delay_us: from the motion to what is said of it.
        freezes: at rest it says what it said before, instead of standstill.
        stuck: the one thing that it says, whatever the car does; "" for what is true.
    """

    delay_us: int = 40_000
    freezes: bool = False
    stuck: Literal["", "forward", "backward", "unknown"] = ""


@dataclass(frozen=True, slots=True)
class SensorProfile:
    """How a car measures and sends.

    Attributes:
        name: one word.
        timing: by message name.
        noise: of the sensors.
        torque_gain: nominal torque on the bus = gain · true torque + offset, ``torque_delay_us`` late.
        torque_offset_nm: see there.
        torque_delay_us: see there; on top of the message's own delay.
        torque_lag_s: first-order lag of the engine behind the torque on the bus, which is then a demand.
        driven_axle: whose wheels the transmission turns.
        seed: of noise and jitter.
        inertial: errors of the message Inertial, if it is sent.
        reference_torque_nm: what 100 % of the torques of the message EngineShare are.
        clutch_torque_gain: torque of the driving clutch as the transmission control believes it, over the true.
        driving_shaft_delay_us: by which the message DrivingShaft goes over to the other shaft too late.
        direction: errors of the message WheelDirections, if it is sent.
        unsigned: speeds that are measured and sent without their sign, as by most production sensors: they count
            teeth. Noise and resolution are then those of the magnitude.
        gear_changes: when in a shift the one gear of the message Transmission changes: in the middle, when the new
            clutch has the greater capacity, or at the end, when the old one is open.
        own_period_us: of every message of a car with a bus of its own (`own_bus`); None: what its DBC says.
    """

    name: str
    timing: Mapping[str, Timing]
    noise: Noise
    torque_gain: float = 1.0
    torque_offset_nm: float = 0.0
    torque_delay_us: int = 0
    torque_lag_s: float = 0.0
    driven_axle: Literal["front", "rear", "all"] = "front"
    seed: int = 0
    inertial: InertialErrors = InertialErrors()
    reference_torque_nm: float = 400.0
    clutch_torque_gain: float = 1.06
    driving_shaft_delay_us: int = 50_000
    direction: DirectionErrors = DirectionErrors()
    unsigned: frozenset[Speeds] = frozenset()
    gear_changes: GearChange = "end"
    own_period_us: int | None = None


LABORATORY = SensorProfile(
    name="laboratory",
    timing={
        name: Timing(1000)
        for name in ("EngineData", "InputShafts", "Gearbox", "WheelSpeedsFront", "WheelSpeedsRear")
    },
    noise=Noise(engine_speed_rad_s=0.3, shaft_speed_rad_s=0.3, wheel_speed_rad_s=0.02),
    own_period_us=1000,
)
"""Every signal each millisecond, without delay, with the noise of the paper's simulation study."""

PRODUCTION = SensorProfile(
    name="production",
    timing={
        "EngineData": Timing(10_000, 0, 1_500, 400),
        "InputShafts": Timing(10_000, 2_300, 1_000, 400),
        "Gearbox": Timing(10_000, 4_700, 1_000, 400),
        "WheelSpeedsFront": Timing(20_000, 6_100, 2_000, 400),
        "WheelSpeedsRear": Timing(20_000, 6_500, 2_000, 400),
    },
    noise=Noise(
        engine_speed_rad_s=0.1,
        shaft_speed_rad_s=0.1,
        wheel_speed_rad_s=0.02,
        engine_torque_nm=0.5,
        clutch_position_mm=0.01,
    ),
)
"""A production bus: 10 and 20 ms, messages staggered, a little late and a little unsteady, modest noise."""

INERTIAL = replace(
    PRODUCTION, name="inertial", timing={**PRODUCTION.timing, "Inertial": Timing(20_000, 8_900, 2_000, 400)}
)
"""The same with the message of an inertial sensor: every other message is the same bit for bit."""

ONE_GEAR = replace(
    PRODUCTION, name="one_gear", timing={**PRODUCTION.timing, "Transmission": Timing(10_000, 5_300, 1_000, 400)}
)
"""The same with one gear signal for the whole gearbox: every other message is the same bit for bit."""

MORE = replace(
    PRODUCTION,
    name="more",
    timing={
        **PRODUCTION.timing,
        "WheelDirections": Timing(20_000, 7_300, 2_000, 400),
        "EngineShare": Timing(10_000, 0, 1_500, 400),
        "EngineReference": Timing(1_000_000, 3_100, 2_000, 400),
        "DrivingClutch": Timing(10_000, 5_900, 1_000, 400),
        "DrivingShaft": Timing(10_000, 2_700, 1_000, 400),
    },
)
"""The same with the messages of dbc/demo_car_more.dbc: every other message is the same bit for bit."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What the control units of one car send.

    Attributes:
        timing: by message name.
        columns: by message name, physical values of its signals at the instants at which it samples.
        protections: by message name, of those that have one.
    """

    timing: Mapping[str, Timing]
    columns: Mapping[str, Callable[[Sampled], Mapping[str, NDArray[np.float64]]]]
    protections: Mapping[str, Protection]


def sent_by_demo_car(profile: SensorProfile, database: Database) -> Sent:
    """Return what the demo car sends.

    Raises:
        DctorqueError: the database lacks a message, or the profile names one that no sensor fills.
    """
    known = {message.name: message for message in database.messages}
    protections = {}
    for name in profile.timing:
        if name not in COLUMNS:
            raise DctorqueError(f"no sensors for message {name}; there are {', '.join(COLUMNS)}")
        if name not in known:
            raise DctorqueError(
                f"no DBC of the vehicle file has a message {name}; the simulated car sends demo_car.dbc, with "
                "profile one_gear demo_car_one_gear.dbc, with more demo_car_more.dbc too: name it in databases"
            )
        protections[name] = Protection(
            message=name,
            counter_signal=f"{name}Counter",
            counter_modulus=15,
            crc="e2e_p01",
            crc_signal=f"{name}Crc",
            data_id=known[name].frame_id & 0xFFFF,
        )
    return Sent(profile.timing, COLUMNS, protections)


@dataclass(slots=True)
class FrameEmitter:
    """The electronic control units of one car: they count and sign from one drive to the next.

    Args:
        vehicle: for the wheel radius that is coded in the brake control unit, whatever the tyre's true radius is:
            the unit measures rad/s and multiplies.
        profile: how the car measures and sends.
        database: with the messages that are sent.
        sent: what is; None for what the demo car sends.
        addresses: identifier and channel on which a message is sent, by its name, where they are not the DBC's.

    Raises:
        DctorqueError: the database lacks a message of the demo car, or a message cannot be sent.
    """

    vehicle: Vehicle
    profile: SensorProfile
    database: Database
    sent: Sent | None = None
    addresses: Mapping[str, Address] = field(default_factory=dict)
    _sent: Sent = field(init=False)
    _encoders: dict[str, MessageEncoder] = field(init=False)
    _random: dict[str, np.random.Generator] = field(init=False)

    def __post_init__(self) -> None:
        self._sent = self.sent or sent_by_demo_car(self.profile, self.database)
        self._encoders, self._random = {}, {}
        for name, timing in self._sent.timing.items():
            if not 0 <= timing.jitter_us < timing.period_us:
                raise DctorqueError(
                    f"message {name}: jitter {timing.jitter_us} µs must be within 0 and its period"
                )
            message = self.database.get_message_by_name(name)
            self._encoders[name] = MessageEncoder(message, self._sent.protections.get(name))
            self._random[name] = np.random.default_rng([self.profile.seed, message.frame_id])

    def emit(self, truth: NDArray[np.void], start_us: int = 0) -> Frames:
        """Return the frames sampled from the first row up to, not including, the last, sorted by arrival.

        A drive that is emitted again with ``start_us`` later by its length continues counters and noise; so an
        hour of traffic needs no hour of truth.

        Args:
            truth: `TRUTH` ``[n]``.
            start_us: time of the first row on the bus.
        """
        parts = [self._message(name, truth, start_us) for name in self._sent.timing]
        return Frames.concatenate(parts).sorted_by_time()

    def _message(self, name: str, truth: NDArray[np.void], start_us: int) -> Frames:
        timing, random = self._sent.timing[name], self._random[name]
        first, last = int(truth["t_us"][0]), int(truth["t_us"][-1])
        at_us = np.arange(first + timing.offset_us, last, timing.period_us, dtype=np.int64)
        message = self.database.get_message_by_name(name)
        lasting = np.random.default_rng([self.profile.seed, message.frame_id, 1])
        radius_m = self.vehicle.chassis.wheel_radius_m
        sampled = Sampled(truth, at_us, self.profile, radius_m, random, lasting)
        payload = self._encoders[name].encode(self._sent.columns[name](sampled))
        is_fd = message.length > _CLASSIC_BYTES
        frames = Frames.empty(len(at_us), MAX_BYTES if is_fd else _CLASSIC_BYTES)
        frames.flags[:] = FrameFlag.FD if is_fd else 0
        late = timing.delay_us + random.integers(0, timing.jitter_us, len(at_us), endpoint=True)
        frames.t_us[:] = at_us - first + start_us + late
        address = address_of(message, self.addresses)
        frames.can_id[:] = address.can_id
        frames.channel[:] = address.channel or 0
        frames.length[:] = message.length
        frames.data[:, : message.length] = payload
        return frames


def emit_frames(
    truth: NDArray[np.void],
    vehicle: Vehicle,
    profile: SensorProfile,
    database: Database,
    start_us: int = 0,
    sent: Sent | None = None,
    addresses: Mapping[str, Address] | None = None,
) -> Frames:
    """Return the CAN frames of one drive, sorted by arrival; see `FrameEmitter`.

    Raises:
        DctorqueError: as for `FrameEmitter`.
    """
    return FrameEmitter(vehicle, profile, database, sent, addresses or {}).emit(truth, start_us)


def length_us(truth: NDArray[np.void]) -> int:
    """Return by how much the next `FrameEmitter.emit` of the same drive must start later.

    Rounded up to 20 ms, so that no message of the demo car falls out of step at the joint.
    """
    span = int(truth["t_us"][-1] - truth["t_us"][0])
    return -(-max(span, TRUTH_PERIOD_US) // 20_000) * 20_000
