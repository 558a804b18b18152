"""All signals of a recording at the same moments, a hundredth of a second apart, and what the car does at each."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from dctorque_can.driveline.parameters import DrivenAxle, Vehicle
from dctorque_can.evidence.series import UNKNOWN_GEAR, Floats, Series
from dctorque_can.pipeline.samples import Quantity

Mask = NDArray[np.bool_]
STEP_S = 0.01
SMOOTH_S = 0.06
"""Standard deviation of the smoothing: six samples of a production bus, a tenth of a shift."""
STEADY_S = 0.5
"""A gear counts when it has been in for so long: the synchroniser and the swing after it are over."""
ROLLS_RAD_S = 8.0
"""Wheels must turn so fast for a ratio: noise and resolution are then some tenths of a percent."""
LOCKED_SHARE, LOCKED_RAD_S = 0.005, 2.0
"""Slip of a locked clutch is less than this: resolution, noise, and some milliseconds of delay."""
LOCKED_S = 0.3
CONSTANT_RATE = 0.03
"""A ratio that changes by less than this share in a second is that of a gear, or soon shows that it is not."""
NEAR_SHARE = 0.2
"""A gear is near within this (natural logarithm): neighbouring gears of one shaft are 50 % apart."""
RUNS_RAD_S = 40.0
"""A slower engine does not run on its own."""
WHEELS = (Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_FR, Quantity.WHEEL_SPEED_RL, Quantity.WHEEL_SPEED_RR)
SHAFTS = (Quantity.SHAFT1_SPEED, Quantity.SHAFT2_SPEED)


def smooth(values: Floats, sigma_s: float = SMOOTH_S) -> Floats:
    """Return values ``[n]`` smoothed by a Gaussian; not-a-number is where it reaches."""
    return np.asarray(gaussian_filter1d(values, sigma_s / STEP_S, truncate=3.0), np.float64)


def rate(values: Floats, sigma_s: float = SMOOTH_S) -> Floats:
    """Return the rate of values ``[n]``, per second, smoothed alike."""
    return np.asarray(gaussian_filter1d(values, sigma_s / STEP_S, order=1, truncate=3.0) / STEP_S, np.float64)


def change(values: Floats, half_s: float) -> Floats:
    """Return by how much values ``[n]`` change from ``half_s`` before to as much after; NaN at the ends."""
    n = round(half_s / STEP_S)
    found = np.full(len(values), np.nan)
    found[n:-n] = values[2 * n :] - values[: -2 * n]
    return found


def lasting(mask: Mask, before_s: float, after_s: float = 0.0) -> Mask:
    """Return where a mask ``[n]`` has held for a time and will hold for another one."""
    missing = np.cumsum(np.concatenate([[0], ~mask]))
    here = np.arange(len(mask))
    first = np.maximum(here - round(before_s / STEP_S), 0)
    last = np.minimum(here + round(after_s / STEP_S) + 1, len(mask))
    return np.asarray(missing[last] == missing[first], np.bool_)


@dataclass(frozen=True)
class Moments:
    """A recording on one grid of times; everything ``[n]``, not-a-number where it is not known.

    Attributes:
        series: the recording.
        t_s: times, s.
        driven: the axle that counts as driven.
    """

    series: Series
    t_s: Floats
    driven: DrivenAxle
    _known: dict[Quantity, Floats] = field(default_factory=dict)

    @property
    def vehicle(self) -> Vehicle:
        """What the vehicle file says of the car."""
        return self.series.config.settings.vehicle

    def has(self, *quantities: Quantity) -> bool:
        """Return whether all of these are measured."""
        return all(quantity in self.series.signals for quantity in quantities)

    def speed(self, quantity: Quantity) -> Floats:
        """Return a measured value."""
        if quantity not in self._known:
            self._known[quantity] = self.series.on(quantity, self.t_s)
        return self._known[quantity]

    @cached_property
    def engine(self) -> Floats:
        """Engine speed, rad/s."""
        return self.speed(Quantity.ENGINE_SPEED)

    @cached_property
    def torque(self) -> Floats:
        """Engine torque, N·m."""
        return self.speed(Quantity.ENGINE_TORQUE)

    def axle(self, front: bool) -> Floats:
        """Return the mean speed of the measured wheels of one axle, rad/s."""
        wheels = [self.speed(each) for each in (WHEELS[:2] if front else WHEELS[2:]) if self.has(each)]
        return np.asarray(np.mean(wheels, axis=0), np.float64) if wheels else np.full(len(self.t_s), np.nan)

    def measures(self, front: bool) -> bool:
        """Return whether a wheel of an axle is measured."""
        return any(self.has(each) for each in (WHEELS[:2] if front else WHEELS[2:]))

    @property
    def driven_fronts(self) -> list[bool]:
        """The driven axles that are measured, as ``front``; the others where none is."""
        wanted = {DrivenAxle.FRONT: [True], DrivenAxle.REAR: [False]}.get(self.driven, [True, False])
        measured = [front for front in (True, False) if self.measures(front)]
        return [front for front in wanted if front in measured] or measured

    @property
    def measures_driven(self) -> bool:
        """Whether a driven wheel is measured."""
        return self.driven is DrivenAxle.ALL or self.measures(self.driven is DrivenAxle.FRONT)

    @cached_property
    def wheels(self) -> Floats:
        """Mean speed of the driven wheels, rad/s; of the others where none of them is measured."""
        return np.asarray(np.mean([self.axle(front) for front in self.driven_fronts], axis=0), np.float64)

    @cached_property
    def body(self) -> Floats:
        """Speed of the wheels that are not driven, rad/s; of all where there are none."""
        others = [front for front in (True, False) if self.measures(front) and front not in self.driven_fronts]
        return self.axle(others[0]) if others else self.wheels

    @property
    def knows_body(self) -> bool:
        """Whether a wheel is measured that is not driven."""
        return self.driven is not DrivenAxle.ALL and self.measures(self.driven is DrivenAxle.REAR)

    @cached_property
    def gear(self) -> NDArray[np.int64]:
        """Gear of each shaft ``[2, n]``: as it is told, or by its ratio where the file wants that."""
        if self.series.config.settings.gear_inference is not None:
            return np.stack([self.gear_by_ratio(shaft, self.wheels) for shaft in (1, 2)])
        return np.stack([self.series.gears(shaft, self.t_s) for shaft in (1, 2)])

    def gear_by_ratio(self, shaft: int, wheels: Floats) -> NDArray[np.int64]:
        """Return the forward gear of a shaft that its speed is nearest to, while it turns with wheels ``[n]``."""
        found = np.full(len(self.t_s), UNKNOWN_GEAR)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.log(smooth(np.abs(self.speed(SHAFTS[shaft - 1]))) / smooth(np.abs(wheels)))
        fixed = lasting(np.abs(rate(ratio)) < CONSTANT_RATE, 0.3, 0.1)
        for gear in self.vehicle.gears_on(shaft):
            near = np.abs(ratio - np.log(abs(gear.total_ratio))) < NEAR_SHARE
            found[fixed & near & (gear.number > 0)] = gear.number
        return found

    @cached_property
    def ratio(self) -> Floats:
        """Total ratio of the gear that has been in for long on each shaft ``[2, n]``; 0 where none has."""
        found = np.zeros((2, len(self.t_s)))
        for gear in self.vehicle.gears:
            held = lasting(self.gear[gear.shaft - 1] == gear.number, STEADY_S, 0.2)
            found[gear.shaft - 1, held] = gear.total_ratio if gear.number > 0 else 0.0
        return found

    @cached_property
    def shaft(self) -> Floats:
        """Speed of each input shaft ``[2, n]``, rad/s: measured, or by gear and wheels where it is not."""
        found = []
        for i, quantity in enumerate(SHAFTS):
            if self.has(quantity):
                found.append(self.speed(quantity))
            else:
                found.append(np.where(self.ratio[i] > 0.0, self.ratio[i] * self.wheels, np.nan))
        return np.stack(found)

    @cached_property
    def locked(self) -> Mask:
        """Where engine and shaft have turned alike for long, and their speed is high enough ``[2, n]``."""
        found = []
        for i in range(2):
            slip = np.abs(smooth(self.engine - self.shaft[i]))
            together = slip < LOCKED_RAD_S + LOCKED_SHARE * np.abs(self.engine)
            found.append(lasting(together & (self.engine > RUNS_RAD_S), LOCKED_S, 0.1))
        return np.stack(found)

    @cached_property
    def closed_told(self) -> NDArray[np.int64]:
        """What is told of each clutch ``[2, n]``: 1 can carry torque, 0 is open, -1 nothing is told."""
        by = np.stack([self.series.closes_by(clutch, self.t_s) for clutch in (1, 2)])
        return np.where(np.isnan(by), -1, by > 0.0).astype(np.int64)

    @cached_property
    def neutral(self) -> Mask:
        """Where a shaft is told to have no gear ``[2, n]``."""
        return np.asarray(self.gear == 0, np.bool_)

    @cached_property
    def free(self) -> Mask:
        """Where no brake is on and none was lately; without a signal of it, while the car gathers speed."""
        if not self.has(Quantity.BRAKE):
            return np.asarray(rate(self.body, 0.2) > 0.0, np.bool_)
        told = self.series.told(Quantity.BRAKE, self.t_s)
        return lasting(told <= 0.0, 0.6, 0.2)

    @cached_property
    def rolls(self) -> Mask:
        """Where the wheels turn fast enough for a ratio, forwards."""
        return np.asarray((self.wheels > ROLLS_RAD_S) & (self.gear[0] != -1) & (self.gear[1] != -1), np.bool_)

    @property
    def tells_gears(self) -> bool:
        """Whether any signal tells a gear."""
        return bool((self.gear != UNKNOWN_GEAR).any())


def moments(series: Series, driven: DrivenAxle | None = None) -> Moments:
    """Return a recording at moments from its begin to its end.

    Args:
        series: the recording.
        driven: the driven axle; None: as the vehicle file says.
    """
    t_s = np.arange(0.0, max(series.seconds, STEP_S), STEP_S)
    return Moments(series, t_s, series.config.settings.driven_axle if driven is None else driven)
