"""What the core gives: rows of estimates and of health, as structured numpy arrays."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import GEARS
from dctorque_can.pipeline.samples import N_QUANTITIES
from dctorque_can.plausibility.findings import N_FINDINGS


class Status(IntFlag):
    """Bits of ``status`` of an estimate."""

    CLUTCH1_VALID = 1
    CLUTCH2_VALID = 2
    OUTPUT_VALID = 4
    GEARS_KNOWN = 8
    PHASES_KNOWN = 16
    ROAD_LOAD_LEARNED = 32
    CONVERGED = 64  # enough time has passed since the last reset
    INPUT_STALE = 128  # an input is older than its timeout, or a required one was never there
    SPEED_IMPLAUSIBLE = 256  # e.g. shaft speed does not fit gear and wheel speed
    LIMITED = 512  # an estimate hit its plausibility limit
    ENERGY1_KNOWN = (
        1024  # the engagement of clutch 1 has been seen from its beginning, with a valid torque all along
    )
    ENERGY2_KNOWN = 2048
    RESIDUAL1_KNOWN = 4096  # clutch 1 slips and its command is fresh
    RESIDUAL2_KNOWN = 8192
    TEMPERATURE1_KNOWN = 16384  # the vehicle file has the thermal data of clutch 1, and the estimator runs
    TEMPERATURE2_KNOWN = 32768
    TIE_UP_KNOWN = 65536  # the probability of a tie-up: the method states standard deviations
    # the Kalman estimator does without a signal: it is missing, stuck, biased, or jumps
    ENGINE_SPEED_FAULT = 1 << 17
    SHAFT1_SPEED_FAULT = 1 << 18
    SHAFT2_SPEED_FAULT = 1 << 19
    DRIVEN_WHEELS_FAULT = 1 << 20
    UNDRIVEN_WHEELS_FAULT = 1 << 21
    ENGINE_TORQUE_FAULT = 1 << 22
    VEHICLE_FILE_IMPLAUSIBLE = 1 << 23  # what the car does contradicts the vehicle file: see findings in HEALTH
    TRANSMISSION_TORQUE_KNOWN = 1 << 24  # the transmission tells a torque, and just one clutch can carry one


ESTIMATE = np.dtype(
    [
        ("t_us", "i8"),
        ("clutch1_torque_nm", "f8"),  # after attenuation
        ("clutch2_torque_nm", "f8"),
        ("output_torque_nm", "f8"),  # (31), from the clutch torques, after efficiency
        ("output_torque_adaptive_nm", "f8"),  # T_n + τ_o dω_w/dt, (47)
        ("clutch1_sigma_nm", "f8"),  # standard deviations of the three torques
        ("clutch2_sigma_nm", "f8"),
        ("output_sigma_nm", "f8"),
        ("clutch_correlation", "f8"),  # of the errors of both clutch torques, −1 … 1
        ("clutch1_torque_uio_nm", "f8"),  # (65)
        ("clutch2_torque_uio_nm", "f8"),  # (66)
        ("clutch_torque_sum_nm", "f8"),  # T_c of (59), (60), or the sum of both
        ("engine_torque_nm", "f8"),  # corrected: T_en + ω_e τ_e, or the filter's
        ("road_load_nm", "f8"),  # T_n, or T_v
        ("engine_speed_rad_s", "f8"),
        ("clutch1_slip_rad_s", "f8"),  # ω_e - ω_c1
        ("clutch2_slip_rad_s", "f8"),
        ("wheel_acceleration_rad_s2", "f8"),
        ("clutch1_power_w", "f8"),  # |torque · slip| while the clutch slips
        ("clutch2_power_w", "f8"),
        ("clutch1_energy_j", "f8"),  # of the present engagement, or of the last one
        ("clutch2_energy_j", "f8"),
        ("clutch1_heat_j", "f8"),  # all friction work since the start
        ("clutch2_heat_j", "f8"),
        ("clutch1_residual_nm", "f8"),  # transmitted minus commanded torque
        ("clutch2_residual_nm", "f8"),
        ("clutch1_temperature_c", "f8"),
        ("clutch2_temperature_c", "f8"),
        ("recirculated_torque_nm", "f8"),  # what one clutch drives and the other takes back
        ("tie_up_probability", "f8"),
        ("transmission_torque_nm", "f8"),  # what the transmission believes of the clutch that drives
        ("clutch1_engagements", "u4"),  # since the start
        ("clutch2_engagements", "u4"),
        ("gear1", "i1"),
        ("gear2", "i1"),
        ("phase1", "u1"),  # ClutchPhase
        ("phase2", "u1"),
        ("status", "u4"),  # Status
    ],
    align=True,
)
"""One estimate. Units are in the names. Every float is finite, but for `ONLY_KALMAN` and `ONLY_OH2014`: the
columns of another method than the chosen one are NaN, not known."""

ONLY_KALMAN = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm", "clutch_correlation")
ONLY_OH2014 = ("output_torque_adaptive_nm", "clutch1_torque_uio_nm", "clutch2_torque_uio_nm")

SENSORS = ("engine", "shaft1", "shaft2", "driven_wheels", "undriven_wheels")
"""The speeds that the Kalman filter measures, in the order of its innovations."""

HEALTH = np.dtype(
    [
        ("t_us", "i8"),
        ("age_us", "i8", (N_QUANTITIES,)),  # per Quantity; -1: never seen
        ("innovations", "i8", (len(SENSORS),)),  # speeds but zeros that the filter took; 0: the 2014 observer
        ("innovation_squares", "f8", (len(SENSORS),)),  # … and the sum of their normalised innovations squared
        ("innovations_rejected", "i8", (len(SENSORS),)),  # speeds beyond its gate
        ("speed_noise_told_rad_s", "f8", (len(SENSORS),)),  # noise of one sample as configured, …
        ("speed_noise_rad_s", "f8", (len(SENSORS),)),  # … as learned from all samples
        ("speed_noise_samples", "f8", (len(SENSORS),)),  # … and how many these are; 0: the 2014 observer
        ("engine_torque_gain_error", "f8"),  # learned share that the engine's torque is above the nominal one, …
        ("engine_torque_gain_sigma", "f8"),  # its standard deviation, 0 with the 2014 observer
        ("engine_torque_lag_error_s", "f8"),  # … and time that it is behind it, beyond the configured one
        ("engine_torque_lag_sigma_s", "f8"),
        ("wheel_scale_error", "f8"),  # learned share that wheels are told too fast, as ratios have it
        ("wheel_scale_sigma", "f8"),
        ("wheels_late_s", "f8"),  # … and time that they come later than told, against the shafts
        ("wheels_late_sigma_s", "f8"),
        ("gear_ratio_error", "f8", (GEARS,)),  # … and share that the ratio of each gear is larger than that of the
        ("gear_ratio_sigma", "f8", (GEARS,)),  # median of all that have been in, by gear number + 1; 0: not yet
        ("accepted", "i8", (N_QUANTITIES,)),  # samples since the start, likewise below: no year makes them wrap
        ("not_available", "i8", (N_QUANTITIES,)),
        ("out_of_range", "i8", (N_QUANTITIES,)),
        ("bad_length", "i8", (N_QUANTITIES,)),
        ("bad_crc", "i8", (N_QUANTITIES,)),
        ("bad_counter", "i8", (N_QUANTITIES,)),
        ("not_believed", "i8", (N_QUANTITIES,)),
        ("bad_rate", "i8", (N_QUANTITIES,)),
        ("timeouts", "i8", (N_QUANTITIES,)),  # times an input went stale
        ("late_frames", "i8"),  # older than the grid, taken at the grid's time
        ("gap_resets", "i8"),
        ("clock_resets", "i8"),
        ("numeric_resets", "i8"),  # a state was no number any more
        ("status", "u4"),  # Status of the last estimate
        ("findings", "u4"),  # plausibility.findings.Finding that stand
        ("findings_strong", "u4"),  # of these, those for which no torque is valid
        ("findings_ever", "u4"),  # that have stood since the start
        ("finding_gear", "i4"),  # that the last finding about a gear means
        ("finding_measured", "f8", (N_FINDINGS,)),  # the number in the sentence of each
    ],
)
"""One health record, cumulative since the start."""


@dataclass(frozen=True, slots=True)
class Estimates:
    """What one call of ``feed`` gave.

    Attributes:
        rows: `ESTIMATE` ``[n]`` in order of time.
        health: `HEALTH` ``[m]``, one per health period that ended in the batch.
    """

    rows: NDArray[np.void]
    health: NDArray[np.void]

    def __len__(self) -> int:
        return len(self.rows)
