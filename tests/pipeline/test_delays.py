"""Signals whose age is known: each sample acts once, at the time at which it was taken."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline import delays
from dctorque_can.pipeline.arrivals import Arrivals, without_delays
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus
from dctorque_can.pipeline.smoothing import Smoother
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames

from .drives import SETTINGS as HAND_MADE
from .drives import cruise, traffic

CONFIG = load_config(shipped_config("avante_dct7"), {"estimator.method": "kalman", "estimator.period_ms": "10"})
SETTINGS = CONFIG.settings
TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
Q = Quantity
MESSAGES = (  # of the demo car, with their delays in ms
    ((Q.ENGINE_SPEED, Q.ENGINE_TORQUE), 12),
    ((Q.SHAFT1_SPEED, Q.SHAFT2_SPEED), 0),
    ((Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR, Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR), 40),
)
DELAY_US = np.zeros(len(Quantity), np.int64)
for quantities, ms in MESSAGES:
    DELAY_US[list(quantities)] = 1000 * ms
LONGEST_US = int(DELAY_US.max())


def delayed(settings):
    inputs = [replace(item, delay_us=int(DELAY_US[item.quantity])) for item in settings.inputs]
    return replace(settings, inputs=tuple(inputs))


def late(data):
    """The same samples as they arrive with the delays; a frame of several delays becomes several."""
    arrival = data.t_us + DELAY_US[data.quantity]
    order = np.argsort(arrival, kind="stable")
    frame = (np.cumsum(data.last) - data.last)[order]
    data = replace(data, t_us=arrival)[order]
    return replace(data, last=np.append((np.diff(frame) != 0) | (np.diff(data.t_us) != 0), True))


def in_order(data, settings):
    """The samples at the times at which they were taken, after the first time that there is."""
    arrivals = Arrivals(settings)
    for part in arrivals.split(data):
        arrivals.add(part, np.zeros(0, np.int64))
    ((ordered, _),) = arrivals.in_order()
    return joined(time_alone(data.t_us[0] - LONGEST_US), ordered)


def joined(*parts):
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in Samples.__slots__))


def time_alone(t_us):
    return Samples(
        np.array([t_us]),
        np.array([Q.ENGINE_SPEED], np.uint8),
        np.zeros(1),
        np.array([SampleStatus.NOT_AVAILABLE], np.uint8),
        np.ones(1, np.bool_),
    )


@pytest.fixture(scope="module")
def truth():
    return simulate(SETTINGS.vehicle, PAPER)


@pytest.fixture(scope="module")
def taken(truth):
    """Samples of the paper's drive as a production bus would have them without any delay."""
    timing = {name: replace(t, delay_us=0, jitter_us=0) for name, t in PRODUCTION.timing.items()}
    frames = emit_frames(truth, SETTINGS.vehicle, replace(PRODUCTION, seed=2, timing=timing), CONFIG.database)
    return Decoder(CONFIG.database, CONFIG.inputs, CONFIG.protections).decode(frames)


def errors(rows, truth, after_s=1.0):
    t = truth["t_us"]
    keep = rows["t_us"] > t[0] + after_s * 1e6
    rows = rows[keep]
    found = []
    for name in TORQUES:
        found.append(np.sqrt(np.mean((rows[name] - np.interp(rows["t_us"], t, truth[name])) ** 2)))
    return np.array(found)


@pytest.mark.parametrize("method", Method)
def test_what_waited_long_enough_has_acted_as_if_it_had_come_at_once(taken, method):
    settings = delayed(replace(SETTINGS, method=method))
    data = late(taken)
    estimator, plain = Estimator(settings), Estimator(without_delays(settings))
    estimator.feed(data)
    estimator.feed(time_alone(data.t_us[-1] + LONGEST_US + 1))
    plain.feed(in_order(data, settings))
    ours, theirs = (e.chosen.state for e in (estimator, plain))
    kalman = ("x", "P", "t_us", "gear", "fault", "taken", "squares")
    for name in kalman if method is Method.KALMAN else ("observer", "pair"):
        assert ours[name].tobytes() == theirs[name].tobytes(), name
    assert theirs["running"][0]
    assert estimator._queue["count"][0] == 1  # the time alone


@pytest.mark.parametrize("share", [0.1, 0.31, 0.5, 0.77, 0.999])
def test_an_estimate_stands_on_all_that_has_arrived(taken, share):
    """It is that of an estimator that gets what has arrived, in order, and then the time of the estimate."""
    settings = delayed(SETTINGS)
    data = late(taken)
    rows = Estimator(settings).feed(data).rows
    row = rows[int(share * len(rows))]
    plain = Estimator(without_delays(settings))
    ordered = in_order(data[data.t_us <= row["t_us"]], settings)
    if ordered.t_us[-1] < row["t_us"]:
        ordered = joined(ordered, time_alone(row["t_us"]))
    wanted = plain.feed(ordered, np.arange(len(ordered)) == len(ordered) - 1).rows[0]
    # whether an engagement is known from its beginning depends on the estimates before, which are others
    assert {name for name in rows.dtype.names if row[name].tobytes() != wanted[name].tobytes()} <= {"status"}
    assert row["t_us"] == wanted["t_us"]


def test_one_by_one_gives_the_same_bits(taken):
    data = late(taken)
    data = data[: len(data) // 4]
    whole = Estimator(delayed(SETTINGS)).feed(data)
    estimator = Estimator(delayed(SETTINGS))
    ends = np.append(0, np.flatnonzero(data.last) + 1)
    parts = [estimator.feed(data[a:b]) for a, b in pairwise(ends)]
    assert np.concatenate([p.rows for p in parts]).tobytes() == whole.rows.tobytes()
    assert np.concatenate([p.health for p in parts]).tobytes() == whole.health.tobytes()


def test_a_known_delay_costs_little_and_one_that_is_taken_for_none_much(taken, truth):
    """One that nobody tells is learned, unless the file is to be believed."""
    data = late(taken)
    sure = replace(SETTINGS.kalman, delay_error_s=0.0, wheel_scale_error_share=0.0, ratio_error_share=0.0)
    at_once = errors(Estimator(SETTINGS).feed(taken).rows, truth)
    known = errors(Estimator(delayed(SETTINGS)).feed(data).rows, truth)
    learned = errors(Estimator(SETTINGS).feed(data).rows, truth)
    none = errors(Estimator(replace(SETTINGS, kalman=sure)).feed(data).rows, truth)
    assert (known < 0.35 * none).all(), (at_once, known, learned, none)
    assert (learned < 0.45 * none).all(), (at_once, known, learned, none)
    assert (known < 3.0 * at_once).all(), (at_once, known, learned, none)


def test_a_reset_drops_what_waits():
    settings = delayed(replace(HAND_MADE, method=Method.KALMAN))
    data = traffic(1.0, lambda t: cruise())
    estimator = Estimator(settings)
    estimator.feed(late(data))
    assert estimator._queue["count"][0] > 0
    before = estimator.health["accepted"].sum()
    again = late(replace(data, t_us=data.t_us - 10_000_000))
    estimator.feed(again[:1])
    assert estimator.health["clock_resets"] == 1
    assert estimator._queue["count"][0] == 1
    rows = estimator.feed(again[1:]).rows
    assert rows["t_us"][-1] == again.t_us[-1]
    assert estimator.health["accepted"].sum() == 2 * before


def test_more_than_there_are_places_for_lose_nothing():
    """The oldest take effect before their delay has passed."""
    settings = delayed(replace(HAND_MADE, method=Method.KALMAN))
    data = late(traffic(1.0, lambda t: cruise()))
    burst = replace(data, t_us=data.t_us // 400)  # 2.5 ms in all
    many = [replace(burst, t_us=burst.t_us + 2600 * k) for k in range(8)]
    frames = sum(int(part.last.sum()) for part in many)
    assert frames > 2 * delays.PLACES
    assert many[-1].t_us[-1] < LONGEST_US  # nothing leaves by itself
    estimator = Estimator(settings)
    rows = np.concatenate([estimator.feed(part).rows for part in many])
    assert estimator._queue["count"][0] == delays.MOST
    assert estimator._now.inputs["t_us"][0] > -LONGEST_US
    assert np.isfinite(rows["clutch1_torque_nm"]).all()
    assert (np.diff(rows["t_us"]) > 0).all()
    assert estimator.health["accepted"].sum() == len(many) * len(data)


def test_frames_without_a_value_let_time_pass():
    """Else each estimate would bridge all the time since the last value anew."""
    settings = delayed(replace(HAND_MADE, method=Method.KALMAN))
    estimator = Estimator(settings)
    estimator.feed(late(traffic(1.0, lambda t: cruise())))
    nothing = late(traffic(2.0, lambda t: dict.fromkeys(cruise()), start_us=1_000_000))
    rows = estimator.feed(nothing).rows
    assert nothing.t_us[-1] - estimator._now.inputs["t_us"][0] <= LONGEST_US + 2500
    assert rows["status"][-1] & Status.INPUT_STALE


def test_counters_only_grow():
    settings = delayed(replace(HAND_MADE, method=Method.KALMAN, health_period_us=5000))
    tight = [replace(item, timeout_us=25_000) for item in settings.inputs]
    data = late(traffic(2.0, lambda t: cruise()))
    wheel = (data.quantity >= Q.WHEEL_SPEED_FL) & (data.quantity <= Q.WHEEL_SPEED_RR)
    gap = wheel & (data.t_us > 1_000_000) & (data.t_us < 1_040_000)  # longer than the timeout, not than the delay
    estimator = Estimator(replace(settings, inputs=tuple(tight)))
    health = estimator.feed(data[~gap & (data.t_us < 1_990_000)]).health
    for name in ("accepted", "timeouts", "innovations", "innovation_squares", "innovations_rejected"):
        assert (np.diff(health[name].astype(float), axis=0) >= 0.0).all(), name
    assert health["timeouts"][-1].sum() == 4
    assert health["innovations"][-1].sum() > 500


def test_a_sample_that_comes_late_by_its_delay_is_not_missing():
    """A timeout counts from frame to frame, whatever the delay."""
    settings = replace(HAND_MADE, method=Method.KALMAN)
    tight = [replace(item, timeout_us=25_000) for item in settings.inputs]
    settings = delayed(replace(settings, inputs=tuple(tight)))
    estimator = Estimator(settings)
    data = late(traffic(2.0, lambda t: cruise()))
    estimator.feed(data[data.t_us < 1_990_000])  # after it only what is late would come
    assert estimator.health["timeouts"].sum() == 0


class TestSmoothing:
    def test_the_same_however_cut(self):
        settings = delayed(replace(HAND_MADE, method=Method.KALMAN))
        data = late(traffic(1.0, lambda t: cruise()))
        found = []
        for length in (len(data), 7):  # 7: also within frames
            smoother = Smoother(settings)
            for first in range(0, len(data), length):
                smoother.feed(data[first : first + length])
            found.append(smoother.smoothed())
        assert found[0].tobytes() == found[1].tobytes()

    def test_delays_known_smooth_as_well_as_none(self, taken, truth):
        at_once, smoother = Smoother(SETTINGS), Smoother(delayed(SETTINGS))
        at_once.feed(taken)
        data = late(taken)
        cut = len(data) // 3
        online = np.concatenate([smoother.feed(part).rows for part in (data[:cut], data[cut:])])
        rows = smoother.smoothed()
        assert np.array_equal(rows["t_us"], online["t_us"])
        assert (errors(rows, truth) < 1.1 * errors(at_once.smoothed(), truth)).all()
        assert online.tobytes() == Estimator(delayed(SETTINGS)).feed(data).rows.tobytes()

    def test_estimates_of_every_stretch_come_back_at_their_times(self):
        settings = delayed(replace(HAND_MADE, method=Method.KALMAN))
        first = late(traffic(1.0, lambda t: cruise()))
        second = replace(first, t_us=first.t_us - 5_000_000)
        both = Samples(*(np.concatenate([getattr(first, n), getattr(second, n)]) for n in Samples.__slots__))
        smoother = Smoother(settings)
        online = smoother.feed(both).rows
        assert np.array_equal(smoother.smoothed()["t_us"], online["t_us"])
        assert (np.diff(online["t_us"]) < 0).sum() == 1
