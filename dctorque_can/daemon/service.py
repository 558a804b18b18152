"""The live service: one thread that receives, estimates, sends and hands over to the log writer."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.health import health_counts, never_received
from dctorque_can.analysis.origins import OriginWatch
from dctorque_can.analysis.status_shares import BOTH_CLUTCHES, StatusShares
from dctorque_can.analysis.transmission import TransmissionFigures
from dctorque_can.bus.addresses import read_addresses
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.chain import Chain
from dctorque_can.config.edges import CanSection
from dctorque_can.config.load import Config
from dctorque_can.daemon import socketcan
from dctorque_can.daemon.clock_watch import ClockWatch
from dctorque_can.daemon.kept_maps import MAPS
from dctorque_can.daemon.link import LinkCounts
from dctorque_can.daemon.links import BusLinks, NamedBus
from dctorque_can.daemon.log_plan import LogPlan
from dctorque_can.daemon.log_process import LogCounts, LogProcess, State, no_state
from dctorque_can.daemon.map_keeper import MapKeeper
from dctorque_can.daemon.publisher import Publisher
from dctorque_can.daemon.recorder import Recorder
from dctorque_can.daemon.systemd import Systemd
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.table import Table
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.frames import SOURCE, FrameFlag, Frames
from dctorque_can.pipeline.samples import Quantity

RECEIVE_TIMEOUT_S = 0.1
SHARE_S = 0.1  # the end of a run takes some time too, a share of less would be of that
PATIENT_BYTES = 1 << 20
ORIGINS_S = 2.0  # what messages come from several places is gathered for so long, and told together


@dataclass(frozen=True)
class Summary:
    """What a run of the service did.

    Attributes:
        seconds: from ready to stop.
        cpu_share: processor time of the service's thread over ``seconds``, None when that is below `SHARE_S`; the
            log writer is another process.
        frames: received.
        estimates: given.
        valid_estimates: of these, with both clutch torques valid.
        status: share of the estimates with each torque valid and with each fault, see `StatusShares`.
        status_time: the same as shares of the time.
        transmission: the driving clutch against the transmission's own torque, see `TransmissionFigures`.
        never_received: mapped inputs of which no usable value came.
        published: frames sent.
        refused_ids: identifiers that someone else uses.
        clock_steps: times the clock of the frames was set.
        link: counters of the wire, of all buses together.
        buses: each bus: its name, the number of its channel, whether it was open at the end, its counters.
        log: counters of the log, or None without one.
        health: counters of the estimator, see `health_counts`.
        clutch_map: what was learned of the clutches by the end, None when they are not learned.
    """

    seconds: float
    cpu_share: float | None
    frames: int
    estimates: int
    valid_estimates: int
    status: dict[str, float]
    status_time: dict[str, float]
    transmission: dict[str, float] | None
    never_received: list[str]
    published: int
    refused_ids: list[int]
    clock_steps: int
    link: LinkCounts
    buses: list[dict[str, Any]]
    log: LogCounts | None
    health: dict[str, Any]
    clutch_map: dict[str, Any] | None = None

    @property
    def complete(self) -> bool:
        """Whether every received frame is in the log (or no log was wanted)."""
        return self.log is None or (self.log.dropped == 0 and not self.log.failures)

    def as_json(self) -> dict[str, Any]:
        """Return the summary for scripts."""
        result = asdict(self)
        if self.log is not None:
            for name in ("paths", "finalised"):
                result["log"][name] = [str(path) for path in result["log"][name]]
        return result


class Service:
    """Receives, estimates, publishes and records until it is stopped.

    Args:
        config: vehicle, inputs, outputs.
        connects: opens each bus, in the order of ``config.buses``.
        plan: how to log, or None for no log.
        say: is told remarks for people, one line each: ``say(is_error, text)``.
        patient: wait for the log writer instead of dropping; only for traffic that is not live.

    Attributes:
        received: frames so far.
        compiling: whether there is nothing yet that would have to be closed.
        finishing: whether all that is left to do is closing the log.
    """

    def __init__(
        self,
        config: Config,
        connects: Sequence[Callable[[], can.BusABC]],
        plan: LogPlan | None,
        say: Callable[[bool, str], None],
        patient: bool = False,
    ) -> None:
        self.received = 0
        self._config = config
        self._say = say
        self._patient = patient
        self._news: deque[tuple[bool, str]] = deque()
        self._maps = MapKeeper(config, self._tell)
        self._chain = Chain(config, maps=self._maps.maps)
        numbers = [bus.number or 0 for bus in config.buses]
        named = map(NamedBus, map(str, config.buses), numbers, connects)
        self._links = BusLinks(list(named), self._tell)
        self._out = numbers.index(config.output.channel)
        listens = len(config.buses) > 1 or any(not address.mask & SOURCE for address in config.addresses.values())
        self._origins = OriginWatch(read_addresses(config.database, config.inputs, config.addresses))
        self._watches_origins = listens
        self._origins_due_s: float | None = None
        self._log = None if plan is None else LogProcess(plan, config.documents | self._maps.documents)
        self._recorder: Recorder | None = None
        self._publisher = self._make_publisher()
        self._clock = ClockWatch(config.settings.max_step_back_us, self._tell)
        self._systemd = Systemd()
        self._stop = False
        self.compiling = False
        self.finishing = False
        self._rotate = False
        self._t_us: int | None = None
        self._were_up: list[bool] = []
        self._status = StatusShares()
        told = {given.quantity for given in config.inputs}
        self._transmission = TransmissionFigures() if Quantity.TRANSMISSION_TORQUE in told else None

    def stop(self) -> None:
        """Ask the service to end; may be called from a signal handler or another thread."""
        self._stop = True

    @property
    def stopped(self) -> bool:
        """Whether the service was asked to end."""
        return self._stop

    def rotate(self) -> None:
        """Ask for a new log; may be called from a signal handler or another thread."""
        self._rotate = True

    def prepare(self, wait_for_bus: bool = False) -> None:
        """Compile, open the log and the bus.

        Args:
            wait_for_bus: a bus that is not there (yet) is no error, it is waited for.

        Raises:
            DctorqueError: the log cannot be created, or the bus cannot be opened.
        """
        self.compiling = True
        try:
            self._chain.warm_up()
            if any(bus.interface == "socketcan" for bus in self._config.buses):
                socketcan.warm_up()
            if self._publisher is not None:
                self._output_encoder().encode(np.zeros(1, ESTIMATE))  # another one: no counter moves
        finally:
            self.compiling = False
        self._links.open(lambda: self._stop, wait_for_bus)
        if self._log is not None:
            try:
                self._log.open()
            except BaseException:
                self._links.close()
                raise
            settings = self._config.logging
            flush_s = settings.flush_ms / 1000
            self._recorder = Recorder(self._log, settings.frames, settings.estimates, flush_s, self._state)

    def record_table(self, table: Table, rows: NDArray[np.void]) -> None:
        """Put rows into the log beside what the service itself writes; between `prepare` and `run`."""
        if self._recorder is not None:
            self._recorder.table(table, rows)

    def run(self, duration_s: float | None = None) -> Summary:
        """Serve until `stop`, or for ``duration_s``; the log is closed afterwards."""
        began_s, began_cpu_s = time.monotonic(), time.thread_time()
        until_s = began_s + duration_s if duration_s is not None else float("inf")
        self._systemd.ready()
        try:
            now_s = began_s
            while not self._stop and now_s < until_s:
                pause_s = RECEIVE_TIMEOUT_S if self._recorder is None else self._recorder.pause_s(now_s)
                frames = self._links.receive(min(RECEIVE_TIMEOUT_S, until_s - now_s, pause_s))
                if len(frames):
                    self._take(frames)
                now_s = time.monotonic()
                self._keep_time(now_s)
            seconds, cpu_s = now_s - began_s, time.thread_time() - began_cpu_s
        finally:
            self._systemd.stopping()
            self._were_up = [link.up for link in self._links.links]
            self._links.close()
            self.finishing = True
            self._maps.close()
            if self._maps.maps is not None:
                self._give_maps(self._maps.last_rows())
            if self._recorder is not None:
                self._pass_on_news()
                self._recorder.close()
                self._pass_on_news()
        return self._summary(seconds, cpu_s)

    def _take(self, frames: Frames) -> None:
        """Do the whole job for a few frames."""
        self._mark_own(frames)
        self.received += len(frames)
        self._t_us = int(frames.t_us[-1])
        self._clock.look(frames.t_us, time.monotonic())
        if self._publisher is not None:
            self._publisher.hear(frames, None if len(self._links.buses) == 1 else self._number)
        if self._watches_origins and self._origins.take(frames) and self._origins_due_s is None:
            self._origins_due_s = time.monotonic() + ORIGINS_S
        estimates = self._chain.feed(frames)
        if len(estimates):
            self._status.count(estimates.rows["t_us"], estimates.rows["status"])
            if self._transmission is not None:
                self._transmission.count(estimates.rows)
        maps = self._chain.map_rows()
        if len(maps):
            self._give_maps(maps)
        sent: Frames | None = None
        if self._publisher is not None and len(estimates):
            sent = self._publisher.publish(estimates.rows)
        if self._recorder is not None:
            self._recorder.frames(frames)
            self._recorder.estimates(estimates)
            if sent is not None and len(sent) and not self._out_bus.receive_own_messages:
                sent.channel[:] = self._number
                self._recorder.frames(sent)

    def _state(self) -> State:
        """Return the state with which a log begins that begins now."""
        if not self.received:
            return no_state
        return partial(self._chain.packed, self._chain.state())

    def _give_maps(self, rows: NDArray[np.void]) -> None:
        if self._publisher is not None:
            self._publisher.renew_maps(rows)
        if self._recorder is not None and self._config.logging.estimates:
            self._recorder.table(MAPS, rows)

    def _mark_own(self, frames: Frames) -> None:
        """Tell our own frames, which come back with ``receive_own_messages`` of their bus, from those of others.

        Drivers call whatever this computer sends transmitted, also what other programs on it send.
        """
        if max(frames.flags.tobytes()) < FrameFlag.TRANSMITTED:  # most batches have no flags at all
            return
        local = (frames.flags & FrameFlag.TRANSMITTED) != 0
        frames.flags[local] &= ~np.uint8(FrameFlag.TRANSMITTED)
        if self._publisher is not None and self._out_bus.receive_own_messages:
            own = local & (frames.channel == self._number) & np.isin(frames.can_id, list(self._publisher.can_ids))
            frames.flags[own] |= np.uint8(FrameFlag.SENT)

    def _keep_time(self, now_s: float) -> None:
        if self._rotate:
            self._rotate = False
            if self._recorder is not None:
                self._recorder.rotate()
        if self._recorder is not None:
            self._recorder.keep_time(now_s)
            if self._patient:
                self._recorder.wait_for_room(PATIENT_BYTES)
        self._maps.keep_time(now_s)
        if self._origins_due_s is not None and now_s >= self._origins_due_s:
            self._origins_due_s = None
            for line in self._origins.news():
                self._tell(True, line)
        self._pass_on_news()
        away = self._links.away
        state = f"waiting for {' and '.join(away)}" if away else "estimating"
        self._systemd.keep_time(now_s, self.received, state)

    def _tell(self, is_error: bool, text: str) -> None:
        self._news.append((is_error, text))

    def _pass_on_news(self) -> None:
        """Show what happened, and note the service's own news in the log."""
        while self._news:
            is_error, text = self._news.popleft()
            if self._recorder is not None:
                t_us = self._t_us if self._t_us is not None else time.time_ns() // 1000
                self._recorder.event(t_us, EventLevel.ERROR if is_error else EventLevel.INFO, text)
            self._say(is_error, text)
        while self._log is not None and self._log.news:
            self._say(*self._log.news.popleft())

    @property
    def _out_bus(self) -> CanSection:
        return self._config.buses[self._out]

    @property
    def _number(self) -> int:
        """Of the channel that estimates are sent on."""
        return self._config.output.channel

    def _make_publisher(self) -> Publisher | None:
        if not self._config.output.enabled:
            return None
        link = self._links.links[self._out]
        return Publisher(self._output_encoder(), link, self._tell, self._maps.encoder())

    def _output_encoder(self) -> OutputEncoder:
        return OutputEncoder(self._config.output.database, self._config.output.ids)

    def _summary(self, seconds: float, cpu_s: float) -> Summary:
        return Summary(
            seconds=round(seconds, 3),
            cpu_share=round(cpu_s / seconds, 4) if seconds >= SHARE_S else None,
            frames=self.received,
            estimates=self._status.estimates,
            valid_estimates=self._status.having(BOTH_CLUTCHES),
            status=self._status.as_json(),
            status_time=self._status.time_as_json(),
            transmission=self._transmission.as_json() if self._transmission is not None else None,
            never_received=never_received(self._config.inputs, self._chain.health),
            published=self._links.counts.sent,
            refused_ids=sorted(self._publisher.refused) if self._publisher is not None else [],
            clock_steps=self._clock.steps,
            link=self._links.counts,
            buses=[
                {"name": bus.name, "number": bus.number, "open": up, **asdict(link.counts)}
                for bus, link, up in zip(self._links.buses, self._links.links, self._were_up, strict=True)
            ],
            log=self._log.counts if self._log is not None else None,
            health=health_counts(self._chain.health),
            clutch_map=self._maps.as_json(),
        )
