"""Where this commit keeps what is measured; changed together with the modules that it names.

`tools/bench --against` lets every commit be measured by its own copy of this file.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can

from dctorque_can.bus.decoder import Decoder
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.service import Service
from dctorque_can.logs.messages import MessageRoom, message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config


def kalman_config(car: str) -> Config:
    return load_config(shipped_config(car), {"estimator.method": "kalman"})


def frames_of(log: Path) -> Frames:
    with open_log(log) as reader:
        return Frames.concatenate(list(reader.frames()))


def messages_of(log: Path, most: int) -> list[can.Message]:
    frames = frames_of(log)
    return [message_from_frame(frames, i) for i in range(min(len(frames), most))]


def decoded(config: Config, frames: Frames) -> Any:
    return Decoder(config.database, config.inputs, config.protections, config.addresses).decode(frames)


def new_feed(config: Config) -> Callable[[Any], object]:
    """Return the function that takes samples to estimates, of an estimator in its first state."""
    return Estimator(config.settings).feed


def new_live_feed(config: Config) -> Callable[[can.Message], object]:
    """Return the function that takes one message to estimates, as the service does it."""
    chain, room = Chain(config), MessageRoom(1)
    return lambda message: chain.feed(room.frames([message]))


def new_service(config: Config, connect: Callable[[], can.BusABC]) -> Service:
    """Return a service that is ready to ``run()`` and writes no log."""
    service = Service(config, [connect], None, lambda is_error, text: None)
    service.prepare()
    return service


def mapped_messages(config: Config) -> dict[int, Any]:
    """Return by identifier the cantools messages that an input comes from."""
    names = {term.message for given in config.inputs for term in given.signals}
    return {m.frame_id: m for m in config.database.messages if m.name in names}
