"""A run of the service in which much happens, for whoever wants to know what it does for the first time.

    python eventful.py DRIVE_NPZ FOLDER

Prints, as JSON, the modules that were imported and the functions whose machine code was made or loaded after
`Service.prepare`, and what was told.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import can
import numpy as np
from numba.core import event

from dctorque_can.compiling.kept_code import KeptCode
from dctorque_can.config.load import load_config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service
from dctorque_can.daemon.signals import obeying_signals
from dctorque_can.daemon.wire.link import open_bus
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.pipeline.frames import FrameFlag, Frames
from dctorque_can.resources import shipped_config

HOUR_US = 3_600_000_000
PART = 350  # frames; more than one look takes


class FirstTimes(event.Listener):  # type: ignore[misc]
    """Notes what is imported, compiled or loaded from now on."""

    def __init__(self) -> None:
        self.functions: list[str] = []
        self._modules = set(sys.modules)
        event.register("numba:compile", self)
        load = KeptCode.load_overload

        def noted(kept: Any, *arguments: Any) -> Any:
            self.functions.append(kept._function.__qualname__)
            return load(kept, *arguments)

        KeptCode.load_overload = noted  # type: ignore[method-assign]

    def on_start(self, event: Any) -> None:
        self.functions.append(str(event.data["dispatcher"]))

    def on_end(self, event: Any) -> None:
        """Nothing else is to be known."""

    @property
    def modules(self) -> list[str]:
        return sorted(set(sys.modules) - self._modules)


def play(service: Service, wire: can.BusABC, frames: Frames, at_once: int = 4) -> None:
    """Send frames, some at once, and wait until they were taken."""
    for first in range(0, len(frames), at_once):
        until = service.received + len(frames[first : first + at_once])
        for i in range(first, min(first + at_once, len(frames))):
            wire.send(message_from_frame(frames, i))
        while service.received < until:
            time.sleep(0.001)


def happen(service: Service, wire: can.BusABC, frames: Frames, told: list[str]) -> None:
    """Let everything happen that a bus and a log can do to a service."""
    parts = [frames[first : first + PART] for first in range(0, 8 * PART, PART)]

    def until(text: str) -> None:
        while not any(text in line for line in told):
            time.sleep(0.01)

    play(service, wire, parts[0])
    play(service, wire, parts[1], at_once=PART)
    play(service, wire, replace(parts[2], data=parts[2].data ^ 0xFF))  # nothing of it is right
    for flag in (FrameFlag.ERROR, FrameFlag.REMOTE):
        some = parts[2][:8]
        play(service, wire, replace(some, flags=some.flags | np.uint8(flag)))
    play(service, wire, replace(parts[3], t_us=parts[3].t_us + 5_000_000))  # behind a gap
    play(service, wire, replace(parts[4], t_us=parts[4].t_us - HOUR_US))
    until("the clock of the frames was set")
    own = replace(parts[5][:4], can_id=np.full(4, 0x6F0, np.uint32), t_us=parts[5].t_us[:4] - HOUR_US)
    play(service, wire, own)
    until("someone else sends on 0x6F0")
    play(service, wire, replace(parts[5], t_us=parts[5].t_us - HOUR_US))
    logs = len(told)
    service.rotate()
    while not any(line.startswith("logging to") for line in told[logs:]):
        time.sleep(0.01)
    assert service._log is not None
    assert service._log._process is not None
    os.kill(service._log._process.pid, signal.SIGKILL)
    until("the log writer ended")
    play(service, wire, replace(parts[6], t_us=parts[6].t_us - HOUR_US))
    until("was torn and is whole again")
    until("no frame for 2 s")
    play(service, wire, replace(parts[7], t_us=parts[7].t_us - HOUR_US))
    until("frames again")


def in_thread(work: Callable[[], None], service: Service, failed: list[BaseException]) -> threading.Thread:
    def run() -> None:
        try:
            work()
        except BaseException as error:  # noqa: BLE001  raised again by who reads the list
            failed.append(error)
        finally:
            service.stop()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def main() -> None:
    drive, folder = sys.argv[1:]
    overrides = {"can.interface": "virtual", "can.channel": "eventful", "logging.directory": folder}
    config = load_config(shipped_config("paper_car"), overrides | {"output.enabled": "true"})
    with np.load(drive) as stored:
        frames = Frames(*(stored[name] for name in ("t_us", "can_id", "length", "flags", "channel", "data")))
    told: list[str] = []

    def say(is_error: bool, text: str) -> None:
        told.append(text)
        print(text, file=sys.stderr, flush=True)

    connect = partial(open_bus, config.can.arguments())
    service = Service(config, [connect], plan_for(config), say)
    failed: list[BaseException] = []
    with connect() as wire, obeying_signals(service):
        play_first = [message_from_frame(frames, i) for i in range(2)]  # ours, not the service's
        service.prepare()
        assert play_first
        first_times = FirstTimes()
        thread = in_thread(lambda: happen(service, wire, frames, told), service, failed)
        summary = service.run()
        thread.join()
    if failed:
        raise failed[0]
    result = {
        "modules": first_times.modules,
        "functions": first_times.functions,
        "told": told,
        "sent": summary.published,
        "log": [summary.log.written, summary.log.dropped, summary.frames] if summary.log is not None else None,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
