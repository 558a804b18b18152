"""A run: the service on a bus, one fault after the other, and what was seen of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from random import Random

from .bus import Bus
from .faults import ENDING, KILLS, Fault, Stage, possible
from .service import ServiceProcess

SAMPLE_S = 2.0
RECOVERY_S = 120.0
SHORT_MINUTES, WITH_A_CALM_HALF_MINUTES = 3.0, 10.0
DISK = ("disk full", "slow disk")
CAUGHT_UP_S = 3.0
IN_ORDER, KILLED_WRITER = "restart in order", "kill -9 of the log process"


@dataclass
class Event:
    """One fault.

    Attributes:
        name: see `faults`.
        life: of the service in which it began.
        began_s: monotonic time of its beginning, …
        ended_s: … of its end; of a kill, of the kill.
        first: index of the first frame that passed on the bus after its beginning, …
        last: … and after its end.
        detail: how much of it.
        heard_after_s: from its end to the next frame of the service, None: never.
        valid_after_s: … with both torques valid.
    """

    name: str
    life: int
    began_s: float
    ended_s: float
    first: int
    last: int
    detail: str = ""
    heard_after_s: float | None = None
    valid_after_s: float | None = None


@dataclass
class Run:
    """Does one fault after the other.

    Args:
        bus: that is busy.
        service: on it.
        seed: of the schedule.
        tell: is told of each fault, in a line.

    Attributes:
        events: what was done, in order.
        crashes: what the service did by itself, in words.
        calm_from_s: monotonic time from which on no process is ended.
    """

    bus: Bus
    service: ServiceProcess
    seed: int
    tell: Callable[[str], None]
    events: list[Event] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    calm_from_s: float | None = None
    _sampled_s: float = 0.0
    _drops: bool = False

    def soak(self, minutes: float) -> None:
        """Do faults for so long."""
        chance = Random(self.seed)
        stage = Stage(self.bus, self.service, chance, self.wait, short=minutes <= SHORT_MINUTES)
        began_s = time.monotonic()
        half_s = began_s + 30 * minutes if minutes >= WITH_A_CALM_HALF_MINUTES else float("inf")
        others = possible(self.bus)
        names = _shuffled(ENDING | others, chance)
        calm = _shuffled({name: fault for name, fault in others.items() if name not in KILLS}, chance)
        self._begin()
        while (now_s := time.monotonic()) < began_s + 60 * minutes:
            if now_s > half_s and self.calm_from_s is None:
                self._do(stage, IN_ORDER, ENDING[IN_ORDER])
                self.calm_from_s = time.monotonic()
            name = next(names) if self.calm_from_s is None else next(calm)
            self._do(stage, name, (ENDING | others)[name])
            self.wait(stage.seconds(1.0, 4.0))
        self.service.terminate()

    def kill(self, kinds: Mapping[str, Fault], count: int) -> None:
        """Do each kind of kill so often, at moments of chance while a log is written."""
        chance = Random(self.seed)
        stage = Stage(self.bus, self.service, chance, self.wait)
        names = [name for name in kinds for _ in range(count)]
        chance.shuffle(names)
        self._begin()
        for name in names:
            self._wait_for_a_log()
            self.wait(chance.uniform(0.2, 3.0))
            self._do(stage, name, kinds[name])
        self.wait(1.0)
        self.service.terminate()

    def _wait_for_a_log(self) -> None:
        """Wait until the service has a log, a new one after the end of a log process, and has caught up with it.

        What came while a log process started is still on its way to it in the first seconds.
        """
        life, limit_s = self.service.life, time.monotonic() + RECOVERY_S
        killed = sum(event.name == KILLED_WRITER and event.life == life.number for event in self.events)
        while len(life.was_told("logging to")) <= killed and time.monotonic() < limit_s:
            self.wait(0.05)
        self.wait(CAUGHT_UP_S)

    def wait(self, seconds: float) -> None:
        """Wait, and look after memory and crashes meanwhile."""
        until_s = time.monotonic() + seconds
        while True:
            self.bus.check()
            now_s = time.monotonic()
            if self.service.alive() and now_s >= self._sampled_s + SAMPLE_S:
                self._sampled_s = now_s
                self.service.sample()
            if now_s >= until_s:
                return
            time.sleep(min(until_s - now_s, 0.01))

    def _begin(self) -> None:
        self.service.start()
        self._recover(Event("start", 0, self.service.life.began_s, self.service.life.began_s, 0, self.bus.passed))

    def _do(self, stage: Stage, name: str, fault: Fault) -> None:
        if self._drops and name in ENDING and name != IN_ORDER:  # only an orderly end tells how much was dropped
            self._do(stage, IN_ORDER, ENDING[IN_ORDER])
        self._drops = (self._drops or name in DISK) and name != IN_ORDER
        if name in KILLS:
            self._wait_for_a_log()
        began_s, first, life = time.monotonic(), self.bus.passed, self.service.life.number
        event = Event(name, life, began_s, began_s, first, first)
        event.detail = fault(stage)
        if name not in ENDING:
            event.ended_s, event.last = time.monotonic(), self.bus.passed
        self._recover(event)

    def _recover(self, event: Event) -> None:
        self.events.append(event)
        limit_s = time.monotonic() + RECOVERY_S
        bus = self.bus
        while event.valid_after_s is None and time.monotonic() < limit_s:
            self.wait(0.005)
            if not self.service.alive():
                self._crashed(event)
                continue
            since_s = max(event.ended_s, self.service.life.began_s)  # what comes earlier is of the process before
            if event.heard_after_s is None and bus.heard_s > since_s:
                event.heard_after_s = bus.heard_s - event.ended_s
            if bus.valid_s > since_s:
                event.valid_after_s = bus.valid_s - event.ended_s
        valid = "never" if event.valid_after_s is None else f"{event.valid_after_s:.2f} s"
        began_s = event.began_s - self.events[0].began_s
        self.tell(f"{began_s:7.1f} s  {event.name} {event.detail}: valid again after {valid}")

    def _crashed(self, event: Event) -> None:
        self.service.settle()
        life = self.service.life
        last = life.told[-1][1] if life.told else ""
        self.crashes.append(f"after “{event.name}” the service ended by itself with code {life.code}: {last}")
        self.service.start()


def _shuffled(faults: Mapping[str, Fault], chance: Random) -> Iterator[str]:
    while True:
        names = list(faults)
        chance.shuffle(names)
        yield from names
