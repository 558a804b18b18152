"""Friction energies, residuals and tie-ups of simulated drives against what the simulation knows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.driveline.parameters import Thermal
from dctorque_can.estimators.kalman.model import State
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.derived import tie_up_probability
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Input, Quantity, Samples
from dctorque_can.pipeline.thresholds import TIE_UP_NM
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, emit_frames
from dctorque_can.simulation.tie_up import tie_up

from .drives import SETTINGS, Q, cruise, traffic

CONFIGS = {name: load_config(shipped_config(name)) for name in ("paper_car", "avante_dct7")}
KALMAN = {  # paper_car has its own numbers for laboratory signals, and none for a production bus
    ("paper_car", "laboratory"): CONFIGS["paper_car"].settings.kalman,
    ("paper_car", "production"): CONFIGS["avante_dct7"].settings.kalman,
    ("avante_dct7", "production"): CONFIGS["avante_dct7"].settings.kalman,
}
PROFILES = {"laboratory": replace(LABORATORY, seed=1), "production": replace(PRODUCTION, seed=1)}
ENERGY_KNOWN = (Status.ENERGY1_KNOWN, Status.ENERGY2_KNOWN)
RESIDUAL_KNOWN = (Status.RESIDUAL1_KNOWN, Status.RESIDUAL2_KNOWN)


@cache
def drive(car):
    return simulate(CONFIGS[car].settings.vehicle, PAPER)


def sensed(truth, car, profile):
    config = CONFIGS[car]
    frames = emit_frames(truth, config.settings.vehicle, PROFILES[profile], config.database)
    return Decoder(config.database, config.inputs, config.protections).decode(frames)


def settings_of(car, profile, method):
    return replace(CONFIGS[car].settings, method=method, kalman=KALMAN[car, profile])


@cache
def estimated(car, profile, method):
    return Estimator(settings_of(car, profile, method)).feed(sensed(drive(car), car, profile)).rows


@pytest.mark.parametrize(("car", "profile"), list(KALMAN))
@pytest.mark.parametrize(
    ("method", "share", "rest_j"),
    [(Method.OH2014, 0.12, 500.0), (Method.KALMAN, 0.03, 200.0)],
    ids=["oh2014", "kalman"],
)
def test_energy_of_every_engagement(car, profile, method, share, rest_j):
    """Within 12 % + 500 J (2014 observer) and 3 % + 200 J (Kalman) of the plant's own ledger of friction heat.

    The paper's drive has a launch of 24 to 37 kJ, an up-shift of 8 to 10 kJ, and down-shifts of 0.2 to 2 kJ.
    """
    rows, truth = estimated(car, profile, method), drive(car)
    found = []
    for i in (1, 2):
        number, energy = rows[f"clutch{i}_engagements"], rows[f"clutch{i}_energy_j"]
        for k in range(1, number.max() + 1):
            own = np.flatnonzero(number == k)
            end = own[np.argmax(energy[own] == energy[own[-1]])]
            heat = np.interp(rows["t_us"][[own[0] - 1, end]], truth["t_us"], truth[f"clutch{i}_heat_j"])
            found.append((heat[1] - heat[0], energy[end], bool(rows["status"][end] & ENERGY_KNOWN[i - 1])))
    true, energy, known = (np.array(column) for column in zip(*found, strict=True))
    assert len(true) >= 3
    assert (true > 7000.0).sum() == 2  # the launch and the up-shift
    assert known[true > 7000.0].all()
    assert (np.abs(energy - true) <= share * true + rest_j).all()


@pytest.mark.parametrize("method", [Method.OH2014, Method.KALMAN])
def test_power_is_torque_times_slip(method):
    """|T (ω_d − ω_ci)| of the truth while the clutch slips, within the error of the torque at that slip."""
    rows, truth = estimated("paper_car", "laboratory", method), drive("paper_car")
    for i in (1, 2):
        slip = truth["damper_speed_rad_s"] - truth[f"shaft{i}_speed_rad_s"]
        slip, torque = (np.interp(rows["t_us"], truth["t_us"], x) for x in (slip, truth[f"clutch{i}_torque_nm"]))
        slips = (rows[f"phase{i}"] == 1) & (rows[f"gear{i}"] != 0) & (rows["t_us"] > 100_000)
        error = np.abs(rows[f"clutch{i}_torque_nm"] - torque)
        difference = np.abs(rows[f"clutch{i}_power_w"] - np.abs(torque * slip))
        assert slips.sum() > 500
        # 3 rad/s: noise of the engine speed, and the twist of the damper that the 2014 observer does not know
        assert (difference <= error * np.abs(slip) + 3.0 * (np.abs(torque) + error))[slips].all()
        assert not rows[f"clutch{i}_power_w"][(rows[f"phase{i}"] != 1) | (rows[f"gear{i}"] == 0)].any()


def test_the_slip_of_the_kalman_estimator_is_that_of_its_drums():
    """The damper's secondary side minus the input shaft, by its own state after the last frame of a launch."""
    samples = sensed(drive("paper_car"), "paper_car", "production")
    estimator = Estimator(settings_of("paper_car", "production", Method.KALMAN))
    row = estimator.feed(samples[samples.t_us < 2_500_000]).rows[-1]
    assert row["t_us"] == samples.t_us[samples.t_us < 2_500_000][-1]
    x = estimator.chosen.state["x"][0]
    slip = x[State.W_D] - x[State.W_C1]
    assert slip > 50.0
    assert row["clutch1_power_w"] == pytest.approx(abs(row["clutch1_torque_nm"] * slip), rel=1e-12)
    assert slip != row["clutch1_slip_rad_s"]


@pytest.mark.parametrize("method", [Method.OH2014, Method.KALMAN])
def test_the_residual_is_the_error_when_the_command_is_the_capacity(method):
    """A slipping clutch transmits its capacity: with that as the command the residual is the torque's error."""
    truth, car = drive("paper_car"), "paper_car"
    config = settings_of(car, "laboratory", method)
    commands = (Quantity.CLUTCH1_COMMAND, Quantity.CLUTCH2_COMMAND)
    config = replace(config, inputs=(*config.inputs, *(Input(q, (), -10.0, 1e4, 100_000) for q in commands)))
    rows = Estimator(config).feed(with_commands(sensed(truth, car, "laboratory"), truth)).rows
    for i in (1, 2):
        known = (rows["status"] & int(RESIDUAL_KNOWN[i - 1])) > 0
        torque, capacity = (
            np.interp(rows["t_us"], truth["t_us"], truth[f"clutch{i}_{name}_nm"])
            for name in ("torque", "capacity")
        )
        moving = known & (np.abs(torque) > 0.9 * capacity) & (capacity > 5.0)  # the plant slips too
        error = rows[f"clutch{i}_torque_nm"] - torque
        assert moving.sum() > 300
        np.testing.assert_allclose(
            rows[f"clutch{i}_residual_nm"][moving], error[moving], atol=3.0
        )  # drag: 1.5 N·m
        assert (rows[f"phase{i}"][known] == 1).all()


def with_commands(samples, truth):
    """Put the plant's capacities before every tenth sample that ends a frame, as part of that frame."""
    at = np.flatnonzero(samples.last)[::10]
    t_us = np.repeat(samples.t_us[at], 2)
    value = np.stack(
        [np.interp(samples.t_us[at], truth["t_us"], truth[f"clutch{i}_capacity_nm"]) for i in (1, 2)], axis=1
    ).ravel()
    quantity = np.tile(np.array([Quantity.CLUTCH1_COMMAND, Quantity.CLUTCH2_COMMAND], np.uint8), len(at))
    places = np.repeat(at, 2)
    none = np.zeros(len(t_us), np.uint8)
    return Samples(
        *(
            np.insert(old, places, new)
            for old, new in (
                (samples.t_us, t_us),
                (samples.quantity, quantity),
                (samples.value, value),
                (samples.status, none),
                (samples.last, none.astype(bool)),
            )
        )
    )


@pytest.mark.parametrize("correlation", [-0.99, -0.7, 0.0, 0.5])
@pytest.mark.parametrize(
    ("torques", "sigmas"),
    [
        ((60.0, 40.0), (3.0, 5.0)),
        ((80.0, -25.0), (10.0, 8.0)),
        ((-40.0, 22.0), (15.0, 30.0)),
        ((5.0, 0.0), (20.0, 25.0)),
    ],
)
def test_the_probability_of_a_tie_up(torques, sigmas, correlation):
    """The two corners of the plane where both torques exceed the threshold with opposite signs, by scipy."""
    cross = correlation * sigmas[0] * sigmas[1]
    normal = multivariate_normal(torques, [[sigmas[0] ** 2, cross], [cross, sigmas[1] ** 2]])
    far = 1e4
    expected = normal.cdf([far, -TIE_UP_NM], lower_limit=[TIE_UP_NM, -far])
    expected += normal.cdf([-TIE_UP_NM, far], lower_limit=[-far, TIE_UP_NM])
    assert tie_up_probability(*torques, *sigmas, correlation) == pytest.approx(expected, abs=5e-5)


def recirculated(t_1, t_2):
    return np.where(t_1 * t_2 < 0.0, np.minimum(np.abs(t_1), np.abs(t_2)), 0.0)


def both_closed(rows):
    return (rows["phase1"] > 0) & (rows["phase2"] > 0) & (rows["gear1"] != 0) & (rows["gear2"] != 0)


@pytest.mark.parametrize("method", [Method.OH2014, Method.KALMAN])
@pytest.mark.parametrize("pressed_nm", [90.0, 120.0])
@pytest.mark.parametrize(("car", "profile"), list(KALMAN))
def test_a_tie_up_is_seen(car, profile, pressed_nm, method):
    """Clutch 2 is pressed against the locked clutch 1: what it carries beyond the engine's 60 N·m comes back.

    Where more than 20 N·m do, the probability is over one half in nine estimates of ten. The wheels are known to
    fit the shafts: to learn that takes longer than this drive.
    """
    config = settings_of(car, profile, method)
    config = replace(config, kalman=replace(config.kalman, wheel_scale_error_share=0.0))
    truth = tie_up(config.vehicle, 8.0, 60.0, pressed_nm)
    rows = Estimator(config).feed(sensed(truth, car, profile)).rows
    rows = rows[rows["t_us"] > 200_000]
    both = both_closed(rows)
    estimate = recirculated(rows["clutch1_torque_nm"], rows["clutch2_torque_nm"])
    np.testing.assert_array_equal(rows["recirculated_torque_nm"], np.where(both, estimate, 0.0))
    t_1, t_2 = (np.interp(rows["t_us"], truth["t_us"], truth[f"clutch{i}_torque_nm"]) for i in (1, 2))
    tied = both & (recirculated(t_1, t_2) > TIE_UP_NM)
    assert tied.sum() > 50
    probability, known = rows["tie_up_probability"], (rows["status"] & int(Status.TIE_UP_KNOWN)) > 0
    assert not probability[~both].any()
    if method is Method.OH2014:
        assert not known.any()
        assert not probability.any()
        return
    assert known.all()
    assert (probability[tied] > 0.5).mean() > 0.88
    for row in rows[both][::40]:
        sigma_1, sigma_2 = row["clutch1_sigma_nm"], row["clutch2_sigma_nm"]
        cross = row["clutch_correlation"] * sigma_1 * sigma_2
        normal = multivariate_normal(
            [row["clutch1_torque_nm"], row["clutch2_torque_nm"]], [[sigma_1**2, cross], [cross, sigma_2**2]]
        )
        expected = normal.cdf([1e4, -TIE_UP_NM], lower_limit=[TIE_UP_NM, -1e4])
        expected += normal.cdf([-TIE_UP_NM, 1e4], lower_limit=[-1e4, TIE_UP_NM])
        assert row["tie_up_probability"] == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize(("car", "profile"), list(KALMAN))
def test_a_sound_shift_is_no_tie_up(car, profile):
    """The paper's drive recirculates 7 N·m at most: the probability stays below six tenths."""
    rows, truth = estimated(car, profile, Method.KALMAN), drive(car)
    assert recirculated(truth["clutch1_torque_nm"], truth["clutch2_torque_nm"]).max() < 7.0
    assert both_closed(rows).sum() > 100
    assert rows["tie_up_probability"].max() < 0.6


def test_reverse_against_a_forward_gear():
    """Reverse turns the output the other way: both clutches drive, and against each other."""
    settings = replace(CONFIGS["avante_dct7"].settings, estimate_period_us=1000)
    R = {gear.number: gear.total_ratio for gear in settings.vehicle.gears}

    def values(t):
        wheel = 5.0
        return cruise(60.0, 40.0) | {
            Q.ENGINE_SPEED: wheel * R[1] + 40.0,
            Q.SHAFT1_SPEED: wheel * R[1],
            Q.SHAFT2_SPEED: wheel * R[-1],
            Q.GEAR2: -1,
            Q.CLUTCH2_POSITION: 6.0,
            **dict.fromkeys((Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR, Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR), wheel),
        }

    rows = Estimator(settings).feed(traffic(1.0, values)).rows[-200:]
    t_1, t_2 = rows["clutch1_torque_nm"], rows["clutch2_torque_nm"]
    assert (np.abs(t_1) > 1.0).all()
    assert (np.abs(t_2) > 1.0).all()
    np.testing.assert_array_equal(rows["recirculated_torque_nm"], recirculated(t_1, -t_2))


@pytest.mark.parametrize("method", [Method.OH2014, Method.KALMAN])
def test_cuts_change_no_bit(method):
    """The up-shift of the paper's drive, frame by frame and at once, with temperatures and commands."""
    config = settings_of("paper_car", "production", method)
    clutches = tuple(replace(c, thermal=Thermal(2500.0, 30.0, 80.0)) for c in config.vehicle.clutches)
    commands = (Input(q, (), -10.0, 1e4, 100_000) for q in (Quantity.CLUTCH1_COMMAND, Quantity.CLUTCH2_COMMAND))
    config = replace(
        config,
        vehicle=replace(config.vehicle, clutches=clutches),
        inputs=(*config.inputs, *commands),
        estimate_period_us=SETTINGS.estimate_period_us,
    )
    samples = with_commands(sensed(drive("paper_car"), "paper_car", "production"), drive("paper_car"))
    samples = samples[samples.t_us < 7_000_000]
    whole = Estimator(config).feed(samples).rows
    assert whole["clutch2_energy_j"][-1] > 1000.0
    assert whole["clutch1_temperature_c"][-1] > 90.0
    assert np.abs(whole["clutch1_residual_nm"]).max() > 0.0
    estimator, start, parts = Estimator(config), 0, []
    for end in np.flatnonzero(samples.last) + 1:
        parts.append(estimator.feed(samples[start:end]).rows)
        start = end
    assert np.concatenate(parts).tobytes() == whole.tobytes()
