"""What is proposed of invented buses: found by meaning and behaviour; what only looks right is never sure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import Frames
from dctorque_can.starter.databases import read_dbc
from dctorque_can.starter.propose import propose
from dctorque_can.starter.recording import joined

from .bus import RPM, Drive, Signal, dbc_text, frames_of, levels, proposed, written
from .cars import ENGLISH, GERMAN, NAMELESS, RIVALS, speed, wanted, wheels

ENGLISH_TRUTH = {
    "inputs.engine_speed": "EngSpd",
    "inputs.engine_torque": "EngTrqAct",
    "inputs.shaft1_speed": "InpShaft1Spd",
    "inputs.shaft2_speed": "InpShaft2Spd",
    "inputs.wheel_speeds.fl": "WhlSpdFL",
    "inputs.wheel_speeds.fr": "WhlSpdFR",
    "inputs.wheel_speeds.rl": "WhlSpdRL",
    "inputs.wheel_speeds.rr": "WhlSpdRR",
    "inputs.acceleration": "LongAccel",
    "inputs.brake": "BrkPdlPressed",
    "gears.actual": "GearAct",
}


def without(signals: list[Signal], *names: str) -> list[Signal]:
    return [each for each in signals if each.name.split(".")[1] not in names]


def test_a_car_with_clear_names_is_found_and_sure(tmp_path: Path, traffic: Drive) -> None:
    found = levels(proposed(tmp_path, ENGLISH, traffic))
    assert found == {key: (name, "sure") for key, name in ENGLISH_TRUTH.items()}


def test_rivals_are_not_mistaken_for_it(tmp_path: Path, traffic: Drive) -> None:
    starter = proposed(tmp_path, ENGLISH + RIVALS, traffic)
    found = levels(starter)
    assert {key: found[key] for key in ENGLISH_TRUTH} == {k: (name, "sure") for k, name in ENGLISH_TRUTH.items()}
    assert found["gears.target"] == ("GearTgt", "sure")
    assert set(found) == {*ENGLISH_TRUTH, "gears.target"}
    engine = next(each for each in starter.proposals if each.key == "inputs.engine_speed")
    assert {"EngSpdTgt", "EngSpdFilt"} <= {each.entry.signal.name for each in engine.alternatives}


@pytest.mark.parametrize("name", list(ENGLISH_TRUTH))
def test_what_is_not_there_is_not_found_among_the_rivals(name: str, tmp_path: Path, traffic: Drive) -> None:
    """With the right signal away, none of those that only look like it may be sure."""
    signals = without(ENGLISH, ENGLISH_TRUTH[name]) + RIVALS
    found = levels(proposed(tmp_path, signals, traffic))
    assert found.get(name, ("", ""))[1] != "sure"
    right = set(ENGLISH_TRUTH.values()) | {"GearTgt"}
    assert [each for each, level in found.values() if level == "sure" and each not in right] == []


def test_a_german_car(tmp_path: Path, traffic: Drive) -> None:
    starter = proposed(tmp_path, GERMAN, traffic)
    torque = next(each for each in starter.proposals if each.key == "inputs.engine_torque")
    assert [term["signal"] for term in torque.fields["sum"]] == [
        "Motor_1.IndiziertesIstmoment",
        "Motor_1.Verlustmoment",
    ]
    assert torque.fields["sum"][1]["factor"] == -1
    found = levels(starter)
    assert found["inputs.engine_speed"] == ("Motordrehzahl", "sure")
    assert found["inputs.wheel_speeds.rl"] == ("Radgeschw_HL", "sure")
    assert found["gears.actual"] == ("Istgang", "sure")
    assert found["gears.target"][0] == "Zielgang"
    assert starter.phase_source == "position"
    clutch = next(each for each in starter.proposals if each.key == "clutch_phase.clutch2")
    assert clutch.entry.signal.name == "Kupplung2_Position"
    assert (clutch.fields["closes"], clutch.fields["kissing_point"]) == ("increasing", None)
    actual = next(each for each in starter.proposals if each.key == "gears.actual")
    assert actual.fields["values"] == {0: 0, **{gear: gear for gear in range(1, 8)}, 8: -1}


def test_without_a_log_little_is_sure(tmp_path: Path) -> None:
    found = levels(proposed(tmp_path, ENGLISH + RIVALS, None))
    wheels_alone = {key: value for key, value in found.items() if value[1] == "sure"}
    assert set(wheels_alone) <= {f"inputs.wheel_speeds.{wheel}" for wheel in ("fl", "fr", "rl", "rr")}
    assert found["inputs.engine_speed"] == ("EngSpd", "likely")


def test_names_without_meaning_are_never_sure(tmp_path: Path, traffic: Drive) -> None:
    starter = proposed(tmp_path, NAMELESS, traffic)
    found = levels(starter)
    assert "sure" not in {level for _, level in found.values()}
    assert found["inputs.engine_speed"][0] in ("S0", "S12", "S14")  # its own, filtered, shown: nobody can tell
    assert [found[f"inputs.shaft{n}_speed"][0] for n in (1, 2)] == ["S3", "S4"]
    assert {found[f"inputs.wheel_speeds.{wheel}"][0] for wheel in ("fl", "fr", "rl", "rr")} == {
        "S6",
        "S7",
        "S8",
        "S9",
    }


def test_names_without_units_are_not_sure_but_right(tmp_path: Path, traffic: Drive) -> None:
    bare = [replace(each, unit="") for each in ENGLISH]
    starter = proposed(tmp_path, bare, traffic)
    found = levels(starter)
    assert {key: name for key, (name, _) in found.items()} == ENGLISH_TRUTH
    speeds = [key for key in found if "speed" in key or "torque" in key]
    assert {found[key][1] for key in speeds} == {"likely"}
    assert starter.units["Brakes.WhlSpdFL"][0] == "km/h"
    assert starter.units["EngineData.EngSpd"][0] == "rpm"
    assert starter.units["EngineData.EngTrqAct"][0] == "Nm"


def test_a_name_that_lies_is_not_believed(tmp_path: Path, traffic: Drive) -> None:
    """What is called engine speed follows the road; what is called so in another message is the engine's."""
    lying = Signal("EngineData.EngSpd", lambda d: 12.0 * RPM * d.wheel, 16, 0.25, 0.0, "rpm")
    right = speed("Motor.Rpm", "engine_speed_rad_s")
    starter = proposed(tmp_path, [lying, right, *without(ENGLISH, "EngSpd")], traffic)
    assert levels(starter)["inputs.engine_speed"][0] == "Rpm"


def test_two_equal_signals_are_not_sure(tmp_path: Path, traffic: Drive) -> None:
    twin = speed("Gateway.EngSpd", "engine_speed_rad_s")
    found = levels(proposed(tmp_path, [*ENGLISH, twin], traffic))
    assert found["inputs.engine_speed"] == ("EngSpd", "likely")


def test_a_unit_that_cannot_be_is_doubted(tmp_path: Path, traffic: Drive) -> None:
    """Wheels in km/h that the DBC calls m/s: no car has total ratios from 4.8 down to 0.7."""
    wrong = [replace(each, unit="m/s") if each.unit == "km/h" else each for each in ENGLISH]
    starter = proposed(tmp_path, wrong, traffic)
    wheel = next(each for each in starter.proposals if each.key == "inputs.wheel_speeds.fl")
    assert wheel.level == "likely"
    assert "is a unit wrong?" in wheel.why[-1]


def test_a_shaft_that_is_called_an_engine(tmp_path: Path, traffic: Drive) -> None:
    """Stands with the car: whatever it is called, an engine idles."""
    signals = [speed("EngineData.EngSpd", "shaft1_speed_rad_s"), *without(ENGLISH, "EngSpd")]
    assert levels(proposed(tmp_path, signals, traffic)).get("inputs.engine_speed", ("", ""))[1] != "sure"


def test_shafts_that_are_numbered_the_other_way_are_doubtful(tmp_path: Path, traffic: Drive) -> None:
    turned = [
        speed("Gearbox.InpShaft1Spd", "shaft2_speed_rad_s"),
        speed("Gearbox.InpShaft2Spd", "shaft1_speed_rad_s"),
    ]
    starter = proposed(tmp_path, [*without(ENGLISH, "InpShaft1Spd", "InpShaft2Spd"), *turned], traffic)
    for n in (1, 2):
        shaft = next(each for each in starter.proposals if each.key == f"inputs.shaft{n}_speed")
        assert shaft.level == "likely"
        assert "numbering" in shaft.why[-1]


def test_indicated_torque_without_friction_is_doubtful(tmp_path: Path, traffic: Drive) -> None:
    burns = Signal(
        "EngineData.EngTrqAct",
        lambda d: np.maximum(d.engine_torque_nominal_nm + 12.0 + 0.03 * d.engine_speed_rad_s, 0.0),
        12,
        0.5,
        0.0,
        "Nm",
    )
    found = proposed(tmp_path, [*without(ENGLISH, "EngTrqAct"), burns], traffic)
    torque = next(each for each in found.proposals if each.key == "inputs.engine_torque")
    assert torque.level != "sure"


def test_a_demand_alone_is_not_sure(tmp_path: Path, traffic: Drive) -> None:
    demand = Signal("EngineData.EngTrqReq", wanted, 12, 0.5, -500.0, "Nm")
    found = levels(proposed(tmp_path, [*without(ENGLISH, "EngTrqAct"), demand], traffic))
    assert found.get("inputs.engine_torque", ("", "guess"))[1] != "sure"


def test_one_shaft_alone_is_that_which_drives(tmp_path: Path, traffic: Drive) -> None:
    first = Signal(
        "Gearbox.InpSpd",
        lambda d: (
            RPM
            * np.where(d.clutch1_capacity_nm > d.clutch2_capacity_nm, d.shaft1_speed_rad_s, d.shaft2_speed_rad_s)
        ),
        16,
        0.25,
        0.0,
        "rpm",
    )
    signals = [*without(ENGLISH, "InpShaft1Spd", "InpShaft2Spd"), first]
    assert levels(proposed(tmp_path, signals, traffic))["inputs.driving_shaft_speed"] == ("InpSpd", "sure")


def test_gears_that_begin_at_another_number(tmp_path: Path, traffic: Drive) -> None:
    """Without a value table the ratios number them: raw 5 with the highest one is the first gear."""
    shifted = Signal("Gearbox.GearAct", lambda d: d.gear + 4.0, 4)
    starter = proposed(tmp_path, [*without(ENGLISH, "GearAct"), shifted], traffic)
    gear = next(each for each in starter.proposals if each.key == "gears.actual")
    assert gear.fields["values"] == {gear + 4: gear for gear in range(1, 8)}
    assert gear.level == "likely"


def test_a_torque_in_per_cent_with_its_reference(tmp_path: Path, traffic: Drive) -> None:
    share = Signal("EngineData.EngTrqAct", lambda d: d.engine_torque_nominal_nm / 4.0, 12, 0.1, -100.0, "%")
    reference = Signal("EngineConst.EngTrqRef", lambda d: np.full(len(d.truth), 400.0), 12, 1.0, 0.0, "Nm")
    signals = [*without(ENGLISH, "EngTrqAct"), share, reference]
    torque = next(e for e in proposed(tmp_path, signals, traffic).proposals if e.key == "inputs.engine_torque")
    assert torque.fields["times"] == {"signal": "EngineConst.EngTrqRef"}
    alone = next(e for e in proposed(tmp_path, signals[:-1], traffic).proposals if e.key == "inputs.engine_torque")
    assert alone.fields == {"reference_nm": None}
    assert alone.level != "sure"


def test_a_car_that_stands_says_nothing(tmp_path: Path, traffic: Drive) -> None:
    """Then names are all there is; a number that never changes is no speed."""
    still = Drive(traffic.truth[:20_000].copy())
    for name in still.truth.dtype.names or ():
        if "speed" in name and "engine" not in name:
            still.truth[name] = 0.0
    starter = proposed(tmp_path, ENGLISH + RIVALS, still)
    assert "sure" not in {each.level for each in starter.proposals}
    assert any("hardly moves" in remark for remark in starter.remarks)


def test_an_empty_log(tmp_path: Path) -> None:
    starter = propose([written(tmp_path, ENGLISH)], Frames.empty())
    assert "the log holds no frame" in starter.remarks[0]
    assert levels(starter)["inputs.engine_speed"] == ("EngSpd", "likely")


def test_the_dbc_of_another_car(tmp_path: Path, traffic: Drive) -> None:
    dbc = written(tmp_path, ENGLISH)
    frames = frames_of(dbc, ENGLISH, traffic)
    frames.can_id[:] += 0x300
    starter = propose([dbc], joined([frames]))
    assert "none of the" in starter.remarks[0]
    assert {each.level for each in starter.proposals} <= {"likely", "guess"} | (
        {"sure"}
        if all(e.key.startswith("inputs.wheel") for e in starter.proposals if e.level == "sure")
        else set()
    )


def test_values_that_mean_none_are_seen(tmp_path: Path, traffic: Drive) -> None:
    """All bits set for a while: told, and left out of what is compared."""

    def lost(drive: Drive) -> np.ndarray:
        return np.where(drive.t_us % 9_000_000 < 200_000, 65535 * 0.25, RPM * drive.engine_speed_rad_s)

    signals = [Signal("EngineData.EngSpd", lost, 16, 0.25, 0.0, "rpm"), *without(ENGLISH, "EngSpd")]
    starter = proposed(tmp_path, signals, traffic)
    assert starter.no_value == {"EngineData.EngSpd": (65535,)}
    assert levels(starter)["inputs.engine_speed"] == ("EngSpd", "sure")


def test_several_dbcs_on_several_channels(tmp_path: Path, traffic: Drive) -> None:
    """One identifier on both buses: each DBC gets the channel that its messages are on."""
    engine = [each for each in ENGLISH if not each.name.startswith("Brakes.")]
    brakes = [each for each in ENGLISH if each.name.startswith("Brakes.")]
    dbcs = [written(tmp_path, engine, "pt.dbc"), written(tmp_path, brakes, "ch.dbc")]
    frames = [frames_of(dbcs[0], engine, traffic, 0), frames_of(dbcs[1], brakes, traffic, 1)]
    starter = propose(dbcs, joined([Frames.concatenate(frames).sorted_by_time()]))
    found = levels(starter)
    assert {key: name for key, (name, _) in found.items()} == ENGLISH_TRUTH
    assert starter.channels == {0: 0, 1: 1}


def test_timeouts_come_from_the_log(tmp_path: Path, traffic: Drive) -> None:
    starter = proposed(tmp_path, ENGLISH, traffic)
    assert starter.periods["EngineData"].median_ms == 10.0
    assert {starter.timeout_ms(each.entry) for each in starter.proposals} == {30}


def test_total_ratios_are_measured(tmp_path: Path, traffic: Drive) -> None:
    """Against the vehicle that drove: ratio times final drive, its wheels taken as 0.31 m."""
    starter = proposed(tmp_path, ENGLISH, traffic)
    totals = {1: 3.688 * 4.657, 2: 2.85 * 3.601, 3: 1.387 * 4.657, 4: 0.951 * 4.657, 5: 0.943 * 3.601}
    assert {gear: starter.ratios[gear] for gear in totals} == pytest.approx(totals, rel=0.02)


def test_what_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "no.dbc").write_text("hello")
    with pytest.raises(DctorqueError, match=r"no\.dbc"):
        read_dbc(tmp_path / "no.dbc")
    with pytest.raises(DctorqueError, match="cannot be read"):
        read_dbc(tmp_path / "missing.dbc")


def test_a_broken_line_costs_no_message(tmp_path: Path) -> None:
    path = tmp_path / "bent.dbc"
    path.write_text(dbc_text(ENGLISH) + 'VAL_ 9999 Nothing 0 "a" ;\nBA_ "Foo" BO_ 77 1;\n')
    assert len(read_dbc(path).database.messages) == 3


def test_wheels_of_another_spelling(tmp_path: Path, traffic: Drive) -> None:
    signals = [
        *without(ENGLISH, "WhlSpdFL", "WhlSpdFR", "WhlSpdRL", "WhlSpdRR"),
        *wheels(
            "Abs", ("FrontLeftWheelSpeed", "FrontRightWheelSpeed", "RearLeftWheelSpeed", "RearRightWheelSpeed")
        ),
    ]
    assert levels(proposed(tmp_path, signals, traffic))["inputs.wheel_speeds.rr"] == (
        "RearRightWheelSpeed",
        "sure",
    )
