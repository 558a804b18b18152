"""What both kinds of bus have in common: traffic, in a thread of its own, and an account of all that passes."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from array import array
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .traffic import RECORD, Traffic

TICK_S = 0.001
MINDED_LATE_S = 0.02
HEARD = np.dtype([("mono_us", "<i8"), ("can_id", "<u4"), ("length", "u1"), ("spare", "u1", 3), ("data", "u1", 8)])
"""A frame that the service sent, with the time at which it was heard."""


class Bus(ABC):
    """A bus with a busy car on it.

    Args:
        traffic: of the car.
        folder: for the account.
        torque_id: identifier of the service's message with the torques, …
        valid_mask: … and the bits of its payload, as a little-endian number, that say that both are valid.

    Attributes:
        traffic: see above.
        passed: frames that the bus took so far.
        heard_s: monotonic time at which the service was last heard; `valid_s`: with both torques.
        late: monotonic time and seconds of each stop of the sending thread that is longer than `MINDED_LATE_S`.
        untaken: frames that nobody was there for.
    """

    def __init__(self, traffic: Traffic, folder: Path, torque_id: int, valid_mask: int) -> None:
        self.traffic = traffic
        self.passed = 0
        self.untaken = 0
        self.heard_s = self.valid_s = 0.0
        self.late: list[tuple[float, float]] = []
        self._tick_rows, self._tick_us = array("q"), array("q")
        self._torque_id, self._valid_mask = torque_id, valid_mask
        self._passed_path, self._heard_path = folder / "passed.bin", folder / "heard.bin"
        self._passed = self._passed_path.open("wb")
        self._heard = self._heard_path.open("wb")
        self._end = threading.Event()
        self._failure: BaseException | None = None
        self._began_s = 0.0
        self._wall_us = 0
        self._thread = threading.Thread(target=self._run, name="bus")

    def start(self) -> None:
        self._began_s = time.monotonic()
        self._wall_us = time.time_ns() // 1000
        self._thread.start()

    def stop(self) -> None:
        """End the traffic.

        Raises:
            BaseException: whatever ended it before.
        """
        self._end.set()
        self._thread.join()
        self._passed.close()
        self._heard.close()
        if self._failure is not None:
            raise self._failure

    def check(self) -> None:
        """Raise what has ended the traffic."""
        if self._failure is not None:
            raise self._failure

    def all_passed(self) -> NDArray[np.void]:
        return np.fromfile(self._passed_path, RECORD)

    def all_heard(self) -> NDArray[np.void]:
        return np.fromfile(self._heard_path, HEARD)

    def time_of(self, index: int) -> float:
        """Return the monotonic time at which a frame that passed was sent."""
        at = int(np.searchsorted(np.array(self._tick_rows), index, "right")) - 1
        return self._tick_us[max(at, 0)] / 1e6

    def passed_at(self, time_s: float) -> int:
        """Return how many frames had passed at a monotonic time."""
        at = int(np.searchsorted(np.array(self._tick_us), 1e6 * time_s))
        return self.passed if at == len(self._tick_us) else self._tick_rows[at]

    def longest_late_s(self, from_s: float, to_s: float) -> float:
        """Return how long this process, beside the service, did not run at most."""
        return max((late_s for at_s, late_s in self.late if from_s <= at_s <= to_s), default=0.0)

    @abstractmethod
    def connection(self) -> list[str]:
        """Return the options of ``dctorque run``."""

    @abstractmethod
    def down(self) -> None:
        """Take the bus away."""

    @abstractmethod
    def up(self) -> None:
        """Bring it back."""

    @abstractmethod
    def set_clock(self, step_us: int) -> None:
        """Set the clock by which frames are stamped."""

    @abstractmethod
    def _give(self, records: NDArray[np.void]) -> int:
        """Send what is due and return how many the bus took; the first ones."""

    @abstractmethod
    def _take(self) -> bytes:
        """Return the `HEARD` records that have come; called often."""

    @abstractmethod
    def _close(self) -> None: ...

    def _run(self) -> None:
        try:
            looked_s = time.monotonic()
            while not self._end.is_set():
                now_s = time.monotonic()
                if now_s - looked_s > MINDED_LATE_S:
                    self.late.append((now_s, now_s - looked_s))
                looked_s = now_s
                self._step(now_s)
                time.sleep(max(TICK_S - (time.monotonic() - now_s), 0.0))
        except BaseException as error:  # noqa: BLE001  told by those who wait for it
            self._failure = error
        finally:
            self._close()

    def _step(self, now_s: float) -> None:
        records = self.traffic.due(round(1e6 * (now_s - self._began_s)))
        if len(records):
            records["t_us"] += self._wall_us
            taken = self._give(records)
            self.untaken += len(records) - taken
            if taken:
                self._tick_rows.append(self.passed)
                self._tick_us.append(round(1e6 * now_s))
                self._passed.write(records[:taken].tobytes())
                self.passed += taken
        heard = self._take()
        if heard:
            self._heard.write(heard)
            self.heard_s = now_s
            rows = np.frombuffer(heard, HEARD)
            torques = rows["data"][rows["can_id"] == self._torque_id].copy().view("<u8").ravel()
            if any(int(word) & self._valid_mask == self._valid_mask for word in torques):
                self.valid_s = now_s
