"""The runs of a catalogue: a drawn car drives a manoeuvre, and the configured estimator is held to its word."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.honesty import honesty
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_documents
from dctorque_can.errors import DctorqueError
from dctorque_can.offline.simulated_car import (
    UNSIGNED,
    DriveName,
    ProfileName,
    Unsigned,
    drive_of,
    frames_of,
    sensors_of,
)
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN
from dctorque_can.study.catalogue import MIXED_S, Case, Catalogue
from dctorque_can.study.code import SIMULATION, code
from dctorque_can.study.draw import noise_seed
from dctorque_can.study.factors import Car, varied
from dctorque_can.study.kept import kept
from dctorque_can.study.run import Record, judged

_BATCH = 100_000


@dataclass(frozen=True, slots=True)
class CatalogueSetup:
    """What every process of a catalogue study is given; it can be pickled.

    Attributes:
        documents: `Config.documents` by vehicle and signals.
        cases: by number of the run.
        unsigned: by signals, what is sent without its sign.
        profile: how the cars measure and send.
        seed: of the study.
        drives: folder in which simulated drives are kept, or None.
        smooth: the estimates are smoothed too.
    """

    documents: Mapping[tuple[str, str], Mapping[str, bytes]]
    cases: Mapping[int, Case]
    unsigned: Mapping[str, Unsigned]
    profile: ProfileName
    seed: int
    drives: Path | None = None
    smooth: bool = False

    @classmethod
    def of(cls, catalogue: Catalogue, drives: Path | None = None) -> CatalogueSetup:
        """Return the setup of a study."""
        plan = catalogue.plan
        return cls(
            documents={names: config.documents for names, config in catalogue.configs.items()},
            cases=catalogue.cases(),
            unsigned={name: Unsigned(signals.unsigned) for name, signals in plan.signals.items()},
            profile=ProfileName(plan.profile),
            seed=plan.seed,
            drives=drives,
            smooth=plan.smooth,
        )

    def bench(self) -> CatalogueBench:
        """Return what makes the runs."""
        return CatalogueBench(self)


class CatalogueBench:
    """Makes runs; what run k gives depends on the setup, on k and on the values of its factors only."""

    def __init__(self, setup: CatalogueSetup) -> None:
        self._setup = setup
        self._configs = {names: load_documents(documents) for names, documents in setup.documents.items()}

    def warm_up(self) -> None:
        """Compile everything, or load it where it is compiled already."""
        config = next(iter(self._configs.values()))
        chain = Chain(config, self._setup.smooth)
        chain.warm_up()
        drive = drive_of(config, DriveName.PAPER, 0, 0.1)
        truth = simulate(config.settings.vehicle, drive)
        sensors = sensors_of(config, self._setup.profile, 0)
        chain.feed(frames_of(config, truth, sensors))
        if self._setup.smooth:
            chain.smoothed()

    def run(self, number: int, values: Mapping[str, float]) -> Record:
        """Return what the estimates of one case are worth, or why there are none.

        ``torques`` has the fields of `analysis.honesty.Honesty` by torque; ``smoothed`` too, if it was asked for.
        """
        case = self._setup.cases[number]
        record: Record = {"run": number, "factors": dict(values), "case": asdict(case)}
        try:
            config = self._configs[case.vehicle, case.signals]
            frames, truth = self._driven(case, config, values)
            chain = Chain(config, self._setup.smooth)
            parts = [chain.feed(frames[start : start + _BATCH]).rows for start in range(0, len(frames), _BATCH)]
            found = honesty(np.concatenate(parts), truth)
            record["torques"] = {name: asdict(one) for name, one in found.items()}
            if self._setup.smooth:
                after = honesty(chain.smoothed(), truth)
                record["smoothed"] = {name: asdict(one) for name, one in after.items()}
            return record
        except DctorqueError as error:
            return record | {"error": str(error)}

    def _driven(self, case: Case, config: Config, values: Mapping[str, float]) -> tuple[Frames, NDArray[np.void]]:
        setup = self._setup
        nominal = config.settings.vehicle
        length = MIXED_S if case.drive in (DriveName.MIXED, DriveName.FRICTION_DRIFT) else None
        car = varied(
            Car(
                vehicle=nominal,
                powertrain=DEMO_POWERTRAIN,
                sensors=sensors_of(config, setup.profile, noise_seed(setup.seed, case.point)),
                drive=drive_of(config, case.drive, setup.seed + case.draw, length),
            ),
            values,
        )
        car = replace(car, sensors=replace(car.sensors, unsigned=UNSIGNED[setup.unsigned[case.signals]]))

        def make() -> tuple[Frames, NDArray[np.void]]:
            truth = simulate(car.vehicle, car.drive, car.powertrain)
            return frames_of(config, truth, car.sensors), judged(truth)

        documents = setup.documents[case.vehicle, case.signals]
        databases = sorted((n, c) for n, c in documents.items() if not n.endswith((".yaml", ".yml")))
        sensors = replace(car.sensors, unsigned=frozenset())  # a set has no order
        depends_on = (
            code(SIMULATION),
            replace(car, sensors=sensors),
            sorted(car.sensors.unsigned),
            nominal.chassis.wheel_radius_m,
            databases,
        )
        return kept(setup.drives, hashlib.sha256(repr(depends_on).encode()).hexdigest()[:32], make)
