"""Spin losses, drag of open clutches and the load of the road, against closed forms and a simulated drive."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.evidence.moments import SHAFTS, Moments, moments
from dctorque_can.evidence.series import Series, Signal
from dctorque_can.identify.drive import rate
from dctorque_can.identify.resistances import SLOPE, drives, road_load, spin_losses
from dctorque_can.identify.results import Result
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config

SPIN_NM, SPIN_NMS, DRAG_NMS = 1.2, 0.006, 0.012
BELIEVED = {
    "vehicle.shafts.1.spin_loss_nm": "{value: 0.8, sigma: 0.4}",
    "vehicle.shafts.1.spin_loss_nms_per_rad": "{value: 0.004, sigma: 0.002}",
    "vehicle.clutches.1.drag_nms_per_rad": "{value: 0.02, sigma: 0.01}",
    "vehicle.shafts.1.inertia_kgm2": "{value: 0.02, sigma: 0.0002}",
}


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(shipped_config("paper_car"), BELIEVED)


def coasting(config: Config, coasts: int) -> Moments:
    """Return shaft 1 out of gear with its clutch open, running down again and again below engines that idle.

    J ω̇ = −s − s' ω + d (ω_e − ω) is an exponential.
    """
    inertia = config.settings.vehicle.shaft_inertia_kgm2(1)
    random = np.random.default_rng(4)
    shaft, engine = [], []
    t_s = np.arange(0.0, 3.0, 0.01)
    for n in range(coasts):
        w_e = 90.0 + 60.0 * (n % 4)
        end, falls = (DRAG_NMS * w_e - SPIN_NM) / (SPIN_NMS + DRAG_NMS), (SPIN_NMS + DRAG_NMS) / inertia
        shaft.append(end + (400.0 - end) * np.exp(-falls * t_s))
        engine.append(np.full(len(t_s), w_e))
    w, w_e = np.concatenate(shaft), np.concatenate(engine)
    t_s = 0.01 * np.arange(len(w))
    values = {
        Quantity.ENGINE_SPEED: w_e,
        Quantity.ENGINE_TORQUE: 0.0 * w,
        Quantity.SHAFT1_SPEED: w + 0.1 * random.standard_normal(len(w)),
        Quantity.SHAFT2_SPEED: 0.0 * w,
        Quantity.GEAR1: 0.0 * w,
        Quantity.GEAR2: 0.0 * w,
        Quantity.CLUTCH1_POSITION: 0.0 * w,
        Quantity.CLUTCH2_POSITION: 0.0 * w,
        Quantity.WHEEL_SPEED_FL: 20.0 + 0.0 * w,
        Quantity.WHEEL_SPEED_RL: 20.0 + 0.0 * w,
    }
    signals = {quantity: Signal(t_s, value) for quantity, value in values.items()}
    return moments(Series(signals, float(t_s[-1]), config))


def by_key(found: list[Result]) -> dict[str, Result]:
    return {each.key: each for each in found}


def test_a_free_shaft_tells_its_losses_and_the_drag(config: Config) -> None:
    found = by_key(spin_losses(drives([coasting(config, 60)], config), config))
    for key, true in (
        ("vehicle.shafts.1.spin_loss_nm", SPIN_NM),
        ("vehicle.shafts.1.spin_loss_nms_per_rad", SPIN_NMS),
        ("vehicle.clutches.1.drag_nms_per_rad", DRAG_NMS),
    ):
        assert found[key].changes, key
        assert found[key].told > 0.5
        assert abs(found[key].after.value - true) < 3.0 * found[key].after.sigma, key


def test_a_shaft_that_is_never_free_tells_nothing(config: Config) -> None:
    found = by_key(spin_losses(drives([coasting(config, 60)], config), config))
    key = "vehicle.shafts.2.spin_loss_nm"
    assert found[key].after == found[key].before
    assert not found[key].changes


def test_without_shaft_speeds_nothing_is_told(config: Config) -> None:
    m = coasting(config, 4)
    signals = {quantity: signal for quantity, signal in m.series.signals.items() if quantity not in SHAFTS}
    recordings = drives([moments(replace(m.series, signals=signals))], config)
    for each in (*spin_losses(recordings, config), *road_load(recordings, config)):
        assert not each.changes, each.key


def test_hills_leave_rolling_resistance_unsure(owned_drive: Moments, owned_truth: Config) -> None:
    """A mean slope of half a percent is as much as half of the rolling resistance."""
    found = by_key(road_load(drives([owned_drive], owned_truth), owned_truth))
    rolling, chassis = found["vehicle.chassis.rolling_resistance"], owned_truth.settings.vehicle.chassis
    assert abs(rolling.after.value - chassis.rolling_resistance) < 2.0 * rolling.after.sigma
    assert rolling.after.sigma > 0.9 / np.hypot(1.0 / SLOPE, 1.0 / rolling.before.sigma)
    for key in ("drag_coefficient", "frontal_area_m2"):
        each = found[f"vehicle.chassis.{key}"]
        assert abs(each.after.value - getattr(chassis, key)) < 3.0 * each.after.sigma


def test_the_rate_of_a_ramp_is_its_slope() -> None:
    ramp = 3.0 * np.arange(400) * 0.01
    assert rate(ramp, 0.08)[100:300] == pytest.approx(3.0, rel=1e-9)
