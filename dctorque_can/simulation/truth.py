"""What the simulation knows and no sensor tells: one row per millisecond."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TRUTH_PERIOD_US = 1000

TRUTH = np.dtype(
    [
        ("t_us", "i8"),  # since the start of the drive
        ("engine_speed_rad_s", "f8"),
        ("damper_speed_rad_s", "f8"),  # secondary side of the damper = driving side of both clutches
        ("shaft1_speed_rad_s", "f8"),
        ("shaft2_speed_rad_s", "f8"),
        ("output_speed_rad_s", "f8"),
        ("wheel_speed_rad_s", "f8"),  # driven wheels
        ("undriven_wheel_speed_rad_s", "f8"),  # these roll with the body
        ("clutch1_torque_nm", "f8"),  # transmitted, drag included
        ("clutch2_torque_nm", "f8"),
        ("transfer1_torque_nm", "f8"),  # T_t, in the transfer shaft, behind the gear
        ("transfer2_torque_nm", "f8"),
        ("output_torque_nm", "f8"),  # T_o, in the output shaft: after gear and final drive efficiency
        ("engine_torque_nm", "f8"),  # T_e, net, after the engine's lag
        ("engine_torque_nominal_nm", "f8"),  # T_en as the engine's own control unit knows it
        ("road_load_nm", "f8"),  # T_v at the wheel: grade, rolling resistance, air and brake
        ("grade_rad", "f8"),
        ("pedal", "f8"),  # 0..1
        ("brake_n", "f8"),  # braking force asked for, the hill holder's included
        ("clutch1_position_mm", "f8"),  # 0 open .. 10 full
        ("clutch2_position_mm", "f8"),
        ("clutch1_command_nm", "f8"),  # capacity asked for by the gearbox control
        ("clutch2_command_nm", "f8"),
        ("clutch1_capacity_nm", "f8"),  # kinetic capacity at the actual position
        ("clutch2_capacity_nm", "f8"),
        ("gear1", "i1"),  # engaged on shaft 1; 0 neutral, -1 reverse
        ("gear2", "i1"),
        ("gear1_command", "i1"),  # asked for by the gearbox control
        ("gear2_command", "i1"),
        ("changing1", "bool"),  # a synchroniser of shaft 1 is at work
        ("changing2", "bool"),
        ("phase1", "u1"),  # ClutchPhase: OPEN has no capacity, LOCKED sticks
        ("phase2", "u1"),
        # Energy ledger [J]. The two states at this instant ...
        ("kinetic_energy_j", "f8"),
        ("elastic_energy_j", "f8"),
        # ... and the flows since the start.
        ("engine_work_j", "f8"),
        ("grade_work_j", "f8"),  # against gravity
        ("clutch1_heat_j", "f8"),  # friction and drag
        ("clutch2_heat_j", "f8"),
        ("synchroniser_heat_j", "f8"),
        ("driveline_heat_j", "f8"),  # gear and final drive losses, dampers, twist lost on disengaging a gear
        ("tyre_heat_j", "f8"),
        ("road_heat_j", "f8"),  # rolling resistance, air, brake
        ("wheel_difference_rad_s", "f8"),  # half of left minus right driven wheel; wheel_speed_rad_s is their mean
    ],
    align=True,
)
"""One instant of a simulated drive. Units are in the names; torque is positive from engine to wheels."""

_HEAT = (
    "clutch1_heat_j",
    "clutch2_heat_j",
    "synchroniser_heat_j",
    "driveline_heat_j",
    "tyre_heat_j",
    "road_heat_j",
)


def energy_residual_j(truth: NDArray[np.void]) -> NDArray[np.float64]:
    """Return what the energy ledger fails to explain since the first row, ``[n]``, in joule.

    Engine work minus work against grade minus growth of kinetic and elastic energy minus all heat.
    """
    stored = truth["kinetic_energy_j"] + truth["elastic_energy_j"]
    heat = sum(truth[name] for name in _HEAT)
    balance = truth["engine_work_j"] - truth["grade_work_j"] - stored - heat
    return np.asarray(balance - balance[0], np.float64)
