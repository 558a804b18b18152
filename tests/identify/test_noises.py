"""Noises of the speeds: what is learned on what was held out, and what is taken of it."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.analysis.noise_hints import learned_noises
from dctorque_can.identify.judgement import Judgement, noise_results, without_help
from dctorque_can.pipeline.estimates import HEALTH, SENSORS

WHEELS = "estimator.kalman.wheel_speed_noise_rad_s"


def healths(wheels: tuple[float, ...], samples: float) -> np.ndarray:
    """Return runs that have learned these noises of the wheels, and that all else is as told."""
    records = np.zeros(len(wheels), HEALTH)
    records["speed_noise_told_rad_s"] = (0.1, 0.1, 0.1, 0.02, 0.02)
    for record, noise in zip(records, wheels, strict=True):
        record["speed_noise_rad_s"] = (0.1, 0.1, 0.1, noise, noise)
        record["speed_noise_samples"] = samples
    return records


def judgement(records: np.ndarray, wheels_nis: float = 1.0) -> Judgement:
    nis = {name: wheels_nis if "wheels" in name else 1.0 for name in SENSORS}
    return Judgement(nis, 0.0, 1.0, [], learned_noises(records))


def test_runs_are_put_together() -> None:
    """The mean of squares: each run alone has too few samples."""
    (wheels,) = [each for each in learned_noises(healths((0.1, 0.14), 300.0)) if each.key == WHEELS]
    assert wheels.learned_rad_s == pytest.approx(((0.1**2 + 0.14**2) / 2.0) ** 0.5)
    assert wheels.samples == 600.0
    assert wheels.value == pytest.approx(0.12)


def test_another_noise_is_told_with_its_chance() -> None:
    (found,) = noise_results(judgement(healths((0.1, 0.1), 400.0)))
    assert found.key == WHEELS
    assert found.changes
    assert found.after.value == pytest.approx(0.1)
    assert found.after.sigma == pytest.approx(0.1 / (2.0 * 800.0) ** 0.5)


def test_a_usual_noise_stays() -> None:
    assert noise_results(judgement(healths((0.03, 0.03), 400.0))) == []


def test_too_few_samples_are_named() -> None:
    found = {each.key: each for each in noise_results(judgement(healths((0.1,), 100.0)))}
    assert set(found) == {
        WHEELS,
        "estimator.kalman.engine_speed_noise_rad_s",
        "estimator.kalman.shaft_speed_noise_rad_s",
    }
    assert not found[WHEELS].changes
    assert found[WHEELS].after == found[WHEELS].before


@pytest.mark.parametrize(("nis", "refused"), [(1.2, False), (0.3, True)])
def test_a_noise_that_does_not_help_goes_back(nis: float, refused: bool) -> None:
    now = judgement(healths((0.1, 0.1), 400.0), wheels_nis=2.0)
    (found,) = without_help(noise_results(now), now, replace(now, nis=judgement(healths((), 0.0), nis).nis))
    assert found.refused is refused
    assert found.changes is not refused
