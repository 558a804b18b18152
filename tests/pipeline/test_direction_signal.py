"""A direction that the bus tells decides sooner, and whatever is wrong with it, no torque is confidently wrong."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config, load_config
from dctorque_can.estimators.contract import INPUTS
from dctorque_can.pipeline.direction import DIRECTION, first_direction
from dctorque_can.pipeline.direction_signal import signal_odds
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.rules import RULES
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import Drive, simulate
from dctorque_can.simulation.sensors import MORE, DirectionErrors, emit_frames

from .manoeuvres import MAGNITUDES, config, driven, wrong_ms

DATABASES = {"databases": "[../dbc/demo_car.dbc, ../dbc/demo_car_more.dbc]"}
VALUES = "values: {0: standstill, 1: forward, 2: backward, 3: unknown}"
SWAPPED = "values: {0: standstill, 2: forward, 1: backward, 3: unknown}"
ONE = "signal: WheelDirections.VehicleDirection"
FOUR = f"signals: [{', '.join(f'WheelDirections.WheelDirection{w}' for w in ('FL', 'FR', 'RL', 'RR'))}]"
RIGHT, LATE = DirectionErrors(), DirectionErrors(delay_us=300_000)
MESSAGE = 306  # WheelDirections


@cache
def told(car: str, how: str) -> Config:
    """Return a vehicle file with a direction, or without if nothing is said of it."""
    direction = {"inputs.direction": f"{{{how}}}"} if how else {}
    return load_config(shipped_config(car), DATABASES | direction)


@cache
def launch_and_roll_back(car: str):
    """Level start and stop; then twice on a slope of 10 % without hill holder, after a long and a short stop."""
    firm = 6000.0
    pedal, brake = [], [(0.0, firm)]
    for start, throttle, released, full, stop in (
        (1.0, 0.35, 0.8, 1.3, 5.0),
        (13.4, 0.45, 12.0, 13.7, 18.0),
        (22.4, 0.45, 21.0, 22.7, 26.0),
    ):
        pedal += [(start, 0.0), (full, throttle), (stop, throttle), (stop + 0.2, 0.0)]
        brake += [(released, firm), (released + 0.2, 0.0), (stop + 1.0, 0.0), (stop + 1.5, firm)]
    slope = ((0.0, 0.0), (7.0, 0.0), (9.0, 0.1))
    drive = Drive("rolling", 28.0, tuple(pedal), tuple(brake), grade_rad=slope, hill_holder=False)
    return simulate(config(car).settings.vehicle, drive)


@cache
def sent(car: str, truth_of, errors: DirectionErrors) -> Frames:
    profile = replace(MORE, seed=4, unsigned=MAGNITUDES, direction=errors)
    return emit_frames(truth_of(car), config(car).settings.vehicle, profile, told(car, "").database)


def estimated(of: Config, frames: Frames):
    """Return the estimates, and at each message of the rear wheels its time and the direction that was decided."""
    estimator, decoder = Estimator(of.settings), Decoder(of.database, of.inputs, of.protections)
    rows, directions = [], []
    wheels = np.flatnonzero(frames.can_id == of.database.get_message_by_name("WheelSpeedsRear").frame_id)
    for a, b in zip([0, *wheels[:-1] + 1], wheels + 1, strict=True):
        rows.append(estimator.feed(decoder.decode(frames[a:b])).rows)
        directions.append((frames.t_us[b - 1], estimator._now.inputs["direction"][0]))
    return np.concatenate(rows), np.array(directions)


def undecided_and_wrong(directions, truth) -> tuple[int, int]:
    """Return for how many milliseconds a car that moves has no direction, and for how many the wrong one."""
    speed = np.interp(directions[:, 0], truth["t_us"], truth["undriven_wheel_speed_rad_s"])
    moves = np.abs(speed) > 0.5
    decided, way = directions[moves, 1], np.sign(speed[moves])
    return 20 * int((decided == 0).sum()), 20 * int((decided == -way).sum())


def spliced(first: Frames, second: Frames, from_us: int, to_us: int) -> Frames:
    """Return the first frames with the directions of the second ones for some time."""
    assert np.array_equal(first.t_us, second.t_us)
    taken = (first.can_id == MESSAGE) & (first.t_us >= from_us) & (first.t_us < to_us)
    frames = first[np.arange(len(first))]
    frames.data[taken] = second.data[taken]
    return frames


def undecided_without(car: str, truth_of) -> int:
    _, directions = estimated(told(car, ""), sent(car, truth_of, RIGHT))
    undecided, wrong = undecided_and_wrong(directions, truth_of(car))
    assert wrong == 0
    return undecided


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
def test_once_it_is_proven_it_decides_soon(car):
    """The car sets off or turns five times: each takes the signal's delay, two frames and a tenth of a second."""
    truth = launch_and_roll_back(car)
    without = undecided_without(car, launch_and_roll_back)
    assert without > 3000
    for how in (ONE, FOUR):
        rows, directions = estimated(
            told(car, f"{how}, {VALUES}, measured: true"), sent(car, launch_and_roll_back, RIGHT)
        )
        undecided, wrong = undecided_and_wrong(directions, truth)
        assert wrong == 0
        assert max(wrong_ms(rows, truth).values()) == 0.0
        assert undecided <= 5 * (40 + 2 * 20 + 100)


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
@pytest.mark.parametrize(
    ("how", "errors"),
    [
        (f"{ONE}, {VALUES}", LATE),
        (f"{ONE}, {VALUES}", replace(LATE, freezes=True)),
        (f"{ONE}, {VALUES}, measured: true", replace(LATE, freezes=True)),
        (f"{ONE}, {VALUES}", DirectionErrors(stuck="forward")),
        (f"{ONE}, {VALUES}, measured: true", DirectionErrors(stuck="forward")),
        (f"{ONE}, {VALUES}, measured: true", DirectionErrors(stuck="backward")),
        (f"{ONE}, {VALUES}", DirectionErrors(stuck="unknown")),
        (f"{ONE}, {SWAPPED}, measured: true", RIGHT),
    ],
    ids=["late", "late_freezes", "measured_late", "forward", "measured_forward", "backward", "unknown", "swapped"],
)
def test_a_bad_signal_makes_nothing_wrong(car, how, errors):
    """Wherever it is of no use, the drive decides as it does without."""
    truth = launch_and_roll_back(car)
    rows, directions = estimated(told(car, how), sent(car, launch_and_roll_back, errors))
    undecided, wrong = undecided_and_wrong(directions, truth)
    assert wrong == 0
    assert max(wrong_ms(rows, truth).values()) <= 50.0
    assert undecided <= undecided_without(car, launch_and_roll_back)
    valid = rows["status"] & np.uint32(7) == 7
    assert valid[rows["t_us"] > 300_000].mean() > 0.9


def test_a_signal_that_begins_to_lie_when_it_has_been_right():
    """It sticks after the first start; or it says backwards for 0.3 s as the car starts; or it is lost."""
    car, truth = "paper_car", launch_and_roll_back("paper_car")
    of = told(car, f"{ONE}, {VALUES}, measured: true")
    right = sent(car, launch_and_roll_back, RIGHT)
    forward = sent(car, launch_and_roll_back, DirectionErrors(stuck="forward"))
    backward = sent(car, launch_and_roll_back, DirectionErrors(stuck="backward"))
    for frames in (
        spliced(right, forward, 8_000_000, 40_000_000),
        spliced(right, backward, 21_000_000, 21_900_000),
        spliced(right, forward, 21_000_000, 22_400_000),
        right[(right.can_id != MESSAGE) | (right.t_us < 12_500_000)],
    ):
        rows, directions = estimated(of, frames)
        assert undecided_and_wrong(directions, truth)[1] == 0
        assert max(wrong_ms(rows, truth).values()) <= 50.0


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
@pytest.mark.parametrize("errors", [LATE, DirectionErrors(stuck="forward")], ids=["late", "stuck"])
def test_rolling_back_at_once(car, errors):
    """The signal has proven nothing yet."""
    truth = driven(car, "roll_back")
    of = told(car, f"{ONE}, {VALUES}, measured: true")
    rows, directions = estimated(of, sent(car, lambda name: driven(name, "roll_back"), errors))
    assert undecided_and_wrong(directions, truth)[1] == 0
    assert max(wrong_ms(rows, truth).values()) <= 50.0


class ByHand:
    """A car that moves, or stands, and what the signal says of it, every 20 ms."""

    def __init__(self, measured=False):
        self.d = np.zeros(1, DIRECTION)
        first_direction(self.d)
        self.inputs, self.rules = np.zeros(1, INPUTS), np.zeros(1, RULES)
        self.rules["direction_measured"] = measured
        self.inputs["mapped"][0, Quantity.DIRECTION] = True
        self.drive, self.gear = 0.0, 1

    def goes_on(self, seconds, moves, says):
        """Return the logarithm of the odds at the end."""
        i, d, odds = self.inputs[0], self.d[0], 0.0
        i["available"][Quantity.DIRECTION] = says is not None
        i["value"][Quantity.DIRECTION] = says or 0.0
        for _ in range(round(seconds / 0.02)):
            i["t_us"] += 20_000
            if not moves:
                d["t_us"] = d["moved_us"] = -(2**62)
            else:
                if d["moved_us"] < 0:
                    d["moved_us"] = i["t_us"]
                d["t_us"] = i["t_us"]
            odds = signal_odds(d, i, self.rules[0], self.drive, 8.0, self.gear)
        return odds


def one_in(odds):
    return 1.0 + np.exp(abs(odds))


def test_what_it_is_worth():
    """Nothing at rest, one in ninety after half a second, and one in 8000 if it is alive, proven, and measures."""
    car = ByHand(measured=True)
    assert car.goes_on(1.0, moves=False, says=1) == 0.0
    assert car.goes_on(0.48, moves=True, says=1) == 0.0
    assert one_in(car.goes_on(0.06, moves=True, says=1)) == pytest.approx(91, abs=1)
    assert car.goes_on(1.0, moves=False, says=0) == 0.0
    assert car.goes_on(0.1, moves=True, says=0) == 0.0
    assert one_in(car.goes_on(0.06, moves=True, says=1)) == pytest.approx(91, abs=1)  # alive at once
    car.drive = 9.0
    assert one_in(car.goes_on(0.2, moves=True, says=1)) == pytest.approx(8100, rel=0.01)
    car.drive = 0.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.1, moves=True, says=0)
    assert one_in(car.goes_on(0.08, moves=True, says=-1)) == pytest.approx(91, abs=1)
    assert -car.goes_on(0.06, moves=True, says=-1) == pytest.approx(np.log(8100), abs=0.01)


def test_a_lever_is_not_a_measurement():
    """What the gear says too decides nothing, until the drive has agreed with it against the gear."""
    car = ByHand()
    car.drive = 9.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.1, moves=True, says=0)
    assert one_in(car.goes_on(1.0, moves=True, says=1)) == pytest.approx(91, abs=1)
    car.drive = -9.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.1, moves=True, says=0)
    car.goes_on(0.2, moves=True, says=-1)
    car.drive = 0.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.1, moves=True, says=0)
    assert one_in(car.goes_on(0.2, moves=True, says=1)) == pytest.approx(8100, rel=0.01)


def test_a_lever_that_says_backwards_while_the_car_rolls_forwards():
    """Out of neutral it is one in ninety, against the gear too; after forward it is no car's direction at all."""
    car = ByHand()
    car.drive = 9.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.1, moves=True, says=0)
    car.goes_on(0.5, moves=True, says=1)  # proven
    car.drive = 0.0
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.3, moves=True, says=0)
    assert one_in(car.goes_on(0.5, moves=True, says=-1)) == pytest.approx(91, abs=1)
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.3, moves=True, says=0)
    car.goes_on(0.5, moves=True, says=1)
    assert car.goes_on(2.0, moves=True, says=-1) == 0.0
    assert car.goes_on(0.6, moves=True, says=1) > 4.0


def test_what_the_drive_refutes_counts_no_more_until_it_changes():
    car = ByHand(measured=True)
    assert car.goes_on(1.0, moves=True, says=1) > 4.0
    car.drive = -8.5
    assert car.goes_on(0.1, moves=True, says=1) == 0.0
    car.drive = 0.0
    assert car.goes_on(3.0, moves=True, says=1) == 0.0
    car.goes_on(0.1, moves=False, says=1)
    assert car.goes_on(0.6, moves=True, says=-1) < -4.0


def test_a_late_signal_is_not_taken_for_the_motion_after_the_last_one():
    """Rocking: forwards, a short stop, backwards; the signal still says forwards, 300 ms late."""
    car = ByHand(measured=True)
    car.goes_on(1.0, moves=False, says=0)
    car.goes_on(0.2, moves=True, says=0)
    car.goes_on(0.1, moves=False, says=0)
    assert car.goes_on(0.3, moves=True, says=1) == 0.0


def test_wheels_that_disagree_and_one_that_is_lost_say_nothing():
    car = ByHand(measured=True)
    for says in (0.5, 0.0, -0.25, None):
        assert car.goes_on(1.0, moves=True, says=says) == 0.0
    assert car.goes_on(1.0, moves=True, says=0.75) > 4.0
