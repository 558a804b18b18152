"""One gear signal for the whole gearbox: the rule by hand; simulated drives that are never confidently wrong."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.analysis.confidence import lasting_ms, wrong
from dctorque_can.analysis.errors import VALID as VALID_BITS
from dctorque_can.chain import Chain
from dctorque_can.config.load import load_config
from dctorque_can.driveline.phases import ClutchActuation, PhaseSource
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Input, Quantity
from dctorque_can.pipeline.settings import GearInference, OneGear
from dctorque_can.resources import shipped_config, shipped_dbc
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES
from dctorque_can.simulation.sensors import ONE_GEAR, emit_frames
from tests.pipeline.drives import FRAMES, SHIPPED, WHEELS, R, samples

Q = Quantity
TORQUES = {"clutch1_nm": "clutch1", "clutch2_nm": "clutch2", "output_nm": "output"}
NOTHING = ClutchActuation(PhaseSource.NONE, 0.0, 0.0)
TOLD = (Q.GEAR, Q.TARGET_GEAR, Q.SHIFT_IN_PROGRESS)
RATIO = GearInference(0.03, 0.06, 50_000, 3.0)


def settings_of(*told, speeds, phases=True):
    """Settings of the paper car with one gear; ``told`` beside the actual gear."""
    without = {Q.GEAR1, Q.GEAR2} | (set() if speeds else {Q.SHAFT1_SPEED, Q.SHAFT2_SPEED})
    kept = [item for item in SHIPPED.inputs if item.quantity not in without]
    gears = [Input(quantity, (), -1.0, 7.0, 100_000) for quantity in (Q.GEAR, *told)]
    clutches = SHIPPED.phases.clutches if phases else (NOTHING, NOTHING)
    return replace(
        SHIPPED,
        method=Method.KALMAN,
        inputs=(*kept, *gears),
        phases=replace(SHIPPED.phases, clutches=clutches),
        one_gear=OneGear(RATIO),
    )


def at_20_rad_s(actual, torque=60.0, slip=0.0, closed=(10.0, 0.0), **more):
    """Values while the wheels turn at 20 rad/s and both shafts as gears 1 and 2 make them."""
    return {
        Q.ENGINE_SPEED: 20.0 * R[actual or 1] + slip,
        Q.ENGINE_TORQUE: torque,
        Q.SHAFT1_SPEED: 20.0 * R[1],
        Q.SHAFT2_SPEED: 20.0 * R[2],
        Q.CLUTCH1_POSITION: closed[0],
        Q.CLUTCH2_POSITION: closed[1],
        Q.GEAR: actual,
        **dict.fromkeys(WHEELS, 20.0),
        **{Q[name]: value for name, value in more.items()},
    }


def rows_of(settings, values, seconds=1.2):
    frames = (*FRAMES[:2], (*TOLD, Q.CLUTCH1_POSITION, Q.CLUTCH2_POSITION), WHEELS)
    rows = []
    for k in range(round(seconds * 400)):
        now = values(k / 400) if callable(values) else values
        frame = [q for q in frames[k % 4] if q in now]
        rows += [(2500 * k, q, now[q], 0, q is frame[-1]) for q in frame]
    return Estimator(settings).feed(samples(rows)).rows


def gears(row):
    return int(row["gear1"]), int(row["gear2"])


@pytest.mark.parametrize(
    ("values", "told", "expected"),
    [
        (at_20_rad_s(1), (), (1, 2)),  # driven by the engine: up
        (at_20_rad_s(3, torque=-40.0), (), (3, 2)),  # driven by the car: down
        (at_20_rad_s(2, closed=(0.0, 10.0)), (), (3, 2)),
        (at_20_rad_s(3, TARGET_GEAR=2), (Q.TARGET_GEAR,), (3, 2)),  # the target counts, whatever may be expected
        (at_20_rad_s(3, TARGET_GEAR=3), (Q.TARGET_GEAR,), (3, 4)),  # … if it belongs to the other shaft
        (at_20_rad_s(3, slip=30.0), (), (3, 2)),  # the engine runs away: a shift down
        (at_20_rad_s(3, slip=-30.0), (), (3, 4)),
        (at_20_rad_s(0), (), (0, 0)),
    ],
)
def test_without_shaft_speeds_the_other_gear_is_the_target_or_expected(values, told, expected):
    assert gears(rows_of(settings_of(*told, speeds=False), values)[-1]) == expected


def test_a_shaft_speed_says_more_than_the_target():
    settings = settings_of(Q.TARGET_GEAR, speeds=True)
    assert gears(rows_of(settings, at_20_rad_s(1, TARGET_GEAR=4))[-1]) == (1, 2)
    turning = at_20_rad_s(1, TARGET_GEAR=2) | {Q.SHAFT2_SPEED: 20.0 * R[2] * 1.2}
    assert gears(rows_of(settings, turning)[-1]) == (1, 0)


def test_the_former_gear_stays_until_the_new_clutch_has_not_slipped_for_long():
    """Gear 1 drives until 0.8 s, then gear 2: its clutch slips until 1.2 s, and counts as together 0.3 s later."""

    def values(t):
        slip = 0.0 if t < 0.8 or t > 1.2 else 20.0
        return at_20_rad_s(1 if t < 0.8 else 2, slip=slip)

    rows = rows_of(settings_of(speeds=False), values, 2.0)
    found = {round(t, 1): gears(rows[np.searchsorted(rows["t_us"], t * 1e6)]) for t in (0.5, 1.0, 1.4, 1.7)}
    assert found == {0.5: (1, 2), 1.0: (1, 2), 1.4: (1, 2), 1.7: (3, 2)}


def test_a_guess_is_not_valid_while_the_other_clutch_may_carry_torque():
    """Valid with clutch 2 open; not with clutch 2 closed on a gear that is only expected."""
    valid = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID)
    for closed, expected in ((0.0, valid), (10.0, 0)):
        row = rows_of(settings_of(speeds=False), at_20_rad_s(1, closed=(10.0, closed)))[-1]
        assert int(row["status"]) & valid == expected


def test_no_gear_is_no_valid_estimate_and_no_error():
    values = at_20_rad_s(1)
    bad = {9: 0, 15: 0, -1: 0}  # the vehicle has neither
    for gear in bad:
        rows = rows_of(settings_of(speeds=False), lambda t, gear=gear: values | {Q.GEAR: 1 if t < 0.8 else gear})
        assert not int(rows["status"][-1]) & int(Status.CLUTCH1_VALID | Status.OUTPUT_VALID | Status.GEARS_KNOWN)
        assert np.isfinite(rows["clutch1_torque_nm"]).all()


def test_an_idle_clutch_of_which_nothing_is_told_carries_little():
    """In gear 1 with a locked clutch, T_c1 is the engine torque at steady speed; clutch 2 may be open or not."""
    row = rows_of(settings_of(speeds=False, phases=False), at_20_rad_s(1), 3.0)[-1]
    assert row["clutch1_torque_nm"] == pytest.approx(60.0, abs=8.0)
    assert row["clutch2_torque_nm"] == pytest.approx(0.0, abs=8.0)
    assert row["clutch2_sigma_nm"] > 5.0  # it may begin to carry


# --- simulated drives ---

VALUES = "{neutral: neutral, 1: 1, 2: 2, 3: 3, 4: 4, 5: 5%s}"
ACTUAL = "actual: {signal: Transmission.ActualGear, values: %s}"
TARGET = "target: {signal: Transmission.TargetGear, values: %s}"
SHIFT = "shift_in_progress: {signal: Transmission.ShiftInProgress, values: {0: no, 1: yes}}"


def config_of(car, told=True, speeds=True, phases="position"):
    more = "" if car == "paper_car" else ", 6: 6, 7: 7, 13: reverse"
    values = VALUES % more
    parts = [ACTUAL % values, *([TARGET % values, SHIFT] if told else [])]
    changes = {"gears": f"{{source: gearbox, {', '.join(parts)}}}", "protection": "null"}
    changes["databases.0.file"] = str(shipped_dbc("demo_car_one_gear"))
    if not speeds:
        changes |= {"inputs.shaft1_speed": "null", "inputs.shaft2_speed": "null"}
    if phases != "position":
        changes["clutch_phase"] = f"{{source: {phases}}}"
    return load_config(shipped_config(car), changes)


@pytest.fixture(scope="module", params=["paper_car", "avante_dct7"])
def car(request):
    return request.param


@pytest.fixture(scope="module")
def truths(car):
    vehicle = load_config(shipped_config(car)).settings.vehicle
    return {"paper": simulate(vehicle, PAPER), "kick_down": simulate(vehicle, MANOEUVRES["kick_down"](vehicle))}


@pytest.mark.parametrize(
    ("told", "speeds", "phases", "least_valid"),
    [
        (True, True, "position", 0.95),
        (False, True, "none", 0.7),
        (True, False, "position", 0.9),
        (True, False, "none", 0.05),
        (False, False, "none", 0.1),
    ],
)
@pytest.mark.parametrize("drive", ["paper", "kick_down"])
def test_shifts_are_never_confidently_wrong(car, truths, drive, told, speeds, phases, least_valid):
    """Full-throttle upshifts, coasting down, kick-downs over a gear; at most 50 ms per torque."""
    truth, config = truths[drive], config_of(car, told, speeds, phases)
    sensors = replace(ONE_GEAR, seed=1, gear_changes="end" if drive == "paper" else "middle")
    frames = emit_frames(truth, config.settings.vehicle, sensors, config.database)
    rows = Chain(config).feed(frames).rows
    rows = rows[rows["t_us"] <= truth["t_us"][-1]]
    ms = lasting_ms(rows["t_us"])
    for name, column in TORQUES.items():
        true = np.interp(rows["t_us"], truth["t_us"], truth[f"{column}_torque_nm"])
        error, sigma = rows[f"{column}_torque_nm"] - true, rows[f"{column}_sigma_nm"]
        assert ms[wrong(name, error, sigma, rows["status"])].sum() <= 50.0
        valid = rows["status"] & np.uint32(VALID_BITS[name]) != 0
        assert np.mean(np.abs(error[valid]) <= 1.96 * sigma[valid]) > 0.93
        if name == "clutch1_nm":
            assert valid.mean() > least_valid
