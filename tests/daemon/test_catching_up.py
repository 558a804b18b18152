"""What came while the log was opened: it is written in time, however much of it there is."""

import time
from collections.abc import Callable
from pathlib import Path

import can

from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.simulated_car import SimulatedDrive

LIMIT_S = 120.0  # so late that no load of the machine explains it


def frames_in(path: Path) -> int:
    try:
        with open_log(path) as log:
            return sum(len(frames) for frames in log.frames())
    except LogReadError:  # its head is not whole yet
        return 0


def test_a_backlog_is_written_while_it_is_taken(
    config: Config, connect: Callable[[], can.BusABC], drive: SimulatedDrive, folder: Path
) -> None:
    """Found by tools/soak: of a service that was killed with all its processes as soon as it ran, all was lost."""

    def busy() -> can.BusABC:
        bus = connect()
        with connect() as car:
            for i in range(1500):
                car.send(message_from_frame(drive.frames, i))
        return bus

    service = Service(config, [busy], plan_for(config, folder / "x.mcap"), lambda is_error, text: None)
    service.prepare()  # and nothing after it, as if it were killed
    limit_s = time.monotonic() + LIMIT_S
    while not frames_in(folder / "x.mcap"):
        assert time.monotonic() < limit_s
        time.sleep(0.02)
    service.stop()
    service.run()
