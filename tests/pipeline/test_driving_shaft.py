"""One input shaft speed, of whichever clutch drives: of use where that is certain, never taken for the other."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.contract import INPUTS
from dctorque_can.pipeline.driving_shaft import DRIVING_SHAFT, first_driving_shaft, give_speed
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.rules import RULES
from dctorque_can.pipeline.samples import Quantity, Signs
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import MORE, emit_frames

from .manoeuvres import config, driven, wrong_ms

BOTH = {"databases": "[../dbc/demo_car.dbc, ../dbc/demo_car_more.dbc]"}
NONE = BOTH | {"inputs.shaft1_speed": "null", "inputs.shaft2_speed": "null"}
ONE = NONE | {"inputs.driving_shaft_speed": "{signal: DrivingShaft.InputShaftSpeed, not_available: [65535]}"}
SPEED, FIRST = Quantity.DRIVING_SHAFT_SPEED, Quantity.SHAFT1_SPEED


@cache
def truth_of(car, drive):
    return simulate(config(car).settings.vehicle, PAPER) if drive == "paper" else driven(car, drive)


def estimated(car, drive, overrides, delay_us=50_000):
    of, truth = load_config(shipped_config(car), overrides), truth_of(car, drive)
    profile = replace(MORE, seed=4, driving_shaft_delay_us=delay_us)
    frames = emit_frames(truth, of.settings.vehicle, profile, of.database)
    estimator = Estimator(of.settings)
    rows = estimator.feed(Decoder(of.database, of.inputs, of.protections).decode(frames)).rows
    error = rows["output_torque_nm"] - np.interp(rows["t_us"], truth["t_us"], truth["output_torque_nm"])
    valid = rows["status"] & np.uint32(4) != 0
    return np.sqrt(np.mean(error[valid] ** 2)), valid.mean(), wrong_ms(rows, truth)


@pytest.mark.parametrize(("car", "drive"), [("paper_car", "paper"), ("avante_dct7", "kick_down")])
def test_it_makes_the_output_torque_better_and_nothing_wrong(car, drive):
    """With shifts in which the signal goes over early, late, or seconds too late."""
    rms, valid, wrong = estimated(car, drive, NONE)
    for delay_us in (0, 300_000, 1_000_000, 5_000_000):
        rms_one, valid_one, wrong_one = estimated(car, drive, ONE, delay_us)
        assert rms_one < {0: 0.9, 300_000: 0.9, 1_000_000: 0.95, 5_000_000: 1.1}[delay_us] * rms
        assert valid_one > valid - 0.01
        for torque, milliseconds in wrong_one.items():
            limit = 50.0 if delay_us <= 1_000_000 else 60.0  # the drive alone has 25 ms of its own
            assert milliseconds <= max(limit, wrong[torque])


class ByHand:
    """Gears 2 on shaft 1 and 3 on shaft 2, ratios 10 and 7, wheels at 20 rad/s."""

    def __init__(self):
        self.d = np.zeros(1, DRIVING_SHAFT)
        first_driving_shaft(self.d[0])
        self.inputs, self.rules = np.zeros(1, INPUTS), np.zeros(1, RULES)
        i = self.inputs[0]
        i["mapped"][SPEED] = True
        i["gear"], i["gear_known"], i["closed_known"], i["heading"] = (2, 3), True, True, 1
        self.rules[0]["ratio"][3], self.rules[0]["ratio"][4] = 10.0, 7.0
        i["available"][Quantity.WHEEL_SPEED_FL] = True
        i["value"][Quantity.WHEEL_SPEED_FL] = 20.0
        i["signs"][SPEED] = Signs.UNSIGNED

    def goes_on(self, seconds, phases, speed):
        """Return what each shaft is given at the end: a speed, or None."""
        i = self.inputs[0]
        i["phase"] = phases
        for _ in range(round(seconds / 0.01)):
            i["t_us"] += 10_000
            i["fresh"] = False
            i["fresh"][SPEED] = True
            i["value"][SPEED] = speed
            give_speed(self.d[0], i, self.rules[0])
        return [float(i["value"][FIRST + k]) if i["fresh"][FIRST + k] else None for k in range(2)]


def test_a_shift():
    """Shaft 1 drives, then both may, then shaft 2: its speed counts 300 ms later, that of the other never."""
    car, shut, slips = ByHand(), ClutchPhase.LOCKED, ClutchPhase.SLIPPING
    assert car.goes_on(0.29, (shut, 0), 201.0) == [None, None]
    assert car.goes_on(0.1, (shut, 0), 201.0) == [201.0, None]
    assert car.goes_on(0.5, (slips, slips), 170.0) == [None, None]
    assert car.goes_on(0.29, (0, slips), 141.0) == [None, None]
    assert car.goes_on(0.1, (0, shut), 141.0) == [None, 141.0]
    assert car.goes_on(0.5, (0, shut), 201.0) == [None, None]  # that of the other shaft
    assert car.goes_on(0.29, (0, shut), 141.0) == [None, None]  # or of one that passes by
    assert car.goes_on(0.1, (0, shut), 141.0) == [None, 141.0]


def test_a_car_that_rolls_back_and_a_clutch_of_which_nobody_knows():
    car = ByHand()
    car.inputs["heading"] = -1
    car.inputs["value"][0, Quantity.WHEEL_SPEED_FL] = -20.0
    assert car.goes_on(0.5, (ClutchPhase.SLIPPING, 0), 200.0) == [-200.0, None]
    car.inputs["closed_known"] = (True, False)
    assert car.goes_on(0.5, (ClutchPhase.SLIPPING, 0), 200.0) == [None, None]


def test_a_speed_that_has_been_negative_has_a_sign():
    car = ByHand()
    car.inputs["signs"][0, SPEED] = Signs.UNTOLD
    assert car.goes_on(0.5, (ClutchPhase.LOCKED, 0), 200.0) == [200.0, None]
    assert car.inputs["signs"][0, FIRST] == Signs.UNTOLD
    car.inputs["value"][0, Quantity.WHEEL_SPEED_FL] = -20.0
    assert car.goes_on(0.1, (ClutchPhase.LOCKED, 0), -200.0) == [-200.0, None]
    assert car.inputs["signs"][0, FIRST] == Signs.SIGNED
