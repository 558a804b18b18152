"""The two sides of ``tools/latency``: ``live_sides.py service`` and ``live_sides.py bare``, each in its process.

Each says "ready", serves until SIGTERM, and prints a line of JSON.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import json
import logging
import os
import resource
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import can
import numpy as np
from can.interfaces.socketcan import socketcan as stock

from dctorque_can.config.load import Config, load_config
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, Timing, emit_frames

CAR = "paper_car"
PACED = "paced"
FULL_HZ = 4000
MAPPED_PERIOD_US = 2500  # of five messages: half of it
FILLERS = 200  # identifiers of the other half
ANSWER_S = 0.01
MOST_STALLS = 100
STAND_IN = "lo"  # an interface that is there


# --- the frames ---


def paced(config: Config) -> Frames:
    """Return the paper's drive as a production car sends it."""
    vehicle = config.settings.vehicle
    return emit_frames(simulate(vehicle, PAPER), vehicle, PRODUCTION, config.database)


def full_load(config: Config) -> Frames:
    """Return the paper's drive on a full bus: a mapped frame and another one in turns."""
    vehicle = config.settings.vehicle
    names = list(LABORATORY.timing)
    step_us = MAPPED_PERIOD_US // len(names)
    timing = {name: Timing(MAPPED_PERIOD_US, n * step_us) for n, name in enumerate(names)}
    mapped = emit_frames(simulate(vehicle, PAPER), vehicle, replace(LABORATORY, timing=timing), config.database)
    n = len(mapped)
    mapped.t_us[:] = mapped.t_us[0] + np.arange(n) * (2_000_000 // FULL_HZ)
    ids = (0x400 + np.arange(n) % FILLERS).astype(np.uint32)
    others = replace(mapped, t_us=mapped.t_us + 1_000_000 // FULL_HZ, can_id=ids, data=np.roll(mapped.data, 1, 0))
    return Frames.concatenate([mapped, others]).sorted_by_time()


# --- the sides ---


def connect(channel: str, file: int | None) -> can.BusABC:
    """Open the interface, or python-can's bus of SocketCAN on a socket that stands for it."""
    from dctorque_can.daemon.wire.link import open_bus

    if file is None:
        return open_bus({"interface": "socketcan", "channel": channel})
    logging.getLogger("can").setLevel(logging.CRITICAL)  # of options that only SocketCAN has
    stock.create_socket = lambda: socket.socket(fileno=file)
    stock.bind_socket = lambda sock, channel: None
    return open_bus({"interface": "socketcan", "channel": STAND_IN})


def bare(arguments: argparse.Namespace) -> dict[str, Any]:
    """Receive, decode what is mapped, answer every 10 ms."""
    config = load_config(shipped_config(CAR))
    names = {term.message for given in config.inputs for term in given.signals}
    known = {message.frame_id: message for message in config.database.messages if message.name in names}
    answer = can.Message(arbitration_id=0x7F1, data=bytes(8), is_extended_id=False)
    frames, took_us, sending_s, answered_s = 0, [], 0.0, 0.0
    with connect(arguments.channel, arguments.socket) as bus, stopped_by_signal() as stopped:
        say_ready()
        began_s = time.thread_time()
        while not stopped():
            message = bus.recv(0.1)
            if message is None:
                continue
            frames += 1
            if message.arbitration_id not in known:
                continue
            known[message.arbitration_id].decode(message.data, decode_choices=False)
            if message.timestamp - answered_s >= ANSWER_S:
                answered_s = message.timestamp
                mark_s = time.thread_time()
                bus.send(answer)
                took_us.append(round(1e6 * (time.time() - message.timestamp)))
                sending_s += time.thread_time() - mark_s
        cpu_s = time.thread_time() - began_s - sending_s
    return {"frames": frames, "took_us": took_us, "cpu_s": cpu_s}


def service(arguments: argparse.Namespace) -> dict[str, Any]:
    """Serve as `dctorque run` does."""
    from dctorque_can.daemon.log.plan import plan_for
    from dctorque_can.daemon.service import Service
    from dctorque_can.daemon.signals import obeying_signals

    overrides = dict(word.split("=", 1) for word in arguments.set or [])
    overrides |= {"can.interface": "socketcan", "can.channel": arguments.channel or STAND_IN}
    overrides |= {"logging.directory": arguments.folder, "output.enabled": "true"}
    config = load_config(shipped_config(CAR), overrides)
    told: list[str] = []
    served = Service(
        config,
        [partial(connect, arguments.channel, arguments.socket)],
        plan_for(config) if arguments.log else None,
        lambda is_error, text: told.append(text),
    )
    with obeying_signals(served):
        served.prepare()
        took_us = watch_answers(served)
        stalls = Stalls(served, arguments.stalls / 1000.0)
        log_before_s = children_s(served)
        before_s, modules = time.process_time(), set(sys.modules)
        say_ready()
        if arguments.before:
            begin = served._systemd.ready
            served._systemd.ready = lambda: (begin(), exec(arguments.before))
        summary = served.run()
        cpu_s = time.process_time() - before_s
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "frames": summary.frames,
        "estimates": summary.estimates,
        "published": summary.published,
        "took_us": took_us,
        "cpu_s": cpu_s,
        "log_cpu_s": used.ru_utime + used.ru_stime - log_before_s,
        "stop": stalls.of_stopping(),
        "stalls": stalls.lines,
        "garbage": stalls.garbage,
        "stalled": summary.stalls,
        "first_time": sorted(set(sys.modules) - modules),
        "log": None
        if summary.log is None
        else {**vars(summary.log), "paths": [], "files": len(summary.log.paths)},
        "link": vars(summary.link),
        "told": told,
    }


def watch_answers(served: Any) -> list[int]:
    """Return a list that gets the µs from receiving to sending of every frame that is sent."""
    took_us: list[int] = []
    send = served._publisher._send

    def timed(frames: Frames, i: int, can_id: int) -> bool:
        sent = send(frames, i, can_id)
        if sent:
            took_us.append(time.time_ns() // 1000 - int(frames.t_us[i]))
        return bool(sent)

    served._publisher._send = timed
    return took_us


class Stalls:
    """Steps of the receive loop that took long, and what was in them.

    Attributes:
        lines: one for each.
        garbage: of each generation, how many collections there were, and how long the longest took, ms.
    """

    def __init__(self, served: Any, limit_s: float) -> None:
        self.lines: list[str] = []
        self.garbage: dict[int, tuple[int, float]] = {}
        self._limit_s = limit_s
        self._began_s = time.monotonic()
        self._collected_s = self._collecting_s = 0.0
        self._compiled: list[str] = []
        self._stopping: dict[str, float] = {}
        gc.callbacks.append(self._gc)
        self._watch_numba()
        inner = [(served._chain, "feed"), (served._publisher, "publish"), (served._publisher, "hear")]
        if served._recorder is not None:
            inner += [(served._recorder, name) for name in ("frames", "estimates", "_hand_over", "_state")]
            inner += [(served._log, "pump"), (served._log, "flush"), (served._log, "rotate")]
        for owner, name in inner if limit_s > 0 else ():
            self._wrap(owner, name, self._inside)
        for name in ("_take", "_keep_time") if limit_s > 0 else ():
            self._wrap(served, name, self._whole)
        closing = [(served._links, "close"), (served._maps, "close"), (served, "_summary")]
        if served._recorder is not None:
            closing.append((served._recorder, "close"))
        for owner, name in closing:
            self._wrap_closing(owner, name)

    def of_stopping(self) -> dict[str, float]:
        """Return the seconds of each step of the end."""
        return {name: round(took_s, 3) for name, took_s in self._stopping.items()}

    def _wrap(self, owner: Any, name: str, watch: Callable[[str, Callable[..., Any]], Callable[..., Any]]) -> None:
        setattr(owner, name, watch(f"{type(owner).__name__}.{name}", getattr(owner, name)))

    def _inside(self, title: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return ``call``, which notes how long it took when that was long; costs little."""

        def watched(*arguments: Any, **named: Any) -> Any:
            began_s = time.monotonic()
            result = call(*arguments, **named)
            took_s = time.monotonic() - began_s
            if took_s >= self._limit_s:
                self._say(f"    {title}: {1e3 * took_s:.1f} ms")
            return result

        return watched

    def _whole(self, title: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return ``call``, which notes what was in it when it took long."""

        def watched(*arguments: Any, **named: Any) -> Any:
            before = self._now()
            result = call(*arguments, **named)
            if time.monotonic() - before[0] >= self._limit_s:
                self._note(title, before)
            return result

        return watched

    def _wrap_closing(self, owner: Any, name: str) -> None:
        call: Callable[..., Any] = getattr(owner, name)

        def watched(*arguments: Any, **named: Any) -> Any:
            began_s = time.monotonic()
            result = call(*arguments, **named)
            self._stopping[f"{type(owner).__name__}.{name}"] = time.monotonic() - began_s
            return result

        setattr(owner, name, watched)

    def _now(self) -> tuple[float, float, Any, float, int, int]:
        used = resource.getrusage(resource.RUSAGE_THREAD)
        return time.monotonic(), time.thread_time(), used, self._collected_s, len(sys.modules), len(self._compiled)

    def _note(self, title: str, before: tuple[float, float, Any, float, int, int]) -> None:
        now = self._now()
        own = {
            "minor faults": now[2].ru_minflt - before[2].ru_minflt,
            "major faults": now[2].ru_majflt - before[2].ru_majflt,
            "put aside": now[2].ru_nivcsw - before[2].ru_nivcsw,
            "waits": now[2].ru_nvcsw - before[2].ru_nvcsw,
            "modules": now[4] - before[4],
            "compiled": self._compiled[before[5] :],
        }
        words = ", ".join(f"{name} {value}" for name, value in own.items() if value)
        self._say(
            f"{now[0] - self._began_s:8.2f} s {title}: {1e3 * (now[0] - before[0]):.1f} ms, of these "
            f"{1e3 * (now[1] - before[1]):.1f} its own, {1e3 * (now[3] - before[3]):.1f} garbage; {words}"
        )

    def _say(self, line: str) -> None:
        if len(self.lines) < MOST_STALLS:
            self.lines.append(line)

    def _gc(self, phase: str, info: Any) -> None:
        if phase == "start":
            self._collecting_s = time.monotonic()
            return
        took_s = time.monotonic() - self._collecting_s
        self._collected_s += took_s
        count, longest_ms = self.garbage.get(info["generation"], (0, 0.0))
        self.garbage[info["generation"]] = count + 1, max(longest_ms, round(1e3 * took_s, 2))

    def _watch_numba(self) -> None:
        from numba.core import event

        class Listener(event.Listener):  # type: ignore[misc]
            def on_start(listener, event: Any) -> None:  # noqa: N805
                self._compiled.append(str(event.data.get("dispatcher")))

            def on_end(listener, event: Any) -> None:  # noqa: N805
                pass

        event.register("numba:compile", Listener())


def children_s(served: Any) -> float:
    """Return the processor time that the log process has used so far, s."""
    process = None if served._log is None else served._log._process
    if process is None:
        return 0.0
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def stopped_by_signal() -> Iterator[Callable[[], bool]]:
    """Give what says whether SIGTERM has come."""
    came: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: came.append(number))
    try:
        yield lambda: bool(came)
    finally:
        signal.signal(signal.SIGTERM, before)


def say_ready() -> None:
    print("ready", flush=True)


def main() -> None:
    atexit.register(gc.freeze)  # as `dctorque` does
    parser = argparse.ArgumentParser()
    parser.add_argument("role", choices=("service", "bare"))
    parser.add_argument("--channel", default="")
    parser.add_argument("--socket", type=int)
    parser.add_argument("--folder", default="")
    parser.add_argument("--no-log", dest="log", action="store_false")
    parser.add_argument("--set", action="append")
    parser.add_argument("--stalls", type=float, default=20.0)
    parser.add_argument("--before")
    arguments = parser.parse_args()
    result = service(arguments) if arguments.role == "service" else bare(arguments)
    print(json.dumps(result, default=str), flush=True)


if __name__ == "__main__":
    main()
