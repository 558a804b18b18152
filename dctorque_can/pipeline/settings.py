"""Everything the estimator core must know besides the samples."""

from __future__ import annotations

from dataclasses import dataclass

from dctorque_can.driveline.parameters import DrivenAxle, Vehicle
from dctorque_can.driveline.phases import PhaseSettings
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.methods import Method
from dctorque_can.estimators.oh2014.design import Oh2014Design
from dctorque_can.pipeline.samples import Input


@dataclass(frozen=True, slots=True)
class GearInference:
    """Gear of a shaft from its speed ratio to the driven wheels, with hysteresis."""

    engage_tolerance: float  # relative error of the ratio below which a gear counts as engaged
    release_tolerance: float  # … above which it counts as released
    confirm_us: int  # for how long
    min_wheel_speed_rad_s: float  # slower than this the last gear is kept


@dataclass(frozen=True, slots=True)
class OneGear:
    """One gear signal for the whole gearbox; the gear of the other shaft follows by `pipeline.one_gear`."""

    by_ratio: GearInference  # of a shaft whose speed is known


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of one estimator core."""

    vehicle: Vehicle
    inputs: tuple[Input, ...]
    phases: PhaseSettings
    gear_inference: GearInference | None  # None: gears come from signals
    method: Method
    observer: Oh2014Design
    kalman: KalmanDesign
    driven_axle: DrivenAxle
    step_us: int  # internal grid
    estimate_period_us: int  # at most one estimate per this time
    health_period_us: int
    max_gap_us: int  # a longer silence resets the observer
    max_step_back_us: int  # a larger step back in time resets the observer
    one_gear: OneGear | None = None  # instead of a gear of each shaft
    direction_measured: bool = False  # the direction that the bus tells is not taken from gear or lever
