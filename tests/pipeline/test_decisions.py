"""Phases from whatever tells them, gears from signals or ratios, speeds that do not fit."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.driveline.phases import ClutchActuation, ClutchPhase, PhaseSource
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Input, SampleStatus
from dctorque_can.pipeline.settings import GearInference

from .drives import SETTINGS, Q, R, locked_in_first, samples, traffic, with_either


def inputs_with(*quantities):
    return (*SETTINGS.inputs, *(Input(q, (), -1e6, 1e6, 200_000) for q in quantities))


@with_either
@pytest.mark.parametrize(
    ("source", "quantity", "open_value", "closed_value"),
    [
        (PhaseSource.FLAG, Q.CLUTCH2_OPEN, 1.0, 0.0),
        (PhaseSource.COMMAND, Q.CLUTCH2_COMMAND, 0.0, 80.0),
        (PhaseSource.POSITION, Q.CLUTCH2_POSITION, 8.0, 2.0),  # a clutch that closes with falling position
    ],
)
def test_phase_from_any_source(settings, source, quantity, open_value, closed_value):
    actuation = ClutchActuation(source, 5.0, 1.0, closes_increasing=False)
    settings = replace(
        settings,
        inputs=inputs_with(quantity),
        phases=replace(settings.phases, clutches=(settings.phases.clutches[0], actuation)),
    )
    values, _, _ = locked_in_first()
    rows = []
    for value in (open_value, closed_value):
        data = traffic(0.5, values)
        extra = (int(data.t_us[0]), quantity, value, SampleStatus.OK, True)
        head = [extra]
        estimator = Estimator(replace(settings))
        keep = data.quantity != quantity
        body = list(zip(data.t_us, data.quantity, data.value, data.status, data.last, strict=True))
        kept = [row for row, k in zip(body, keep, strict=True) if k]
        kept = [(t, q, v, s, bool(last) or q == Q.CLUTCH1_POSITION) for t, q, v, s, last in kept]
        repeated = [(t, quantity, value, SampleStatus.OK, True) for t in range(0, 500_000, 10_000)]
        merged = sorted([*head, *kept, *repeated], key=lambda row: row[0])
        rows.append(estimator.feed(samples(merged)).rows[-1])
    assert rows[0]["phase2"] == ClutchPhase.OPEN
    assert rows[1]["phase2"] == ClutchPhase.SLIPPING


@pytest.mark.parametrize(("increasing", "start", "step"), [(True, 4.0, 0.2), (False, 6.0, -0.2)])
def test_an_open_clutch_is_less_certain_near_its_kissing_point(increasing, start, step):
    """From 1 to 0 before 5 mm its σ grows from that of its drag to that of 20 N·m beside it."""
    actuation = ClutchActuation(PhaseSource.POSITION, 5.0, 0.0, increasing, touches_before=1.0)
    phases = replace(SETTINGS.phases, clutches=(SETTINGS.phases.clutches[0], actuation))
    values, _, _ = locked_in_first()

    def nearer(t):
        return values(t) | {Q.CLUTCH2_POSITION: start + step * int(t / 0.2)}

    rows = Estimator(replace(SETTINGS, method=Method.KALMAN, phases=phases)).feed(traffic(1.0, nearer)).rows
    late = rows[rows["t_us"] % 200_000 >= 150_000]
    assert np.all(late["phase2"] == ClutchPhase.OPEN)
    steps = [late["clutch2_sigma_nm"][late["t_us"] // 200_000 == n].mean() for n in range(5)]
    at_rest = steps[0]
    assert at_rest < 3.0
    expected = [np.hypot(at_rest, 20.0 * share**2) for share in (0.0, 0.2, 0.4, 0.6, 0.8)]
    np.testing.assert_allclose(steps[1:], expected[1:], rtol=0.15)


@with_either
def test_position_has_hysteresis(settings):
    """Noise around the kissing point must not make the phase flicker."""
    actuation = settings.phases.clutches[1]
    values, _, _ = locked_in_first()
    wiggle = 0.45 * actuation.hysteresis

    def noisy(t):
        return values(t) | {Q.CLUTCH2_POSITION: actuation.threshold + wiggle * (-1) ** int(t * 100)}

    rows = Estimator(settings).feed(traffic(1.0, noisy)).rows
    assert len(np.unique(rows["phase2"][rows["t_us"] > 100_000])) == 1


@with_either
def test_gears_from_speed_ratios(settings):
    """Without gear signals the ratio of shaft to driven wheels tells them, also while clutch 2's gear changes."""
    inference = GearInference(0.02, 0.05, 60_000, 3.0)
    settings = replace(
        settings,
        gear_inference=inference,
        inputs=tuple(i for i in settings.inputs if i.quantity not in (Q.GEAR1, Q.GEAR2)),
    )
    values, T_c, _ = locked_in_first()

    def without_signals(t):
        now = values(t)
        del now[Q.GEAR1], now[Q.GEAR2]
        if 1.0 < t < 1.5:
            now[Q.SHAFT2_SPEED] *= 0.8  # synchronising
        return now

    rows = Estimator(settings).feed(traffic(3.0, without_signals)).rows
    at = {ms: rows[np.searchsorted(rows["t_us"], ms * 1000)] for ms in (900, 1300, 2900)}
    assert [(int(r["gear1"]), int(r["gear2"])) for r in at.values()] == [(1, 2), (1, 0), (1, 2)]
    assert at[2900]["clutch1_torque_nm"] == pytest.approx(
        T_c, abs=0.5 + 2.0 * np.nan_to_num(at[2900]["clutch1_sigma_nm"])
    )


def test_gear_change_on_the_free_shaft_leaves_the_other_clutch_alone():
    """Shaft 1 goes from first to third while clutch 2 drives; its old speed must not be read as twist.

    Of the 2014 observer: the filter rightly misses what a synchroniser would take from the wheels.
    """
    values, _, _ = locked_in_first()

    def changing(t):
        now = values(t)
        now |= {Q.CLUTCH1_POSITION: 0.0, Q.CLUTCH2_POSITION: 10.0, Q.ENGINE_SPEED: now[Q.SHAFT2_SPEED]}
        share = min(max((t - 1.0) / 0.1, 0.0), 1.0)  # synchronised within 100 ms
        now[Q.SHAFT1_SPEED] *= 1.0 + share * (R[3] / R[1] - 1.0)
        now[Q.GEAR1] = 1 if share == 0.0 else 3 if share == 1.0 else 0
        return now

    rows = Estimator(SETTINGS).feed(traffic(2.0, changing)).rows
    around = rows[(rows["t_us"] > 900_000) & (rows["t_us"] < 1_500_000)]
    assert {int(g) for g in around["gear1"]} == {1, 0, 3}
    assert np.ptp(around["clutch2_torque_nm"]) < 2.0


@with_either
def test_wrong_gear_signal_is_implausible(settings):
    values, _, _ = locked_in_first()
    rows = Estimator(settings).feed(traffic(2.0, lambda t: values(t) | {Q.GEAR1: 3})).rows
    assert rows[-1]["status"] & Status.SPEED_IMPLAUSIBLE
    assert not rows[-1]["status"] & Status.CLUTCH1_VALID
