"""Decoded signal samples as columns, and the description of the inputs they come from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray


class Quantity(IntEnum):
    """What a sample measures. Values are SI: rad/s, N·m, m/s², rad; positions in the unit of the bus."""

    ENGINE_SPEED = 0
    ENGINE_TORQUE = 1  # nominal net torque T_en
    SHAFT1_SPEED = 2
    SHAFT2_SPEED = 3
    WHEEL_SPEED_FL = 4
    WHEEL_SPEED_FR = 5
    WHEEL_SPEED_RL = 6
    WHEEL_SPEED_RR = 7
    GEAR1 = 8  # engaged on shaft 1: 0 neutral or being changed, -1 reverse
    GEAR2 = 9
    CLUTCH1_POSITION = 10
    CLUTCH2_POSITION = 11
    CLUTCH1_OPEN = 12  # flag: 1 when the clutch cannot carry torque
    CLUTCH2_OPEN = 13
    CLUTCH1_COMMAND = 14  # commanded clutch torque (capacity), N·m
    CLUTCH2_COMMAND = 15
    ACCELERATION = 16  # longitudinal, m/s²
    GRADE = 17  # road inclination, rad, positive uphill
    BRAKE = 18  # any brake measure, positive when braking
    GEAR = 19  # the one gear that a whole gearbox tells: that which drives, 0 neutral, -1 reverse
    TARGET_GEAR = 20  # … and the one that is preselected or shifted to
    SHIFT_IN_PROGRESS = 21  # flag: 1 while it shifts
    CLUTCH_STATE = 22  # of both clutches together: 0 open, 1 slipping, 2 closed
    DIRECTION = 23  # of the car: 1 forwards, -1 backwards, 0 at rest or not known; of several wheels their mean
    TRANSMISSION_TORQUE = 24  # what the transmission believes of the clutch that drives, N·m
    DRIVING_SHAFT_SPEED = 25  # of the input shaft whose clutch drives, when no other one is told


N_QUANTITIES = len(Quantity)
SPEEDS = (
    Quantity.ENGINE_SPEED,
    Quantity.SHAFT1_SPEED,
    Quantity.SHAFT2_SPEED,
    Quantity.WHEEL_SPEED_FL,
    Quantity.WHEEL_SPEED_FR,
    Quantity.WHEEL_SPEED_RL,
    Quantity.WHEEL_SPEED_RR,
)
"""Speeds in the order of the Kalman filter's signals."""


LONGEST_LEARNED_US = 2_000_000
"""No timeout that is learned is longer."""


class SampleStatus(IntEnum):
    """Why a sample may not be used. Anything but OK is counted in `Health` and changes nothing else."""

    OK = 0
    NOT_AVAILABLE = 1  # the sender says so, or a raw value has no meaning
    OUT_OF_RANGE = 2
    BAD_LENGTH = 3
    BAD_CRC = 4
    BAD_COUNTER = 5
    NOT_BELIEVED = 6  # the frame is right, but too many of its message were not
    BAD_RATE = 7  # changed faster than the quantity can


class Signs(IntEnum):
    """Whether a speed says which way something turns."""

    SIGNED = 0
    UNSIGNED = 1  # a magnitude: teeth are counted, whichever way they pass
    UNTOLD = 2  # the one or the other: signed as soon as it has been negative


@dataclass(frozen=True, slots=True)
class Samples:
    """``n`` samples in order of arrival.

    Attributes:
        t_us: int64 ``[n]``, time of the frame.
        quantity: uint8 ``[n]``, `Quantity`.
        value: float64 ``[n]``, SI; zero where ``status`` is not OK.
        status: uint8 ``[n]``, `SampleStatus`.
        last: bool ``[n]``, true on the last sample of its frame: only then the frame takes effect.
    """

    t_us: NDArray[np.int64]
    quantity: NDArray[np.uint8]
    value: NDArray[np.float64]
    status: NDArray[np.uint8]
    last: NDArray[np.bool_]

    @classmethod
    def zeros(cls, n: int) -> Self:
        """Return room for n samples."""
        return cls(
            np.zeros(n, np.int64), np.zeros(n, np.uint8), np.zeros(n), np.zeros(n, np.uint8), np.zeros(n, np.bool_)
        )

    def __len__(self) -> int:
        return len(self.t_us)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Self:
        return type(self)(
            self.t_us[rows], self.quantity[rows], self.value[rows], self.status[rows], self.last[rows]
        )


@dataclass(frozen=True, slots=True)
class Term:
    """One DBC signal of a linear combination: ``factor * physical + offset`` after ``values`` is applied.

    Attributes:
        message: name of the DBC message.
        signal: name of the DBC signal.
        factor: to SI, times the coefficient of the linear combination.
        offset: added after ``factor``, SI.
        not_available: raw (undecoded) values that mean "no value".
        values: raw value to value, instead of the DBC's scaling; a raw value that is missing here is "no value".
        channel: on which its message counts; None: where the database of the message is.
    """

    message: str
    signal: str
    factor: float = 1.0
    offset: float = 0.0
    not_available: frozenset[int] = frozenset()
    values: dict[int, float] = field(default_factory=dict)
    channel: int | None = None


@dataclass(frozen=True, slots=True)
class Multiplier:
    """A signal that the sum of an input is multiplied with, or divided by.

    Attributes:
        term: the signal.
        timeout_us: age up to which its latest value counts.
        divides: whether the sum is divided by it.
    """

    term: Term
    timeout_us: int
    divides: bool = False


@dataclass(frozen=True, slots=True)
class Validity:
    """A signal that says whether an input is valid.

    Attributes:
        term: the signal; its ``values`` are those raw values that mean "valid".
        timeout_us: age up to which its latest value counts.
    """

    term: Term
    timeout_us: int


@dataclass(frozen=True, slots=True)
class Input:
    """One quantity as the sum of DBC signals, or as that times another signal.

    An input of several messages is renewed by each of them with the latest value of the others, as long as
    those are younger than ``timeout_us``.

    Attributes:
        quantity: what it measures.
        terms: the signals to be summed, at least one.
        minimum: SI; a smaller value is `SampleStatus.OUT_OF_RANGE`.
        maximum: SI; a larger value is `SampleStatus.OUT_OF_RANGE`.
        timeout_us: time since its last frame at which the input is stale.
        delay_us: from when a sample is taken to the time of its frame.
        signs: of a speed of wheels or shafts, whether it has one.
        multiplier: what the sum is multiplied with, or divided by.
        validity: what says whether it is valid.
        most_per_s: SI; a value that is further from the one before is `SampleStatus.BAD_RATE`, until three agree.
        resolution: SI; by so much two values may differ anyway.
        learns_timeout: ``timeout_us`` is the longest; the one that counts is learned from how often it comes.
    """

    quantity: Quantity
    terms: tuple[Term, ...]
    minimum: float
    maximum: float
    timeout_us: int
    delay_us: int = 0
    signs: Signs = Signs.SIGNED
    multiplier: Multiplier | None = None
    validity: Validity | None = None
    most_per_s: float = math.inf
    resolution: float = 0.0
    learns_timeout: bool = False

    @property
    def signals(self) -> tuple[Term, ...]:
        """All signals: those of the sum, the multiplier, and what says whether they are valid."""
        return (*self.terms, *(each.term for each in (self.multiplier, self.validity) if each is not None))


@dataclass(frozen=True, slots=True)
class Protection:
    """How one received message is protected.

    Attributes:
        message: name of the DBC message.
        counter_signal: name of the alive counter, or "" for none.
        counter_modulus: the counter runs 0..modulus-1 (15 for AUTOSAR profiles 1 and 11, else mostly 16).
        max_counter_delta: largest accepted step; a repeated counter (step 0) is never accepted.
        crc: kind of checksum, one of `bus.protection.CRC_KINDS`.
        crc_signal: name of the checksum signal, or "" for none.
        data_id: AUTOSAR data id (profiles 1, 4, 5, 6, 7 and 11), or 0.
        data_ids: the 16 data ids of profile 2, or empty.
        counter_high_signal: of a counter in two parts that with the upper bits, or "".
        crc_high_signal: of a checksum in two parts that with the upper bits, or "".
        data_id_mode: which part of the data id goes into profiles 1 and 11: "both" bytes, "low", "alternating"
            (the low one with even counters, the high one with odd ones), or "nibble" (the low one; the four bits
            above are sent).
        crc_start: what the checksum starts with, None for that of its kind.
        crc_xor: what is XORed to it at the end, None for that of its kind.
        crc_bytes: how many first bytes of the message are covered, 0 for all.
        channel: on which the message is protected so; None: on all.
    """

    message: str
    counter_signal: str = ""
    counter_modulus: int = 16
    max_counter_delta: int = 3
    crc: str = "none"
    crc_signal: str = ""
    data_id: int = 0
    data_ids: tuple[int, ...] = ()
    counter_high_signal: str = ""
    crc_high_signal: str = ""
    data_id_mode: str = "both"
    crc_start: int | None = None
    crc_xor: int | None = None
    crc_bytes: int = 0
    channel: int | None = None

    @property
    def counter_signals(self) -> tuple[str, ...]:
        """The signals of the counter, that with the lower bits first."""
        return tuple(filter(None, (self.counter_signal, self.counter_high_signal)))

    @property
    def crc_signals(self) -> tuple[str, ...]:
        """The signals of the checksum, that with the lower bits first."""
        return tuple(filter(None, (self.crc_signal, self.crc_high_signal)))
