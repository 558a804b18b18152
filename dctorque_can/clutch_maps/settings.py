"""What learning a clutch's map needs to know of a car, and the numbers that decide how it learns."""

from __future__ import annotations

from dataclasses import dataclass

from dctorque_can.pipeline.samples import Quantity

NODES = 24
"""Of a grid: with the span doubling as the range grows, 12 to 24 of them are in the range seen."""


@dataclass(frozen=True, slots=True)
class Actuation:
    """The quantity that closes one clutch; "unit" is that of the bus.

    Attributes:
        quantity: a position (or pressure), or a commanded torque.
        closing_sign: 1 if larger values close the clutch, −1 if smaller ones do.
        touch_point: where the vehicle file has it, unit.
        touch_error: by how much that may be wrong, unit, positive.
        timeout_us: age at which a value is stale.
        delay_us: from when a value is taken to the time of its frame.
    """

    quantity: Quantity
    closing_sign: float
    touch_point: float
    touch_error: float
    timeout_us: int
    delay_us: int = 0


@dataclass(frozen=True, slots=True)
class MapSettings:
    """Everything that learning needs besides rows and samples.

    Attributes:
        clutches: how each clutch is actuated; None: nothing tells, no map.
        coolant_c: temperature that each clutch begins with, °C.
        ratios: by gear number + 1, from input shaft to wheel; 0 where there is no such gear.
        wheel_radius_m: of the driven wheels.
        period_us: between two rows of the maps.
        capacity_nm: of each clutch by the vehicle file, the scale of its torques.
        least_slip_rad_s: slower than this a clutch may stick, and carries less than it could.
        max_step_back_us: a larger step back in time is a clock set anew.
        used: whether a kept map becomes a weak measurement of the torques.
        torque_error_nm: of the nominal engine torque, which may last for ever …
        torque_error_share: … and the part that grows with the torque.
        friction_drift_per_sqrt_h: by how much the friction may change in an hour, as a share.
        touch_drift_per_sqrt_h: by how much the touch point may move in an hour, in parts of its error.
        shape_drift_per_sqrt_h: by how much the shape of the map may change in an hour, as a share of its prior σ.
        least_samples: independent estimates that make a node valid.
        largest_sigma_share: of the capacity, up to which a node is valid.
        node_speed_nm_s: by how much the published value of a node may move in a second of slipping, N·m/s.
    """

    clutches: tuple[Actuation | None, Actuation | None]
    capacity_nm: tuple[float, float]
    coolant_c: tuple[float, float]
    ratios: tuple[float, ...]
    wheel_radius_m: float
    least_slip_rad_s: float
    max_step_back_us: int
    period_us: int = 10_000_000
    used: bool = False
    torque_error_nm: float = 3.0
    torque_error_share: float = 0.05
    friction_drift_per_sqrt_h: float = 0.25
    touch_drift_per_sqrt_h: float = 3.5
    shape_drift_per_sqrt_h: float = 0.01
    least_samples: float = 2.0
    largest_sigma_share: float = 0.1
    node_speed_nm_s: float = 40.0
