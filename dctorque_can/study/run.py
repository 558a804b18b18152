"""One run: a true car is simulated, the estimators see its frames and believe in the nominal one."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.comparison import Figures, judge
from dctorque_can.analysis.consistency import nis
from dctorque_can.analysis.errors import TORQUES, compare
from dctorque_can.chain import Chain
from dctorque_can.config.load import load_documents
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.offline.bound import BoundChain
from dctorque_can.offline.simulated_car import DriveName, ProfileName, drive_of, sensors_of
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.simulation.sensors import emit_frames
from dctorque_can.study.code import SIMULATION, code
from dctorque_can.study.draw import noise_seed
from dctorque_can.study.factors import Car, varied
from dctorque_can.study.kept import kept
from dctorque_can.study.plan import Study

Record = dict[str, Any]
"""One line of results: ``run``, ``factors``, and either ``error``, or ``rms``, ``bias``, ``peak`` and ``valid`` of
the configured method, and ``estimators``: by name what `_figures` says of all estimates (``all``) and of those
within shifts (``shifts``, or None), and NIS by sensor (``sensors``).
"""

BOUND = "bound"
ESTIMATORS = ("oh2014", "kalman", BOUND)
"""Both methods, and the Kalman filter that is told the true car, gears and phases."""

_BATCH = 100_000
JUDGED = np.dtype(
    [
        ("t_us", "i8"),
        *((field, "f8") for field in TORQUES.values()),
        ("gear1", "i1"),
        ("gear2", "i1"),
        ("phase1", "u1"),
        ("phase2", "u1"),
    ]
)
_ROLLED_BACK_M_S = 0.5
_GOT_AWAY_M_S = 1.0


@dataclass(frozen=True, slots=True)
class Setup:
    """What every process of a study is given; it can be pickled.

    Attributes:
        documents: vehicle file, DBCs and overrides, `Config.documents`.
        drive: what is driven.
        duration_s: how long, None for the drive's own length.
        profile: how the car measures and sends.
        seed: of the study.
        drives: folder in which simulated drives are kept, or None.
    """

    documents: Mapping[str, bytes]
    drive: DriveName
    duration_s: float | None
    profile: ProfileName
    seed: int
    drives: Path | None = None

    @classmethod
    def of(cls, study: Study, drives: Path | None = None) -> Setup:
        """Return the setup of a study."""
        plan = study.plan
        drive, profile = DriveName(plan.drive), ProfileName(plan.profile)
        return cls(study.config.documents, drive, plan.duration_s, profile, plan.seed, drives)

    def bench(self) -> Bench:
        """Return what makes the runs."""
        return Bench(self)


class Bench:
    """Makes runs; what run k gives depends on the setup, on k and on the values of its factors only."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._config = load_documents(setup.documents)
        self._methods = {
            name: load_documents(setup.documents, {"estimator.method": name})
            for name in ESTIMATORS
            if name != BOUND
        }
        self.nominal = Car(
            vehicle=self._config.settings.vehicle,
            powertrain=DEMO_POWERTRAIN,
            sensors=sensors_of(self._config, setup.profile, seed=0),
            drive=drive_of(self._config, setup.drive, setup.seed, setup.duration_s),
        )

    def warm_up(self) -> None:
        """Compile everything, or load it where it is compiled already."""
        Chain(self._config).warm_up()
        truth = simulate(self.nominal.vehicle, replace(self.nominal.drive, duration_s=0.1))
        emit_frames(
            truth,
            self.nominal.vehicle,
            self.nominal.sensors,
            self._config.database,
            addresses=self._config.addresses,
        )

    def run(self, number: int, values: Mapping[str, float]) -> Record:
        """Return errors of the estimates of one car, or why there are none."""
        record: Record = {"run": number, "factors": dict(values)}
        car = varied(self.nominal, values)
        car = replace(car, sensors=replace(car.sensors, seed=noise_seed(self._setup.seed, number)))
        try:
            return record | self._errors(car)
        except DctorqueError as error:
            return record | {"error": str(error)}

    def _errors(self, car: Car) -> Record:
        frames, truth = kept(self._setup.drives, self._key(car), lambda: self._drive(car))
        estimators: dict[str, Any] = {}
        record: Record = {}
        for name in ESTIMATORS:
            if name == BOUND:
                chain: Chain | BoundChain = BoundChain(self._config, _loaded(car), truth)
            else:
                chain = Chain(self._methods[name])
            rows = np.concatenate(
                [chain.feed(frames[start : start + _BATCH]).rows for start in range(0, len(frames), _BATCH)]
            )
            found = judge([(rows, truth)], lag=False)
            estimators[name] = {
                "all": _figures(found.everything),
                "shifts": None if found.shifts is None else _figures(found.shifts),
                "sensors": {
                    sensor: {"samples": one.samples, "rejected": one.rejected, "nis": one.mean}
                    for sensor, one in nis(chain.health).items()
                },
            }
            if name != BOUND and self._methods[name].settings.method == self._config.settings.method:
                errors = compare(rows, truth)
                both = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
                record = {
                    kind: {torque: getattr(e, kind) for torque, e in errors.items()}
                    for kind in ("rms", "bias", "peak")
                } | {"valid": float(np.mean((rows["status"] & both) == both))}
        return record | {"estimators": estimators}

    def _drive(self, car: Car) -> tuple[Frames, NDArray[np.void]]:
        """Simulate a car; return its frames, and of the truth what estimates are held against."""
        truth = simulate(car.vehicle, car.drive, car.powertrain)
        check_drive(truth, car.vehicle.chassis.wheel_radius_m)
        # The wheel signals are made with the radius of the nominal car: control units have it coded.
        frames = emit_frames(
            truth, self.nominal.vehicle, car.sensors, self._config.database, addresses=self._config.addresses
        )
        return frames, judged(truth)

    def _key(self, car: Car) -> str:
        """Return what frames and truth of a car depend on, as one hash."""
        databases = sorted((n, c) for n, c in self._setup.documents.items() if not n.endswith((".yaml", ".yml")))
        depends_on = (code(SIMULATION), car, self.nominal.vehicle.chassis.wheel_radius_m, databases)
        return hashlib.sha256(repr(depends_on).encode()).hexdigest()[:32]


def judged(truth: NDArray[np.void]) -> NDArray[np.void]:
    """Return of the truth what estimates are held against, `JUDGED` ``[n]``."""
    rows = np.zeros(len(truth), JUDGED)
    for name in JUDGED.names or ():
        rows[name] = truth[name]
    return rows


def _loaded(car: Car) -> Vehicle:
    """Return the true vehicle with what it carries."""
    chassis = car.vehicle.chassis
    return replace(car.vehicle, chassis=replace(chassis, mass_kg=chassis.mass_kg + car.drive.payload_kg))


def _figures(figures: Figures) -> dict[str, Any]:
    """Return by torque the RMS error, N·m, and of ``samples`` that state a σ the coverage of each of `LEVELS`.

    With it goes for how long they were confidently wrong, ms.
    """
    return {
        name: {"rms": torque.rms_nm}
        | (
            {}
            if torque.bands is None
            else {
                "samples": torque.bands.samples,
                "coverage": list(torque.bands.coverage),
                "wrong_ms": torque.wrong_ms,
            }
        )
        for name, torque in figures.torques.items()
    }


def check_drive(truth: NDArray[np.void], radius_m: float) -> None:
    """Check that the car did what the drive is about.

    Raises:
        DctorqueError: it rolled backwards or did not get away, or the simulation went astray.
    """
    speed = truth["undriven_wheel_speed_rad_s"] * radius_m
    if not np.isfinite(speed).all():
        raise DctorqueError("the simulation went astray: a speed is no number")
    if speed.min() < -_ROLLED_BACK_M_S:
        raise DctorqueError(f"the car rolled backwards at {-speed.min():.1f} m/s: it cannot climb this road")
    if speed.max() < _GOT_AWAY_M_S:
        raise DctorqueError(f"the car did not get away: it never was faster than {speed.max():.2f} m/s")
