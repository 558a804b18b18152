"""Where the commits that have no ``tools/measured`` of their own keep what is measured. Never changed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import can

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.service import Service
from dctorque_can.logs.messages import frames_from_messages, message_from_frame
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
    return Decoder(config.database, config.inputs, config.protections).decode(frames)


def new_feed(config: Config) -> Callable[[Any], object]:
    """Return the function that takes samples to estimates, of an estimator in its first state."""
    return Estimator(config.settings).feed


def new_live_feed(config: Config) -> Callable[[can.Message], object]:
    """Return the function that takes one message to estimates, as the service does it."""
    decoder, feed = Decoder(config.database, config.inputs, config.protections), new_feed(config)
    return lambda message: feed(decoder.decode(frames_from_messages([message])))


def new_service(config: Config, connect: Callable[[], can.BusABC]) -> Service:
    """Return a service that is ready to ``run()`` and writes no log."""
    service = Service(config, connect, None, lambda is_error, text: None)
    service.prepare()
    return service


def mapped_messages(config: Config) -> dict[int, Any]:
    """Return by identifier the cantools messages that an input comes from."""
    names = {term.message for given in config.inputs for term in given.terms}
    return {m.frame_id: m for m in config.database.messages if m.name in names}
