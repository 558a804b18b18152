"""Both cars of the paper, by hand from its tables."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import Chassis, Clutch, Damper, Gear, OutputShaft, Shaft, Vehicle
from dctorque_can.simulation.drive import PAPER, simulate


def paper_car() -> Vehicle:
    """Section 4.1."""
    ratios = (3.78, 2.18, 1.43, 1.03, 0.84)
    clutch = Clutch(0.13, 0.31, 0.30, 4, 2500.0, 0.005)
    return Vehicle(
        engine_inertia_kgm2=0.2,
        damper=Damper(0.03, 1500.0, 10.0),
        shafts=(Shaft(0.0023, 10_000.0, 50.0), Shaft(0.0009, 23_000.0, 50.0)),
        clutches=(clutch, clutch),
        gears=tuple(Gear(i, 1 if i % 2 else 2, ratio, 3.7, 0.001) for i, ratio in enumerate(ratios, start=1)),
        gear_efficiency=0.94,
        final_drive_efficiency=0.86,
        output_shaft=OutputShaft(0.0002, 10_000.0, 20.0),
        chassis=Chassis(1600.0, 0.312, 2.0, 0.015, 0.4, 3.0),
    )


def avante() -> Vehicle:
    """Section 2.3: seven gears, two final drives, dry clutches."""
    ratios = (3.688, 2.850, 1.387, 0.951, 0.943, 0.780, 0.674)
    finals = (4.657, 3.601, 4.657, 4.657, 3.601, 3.601, 3.601)
    inertias = (0.00602, 0.005415, 0.006926, 0.00737, 0.008503, 0.008973, 0.01102)
    gears = [
        Gear(i, 1 if i % 2 else 2, ratio, final, inertia)
        for i, (ratio, final, inertia) in enumerate(zip(ratios, finals, inertias, strict=True), start=1)
    ]
    return Vehicle(
        engine_inertia_kgm2=0.2,
        damper=Damper(0.086, 1500.0, 10.0),
        shafts=(Shaft(0.043, 314_200.0, 53.0), Shaft(0.047, 301_200.0, 51.0)),
        clutches=(Clutch(0.21, 0.27, 0.27, 2, 4000.0, 0.0), Clutch(0.1684, 0.27, 0.27, 2, 5000.0, 0.0)),
        gears=(*gears, Gear(-1, 2, -3.537, 4.657, 0.006432)),
        gear_efficiency=0.97,
        final_drive_efficiency=0.97,
        output_shaft=OutputShaft(0.04, 9520.0, 591.0),
        chassis=Chassis(1596.0, 0.338, 1.7747, 0.015, 0.325, 2.2126),
    )


@pytest.fixture(scope="session")
def paper_vehicle() -> Vehicle:
    return paper_car()


@pytest.fixture(scope="session")
def avante_vehicle() -> Vehicle:
    return avante()


@pytest.fixture(scope="session")
def paper_truth(paper_vehicle: Vehicle) -> NDArray[np.void]:
    return simulate(paper_vehicle, PAPER)


@pytest.fixture(params=["paper_vehicle", "avante_vehicle"])
def car(request: pytest.FixtureRequest) -> Vehicle:
    vehicle: Vehicle = request.getfixturevalue(request.param)
    return vehicle
