"""Fig. 3: what noise cannot do, the table of both clutches, and the same answers as the pipeline's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.driveline.phase_decision import NEVER, driveline_phase, phase_history
from dctorque_can.driveline.phases import ClutchActuation, ClutchPhase, DrivelinePhase, PhaseSettings, PhaseSource
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.contract import INPUTS
from dctorque_can.pipeline.decisions import decide_phases
from dctorque_can.pipeline.rules import CORE, RULES
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.simulation import drive

from .segments import PAPER

OPEN, SLIPPING, LOCKED = ClutchPhase
CLUTCH = ClutchActuation(PhaseSource.POSITION, threshold=3.0, hysteresis=0.4)
FALLING = replace(CLUTCH, closes_increasing=False)
SETTINGS = PhaseSettings((CLUTCH, CLUTCH), slip_locked_rad_s=2.0, slip_released_rad_s=5.0, lock_time_us=50_000)

inside = st.lists(st.floats(-0.199, 0.199), min_size=1, max_size=60)  # of a band of 0.4


def times(n, period_us=10_000):
    return np.arange(n, dtype=np.int64) * period_us


def history(slip, position, clutch=CLUTCH, settings=SETTINGS):
    return phase_history(times(len(slip)), np.array(slip, float), np.array(position, float), clutch, settings)


@given(inside, st.booleans(), st.sampled_from([CLUTCH, FALLING]))
def test_noise_in_the_band_of_the_kissing_point_changes_nothing(noise, closed, clutch):
    """After one clear value the clutch stays closed or open, whichever way it closes."""
    clear = 10.0 if closed == clutch.closes_increasing else 0.0
    position = [clear, *(clutch.threshold + x for x in noise)]
    phases = history([20.0] * len(position), position, clutch)
    assert set(phases) == {SLIPPING if closed else OPEN}


@given(st.lists(st.floats(2.001, 4.999), min_size=1, max_size=60), st.booleans())
def test_slip_between_its_thresholds_changes_nothing(slip, locked):
    """After it has locked a clutch stays so, after it has slipped it stays slipping; either sign of slip."""
    before = [0.0 if locked else 20.0] * 10
    signed = [x * (-1) ** k for k, x in enumerate(slip)]
    phases = history(before + signed, [10.0] * (10 + len(slip)))
    assert set(phases[10:]) == {LOCKED if locked else SLIPPING}


@given(st.lists(st.floats(-30.0, 30.0), max_size=80), st.lists(st.floats(0.0, 10.0), max_size=80))
def test_each_change_has_its_cause(slip, position):
    """What a phase says of the columns, however they move: no change without a threshold that was crossed."""
    n = min(len(slip), len(position))
    phases = history(slip[:n], position[:n])
    size = np.abs(slip[:n])
    for k in range(1, n):
        was, now = phases[k - 1], phases[k]
        if was == OPEN and now != OPEN:
            assert position[k] >= 3.2
        if was != OPEN and now == OPEN:
            assert position[k] <= 2.8
        if was == LOCKED and now == SLIPPING:
            assert size[k] > 5.0
        if was != LOCKED and now == LOCKED:
            assert k >= 5
            assert (size[k - 5 : k + 1] <= 2.0).all()


def test_a_clutch_locks_after_its_time_and_not_before():
    phases = history([20.0, *[1.0] * 8, 4.0, 5.1], [10.0] * 11)
    assert list(phases) == [SLIPPING] * 6 + [LOCKED] * 4 + [SLIPPING]


@pytest.mark.parametrize(
    ("source", "values", "expected"),
    [
        (PhaseSource.FLAG, [1.0, 0.0, 1.0], [OPEN, SLIPPING, OPEN]),
        (PhaseSource.COMMAND, [0.0, 3.1, 3.3, 2.9, 2.7], [OPEN, OPEN, SLIPPING, SLIPPING, OPEN]),
        (PhaseSource.POSITION, [0.0, np.nan, 3.0, 0.0, 3.0], [OPEN, SLIPPING, SLIPPING, OPEN, OPEN]),
    ],
)
def test_every_source(source, values, expected):
    """A commanded torque closes upwards whatever the position would do; what is unknown may carry torque."""
    clutch = replace(CLUTCH, source=source, closes_increasing=source is PhaseSource.POSITION)
    assert list(history([20.0] * len(values), values, clutch)) == expected


def test_both_clutches_make_the_three_phases():
    one, two, none = DrivelinePhase
    table = [[none, none, two], [none, none, two], [one, one, one]]  # rows: clutch 1 open, slipping, locked
    phases = np.array(list(ClutchPhase))
    np.testing.assert_array_equal(driveline_phase(phases[:, None], phases[None, :]), table)
    for a in ClutchPhase:
        for b in ClutchPhase:
            assert DrivelinePhase(driveline_phase(a, b)) is table[a][b]


@pytest.mark.parametrize(
    ("t_us", "slip", "position", "message"),
    [
        ([0, 1], [0.0], [0.0, 0.0], r"columns of one length, not \(2,\), \(1,\) and \(2,\)"),
        ([1, 0], [0.0, 0.0], [0.0, 0.0], "time must not fall"),
        ([0, 1], [0.0, np.nan], [0.0, 0.0], "slip nan in row 1 must be a finite number"),
    ],
)
def test_columns_that_make_no_history_are_refused(t_us, slip, position, message):
    with pytest.raises(DctorqueError, match=f"^phase history: .*{message}"):
        phase_history(np.array(t_us), np.array(slip), np.array(position), CLUTCH, SETTINGS)


def pipeline_history(t_us, w_e, w_c, position):
    """Decide both clutches' phases frame by frame with the pipeline's own function and rules filled in by hand."""
    core, inputs, rules = np.zeros(1, CORE), np.zeros(1, INPUTS), np.zeros(1, RULES)
    inputs["closed"], inputs["called"], core["slip_small_us"] = True, 1, NEVER
    inputs["phases_believed"] = True
    rules["closing_sign"], rules["closed_above"], rules["open_below"] = 1.0, 3.2, 2.8
    rules["slip_locked"], rules["slip_released"], rules["lock_time_us"] = 2.0, 5.0, 50_000
    phases = np.zeros((2, len(t_us)), np.uint8)
    for k in range(len(t_us)):
        inputs["t_us"] = t_us[k]
        inputs["w_c"] = w_c[:, k]
        for i, quantity in enumerate((Quantity.CLUTCH1_POSITION, Quantity.CLUTCH2_POSITION)):
            inputs["available"][0, quantity] = True
            inputs["value"][0, quantity] = position[i, k]
        decide_phases(core[0], inputs[0], rules[0], w_e[k])
        phases[:, k] = inputs["phase"][0]
    return phases


def test_history_is_the_pipelines_decision_on_a_noisy_drive():
    """The paper's drive with noise on speeds and positions: the same phase for both clutches at every instant."""
    truth = drive.simulate(PAPER, drive.PAPER)[::10]
    noise = np.random.default_rng(7).normal(size=(5, len(truth)))
    w_e = truth["engine_speed_rad_s"] + 0.3 * noise[0]
    w_c = np.array([truth["shaft1_speed_rad_s"], truth["shaft2_speed_rad_s"]]) + 0.3 * noise[1:3]
    position = np.array([truth["clutch1_position_mm"], truth["clutch2_position_mm"]]) + 0.05 * noise[3:]
    expected = pipeline_history(truth["t_us"], w_e, w_c, position)
    assert [set(row) for row in expected] == [set(ClutchPhase)] * 2
    for i in range(2):
        ours = phase_history(truth["t_us"], w_e - w_c[i], position[i], CLUTCH, SETTINGS)
        np.testing.assert_array_equal(ours, expected[i])
