"""What the sections of signals become: judged by values that a person can work out."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dctorque_can.config.load import Config, ConfigError, load_config
from dctorque_can.driveline.parameters import DrivenAxle, Thermal
from dctorque_can.driveline.phases import ClutchActuation, PhaseSource
from dctorque_can.estimators.oh2014.design import RoadLoad, SubObserver
from dctorque_can.pipeline.samples import Input, Protection, Quantity
from dctorque_can.pipeline.settings import GearInference, OneGear
from dctorque_can.resources import shipped_dbc

Load = Callable[..., Config]


def one(config: Config, quantity: Quantity) -> Input:
    (found,) = [each for each in config.inputs if each.quantity is quantity]
    return found


def si_of(config: Config, quantity: Quantity, raw: dict[str, int]) -> float:
    """Return an input's value from raw signal values, scaled by cantools."""
    total = 0.0
    for term in one(config, quantity).terms:
        signal = config.database.get_message_by_name(term.message).get_signal_by_name(term.signal)
        if term.values:
            total += term.values[raw[term.signal]]
        else:
            total += (
                term.factor * signal.conversion.raw_to_scaled(raw[term.signal], decode_choices=False) + term.offset
            )
    return total


def test_units_of_the_dbc(load: Load) -> None:
    config = load({})
    assert si_of(config, Quantity.ENGINE_SPEED, {"EngineSpeed": 4 * 3000}) == pytest.approx(100 * math.pi)
    assert si_of(config, Quantity.ENGINE_TORQUE, {"EngineTorque": 1150}) == pytest.approx(150)
    wheel = si_of(config, Quantity.WHEEL_SPEED_RL, {"WheelSpeedRL": 32 * 36})
    assert wheel == pytest.approx(10 / 0.312)  # 36 km/h
    assert si_of(config, Quantity.CLUTCH1_POSITION, {"Clutch1Position": 725}) == pytest.approx(7.25)


def test_a_text_is_a_signal(load: Load) -> None:
    speed = one(load({"inputs.engine_speed": "EngineData.EngineSpeed"}), Quantity.ENGINE_SPEED)
    assert [(t.message, t.signal, t.not_available) for t in speed.terms] == [
        ("EngineData", "EngineSpeed", frozenset())
    ]
    assert speed.timeout_us == 100_000


def test_indicated_minus_friction_in_per_cent_of_a_reference(load: Load) -> None:
    torque = {
        "sum": [
            {"signal": "EngineData.AcceleratorPedal"},  # stands for the indicated torque, the next for friction
            {"signal": "EngineData.EngineDataCounter", "factor": -2, "unit": "%", "not_available": [15]},
            {"signal": "EngineData.BrakeActive", "unit": "kNm", "offset": 0.05, "not_available": [3, 2]},
        ],
        "reference_nm": 400,
        "not_available": [255],
        "unit": "%",
        "range": [-50, 120],
    }
    config = load({"inputs.engine_torque": torque})
    raw = {"AcceleratorPedal": 125, "EngineDataCounter": 5, "BrakeActive": 1}  # 50 %, 5 %, 1 kN·m
    value = si_of(config, Quantity.ENGINE_TORQUE, raw)
    assert value == pytest.approx(400 * (0.50 - 2 * 0.05) + 1000 * (1 + 0.05))
    given = one(config, Quantity.ENGINE_TORQUE)
    assert (given.minimum, given.maximum) == pytest.approx((-200, 480))
    assert [t.not_available for t in given.terms] == [{255}, {15}, {2, 3}]


def test_offset_is_in_the_unit_of_the_signal(load: Load) -> None:
    config = load({"inputs.shaft1_speed": {"signal": "InputShafts.InputShaft1Speed", "factor": -1, "offset": 60}})
    assert si_of(config, Quantity.SHAFT1_SPEED, {"InputShaft1Speed": 4 * 120}) == pytest.approx(-2 * math.pi)


def test_range_is_in_the_unit_of_the_signal(load: Load) -> None:
    speed = one(load({"inputs.engine_speed.range": [300, 6000]}), Quantity.ENGINE_SPEED)
    assert (speed.minimum, speed.maximum) == pytest.approx((10 * math.pi, 200 * math.pi))


def test_a_unit_overrules_the_dbc_with_a_warning(load: Load) -> None:
    config = load({"inputs.engine_speed.unit": "rad/s"})
    assert si_of(config, Quantity.ENGINE_SPEED, {"EngineSpeed": 400}) == pytest.approx(100)
    (warning,) = config.warnings
    assert (warning.key, warning.severity) == ("inputs.engine_speed.unit", "warning")
    assert load({"inputs.engine_speed.unit": "U/min"}).warnings == ()


def test_names_of_the_value_table(load: Load) -> None:
    config = load({"inputs.engine_speed.not_available": ["not available", 65534]})
    assert one(config, Quantity.ENGINE_SPEED).terms[0].not_available == {65535, 65534}
    gear = one(config, Quantity.GEAR2).terms[0]
    assert gear.values == {0: 0.0, 14: 0.0, 2: 2.0, 4: 4.0}


def test_resolution_of_the_dbc(load: Load) -> None:
    """A quarter of a revolution per minute is π/120 rad/s; rounding errors of several terms add as squares."""
    speeds = [{"signal": f"InputShafts.InputShaft{i}Speed", "factor": factor} for i, factor in ((1, 3), (2, -4))]
    config = load({"inputs.shaft2_speed": {"sum": speeds}})
    engine, first, second, *wheels = config.settings.kalman.speed_resolutions_rad_s
    assert (engine, first, second) == pytest.approx((math.pi / 120, math.pi / 120, 5 * math.pi / 120))
    assert wheels == pytest.approx([0.03125 / 3.6 / 0.312] * 4)


def test_floats_and_missing_speeds_are_not_rounded(write: Callable[..., Path], removed: object) -> None:
    path = write({"inputs.shaft1_speed": removed, "estimator.method": "kalman"})
    dbc = path.parent / "demo_car.dbc"
    text = dbc.read_text().replace("InputShaft2Speed : 32|16@1+", "InputShaft2Speed : 32|32@1-")
    dbc.write_text(text + "\nSIG_VALTYPE_ 272 InputShaft2Speed : 1;\n")
    engine, first, second, *_ = load_config(path).settings.kalman.speed_resolutions_rad_s
    assert engine > 0
    assert (first, second) == (0, 0)


def test_reverse_and_one_signal_for_both_shafts(load: Load) -> None:
    reverse = {"shaft": 2, "ratio": 3.5, "final_drive": 3.7, "inertia_kgm2": 0.001}
    signal = "Gearbox.GearShaft1"
    config = load(
        {
            "vehicle.gears.R": reverse,
            "gears.shaft1": {"signal": signal, "values": {0: 0, 1: 1, 3: 3, 5: 5, 2: "neutral", 13: "neutral"}},
            "gears.shaft2": {"signal": signal, "values": {0: "neutral", 2: 2, 4: 4, 13: "reverse", 1: 0}},
        }
    )
    assert one(config, Quantity.GEAR2).terms[0].values == {0: 0.0, 2: 2.0, 4: 4.0, 13: -1.0, 1: 0.0}
    assert one(config, Quantity.GEAR2).minimum == -1
    assert config.settings.vehicle.gear(-1).ratio == -3.5
    assert config.warnings == ()


def test_gears_from_ratio(load: Load) -> None:
    config = load({"gears": {"source": "ratio", "engage_tolerance": 0.02, "confirm_ms": 80}})
    assert config.settings.gear_inference == GearInference(0.02, 0.06, 80_000, 3.0)
    assert not {Quantity.GEAR1, Quantity.GEAR2} & {each.quantity for each in config.inputs}


def test_phase_from_position(load: Load) -> None:
    error = {"clutch_phase.clutch1.kissing_point_error": 0.1}
    phases = load({"clutch_phase.clutch2.closes": "decreasing", **error}).settings.phases
    assert phases.clutches == (
        ClutchActuation(PhaseSource.POSITION, 3.0, 0.2, True, 0.1),
        ClutchActuation(PhaseSource.POSITION, 3.0, 0.2, False, pytest.approx(0.6)),
    )


def test_phase_from_flag(load: Load) -> None:
    flag = {"signal": "EngineData.BrakeActive", "values": {"pressed": "open", 0: "closed"}}
    config = load({"clutch_phase": {"source": "flag", "clutch1": flag, "clutch2": flag, "lock_time_ms": 0}})
    assert config.settings.phases.clutches[1].source is PhaseSource.FLAG
    assert one(config, Quantity.CLUTCH2_OPEN).terms[0].values == {1: 1.0, 0: 0.0}
    assert config.settings.phases.lock_time_us == 0


def test_phase_from_command(load: Load) -> None:
    command: dict[str, Any] = {"signal": "EngineData.EngineTorque", "threshold_nm": 5, "hysteresis_nm": 2}
    config = load({"clutch_phase": {"source": "command", "clutch1": command, "clutch2": command}})
    assert config.settings.phases.clutches[0] == ClutchActuation(PhaseSource.COMMAND, 5.0, 2.0)
    assert si_of(config, Quantity.CLUTCH1_COMMAND, {"EngineTorque": 1007}) == 7


def test_a_command_beside_the_positions(load: Load) -> None:
    """Where positions tell the phases, a command is an input like any other."""
    command = {"signal": "EngineData.EngineTorque", "not_available": [4095], "factor": 2, "timeout_ms": 50}
    config = load({"inputs.clutch2_command": command})
    assert config.warnings == ()
    assert one(config, Quantity.CLUTCH2_COMMAND).timeout_us == 50_000
    assert si_of(config, Quantity.CLUTCH2_COMMAND, {"EngineTorque": 1100}) == 200
    assert one(config, Quantity.CLUTCH2_POSITION).maximum == 12
    assert Quantity.CLUTCH1_COMMAND not in {each.quantity for each in config.inputs}


def test_thermal_data_of_one_clutch(load: Load) -> None:
    thermal = {"heat_capacity_j_per_k": 4000, "cooling_w_per_k": 35.5, "coolant_c": -10}
    first, second = load({"vehicle.clutches.2.thermal": thermal}).settings.vehicle.clutches
    assert first.thermal is None
    assert second.thermal == Thermal(4000.0, 35.5, -10.0)
    assert second == replace(first, thermal=second.thermal)


def test_protection_defaults(load: Load) -> None:
    counter = {"counter_signal": "EngineDataCounter"}
    config = load(
        {
            "protection.EngineData": counter,
            "protection.Gearbox": {"crc": "crc8_j1850", "crc_signal": "GearboxCrc", "max_counter_delta": 1}
            | {"counter_signal": "GearboxCounter", "counter_modulus": 15},
        }
    )
    assert Protection("EngineData", counter_signal="EngineDataCounter", counter_modulus=16) in config.protections
    assert Protection("Gearbox", "GearboxCounter", 15, 1, "crc8_j1850", "GearboxCrc") in config.protections


def test_estimator_times_and_choices(load: Load) -> None:
    settings = load(
        {
            "vehicle.driven_axle": "rear",
            "estimator": {
                "step_ms": 0.5,
                "period_ms": 5,
                "max_gap_ms": 250,
                "oh2014": {"road_load": "flat", "sub_observer": "unknown_input", "torque_crossover_rad_s": 11},
            },
        }
    ).settings
    assert (settings.step_us, settings.estimate_period_us, settings.max_gap_us) == (500, 5000, 250_000)
    assert settings.observer.road_load is RoadLoad.FLAT
    assert settings.observer.sub_observer is SubObserver.UNKNOWN_INPUT
    assert settings.observer.torque_crossover_rad_s == 11
    assert settings.driven_axle is DrivenAxle.REAR


def test_the_bus_in_the_words_of_python_can(load: Load) -> None:
    can = {
        "interface": "pcan",
        "channel": "PCAN_USBBUS1",
        "bitrate": 500_000,
        "fd": True,
        "options": {"state": "x"},
    }
    arguments = load({"can": can}).can.arguments()
    assert arguments == {
        "interface": "pcan",
        "channel": "PCAN_USBBUS1",
        "bitrate": 500_000,
        "fd": True,
        "receive_own_messages": False,
        "state": "x",
    }


def test_edges_have_defaults(load: Load, removed: object) -> None:
    config = load(dict.fromkeys(("can", "output", "logging", "estimator", "protection"), removed))
    assert (config.can.interface, config.can.channel) == ("socketcan", "can0")
    assert not config.output.enabled
    assert config.logging.flush_ms == 200
    assert config.protections == ()


WARNINGS = [
    ({"inputs.engine_speed.timeout_ms": 15}, "inputs.engine_speed.timeout_ms", "two periods of 10 ms"),
    (
        {"inputs.engine_speed": {"signal": "EngineData.EngineSpeed"}},
        "inputs.engine_speed",
        "not_available: [65535]",
    ),
    ({"vehicle.gears.4.ratio": 1.40}, "vehicle.gears.4", "errors of the observer grow"),
    ({"vehicle.gears.4.ratio": 1.60}, "vehicle.gears.4", "which final drive"),
    ({"gears.shaft1.values": {0: 0, 1: 1, 3: 3}}, "gears.shaft1.values", "no raw value means gear 5"),
    ({"gears.shaft1.values": {1: 1, 3: 3, 5: 5}}, "gears.shaft1.values", "no raw value means neutral"),
    ({"inputs.wheel_speeds": {"fl": "WheelSpeedsFront.WheelSpeedFL"}}, "inputs.wheel_speeds", "no undriven wheel"),
    ({"inputs.wheel_speeds": {"rl": "WheelSpeedsRear.WheelSpeedRL"}}, "inputs.wheel_speeds", "no driven wheel"),
    (
        {"inputs.shaft1_speed.delay_ms": 200},  # 80 of 400 frames/s
        "estimator.period_ms",
        "frames of the last 200 ms again (the longest delay_ms), which are 32000 a second; give 4 or more",
    ),
]


@pytest.mark.parametrize(("changes", "key", "reason"), WARNINGS)
def test_what_is_doubtful_is_a_warning(load: Load, changes, key, reason) -> None:
    warnings = load(changes).warnings
    assert any(w.key == key and reason in w.reason and w.severity == "warning" for w in warnings), warnings


@pytest.mark.parametrize(
    "changes",
    [{"inputs.shaft1_speed.delay_ms": 120}, {"inputs.shaft1_speed.delay_ms": 200, "estimator.period_ms": 4}],
)
def test_delays_that_cost_little_are_no_warning(load: Load, changes) -> None:
    assert load(changes).warnings == ()


def test_without_cycle_times_nobody_knows_what_delays_cost(write) -> None:
    path = write({"inputs.shaft1_speed.delay_ms": 200})
    dbc = path.with_name("demo_car.dbc")
    lines = dbc.read_text().splitlines()
    dbc.write_text("\n".join(line for line in lines if "GenMsgCycleTime" not in line))
    (warning,) = load_config(path).warnings
    assert warning.key == "databases"
    assert warning.reason.startswith("no cycle time (GenMsgCycleTime) of any mapped message in the DBC")
    assert "timeout_ms" in warning.reason
    assert "WheelSpeedsFront 200 ms" in warning.reason


def test_entries_tell_people_what_the_file_says(load: Load) -> None:
    entries = {entry.key: entry for entry in load({}).entries}
    wheel = entries["inputs.wheel_speeds.fl"]
    assert (wheel.units, wheel.periods_ms) == (("km/h",), (20,))
    assert entries["clutch_phase.clutch1"].input.quantity is Quantity.CLUTCH1_POSITION
    assert entries["gears.shaft2"].units == ("",)


DATABASE = {"databases.0.file": str(shipped_dbc("demo_car_one_gear"))}
GEAR_VALUES = {"neutral": "neutral", 1: 1, 2: 2, 3: 3, 4: 4, 5: 5}
GEARBOX = {
    "source": "gearbox",
    "actual": {"signal": "Transmission.ActualGear", "values": GEAR_VALUES},
    "target": {"signal": "Transmission.TargetGear", "values": GEAR_VALUES},
    "shift_in_progress": {"signal": "Transmission.ShiftInProgress", "values": {"no": "no", 1: "yes"}},
    "confirm_ms": 80,
}


def test_one_gear_of_the_whole_gearbox(load: Load) -> None:
    config = load(DATABASE | {"gears": GEARBOX})
    assert config.settings.one_gear == OneGear(GearInference(0.03, 0.06, 80_000, 3.0))
    assert config.settings.gear_inference is None
    assert one(config, Quantity.GEAR).terms[0].values == {n: float(n) for n in range(6)}
    assert one(config, Quantity.TARGET_GEAR).terms[0].signal == "TargetGear"
    assert one(config, Quantity.SHIFT_IN_PROGRESS).terms[0].values == {0: 0.0, 1: 1.0}
    assert not {Quantity.GEAR1, Quantity.GEAR2} & {each.quantity for each in config.inputs}
    assert config.warnings == ()


def test_a_gear_of_the_gearbox_that_the_vehicle_lacks(load: Load) -> None:
    gears = GEARBOX | {"actual": {"signal": "Transmission.ActualGear", "values": GEAR_VALUES | {7: 7}}}
    with pytest.raises(ConfigError, match=r"gears.actual.values.7 = 7: the vehicle has no gear 7"):
        load(DATABASE | {"gears": gears})


def test_one_signal_for_both_shafts_is_one_gear(load: Load) -> None:
    signal = "Transmission.ActualGear"
    flag = {"signal": signal, "values": {0: "open", 1: "closed", 2: "closed"}}
    config = load(
        DATABASE
        | {
            "gears.shaft1": {"signal": signal, "values": {0: 0, 1: 1, 2: "neutral", 3: 3, 4: 0, 5: 5}},
            "gears.shaft2": {"signal": signal, "values": {0: 0, 1: 0, 2: 2, 3: 0, 4: 4, 5: 0}, "timeout_ms": 50},
            "clutch_phase": {"source": "flag", "clutch1": flag, "clutch2": flag},
        }
    )
    gear = one(config, Quantity.GEAR)
    assert gear.terms[0].values == {n: float(n) for n in range(6)}
    assert gear.timeout_us == 50_000
    assert config.settings.one_gear is not None
    assert {clutch.source for clutch in config.settings.phases.clutches} == {PhaseSource.STATE}
    assert one(config, Quantity.CLUTCH_STATE).terms[0].values == {0: 0.0, 1: 2.0, 2: 2.0}


def test_one_state_of_both_clutches_or_none(load: Load) -> None:
    both = {"signal": "Transmission.ClutchState", "values": {"open": "open", 1: "slipping", 2: "closed"}}
    config = load(DATABASE | {"clutch_phase": {"source": "state", "both": both}})
    assert {clutch.source for clutch in config.settings.phases.clutches} == {PhaseSource.STATE}
    assert one(config, Quantity.CLUTCH_STATE).terms[0].values == {0: 0.0, 1: 1.0, 2: 2.0}
    config = load({"clutch_phase": {"source": "none", "lock_time_ms": 80}})
    assert {clutch.source for clutch in config.settings.phases.clutches} == {PhaseSource.NONE}
    assert config.settings.phases.lock_time_us == 80_000
    with pytest.raises(ConfigError, match=r"clutch_phase\.source = none: the method oh2014 must be told"):
        load({"clutch_phase": {"source": "none"}, "estimator.method": "oh2014"})


def test_a_rate_is_in_the_unit_of_the_signal_and_bears_its_steps(load: Load) -> None:
    speed = one(load({"inputs.engine_speed.max_rate": 60_000}), Quantity.ENGINE_SPEED)
    assert speed.most_per_s == pytest.approx(2000 * math.pi)
    assert speed.resolution == pytest.approx(math.pi / 120)
    assert one(load({}), Quantity.ENGINE_SPEED).most_per_s == math.inf


@pytest.mark.parametrize("rate", [0, -5, "fast", math.inf])
def test_a_rate_is_positive_and_finite(errors: Callable[..., list[Any]], rate: object) -> None:
    assert [problem.key for problem in errors({"inputs.engine_speed.max_rate": rate})] == [
        "inputs.engine_speed.max_rate"
    ]


def test_a_timeout_is_learned_where_it_says_so(load: Load) -> None:
    config = load({"inputs.engine_speed.timeout_ms": "learned", "gears.shaft1.timeout_ms": "learned"})
    learned = {given.quantity for given in config.inputs if given.learns_timeout}
    assert learned == {Quantity.ENGINE_SPEED, Quantity.GEAR1}


@pytest.mark.parametrize("timeout", [0, "known"])
def test_another_word_is_no_timeout(errors: Callable[..., list[Any]], timeout: object) -> None:
    (problem,) = errors({"inputs.engine_speed.timeout_ms": timeout})
    assert problem.key == "inputs.engine_speed.timeout_ms"
    assert "learned" in problem.reason
