"""Estimates on the bus: values, validity, protection and timing, read back by cantools and autosar-e2e."""

import math

import e2e.p01
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import ESTIMATE, ONLY_KALMAN, ONLY_OH2014, Status
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from .demo import DATABASE as DEMO_DATABASE
from .demo import DBC, identical

DATABASE = load_database([DatabaseFile(DBC / "dctorque.dbc")])
ALL_VALID = (
    Status.CLUTCH1_VALID
    | Status.CLUTCH2_VALID
    | Status.OUTPUT_VALID
    | Status.GEARS_KNOWN
    | Status.PHASES_KNOWN
    | Status.ROAD_LOAD_LEARNED
    | Status.CONVERGED
    | Status.ENERGY1_KNOWN
    | Status.ENERGY2_KNOWN
    | Status.RESIDUAL1_KNOWN
    | Status.RESIDUAL2_KNOWN
    | Status.TEMPERATURE1_KNOWN
    | Status.TEMPERATURE2_KNOWN
    | Status.TIE_UP_KNOWN
)
SIGMAS = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm")


def estimates(t_us, **values):
    rows = np.zeros(len(t_us), ESTIMATE)
    rows["t_us"] = t_us
    rows["status"] = ALL_VALID
    for name in SIGMAS:
        rows[name] = 1.0
    for name, value in values.items():
        rows[name] = value
    return rows


def read(frames):
    """Return the last frame of each message, decoded by cantools."""
    found = {}
    for i in range(len(frames)):
        message = DATABASE.get_message_by_frame_id(int(frames.can_id[i]))
        found[message.name] = message.decode(frames.data[i].tobytes())
    return found


def test_values_in_the_units_of_the_database():
    rows = estimates(
        [0],
        clutch1_torque_nm=123.44,
        clutch2_torque_nm=-45.6,
        clutch_torque_sum_nm=77.8,
        output_torque_nm=2345.6,
        output_torque_adaptive_nm=-100.1,
        road_load_nm=250.0,
        engine_torque_nm=99.9,
        clutch1_slip_rad_s=100.0,
        clutch2_slip_rad_s=-10.0,
        clutch1_sigma_nm=3.21,
        clutch2_sigma_nm=200.0,
        output_sigma_nm=77.7,
        clutch_correlation=-0.704,
        gear1=-1,
        gear2=4,
        phase1=ClutchPhase.LOCKED,
        phase2=ClutchPhase.SLIPPING,
    )
    found = read(OutputEncoder(DATABASE).encode(rows))
    torque, driveline, slip, status, uncertainty = (
        found[name] for name in ("DctClutchTorque", "DctDriveline", "DctClutchSlip", "DctStatus", "DctUncertainty")
    )
    assert torque["Clutch1Torque"] == pytest.approx(123.44, abs=0.05)
    assert torque["Clutch2Torque"] == pytest.approx(-45.6, abs=0.05)
    assert torque["ClutchTorqueSum"] == pytest.approx(77.8, abs=0.05)
    assert driveline["OutputTorque"] == pytest.approx(2345.6, abs=0.125)
    assert driveline["OutputTorqueAdaptive"] == pytest.approx(-100.1, abs=0.125)
    assert driveline["RoadLoadTorque"] == 250.0
    assert slip["Clutch1Slip"] == pytest.approx(100.0 * 60.0 / math.tau, abs=0.125)
    assert slip["Clutch2Slip"] == pytest.approx(-10.0 * 60.0 / math.tau, abs=0.125)
    assert (slip["Clutch1Phase"], slip["Clutch2Phase"]) == ("locked", "slipping")
    assert (slip["GearShaft1"], slip["GearShaft2"]) == ("reverse", "gear 4")
    assert status["EngineTorqueEstimate"] == pytest.approx(99.9, abs=0.05)
    assert uncertainty["Clutch1Sigma"] == pytest.approx(3.21, abs=0.05)
    assert uncertainty["Clutch2Sigma"] == 200.0
    assert uncertainty["OutputSigma"] == pytest.approx(77.7, abs=0.125)
    assert uncertainty["ClutchCorrelation"] == pytest.approx(-0.704, abs=0.005)
    assert [uncertainty[f"{name}SigmaValid"] for name in ("Clutch1", "Clutch2", "Output")] == [1, 1, 1]
    assert torque["Clutch1TorqueValid"] == driveline["OutputTorqueValid"] == slip["ClutchSlipValid"] == 1
    assert {str(found[name][f"{name}State"]) for name in found} == {"estimating"}


def test_derived_values_in_the_units_of_the_database():
    rows = estimates(
        [0],
        clutch1_power_w=27_345.0,
        clutch2_power_w=199_999.0,
        clutch1_energy_j=36_604.0,
        clutch2_energy_j=499_999.0,
        clutch1_engagements=254,
        clutch2_engagements=600,
        clutch1_residual_nm=-12.34,
        clutch2_residual_nm=700.0,
        clutch1_temperature_c=-40.04,
        clutch2_temperature_c=312.3,
        recirculated_torque_nm=77.7,
        tie_up_probability=0.777,
    )
    found = read(OutputEncoder(DATABASE).encode(rows))
    values = {name: value for message in found.values() for name, value in message.items()}
    expected = {
        "Clutch1Power": (27_345.0, 4.0),
        "Clutch2Power": (199_999.0, 4.0),
        "Clutch1Energy": (36_604.0, 10.0),
        "Clutch2Energy": (499_999.0, 10.0),
        "Clutch1Engagements": (254, 0.0),
        "Clutch2Engagements": (600 - 2 * 255, 0.0),
        "Clutch1Residual": (-12.34, 0.1),
        "Clutch2Residual": (700.0, 0.1),
        "Clutch1Temperature": (-40.04, 0.1),
        "Clutch2Temperature": (312.3, 0.1),
        "RecirculatedTorque": (77.7, 0.2),
        "TieUpProbability": (0.777, 0.005),
    }
    for name, (value, step) in expected.items():
        assert values[name] == pytest.approx(value, abs=0.501 * step), name
    flags = {f"Clutch{i}{kind}Valid" for i in (1, 2) for kind in ("Power", "Energy", "Residual", "Temperature")}
    assert {name for name in flags if values[name] == 1} == flags
    nothing = read(OutputEncoder(DATABASE).encode(estimates([0], status=0)))
    assert {name for message in nothing.values() for name in flags & set(message) if message[name] == 0} == flags


TWO_CLUTCHES = {"ClutchTorqueSum", "ClutchCorrelation", "RecirculatedTorque", "TieUpProbability"}


@pytest.mark.parametrize(
    ("lost", "signals"),
    [
        (Status.CLUTCH1_VALID, {f"Clutch1{x}" for x in ("Torque", "Sigma", "Power", "Residual")} | TWO_CLUTCHES),
        (Status.CLUTCH2_VALID, {f"Clutch2{x}" for x in ("Torque", "Sigma", "Power", "Residual")} | TWO_CLUTCHES),
        (Status.OUTPUT_VALID, {"OutputTorque", "OutputTorqueAdaptive", "OutputSigma"}),
        (Status.GEARS_KNOWN, {"GearShaft1", "GearShaft2"}),
        (Status.PHASES_KNOWN, {"Clutch1Phase", "Clutch2Phase", "Clutch1Power", "Clutch2Power"}),
        (Status.ENERGY1_KNOWN, {"Clutch1Energy"}),
        (Status.ENERGY2_KNOWN, {"Clutch2Energy"}),
        (Status.RESIDUAL1_KNOWN, {"Clutch1Residual"}),
        (Status.RESIDUAL2_KNOWN, {"Clutch2Residual"}),
        (Status.TEMPERATURE1_KNOWN, {"Clutch1Temperature"}),
        (Status.TEMPERATURE2_KNOWN, {"Clutch2Temperature"}),
        (Status.TIE_UP_KNOWN, {"TieUpProbability"}),
        (Status.ROAD_LOAD_LEARNED, {"RoadLoadTorque", "OutputTorqueAdaptive"}),
    ],
)
def test_what_is_not_valid_is_sent_as_not_available(lost, signals):
    assert not_available(estimates([0], status=ALL_VALID & ~lost)) == signals


def not_available(rows):
    found = read(OutputEncoder(DATABASE).encode(rows))
    return {name for message in found.values() for name, value in message.items() if value == "not available"}


@pytest.mark.parametrize(
    ("unknown", "signal"),
    [
        ("clutch1_sigma_nm", {"Clutch1Sigma", "ClutchCorrelation"}),
        ("clutch2_sigma_nm", {"Clutch2Sigma", "ClutchCorrelation"}),
        ("output_sigma_nm", {"OutputSigma"}),
    ],
)
@pytest.mark.parametrize("nothing", [math.nan, 0.0])
def test_a_standard_deviation_that_is_not_stated_is_not_sent(unknown, signal, nothing):
    """The torques themselves stay valid."""
    rows = estimates([0], **{unknown: nothing})
    assert not_available(rows) == signal
    uncertainty = read(OutputEncoder(DATABASE).encode(rows))["DctUncertainty"]
    valid = {name: uncertainty[f"{name}SigmaValid"] for name in ("Clutch1", "Clutch2", "Output")}
    assert valid == {name: int(f"{name}Sigma" not in signal) for name in valid}


@pytest.mark.parametrize(
    ("unknown", "method", "signals"),
    [
        (ONLY_KALMAN, "oh2014", {"Clutch1Sigma", "Clutch2Sigma", "OutputSigma", "ClutchCorrelation"}),
        (ONLY_OH2014, "kalman", {"OutputTorqueAdaptive"}),
    ],
)
def test_what_the_method_does_not_know_is_sent_as_not_available(unknown, method, signals):
    """Everything is valid; columns of the other method are NaN. The DBC says of each signal that this may be."""
    assert not_available(estimates([0, 10_000], **dict.fromkeys(unknown, math.nan))) == signals
    comments = {s.name: s.comment or "" for m in DATABASE.messages for s in m.signals if s.name in signals}
    assert {name for name, comment in comments.items() if f"with method {method}" in comment} == signals


@pytest.mark.parametrize("correlation", [-1.0, -0.995, 0.0, 1.0])
def test_the_correlation_over_its_whole_range(correlation):
    found = read(OutputEncoder(DATABASE).encode(estimates([0], clutch_correlation=correlation)))
    assert found["DctUncertainty"]["ClutchCorrelation"] == pytest.approx(correlation, abs=0.00501)


@pytest.mark.parametrize(
    ("status", "state"),
    [
        (Status(0), "starting"),
        (ALL_VALID, "estimating"),
        (ALL_VALID | Status.INPUT_STALE, "degraded"),
        (ALL_VALID | Status.LIMITED, "degraded"),
        (ALL_VALID | Status.VEHICLE_FILE_IMPLAUSIBLE, "degraded"),
        (Status.INPUT_STALE, "starting"),
    ],
)
def test_the_state_and_every_status_bit(status, state):
    found = read(OutputEncoder(DATABASE).encode(estimates([0], status=status)))
    assert {str(found[name][f"{name}State"]) for name in found} == {state}
    bits = {
        "Clutch1Valid": Status.CLUTCH1_VALID,
        "Clutch2Valid": Status.CLUTCH2_VALID,
        "OutputValid": Status.OUTPUT_VALID,
        "GearsKnown": Status.GEARS_KNOWN,
        "PhasesKnown": Status.PHASES_KNOWN,
        "RoadLoadKnown": Status.ROAD_LOAD_LEARNED,
        "Converged": Status.CONVERGED,
        "InputStale": Status.INPUT_STALE,
        "SpeedImplausible": Status.SPEED_IMPLAUSIBLE,
        "EstimateLimited": Status.LIMITED,
        "VehicleFileImplausible": Status.VEHICLE_FILE_IMPLAUSIBLE,
    }
    assert {name: found["DctStatus"][name] for name in bits} == {
        name: int(bit in status) for name, bit in bits.items()
    }


@given(st.lists(st.floats(allow_infinity=True, allow_nan=False), min_size=7, max_size=7))
def test_any_number_is_saturated(numbers):
    signals = {
        "clutch1_torque_nm": ("DctClutchTorque", "Clutch1Torque", 1.0),
        "output_torque_nm": ("DctDriveline", "OutputTorque", 1.0),
        "clutch1_slip_rad_s": ("DctClutchSlip", "Clutch1Slip", 60.0 / math.tau),
        "engine_torque_nm": ("DctStatus", "EngineTorqueEstimate", 1.0),
        "clutch_correlation": ("DctUncertainty", "ClutchCorrelation", 1.0),
        "clutch1_energy_j": ("DctClutchEnergy", "Clutch1Energy", 1.0),
        "clutch2_residual_nm": ("DctClutchResidual", "Clutch2Residual", 1.0),
    }
    found = read(OutputEncoder(DATABASE).encode(estimates([0], **dict(zip(signals, numbers, strict=True)))))
    for (message, signal, factor), number in zip(signals.values(), numbers, strict=True):
        limits = DATABASE.get_message_by_name(message).get_signal_by_name(signal)
        saturated = min(max(number * factor, limits.minimum), limits.maximum)
        assert found[message][signal] == pytest.approx(saturated, abs=0.51 * limits.scale)


def times(frames, name, encoder):
    return frames.t_us[frames.can_id == encoder.can_ids[name]].tolist()


def test_cycle_times_counters_crc_and_flags():
    encoder = OutputEncoder(DATABASE, channel=2)
    frames = encoder.encode(estimates(np.arange(400) * 10_000))
    assert times(frames, "DctClutchTorque", encoder) == list(range(0, 4_000_000, 10_000))
    assert times(frames, "DctStatus", encoder) == list(range(0, 4_000_000, 100_000))
    assert set(frames.flags) == {FrameFlag.SENT}
    assert set(frames.channel) == {2}
    assert (np.diff(frames.t_us) >= 0).all()
    for name, can_id in encoder.can_ids.items():
        own = frames[frames.can_id == can_id]
        assert all(e2e.p01.e2e_p01_check(bytearray(row), can_id) for row in own.data)
        assert (own.data[:, 1] & 15).tolist() == [k % 15 for k in range(len(own))], name


def test_estimates_each_millisecond_are_thinned_and_slow_ones_all_sent():
    encoder = OutputEncoder(DATABASE)
    frames = encoder.encode(estimates(np.arange(1000) * 1000))
    assert times(frames, "DctDriveline", encoder) == list(range(0, 1_000_000, 10_000))
    slow = OutputEncoder(DATABASE)
    assert len(times(slow.encode(estimates(np.arange(20) * 50_000)), "DctDriveline", slow)) == 20


def test_jitter_within_a_tenth_of_the_cycle_loses_nothing():
    rng = np.random.default_rng(3)
    t_us = np.arange(500) * 10_000 + rng.integers(-500, 500, 500)
    encoder = OutputEncoder(DATABASE)
    assert times(encoder.encode(estimates(t_us)), "DctClutchTorque", encoder) == t_us.tolist()


def test_a_step_of_the_clock_starts_the_cycle_anew():
    t_us = [0, 10_000, 20_000, 5_000, 15_000, 9_000_000, 9_010_000, 1_000, 11_000]
    encoder = OutputEncoder(DATABASE)
    sent = times(encoder.encode(estimates(t_us)), "DctClutchTorque", encoder)
    assert sent == t_us


def test_steps_back_of_less_than_a_cycle_never_silence_a_message():
    """The clock is set back by 100 ms every 100 ms: the slowest cycle, and no step is as long as it."""
    t_us = np.tile(np.arange(0, 100_000, 10_000), 20)
    encoder = OutputEncoder(DATABASE)
    frames = encoder.encode(estimates(t_us))
    for name, can_id in encoder.can_ids.items():
        assert np.count_nonzero(frames.can_id == can_id) >= 20, name


@settings(max_examples=40)
@given(st.lists(st.integers(-30_000, 40_000), min_size=1, max_size=60), st.data())
def test_random_cuts_give_identical_frames(steps, data):
    rows = estimates(np.cumsum(steps))
    whole = OutputEncoder(DATABASE).encode(rows)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(rows)), max_size=6)))
    encoder = OutputEncoder(DATABASE)
    parts = [encoder.encode(rows[a:b]) for a, b in zip([0, *cuts], [*cuts, len(rows)], strict=True)]
    assert identical(Frames.concatenate(parts), whole)


def test_other_identifiers():
    encoder = OutputEncoder(
        DATABASE, {"DctStatus": 0x123, "DctDriveline": 0x18FF0001, "DctClutchSlip": EXTENDED_ID | 5}
    )
    assert encoder.can_ids == {
        "DctClutchTorque": 0x6F0,
        "DctDriveline": 0x18FF0001 | EXTENDED_ID,
        "DctClutchSlip": 5 | EXTENDED_ID,
        "DctStatus": 0x123,
        "DctUncertainty": 0x6F4,
        "DctClutchPower": 0x6F5,
        "DctClutchEnergy": 0x6F6,
        "DctClutchResidual": 0x6F7,
        "DctClutchTemperature": 0x6F8,
    }
    frames = encoder.encode(estimates([0]))
    assert set(frames.can_id.tolist()) == set(encoder.can_ids.values())
    status = frames.data[frames.can_id == 0x123][0]
    assert e2e.p01.e2e_p01_check(bytearray(status), 0x6F3)  # the data id stays that of the DBC


@pytest.mark.parametrize(
    ("database", "ids", "reason"),
    [
        (DATABASE, {"DctStats": 1}, r"output id of DctStats: no such message; did you mean DctStatus"),
        (DATABASE, {"DctStatus": 0x6F0}, "DctStatus and DctClutchTorque have the same id 0x6F0"),
        (DATABASE, {"DctStatus": 0x2000_0000}, "0x20000000 is no id"),
        (DATABASE, {"DctStatus": -1}, "is no id"),
        (DEMO_DATABASE, {}, "has none of the messages DctClutchTorque"),
        (Database([]), {}, "has none of the messages"),
    ],
)
def test_mistakes_are_named(database, ids, reason):
    with pytest.raises(DctorqueError, match=reason):
        OutputEncoder(database, ids)


def test_a_message_without_cycle_time_is_refused():
    text = (
        (DBC / "dctorque.dbc")
        .read_text()
        .replace('"GenMsgCycleTime" BO_ 1779 100', '"GenMsgCycleTime" BO_ 1779 0')
    )
    database = load_database([DatabaseFile(DBC / "x.dbc", content=text.encode())])
    with pytest.raises(DctorqueError, match="DctStatus has no GenMsgCycleTime"):
        OutputEncoder(database)


def test_read_only_estimates_are_taken():
    rows = estimates([0])
    rows.flags.writeable = False
    assert len(OutputEncoder(DATABASE).encode(rows)) == len(DATABASE.messages)
    assert len(OutputEncoder(DATABASE).encode(rows[:0])) == 0
