"""Whole recordings smoothed: better and honest on the simulated drives, the same however they are taken apart."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.kalman import tape
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Quantity, Samples
from dctorque_can.pipeline.smoothing import Smoother
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, mixed_drive, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, emit_frames

from .drives import SETTINGS as HAND_MADE
from .drives import SIGNED, cruise, samples, traffic

CONFIG = load_config(shipped_config("paper_car"))
SETTINGS = CONFIG.settings
SETTINGS = replace(SETTINGS, kalman=replace(SETTINGS.kalman, parameter_error_share=0.0))  # it is the very car
PRODUCTION_DESIGN = load_config(shipped_config("avante_dct7")).settings.kalman
OURS = replace(HAND_MADE, method=Method.KALMAN)
TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
SIGMAS = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm")
SMOOTHED = (*TORQUES, *SIGMAS, "clutch_correlation", "clutch_torque_sum_nm")
OTHERS = [name for name in ESTIMATE.names if name not in (*SMOOTHED, "status")]


@pytest.fixture(scope="module")
def truth():
    return simulate(SETTINGS.vehicle, PAPER)


@pytest.fixture(scope="module")
def drives(truth):
    """Samples of the paper's drive from the laboratory and from a production bus."""
    found = {}
    for name, profile in (("laboratory", LABORATORY), ("production", PRODUCTION)):
        frames = emit_frames(truth, SETTINGS.vehicle, replace(profile, seed=2), CONFIG.database)
        found[name] = Decoder(CONFIG.database, CONFIG.inputs, CONFIG.protections).decode(frames)
    return found


def smooth(settings, data, **options):
    smoother = Smoother(settings, **options)
    smoother.feed(data)
    return smoother.smoothed()


def joined(*parts):
    return Samples(*(np.concatenate([getattr(p, name) for p in parts]) for name in Samples.__slots__))


def between(data, begin_s, end_s):
    return data[slice(*np.searchsorted(data.t_us, [begin_s * 1e6, end_s * 1e6]))]


def later(data, seconds):
    return replace(data, t_us=data.t_us + round(seconds * 1e6))


@pytest.fixture(scope="module")
def traffic_truth():
    """A minute of traffic: a launch, and all gears up."""
    truth = simulate(SETTINGS.vehicle, mixed_drive(SETTINGS.vehicle, 11, 180.0))
    return truth[truth["t_us"] < 60_000_000]


@pytest.mark.parametrize(
    ("profile", "signed", "whole", "shifts"),
    [
        (LABORATORY, True, (1.0, 1.0, 1.05), (0.8, 0.8)),
        (LABORATORY, False, (1.0, 1.0, 1.1), (0.8, 0.8)),  # while the direction of the launch is not known
        (PRODUCTION, True, (0.85, 0.85, 1.0), (0.85, 0.9)),
        (PRODUCTION, False, (0.85, 0.85, 1.0), (0.85, 0.9)),
    ],
    ids=["laboratory", "laboratory without sign", "production", "production without sign"],
)
def test_errors_and_bands(traffic_truth, profile, signed, whole, shifts):
    """RMS errors as shares of the online ones at most; sigmas never larger; 90 % of the errors in 1.96 σ.

    Limits for both clutches and the output over the whole drive, and for the clutches while both carry torque.
    """
    truth, design = traffic_truth, SETTINGS.kalman
    if profile is PRODUCTION:  # what a vehicle file without its own numbers has
        design = replace(PRODUCTION_DESIGN, parameter_error_share=0.0)
    frames = emit_frames(truth, SETTINGS.vehicle, replace(profile, seed=2), CONFIG.database)
    smoother = Smoother(replace(SETTINGS, kalman=design, inputs=SIGNED if signed else SETTINGS.inputs))
    online = smoother.feed(Decoder(CONFIG.database, CONFIG.inputs, CONFIG.protections).decode(frames)).rows
    rows = smoother.smoothed()
    both = (truth["phase1"] > 0) & (truth["phase2"] > 0)
    shifting = np.interp(rows["t_us"], truth["t_us"], both.astype(float)) > 0.5
    for torque, sigma, limit, limit_in_shifts in zip(TORQUES, SIGMAS, whole, (*shifts, np.inf), strict=True):
        true = np.interp(rows["t_us"], truth["t_us"], truth[torque])
        error, error_online = rows[torque] - true, online[torque] - true
        assert np.sqrt(np.mean(error**2)) < limit * np.sqrt(np.mean(error_online**2))
        in_shifts = np.sqrt(np.mean(error[shifting] ** 2))
        assert in_shifts < limit_in_shifts * np.sqrt(np.mean(error_online[shifting] ** 2))
        assert (rows[sigma] <= online[sigma]).all()
        within = np.abs(error) <= 1.96 * rows[sigma]
        assert within.mean() >= 0.9
        assert within[shifting].mean() >= 0.9
    for name in OTHERS:
        assert np.array_equal(rows[name], online[name], equal_nan=rows[name].dtype.kind == "f")


def test_the_forward_pass_is_the_estimator(drives):
    """Also once it has smoothed: rows and health are those of an estimator that was fed at once."""
    data = drives["production"][:3000]
    whole = Estimator(SETTINGS).feed(data)
    smoother = Smoother(SETTINGS, 100)
    first = smoother.feed(data[:2000])
    before = smoother.smoothed()
    second = smoother.feed(data[2000:])
    assert np.concatenate([first.rows, second.rows]).tobytes() == whole.rows.tobytes()
    assert np.concatenate([first.health, second.health]).tobytes() == whole.health.tobytes()
    assert smoother.smoothed()["t_us"].tobytes() == whole.rows["t_us"].tobytes()
    assert len(before) == len(first.rows)


def test_segments_change_no_bit(drives):
    """Of 2 s with an up-shift: however long the segments are, and however the samples were fed.

    All at once has no room on the tape and is halved.
    """
    data = between(drives["production"], 5.0, 7.0)
    whole = Smoother(SETTINGS, len(data))
    whole.feed(data)
    expected = whole.smoothed()
    assert len(expected) > tape.ROWS
    assert smooth(SETTINGS, data, segment=1024).tobytes() == expected.tobytes()
    assert smooth(SETTINGS, data, segment=37).tobytes() == expected.tobytes()
    random = np.random.default_rng(4)
    cuts = np.sort(random.integers(0, len(data), 30))
    smoother = Smoother(SETTINGS)
    for a, b in pairwise([0, *cuts, len(data)]):
        smoother.feed(data[a:b])
    assert smoother.smoothed().tobytes() == expected.tobytes()
    assert smoother.smoothed().tobytes() == expected.tobytes()  # asked again


def test_the_last_moment_has_no_later():
    data = traffic(1.0, lambda t: cruise(60.0, 40.0 + 10.0 * np.sin(9.0 * t)))
    smoother = Smoother(OURS)
    online = smoother.feed(data).rows
    rows = smoother.smoothed()
    for name in SMOOTHED:
        assert rows[-1][name] == pytest.approx(online[-1][name], rel=1e-12)


@pytest.mark.parametrize("pause_s", [5.0, -30.0], ids=["gap", "clock set back"])
def test_nothing_is_known_across_a_reset(pause_s):
    """Two recordings with more than the largest gap between them are smoothed as if each stood alone."""
    random = np.random.default_rng(3)
    data = traffic(1.0, lambda t: cruise(60.0, 40.0 + 10.0 * np.sin(9.0 * t)))
    data = replace(data, value=data.value + random.normal(0.0, 0.5, len(data)) * (data.quantity < 8))
    alone = smooth(OURS, data)
    smoother = Smoother(OURS)
    online = smoother.feed(joined(data, later(data, 1.0 + pause_s))).rows
    both = smoother.smoothed()
    n = len(alone)
    assert len(both) == 2 * n
    started = np.flatnonzero(alone["clutch1_sigma_nm"] > 0.0)
    assert len(started) > n - 5
    for name in SMOOTHED:
        assert both[:n][name].tobytes() == alone[name].tobytes()
        np.testing.assert_allclose(both[n:][name][started], alone[name][started], rtol=1e-9, atol=1e-9)
    # until it has started anew the last estimate from before is held
    assert both[n : n + started[0]].tobytes() == online[n : n + started[0]].tobytes()
    assert (both[started]["clutch1_torque_nm"][:-1] != online[started]["clutch1_torque_nm"][:-1]).all()


def test_a_held_estimate_stays():
    """While an input is stale the last estimate is held: nothing later is known of it, until a new start."""
    silent = (1.0, 2.0)  # the engine's message is missing, for longer than its timeout
    data = traffic(
        3.0,
        lambda t: {
            quantity: value
            for quantity, value in cruise().items()
            if not (silent[0] < t < silent[1] and quantity <= Quantity.ENGINE_TORQUE)
        },
    )
    smoother = Smoother(OURS)
    online = smoother.feed(data).rows
    rows = smoother.smoothed()
    stale = (online["status"] & Status.INPUT_STALE) != 0
    held = stale & (online["t_us"] > 1_550_000)  # the model stands in for half a second
    assert 100 < held.sum() < 500
    assert (online["clutch1_torque_nm"][held] == online["clutch1_torque_nm"][held][0]).all()
    for name in SMOOTHED:
        np.testing.assert_allclose(rows[name][held], online[name][held], rtol=1e-12)
    assert (rows["clutch1_torque_nm"][~stale] != online["clutch1_torque_nm"][~stale]).mean() > 0.9


def test_a_gear_change_keeps_drag_in_neutral():
    """In neutral a clutch has its drag, known ± what is configured; all else is smoothed."""

    def values(t):
        return cruise(g1=1 if t < 1.2 else 3) | ({Quantity.GEAR1: 0} if 0.8 < t < 1.2 else {})

    data = traffic(2.0, values)
    smoother = Smoother(OURS)
    online = smoother.feed(data).rows
    rows = smoother.smoothed()
    neutral = (rows["gear1"] == 0) & (rows["t_us"] > 800_000)
    assert 100 < neutral.sum() < 200
    sigma, slip = rows["clutch1_sigma_nm"][neutral], online["clutch1_slip_rad_s"][neutral]
    assert (sigma == online["clutch1_sigma_nm"][neutral]).all()
    design = OURS.kalman
    expected = np.hypot(design.open_torque_nm, design.open_drag_error_nms_per_rad * slip)
    np.testing.assert_allclose(sigma, expected, rtol=0.05)  # W_D for W_E
    assert (rows["clutch_correlation"][neutral] == 0.0).all()
    drag = OURS.vehicle.clutches[0].drag_nms_per_rad
    assert np.abs(rows["clutch1_torque_nm"][neutral] - online["clutch1_torque_nm"][neutral]).max() < 20.0 * drag
    assert (rows["clutch2_sigma_nm"][neutral] < online["clutch2_sigma_nm"][neutral]).all()
    changed = np.abs(rows["clutch1_torque_nm"] - online["clutch1_torque_nm"]) > 1e-6
    assert changed[~neutral].mean() > 0.9


def test_odd_values_stay_finite_and_within_their_limits():
    """Speeds, torques and gears drawn at random, the clock included; what had to be limited says so."""
    random = np.random.default_rng(7)
    n = 20_000
    t_us = np.cumsum(random.integers(-2_000, 9_000, n))
    data = samples(
        [
            (int(t), int(q), float(v), 0, True)
            for t, q, v in zip(
                t_us,
                random.integers(0, len(Quantity), n),
                random.choice([0.0, 1.0, 2.0, 6.0, 90.0, -300.0, 1e5], n),
                strict=True,
            )
        ]
    )
    smoother = Smoother(OURS)
    online = smoother.feed(data).rows
    rows = smoother.smoothed()
    assert len(rows) == len(online) > 0
    limits = Estimator(OURS).torque_limits
    limited = (rows["status"] & Status.LIMITED) != 0
    for torque, sigma, limit in zip(TORQUES, SIGMAS, limits, strict=True):
        assert np.isfinite(rows[torque]).all()
        assert (np.abs(rows[torque]) <= limit).all()
        assert limited[np.abs(rows[torque]) == limit].all()
        assert ((rows[sigma] >= 0.0) & (rows[sigma] <= limit)).all()
    assert (np.abs(rows["clutch_correlation"]) <= 1.0).all()
    assert ((online["status"] & Status.LIMITED) <= (rows["status"] & Status.LIMITED)).all()
    valid = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID
    assert ((rows["status"][limited] & valid) == 0).all()


def test_a_limit_that_only_the_smoothed_torque_meets(drives):
    """Its status says that it was limited and that the torques are not valid; all other bits are as online."""
    data = between(drives["production"], 4.0, 7.0)
    smoother = Smoother(SETTINGS)
    free = smoother.feed(data).rows
    more = smoother.smoothed()["clutch1_torque_nm"] - free["clutch1_torque_nm"]
    more[(free["status"] & Status.CLUTCH1_VALID) == 0] = 0.0
    limit = (free["clutch1_torque_nm"] + 0.5 * more)[np.argmax(more)]
    smoother = Smoother(SETTINGS)
    smoother._estimator._now.inputs["torque_limit"][0, 0] = limit
    online = smoother.feed(data).rows
    rows = smoother.smoothed()
    met = (rows["clutch1_torque_nm"] == limit) & (online["clutch1_torque_nm"] < limit)
    assert met.any()
    valid = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
    assert (online["status"][met] & valid).any()
    assert (rows["status"][met] & valid == 0).all()
    assert (rows["status"][met] & Status.LIMITED != 0).all()
    others = ~np.uint32(valid | Status.LIMITED)
    assert (rows["status"] & others == online["status"] & others).all()
    assert (rows["status"][~met] == online["status"][~met]).all()


def test_no_samples():
    smoother = Smoother(SETTINGS)
    assert len(smoother.smoothed()) == 0
    assert len(smoother.feed(samples([]))) == 0
    assert smoother.smoothed().dtype == ESTIMATE


def test_the_2014_observer_cannot_be_smoothed():
    with pytest.raises(DctorqueError, match=r"oh2014 cannot be smoothed.*--set estimator.method=kalman"):
        Smoother(replace(SETTINGS, method=Method.OH2014))
