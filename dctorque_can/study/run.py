"""One run: a true car is simulated, the estimator sees its frames and believes in the nominal one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.errors import compare
from dctorque_can.config.load import load_documents
from dctorque_can.daemon.chain import Chain
from dctorque_can.daemon.simulated_car import DriveName, ProfileName, drive_of, sensors_of
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import Status
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.simulation.sensors import emit_frames
from dctorque_can.study.draw import noise_seed
from dctorque_can.study.factors import Car, varied
from dctorque_can.study.plan import Study

Record = dict[str, Any]
"""One line of results: ``run``, ``factors``, and either ``error`` or ``rms``, ``bias``, ``peak``, ``valid``."""

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
    """

    documents: Mapping[str, bytes]
    drive: DriveName
    duration_s: float | None
    profile: ProfileName
    seed: int

    @classmethod
    def of(cls, study: Study) -> Setup:
        """Return the setup of a study."""
        plan = study.plan
        drive, profile = DriveName(plan.drive), ProfileName(plan.profile)
        return cls(study.config.documents, drive, plan.duration_s, profile, plan.seed)


class Bench:
    """Makes runs; what run k gives depends on the setup, on k and on the values of its factors only."""

    def __init__(self, setup: Setup) -> None:
        self._config = load_documents(setup.documents)
        self._seed = setup.seed
        self.nominal = Car(
            vehicle=self._config.settings.vehicle,
            powertrain=DEMO_POWERTRAIN,
            sensors=sensors_of(self._config, setup.profile, seed=0),
            drive=drive_of(self._config, setup.drive, setup.seed, setup.duration_s),
        )

    def warm_up(self) -> None:
        """Compile everything; takes up to a minute the first time on a machine."""
        Chain(self._config).warm_up()
        truth = simulate(self.nominal.vehicle, replace(self.nominal.drive, duration_s=0.1))
        emit_frames(truth, self.nominal.vehicle, self.nominal.sensors, self._config.database)

    def run(self, number: int, values: Mapping[str, float]) -> Record:
        """Return errors of the estimates of one car, or why there are none."""
        record: Record = {"run": number, "factors": dict(values)}
        car = varied(self.nominal, values)
        car = replace(car, sensors=replace(car.sensors, seed=noise_seed(self._seed, number)))
        try:
            return record | self._errors(car)
        except DctorqueError as error:
            return record | {"error": str(error)}

    def _errors(self, car: Car) -> Record:
        truth = simulate(car.vehicle, car.drive, car.powertrain)
        check_drive(truth, car.vehicle.chassis.wheel_radius_m)
        # The wheel signals are made with the radius of the nominal car: control units have it coded.
        frames = emit_frames(truth, self.nominal.vehicle, car.sensors, self._config.database)
        estimates = Chain(self._config).feed(frames).rows
        errors = compare(estimates, truth)
        both = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
        return {
            **{kind: {name: getattr(e, kind) for name, e in errors.items()} for kind in ("rms", "bias", "peak")},
            "valid": float(np.mean((estimates["status"] & both) == both)),
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
