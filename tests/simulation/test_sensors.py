"""Frames of the simulated car, decoded by cantools, against the truth they were sampled from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cantools.database.can import Database
from numpy.typing import NDArray

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES
from dctorque_can.simulation.sensors import (
    INERTIAL,
    LABORATORY,
    MORE,
    ONE_GEAR,
    PRODUCTION,
    DirectionErrors,
    FrameEmitter,
    InertialErrors,
    Noise,
    SensorProfile,
    Timing,
    emit_frames,
    length_us,
)

DBC = Path(__file__).parents[2] / "dbc" / "demo_car.dbc"
QUIET = Noise(0.0, 0.0, 0.0)
RPM = np.pi / 30
Columns = dict[str, NDArray[np.float64]]


@pytest.fixture(scope="module")
def database() -> Database:
    return load_database([DatabaseFile(DBC)])


def decoded(frames: Frames, database: Database, message: str) -> tuple[NDArray[np.int64], Columns]:
    codec = database.get_message_by_name(message)
    part = frames[frames.can_id == codec.frame_id]
    rows = [codec.decode(bytes(data), decode_choices=False) for data in part.data]
    return part.t_us, {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}


def every_20th_ms(profile: SensorProfile) -> SensorProfile:
    return replace(profile, timing={name: Timing(20_000) for name in profile.timing})


def test_laboratory_sends_everything_each_millisecond(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    frames = emit_frames(paper_truth, paper_vehicle, LABORATORY, database, start_us=5_000)
    assert len(frames) == 80_000
    for can_id in (0x100, 0x110, 0x120, 0x130, 0x131):
        np.testing.assert_array_equal(frames.t_us[frames.can_id == can_id], 5_000 + 1000 * np.arange(16_000))
    assert np.all(np.diff(frames.t_us) >= 0)


def test_production_rates_delays_and_jitter(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    frames = emit_frames(paper_truth, paper_vehicle, PRODUCTION, database)
    assert len(frames) == 6400  # 400 a second
    for name, timing in PRODUCTION.timing.items():
        t, _ = decoded(frames, database, name)
        late = t - timing.offset_us - timing.period_us * np.arange(len(t))
        assert late.min() >= timing.delay_us
        assert late.max() <= timing.delay_us + timing.jitter_us
        # Evenly distributed jitter: mean in the middle, standard deviation of width/√12.
        assert late.mean() == pytest.approx(timing.delay_us + timing.jitter_us / 2, abs=20)
        assert late.std() == pytest.approx(timing.jitter_us / np.sqrt(12), rel=0.1)
    assert np.all(np.diff(frames.t_us) >= 0)


def test_the_inertial_message_changes_no_other(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    frames = emit_frames(paper_truth, paper_vehicle, replace(INERTIAL, seed=4), database)
    more = frames.can_id == 0x140
    assert np.count_nonzero(more) == 800
    without = emit_frames(paper_truth, paper_vehicle, replace(PRODUCTION, seed=4), database)
    assert frames[~more].data.tobytes() == without.data.tobytes()
    assert frames[~more].t_us.tobytes() == without.t_us.tobytes()


def test_acceleration_is_the_force_on_the_car(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    """Without errors it is, by energy, what kinetic and potential energy of the body gain over the way."""
    perfect = InertialErrors(0.0, 0.0, 0.0, 0, 0.0, 0)
    timing = {"Inertial": Timing(20_000, 10_000)}
    profile = SensorProfile("perfect", timing, QUIET, inertial=perfect)
    _, columns = decoded(emit_frames(paper_truth, paper_vehicle, profile, database), database, "Inertial")
    radius_m, mass_kg = paper_vehicle.chassis.wheel_radius_m, paper_vehicle.chassis.mass_kg
    v = radius_m * paper_truth["undriven_wheel_speed_rad_s"][::20]
    mean_v = radius_m * paper_truth["undriven_wheel_speed_rad_s"][10:-10:20]
    gained = np.diff(0.5 * mass_kg * v**2 + paper_truth["grade_work_j"][::20])
    moving = mean_v > 1.0
    assert np.count_nonzero(moving) > 500
    force = gained[moving] / (mass_kg * 0.02 * mean_v[moving])
    np.testing.assert_allclose(columns["LongAcceleration"][moving], force, atol=0.03)
    np.testing.assert_allclose(columns["RoadGrade"], np.degrees(0.1), atol=0.0101)


def test_offsets_last_and_are_drawn_from_the_seed(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    offsets = []
    for seed in range(40):
        errors = InertialErrors(noise_m_s2=0.0)
        profile = replace(INERTIAL, timing={"Inertial": Timing(20_000)}, inertial=errors, seed=seed)
        emitter = FrameEmitter(paper_vehicle, profile, database)
        first, again = (emitter.emit(paper_truth[:1000]) for _ in range(2))
        _, columns = decoded(first, database, "Inertial")
        _, repeated = decoded(again, database, "Inertial")
        np.testing.assert_array_equal(columns["LongAcceleration"], repeated["LongAcceleration"])
        offsets.append([columns["LongAcceleration"][10] - 9.80665 * np.sin(0.1), columns["RoadGrade"][10]])
    np.testing.assert_allclose(np.std(offsets, axis=0), [0.15, np.degrees(0.01)], rtol=0.35)


def test_without_noise_only_the_resolution_of_the_dbc_is_lost(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    """Sampled between the rows of the truth, by the linear interpolation of neighbours."""
    profile = SensorProfile(
        "quiet", {name: Timing(20_000, 300) for name in LABORATORY.timing}, QUIET, driven_axle="front"
    )
    frames = emit_frames(paper_truth, paper_vehicle, profile, database)

    def at_samples(name: str) -> NDArray[np.float64]:
        column = paper_truth[name]
        return np.asarray(0.7 * column[:-1:20] + 0.3 * column[1::20])

    _, engine = decoded(frames, database, "EngineData")
    np.testing.assert_allclose(engine["EngineSpeed"] * RPM, at_samples("engine_speed_rad_s"), atol=0.126 * RPM)
    np.testing.assert_allclose(engine["EngineTorque"], at_samples("engine_torque_nm"), atol=0.501)
    np.testing.assert_allclose(engine["AcceleratorPedal"] / 100, at_samples("pedal"), atol=0.0021)
    assert np.any(engine["BrakeActive"] == 1)
    assert np.any(engine["BrakeActive"] == 0)
    _, shafts = decoded(frames, database, "InputShafts")
    for i in (1, 2):
        true = np.maximum(0.0, at_samples(f"shaft{i}_speed_rad_s"))
        np.testing.assert_allclose(shafts[f"InputShaft{i}Speed"] * RPM, true, atol=0.126 * RPM)
    r = paper_vehicle.chassis.wheel_radius_m
    for message, wheels, name in (
        ("WheelSpeedsFront", ("FL", "FR"), "wheel_speed_rad_s"),
        ("WheelSpeedsRear", ("RL", "RR"), "undriven_wheel_speed_rad_s"),
    ):
        _, columns = decoded(frames, database, message)
        for wheel in wheels:
            true = np.maximum(0.0, at_samples(name)) * r * 3.6
            np.testing.assert_allclose(columns[f"WheelSpeed{wheel}"], true, atol=0.01563)
    _, gearbox = decoded(frames, database, "Gearbox")
    for i in (1, 2):
        np.testing.assert_allclose(
            gearbox[f"Clutch{i}Position"], at_samples(f"clutch{i}_position_mm"), atol=0.00501
        )
        rows = paper_truth[:-1:20]
        np.testing.assert_array_equal(
            gearbox[f"GearShaft{i}"], np.where(rows[f"changing{i}"], 14, rows[f"gear{i}"])
        )
    assert 14 in gearbox["GearShaft1"]


def test_noise_has_the_stated_size_is_white_and_independent(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    frames = emit_frames(paper_truth, paper_vehicle, LABORATORY, database)
    moving = slice(2000, 13_500)
    _, engine = decoded(frames, database, "EngineData")
    _, shafts = decoded(frames, database, "InputShafts")
    _, rear = decoded(frames, database, "WheelSpeedsRear")
    truth = paper_truth[:-1]
    step = 0.25 * RPM
    wheel_step = 0.03125 / 3.6 / paper_vehicle.chassis.wheel_radius_m
    errors = [
        (engine["EngineSpeed"] * RPM - truth["engine_speed_rad_s"], 0.3, step),
        (shafts["InputShaft1Speed"] * RPM - truth["shaft1_speed_rad_s"], 0.3, step),
        (shafts["InputShaft2Speed"] * RPM - truth["shaft2_speed_rad_s"], 0.3, step),
    ]
    for wheel in ("RL", "RR"):
        speed = rear[f"WheelSpeed{wheel}"] / 3.6 / paper_vehicle.chassis.wheel_radius_m
        errors.append((speed - truth["undriven_wheel_speed_rad_s"], 0.02, wheel_step))
    series = np.array([error[moving] for error, _, _ in errors])
    for error, (_, sigma, resolution) in zip(series, errors, strict=True):
        assert error.std() == pytest.approx(np.hypot(sigma, resolution / np.sqrt(12)), rel=0.03)
        assert abs(error.mean()) < 5 * sigma / np.sqrt(len(error))
        assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05
    assert np.abs(np.corrcoef(series) - np.eye(len(series))).max() < 0.05


def test_seed_alone_decides(paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database) -> None:
    first, again, other = (
        emit_frames(paper_truth, paper_vehicle, replace(PRODUCTION, seed=seed), database) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.data, again.data)
    np.testing.assert_array_equal(first.t_us, again.t_us)
    assert np.any(first.data != other.data)
    assert np.any(first.t_us != other.t_us)


def test_nominal_torque_may_be_wrong_and_late(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    profile = replace(every_20th_ms(LABORATORY), torque_gain=0.9, torque_offset_nm=7.0, torque_delay_us=40_000)
    _, engine = decoded(emit_frames(paper_truth, paper_vehicle, profile, database), database, "EngineData")
    late = paper_truth["engine_torque_nm"][:-1:20]
    np.testing.assert_allclose(engine["EngineTorque"][2:], 0.9 * late[:-2] + 7.0, atol=0.501)


def test_rear_driven_car_swaps_the_axles(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    quiet = replace(every_20th_ms(LABORATORY), noise=QUIET)
    front, rear = (
        emit_frames(paper_truth, paper_vehicle, replace(quiet, driven_axle=axle), database)
        for axle in ("front", "rear")
    )
    _, driven = decoded(front, database, "WheelSpeedsFront")
    _, swapped = decoded(rear, database, "WheelSpeedsRear")
    np.testing.assert_array_equal(driven["WheelSpeedFL"], swapped["WheelSpeedRL"])


def test_emitting_again_continues_counters_without_repeating_noise(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    emitter = FrameEmitter(paper_vehicle, PRODUCTION, database)
    one = emitter.emit(paper_truth)
    two = emitter.emit(paper_truth, start_us=length_us(paper_truth))
    both = Frames.concatenate([one, two])
    assert np.any(one.data != two.data)
    for name in PRODUCTION.timing:
        t, columns = decoded(both, database, name)
        steps = np.diff(columns[f"{name}Counter"]) % 15
        assert np.all(steps == 1), name
        assert np.diff(t).min() > 0
        assert np.diff(t).max() < 1.1 * PRODUCTION.timing[name].period_us


def test_wrong_database_or_profile_is_refused(paper_vehicle: Vehicle, database: Database) -> None:
    with pytest.raises(DctorqueError, match="demo_car"):
        FrameEmitter(paper_vehicle, PRODUCTION, Database([]))
    with pytest.raises(DctorqueError, match="no sensors for message Radio"):
        FrameEmitter(paper_vehicle, replace(PRODUCTION, timing={"Radio": Timing(1000)}), database)
    late = replace(PRODUCTION, timing={"EngineData": Timing(1000, jitter_us=1000)})
    with pytest.raises(DctorqueError, match="jitter"):
        FrameEmitter(paper_vehicle, late, database)


@pytest.mark.parametrize("unsigned", [set(), {"wheels"}, {"shafts"}, {"wheels", "shafts"}])
def test_unsigned_speeds_are_the_magnitude_of_signed_ones(paper_vehicle: Vehicle, unsigned: set[str]) -> None:
    """Of a car that rolls backwards; without noise, within the resolution. Nothing else is touched."""
    truth = simulate(paper_vehicle, replace(MANOEUVRES["roll_back"](paper_vehicle), duration_s=5.0))
    database = load_database([DatabaseFile(DBC.with_name("demo_car_signed.dbc"))])
    quiet = replace(PRODUCTION, noise=QUIET)
    signed = emit_frames(truth, paper_vehicle, quiet, database)
    sent = emit_frames(truth, paper_vehicle, replace(quiet, unsigned=frozenset(unsigned)), database)
    np.testing.assert_array_equal(sent.t_us, signed.t_us)
    for message, group in (("InputShafts", "shafts"), ("WheelSpeedsRear", "wheels"), ("EngineData", "")):
        (_, before), (_, after) = (decoded(frames, database, message) for frames in (signed, sent))
        for name, value in before.items():
            if not name.startswith(("InputShaft1", "InputShaft2", "WheelSpeedR", "EngineSpeed")):
                continue
            if group:
                assert value.min() < -0.5
            wanted = np.abs(value) if group in unsigned else value
            np.testing.assert_allclose(
                after[name], wanted, atol=0.26 if group == "shafts" else 0.032, err_msg=name
            )


def test_unsigned_noise_is_that_of_the_magnitude(paper_vehicle: Vehicle) -> None:
    """At rest it shows as values above zero, never below; rolling backwards it is the usual one."""
    truth = simulate(paper_vehicle, replace(MANOEUVRES["roll_back"](paper_vehicle), duration_s=2.3))
    database = load_database([DatabaseFile(DBC.with_name("demo_car_signed.dbc"))])
    sensors = replace(LABORATORY, unsigned=frozenset({"wheels", "shafts"}))
    _, shafts = decoded(emit_frames(truth, paper_vehicle, sensors, database), database, "InputShafts")
    speed = shafts["InputShaft1Speed"] * RPM
    assert speed.min() == 0.0
    back = np.arange(len(speed)) > 1600
    error = speed[back] - np.abs(truth["shaft1_speed_rad_s"][:-1][back])
    assert error.std() == pytest.approx(0.3, rel=0.1)
    assert abs(error.mean()) < 0.05


def test_the_signed_bus_sends_the_same_forwards(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle, database: Database
) -> None:
    """Same resolution, same noise: what is not near standstill is the same number."""
    other = load_database([DatabaseFile(DBC.with_name("demo_car_signed.dbc"))])
    usual, signed = (emit_frames(paper_truth, paper_vehicle, PRODUCTION, each) for each in (database, other))
    for message in ("InputShafts", "WheelSpeedsFront", "Gearbox"):
        (_, before), (_, after) = decoded(usual, database, message), decoded(signed, other, message)
        for name in before:
            if "Crc" not in name:
                np.testing.assert_array_equal(before[name], np.maximum(after[name], 0.0), err_msg=name)


def test_left_and_right_driven_wheel_have_their_own_speeds(paper_vehicle: Vehicle, database: Database) -> None:
    """With one wheel on ice; the wheels of the other axle are alike."""
    truth = simulate(paper_vehicle, replace(MANOEUVRES["split_mu"](paper_vehicle), duration_s=4.0))
    frames = emit_frames(truth, paper_vehicle, replace(LABORATORY, noise=QUIET), database)
    kmh = 3.6 * paper_vehicle.chassis.wheel_radius_m
    for side, wheel in ((1, "FL"), (-1, "FR")):
        _, front = decoded(frames, database, "WheelSpeedsFront")
        expected = (truth["wheel_speed_rad_s"] + side * truth["wheel_difference_rad_s"])[:-1] * kmh
        np.testing.assert_allclose(front[f"WheelSpeed{wheel}"], np.maximum(expected, 0.0), atol=0.02)
    _, rear = decoded(frames, database, "WheelSpeedsRear")
    np.testing.assert_array_equal(rear["WheelSpeedRL"], rear["WheelSpeedRR"])
    assert front["WheelSpeedFL"].max() > 20.0 + front["WheelSpeedFR"].max()


def test_one_gear_changes_no_other_message_and_follows_the_shift(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle
) -> None:
    """At the end of the shift from 1 to 2 clutch 1 is open, in its middle clutch 2 has more capacity than it."""
    database = load_database([DatabaseFile(DBC.with_name("demo_car_one_gear.dbc"))])
    frames = emit_frames(paper_truth, paper_vehicle, replace(ONE_GEAR, seed=4), database)
    others = frames[frames.can_id != 0x124]
    without = emit_frames(paper_truth, paper_vehicle, replace(PRODUCTION, seed=4), database)
    np.testing.assert_array_equal(others.data, without.data)
    np.testing.assert_array_equal(others.t_us, without.t_us)
    changed_at = {}
    for changes in ("middle", "end"):
        profile = replace(ONE_GEAR, timing={"Transmission": Timing(1_000)}, gear_changes=changes)
        t_us, told = decoded(emit_frames(paper_truth, paper_vehicle, profile, database), database, "Transmission")
        first = int(np.flatnonzero(told["ActualGear"] == 2)[0])
        row = paper_truth[np.searchsorted(paper_truth["t_us"], t_us[first])]
        changed_at[changes] = t_us[first]
        assert row["clutch2_capacity_nm"] > row["clutch1_capacity_nm"]
        assert (row["clutch1_capacity_nm"] > 2.0) == (changes == "middle")
        assert told["ShiftInProgress"][first] == 1
        assert told["ClutchState"][first] == 1
        assert told["ShiftInProgress"][first - 1000] == 0
        assert told["TargetGear"][first - 1000] == 2  # preselected
        assert told["ActualGear"][first - 1000] == 1
    assert changed_at["middle"] < changed_at["end"]


def test_more_messages_change_no_other_one(paper_truth: NDArray[np.void], paper_vehicle: Vehicle) -> None:
    database = load_database([DatabaseFile(DBC), DatabaseFile(DBC.with_name("demo_car_more.dbc"))])
    frames = emit_frames(paper_truth, paper_vehicle, replace(MORE, seed=4), database)
    before = replace(PRODUCTION, seed=4)
    others = frames[np.isin(frames.can_id, [database.get_message_by_name(n).frame_id for n in before.timing])]
    without = emit_frames(paper_truth, paper_vehicle, before, database)
    np.testing.assert_array_equal(others.data, without.data)
    np.testing.assert_array_equal(others.t_us, without.t_us)


def test_directions_are_late_and_stick_as_told(paper_vehicle: Vehicle) -> None:
    """At rest standstill, or what was said before; of a wheel that turns backwards, 60 ms later, backward."""
    database = load_database([DatabaseFile(DBC), DatabaseFile(DBC.with_name("demo_car_more.dbc"))])
    truth = simulate(paper_vehicle, MANOEUVRES["roll_back"](paper_vehicle))
    speed = truth["undriven_wheel_speed_rad_s"]
    late = DirectionErrors(delay_us=60_000)
    said = {}
    for name, errors in (
        ("late", late),
        ("freezes", replace(late, freezes=True)),
        ("stuck", replace(late, stuck="forward")),
    ):
        profile = replace(MORE, timing={"WheelDirections": Timing(1_000)}, direction=errors)
        t_us, columns = decoded(emit_frames(truth, paper_vehicle, profile, database), database, "WheelDirections")
        said[name] = columns
    assert set(columns) >= {f"WheelDirection{wheel}" for wheel in ("FL", "FR", "RL", "RR")}
    backwards = truth["t_us"][np.flatnonzero(speed < -0.3)[0]]
    first = t_us[np.flatnonzero(said["late"]["VehicleDirection"] == 2)[0]]
    assert abs(first - backwards - 60_000) <= 1_000
    rests = said["late"]["VehicleDirection"] == 0
    assert rests[0]
    assert set(said["freezes"]["VehicleDirection"][rests]) == {1.0, 2.0}
    np.testing.assert_array_equal(
        said["freezes"]["VehicleDirection"][~rests], said["late"]["VehicleDirection"][~rests]
    )
    assert set(said["stuck"]["WheelDirectionRL"]) == {1.0}


def test_shares_of_the_reference_torque_are_the_engine_torque(
    paper_truth: NDArray[np.void], paper_vehicle: Vehicle
) -> None:
    """Indicated less friction, times what 100 % are: the nominal torque, within half a step of both."""
    database = load_database([DatabaseFile(DBC), DatabaseFile(DBC.with_name("demo_car_more.dbc"))])
    timing = {"EngineShare": Timing(1_000), "EngineReference": Timing(1_000_000)}
    profile = replace(MORE, noise=QUIET, reference_torque_nm=300.0, timing=timing)
    frames = emit_frames(paper_truth, paper_vehicle, profile, database)
    t_us, share = decoded(frames, database, "EngineShare")
    assert set(decoded(frames, database, "EngineReference")[1]["ReferenceTorque"]) == {300.0}
    torque = (share["IndicatedTorque"] - share["FrictionTorque"]) / 100.0 * 300.0
    nominal = np.interp(t_us, paper_truth["t_us"], paper_truth["engine_torque_nominal_nm"])
    assert np.abs(torque - nominal).max() <= 2 * 0.05 / 100.0 * 300.0 + 1e-9
    assert share["FrictionTorque"].min() > 0.0
