"""The Kalman estimator within the core: accuracy, honesty, and what faulty signals can do to it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import wheels
from dctorque_can.estimators.kalman.model import State
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus
from dctorque_can.pipeline.settings import GearInference
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, emit_frames

from .drives import SETTINGS as HAND_MADE
from .drives import R, cruise, samples, traffic

CONFIG = load_config(shipped_config("paper_car"))
LABORATORY_SETTINGS = CONFIG.settings
PRODUCTION_SETTINGS = replace(  # the demo car with the default design: no key of estimator.kalman is its own
    LABORATORY_SETTINGS, kalman=load_config(shipped_config("avante_dct7")).settings.kalman
)
TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
SIGMAS = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm")
Q = Quantity
FRONT, REAR = (Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR), (Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR)
SIGNALS = {
    "engine speed": (Q.ENGINE_SPEED,),
    "shaft 1": (Q.SHAFT1_SPEED,),
    "shaft 2": (Q.SHAFT2_SPEED,),
    "driven wheels": FRONT,
    "undriven wheels": REAR,
    "one driven wheel": FRONT[:1],
    "one undriven wheel": REAR[:1],
    "engine torque": (Q.ENGINE_TORQUE,),
}
FLAGS = {
    "engine speed": Status.ENGINE_SPEED_FAULT,
    "shaft 1": Status.SHAFT1_SPEED_FAULT,
    "shaft 2": Status.SHAFT2_SPEED_FAULT,
    "driven wheels": Status.DRIVEN_WHEELS_FAULT,
    "undriven wheels": Status.UNDRIVEN_WHEELS_FAULT,
    "one driven wheel": Status.DRIVEN_WHEELS_FAULT,
    "one undriven wheel": Status.UNDRIVEN_WHEELS_FAULT,
    "engine torque": Status.ENGINE_TORQUE_FAULT,
}
LATE_TORQUE = replace(PRODUCTION, torque_gain=1.05, torque_delay_us=10_000, seed=3)


@pytest.fixture(scope="module")
def truth():
    return simulate(CONFIG.settings.vehicle, PAPER)


@pytest.fixture(scope="module")
def drives(truth):
    """Samples of the paper's drive from the laboratory and from a production bus with a poor torque signal."""
    found = {}
    for name, profile in (("laboratory", replace(LABORATORY, seed=1)), ("production", LATE_TORQUE)):
        frames = emit_frames(truth, CONFIG.settings.vehicle, profile, CONFIG.database)
        found[name] = Decoder(CONFIG.database, CONFIG.inputs, CONFIG.protections).decode(frames)
    return found


@pytest.fixture(scope="module")
def clean(drives):
    """The estimates without any fault."""
    return {
        "laboratory": Estimator(LABORATORY_SETTINGS).feed(drives["laboratory"]).rows,
        "production": Estimator(PRODUCTION_SETTINGS).feed(drives["production"]).rows,
    }


def errors(rows, truth):
    return np.array([rows[name] - np.interp(rows["t_us"], truth["t_us"], truth[name]) for name in TORQUES])


def shifting(rows, truth):
    """Whether both clutches carry torque in a row, by the truth."""
    both = (truth["phase1"] > 0) & (truth["phase2"] > 0)
    return np.interp(rows["t_us"], truth["t_us"], both.astype(float)) > 0.5


@pytest.mark.parametrize(
    ("drive", "settings", "limits"),
    [
        ("laboratory", LABORATORY_SETTINGS, (2.1, 3.4, 40.0)),
        ("production", PRODUCTION_SETTINGS, (6.0, 8.0, 120.0)),
    ],
    ids=["laboratory", "production"],
)
def test_errors_and_bands(drives, truth, drive, settings, limits):
    """RMS errors, and 90 % or more of the errors within 1.96 σ over the drive and within the shifts alone.

    Nine parts of ten and no more is asked of bands that say 95 %, since errors last and shifts are short. An upper
    limit stands on the bands themselves: σ is less than 3.5 times the RMS error of its torque. The car has the
    spin losses of its file, none, and that is known: what they may be else is not in σ here.
    """
    known = replace(settings.kalman, spin_loss_error_nm=0.0, spin_loss_error_nms_per_rad=0.0)
    settings = replace(settings, kalman=known)
    rows = Estimator(settings).feed(drives[drive]).rows
    error = errors(rows, truth)
    sigma = np.array([rows[name] for name in SIGMAS])
    rms = np.sqrt(np.mean(error**2, axis=1))
    assert (rms <= limits).all()
    within = np.abs(error) <= 1.96 * sigma
    assert (within.mean(axis=1) >= 0.9).all()
    assert (within[:, shifting(rows, truth)].mean(axis=1) >= 0.9).all()
    assert (np.median(sigma, axis=1) <= 3.5 * rms).all()


@pytest.mark.parametrize("drive", ["laboratory", "production"])
def test_covariance_stays_one(drives, drive):
    """Symmetric to the bit and positive semidefinite to rounding, at 300 moments of a drive."""
    data = drives[drive]
    estimator = Estimator(LABORATORY_SETTINGS if drive == "laboratory" else PRODUCTION_SETTINGS)
    edges = np.linspace(0, len(data), 301).astype(int)
    for a, b in pairwise(edges):
        estimator.feed(data[a:b])
        f = estimator.chosen.state[0]
        P = f["P"]
        assert (P == P.T).all()
        unknown = np.ones(len(P), bool)
        unknown[[State.RATIO_1, State.RATIO_2]] = f["gear"] != 0  # no gear, no error of it
        assert not P[~unknown].any()
        P = P[np.ix_(unknown, unknown)]
        size = np.sqrt(np.diag(P))
        assert (size > 0).all()
        assert np.linalg.eigvalsh(P / np.outer(size, size)).min() > -1e-9
    assert estimator.health["numeric_resets"][0] == 0


@settings(max_examples=20)
@given(st.lists(st.integers(0, 12_000), max_size=12), st.integers(0, 2**32 - 1))
def test_cuts_change_no_bit(cuts, seed):
    random = np.random.default_rng(seed)
    data = traffic(1.0, lambda t: cruise(60.0, 40.0 * (t < 0.5)))
    value = data.value + random.normal(0.0, 1.0, len(data)) * (data.quantity < 8)
    value[random.random(len(data)) < 0.01] = 6.0  # odd positions, gears and speeds
    data = Samples(data.t_us, data.quantity, value, data.status, data.last)
    ours = replace(HAND_MADE, method=Method.KALMAN)
    whole = Estimator(ours).feed(data)
    estimator = Estimator(ours)
    parts = [
        estimator.feed(data[a:b]) for a, b in pairwise([0, *sorted(min(c, len(data)) for c in cuts), len(data)])
    ]
    assert np.concatenate([p.rows for p in parts]).tobytes() == whole.rows.tobytes()
    assert np.concatenate([p.health for p in parts]).tobytes() == whole.health.tobytes()


SHIFT_US = 6_150_000  # in the middle of the up-shift
FAULT_US = 200_000
RECOVERY_US = 300_000
FAULTS = ("missing", "stuck", "spikes")


def with_fault(data, quantities, fault):
    """The samples with a fault of 200 ms in some signals."""
    value, status = data.value.copy(), data.status.copy()
    random = np.random.default_rng(5)
    for quantity in quantities:
        mine = np.flatnonzero(data.quantity == quantity)
        mine = mine[(data.t_us[mine] >= SHIFT_US) & (data.t_us[mine] < SHIFT_US + FAULT_US)]
        if fault == "missing":
            status[mine] = SampleStatus.NOT_AVAILABLE
        elif fault == "stuck":
            value[mine] = value[mine[0]]
        else:
            hit = mine[random.random(len(mine)) < 0.3]
            value[hit] += random.choice([-100.0, 100.0], len(hit))
    return replace(data, value=value, status=status)


@pytest.mark.parametrize("drive", ["laboratory", "production"])
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("signal", list(SIGNALS))
def test_a_faulty_signal_is_ridden_out(drives, clean, truth, drive, fault, signal):
    """200 ms in the middle of a shift: no divergence, the flag names it, 300 ms later all is nearly as without.

    What is left is within two of the filter's own σ. A torque that sticks cannot be told from one that stays the
    same; nor can both wheels of the driven axle on the slow bus, whose prediction is uncertain in a shift: there
    what is left is within three. Wheels go stale after 200 ms only.
    """
    settings = LABORATORY_SETTINGS if drive == "laboratory" else PRODUCTION_SETTINGS
    estimator = Estimator(settings)
    rows, good = estimator.feed(with_fault(drives[drive], SIGNALS[signal], fault)).rows, clean[drive]
    assert estimator.health["numeric_resets"][0] == 0
    during = (rows["t_us"] >= SHIFT_US) & (rows["t_us"] < SHIFT_US + FAULT_US)
    late = rows["t_us"] > SHIFT_US + FAULT_US + RECOVERY_US
    left = 3.0 if (signal, fault, drive) == ("driven wheels", "stuck", "production") else 2.0
    for torque, sigma, bound, rest in zip(TORQUES, SIGMAS, (70.0, 70.0, 450.0), (6.0, 8.0, 120.0), strict=True):
        difference = np.abs(rows[torque] - good[torque])
        assert difference[during].max() <= bound
        assert (difference[late] <= np.maximum(rest, left * good[sigma][late])).all()
    unnamed = {
        ("missing", "driven wheels"),
        ("missing", "undriven wheels"),
        ("missing", "one driven wheel"),
        ("missing", "one undriven wheel"),
        ("stuck", "engine torque"),
    }
    if (fault, signal) not in unnamed and (fault, signal, drive) != ("stuck", "driven wheels", "production"):
        named = np.bitwise_or.reduce(rows["status"][during] & ~good["status"][during])
        assert Status(int(named)) & FLAGS[signal]


@pytest.mark.parametrize("value", ["stuck", "zero"])
@pytest.mark.parametrize("wheel", [Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_RL])
def test_a_dead_wheel_is_left_out_for_good(drives, clean, wheel, value):
    """From the middle of the shift to the end: its neighbour stands for both, and no torque suffers."""
    data = drives["production"]
    mine = np.flatnonzero((data.quantity == wheel) & (data.t_us >= SHIFT_US))
    values = data.value.copy()
    values[mine] = values[mine[0]] if value == "stuck" else 0.0
    rows, good = Estimator(PRODUCTION_SETTINGS).feed(replace(data, value=values)).rows, clean["production"]
    moving = (rows["t_us"] > SHIFT_US) & (rows["t_us"] < SHIFT_US + 4_000_000)
    for torque, sigma, rest in zip(TORQUES, SIGMAS, (6.0, 8.0, 120.0), strict=True):
        difference = np.abs(rows[torque] - good[torque])[moving]
        assert (difference <= np.maximum(rest, 3.0 * good[sigma][moving])).all()
    flag = Status.DRIVEN_WHEELS_FAULT if wheel == Q.WHEEL_SPEED_FL else Status.UNDRIVEN_WHEELS_FAULT
    assert np.mean((rows["status"][moving] & np.uint32(int(flag))) != 0) > 0.9


def test_without_undriven_wheels_the_driven_ones_tell_of_the_body():
    """At a steady speed neither the road load nor the acceleration may drift away."""
    ours = replace(HAND_MADE, method=Method.KALMAN)
    whole = Estimator(ours).feed(traffic(20.0, lambda t: cruise())).rows[-1]
    rear = (Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR)
    driven = (
        Estimator(ours)
        .feed(traffic(20.0, lambda t: {q: v for q, v in cruise().items() if q not in rear}))
        .rows[-1]
    )
    assert abs(driven["wheel_acceleration_rad_s2"]) < 0.2
    assert driven["road_load_nm"] == pytest.approx(
        whole["road_load_nm"], abs=3.0 * whole["output_sigma_nm"] + 50.0
    )


def test_rare_gears_within_their_timeout_are_enough():
    """A gear that comes once a second and may be 3 s old keeps the filter running."""
    slow = tuple(
        replace(item, timeout_us=3_000_000) if item.quantity in (Q.GEAR1, Q.GEAR2) else item
        for item in HAND_MADE.inputs
    )
    data = traffic(10.0, lambda t: cruise())
    gears = np.isin(data.quantity, [Q.GEAR1, Q.GEAR2])
    status = np.where(gears & (data.t_us % 1_000_000 > 20_000), SampleStatus.NOT_AVAILABLE, data.status)
    rows = (
        Estimator(replace(HAND_MADE, method=Method.KALMAN, inputs=slow))
        .feed(replace(data, status=status.astype(np.uint8)))
        .rows
    )
    settled = rows["t_us"] > 3_000_000
    assert ((rows["status"][settled] & int(Status.CONVERGED)) != 0).all()


@pytest.mark.parametrize("begin_s", [0.0, 60.0])
def test_it_waits_for_gears_that_must_show_first(begin_s):
    """Started (or started anew after a gap) on the move without gear signals: no row says that gear 1 is neutral.

    Clutch 1 carries 60 N·m; read as neutral that would be an error of the engine torque, for many seconds.
    """
    ours = replace(
        HAND_MADE,
        method=Method.KALMAN,
        gear_inference=GearInference(0.02, 0.05, 60_000, 3.0),
        inputs=tuple(i for i in HAND_MADE.inputs if i.quantity not in (Q.GEAR1, Q.GEAR2)),
    )

    def moving(t):
        return {q: v for q, v in cruise(60.0).items() if q not in (Q.GEAR1, Q.GEAR2)}

    estimator = Estimator(ours)
    if begin_s:
        third = {Q.SHAFT1_SPEED: 20.0 * R[3], Q.ENGINE_SPEED: 40.0 + 20.0 * R[3]}
        estimator.feed(traffic(1.0, lambda t: moving(t) | third))
    rows = estimator.feed(traffic(1.0, moving, round(begin_s * 1e6))).rows
    valid = (rows["status"] & int(Status.CLUTCH1_VALID)) != 0
    assert valid[-1]
    assert (np.abs(rows["clutch1_torque_nm"] - 60.0)[valid] <= 3.0 * rows["clutch1_sigma_nm"][valid]).all()
    assert not (rows["status"] & int(Status.ENGINE_TORQUE_FAULT)).any()


def test_a_gap_starts_the_filter_anew():
    """A jump of the clock by an hour, forwards and back; the gears come last."""
    ours = replace(HAND_MADE, method=Method.KALMAN)
    for jump_s in (3600, -3600):
        estimator = Estimator(ours)
        for begin_s in (7200, 7200 + jump_s):
            data = traffic(2.0, lambda t: cruise(), begin_s * 1_000_000)
            order = np.argsort(np.isin(data.quantity, [Q.GEAR1, Q.GEAR2]), kind="stable")
            estimator.feed(data[order[np.argsort(data.t_us[order], kind="stable")]])
            state = estimator.chosen.state[0]
            assert begin_s * 1e6 <= state["reset_us"] < begin_s * 1e6 + 100_000
            assert abs(state["t_us"] - data.t_us[-1]) < 10_000


@pytest.mark.parametrize("drive", ["laboratory", "production"])
def test_no_fault_is_seen_where_there_is_none(clean, drive):
    """On the paper's drive with a torque that is 5 % wrong and 10 ms late, less than one row in a hundred."""
    flags = np.uint32(0)
    for flag in FLAGS.values():
        flags |= np.uint32(int(flag))
    assert np.mean((clean[drive]["status"] & flags) != 0) < 0.01


def test_the_2014_observer_has_no_uncertainty(drives):
    """With method oh2014 the four columns of the Kalman estimator are not known."""
    rows = Estimator(replace(LABORATORY_SETTINGS, method=Method.OH2014)).feed(drives["laboratory"]).rows
    for name in (*SIGMAS, "clutch_correlation"):
        assert np.isnan(rows[name]).all()


def test_innovations_are_counted_through_restarts():
    """Every speed that came while the filter ran was taken or refused; a gap and a spoiled state lose nothing."""
    ours = replace(HAND_MADE, method=Method.KALMAN)
    speeds = (Q.ENGINE_SPEED, Q.SHAFT1_SPEED, Q.SHAFT2_SPEED, Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FL)
    estimator = Estimator(ours)
    health = [estimator.feed(traffic(2.0, lambda t: cruise())).health]
    estimator.chosen.state["x"][0, 3] = np.nan
    health.append(estimator.feed(traffic(2.0, lambda t: cruise(), 2_000_000)).health)
    health.append(estimator.feed(traffic(2.0, lambda t: cruise(slip=90.0), 9_000_000)).health)
    rows = np.concatenate(health)
    last = estimator.health[0]
    assert (last["numeric_resets"], last["gap_resets"]) == (1, 1)
    missed = last["accepted"][list(speeds)] - last["innovations"] - last["innovations_rejected"]
    assert (missed >= 0).all()
    assert (missed <= 3).all()  # the first of both starts, and the frame that found the state spoiled
    for name in ("innovations", "innovation_squares", "innovations_rejected"):
        assert (np.diff(rows[name].astype(float), axis=0) >= 0).all()
        assert np.isfinite(rows[name].astype(float)).all()
    assert (
        not Estimator(replace(ours, method=Method.OH2014))
        .feed(traffic(2.0, lambda t: cruise()))
        .health["innovations"]
        .any()
    )


def test_the_mean_of_a_period_is_a_difference_of_two_records(drives):
    """1 kHz signals of known white noise: the engine's NIS is near one in every period once the car moves."""
    estimator = Estimator(LABORATORY_SETTINGS)
    rows = estimator.feed(drives["laboratory"]).health
    period_us = LABORATORY_SETTINGS.health_period_us
    assert len(rows) == pytest.approx(16e6 / period_us, abs=2)
    n, beyond, squares = (
        np.diff(rows[name][:, 0]) for name in ("innovations", "innovations_rejected", "innovation_squares")
    )
    assert n + beyond == pytest.approx(period_us / 1000, abs=1)
    assert (squares / n)[1:] == pytest.approx(1.0, abs=6 * np.sqrt(2 / n[0]))


def test_odd_values_stay_finite():
    """Speeds, torques and gears drawn at random, the clock included, give finite rows within their limits."""
    random = np.random.default_rng(7)
    n = 20_000
    t_us = np.cumsum(random.integers(-2_000, 9_000, n))
    rows = [
        (int(t), int(q), float(v), 0, True)
        for t, q, v in zip(
            t_us,
            random.integers(0, len(Q), n),
            random.choice([0.0, 1.0, 2.0, 6.0, 90.0, -300.0, 1e5], n),
            strict=True,
        )
    ]
    estimator = Estimator(replace(HAND_MADE, method=Method.KALMAN))
    estimates = estimator.feed(samples(rows)).rows
    assert len(estimates)
    for name in (*TORQUES, *SIGMAS, "clutch_correlation"):
        assert np.isfinite(estimates[name]).all()
    assert (np.abs(estimates["clutch_correlation"]) <= 1.0).all()


@pytest.mark.parametrize("signal", ["engine speed", "shaft 1", "shaft 2", "driven wheels", "undriven wheels"])
@pytest.mark.parametrize("at_s", [2.5, 6.15], ids=["launch", "shift"])
def test_a_spike_is_not_believed(drives, clean, signal, at_s):
    """50 rad/s on one frame of production CAN moves no torque by more than 1.5 of its own σ."""
    data, good = drives["production"], clean["production"]
    hit = np.isin(data.quantity, SIGNALS[signal]) & (data.t_us >= at_s * 1e6)
    hit &= data.t_us == data.t_us[hit][0]
    struck = Estimator(PRODUCTION_SETTINGS).feed(replace(data, value=data.value + 50.0 * hit)).rows
    for torque, sigma in zip(TORQUES, SIGMAS, strict=True):
        assert (np.abs(struck[torque] - good[torque]) <= 1.5 * good[sigma] + 0.5).all()


@pytest.mark.parametrize(("told", "speed"), [(0.0, 0.0), (-1e-14, 0.0), (20.0, 20.3), (-20.0, -19.7)])
def test_a_wheel_that_stands_is_not_corrected(told, speed):
    """Alone it tells the mean of its axle, from which it usually differs; at rest none does."""
    assert wheels.alone(told, 0.3) == pytest.approx(speed, abs=1e-12)
    if speed == 0.0:
        assert wheels.alone(told, 0.3) == 0.0
