"""Every kind of mistake gives one line that says where, what, and what would be right."""

from pathlib import Path

import pytest

from dctorque_can.config.load import ConfigError, load_config
from dctorque_can.errors import DctorqueError
from dctorque_can.resources import shipped_config, shipped_dbc

PEDAL = "EngineData.AcceleratorPedal"
GEAR = {"ratio": 1.0, "final_drive": 3.7, "inertia_kgm2": 0.001}
COMMAND = {"signal": "EngineData.EngineTorque", "threshold_nm": 5, "hysteresis_nm": 2}
THERMAL = {"heat_capacity_j_per_k": 4000, "cooling_w_per_k": 30, "coolant_c": 80}

MISTAKES = [
    ({"colour": "red"}, "colour", "unknown section"),
    ({"clutch_phases": {}}, "clutch_phases", "did you mean clutch_phase"),
    ({"name": 3}, "name", "must be text"),
    ({"vehicle.engine_inertia_kgm2": -1}, "vehicle.engine_inertia_kgm2", "greater than 0"),
    ({"vehicle.engine_inertia_kgm2": float("nan")}, "vehicle.engine_inertia_kgm2", "finite number"),
    ({"vehicle.engine_inertia_kgm2": "0.2"}, "vehicle.engine_inertia_kgm2", "must be a number"),
    ({"vehicle.engine_inertia_kgm2": True}, "vehicle.engine_inertia_kgm2", "must be a number"),
    ({"vehicle.engine_inertia": 0.2}, "vehicle.engine_inertia", "did you mean engine_inertia_kgm2"),
    ({"vehicle.clutches.1.surfaces": 2.5}, "vehicle.clutches.1.surfaces", "whole number"),
    (
        {"vehicle.clutches.1.friction_static": 0.2},
        "vehicle.clutches.1.friction_static",
        "at least friction_kinetic",
    ),
    ({"vehicle.damper": 3}, "vehicle.damper", "must be a mapping"),
    ({"vehicle.gear_efficiency": 94}, "vehicle.gear_efficiency", "less than or equal to 1"),
    ({"vehicle.driven_axle": "left"}, "vehicle.driven_axle", "one of: front, rear or all"),
    ({"vehicle.gears.3.shaft": 3}, "vehicle.gears.3.shaft", "one of: 1 or 2"),
    ({"vehicle.gears.X": {"shaft": 1} | GEAR}, "vehicle.gears.X", "1, 2, … or R"),
    ({"vehicle.gears.2.ratio": 3.78}, "vehicle.gears.2", "pair with gear 1 is singular"),
    ({f"vehicle.gears.{n}.shaft": 1 for n in (2, 4)}, "vehicle.gears", "no gear is on shaft 2"),
    ({"databases": "demo_car.dbc"}, "databases", "must be a list"),
    ({"databases.0.file": "none.dbc"}, "databases.0.file", "none.dbc cannot be read: No such file"),
    ({"databases.0.file": "car.yaml"}, "databases.0.file", "Invalid syntax"),
    ({"databases.0.strict": "yes"}, "databases.0.strict", "true or false"),
    ({"inputs.engine_speed": "EngineData.EngineSped"}, "inputs.engine_speed", "did you mean EngineSpeed"),
    ({"inputs.engine_speed": "EngineDat.EngineSpeed"}, "inputs.engine_speed", "did you mean EngineData"),
    ({"inputs.engine_speed": "EngineSpeed"}, "inputs.engine_speed", "must be Message.Signal"),
    ({"inputs.engine_speed": {}}, "inputs.engine_speed.signal", "give signal: Message.Signal, or sum"),
    ({"inputs.engine_speed.timeout_s": 1}, "inputs.engine_speed.timeout_s", "did you mean timeout_ms"),
    ({"inputs.engine_speed.timeout_ms": 0}, "inputs.engine_speed.timeout_ms", "greater than 0"),
    ({"inputs.engine_speed.range": [5, 1]}, "inputs.engine_speed.range", "[lowest, highest]"),
    ({"inputs.engine_speed.range": [5]}, "inputs.engine_speed.range", "at least 2 items"),
    ({"inputs.engine_speed.unit": "km/h"}, "inputs.engine_speed.unit", "use rpm"),
    ({"inputs.engine_speed.not_available": [70000]}, "inputs.engine_speed.signal", "it holds 0..65535"),
    (
        {"inputs.engine_speed.not_available": ["SNA"]},
        "inputs.engine_speed.not_available.0",
        "there is: not available",
    ),
    ({"inputs.engine_speed.sum": [PEDAL]}, "inputs.engine_speed.sum", "either signal or sum"),
    ({"inputs.engine_torque": {"sum": []}}, "inputs.engine_torque.sum", "at least 1 item"),
    (
        {"inputs.engine_torque": {"sum": [PEDAL], "unit": "N·m", "factor": 2}},
        "inputs.engine_torque.factor",
        "into each",
    ),
    ({"inputs.engine_torque": PEDAL}, "inputs.engine_torque", "give reference_nm"),
    (
        {"inputs.engine_torque": {"sum": ["EngineData.EngineTorque", {"signal": PEDAL, "reference_nm": 300}]}}
        | {"inputs.engine_torque.range": [-100, 100]},
        "inputs.engine_torque.range",
        "different units",
    ),
    ({"inputs.engine_torque": "EngineData.EngineDataCounter"}, "inputs.engine_torque", "give unit:"),
    ({"inputs.wheel_speeds": {}}, "inputs.wheel_speeds", "at least one of fl, fr, rl, rr"),
    ({"inputs.wheel_speeds.front_left": PEDAL}, "inputs.wheel_speeds.front_left", "unknown key"),
    ({"protection.EngineDat": {"counter_signal": "C"}}, "protection.EngineDat", "did you mean EngineData"),
    ({"protection.EngineData.crc": "crc32"}, "protection.EngineData.crc", "one of: none, crc8_j1850"),
    ({"protection.EngineData.crc_signal": "Crc"}, "protection.EngineData.crc_signal", "is not a signal"),
    ({"protection.EngineData.counter_modulus": 16}, "protection.EngineData.counter_signal", "runs 0..14"),
    ({"protection.EngineData.max_counter_delta": 15}, "protection.EngineData.max_counter_delta", "less than"),
    ({"protection.EngineData.crc": "e2e_p02"}, "protection.EngineData.data_ids", "16 data ids"),
    ({"protection.EngineData": {}}, "protection.EngineData.counter_signal", "a crc, a counter_signal, or both"),
    ({"gears.source": "signal"}, "gears.source", "did you mean signals"),
    ({"gears": {"engage_tolerance": 0.02}}, "gears.source", "missing: one of signals, gearbox, ratio"),
    ({"gears.shaft1.values.2": 2}, "gears.shaft1.values.2", "gear 2 is on shaft 2, not on shaft 1"),
    ({"gears.shaft1.values.7": 7}, "gears.shaft1.values.7", "no gear 7; there is: 1, 2, 3, 4, 5"),
    ({"gears.shaft1.values.gear 9": 1}, "gears.shaft1.values.gear 9", "not in the value table"),
    ({"gears.shaft1.values.5": "five"}, "gears.shaft1.values.5", "a gear is 1, 2, … or R"),
    ({"gears": {"source": "ratio", "release_tolerance": 0.4}}, "gears.release_tolerance", "gears 3 and 5 apart"),
    ({"gears": {"source": "ratio", "release_tolerance": 0.01}}, "gears.release_tolerance", "more than engage"),
    ({"clutch_phase.source": "positon"}, "clutch_phase.source", "did you mean position"),
    ({"clutch_phase.clutch1.closes": "up"}, "clutch_phase.clutch1.closes", "increasing or decreasing"),
    (
        {"inputs.clutch2_command": COMMAND["signal"]}
        | {"clutch_phase": {"source": "command", "clutch1": COMMAND, "clutch2": COMMAND}},
        "clutch_phase.clutch2",
        "is the input clutch2_command too",
    ),
    ({"vehicle.clutches.1.thermal": {}}, "vehicle.clutches.1.thermal.heat_capacity_j_per_k", "missing"),
    (
        {"vehicle.clutches.2.thermal": THERMAL | {"cooling_w_per_k": 0}},
        "vehicle.clutches.2.thermal.cooling_w_per_k",
        "greater than 0",
    ),
    (
        {"vehicle.clutches.2.thermal": THERMAL | {"coolant_k": 353}},
        "vehicle.clutches.2.thermal.coolant_k",
        "did you mean coolant_c",
    ),
    ({"clutch_phase.slip_locked_rad_s": 9}, "clutch_phase.slip_released_rad_s", "more than slip_locked"),
    ({"estimator.oh2014.road_load": "steep"}, "estimator.oh2014.road_load", "none, flat or learned"),
    ({"estimator.step_ms": 20}, "estimator.period_ms", "at least step_ms"),
    ({"estimator.step_ms": 10}, "estimator.oh2014.engine_bandwidth_rad_s", "at most 50 rad/s"),
    ({"can.options": {"channel": 1}}, "can.options.channel", "can.channel"),
    ({"can.data_bitrate": 2_000_000}, "can.data_bitrate", "needs fd: true"),
    ({"output.database": "none.dbc"}, "output.database", "cannot be read"),
    ({"output.ids": {"DctStatuss": 1}}, "output.ids.DctStatuss", "did you mean DctStatus"),
    ({"output.ids": {"DctStatus": 0x6F0}}, "output.ids.DctStatus", "is the id of DctClutchTorque too"),
    ({"output.ids": {"DctStatus": 0x100}}, "output.ids.DctStatus", "EngineData, which the vehicle sends"),
    ({"logging.keep_mb": 10}, "logging.keep_mb", "at least rotate_mb"),
]


@pytest.mark.parametrize(
    ("changes", "key", "reason"), MISTAKES, ids=[f"{key}-{why[:20]}" for _, key, why in MISTAKES]
)
def test_one_mistake_is_named(errors, changes, key, reason) -> None:
    found = errors(changes)
    assert any(p.key == key and reason in p.reason for p in found), found
    assert all(problem.line > 0 for problem in found)


@pytest.mark.parametrize(
    "key",
    [
        "name",
        "vehicle",
        "databases",
        "inputs",
        "gears",
        "clutch_phase",
        "vehicle.engine_inertia_kgm2",
        "vehicle.damper.stiffness_nm_per_rad",
        "vehicle.shafts.2",
        "vehicle.shafts.1.transfer_stiffness_nm_per_rad",
        "vehicle.clutches.1",
        "vehicle.clutches.2.max_normal_force_n",
        "vehicle.gears.3.final_drive",
        "vehicle.gear_efficiency",
        "vehicle.chassis.wheel_radius_m",
        "vehicle.driven_axle",
        "databases.0.file",
        "inputs.engine_speed",
        "inputs.engine_torque",
        "inputs.wheel_speeds",
        "gears.shaft2",
        "clutch_phase.clutch1.kissing_point",
        "clutch_phase.clutch2",
    ],
)
def test_nothing_that_is_needed_has_a_silent_default(errors, removed, key) -> None:
    (problem,) = errors({key: removed})
    assert problem.key == key
    assert problem.reason.startswith("missing")


def test_the_2014_observer_needs_both_shafts(errors, removed) -> None:
    (problem,) = errors({"inputs.shaft1_speed": removed, "estimator.method": "oh2014"})
    assert problem.key == "inputs.shaft1_speed"
    assert problem.reason.startswith("missing")


def test_all_errors_of_a_file_at_once(errors) -> None:
    changes: dict[str, object] = {}
    keys: set[str] = set()
    for change, key, _ in MISTAKES:
        touched = {known.split(".")[0] for known in changes}
        if "databases" in key:
            continue  # without its DBC a signal cannot be checked
        if len(change) == 1 and not {known.split(".")[0] for known in change} & touched:
            changes |= change
            keys.add(key)
    assert len(keys) >= 10
    assert {problem.key for problem in errors(changes)} == keys


def test_what_is_sound_is_checked_although_its_neighbours_are_not(errors) -> None:
    found = errors(
        {
            "vehicle.chassis.mass_kg": -1,
            "vehicle.gears.2.ratio": 3.78,
            "inputs.engine_speed": {"signal": "EngineData.Nothing", "timeout": 5},
            "inputs.shaft1_speed": 3,
            "gears.shaft1": {"signal": "Gearbox.Nothing", "values": {"neutral": "neutral", 2: 2}},
            "clutch_phase.clutch1": {"signal": "Gearbox.Nothing", "closes": 1},
            "protection.EngineData": {"crc": "e2e_p01", "crc_signal": "Nothing"},
        }
    )
    assert {problem.key for problem in found} >= {
        "vehicle.chassis.mass_kg",
        "vehicle.gears.2",
        "inputs.engine_speed.timeout",
        "inputs.engine_speed.signal",
        "inputs.shaft1_speed",
        "gears.shaft1.signal",
        "gears.shaft1.values.2",
        "clutch_phase.clutch1.closes",
        "protection.EngineData.crc_signal",
        "protection.EngineData.data_id",
    }


def test_the_line_is_the_line(tmp_path: Path) -> None:
    text = shipped_config("paper_car").read_text().replace("../dbc/", f"{shipped_dbc('demo_car').parent}/")
    wrong = {"mass_kg: 1600": "mass_kg: -1600", "4: {shaft: 2": "4: {shaft: 4"}
    for right, mistake in wrong.items():
        text = text.replace(right, mistake)
    path = tmp_path / "car.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    lines = text.splitlines()
    for problem in caught.value.problems:
        assert problem.value in lines[problem.line - 1]
        assert problem.key.split(".")[-1] in lines[problem.line - 1]
    assert [problem.key for problem in caught.value.problems if problem.severity == "error"] == [
        "vehicle.gears.4.shaft",
        "vehicle.chassis.mass_kg",
    ]
    first = str(caught.value).splitlines()[0]
    assert first.startswith(f"{path}:")
    assert first.endswith("vehicle.gears.4.shaft = 4: must be one of: 1 or 2")


def test_files_that_are_not_there(tmp_path: Path) -> None:
    (tmp_path / "paper_car.yaml").write_text("name: x")
    with pytest.raises(DctorqueError, match=r"cannot be read: No such file.*did you mean .*paper_car\.yaml"):
        load_config(tmp_path / "papercar.yaml")
    with pytest.raises(DctorqueError, match="cannot be read: Is a directory"):
        load_config(tmp_path)
    with pytest.raises(DctorqueError, match="cannot be read: No such file"):
        load_config(tmp_path / "nowhere" / "car.yaml")


def test_a_dbc_that_loads_only_laxly_says_so(write) -> None:
    path = write({})
    dbc = path.parent / "demo_car.dbc"
    text = dbc.read_text().replace("EngineSpeed : 16|16@1+", "EngineSpeed : 8|16@1+")
    dbc.write_text(text)
    line = 1 + text[: text.index("EngineSpeed : 8|16")].count("\n")
    with pytest.raises(ConfigError, match=rf"demo_car\.dbc:{line}: .*strict: false"):
        load_config(path)
    assert load_config(path, {"databases.0.strict": "false"}).name == "paper car"


TAGS = [
    "!!timestamp x",
    "!!bool x",
    "!!int x",
    "!!float x",
    "!!binary x",
    "!!set {a}",
    "!!omap [a: 1]",
    "!foo x",
    "!!map [a]",
]


@pytest.mark.parametrize("value", TAGS)
@pytest.mark.parametrize(
    "key", ["name", "vehicle.chassis.mass_kg", "inputs.engine_speed", "estimator.method", "can.fd"]
)
def test_a_tag_is_one_clear_error(write, value, key) -> None:
    path = write({key: "REPLACED"})
    text = path.read_text()
    path.write_text(text.replace("REPLACED", value))
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    errors = [p for p in caught.value.problems if p.severity == "error" and not p.key.startswith("databases")]
    assert [error.key for error in errors] == [key]
    assert errors[0].reason.startswith("not understood: ")
    assert value.split()[0] in errors[0].reason
    assert "leave" in errors[0].reason


@pytest.mark.parametrize("tag", ["!!timestamp", "!!bool", "!!int", "!foo", "!!binary"])
def test_a_tagged_key_is_one_clear_error(write, tag) -> None:
    path = write({})
    path.write_text(path.read_text() + f"{tag} extra: 1\n")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    (error,) = caught.value.problems
    assert "a key must be a word or a whole number" in error.reason


def test_a_broken_line_of_a_dbc_that_nobody_needs_is_a_warning(write) -> None:
    path = write({"databases.1": {"file": "other.dbc"}})
    other = path.parent / "other.dbc"
    other.write_text('BO_ 1000 Lamp: 2 X\n SG_ On : 0|1@1+ (1,0) [0|0] "" X\nVAL_ 1001 On 0 "off" ;\n')
    config = load_config(path)
    assert "Lamp" in {message.name for message in config.database.messages}
    (warning,) = config.warnings
    assert warning.key == "databases.1.file"
    assert warning.reason.startswith(f"{other}:3: VAL_ is about the message 1001, which is not there")


@pytest.mark.parametrize(
    ("before", "after", "mapped"),
    [
        (" SG_ EngineSpeed : 16|16@1+", " SG_ EngineSpeed : 16/16@1+", True),
        (" SG_ BrakeActive :", " SG_ BrakeActive", True),
        (" SG_ EngineDataCounter :", " SG_ EngineDataCounter", True),
        ("BO_ 320 Inertial", "BO_ x Inertial", False),
    ],
)
def test_a_broken_line_is_an_error_where_it_is_mapped(write, before, after, mapped) -> None:
    path = write({})
    dbc = path.parent / "demo_car.dbc"
    text = dbc.read_text().replace(before, after)
    dbc.write_text(text)
    place = f"{dbc}:{text[: text.index(after)].count(chr(10)) + 1}: "
    if mapped:
        with pytest.raises(ConfigError) as caught:
            load_config(path)
        (error,) = [p for p in caught.value.problems if p.severity == "error"]
        assert error.reason.startswith(place)
        assert "a signal is written SG_ Name" in error.reason
    else:
        assert any(warning.reason.startswith(place) for warning in load_config(path).warnings)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_units_with_letters_beyond_ascii(write, encoding) -> None:
    path = write({"inputs.acceleration": "Inertial.LongAcceleration", "inputs.grade": "Inertial.RoadGrade"})
    dbc = path.parent / "demo_car.dbc"
    text = dbc.read_text(encoding="cp1252").replace('"m/s^2"', '"m/s²"').replace('"deg"', '"°"')
    dbc.write_bytes(text.encode(encoding))
    load_config(path)


def test_two_dbcs_that_contradict_each_other(write, tmp_path) -> None:
    path = write({"databases.1": {"file": "other.dbc"}})
    text = shipped_dbc("demo_car").read_text()
    (tmp_path / "other.dbc").write_text(text.replace("EngineTorque : 32|12@1+", "EngineTorque : 32|11@1+"))
    with pytest.raises(ConfigError, match=r"databases = .*EngineData.*contradicts"):
        load_config(path)


def test_every_broken_dbc_is_reported(errors) -> None:
    found = errors({"databases.1": {"file": "a.dbc"}, "databases.2": "b.dbc", "databases.3": {"strict": True}})
    assert [p.key for p in found] == ["databases.1.file", "databases.2", "databases.3.file"]
