"""What a drive of an invented car says of the numbers that its owner does not know, against the true ones."""

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.evidence.series import Series, decoded, read_frames
from dctorque_can.identify.beliefs import messages, number_of
from dctorque_can.identify.identification import Solution, solution
from dctorque_can.identify.identified_file import changes, identified_text
from dctorque_can.identify.plan import DRIVES, lacking
from dctorque_can.identify.results import Result, common, correlations, results
from dctorque_can.identify.unknowns import GROUPS
from dctorque_can.logs.reader import open_log
from tests.identify.conftest import Owned


@pytest.fixture(scope="module")
def series(owned: Owned) -> Series:
    config = load_config(owned.owners)
    with open_log(owned.log) as reader:
        return decoded(read_frames([reader], config), config)


@pytest.fixture(scope="module")
def solved(owned: Owned, series: Series) -> Solution:
    return solution([series], load_config(owned.owners))


@pytest.fixture(scope="module")
def found(owned: Owned, solved: Solution) -> dict[str, Result]:
    return {each.key: each for each in results(solved, load_config(owned.owners))}


def test_delays_are_told_against_each_other(owned: Owned, found: dict[str, Result]) -> None:
    true_ms = {key: each.told_ms for each in messages(owned.truth) for key in each.keys}
    wrong = [found[key].after.value - late_ms for key, late_ms in true_ms.items()]
    assert np.ptp(list(true_ms.values())) > 20.0
    assert np.ptp(wrong) < 1.5


def test_together_delays_are_as_unsure_as_they_were_believed(solved: Solution) -> None:
    together, apart = common(solved)["delays"]
    assert together > 3.0
    assert apart < 1.0


@pytest.mark.parametrize(
    ("key", "share"),
    [
        ("vehicle.chassis.mass_kg", 0.1),
        ("vehicle.engine_inertia_kgm2", 0.2),
        ("vehicle.damper.stiffness_nm_per_rad", 0.15),
        ("vehicle.output_shaft.stiffness_nm_per_rad", 0.1),
        ("vehicle.output_shaft.damping_nms_per_rad", 0.4),
        ("vehicle.chassis.wheel_radius_m", 0.005),
    ],
)
def test_what_a_drive_tells_is_found(owned: Owned, found: dict[str, Result], key: str, share: float) -> None:
    true, result = number_of(owned.truth.settings.vehicle, key), found[key]
    assert result.after.value == pytest.approx(true, rel=share)
    assert abs(result.after.value - true) < 3.0 * result.after.sigma
    assert result.changes
    assert result.told > 0.3


def test_no_number_is_sure_and_wrong(owned: Owned, found: dict[str, Result]) -> None:
    off = [
        (each.after.value - number_of(owned.truth.settings.vehicle, key)) / each.after.sigma
        for key, each in found.items()
        if key.startswith("vehicle.")
    ]
    assert np.mean(np.abs(off) < 2.0) >= 0.9
    assert max(map(abs, off)) < 4.0


def test_mass_and_torque_are_named_as_one(owned: Owned, solved: Solution) -> None:
    pairs = {(first, second) for first, second, _ in correlations(solved, load_config(owned.owners))}
    torque = "the engine's torque over the nominal one"
    assert any(torque in pair and "vehicle.chassis.mass_kg" in pair for pair in pairs)


def test_what_was_held_out_is_likelier(solved: Solution) -> None:
    for kind, (before, after) in solved.likelihood.items():
        assert after > before, kind


def test_the_file_that_is_written_has_values_and_sigmas(owned: Owned, found: dict[str, Result]) -> None:
    config = load_config(owned.owners)
    path = owned.owners.parent / "identified.yaml"
    path.write_text(identified_text(config, changes(config, list(found.values()))))
    loaded = load_config(path)
    mass = found["vehicle.chassis.mass_kg"].after
    assert loaded.settings.vehicle.chassis.mass_kg == pytest.approx(mass.value, rel=2e-3)
    assert loaded.sigmas["vehicle.chassis.mass_kg"] == pytest.approx(mass.sigma, rel=0.05)
    assert loaded.of_class  # what was not told is still that of the class
    assert "told" in path.read_text()


def test_groups_that_are_not_chosen_stay(owned: Owned, series: Series) -> None:
    config = load_config(owned.owners)
    only = solution([series], config, ("delays",))
    assert {each.group for each in results(only, config)} == {"delays"}
    for each in only.unknowns:
        if each.group != "delays" and each.corrects:
            assert only.values[each.name] == pytest.approx(each.prior.value, rel=1e-3, abs=1e-6), each.name


def test_each_group_has_a_drive_that_tells_of_it(found: dict[str, Result]) -> None:
    assert set(DRIVES) == set(GROUPS)
    missing = lacking(list(found.values()))
    assert set(missing) <= set(GROUPS)
    assert "vehicle.damper.stiffness_nm_per_rad" not in missing.get("stiffnesses", [])
