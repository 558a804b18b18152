"""`dctorque identify`: from a drive and a file with a class to a file that fits the car."""

import json

import pytest

from tests.identify.conftest import Owned


def test_a_drive_and_a_class_make_a_file(dctorque, owned: Owned) -> None:
    out = owned.owners.parent / "found.yaml"
    options = ("--log", owned.log, "-o", out, "--what", "delays", "--what", "car", "--json")
    outcome = dctorque("identify", owned.owners, *options)
    assert outcome.code == 0, outcome.err
    result = json.loads(outcome.out)
    told = {each["key"]: each for each in result["numbers"]}
    assert told["vehicle.chassis.mass_kg"]["changed"]
    assert told["vehicle.chassis.mass_kg"]["sigma"] < told["vehicle.chassis.mass_kg"]["before_sigma"]
    assert result["output"] == str(out)
    assert result["before"]["nis"].keys() == result["after"]["nis"].keys()
    assert result["sensitivities"][0]["torques_nm"]
    assert all(each["seen_s"] < each["needed_s"] and each["keys"] for each in result["missing"])
    assert dctorque("check", out).code == 0
    again = dctorque("identify", owned.owners, *options)
    assert again.code == 1
    assert "exists already" in again.err


def test_what_the_drives_lack_is_said(dctorque, owned: Owned) -> None:
    outcome = dctorque("identify", owned.owners, "--log", owned.log, "--what", "kissing_points")
    assert outcome.code == 0, outcome.err
    said = " ".join((outcome.out + outcome.err).split())
    assert "no launch with clutch 2 in these logs; it would tell clutch_phase.clutch2.kissing_point" in said
    assert "launch with clutch 1" not in said
    assert "1 numbers changed" in said


def test_a_plan_needs_no_recording(dctorque, owned: Owned) -> None:
    outcome = dctorque("identify", owned.owners, "--plan")
    assert outcome.code == 0
    assert "tip-ins" in outcome.out + outcome.err


@pytest.mark.parametrize(
    ("options", "code", "word"),
    [
        ((), 2, "--plan"),
        (("--log", "nothing.mcap"), 1, "nothing.mcap"),
    ],
)
def test_what_is_missing_is_said(dctorque, owned: Owned, options: tuple[str, ...], code: int, word: str) -> None:
    outcome = dctorque("identify", owned.owners, *options)
    assert outcome.code == code
    assert word in outcome.err


def test_the_file_itself_stays(dctorque, owned: Owned) -> None:
    before = owned.owners.read_bytes()
    outcome = dctorque("identify", owned.owners, "--log", owned.log, "-o", owned.owners, "--force")
    assert outcome.code == 1
    assert "is the vehicle file itself" in outcome.err
    assert owned.owners.read_bytes() == before


def test_a_log_of_another_car_is_refused(dctorque, owned: Owned) -> None:
    outcome = dctorque("identify", "paper_car", "--log", owned.log)
    assert outcome.code == 1
    assert "is it a log of this car?" in outcome.err


def test_a_short_drive_holds_nothing_out_and_says_so(dctorque, tmp_path) -> None:
    log = tmp_path / "paper.blf"
    assert dctorque("simulate", "-o", log).code == 0
    outcome = dctorque("identify", "paper_car", "--log", log, "--what", "ratios")
    assert outcome.code == 0, outcome.err
    assert "nothing was held out" in outcome.out + outcome.err
    assert "nothing written" in outcome.out + outcome.err


def test_a_car_that_stands_holds_no_equation(dctorque, tmp_path) -> None:
    log = tmp_path / "stands.blf"
    assert dctorque("simulate", "--duration", "1.5", "-o", log).code == 0
    outcome = dctorque("identify", "paper_car", "--log", log)
    assert outcome.code == 1
    assert "no equation of motion holds anywhere" in outcome.err
