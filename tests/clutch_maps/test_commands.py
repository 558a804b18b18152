"""A frozen map that turns positions into commanded torques."""

import numpy as np
import pytest

from dctorque_can.clutch_maps.commands import Commands
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus

from .car import capacity, rows_of, samples_of, settings

SECOND = 1_000_000


@pytest.fixture(scope="module")
def maps() -> ClutchMaps:
    """Return the map of clutch 1 after a minute of slipping."""
    t = np.arange(0, 60 * SECOND, 10_000)
    x = 5.2 + 1.9 * np.sin(2e-6 * np.pi * t / 4.0)
    taught = ClutchMaps(settings())
    taught.take(samples_of(t, x), rows_of(t, capacity(x)))
    return taught


def test_nothing_known_is_no_command():
    assert Commands.of(ClutchMaps(settings())) is None


def test_its_error_is_not_below_that_of_any_node(maps: ClutchMaps):
    commands = Commands.of(maps)
    (one,) = commands.clutches
    assert one.quantity == Quantity.CLUTCH1_COMMAND
    allowed = commands.error_nm + commands.error_share * one.torque_nm
    assert np.all(allowed[one.valid] >= 2.0 * one.sigma_nm[one.valid] - 1e-9)
    assert 0.05 < commands.error_share < 0.3


def test_a_command_stands_before_its_position_in_the_same_frame(maps: ClutchMaps):
    """A frame with both positions, one of a position that is unknown to the map, and a damaged one."""
    quantity = [Quantity.ENGINE_SPEED, Quantity.CLUTCH1_POSITION, Quantity.CLUTCH2_POSITION] * 3
    value = [100.0, 5.0, 5.0, 100.0, 11.5, 5.0, 0.0, 0.0, 0.0]
    status = [SampleStatus.OK] * 6 + [SampleStatus.BAD_CRC] * 3
    last = [False, False, True] * 3
    samples = Samples(
        np.repeat([0, 10_000, 20_000], 3),
        np.array(quantity, np.uint8),
        np.array(value),
        np.array(status, np.uint8),
        np.array(last),
    )
    found = Commands.of(maps).added_to(samples)
    assert found.quantity.tolist() == [quantity[0], Quantity.CLUTCH1_COMMAND, *quantity[1:]]
    assert found.t_us.tolist() == [0, *samples.t_us.tolist()]
    assert found.last.tolist() == [False, *last]
    assert found.status.tolist() == [SampleStatus.OK, *status]
    assert found.value[1] == pytest.approx(capacity(5.0), abs=3.0)


def test_nothing_to_add_gives_the_samples_themselves(maps: ClutchMaps):
    samples = samples_of([0, 1], [0.0, 0.0])
    assert Commands.of(maps).added_to(samples) is samples
