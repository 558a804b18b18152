"""The whole chain on one machine: simulated car, virtual CAN bus, the service, its log, and the errors."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.errors import ErrorFigures, compare
from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import LogFolder, LogPlan, bus_metadata
from dctorque_can.daemon.service import Service, Summary
from dctorque_can.daemon.wire.link import open_bus
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.offline.truth_log import TRUTHS

MOST_IN_FLIGHT = 2000  # frames that wait on the virtual bus, which has no limit of its own
STALLED_S = 30.0


@dataclass(frozen=True)
class DemoResult:
    """What the demo shows.

    Attributes:
        errors: per torque.
        summary: of the service.
        heard: frames of the service that the car received.
        log: the MCAP log.
        estimates: `ESTIMATE` ``[n]``, those in the log.
    """

    errors: dict[str, ErrorFigures]
    summary: Summary
    heard: int
    log: Path
    estimates: NDArray[np.void]

    def as_json(self) -> dict[str, Any]:
        """Return the result for scripts."""
        figures = ("rms", "bias", "peak")
        return {
            **{kind: {name: getattr(e, kind) for name, e in self.errors.items()} for kind in figures},
            "frames": self.summary.frames,
            "estimates": len(self.estimates),
            "published": self.heard,
            "log": str(self.log),
            "seconds": self.summary.seconds,
            "health": self.summary.health,
        }


class Demo:
    """Runs a simulated drive through the service.

    Args:
        config: must use the virtual interface.
        folder: takes ``demo.mcap``; is made when missing, a file of that name is replaced.
        say: is told remarks of the service.

    Raises:
        DctorqueError: the configuration has several buses.
    """

    def __init__(self, config: Config, folder: Path, say: Callable[[bool, str], None]) -> None:
        if len(config.buses) > 1:
            raise DctorqueError(f"{config.name}: has {len(config.buses)} buses under can; the demo has one")
        folder.mkdir(parents=True, exist_ok=True)
        self._log = folder / "demo.mcap"
        plan = LogPlan(
            LogFolder(folder, "demo", first=self._log),
            flush_s=0.2,
            rotate_mb=0,
            rotate_s=0,
            signals=config.logging.signals,
            metadata=bus_metadata(config),
        )
        self._connect = partial(open_bus, config.can.arguments())
        self._service = Service(config, [self._connect], plan, say, patient=True)
        self._summary: Summary | None = None
        self._failure: BaseException | None = None
        self._heard = 0

    def prepare(self) -> None:
        """Compile and open log and bus."""
        self._service.prepare()

    def run(self, drive: SimulatedDrive, progress: Callable[[float], None]) -> DemoResult:
        """Send the drive's frames as fast as the service takes them, and compare its log with the truth.

        Raises:
            DctorqueError: the service failed, or lost frames.
        """
        self._service.record_table(TRUTHS, drive.truth)
        thread = threading.Thread(target=self._serve, name="service")
        with self._connect() as car:
            thread.start()
            try:
                self._send(car, drive, progress)
            finally:
                self._service.stop()
                thread.join()
            self._listen(car)
        if self._failure is not None:
            raise self._failure
        assert self._summary is not None
        if self._summary.frames != len(drive.frames) or not self._summary.complete:
            raise DctorqueError(
                f"{len(drive.frames)} frames were sent, {self._summary.frames} received, "
                f"{self._summary.log.written if self._summary.log else 0} logged"
            )
        return self._evaluate(drive, self._summary)

    def _serve(self) -> None:
        try:
            self._summary = self._service.run()
        except BaseException as error:  # noqa: BLE001  raised again in the thread that waits for this one
            self._failure = error

    def _send(self, car: can.BusABC, drive: SimulatedDrive, progress: Callable[[float], None]) -> None:
        total = len(drive.frames)
        for i in range(total):
            car.send(message_from_frame(drive.frames, i))
            if i % 64 == 0:
                progress(i / total)
                self._wait(i - MOST_IN_FLIGHT)
                self._listen(car)
        self._wait(total)

    def _wait(self, received: int) -> None:
        """Wait until the service has received so many frames."""
        before, since_s = -1, time.monotonic()
        while self._service.received < received and self._failure is None:
            time.sleep(0.0005)
            if self._service.received != before:
                before, since_s = self._service.received, time.monotonic()
            elif time.monotonic() - since_s > STALLED_S:
                raise DctorqueError(f"the service stands still after {before} frames")

    def _listen(self, car: can.BusABC) -> None:
        while car.recv(0.0) is not None:
            self._heard += 1

    def _evaluate(self, drive: SimulatedDrive, summary: Summary) -> DemoResult:
        estimates = read_table(self._log, ESTIMATES)
        errors = compare(estimates, drive.truth)
        return DemoResult(errors, summary, self._heard, self._log, estimates)
