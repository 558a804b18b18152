"""The `gears:`, `clutch_phase:` and `estimator:` sections.

The design numbers of both estimators have their defaults here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.config.signals import (
    ClutchStateSection,
    CommandSection,
    FlagSection,
    GearSignalSection,
    PositionSection,
    ShiftFlagSection,
)
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.oh2014.design import Oh2014Design, RoadLoad, SubObserver
from dctorque_can.pipeline.settings import GearInference

FASTEST_POLE = 0.5  # bandwidth · step; beyond it a discrete observer no longer behaves as designed

Bandwidth = Annotated[float, Field(gt=0, le=2000)]
Seconds = Annotated[float, Field(gt=0, le=600)]
Milliseconds = Annotated[float, Field(gt=0, le=60_000)]


class GearsFromSignals(Section):
    """The gear of each shaft comes from a signal."""

    source: Literal["signals"]
    """Where the gears come from: signals, gearbox or ratio."""
    shaft1: GearSignalSection
    """Gear engaged on input shaft 1."""
    shaft2: GearSignalSection
    """Gear engaged on input shaft 2."""


class RatioSection(Section):
    """When the ratio of a shaft's speed to the driven wheels' speed says that a gear is engaged."""

    engage_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.03
    """Relative error of the ratio below which a gear counts as engaged."""
    release_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.06
    """Relative error of the ratio above which it counts as released."""
    confirm_ms: Milliseconds = 50.0
    """For how long the ratio must fit, ms."""
    min_wheel_speed_rad_s: Annotated[float, Field(gt=0)] = 3.0
    """Slower than this the last gear is kept, rad/s of the wheel."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.release_tolerance <= self.engage_tolerance:
            yield ("release_tolerance",), f"must be more than engage_tolerance ({self.engage_tolerance:g})"

    def build(self) -> GearInference:
        """Return the inference as the estimator knows it."""
        return GearInference(
            self.engage_tolerance,
            self.release_tolerance,
            microseconds(self.confirm_ms),
            self.min_wheel_speed_rad_s,
        )


class GearsFromRatio(RatioSection):
    """The gear of each shaft is inferred from the ratio of its speed to the driven wheels' speed."""

    source: Literal["ratio"]
    """Where the gears come from: signals, gearbox or ratio."""


class GearsFromGearbox(RatioSection):
    """One gear for the whole gearbox; that of the other shaft follows from ratio, target or expectation."""

    source: Literal["gearbox"]
    """Where the gears come from: signals, gearbox or ratio."""
    actual: GearSignalSection
    """The gear that drives."""
    target: GearSignalSection | None = None
    """The gear that is preselected or shifted to."""
    shift_in_progress: ShiftFlagSection | None = None
    """Flag of a shift in progress."""


class PhaseSection(Section):
    """What the kinds of clutch phase have in common."""

    slip_locked_rad_s: Annotated[float, Field(gt=0)] = 3.0
    """A closed clutch with less slip counts as locked, rad/s."""
    slip_released_rad_s: Annotated[float, Field(gt=0)] = 6.0
    """A locked clutch with more slip counts as slipping, rad/s."""
    lock_time_ms: Annotated[float, Field(ge=0, le=60_000)] = 50.0
    """For how long the slip must be small, ms."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.slip_released_rad_s <= self.slip_locked_rad_s:
            yield ("slip_released_rad_s",), f"must be more than slip_locked_rad_s ({self.slip_locked_rad_s:g})"


class PhaseFromPosition(PhaseSection):
    """A clutch is open while its actuator is before the kissing point."""

    source: Literal["position"]
    """What tells whether a clutch is open: position, flag, command, state or none."""
    clutch1: PositionSection
    """Actuator position of clutch 1."""
    clutch2: PositionSection
    """Actuator position of clutch 2."""


class PhaseFromFlag(PhaseSection):
    """A clutch is open while its flag says so."""

    source: Literal["flag"]
    """What tells whether a clutch is open: position, flag, command, state or none."""
    clutch1: FlagSection
    """Flag of clutch 1."""
    clutch2: FlagSection
    """Flag of clutch 2."""


class PhaseFromCommand(PhaseSection):
    """A clutch is open while hardly any torque is commanded."""

    source: Literal["command"]
    """What tells whether a clutch is open: position, flag, command, state or none."""
    clutch1: CommandSection
    """Commanded torque of clutch 1."""
    clutch2: CommandSection
    """Commanded torque of clutch 2."""


class PhaseFromState(PhaseSection):
    """Both clutches are open while one state for the whole gearbox says so; else each may carry torque."""

    source: Literal["state"]
    """What tells whether a clutch is open: position, flag, command, state or none."""
    both: ClutchStateSection
    """State of the clutches together."""


class PhaseFromNothing(PhaseSection):
    """Nothing says whether a clutch is open: each may carry torque, and the speeds alone say how much."""

    source: Literal["none"]
    """What tells whether a clutch is open: position, flag, command, state or none."""


GEAR_SOURCES: dict[str, type[GearsFromSignals] | type[GearsFromGearbox] | type[GearsFromRatio]] = {
    "signals": GearsFromSignals,
    "gearbox": GearsFromGearbox,
    "ratio": GearsFromRatio,
}
AnyPhase = PhaseFromPosition | PhaseFromFlag | PhaseFromCommand | PhaseFromState | PhaseFromNothing
PHASE_SOURCES: dict[str, type[AnyPhase]] = {
    "position": PhaseFromPosition,
    "flag": PhaseFromFlag,
    "command": PhaseFromCommand,
    "state": PhaseFromState,
    "none": PhaseFromNothing,
}


class Oh2014Section(Section):
    """Design numbers of the 2014 observer, from which its gains follow."""

    engine_bandwidth_rad_s: Bandwidth = 200.0
    """Double pole of the engine-side unknown input observer, s² + l_1 s + l_2/J_e, rad/s."""
    shaft_bandwidth_rad_s: Bandwidth = 200.0
    """Double pole of the clutch-side unknown input observer, s² + l_3 s + l_4/J_e1, rad/s."""
    torque_crossover_rad_s: Bandwidth = 100.0
    """Crossover L_1 = L_2: above it the transfer shaft model, below it the unknown input observers, rad/s."""
    adaptation_time_s: Seconds = 2.0
    """Convergence time of the adaptive laws, sets γ_e and γ_t, s."""
    leakage_time_s: Seconds = 0.3
    """Time in which the adaptive states forget, 1/γ_l, s."""
    acceleration_bandwidth_rad_s: Bandwidth = 100.0
    """Bandwidth of the filter that gives the wheel acceleration, rad/s, at the widest ratio step of two gears."""
    road_load_time_s: Seconds = 0.2
    """Averaging time of the learned road load, s."""
    road_load: Literal["none", "flat", "learned"] = "learned"
    """Known part of the output torque: none (the literal paper), flat (equation 11 without grade) or learned."""
    phase_gating: bool = True
    """Hold a clutch at zero before its kissing point and use the single-clutch balance for the other."""
    printed_rate_law: bool = False
    """Use both innovations in the rate of (36), as rows 1 and 2 of the paper's matrix A are printed."""
    sub_observer: Literal["full", "adaptive", "unknown_input"] = "full"
    """Which part of the observer gives the published torques: full, adaptive or unknown_input."""

    def build(self) -> Oh2014Design:
        """Return the design as the estimator knows it."""
        numbers = dict(self)
        numbers["road_load"] = RoadLoad[self.road_load.upper()]
        numbers["sub_observer"] = SubObserver[self.sub_observer.upper()]
        return Oh2014Design(**numbers)


Noise = Annotated[float, Field(gt=0, le=100)]
Rate = Annotated[float, Field(gt=0, le=1e6)]


class KalmanSection(Section):
    """What the Kalman estimator is told of sensors, torques and disturbances; standard deviations throughout."""

    engine_speed_noise_rad_s: Noise = 0.1
    """Noise of one sample of the engine speed, without the resolution of the DBC, rad/s."""
    shaft_speed_noise_rad_s: Noise = 0.1
    """Noise of one sample of an input-shaft speed, rad/s."""
    wheel_speed_noise_rad_s: Noise = 0.02
    """Noise of one sample of one wheel speed, rad/s."""
    wheel_scale_error_share: Annotated[float, Field(ge=0, le=0.2)] = 0.005
    """By how much the wheel speeds may lastingly be too large, or too small, for the ratios, as a share."""
    ratio_error_share: Annotated[float, Field(ge=0, le=0.1)] = 0.001
    """By how much the ratio of each gear may be another one, as a share, before it has been in."""
    delay_error_ms: Annotated[float, Field(ge=0, le=200)] = 3.0
    """By how much wheel speeds may lastingly come later, or sooner, than told, against those of the shafts, ms."""
    timing_error_ms: Annotated[float, Field(ge=0, le=100)] = 0.8
    """From the sample of a speed to its frame, as far as it is unknown, ms."""
    slipping_torque_rate_nm_per_s: Rate = 2500.0
    """How fast clutch torques change while a clutch slips or torque is handed over, near lock-up, N·m/s."""
    sliding_torque_rate_nm_per_s: Rate = 1500.0
    """… and while it slips by more than 12 rad/s, N·m/s."""
    locked_torque_rate_nm_per_s: Rate = 800.0
    """How fast the torque of a locked clutch changes at most with the engine torque, N·m/s."""
    steady_torque_rate_nm_per_s: Rate = 50.0
    """How fast it changes while the engine torque stays the same, N·m/s."""
    torque_rate_time_s: Annotated[float, Field(ge=0.005, le=10)] = 0.1
    """For how long a clutch torque keeps its rate, s."""
    settling_time_s: Annotated[float, Field(ge=0.01, le=10)] = 0.2
    """For how long the driveline rings after a shift or a change of engine torque, s."""
    open_torque_nm: Annotated[float, Field(gt=0, le=100)] = 1.0
    """Torque of an open clutch beside its viscous drag, N·m. It lasts, so speeds do not make it surer."""
    touch_torque_nm: Annotated[float, Field(ge=0, le=1000)] = 20.0
    """Torque that a clutch may carry at its kissing point, if it is not where it is told, N·m."""
    open_drag_error_nms_per_rad: Annotated[float, Field(ge=0, le=1)] = 0.02
    """By how much that drag may lastingly be another than ``drag_nms_per_rad``, N·m·s/rad."""
    spin_loss_error_nm: Annotated[float, Field(ge=0, le=100)] = 1.0
    """By how much the spin loss of an input shaft may lastingly be another than ``spin_loss_nm``, N·m."""
    spin_loss_error_nms_per_rad: Annotated[float, Field(ge=0, le=1)] = 0.01
    """… and its growth with the speed another than ``spin_loss_nms_per_rad``, N·m·s/rad."""
    road_load_rate_nm_per_sqrt_s: Rate = 60.0
    """How fast grade, wind and load change at the wheel, N·m/√s."""
    held_load_rate_nm_per_sqrt_s: Rate = 3000.0
    """The same when the car stops or brakes, while the brakes change, N·m/√s."""
    tyre_torque_share: Annotated[float, Field(gt=0, le=10)] = 0.04
    """What the tyres' torque does beside following the clutches, as a share of their rate at the wheel."""
    tyre_slip_stiffness: Annotated[float, Field(ge=0, le=100)] = 25.0
    """Longitudinal force of the driven tyres by slip and load, which damps the driven wheels against the car."""
    tyre_friction: Annotated[float, Field(gt=0, le=3)] = 1.1
    """Largest force of a tyre by its load, on a dry road: while driven wheels slip, any less may act."""
    parameter_error_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Error of mass, inertias and stiffnesses together, as a share."""
    engine_torque_error_nm: Annotated[float, Field(gt=0, le=1000)] = 3.0
    """Error of the nominal engine torque when it is zero, N·m."""
    engine_torque_error_share: Annotated[float, Field(ge=0, le=1)] = 0.05
    """… and by how much of the torque it grows with it."""
    engine_torque_lag_ms: Annotated[float, Field(ge=0, le=1000)] = 0.0
    """First-order lag of the engine behind the torque that the bus tells, when that is a demand, ms."""
    engine_torque_lag_error_ms: Annotated[float, Field(ge=0, le=1000)] = 60.0
    """By how much that lag may be another one, ms."""
    engine_torque_delay_ms: Annotated[float, Field(ge=0, le=1000)] = 10.0
    """By how much a change of the nominal engine torque may be late, ms."""
    engine_torque_error_time_s: Annotated[float, Field(ge=0.05, le=600)] = 1.0
    """For how long that error lasts, s."""
    unmodelled_rad_s_per_sqrt_s: Annotated[float, Field(ge=0, le=1000)] = 0.1
    """What engine and input shafts do beside the model, rad/s/√s."""
    synchroniser_rad_s2: Annotated[float, Field(gt=0, le=1e5)] = 500.0
    """Acceleration that a synchroniser gives to an input shaft in neutral, rad/s²."""
    synchroniser_torque_nm: Annotated[float, Field(ge=0, le=1000)] = 40.0
    """Largest torque of a synchroniser at its shaft, N·m: it may begin at any time while that is in neutral."""
    acceleration_error_m_s2: Annotated[float, Field(gt=0, le=10)] = 0.3
    """Lasting error of inputs.acceleration, with the pitch of the body, m/s²."""
    grade_error_rad: Annotated[float, Field(gt=0, le=0.5)] = 0.02
    """Lasting error of inputs.grade, rad."""
    command_error_share: Annotated[float, Field(ge=0, le=1)] | None = None
    """Lasting error of the clutch commands as a share of them; without, they are not used for the torques."""
    command_error_nm: Annotated[float, Field(gt=0, le=1000)] = 5.0
    """… and its constant part, N·m."""
    command_lag_ms: Annotated[float, Field(ge=1, le=1000)] = 50.0
    """Lag of a clutch behind its command, ms."""
    command_error_time_s: Annotated[float, Field(ge=0.05, le=600)] = 1.0
    """For how long the error of a clutch command lasts: at least as long as a clutch slips, s."""
    inertial_error_time_s: Annotated[float, Field(ge=0.05, le=600)] = 5.0
    """For how long the errors of acceleration and grade last, s."""
    gate_sigma: Annotated[float, Field(ge=3, le=1000)] = 5.0
    """A speed further from its prediction is not believed, in standard deviations."""
    gate_patience_s: Annotated[float, Field(ge=0.02, le=60)] = 0.5
    """… unless it moves as a shaft can, or has been there for so long, s."""

    def build(self, speed_resolutions_rad_s: tuple[float, ...]) -> KalmanDesign:
        """Return the design as the estimator knows it; resolutions of the DBC as `KalmanDesign` has them."""
        numbers = dict(self)
        names = (
            "timing_error_ms",
            "delay_error_ms",
            "engine_torque_lag_ms",
            "engine_torque_lag_error_ms",
            "engine_torque_delay_ms",
            "command_lag_ms",
        )
        timing, delay_error, engine_lag, lag_error, delay, lag = (numbers.pop(name) / 1000.0 for name in names)
        return KalmanDesign(
            speed_resolutions_rad_s=speed_resolutions_rad_s,
            timing_error_s=timing,
            delay_error_s=delay_error,
            engine_torque_lag_s=engine_lag,
            engine_torque_lag_error_s=lag_error,
            engine_torque_delay_s=delay,
            command_lag_s=lag,
            **numbers,
        )


class EstimatorSection(Section):
    """Which estimator runs, what is published how often, and when to start afresh."""

    step_ms: Annotated[float, Field(ge=0.1, le=20)] = 1.0
    """Step of the 2014 observer's time grid, ms."""
    period_ms: Milliseconds = 10.0
    """At most one estimate per this time, ms."""
    health_period_ms: Milliseconds = 1000.0
    """One health record per this time, ms."""
    max_gap_ms: Milliseconds = 500.0
    """A longer silence of all inputs resets the estimator, ms."""
    max_step_back_ms: Annotated[float, Field(ge=0, le=60_000)] = 100.0
    """A larger step of time backwards resets the estimator, ms; smaller ones are taken as late frames."""
    reorder_ms: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Frames of a log are sorted within this time, ms; default: 100 in logs of others, 0 in our own."""
    method: Literal["kalman", "oh2014"] = "kalman"
    """Which estimator runs: kalman, or oh2014, the 2014 observer."""
    oh2014: Oh2014Section = Oh2014Section()
    """Design of the 2014 observer."""
    kalman: KalmanSection = KalmanSection()
    """Design of the Kalman estimator."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        for name in ("period_ms", "health_period_ms", "max_gap_ms"):
            if getattr(self, name) < self.step_ms:
                yield (name,), f"must be at least step_ms ({self.step_ms:g})"
        fastest = FASTEST_POLE * 1000 / self.step_ms
        for name in (n for n in Oh2014Section.model_fields if n.endswith("_rad_s")):
            if getattr(self.oh2014, name) > fastest:
                reason = f"must be at most {fastest:g} rad/s for step_ms {self.step_ms:g}: {FASTEST_POLE}/step"
                yield ("oh2014", name), reason


def microseconds(milliseconds: float) -> int:
    """Return a time in whole microseconds."""
    return round(milliseconds * 1000)
