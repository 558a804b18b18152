"""Which way a car goes whose speeds are magnitudes: decided by the drive, and never wrongly."""

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import Drive, simulate

from .manoeuvres import MAGNITUDES, config, driven, frames_of, wrong_ms


def estimated(of: Config, frames: Frames):
    """Return the estimates, and at each wheel message its time and the direction that was decided."""
    estimator, decoder = Estimator(of.settings), Decoder(of.database, of.inputs, of.protections)
    rows, told = [], []
    wheels = np.flatnonzero(frames.can_id == of.database.get_message_by_name("WheelSpeedsRear").frame_id)
    for a, b in zip([0, *wheels[:-1] + 1], wheels + 1, strict=True):
        rows.append(estimator.feed(decoder.decode(frames[a:b])).rows)
        told.append((frames.t_us[b - 1], estimator._now.inputs["direction"][0]))
    return np.concatenate(rows), np.array(told)


@pytest.mark.parametrize(
    ("car", "drive", "signed_dbc", "unsigned"),
    [
        ("paper_car", "roll_back", False, MAGNITUDES),
        ("avante_dct7", "roll_back", False, MAGNITUDES),
        ("avante_dct7", "roll_back", False, ()),  # what is negative is sent as zero
        ("avante_dct7", "roll_back", True, {"wheels"}),
        ("avante_dct7", "roll_back", True, {"shafts"}),
        ("avante_dct7", "roll_back", True, ()),
        ("avante_dct7", "reverse", False, MAGNITUDES),
        ("paper_car", "hill_hold", False, MAGNITUDES),
        ("avante_dct7", "creep", False, MAGNITUDES),
        ("avante_dct7", "wheel_spin", False, MAGNITUDES),
        ("avante_dct7", "kick_down", False, MAGNITUDES),
    ],
)
def test_never_confidently_wrong(car, drive, signed_dbc, unsigned):
    """50 ms is what is asked of a drive. The direction is never decided wrongly while the car moves."""
    of, truth = config(car, signed_dbc), driven(car, drive)
    rows, told = estimated(of, frames_of(of, truth, unsigned))
    assert max(wrong_ms(rows, truth).values()) <= 50.0
    speed = np.interp(told[:, 0], truth["t_us"], truth["undriven_wheel_speed_rad_s"])
    moving = np.abs(speed) > 0.5
    assert (told[moving, 1] * speed[moving] >= 0.0).all()
    valid = rows["status"] & np.uint32(7) == 7
    assert valid[rows["t_us"] > 300_000].mean() > 0.9
    if drive in ("roll_back", "reverse") and unsigned:
        backwards = speed < -3.0
        assert (told[backwards, 1] == -1).any()


def test_a_launch_is_decided_soon():
    """Within half a second from when the wheels turn, with throttle; and it stays so until the car stands."""
    of, truth = config("paper_car"), driven("paper_car", "stop_start")
    _, told = estimated(of, frames_of(of, truth, MAGNITUDES))
    speed = np.interp(told[:, 0], truth["t_us"], truth["undriven_wheel_speed_rad_s"])
    first = np.flatnonzero(speed > 0.5)[0]
    decided = np.flatnonzero(told[:, 1] == 1)[0]
    assert told[decided, 0] - told[first, 0] < 500_000
    assert (told[decided:, 1][speed[decided:] > 1.0] != -1).all()
    assert (told[speed < 0.1, 1] == 0).mean() > 0.95


def test_a_few_centimetres_backwards_are_not_taken_for_a_start():
    """The brake is released on a slope, and the clutch catches the car after 4 cm."""
    vehicle = config("paper_car").settings.vehicle
    drive = Drive(
        "rocking",
        6.0,
        pedal=((1.0, 0.0), (1.3, 0.4)),
        brake_n=((0.0, 6000.0), (1.35, 6000.0), (1.45, 0.0)),
        grade_rad=((0.0, 0.12),),
        hill_holder=False,
    )
    truth = simulate(vehicle, drive)
    assert -1.0 < truth["undriven_wheel_speed_rad_s"].min() < -0.1
    of = config("paper_car")
    for unsigned in (MAGNITUDES, ()):
        rows, told = estimated(of, frames_of(of, truth, unsigned))
        assert max(wrong_ms(rows, truth).values()) <= 50.0
        assert (told[:, 1] != -1).all()


def test_a_gap_forgets_the_direction_and_a_fast_car_has_one():
    of, truth = config("paper_car"), driven("paper_car", "braked_coast_down")
    frames = frames_of(of, truth, MAGNITUDES)
    fast, slow = frames[frames.t_us > 18_000_000], frames[frames.t_us > 38_000_000]
    _, told = estimated(of, fast)
    assert told[1, 1] == 1
    _, told = estimated(of, slow)
    assert told[1, 1] == 0


def test_a_speed_that_has_been_negative_has_a_sign():
    of, truth = config("avante_dct7", signed=True), driven("avante_dct7", "roll_back")
    estimator, decoder = Estimator(of.settings), Decoder(of.database, of.inputs, of.protections)
    frames = frames_of(of, truth, ())
    estimator.feed(decoder.decode(frames[frames.t_us < 1_000_000]))
    assert set(estimator._now.inputs["signs"][0][2:8]) == {2}
    estimator.feed(decoder.decode(frames[frames.t_us >= 1_000_000]))
    assert set(estimator._now.inputs["signs"][0][4:8]) == {0}
