"""What counts of a recording become, by hand."""

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.evidence.findings import findings
from dctorque_can.evidence.intervals import Interval
from dctorque_can.resources import shipped_config

WHOLE_FRAME = ("bad_crc", "bad_counter", "bad_length", "not_believed")
FAULTS = (*WHOLE_FRAME, "bad_rate", "out_of_range", "not_available")
MESSAGES = {
    "EngineData": 10.0,
    "InputShafts": 10.0,
    "Gearbox": 10.0,
    "WheelSpeedsFront": 20.0,
    "WheelSpeedsRear": 20.0,
}
CONFIG = load_config(shipped_config("paper_car"))


def health(**counts):
    quantities = [entry.input.quantity.name.lower() for entry in CONFIG.entries]
    whole = {fault: {} for fault in FAULTS} | {"accepted": dict.fromkeys(quantities, 1000)}
    return whole | {"findings": [], "hints": []} | counts


def intervals(**others):
    return {name: Interval(1000, period, period + 0.4) for name, period in MESSAGES.items()} | others


def found(given=None, missing=(), measured=None, config=CONFIG):
    return findings(config, given or health(), missing, intervals() if measured is None else measured)


def test_nothing_on_a_recording_that_fits():
    assert found() == []


@pytest.mark.parametrize("fault", FAULTS)
def test_shares_of_bad_frames(fault):
    """One in a hundred is told, less is not; all of them is an error."""
    few, some, all_bad = (
        found(health(accepted={"engine_speed": good}, **{fault: {"engine_speed": bad}}), missing=())
        for good, bad in ((995, 5), (900, 100), (0, 1000))
    )
    assert few == []
    (one,), (every,) = some, all_bad
    assert one.severity == ("hint" if fault == "not_available" else "warning")
    assert every.severity == "error"
    assert "10%" in one.text
    assert one.key == ("protection.EngineData" if fault in WHOLE_FRAME else "inputs.engine_speed")


def test_one_message_is_told_once():
    """Its counter is bad for both inputs that come from it."""
    told = found(health(bad_counter={"engine_speed": 500, "engine_torque": 500}))
    assert [finding.key for finding in told] == ["protection.EngineData"]


def test_a_message_that_never_comes():
    measured = intervals()
    del measured["InputShafts"]
    told = found(health(accepted={}), ("shaft1_speed", "shaft2_speed"), measured)
    assert [(f.severity, f.key, f.text) for f in told] == [
        ("error", f"inputs.shaft{i}_speed", "not in the recording: InputShafts") for i in (1, 2)
    ]
    assert found(health(accepted={}), ("shaft1_speed",), {}) == []


def test_timeouts_and_periods_are_measured():
    """Every 80 ms and at times 130: a timeout of 100 is too short, and the DBC says 10."""
    told = found(measured=intervals(InputShafts=Interval(500, 80.0, 130.0)))
    warnings = [f for f in told if f.severity == "warning"]
    assert [(f.key, f.value) for f in warnings] == [(f"inputs.shaft{i}_speed.timeout_ms", 240.0) for i in (1, 2)]
    (hint,) = [f for f in told if f.severity == "hint"]
    assert "every 80 ms, the DBC says 10 ms" in hint.text


def test_the_monitor_and_the_learned_noise():
    contradiction = {"key": "vehicle.chassis.mass_kg", "says": "too heavy", "torques_not_valid": True}
    doubt = contradiction | {"key": "gears", "torques_not_valid": False}
    noise = {"key": "estimator.kalman.wheel_speed_noise_rad_s", "says": "noisy", "value": 0.08}
    told = found(health(findings=[doubt, contradiction], hints=[noise]))
    assert [(f.severity, f.key, f.value) for f in told] == [
        ("error", "vehicle.chassis.mass_kg", None),
        ("warning", "gears", None),
        ("hint", "estimator.kalman.wheel_speed_noise_rad_s", 0.08),
    ]


def test_doubts_of_the_file_itself():
    """A number that no car has is a warning, a timeout that leaves no room a hint."""
    odd = load_config(
        shipped_config("paper_car"),
        {"vehicle.chassis.mass_kg": "1.6", "inputs.engine_speed.timeout_ms": "15"},
    )
    told = found(config=odd)
    assert [(f.severity, f.key) for f in told] == [
        ("warning", "vehicle.chassis.mass_kg"),
        ("hint", "inputs.engine_speed.timeout_ms"),
    ]
