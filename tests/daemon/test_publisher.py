"""It listens before it talks, and is silent where someone else talks."""

from collections.abc import Callable, Sequence

import can
import numpy as np
import pytest

from dctorque_can.bus.output import OutputEncoder
from dctorque_can.config.load import Config
from dctorque_can.daemon.link import BusLink
from dctorque_can.daemon.publisher import LISTEN_US, LONGEST_WAIT_US, Publisher
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.frames import FrameFlag, Frames

START = 1_000_000_000


def heard(
    can_id: int, flags: int = 0, t_us: Sequence[int] = range(START, START + LISTEN_US + 1, 50_000)
) -> Frames:
    frames = Frames.empty(len(t_us))
    frames.t_us[:] = t_us
    frames.can_id[:] = can_id
    frames.flags[:] = flags
    return frames


def rows(after_us: int) -> np.ndarray:
    row = np.zeros(1, ESTIMATE)
    row["t_us"] = START + after_us
    return row


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def publisher(config: Config, connect: Callable[[], can.BusABC], told: list[str]):
    link = BusLink(connect, lambda is_error, text: None)
    link.open()
    encoder = OutputEncoder(config.output.database, config.output.ids)
    yield Publisher(encoder, link, lambda is_error, text: told.append(text))
    link.close()


def ids(config: Config) -> set[int]:
    return {message.frame_id for message in config.output.database.messages}


def test_it_listens_first(publisher: Publisher, config: Config) -> None:
    assert len(publisher.publish(rows(0))) == 0  # has heard nothing at all
    publisher.hear(heard(0x100, t_us=range(START, START + LISTEN_US, 50_000)))
    assert len(publisher.publish(rows(LISTEN_US - 1))) == 0
    publisher.hear(heard(0x100, t_us=[START + LISTEN_US]))
    sent = publisher.publish(rows(LISTEN_US + 200_000))
    assert set(sent.can_id.tolist()) == ids(config)
    assert (sent.flags & FrameFlag.SENT).all()


def test_a_bus_on_which_nobody_else_talks(publisher: Publisher, config: Config) -> None:
    """Other buses tell how long it has listened; whoever uses our identifiers there disturbs nobody."""
    elsewhere = heard(min(ids(config)))
    elsewhere.channel[:] = 5
    publisher.hear(elsewhere, channel=0)
    assert set(publisher.publish(rows(LISTEN_US + 200_000)).can_id.tolist()) == ids(config)
    assert not publisher.refused
    publisher.hear(heard(min(ids(config)), t_us=[START + 2 * LISTEN_US]), channel=0)
    assert publisher.refused == {min(ids(config))}


@pytest.mark.parametrize("step_us", [-3_600_000_000, -1_000, 3_600_000_000])
def test_it_listens_as_long_when_the_clock_is_set_meanwhile(publisher: Publisher, step_us: int) -> None:
    """The step adds as much as the longest silence that counts, and takes nothing away."""
    part = np.arange(0, 200_000, 10_000)
    publisher.hear(heard(0x100, t_us=START + part))
    publisher.hear(heard(0x100, t_us=START + step_us + part))
    assert len(publisher.publish(rows(step_us + 200_000))) == 0
    publisher.hear(heard(0x100, t_us=START + step_us + 200_000 + part))
    assert len(publisher.publish(rows(step_us + 400_000))) > 0


@pytest.mark.parametrize("step_us", [-3_600_000_000, 3_600_000_000])
def test_a_step_of_the_clock_does_not_silence_it(publisher: Publisher, config: Config, step_us: int) -> None:
    publisher.hear(heard(0x100))
    assert set(publisher.publish(rows(LISTEN_US)).can_id.tolist()) == ids(config)
    assert set(publisher.publish(rows(LISTEN_US + step_us)).can_id.tolist()) == ids(config)


def test_a_bus_with_few_frames_is_listened_to_for_longer_and_not_for_ever(publisher: Publisher) -> None:
    few = START + np.arange(LISTEN_US // LONGEST_WAIT_US) * 1_000_000
    publisher.hear(heard(0x100, t_us=few))
    assert len(publisher.publish(rows(0))) == 0
    publisher.hear(heard(0x100, t_us=few[-1:] + 1_000_000))
    assert len(publisher.publish(rows(1_000_000))) > 0


def test_an_identifier_of_someone_else_is_left_alone(
    publisher: Publisher, config: Config, told: list[str]
) -> None:
    taken = min(ids(config))
    publisher.hear(heard(taken))
    publisher.hear(heard(taken))
    sent = publisher.publish(rows(LISTEN_US))
    assert set(sent.can_id.tolist()) == ids(config) - {taken}
    assert len(told) == 1
    assert f"0x{taken:X}" in told[0]
    assert "output.ids" in told[0]


@pytest.mark.parametrize("flag", [FrameFlag.SENT, FrameFlag.ERROR])
def test_our_own_frames_and_error_frames_are_nobody_else(
    publisher: Publisher, config: Config, flag: FrameFlag
) -> None:
    publisher.hear(heard(min(ids(config)), int(flag)))
    assert set(publisher.publish(rows(LISTEN_US)).can_id.tolist()) == ids(config)
