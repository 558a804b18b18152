"""The live service: one thread that receives, estimates, sends and hands over to the log writer."""

from __future__ import annotations

import gc
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import can
import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.origins import OriginWatch
from dctorque_can.analysis.status_shares import StatusShares
from dctorque_can.analysis.traffic import MappedMessage
from dctorque_can.analysis.transmission import TransmissionFigures
from dctorque_can.bus.addresses import read_addresses
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.chain import Chain
from dctorque_can.config.edges import CanSection
from dctorque_can.config.load import Config
from dctorque_can.daemon.belief_watch import BeliefWatch
from dctorque_can.daemon.clock_watch import ClockWatch
from dctorque_can.daemon.kept_maps import MAPS
from dctorque_can.daemon.log.counts import State, no_state
from dctorque_can.daemon.log.plan import LogPlan, plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.recorder import Recorder
from dctorque_can.daemon.map_keeper import MapKeeper
from dctorque_can.daemon.output.publisher import Publisher
from dctorque_can.daemon.reload import Reloader
from dctorque_can.daemon.stalls import StallWatch
from dctorque_can.daemon.status.latency import Latency
from dctorque_can.daemon.status.live import LiveStatus
from dctorque_can.daemon.status.parts import Parts
from dctorque_can.daemon.status.process import StatusPlaces, StatusProcess
from dctorque_can.daemon.status.summary import Summary
from dctorque_can.daemon.systemd import Systemd
from dctorque_can.daemon.traffic_watch import TrafficWatch
from dctorque_can.daemon.wire import socketcan
from dctorque_can.daemon.wire.kernel_filter import Wanted
from dctorque_can.daemon.wire.links import BusLinks, NamedBus
from dctorque_can.daemon.wire.listening import remark
from dctorque_can.daemon.wire.socketcan import MOST
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.table import Table
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.frames import SOURCE, Address, FrameFlag, Frames
from dctorque_can.pipeline.samples import Quantity

__all__ = ["Service", "Summary"]  # all that one needs for a run

RECEIVE_TIMEOUT_S = 0.1
PATIENT_BYTES = 1 << 20
MOST_CATCHING_UP = 256  # looks at the buses, each for `MOST` frames
ORIGINS_S = 2.0  # what messages come from several places is gathered for so long, and told together


class Service:
    """Receives, estimates, publishes and records until it is stopped.

    Args:
        config: vehicle, inputs, outputs.
        connects: opens each bus, in the order of ``config.buses``.
        plan: how to log, or None for no log.
        say: is told remarks for people, one line each: ``say(is_error, text)``.
        patient: wait for the log writer instead of dropping; only for traffic that is not live.
        places: where the status can be read, or None for nowhere.
        reread: reads the vehicle file anew and says how to log then (None without a log); None: never.

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
        places: StatusPlaces | None = None,
        reread: Callable[[], Config] | None = None,
    ) -> None:
        self.received = 0
        self._config = config
        self._say = say
        self._patient = patient
        self._news: deque[tuple[bool, str]] = deque()
        self._maps = MapKeeper(config, self._tell)
        self._chain = Chain(config, maps=self._maps.maps)
        numbers = [bus.number or 0 for bus in config.buses]
        mapped = read_addresses(config.database, config.inputs, config.addresses)
        wanted = None if plan is not None and config.logging.frames else self._wanted(mapped)
        named = [
            NamedBus(str(bus), number, connect, bus.listen_only, wanted and wanted.on_channel(number))
            for bus, number, connect in zip(config.buses, numbers, connects, strict=True)
        ]
        self._links = BusLinks(named, self._tell)
        self._out = numbers.index(config.output.channel)
        listens = len(config.buses) > 1 or any(not address.mask & SOURCE for address in config.addresses.values())
        self._origins = OriginWatch(mapped)
        messages = [MappedMessage(*key, message.length, message.length) for key, message in mapped.items()]
        self._traffic = TrafficWatch(messages, self._tell)
        self._watches_origins = listens
        self._origins_due_s: float | None = None
        self._log = None if plan is None else LogProcess(plan, config.documents | self._maps.documents)
        self._recorder: Recorder | None = None
        self._publisher = self._make_publisher()
        self._clock = ClockWatch(config.settings.max_step_back_us, self._tell)
        self._stalls = StallWatch(self._tell)
        self._beliefs = BeliefWatch(*self._chain.messages, self._tell)
        self._systemd = Systemd()
        self._stop = False
        self.compiling = False
        self.finishing = False
        self._rotate = False
        self._t_us: int | None = None
        self._mute: list[str] = []
        self._status = StatusShares()
        self._latency = Latency()
        self._reloader = Reloader(reread, self._tell)
        watches = (self._status, self._stalls, self._clock, self._latency, self._reloader.outcomes)
        self._parts = Parts(config, self._chain, self._links, self._publisher, self._log, *watches)
        self._live = None if places is None else LiveStatus(StatusProcess(places, self._tell), self._parts)
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

    def reload(self) -> None:
        """Ask for the vehicle file to be read anew; may be called from a signal handler or another thread."""
        self._reloader.ask()

    def prepare(self, wait_for_bus: bool = False) -> None:
        """Compile, open the log and the bus.

        A log that cannot be created in the directory of the vehicle file is told, and tried again while it runs.

        Args:
            wait_for_bus: a bus that is not there (yet) is no error, it is waited for; so are a log at a given path
                and the places of the status.

        Raises:
            DctorqueError: the log at a given path cannot be created, the bus cannot be opened, or the status
                cannot be served where it is wanted.
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
        for bus in self._config.buses:
            if bus.listen_only and (line := remark(bus.interface, str(bus.channel))):
                self._tell(False, line)
        if self._log is not None:
            try:
                self._log.open(self._log.given_path is not None and not wait_for_bus, lambda: self._stop)
            except BaseException:
                self._links.close()
                raise
            if not self._log.counts.paths and not self._stop:
                self._tell(True, "estimating without a log until one can be written; it is tried again and again")
            settings = self._config.logging
            flush_s = settings.flush_ms / 1000
            self._recorder = Recorder(self._log, settings.frames, settings.estimates, flush_s, self._state)
        if self._live is not None:
            try:
                self._live.begin(not wait_for_bus, lambda: self._stop)
            except BaseException:
                self._links.close()
                if self._recorder is not None:
                    self._recorder.close()
                raise
        self._catch_up()

    def _catch_up(self) -> None:
        """Take what has come while the log was opened; what it would be answered with is of the past."""
        for _ in range(MOST_CATCHING_UP):
            frames = self._links.receive(0.0)
            if len(frames):
                self._take(frames, late=True)
                if self._recorder is not None:
                    self._recorder.keep_time(time.monotonic())
            if len(frames) < MOST or self._stop:
                return

    def record_table(self, table: Table, rows: NDArray[np.void]) -> None:
        """Put rows into the log beside what the service itself writes; between `prepare` and `run`."""
        if self._recorder is not None:
            self._recorder.table(table, rows)

    def run(self, duration_s: float | None = None) -> Summary:
        """Serve until `stop`, or for ``duration_s``; the log is closed afterwards."""
        gc.freeze()  # what is there stays; to look through it for garbage takes a tenth of a second
        began_s, began_cpu_s = time.monotonic(), time.thread_time()
        until_s = began_s + duration_s if duration_s is not None else float("inf")
        self._systemd.ready()
        try:
            now_s = began_s
            while not self._stop and now_s < until_s:
                pause_s = RECEIVE_TIMEOUT_S if self._recorder is None else self._recorder.pause_s(now_s)
                frames = self._links.receive(min(RECEIVE_TIMEOUT_S, until_s - now_s, pause_s))
                late = self._stalls.look(time.monotonic(), len(frames)) and not self._patient
                if len(frames):
                    self._take(frames, late)
                now_s = time.monotonic()
                self._keep_time(now_s)
            seconds, cpu_s = now_s - began_s, time.thread_time() - began_cpu_s
        finally:
            self._systemd.stopping()
            buses = self._parts.buses_json()
            self._mute = self._links.mute
            self._links.close()
            self.finishing = True
            self._maps.close()
            if self._maps.maps is not None:
                self._give_maps(self._maps.last_rows())
            if self._recorder is not None:
                self._pass_on_news()
                self._recorder.close()
                self._pass_on_news()
            if self._live is not None:
                self._live.process.close()
            gc.unfreeze()
        return Summary.of(
            self._parts,
            seconds,
            cpu_s,
            frames=self.received,
            transmission=self._transmission.as_json() if self._transmission is not None else None,
            missing=[*self._mute, *(self._traffic.lines() if self._traffic.told else ())],
            buses=buses,
            clutch_map=self._maps.as_json(),
        )

    def _take(self, frames: Frames, late: bool) -> None:
        """Do the whole job for a few frames; of ``late`` ones nothing is sent."""
        self._mark_own(frames)
        self.received += len(frames)
        self._t_us = int(frames.t_us[-1])
        now_s = time.monotonic()
        self._clock.look(frames.t_us, now_s)
        self._traffic.take(frames, now_s)
        if self._publisher is not None:
            self._publisher.hear(frames, None if len(self._links.buses) == 1 else self._number)
        if self._watches_origins and self._origins.take(frames) and self._origins_due_s is None:
            self._origins_due_s = now_s + ORIGINS_S
        estimates = self._chain.feed(frames)
        self._beliefs.look()
        if len(estimates):
            self._status.count(estimates.rows["t_us"], estimates.rows["status"])
            if self._transmission is not None:
                self._transmission.count(estimates.rows)
        maps = self._chain.map_rows()
        if len(maps):
            self._give_maps(maps)
        sent: Frames | None = None
        if self._publisher is not None and len(estimates):
            sent = self._publisher.publish(estimates.rows, late)
        if len(estimates):
            self._latency.answered(int(frames.t_us[0]), time.time_ns() // 1000)
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
        self._traffic.keep_time(now_s)
        if self._origins_due_s is not None and now_s >= self._origins_due_s:
            self._origins_due_s = None
            for line in self._origins.news():
                self._tell(True, line)
        if (new := self._reloader.look(self._config)) is not None:
            self._adopt(new)
        if self._live is not None:
            self._live.keep_time(now_s, self.received, self._t_us, self._doing)
        self._pass_on_news()
        self._systemd.keep_time(now_s, self.received, self._doing)

    def _adopt(self, config: Config) -> None:
        """Go on with a vehicle file that has changed in what may change meanwhile; a new log begins with it."""
        self._config = self._parts.config = config
        self._chain.rename(config)
        self._maps.rename(config)
        if self._publisher is not None:
            self._publisher.change_silence(config.output.foreign_silence_s)
        if self._log is not None and self._recorder is not None:
            self._log.change(plan_for(config, self._log.given_path), config.documents | self._maps.documents)
            settings = config.logging
            self._recorder.change(settings.frames, settings.estimates, settings.flush_ms / 1000)

    def _doing(self) -> str:
        """Return in a few words what the service does at the moment."""
        if away := self._links.away:
            return f"waiting for {' and '.join(away)}"
        if self._traffic.mapped:
            lost = self._links.counts.dropped
            sends = "" if self._publisher is None else self._publisher.in_words
            return "estimating" + sends + (f", {lost} frames lost by the kernel" if lost else "")
        return "no mapped frame yet" if self.received else "no frame yet"

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
        silence_s = self._config.output.foreign_silence_s
        encoder, maps = self._output_encoder(), self._maps.encoder()
        return Publisher(encoder, link, self._tell, maps, silence_s, live=not self._patient)

    def _wanted(self, mapped: Iterable[tuple[str, Address]]) -> Wanted:
        """Return the frames that are needed when frames are not logged: what is mapped, and what we send."""
        sent = set(self._output_encoder().can_ids.values()) if self._config.output.enabled else set()
        if sent and (maps := self._maps.encoder()) is not None:
            sent |= maps.periods_s.keys()
        return Wanted([address for _, address in mapped], sent)

    def _output_encoder(self) -> OutputEncoder:
        return OutputEncoder(self._config.output.database, self._config.output.ids)
