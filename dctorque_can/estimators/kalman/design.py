"""Design numbers of the Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class KalmanDesign:
    """What the Kalman estimator is told of sensors, torques and disturbances. Noises are white; σ throughout."""

    speed_resolutions_rad_s: tuple[float, ...]  # on the bus: engine, input shafts, wheels FL, FR, RL, RR
    engine_speed_noise_rad_s: float  # of one sample, before it is rounded to the resolution
    shaft_speed_noise_rad_s: float
    wheel_speed_noise_rad_s: float  # of one wheel
    wheel_scale_error_share: float  # of all wheel speeds against the ratios; lasting
    ratio_error_share: float  # of each gear's ratio; lasting
    delay_error_s: float  # of wheel speeds against those of shafts, beyond what is told; lasting
    timing_error_s: float  # between the sample of a speed and the time of its frame
    slipping_torque_rate_nm_per_s: float  # how fast the torque of a slipping clutch changes, near lock-up
    sliding_torque_rate_nm_per_s: float  # … and far from it
    locked_torque_rate_nm_per_s: float  # … of a locked one while the engine torque changes
    steady_torque_rate_nm_per_s: float  # … of a locked one otherwise
    torque_rate_time_s: float  # for how long it keeps that rate
    settling_time_s: float  # in which the rate falls to the steady one
    open_torque_nm: float  # of an open clutch around its drag; lasting
    touch_torque_nm: float  # of a clutch that is called open, at its kissing point
    open_drag_error_nms_per_rad: float  # … and how it grows with the slip
    spin_loss_error_nm: float  # of each input shaft; lasting
    spin_loss_error_nms_per_rad: float  # … and how it grows with its speed
    road_load_rate_nm_per_sqrt_s: float
    held_load_rate_nm_per_sqrt_s: float  # … when the car stops or brakes, while the brakes change
    tyre_torque_share: float  # of a clutch torque's rate at the wheel, what the tyres' torque does beside it
    tyre_slip_stiffness: float  # force of the driven tyres by slip and load
    tyre_friction: float  # largest force of a tyre by its load
    parameter_error_share: float  # of mass, inertias and stiffnesses
    engine_torque_error_nm: float  # of the nominal engine torque, when there is none
    engine_torque_error_share: float  # … and its growth with the torque
    engine_torque_lag_s: float  # first-order lag of the engine behind its nominal torque
    engine_torque_lag_error_s: float  # … and by how much it may be another
    engine_torque_delay_s: float  # by how much it may be late
    engine_torque_error_time_s: float  # for how long it lasts
    unmodelled_rad_s_per_sqrt_s: float  # what engine and shafts do beside the model
    synchroniser_rad_s2: float  # acceleration of a shaft in neutral
    synchroniser_torque_nm: float  # largest, at the shaft
    acceleration_error_m_s2: float  # lasting, of the accelerometer and the pitch of the body
    grade_error_rad: float  # lasting
    command_error_share: float | None  # of the commanded clutch torque, where it is to be used
    command_error_nm: float  # … and its constant part
    command_lag_s: float  # of a clutch behind its command
    command_error_time_s: float  # for how long its error lasts
    inertial_error_time_s: float  # … and those of acceleration and grade
    gate_sigma: float  # a speed further from its prediction is not believed
    gate_patience_s: float  # … until it has been so for this long
