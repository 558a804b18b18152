"""The Kalman filter that is told the truth: what it is told, and that it is not worse for it."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config, load_config
from dctorque_can.offline.bound import BoundChain, told_samples
from dctorque_can.offline.comparison import compare_bound, compare_variants, variants_of
from dctorque_can.offline.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car
from dctorque_can.pipeline.samples import Quantity, Samples
from dctorque_can.resources import shipped_config

OF_DEMO_CAR = (ProfileName.LABORATORY, ProfileName.PRODUCTION, ProfileName.INERTIAL)
TOLD = (Quantity.GEAR1, Quantity.GEAR2, Quantity.CLUTCH1_POSITION, Quantity.CLUTCH2_POSITION)


def at(truth: np.ndarray, t_us: np.ndarray) -> np.ndarray:
    """Return the rows of the last millisecond that has begun."""
    return truth[np.clip((t_us - truth["t_us"][0]) // 1000, 0, len(truth) - 1)]


def load(**overrides: str) -> Config:
    return load_config(shipped_config("paper_car"), {k.replace("__", "."): v for k, v in overrides.items()})


def test_every_frame_begins_with_the_truth(drive: SimulatedDrive) -> None:
    config = load()
    samples = Decoder(config.database, config.inputs, config.protections).decode(drive.frames)
    told = told_samples(samples, drive.truth)
    parts = np.split(np.arange(len(told)), np.flatnonzero(told.last) + 1)[:-1]
    before = np.split(np.arange(len(samples)), np.flatnonzero(samples.last) + 1)[:-1]
    assert len(parts) == len(before) == len(drive.frames)
    for new, old in list(zip(parts, before, strict=True))[::7]:
        assert (told.t_us[new] == samples.t_us[old][0]).all()
        assert not told.last[new[:-1]].any()
        row = at(drive.truth, told.t_us[new[:1]])[0]
        assert told.quantity[new[:4]].tolist() == list(TOLD)
        assert told.value[new[:4]].tolist() == [row[name] for name in ("gear1", "gear2", "phase1", "phase2")]
        kept = [k for k in old if samples.quantity[k] not in TOLD]
        assert told.quantity[new[4:]].tolist() == samples.quantity[kept].tolist()
        assert told.value[new[4:]].tolist() == samples.value[kept].tolist()
    assert len(told_samples(samples[:0], drive.truth)) == 0


def test_a_frame_of_nothing_else_stays_a_frame(drive: SimulatedDrive) -> None:
    n = 3
    gears = Samples(
        drive.truth["t_us"][1000 : 1000 + n].copy(),
        np.full(n, Quantity.GEAR1, np.uint8),
        np.zeros(n),
        np.zeros(n, np.uint8),
        np.ones(n, np.bool_),
    )
    told = told_samples(gears, drive.truth)
    assert told.quantity.tolist() == list(TOLD) * n
    assert np.flatnonzero(told.last).tolist() == [3, 7, 11]


def test_its_estimates_have_the_true_gears_and_phases(drive: SimulatedDrive) -> None:
    """Whatever the frames say: here the clutches' positions are those of another kissing point."""
    config = load(clutch_phase__clutch1__kissing_point="9", clutch_phase__clutch2__kissing_point="9")
    assert drive.vehicle is not None
    chain = BoundChain(config, drive.vehicle, drive.truth)
    rows = chain.feed(drive.frames).rows
    truth = at(drive.truth, rows["t_us"])
    for name in ("gear1", "gear2", "phase1", "phase2"):
        assert (rows[name] == truth[name]).all()
    assert set(rows["phase1"]) == {0, 1, 2}
    assert (rows["clutch1_sigma_nm"][20:] > 0).all()  # once every input has been there
    assert (chain.health["innovations"] > 100).all()


def test_it_knows_the_car_that_drove(drive: SimulatedDrive) -> None:
    """A wrong configuration changes the filter, not the bound; nor does where phases and gears come from."""
    right = compare_bound(load(), [drive])
    wrong = load(
        vehicle__engine_inertia_kgm2="0.3",
        vehicle__chassis__mass_kg="2500",
        estimator__method="kalman",
        gears="{source: ratio}",
    )
    assert compare_bound(wrong, [drive]).comparison == right.comparison
    unknown = compare_bound(wrong, [replace(drive, vehicle=None)])
    assert unknown.comparison != right.comparison
    assert right.doubts == []
    (doubt,) = unknown.doubts
    assert drive.name in doubt
    assert "the configured one" in doubt


def test_estimates_do_not_depend_on_how_frames_are_cut(drive: SimulatedDrive) -> None:
    assert drive.vehicle is not None
    whole, cut = (BoundChain(load(), drive.vehicle, drive.truth) for _ in range(2))
    rows = [cut.feed(drive.frames[start : start + 77]).rows for start in range(0, len(drive.frames), 77)]
    assert np.concatenate(rows).tobytes() == whole.feed(drive.frames).rows.tobytes()


@pytest.mark.parametrize("profile", OF_DEMO_CAR)
def test_the_truth_is_no_hindrance(profile: ProfileName) -> None:
    """Five drives: the clutch torques of a filter that must find out phases are no better than those of the bound.

    15 % are allowed: five drives are few.
    """
    ours = {} if profile is ProfileName.LABORATORY else {"estimator__kalman": "{}"}
    ours["estimator__kalman__parameter_error_share"] = "0"  # the car is that of the file
    config = load(**ours)
    drives = [simulate_car(config, DriveName.PAPER, profile, seed, None) for seed in range(1, 6)]
    bound = compare_bound(config, drives).comparison.everything
    _, kalman = compare_variants(variants_of(lambda more: load(**ours, **more), {}), drives)
    for torque in ("clutch1_nm", "clutch2_nm"):
        assert bound.torques[torque].rms_nm <= 1.15 * kalman.comparison.everything.torques[torque].rms_nm
