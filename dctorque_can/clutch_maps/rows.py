"""One row of a clutch's map, as it is logged and sent."""

from __future__ import annotations

import numpy as np

from dctorque_can.clutch_maps.settings import NODES

RESIDUALS_NM = (50.0, 75.0, 125.0, 200.0, 300.0)
"""Torques at which residuals are told; each observation counts at the nearest one by ratio."""
ENERGIES_J = (1e3, 5e3, 20e3, 50e3)
"""Limits between classes of engagements by their energy."""
TEMPERATURES_C = (100.0, 150.0, 200.0, 250.0, 300.0)
"""Limits between classes of temperature."""

CLUTCH_MAP = np.dtype(
    [
        ("t_us", "i8"),
        ("actuation", "f8", (NODES,)),  # of the nodes, in the unit of the bus
        ("capacity_nm", "f8", (NODES,)),  # of now: rising, and moved no faster than may be
        ("sigma_nm", "f8", (NODES,)),
        ("raw_nm", "f8", (NODES,)),  # as learned
        ("samples", "f8", (NODES,)),  # independent estimates that each node has seen
        ("residual_nm", "f8", (len(RESIDUALS_NM),)),  # estimate minus map, mean at each of `RESIDUALS_NM`
        ("residual_rms_nm", "f8", (len(RESIDUALS_NM),)),
        ("temperature_s", "f8", (len(TEMPERATURES_C) + 1,)),  # time in each class of `TEMPERATURES_C`
        ("touch_point", "f8"),  # unit of the bus; NaN: not known, likewise below
        ("touch_sigma", "f8"),
        ("touch_first", "f8"),  # when it was first known
        ("touch_least", "f8"),
        ("touch_most", "f8"),
        ("touch_per_1000_km", "f8"),  # by how much it drifts: regression over the distance
        ("slope_nm_per_unit", "f8"),  # where the clutch carries a fifth of its capacity
        ("slope_sigma", "f8"),
        ("hysteresis", "f8"),  # unit: actuation of closing minus that of opening, at one torque
        ("hysteresis_sigma", "f8"),
        ("lag_s", "f8"),  # by which the actuation is later in the torque
        ("lag_sigma_s", "f8"),
        ("friction", "f8"),  # health index: over that when the map was begun, cold
        ("friction_sigma", "f8"),
        ("friction_least", "f8"),
        ("friction_most", "f8"),
        ("friction_by_heat", "f8"),  # change by 100 K, or by 100 kJ stored where no temperature is known
        ("friction_by_heat_sigma", "f8"),
        ("friction_by_slip", "f8"),  # change by an e-fold of the slip
        ("friction_by_slip_sigma", "f8"),
        ("seen_least", "f8"),  # actuations that taught
        ("seen_most", "f8"),
        ("slipped_s", "f8"),  # that taught
        ("energy_j", "f8"),  # all friction work
        ("distance_km", "f8"),
        ("taken", "u4"),  # observations that taught
        ("refused", "u4"),  # … and beyond the gate
        ("engagements", "u4", (len(ENERGIES_J) + 1,)),  # in each class of `ENERGIES_J`
        ("valid", "u1", (NODES,)),  # of the nodes
        ("clutch", "u1"),  # 1 or 2
        ("touch_valid", "u1"),
        ("friction_valid", "u1"),
        ("restored", "u1"),  # begun from a kept state
    ],
    align=True,
)
"""Cumulative since the map was begun, which may have been many drives ago."""
