"""What is done to the service and its bus; each function does one thing and undoes it."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

from .bus import Bus
from .service import RESTART_S, ServiceProcess
from .traffic import Disturbance
from .vcan import Vcan, clock_is_ours

HOUR_US = 3_600_000_000
FLOOD_HZ = 4000.0
MAPPED_ID, OUTPUT_ID, LOW_ID = 0x100, 0x6F0, 0x001
_PROCESS_MADVISE, _MADV_PAGEOUT = 440, 21


@dataclass
class Stage:
    """What faults act on.

    Attributes:
        bus: with the car.
        service: on it.
        chance: for how long, how much.
        wait: waits for so many seconds, looking after the rest.
        short: durations are a third.
    """

    bus: Bus
    service: ServiceProcess
    chance: Random
    wait: Callable[[float], None]
    short: bool = False

    def seconds(self, least: float, most: float) -> float:
        return self.chance.uniform(least, most) / (3 if self.short else 1)


def _while_disturbed(stage: Stage, least_s: float, most_s: float, **changes: Any) -> str:
    now = stage.bus.traffic.disturbance
    stage.bus.traffic.disturbance = Disturbance(**{**vars(now), **changes})
    seconds = stage.seconds(least_s, most_s)
    stage.wait(seconds)
    stage.bus.traffic.disturbance = Disturbance(clock_us=stage.bus.traffic.disturbance.clock_us)
    return f"for {seconds:.1f} s"


def loss(stage: Stage) -> str:
    share = stage.chance.uniform(0.05, 0.6)
    return f"{share:.0%} " + _while_disturbed(stage, 2, 8, loss=share)


def duplication(stage: Stage) -> str:
    share = stage.chance.uniform(0.05, 0.6)
    return f"{share:.0%} " + _while_disturbed(stage, 2, 8, duplication=share)


def reordering(stage: Stage) -> str:
    share = stage.chance.uniform(0.05, 0.5)
    return f"{share:.0%} " + _while_disturbed(stage, 2, 8, reordering=share)


def bit_flips(stage: Stage) -> str:
    share = stage.chance.uniform(0.05, 0.6)
    return f"{share:.0%} " + _while_disturbed(stage, 2, 8, flips=share)


def babble(stage: Stage) -> str:
    return "0x001, 4 000/s more " + _while_disturbed(stage, 2, 6, flood=(LOW_ID,), flood_hz=FLOOD_HZ)


def babble_on_an_input(stage: Stage) -> str:
    return "0x100, 4 000/s more " + _while_disturbed(stage, 2, 6, flood=(MAPPED_ID,), flood_hz=FLOOD_HZ)


def foreign_sender(stage: Stage) -> str:
    return "0x6F0, 20/s " + _while_disturbed(stage, 1, 3, flood=(OUTPUT_ID,), flood_hz=20.0)


def bursts(stage: Stage) -> str:
    return "of 150 ms " + _while_disturbed(stage, 3, 8, burst_s=0.15)


def silence(stage: Stage) -> str:
    return _while_disturbed(stage, 2.5, 8, silent=True)


def all_at_once(stage: Stage) -> str:
    changes: dict[str, Any] = {"loss": 0.2, "duplication": 0.2, "reordering": 0.2, "flips": 0.2, "burst_s": 0.05}
    changes |= {"flood": (LOW_ID, MAPPED_ID), "flood_hz": FLOOD_HZ / 2}
    return "loss, duplication, reordering, flips, babble, bursts " + _while_disturbed(stage, 3, 8, **changes)


def clock_forwards(stage: Stage) -> str:
    stage.bus.set_clock(HOUR_US)
    return "by 1 h"


def clock_back(stage: Stage) -> str:
    stage.bus.set_clock(-HOUR_US)
    return "by 1 h"


def interface_down(stage: Stage) -> str:
    seconds = stage.seconds(0.5, 6)
    stage.bus.down()
    stage.wait(seconds)
    stage.bus.up()
    return f"for {seconds:.1f} s"


def service_stopped(stage: Stage) -> str:
    return _while_stopped(stage, stage.service.life.pid, stage.seconds(0.2, 5))


def slow_disk(stage: Stage) -> str:
    """Stop the log process: as a disk that takes nothing for a while."""
    return _while_stopped(stage, _writer(stage), stage.seconds(3, 20))


def _while_stopped(stage: Stage, pid: int, seconds: float) -> str:
    os.kill(pid, signal.SIGSTOP)
    try:
        stage.wait(seconds)
    finally:
        os.kill(pid, signal.SIGCONT)
    return f"for {seconds:.1f} s"


def _writer(stage: Stage) -> int:
    """Return the log process, as soon as there is one."""
    while not (found := stage.service.writers()):
        stage.wait(0.05)
    return found[0]


def kill_service(stage: Stage) -> str:
    stage.service.kill(with_writers=False)
    return _started_again(stage)


def kill_everything(stage: Stage) -> str:
    stage.service.kill(with_writers=True)
    return _started_again(stage)


def restart(stage: Stage) -> str:
    stage.service.terminate()
    return _started_again(stage)


def _started_again(stage: Stage) -> str:
    stage.wait(RESTART_S)
    stage.service.start()
    return f"started again after {RESTART_S:g} s"


def kill_log_process(stage: Stage) -> str:
    os.kill(_writer(stage), signal.SIGKILL)
    return ""


def new_log(stage: Stage) -> str:
    os.kill(stage.service.life.pid, signal.SIGUSR1)
    return "SIGUSR1"


def disk_full(stage: Stage) -> str:
    """Let no file of the log process grow; the error differs from that of a full disk in its number alone."""
    seconds = stage.seconds(1, 5)
    pid = _writer(stage)
    _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, hard))
    stage.wait(seconds)
    if pid in stage.service.writers():
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (hard, hard))
    return f"for {seconds:.1f} s"


def memory_pressure(stage: Stage) -> str:
    """Take away all the memory of both processes that the kernel can get back."""
    pages = sum(_page_out(pid) for pid in (stage.service.life.pid, *stage.service.writers()))
    return f"{pages >> 20} MB paged out"


class _Range(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


def _page_out(pid: int) -> int:
    """Return how many bytes the kernel was asked to take; 0 where that is not allowed."""
    libc = ctypes.CDLL(None, use_errno=True)
    number = os.pidfd_open(pid)
    asked = 0
    try:
        with open(f"/proc/{pid}/maps") as maps:  # noqa: PTH123
            ranges = [[int(word, 16) for word in line.split()[0].split("-")] for line in maps]
        for base, end in ranges:
            one = _Range(base, end - base)
            done = libc.syscall(_PROCESS_MADVISE, number, ctypes.byref(one), ctypes.c_size_t(1), _MADV_PAGEOUT, 0)
            asked += max(done, 0)
    finally:
        os.close(number)
    return asked


Fault = Callable[[Stage], str]

ENDING: dict[str, Fault] = {
    "kill -9 of the service": kill_service,
    "kill -9 of everything": kill_everything,
    "restart in order": restart,
}
"""After which the service is another process."""

OTHERS: dict[str, Fault] = {
    "kill -9 of the log process": kill_log_process,
    "disk full": disk_full,
    "interface down and up": interface_down,
    "service stopped": service_stopped,
    "clock forwards": clock_forwards,
    "clock back": clock_back,
    "silence": silence,
    "bit flips": bit_flips,
    "babble": babble,
    "babble on an input": babble_on_an_input,
    "somebody else on an identifier of ours": foreign_sender,
    "bursts": bursts,
    "loss": loss,
    "duplication": duplication,
    "reordering": reordering,
    "many disturbances at once": all_at_once,
    "slow disk": slow_disk,
    "memory pressure": memory_pressure,
    "new log": new_log,
}

KILLS: dict[str, Fault] = {name: fault for name, fault in (ENDING | OTHERS).items() if name.startswith("kill")}


def possible(bus: Bus) -> dict[str, Fault]:
    """Return the faults that do not end the service and can be made on a bus; a real clock is not touched."""
    if isinstance(bus, Vcan) and not clock_is_ours():
        return {name: fault for name, fault in OTHERS.items() if not name.startswith("clock")}
    return OTHERS
