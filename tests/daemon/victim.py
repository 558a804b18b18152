"""A service with its traffic in one process, for whoever wants to kill it.

    python victim.py CONFIG_YAML DRIVE_NPZ FOLDER RECEIVED [KEY=VALUE]...

The drive is sent in real time, over and over; each frame's own number is in a frame of identifier 0x7F0. The file
RECEIVED always holds how many frames the service has taken, as eight bytes.
"""

from __future__ import annotations

import sys
import threading
import time
from functools import partial
from pathlib import Path

import can
import numpy as np

from dctorque_can.config.load import load_config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service
from dctorque_can.daemon.wire.link import open_bus
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import Frames

NUMBERED = 0x7F0
STEP_S = 0.005


def send_for_ever(arguments: dict[str, object], frames: Frames, begin: threading.Event) -> None:
    """Send the frames of a drive when they are due, and after each step a numbered one."""
    messages = [message_from_frame(frames, i) for i in range(len(frames))]
    due_s = (frames.t_us - frames.t_us[0]) * 1e-6
    with open_bus(arguments) as bus:
        begin.wait()
        number, began_s = 0, time.monotonic()
        while True:
            at = 0
            while at < len(messages):
                end = int(np.searchsorted(due_s, time.monotonic() - began_s))
                for message in messages[at:end]:
                    message.timestamp = time.time()  # the virtual bus keeps it
                    bus.send(message)
                at = end
                number += 1
                data = number.to_bytes(8, "little")
                bus.send(can.Message(time.time(), NUMBERED, is_extended_id=False, data=data))
                time.sleep(STEP_S)
            began_s = time.monotonic()


class Watched(Service):
    """A service whose received frames others can see."""

    received_by: np.memmap

    def _take(self, frames: Frames, late: bool = False) -> None:
        super()._take(frames, late)
        numbered = np.flatnonzero(frames.can_id == NUMBERED)
        if len(numbered):
            last = frames.data[numbered[-1], :8].copy().view("<u8")[0]
            self.received_by[:] = int(last), int(1e6 * time.monotonic())


def main() -> None:
    """Serve until killed."""
    path, drive, folder, received, *more = sys.argv[1:]
    overrides = dict(word.split("=", 1) for word in more)
    overrides |= {"can.interface": "virtual", "can.channel": "victim", "logging.directory": folder}
    config = load_config(path, overrides)
    with np.load(drive) as stored:
        frames = Frames(*(stored[name] for name in ("t_us", "can_id", "length", "flags", "channel", "data")))
    service = Watched(
        config,
        [partial(open_bus, config.can.arguments())],
        plan_for(config),
        lambda is_error, text: print(text, file=sys.stderr, flush=True),
    )
    service.received_by = np.memmap(Path(received), "<u8", "w+", shape=(2,))
    begin = threading.Event()
    arguments = config.can.arguments()
    threading.Thread(target=send_for_ever, args=(arguments, frames, begin), daemon=True).start()
    service.prepare()
    begin.set()
    service.run()


if __name__ == "__main__":
    main()
