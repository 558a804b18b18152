"""Decoder and estimator together: what a log gives at once, a live bus gives message by message."""

import numpy as np
import pytest

from dctorque_can.chain import Chain
from dctorque_can.config.load import load_config
from dctorque_can.logs.messages import MessageRoom, message_from_frame
from dctorque_can.resources import shipped_config

from .recorded_drive import drive  # noqa: F401  fixture


@pytest.mark.parametrize("method", ["kalman", "oh2014"])
@pytest.mark.parametrize("most", [1, 7, 256])
def test_messages_of_a_live_bus_give_the_bits_of_a_log(drive, method, most):  # noqa: F811
    config = load_config(shipped_config("paper_car"), {"estimator.method": method})
    whole, live, room = Chain(config), Chain(config), MessageRoom(most)
    frames = drive.frames[:2000]
    messages = [message_from_frame(frames, i) for i in range(len(frames))]
    given = [live.feed(room.frames(messages[n : n + most])) for n in range(0, len(messages), most)]
    expected = whole.feed(frames)
    assert len(expected) > 100
    assert np.concatenate([each.rows for each in given]).tobytes() == expected.rows.tobytes()
    assert np.concatenate([each.health for each in given]).tobytes() == expected.health.tobytes()
    assert live.health.tobytes() == whole.health.tobytes()
