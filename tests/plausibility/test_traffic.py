"""A vehicle file with a mistake is found out in traffic, and a right one is left alone."""

from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.analysis.health import findings
from dctorque_can.chain import Chain
from dctorque_can.config.load import load_documents
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus
from dctorque_can.plausibility.findings import Finding
from dctorque_can.report.status_lines import finding_lines

VALID = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID
TOLD = Status.VEHICLE_FILE_IMPLAUSIBLE

F = Finding
EXPECTED = {  # each with one of the cars; tools/plausibility has them all on both
    "engine torque with the wrong sign": ("paper_car", F.ENGINE_TORQUE_SIGN),
    "half the engine torque": ("avante_dct7", F.ENGINE_TORQUE_SCALE),
    "engine torque +40 N·m": ("paper_car", F.ENGINE_TORQUE_OFFSET),
    "engine torque −300 N·m": ("avante_dct7", F.ENGINE_TORQUE_OFFSET),
    "clutches exchanged": ("paper_car", F.CLUTCHES_EXCHANGED),
    "positions close the other way": ("avante_dct7", F.CLUTCH_DIRECTION),
    "position 1 closes the other way": ("paper_car", F.CLUTCH1_CALLED_OPEN),
    "kissing points 7 instead of 3 mm": ("avante_dct7", F.LAUNCH_CALLED_OPEN),
    "kissing points 1 instead of 3 mm": ("paper_car", F.CLUTCH1_CALLED_CLOSED),
    "wrong driven axle": ("paper_car", F.DRIVEN_AXLE),
    "mass × 10": ("avante_dct7", F.MASS),
    "engine inertia × 10": ("paper_car", F.ENGINE_INERTIA),
    "wheel radius +5 %": ("paper_car", F.WHEEL_SPEEDS),
    "wheel radius −5 %": ("avante_dct7", F.WHEEL_SPEEDS),
    "rear wheel speeds −5 %": ("paper_car", F.AXLE_SPEEDS),
    "ratio of gear 3 −10 %": ("avante_dct7", F.GEAR_RATIO),
    "shaft speeds exchanged": ("paper_car", F.SHAFTS_EXCHANGED),
    "gear signal shifted": ("avante_dct7", F.GEAR_SIGNAL),
}


def replayed(config, frames):
    chain = Chain(config)
    return chain.feed(frames).rows, chain.health


@pytest.mark.parametrize("name", EXPECTED)
def test_a_mistake_is_named_and_torques_are_not_valid_from_then_on(cases, drives, name):
    car, expected = EXPECTED[name]
    config, frames = drives[car]
    wrong = load_documents(config.documents, cases.mistakes(config)[name])
    rows, health = replayed(wrong, frames)
    assert health["findings"][0] & health["findings_strong"][0] & expected
    told = rows["status"] & TOLD != 0
    assert told.any()
    late = slice(np.argmax(told), None)
    assert told[late].mean() > 0.99
    assert (rows["status"][late] & VALID == 0).mean() > 0.97


@pytest.mark.parametrize(
    ("car", "name"),
    [
        ("paper_car", "clutches exchanged"),
        ("avante_dct7", "positions close the other way"),
        ("avante_dct7", "kissing points 7 instead of 3 mm"),
    ],
)
def test_after_a_mistake_of_the_clutches_the_speeds_alone_tell_the_torques(cases, drives, car, name):
    """Invalid as they are, they are near those of the right file; phases are not known, and the finding stays."""
    config, frames = drives[car]
    right = replayed(config, frames)[0]
    rows, _ = replayed(load_documents(config.documents, cases.mistakes(config)[name]), frames)
    told = rows["status"] & TOLD != 0
    late = np.arange(len(rows)) > np.argmax(told) + 1000
    assert not np.any(rows["status"][late] & Status.PHASES_KNOWN)
    for torque, share in (("clutch1_torque_nm", 0.25), ("clutch2_torque_nm", 0.25), ("output_torque_nm", 0.25)):
        off = np.sqrt(np.mean((rows[torque][late] - right[torque][late]) ** 2))
        assert off < share * np.sqrt(np.mean(right[torque][late] ** 2))


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
def test_a_right_file_is_left_alone(drives, car):
    rows, health = replayed(*drives[car])
    assert findings(health) == []
    assert not (rows["status"] & TOLD).any()
    assert (rows["status"] & VALID == VALID).mean() > 0.97


def test_honest_errors_of_a_file_are_left_alone(cases):
    config, frames = cases.in_traffic("paper_car", 2, seconds=40.0, errors=cases.HONEST["heavy, weak engine"])
    assert findings(replayed(config, frames)[1]) == []


@pytest.mark.parametrize("settings", [{}, {"inputs.wheel_speeds.fl.delay_ms": "20"}])
def test_findings_do_not_depend_on_how_a_log_was_cut(cases, drives, settings):
    """With delays the estimates stand on copies of the state: the monitor goes along with them."""
    config, frames = drives["avante_dct7"]
    frames = frames[: len(frames) // 2]
    settings = settings | cases.mistakes(config)["ratio of gear 2 +10 %"] | {"estimator.period_ms": "20"}
    wrong = load_documents(config.documents, settings)
    rows, health = replayed(wrong, frames)
    assert health["findings"][0] == F.GEAR_RATIO
    chain, cuts = Chain(wrong), np.random.default_rng(1).choice(len(frames), 60, replace=False)
    edges = [0, *sorted(cuts.tolist()), len(frames)]
    parts = [chain.feed(frames[a:b]).rows for a, b in pairwise(edges)]
    assert np.concatenate(parts).tobytes() == rows.tobytes()
    assert chain.health.tobytes() == health.tobytes()


def idling(torque, start_s, seconds):
    """Samples of a car that stands with both clutches open; the engine idles at 84 rad/s."""
    now = {
        Quantity.ENGINE_SPEED: 84.0,
        Quantity.ENGINE_TORQUE: torque,
        Quantity.SHAFT1_SPEED: 0.0,
        Quantity.SHAFT2_SPEED: 0.0,
        **dict.fromkeys(range(Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_RR + 1), 0.0),
        Quantity.GEAR1: 1.0,
        Quantity.GEAR2: 0.0,
        Quantity.CLUTCH1_POSITION: 0.0,
        Quantity.CLUTCH2_POSITION: 0.0,
        Quantity.BRAKE: 1.0,
    }
    n, frames = len(now), round(seconds * 100)
    t_us = np.repeat(round(start_s * 1e6) + 10_000 * np.arange(frames), n)
    last = np.tile(np.arange(n) == n - 1, frames)
    quantity = np.tile(np.array(list(now), np.uint8), frames)
    ok = np.full(n * frames, SampleStatus.OK, np.uint8)
    return Samples(t_us, quantity, np.tile(list(now.values()), frames), ok, last)


def test_torques_are_valid_again_when_nothing_contradicts_any_more(drives):
    from dctorque_can.pipeline.estimator import Estimator

    config, _ = drives["paper_car"]
    estimator = Estimator(config.settings)
    wrong = estimator.feed(idling(40.0, 0.0, 10.0)).rows
    begun = np.argmax(wrong["status"] & TOLD != 0)
    assert 1.4 < wrong["t_us"][begun] * 1e-6 < 1.8  # `OFFSET_S`
    assert estimator.health["findings_strong"][0] == F.ENGINE_TORQUE_OFFSET
    right = estimator.feed(idling(0.0, 10.0, 40.0)).rows
    # 40 N·m for 10 s, then 0: the fading mean is 0.8 · 20 N·m after 15 s, or a little later for what fades
    ended = right["t_us"][np.argmax(right["status"] & TOLD == 0)] * 1e-6
    assert 22.0 < ended < 26.0
    assert right["status"][-1] & VALID
    (found,) = findings(estimator.health)
    assert not found["stands"]
    (line,) = finding_lines([found])
    assert "inputs.engine_torque" in line
    assert line.endswith("[no longer so at the end]")


def test_neither_garbage_nor_gaps_make_findings(drives):
    from dctorque_can.pipeline.estimator import Estimator

    config, _ = drives["paper_car"]
    random = np.random.default_rng(3)
    estimator = Estimator(config.settings)
    for start_s in (0.0, 100.0, 50.0, 51.0):
        sane = idling(0.0, start_s, 2.0)
        wild = np.where(random.random(len(sane)) < 0.3, random.normal(0.0, 1e6, len(sane)), sane.value)
        estimator.feed(Samples(sane.t_us, sane.quantity, wild, sane.status, sane.last))
    health = estimator.health
    assert np.isfinite(health["finding_measured"]).all()
