"""It listens before it talks, and is silent where someone else talks."""

from collections.abc import Callable

import can
import numpy as np
import pytest

from dctorque_can.bus.output import OutputEncoder
from dctorque_can.config.load import Config
from dctorque_can.daemon.link import BusLink
from dctorque_can.daemon.publisher import LISTEN_US, Publisher
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.frames import FrameFlag, Frames

START = 1_000_000_000


def heard(can_id: int, flags: int = 0) -> Frames:
    frames = Frames.empty(1)
    frames.t_us[:] = START
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
    publisher.hear(heard(0x100))
    assert len(publisher.publish(rows(LISTEN_US - 1))) == 0
    sent = publisher.publish(rows(LISTEN_US + 200_000))
    assert set(sent.can_id.tolist()) == ids(config)
    assert (sent.flags & FrameFlag.SENT).all()


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
