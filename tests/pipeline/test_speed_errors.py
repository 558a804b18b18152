"""A vehicle file whose ratios, wheels or delays are a little off: made up for, told, and never sure and wrong."""

import numpy as np
import pytest

from dctorque_can.analysis.health import findings
from dctorque_can.analysis.speed_hints import speed_hints
from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import mixed_drive, simulate

from .manoeuvres import config, frames_of, wrong_ms

CAR = config("avante_dct7")
GEARS = {gear.number: gear for gear in CAR.settings.vehicle.gears if gear.number > 0}
SCALE = 1.015
WHEELS = {f"inputs.wheel_speeds.{wheel}.delay_ms": "25" for wheel in ("fl", "fr", "rl", "rr")}
RATIOS = {
    f"vehicle.gears.{n}.ratio": str(gear.ratio * (1.0 + 0.002 * (-1) ** (n // 2))) for n, gear in GEARS.items()
}
ONE_RATIO = {"vehicle.gears.3.ratio": str(GEARS[3].ratio * 1.02)}
MUCH_LATER = dict.fromkeys(WHEELS, "62")
FINAL_DRIVES = {f"vehicle.gears.{n}.final_drive": str(gear.final_drive * SCALE) for n, gear in GEARS.items()}
"""Other final drives are what another wheel radius is: the wheels do not fit the shafts, in all gears alike."""


@pytest.fixture(scope="module")
def drive():
    truth = simulate(CAR.settings.vehicle, mixed_drive(CAR.settings.vehicle, 8, 180.0))
    return truth, frames_of(CAR, truth, ())


def replayed(drive, overrides):
    """Estimates, RMS error of the output torque and the last health record, with a file that has these keys."""
    truth, frames = drive
    of = load_config(shipped_config("avante_dct7"), {**overrides, "can.channel": "vcan0"})
    estimator = Estimator(of.settings)
    rows = estimator.feed(Decoder(of.database, of.inputs, of.protections).decode(frames)).rows
    error = rows["output_torque_nm"] - np.interp(rows["t_us"], truth["t_us"], truth["output_torque_nm"])
    return rows, np.sqrt(np.mean(error[rows["t_us"] > truth["t_us"][0] + 5_000_000] ** 2)), estimator.health


@pytest.fixture(scope="module")
def right(drive):
    return replayed(drive, {})


def test_a_right_file_has_nothing_to_be_told(right):
    _, _, health = right
    assert speed_hints(health) == []
    assert abs(health["wheel_scale_error"][0]) < 0.0005
    assert abs(health["wheels_late_s"][0]) < 0.003


@pytest.mark.parametrize(
    "overrides", [FINAL_DRIVES, RATIOS, ONE_RATIO, WHEELS], ids=["wheels", "ratios", "one ratio", "delays"]
)
def test_what_is_off_costs_little_and_is_never_sure_and_wrong(drive, right, overrides):
    """Taken for twist it would be 100 to 1000 N·m of the output torque."""
    rows, rms, _ = replayed(drive, overrides)
    assert max(wrong_ms(rows, drive[0]).values()) <= 10.0
    assert rms < 1.5 * right[1]


def test_wheels_that_are_too_slow_are_told(drive):
    """The ratios of the file are larger than the true ones, so its wheels should turn slower than they do."""
    _, _, health = replayed(drive, FINAL_DRIVES)
    (hint,) = speed_hints(health)
    assert hint["key"] == "vehicle.chassis.wheel_radius_m"
    assert hint["measured"] == pytest.approx(SCALE - 1.0, abs=0.001)
    assert "faster than shafts and ratios" in hint["says"]


def test_wheels_that_come_earlier_than_told_are_told(drive):
    _, _, health = replayed(drive, WHEELS)
    (hint,) = speed_hints(health)
    assert hint["key"] == "inputs.wheel_speeds.fl.delay_ms"
    assert hint["measured"] == pytest.approx(-0.023, abs=0.006)  # the messages are 2 ms late
    assert "earlier than told" in hint["says"]


def test_a_wrong_ratio_is_told(drive):
    _, _, health = replayed(drive, ONE_RATIO)
    (hint,) = speed_hints(health)
    assert hint["key"] == "vehicle.gears.3.ratio"
    assert hint["measured"] == pytest.approx(1.0 / 1.02 - 1.0, abs=0.001)
    assert "gear 3: its shaft turns" in hint["says"]
    assert "slower" in hint["says"]


def test_a_delay_beyond_what_can_be_made_up_for_takes_validity_away(drive):
    rows, _, health = replayed(drive, MUCH_LATER)
    (finding,) = findings(health)
    assert finding["finding"] == "wheels_late"
    assert finding["torques_not_valid"]
    assert "ms earlier than told" in finding["says"]
    late = rows[rows["t_us"] > rows["t_us"][-1] - 60_000_000]
    assert not np.any(late["status"] & (Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID))


def test_a_gap_does_not_make_a_wrong_file_sure_again(drive):
    """A second without frames every 20 s: each new start would take the ratio, and the delay, for torque."""
    truth, frames = drive
    heard = frames[(frames.t_us - frames.t_us[0]) % 20_000_000 > 1_000_000]
    rows, _, _ = replayed((truth, heard), ONE_RATIO)
    assert max(wrong_ms(rows, truth).values()) <= 10.0
    rows, _, health = replayed((truth, heard), MUCH_LATER)
    assert health["gap_resets"][0] > 5
    late = rows[rows["t_us"] > rows["t_us"][-1] - 60_000_000]
    assert not np.any(late["status"] & (Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID))


def test_what_is_known_exactly_is_not_learned(drive):
    keys = ("wheel_scale_error_share", "ratio_error_share", "delay_error_ms")
    _, _, health = replayed(drive, {f"estimator.kalman.{key}": "0" for key in keys})
    names = ("wheel_scale_error", "wheel_scale_sigma", "wheels_late_s", "wheels_late_sigma_s")
    assert [float(health[name][0]) for name in names] == [0.0] * 4


def test_without_the_speed_of_a_shaft_the_file_is_believed():
    without = {f"inputs.shaft{shaft}_speed": "null" for shaft in (1, 2)}
    for overrides, known in ((without, False), ({"inputs.shaft1_speed": "null"}, True)):
        design = load_config(shipped_config("avante_dct7"), overrides).settings.kalman
        shares = design.wheel_scale_error_share, design.ratio_error_share, design.delay_error_s
        assert all(share > 0.0 for share in shares) is known
        assert any(share > 0.0 for share in shares) is known
