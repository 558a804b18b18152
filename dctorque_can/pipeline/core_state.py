"""The records of the loop in `core`: its rules, which never change, and its state."""

from __future__ import annotations

import numpy as np

from dctorque_can.driveline import phase_decision
from dctorque_can.pipeline.samples import N_QUANTITIES

NEVER = phase_decision.NEVER

RULES = np.dtype(
    [
        ("minimum", "f8", (N_QUANTITIES,)),
        ("maximum", "f8", (N_QUANTITIES,)),
        ("timeout_us", "i8", (N_QUANTITIES,)),
        ("delay_us", "i8", (N_QUANTITIES,)),
        ("longest_delay_us", "i8"),
        ("mapped", "u1", (N_QUANTITIES,)),
        ("step_us", "i8"),
        ("estimate_period_us", "i8"),
        ("health_period_us", "i8"),
        ("max_gap_us", "i8"),
        ("max_step_back_us", "i8"),
        ("settling_us", "i8"),
        ("learning_us", "i8"),
        ("driven_axle", "i8"),
        ("infer_gears", "?"),
        ("engage_tolerance", "f8"),
        ("release_tolerance", "f8"),
        ("confirm_us", "i8"),
        ("min_wheel_speed", "f8"),
        ("phase_source", "i8", (2,)),
        ("closed_above", "f8", (2,)),  # positions and commands, in the direction of closing
        ("open_below", "f8", (2,)),
        ("closing_sign", "f8", (2,)),
        ("slip_locked", "f8"),
        ("slip_released", "f8"),
        ("lock_time_us", "i8"),
        ("torque_limit", "f8", (2,)),
        ("output_limit", "f8"),
        ("method", "i8"),  # Method
        ("sub_observer", "i8"),
        ("learns", "?"),  # the road load is learned
        ("heats", "u1", (2,)),  # the vehicle file has the clutch's thermal data
        ("heat_capacity", "f8", (2,)),  # J/K
        ("cooling", "f8", (2,)),  # W/K
        ("coolant", "f8", (2,)),  # °C
    ],
    align=True,
)
"""What the loop must know besides the observer's constants."""

CORE = np.dtype(
    [
        ("t_us", "i8"),  # time of the grid; NEVER before the first sample
        ("origin_us", "i8"),  # where the grid and all periods begin, so that only differences of time matter
        ("value", "f8", (N_QUANTITIES,)),
        ("seen_us", "i8", (N_QUANTITIES,)),
        ("available", "u1", (N_QUANTITIES,)),
        ("stale", "u1", (N_QUANTITIES,)),
        ("fresh", "u1", (N_QUANTITIES,)),  # renewed by the frame at hand
        ("frame_ok", "?"),  # the frame at hand has a usable sample
        ("running", "?"),  # the observer has been started
        ("reset_us", "i8"),
        ("learned_us", "i8"),  # how long the road load has been learned since the start
        ("settled_us", "i8"),  # when the torques were last drawn to the unknown input estimates
        ("engine_us", "i8"),  # time of the last correction by each speed
        ("shaft_us", "i8", (2,)),
        ("wheel_us", "i8"),
        ("w_c", "f8", (2,)),  # shaft speeds, carried on between their frames by the model
        ("w_c_last", "f8", (2,)),  # … as they were at the last use in (36)
        ("twist_us", "i8"),  # when the shafts were last compared; NEVER: not since the gears changed
        ("gear", "i8", (2,)),
        ("gear_known", "u1", (2,)),
        ("gear_candidate", "i8", (2,)),
        ("candidate_us", "i8", (2,)),
        ("closed", "u1", (2,)),
        ("closed_known", "u1", (2,)),
        ("phase", "u1", (2,)),
        ("slip_small_us", "i8", (2,)),  # since when the slip is small
        ("implausible_us", "i8"),  # since when shaft and wheel speed disagree, NEVER if they agree
        ("wheels", "i8"),  # which wheels gave the acceleration last, one bit each
        ("apart", "?"),  # two clutch torques had to be told apart by (65), (66)
        ("estimate_us", "i8"),
        ("health_us", "i8"),
        ("status", "u4"),
    ],
    align=True,
)
"""State of the loop, apart from the observer's."""
