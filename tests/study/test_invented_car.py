"""Cars that are drawn at random have sound files, and differ."""

from itertools import pairwise

import cantools
import pytest

from dctorque_can.config.load import load_documents
from dctorque_can.resources import shipped_classes
from dctorque_can.study.invented_car import invent_car

SEEDS = range(30)


def test_each_one_loads_without_a_warning() -> None:
    for seed in SEEDS:
        config = load_documents(invent_car(seed).documents)
        assert config.warnings == (), seed
        assert config.of_class == {}


def test_motion_is_told_beside_all_else() -> None:
    told = set()
    for seed in SEEDS:
        plain, telling = (invent_car(seed, tells_motion=more).vehicle_file for more in (False, True))
        more = set(telling["inputs"]) - set(plain["inputs"])
        for name in ("vehicle", "gears", "clutch_phase"):
            assert telling[name] == plain[name]
        assert {name: telling["inputs"][name] for name in plain["inputs"]} == plain["inputs"]
        told |= more
        config = load_documents(invent_car(seed, tells_motion=True).documents)
        assert {warning.key for warning in config.warnings} <= {
            "inputs.direction"
        }  # of a car whose speeds have signs
    assert told == {"acceleration", "grade", "direction"}


def test_cantools_reads_each_dbc_strictly() -> None:
    for seed in SEEDS:
        dbc = cantools.database.load_string(invent_car(seed).dbc.decode(), "dbc", strict=True)
        for message in dbc.messages:
            assert sum(signal.length for signal in message.signals) <= 64


def test_they_differ_in_physics_signals_and_class() -> None:
    cars = [invent_car(seed) for seed in SEEDS]
    assert {car.class_name for car in cars} == {path.stem for path in shipped_classes()}
    inertias = {car.vehicle_file["vehicle"]["engine_inertia_kgm2"] for car in cars}
    assert len(inertias) > len(cars) / 2
    assert {car.vehicle_file["gears"]["source"] for car in cars} == {"signals", "gearbox"}
    assert {car.vehicle_file["clutch_phase"]["source"] for car in cars} == {"position", "command"}
    assert {"protection" in car.vehicle_file for car in cars} == {True, False}


def test_higher_gears_are_longer() -> None:
    for seed in SEEDS:
        gears = invent_car(seed).vehicle_file["vehicle"]["gears"]
        totals = [gears[n]["ratio"] * gears[n]["final_drive"] for n in sorted(set(gears) - {"R"})]
        assert all(one > 1.1 * next_one for one, next_one in pairwise(totals))


def test_a_seed_is_one_car() -> None:
    assert invent_car(5).documents == invent_car(5).documents
    assert invent_car(5, "compact_dct6_dry").class_name == "compact_dct6_dry"


def test_numbers_lie_around_the_class() -> None:
    masses = [invent_car(seed, "compact_dct7_dry").vehicle_file["vehicle"]["chassis"]["mass_kg"] for seed in SEEDS]
    assert min(masses) >= 1400 * 0.85
    assert max(masses) <= 1400 * 1.15
    assert sum(masses) / len(masses) == pytest.approx(1400, rel=0.05)
