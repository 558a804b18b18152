"""Design numbers of the 2014 observer, from which its gains follow."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class RoadLoad(IntEnum):
    """Where the known part T_n of the output torque comes from (docs/observer.md)."""

    NONE = 0  # T_n = 0, the literal paper
    FLAT = 1  # equation (11) without grade
    LEARNED = 2  # torque balance while exactly one clutch carries torque, held otherwise


class SubObserver(IntEnum):
    """Which part of the observer gives the published torques."""

    FULL = 0
    ADAPTIVE = 1  # adaptive output torque observer alone
    UNKNOWN_INPUT = 2  # unknown input observers alone


@dataclass(frozen=True, slots=True)
class Oh2014Design:
    """How fast each sub-observer is. Gains are computed from these and the vehicle's inertias."""

    engine_bandwidth_rad_s: float  # double pole of s² + l_1 s + l_2/J_e
    shaft_bandwidth_rad_s: float  # double pole of s² + l_3 s + l_4/J_e1
    torque_crossover_rad_s: float  # L_1 = L_2
    adaptation_time_s: float  # convergence time that sets γ_e and γ_t
    leakage_time_s: float  # 1/γ_l
    acceleration_bandwidth_rad_s: float  # filter that gives the wheel acceleration
    road_load_time_s: float  # averaging time of the learned T_n
    road_load: RoadLoad
    phase_gating: bool  # attenuate before the kissing point and use the single-clutch balance
    printed_rate_law: bool  # both innovations in the rate of T_o used by (36), as rows 1 and 2 of A are printed
    sub_observer: SubObserver
