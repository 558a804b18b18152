"""A clutch whose characteristic is known, and what an estimator would say of it while it slips."""

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.settings import Actuation, MapSettings
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.pipeline.samples import Quantity, Samples

TOUCH_MM, STIFFNESS, EXPONENT = 3.1, 21.0, 1.6
POSITIONS = (Quantity.CLUTCH1_POSITION, Quantity.CLUTCH2_POSITION)


def settings(sign: float = 1.0, **changes) -> MapSettings:
    clutches = tuple(Actuation(quantity, sign, sign * 3.0, 0.6, timeout_us=100_000) for quantity in POSITIONS)
    given = {
        "clutches": clutches,
        "capacity_nm": (400.0, 400.0),
        "coolant_c": (80.0, 80.0),
        "ratios": (0.0, 0.0, 10.0, *[0.0] * 14),
        "wheel_radius_m": 0.3,
        "least_slip_rad_s": 10.0,
        "max_step_back_us": 100_000,
        "period_us": 1_000_000,
    }
    return MapSettings(**given | changes)


def capacity(x_mm: NDArray[np.float64] | float, friction: float = 1.0, shift_mm: float = 0.0):
    """Return the true torque at a position, N·m."""
    return friction * STIFFNESS * np.maximum(np.asarray(x_mm) - TOUCH_MM - shift_mm, 0.0) ** EXPONENT


def rows_of(t_us, torque_nm, slip=60.0, sigma=4.0, **columns) -> NDArray[np.void]:
    """Return estimates of a car in first gear whose clutch 1 slips."""
    rows = np.zeros(len(t_us), ESTIMATE)
    rows["t_us"], rows["clutch1_torque_nm"], rows["clutch1_slip_rad_s"] = t_us, torque_nm, slip
    rows["clutch1_sigma_nm"] = rows["clutch2_sigma_nm"] = sigma
    rows["engine_speed_rad_s"], rows["gear1"], rows["phase1"] = 160.0, 1, 1
    rows["status"] = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.CONVERGED | Status.ENERGY1_KNOWN
    for name, values in columns.items():
        rows[name] = values
    return rows


def samples_of(t_us, x_mm, quantity=Quantity.CLUTCH1_POSITION) -> Samples:
    n = len(t_us)
    return Samples(
        np.array(t_us, np.int64),
        np.full(n, quantity, np.uint8),
        np.array(x_mm, np.float64),
        np.zeros(n, np.uint8),
        np.ones(n, np.bool_),
    )
