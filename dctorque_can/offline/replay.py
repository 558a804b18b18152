"""Recorded frames through the chain, as fast as possible, into a new MCAP log."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.errors import ErrorFigures, compare
from dctorque_can.analysis.health import health_counts, never_received
from dctorque_can.analysis.message_faults import message_faults
from dctorque_can.analysis.status_shares import BOTH_CLUTCHES, StatusShares
from dctorque_can.analysis.traffic import MappedMessage, Traffic
from dctorque_can.analysis.transmission import TransmissionFigures
from dctorque_can.bus.addresses import read_addresses
from dctorque_can.bus.columns import MessageColumns
from dctorque_can.bus.layout import bytes_needed
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.chain import Chain
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.clutch_maps.summary import maps_json
from dctorque_can.config.load import Config, load_documents
from dctorque_can.daemon.kept_maps import MAPS, begun, read_state, state_name, state_of
from dctorque_can.daemon.log.plan import OWN_MARK, STATE_NAME
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.output_file import remove_partial
from dctorque_can.logs.reader import LogReader
from dctorque_can.logs.reorder import Reorder
from dctorque_can.offline.playback import Player
from dctorque_can.offline.traffic_time import TrafficTime
from dctorque_can.offline.truth_log import truth_of, write_truth
from dctorque_can.pipeline.estimates import ESTIMATE, Estimates
from dctorque_can.pipeline.frames import Frames


@dataclass(frozen=True)
class ReplayContent:
    """What a replay writes beside estimates and health.

    Attributes:
        frames: the frames themselves.
        signals: the decoded signals of every known message.
        truth: the truth of a simulated log; the errors against it are computed.
        smooth: estimates are smoothed: each stands on all logs, also on what comes after it.
        state: folder with the kept maps to begin from; None: those that travel in the first log.
    """

    frames: bool = False
    signals: bool = False
    truth: bool = False
    smooth: bool = False
    state: Path | None = None


@dataclass(frozen=True)
class ReplayTargets:
    """Where a replay goes; one of them is enough.

    Attributes:
        log: the new log, or None.
        player: sends the frames and those of the estimates in real time, or None for as fast as possible.
    """

    log: Path | None
    player: Player | None = None


@dataclass(frozen=True)
class Held:
    """What one log holds.

    Attributes:
        log: its path.
        frames: read of it.
        unread: what else is in it, such as topics with their types.
        sorted_frames: that stood behind one of a later time and were put in order.
        sorted_by_us: by how much at most.
    """

    log: str
    frames: int
    unread: list[str]
    sorted_frames: int
    sorted_by_us: int


@dataclass(frozen=True)
class ReplayResult:
    """What a replay did.

    Attributes:
        output: the new log, or None.
        state: that the first log begins with: None if it has none, "" if it was used, else why it was not.
        frames: read.
        estimates: given.
        smoothed: whether these are smoothed.
        valid_estimates: of these, with both clutch torques valid.
        status: share of the estimates with each torque valid and with each fault, see `StatusShares`.
        status_time: the same as shares of the time.
        transmission: the driving clutch against the transmission's own torque, see `TransmissionFigures`.
        never_received: mapped inputs of which no usable value came.
        seconds: from opening to the closed result.
        bus_seconds: time that the frames span; a step back of the clock takes nothing away.
        problems: what could not be read, one line each.
        health: counters of the estimator.
        messages: what was wrong with the frames of each message, see `message_faults`.
        traffic: what the frames are.
        logs: what each log holds.
        clutch_map: what was learned of the clutches by the end, `None` when they are not learned.
        errors: against the truth, when that was asked for.
    """

    output: Path | None
    state: str | None
    frames: int
    estimates: int
    smoothed: bool
    valid_estimates: int
    status: dict[str, float]
    status_time: dict[str, float]
    transmission: dict[str, float] | None
    never_received: list[str]
    seconds: float
    bus_seconds: float
    problems: list[str]
    health: dict[str, Any]
    messages: dict[str, dict[str, Any]]
    traffic: Traffic
    logs: list[Held]
    clutch_map: dict[str, Any] | None
    errors: dict[str, ErrorFigures] | None

    def as_json(self) -> dict[str, Any]:
        """Return the result for scripts."""
        left = ("traffic", "output", "logs", "errors")
        words: dict[str, Any] = {name: value for name, value in vars(self).items() if name not in left}
        return words | {
            "output": None if self.output is None else str(self.output),
            "traffic": self.traffic.as_json(),
            "logs": [asdict(held) for held in self.logs],
            "errors": None if self.errors is None else {name: asdict(e) for name, e in self.errors.items()},
        }


def config_of(logs: Sequence[LogReader], overrides: Mapping[str, str]) -> Config:
    """Return the configuration that travels in the first log, with overrides laid over it.

    Raises:
        DctorqueError: the log has none.
    """
    documents = logs[0].documents
    if not any(name.endswith((".yaml", ".yml")) for name in documents):
        raise DctorqueError(f"{logs[0].path}: carries no configuration; name one with --config")
    return load_documents(documents, overrides)


REORDER_US = 100_000
"""Window within which frames of others' logs are sorted, where the vehicle file gives none."""


def replay_logs(
    logs: Sequence[LogReader],
    config: Config,
    targets: ReplayTargets,
    content: ReplayContent,
    progress: Callable[[float], None],
    watch: Callable[[Frames], None] = lambda frames: None,
) -> ReplayResult:
    """Estimate over ``logs``, one after another as one sequence; ``watch`` is shown every batch.

    Raises:
        DctorqueError: the log cannot be written (then what was written until then is removed), there is no
            truth to compare with, or the configured method cannot be smoothed.
    """
    start = state_of(logs[0].documents) if content.state is None else read_state(content.state, config)
    replay = _Replay(config, targets, content, start)
    state = logs[0].documents.get(STATE_NAME)
    if state is not None:
        replay.begin_with(state)
    began_s = time.monotonic()
    try:
        with replay:
            truth = [truth_of(reader.path) for reader in logs] if content.truth else []
            read = 0.5 if content.smooth else 1.0  # share of reading in the whole
            held: list[Held] = []
            for number, reader in enumerate(logs):
                before = replay.traffic.frames
                order = Reorder(reorder_window_us(reader, config))
                for frames in order.sorted(reader.dated_frames()):
                    replay.take(frames)
                    watch(frames)
                    progress(read * (number + reader.fraction) / len(logs))
                count = replay.traffic.frames - before
                held.append(Held(str(reader.path), count, reader.unread, order.moved, order.furthest_us))
            replay.smooth(lambda fraction: progress(read + (1.0 - read) * fraction))
            replay.finish_maps()
            errors = replay.compare(np.concatenate(truth)) if truth else None
    except DctorqueError:
        if targets.log is not None:
            remove_partial(targets.log)
        raise
    return ReplayResult(
        output=targets.log,
        state=replay.state,
        frames=replay.traffic.frames,
        estimates=replay.status.estimates,
        smoothed=content.smooth,
        valid_estimates=replay.status.having(BOTH_CLUTCHES),
        status=replay.status.as_json(),
        status_time=replay.status.time_as_json(),
        transmission=replay.transmission.as_json(),
        never_received=replay.never_received,
        seconds=round(time.monotonic() - began_s, 3),
        bus_seconds=replay.time.seconds,
        problems=[problem for reader in logs for problem in reader.problems],
        health=replay.health,
        messages=replay.messages,
        traffic=replay.traffic,
        logs=held,
        clutch_map=replay.clutch_map,
        errors=errors,
    )


def reorder_window_us(log: LogReader, config: Config) -> int:
    """Return within which time the frames of a log are sorted: our own logs are as the estimator saw the bus."""
    if OWN_MARK in log.metadata:  # of the service: as it received them, and gave its estimates
        return 0
    if config.reorder_us is not None:
        return config.reorder_us
    return 0 if log.documents else REORDER_US


def mapped_messages(config: Config) -> list[MappedMessage]:
    """Return the messages that inputs come from, each on its channel."""
    mapped: dict[str, set[str]] = {}
    for term in (term for entry in config.inputs for term in entry.signals):
        mapped.setdefault(term.message, set()).add(term.signal)
    found = []
    for (name, address), message in read_addresses(config.database, config.inputs, config.addresses).items():
        if name in mapped:
            protection = next(
                (p for p in config.protections if p.message == name and p.channel in (None, address.channel)), None
            )
            needed = bytes_needed(message, mapped[name], protection)
            found.append(MappedMessage(name, address, message.length, needed))
    return found


class _Replay:
    """One pass: the chain, its targets, and what went through."""

    def __init__(
        self, config: Config, targets: ReplayTargets, content: ReplayContent, start: bytes | None
    ) -> None:
        self.traffic = Traffic(mapped_messages(config))
        self.status = StatusShares()
        self.transmission = TransmissionFigures()
        self.time = TrafficTime()
        self.state: str | None = None
        self._config = config
        self._content = content
        self._player = targets.player
        documents = dict(config.documents)
        maps: ClutchMaps | None = None
        self._map_start = "new"
        if config.clutch_map is not None and start is not None:
            maps, why = begun(start, config)
            self._map_start = why or "kept"
            if maps is not None:
                documents[state_name(config)] = start
        self._chain = Chain(config, content.smooth, maps)
        self._signals = MessageColumns(config.database, config.addresses) if content.signals else None
        self._encoder = OutputEncoder(config.output.database, config.output.ids) if targets.player else None
        self._rows: list[NDArray[np.void]] = []
        self._waiting: list[tuple[Frames, int, NDArray[np.void]]] = []  # frames, number of estimates, health
        self._log = None if targets.log is None else _new_log(targets.log, documents, content)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._log is not None:
            self._log.close()

    def begin_with(self, state: bytes) -> None:
        """Go on where the service stood when it began a log, if this is the same estimator."""
        self.state = self._chain.restore(state)
        if not self.state and self._chain.maps is not None:
            self._map_start = "kept"

    @property
    def clutch_map(self) -> dict[str, Any] | None:
        """What was learned of the clutches by now, and what it began from."""
        if self._chain.maps is None:
            return None
        return {"start": self._map_start, "clutches": maps_json(self._chain.maps.now())}

    @property
    def health(self) -> dict[str, Any]:
        """Counters of the estimator."""
        return health_counts(self._chain.health)

    @property
    def messages(self) -> dict[str, dict[str, Any]]:
        """What was wrong with the frames of each message."""
        return message_faults(*self._chain.messages)

    @property
    def never_received(self) -> list[str]:
        """Mapped inputs of which no usable value came."""
        return never_received(self._config.inputs, self._chain.health)

    def take(self, frames: Frames) -> None:
        """Do the whole job for one batch; if estimates are to be smoothed, only up to them."""
        self.time.take(frames.t_us)
        self.traffic.take(frames)
        estimates = self._chain.feed(frames)
        self._write_maps(self._chain.map_rows())
        if not self._content.smooth:
            self._give(frames, estimates)
            return
        needed = self._content.frames or self._content.signals or self._player is not None
        self._waiting.append((frames if needed else Frames.empty(), len(estimates), estimates.health))

    def smooth(self, progress: Callable[[float], None]) -> None:
        """Do the rest for all batches that wait for their estimates to be smoothed."""
        if not self._content.smooth:
            return
        rows = self._chain.smoothed(progress)
        for frames, n, health in self._waiting:
            self._give(frames, Estimates(rows[:n], health))
            rows = rows[n:]

    def finish_maps(self) -> None:
        """Write what was learned by the end."""
        if self._chain.maps is not None:
            self._write_maps(self._chain.maps.now())

    def _give(self, frames: Frames, estimates: Estimates) -> None:
        self.status.count(estimates.rows["t_us"], estimates.rows["status"])
        self.transmission.count(estimates.rows)
        if self._content.truth:
            self._rows.append(estimates.rows)
        if self._log is not None:
            self._write(self._log, frames, estimates)
        if self._player is not None and self._encoder is not None:
            ours = self._encoder.encode(estimates.rows)
            foreign = frames[~np.isin(frames.can_id, list(self._encoder.can_ids.values()))]
            self._player.play(Frames.concatenate([foreign, ours]).sorted_by_time())

    def compare(self, truth: NDArray[np.void]) -> dict[str, ErrorFigures]:
        """Write the truth and return the errors against it."""
        if self._log is not None:
            write_truth(self._log, truth)
        return compare(np.concatenate([np.zeros(0, ESTIMATE), *self._rows]), truth)

    def _write_maps(self, rows: NDArray[np.void]) -> None:
        if self._log is not None and len(rows):
            self._log.write_table(MAPS, rows)

    def _write(self, log: McapLog, frames: Frames, estimates: Estimates) -> None:
        if self._content.frames:
            log.write_frames(frames)
        if self._signals is not None:
            for name, rows in self._signals.decode(frames).items():
                log.write_table(Table.of_signals(name, rows.dtype), rows)
        log.write_table(ESTIMATES, estimates.rows)
        log.write_table(HEALTH, estimates.health)


def _new_log(path: Path, documents: Mapping[str, bytes], content: ReplayContent) -> McapLog:
    words = {"estimates": {"smoothed": "each stands on the whole recording"}} if content.smooth else None
    return McapLog(path, documents=documents, metadata=words)
