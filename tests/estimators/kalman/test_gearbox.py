"""What is known of the gearbox: drag in neutral, what the deviations contain."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import gearbox
from dctorque_can.estimators.kalman.model import N, State
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
DESIGN = replace(SETTINGS.kalman, timing_error_s=0.0, engine_torque_delay_s=0.0, parameter_error_share=0.0)
VEHICLE = SETTINGS.vehicle
OPEN, SLIPPING, LOCKED = 0, 1, 2


def new_filter():
    """A filter in first and second gear, started at 200, 150, 100 and 10 rad/s, with 80 N·m."""
    k = kalman.new(VEHICLE, DESIGN)
    k.state[0]["gear"][:] = 1, 2
    kalman.start(k.state[0], k.tuning[0], 200.0, 150.0, 100.0, 10.0, 80.0)
    return k


def test_neutral_publishes_drag_alone():
    """The synchroniser's torque is not the clutch's: 0.005 N·m·s/rad · 50 rad/s."""
    k = new_filter()
    f = k.state[0]
    gearbox.change_gears(f, k.tuning[0], 0, 2)
    f["x"][State.T_C1] = 77.0
    gearbox.work_out_torques(f, k.tables, k.tuning[0])
    gearbox.work_out_deviations(f, k.tables, k.tuning[0])
    assert f["T_c1"] == pytest.approx(VEHICLE.clutches[0].drag_nms_per_rad * 50.0)
    assert f["sigma_1"] == pytest.approx(
        np.hypot(DESIGN.open_torque_nm, DESIGN.open_drag_error_nms_per_rad * 50.0)
    )
    assert f["correlation"] == 0.0


@pytest.mark.parametrize(
    ("gears", "phases"), [((0, 2), (0, 2)), ((0, 2), (0, 1)), ((1, 0), (2, 0)), ((1, 2), (2, 0))]
)
def test_a_synchroniser_may_pull_at_any_moment(gears, phases):
    """On the output shaft by its ratio, and on a clutch beside it that is locked: anything from none to all."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    gearbox.change_gears(f, tuning, *gears)
    gearbox.work_out_deviations(f, k.tables, tuning)
    before = np.array([f["sigma_1"], f["sigma_2"], f["sigma_o"]])
    gearbox.admit_synchronisers(f, tuning, *phases)
    added = np.sqrt(np.array([f["sigma_1"], f["sigma_2"], f["sigma_o"]]) ** 2 - before**2)
    expected = np.zeros(3)
    if 0 in gears:
        shaft = gears.index(0)
        spread = DESIGN.synchroniser_torque_nm / np.sqrt(12.0)  # of a uniform distribution
        expected[2] = spread * np.mean([abs(gear.total_ratio) for gear in VEHICLE.gears_on(shaft + 1)])
        if phases[1 - shaft] == ClutchPhase.LOCKED:
            (gear,) = (gear for gear in VEHICLE.gears_on(2 - shaft) if gear.number == gears[1 - shaft])
            expected[1 - shaft] = expected[2] / abs(gear.total_ratio)
    np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-6)


def test_deviations_contain_what_lasts():
    """They are those of M (P + Σ s sᵀ) Mᵀ, where M gives both clutch torques and the output torque."""
    k = new_filter()
    f, random = k.state[0], np.random.default_rng(4)
    root = random.standard_normal((N, N))
    f["P"][:], f["lasting"][:] = root @ root.T, 3.0 * random.standard_normal((2, N))
    gearbox.work_out_deviations(f, k.tables, k.tuning[0])
    M = np.zeros((3, N))
    M[0, State.T_C1] = M[1, State.T_C2] = 1.0
    M[2] = k.tables.output
    V = M @ (f["P"] + f["lasting"].T @ f["lasting"]) @ M.T
    np.testing.assert_allclose([f["sigma_1"], f["sigma_2"], f["sigma_o"]], np.sqrt(np.diag(V)), rtol=1e-12)
    assert f["correlation"] == pytest.approx(V[0, 1] / np.sqrt(V[0, 0] * V[1, 1]))


@pytest.mark.parametrize("other", [OPEN, LOCKED])
def test_an_open_clutch_may_touch_before_its_kissing_point(other):
    """Halfway to it a quarter of the torque, taken from the other clutch, or with it open from the engine."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    inputs = np.zeros(1, [("touches", "f8", (2,))]).view(np.recarray)[0]
    inputs.touches = (0.5, 0.0)
    gearbox.let_touch(f, tuning, inputs, True, other == OPEN)
    gearbox.work_out_deviations(f, k.tables, tuning)
    before = np.array([f["sigma_1"], f["sigma_2"], f["sigma_o"]])
    gearbox.admit_touch(f, tuning, OPEN, other)
    added = np.sqrt(np.array([f["sigma_1"], f["sigma_2"], f["sigma_o"]]) ** 2 - before**2)
    torque = 0.25 * DESIGN.touch_torque_nm
    first, second = (VEHICLE.gear(number).total_ratio for number in (1, 2))
    expected = (torque, torque, torque * (first - second)) if other == LOCKED else (torque, 0.0, torque * first)
    np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-6)
    inputs.touches = (1.0, 0.0)
    known = float(f["P"][State.T_C1, State.T_C1])
    for _ in range(2):  # as it closes, and once
        gearbox.let_touch(f, tuning, inputs, False, other == OPEN)
        assert f["P"][State.T_C1, State.T_C1] == pytest.approx(known + DESIGN.touch_torque_nm**2)
