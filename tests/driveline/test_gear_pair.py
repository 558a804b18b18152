"""Two engaged gears: inertias against kinetic energy and the observer's own, singular pairs by name."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from dctorque_can.driveline.gear_pair import SMALLEST_RATIO_STEP, GearPair, singular_pairs
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.oh2014 import model as oh2014_model
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, parameters

from .segments import AVANTE, DESIGN, PAPER

CARS = {"paper": PAPER, "avante": AVANTE}


def pairs(vehicle):
    return [(one.number, two.number) for one, two in product(vehicle.gears_on(1), vehicle.gears_on(2))]


@pytest.mark.parametrize("name", CARS)
def test_effective_inertias_hold_the_kinetic_energy_of_both_shafts(name):
    """Rigid shafts at any wheel speed: ½ J_e1 ω_c1² = ½ J_e2 ω_c2² = the energy of every part by its own speed."""
    vehicle = CARS[name]
    for one, two in pairs(vehicle):
        pair = GearPair.of(vehicle, one, two)
        w_o = 12.5
        energy = 0.0
        for shaft, number in zip(vehicle.shafts, (one, two), strict=True):
            gear = vehicle.gear(number)
            speed = gear.ratio * gear.final_drive * w_o
            energy += 0.5 * shaft.inertia_kgm2 * speed**2 + 0.5 * gear.inertia_kgm2 * speed**2
        assert 0.5 * pair.J_e1 * (pair.i_t1 * pair.i_f1 * w_o) ** 2 == pytest.approx(energy, rel=1e-14)
        assert 0.5 * pair.J_e2 * (pair.i_t2 * pair.i_f2 * w_o) ** 2 == pytest.approx(energy, rel=1e-14)


@pytest.mark.parametrize("name", CARS)
def test_the_observer_takes_the_same_inertia_to_the_bit(name):
    vehicle = CARS[name]
    c = oh2014_model.constants(vehicle, DESIGN)
    record = np.zeros(1, oh2014_model.PAIR)
    for one, two in pairs(vehicle):
        oh2014_model.set_pair(record[0], c[0], one, two)
        pair = GearPair.of(vehicle, one, two)
        assert (record["J_es"][0], record["R_1"][0], record["R_2"][0]) == (pair.J_e1, pair.R_1, pair.R_2)


@pytest.mark.parametrize("name", CARS)
def test_all_gears_turn_in_the_reference_plant(name):
    """Own inertias with every gear of the shaft are those of the plant; with the engaged gear alone, less."""
    vehicle = CARS[name]
    plant = parameters(vehicle, DEMO_POWERTRAIN, 0.0)
    whole = GearPair.of(vehicle, 1, 2, all_gears_turn=True)
    np.testing.assert_allclose([whole.J_1, whole.J_2], plant.J_shaft, rtol=1e-14)
    engaged = GearPair.of(vehicle, 1, 2)
    idle = [g.inertia_kgm2 for g in vehicle.gears if g.number not in (1, 2)]
    more = whole.J_1 + whole.J_2 - engaged.J_1 - engaged.J_2
    assert more == pytest.approx(sum(idle), rel=1e-12)


def with_ratio(number, ratio):
    gears = tuple(replace(g, ratio=ratio) if g.number == number else g for g in PAPER.gears)
    return replace(PAPER, gears=gears)


@pytest.mark.parametrize("apart", [0.0, 0.5, -0.5])
def test_a_singular_pair_is_refused_by_the_names_of_both_gears(apart):
    """However it is made; gears with ratios far enough apart are not."""
    vehicle = with_ratio(2, 3.78 * (1.0 + apart * SMALLEST_RATIO_STEP))
    message = r"^vehicle: gears 1 and 2 have the same total ratio 13\.986: .*differ by 0\.1 % or more\)$"
    with pytest.raises(DctorqueError, match=message):
        GearPair.of(vehicle, 1, 2)
    with pytest.raises(DctorqueError, match=message):
        GearPair(vehicle.gear(1), vehicle.gear(2), 0.003, 0.002)
    with pytest.raises(DctorqueError, match=message):
        GearPair.of(vehicle, 1, 2, all_gears_turn=True)
    assert len(list(singular_pairs(vehicle))) == 1
    assert list(singular_pairs(with_ratio(2, 3.78 * (1.0 + 2.0 * SMALLEST_RATIO_STEP)))) == []
    other = GearPair.of(vehicle, 3, 2)  # the other pairs stay usable
    assert other.gear2 == vehicle.gear(2)


@pytest.mark.parametrize(
    ("gears", "message"),
    [
        ((2, 1), "gear 2 is on shaft 2, not on shaft 1; gear 1 is on shaft 1, not on shaft 2"),
        ((1, 3), "gear 3 is on shaft 1, not on shaft 2"),
        ((1, 8), r"no gear 8; the vehicle has \[1, 2, 3, 4, 5\]"),
        ((0, 2), "no gear 0; "),
    ],
)
def test_gears_that_make_no_pair_are_refused(gears, message):
    with pytest.raises(DctorqueError, match=f"^vehicle: {message}"):
        GearPair.of(PAPER, *gears)
