"""Each log alone: does it replay to its own estimates, and was sent what they say?"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.output import OutputEncoder
from dctorque_can.bus.output_signals import CONTENTS, estimate_words, physical_values
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import STATE_NAME
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.estimates import ESTIMATE, ONLY_OH2014
from dctorque_can.pipeline.frames import Frames

from .account import received_and_sent

FLOATS = [name for name in ESTIMATE.names or () if ESTIMATE[name].kind == "f" and name not in ONLY_OH2014]


@dataclass
class LogResult:
    """What one log is worth.

    Attributes:
        path: of it.
        problems: why it cannot be read or used whole.
        estimates: in it.
        different: of these, not those of its replay.
        absent: estimates of its replay that are not in it, behind all others.
        not_finite: numbers that are none.
        sent: frames that were sent, …
        unlike: … of these, with other content than the estimate of their time.
        where: of each received frame, among those that passed on the bus.
    """

    path: Path
    problems: list[str] = field(default_factory=list)
    estimates: int = 0
    different: int = 0
    absent: int = 0
    not_finite: int = 0
    sent: int = 0
    unlike: int = 0


class Replayer:
    """Replays logs of one configuration; its encoders are made once."""

    def __init__(self, config: Config) -> None:
        self._config = config
        database = config.output.database
        ids = OutputEncoder(database, config.output.ids).can_ids
        self._encoders = [
            (ids[name], MessageEncoder(message), list(CONTENTS).index(name), _content_mask(message))
            for name in ids
            for message in [database.get_message_by_name(name)]
        ]

    def replay(self, path: Path) -> tuple[LogResult, Frames, Frames]:
        """Return what a log is worth, and the frames in it: received and sent."""
        result = LogResult(path)
        with open_log(path) as log:
            parts = list(log.frames())
            result.problems += log.problems
            chain = Chain(self._config)
            if STATE_NAME in log.documents and (why := chain.restore(log.documents[STATE_NAME])):
                result.problems.append(f"the state cannot be used: {why}")
        fed = [chain.feed(part) for part in parts]
        logged = _rows(path, ESTIMATES)
        again = np.concatenate([ESTIMATE_NONE, *(estimates.rows for estimates in fed)])
        health = _rows(path, HEALTH)
        health_again = np.concatenate([health[:0], *(estimates.health for estimates in fed)])
        result.estimates = len(logged)
        result.different = _different(logged, again) + _different(health, health_again)
        result.absent = max(len(again) - len(logged), 0)
        result.not_finite = sum(int((~np.isfinite(logged[name])).sum()) for name in FLOATS)
        received, sent = received_and_sent(Frames.concatenate(parts))
        result.sent = len(sent)
        result.unlike = self._unlike(sent, again)
        return result, received, sent

    def _unlike(self, sent: Frames, rows: NDArray[np.void]) -> int:
        """Count frames sent whose content is not that of an estimate of the same time."""
        order = np.argsort(rows["t_us"], kind="stable")
        times = rows["t_us"][order]
        unlike = 0
        for can_id, encoder, number, mask in self._encoders:
            own = sent[sent.can_id == can_id]
            first, last = np.searchsorted(times, own.t_us, "left"), np.searchsorted(times, own.t_us, "right")
            left = np.arange(len(own))
            for n in range(int((last - first).max(initial=0))):
                left = left[first[left] + n < last[left]]
                chosen = order[first[left] + n]
                values = physical_values(number, estimate_words(rows), chosen)
                expected = encoder.encode_values(values, encoder.places(CONTENTS_OF[number]))
                same = ((own.data[left, : expected.shape[1]] ^ expected) & mask == 0).all(1)
                done = np.zeros(len(own), np.bool_)
                done[left[same]] = True
                own, first, last = own[~done], first[~done], last[~done]
                left = np.arange(len(own))
            unlike += len(own)
        return unlike


CONTENTS_OF = list(CONTENTS.values())
ESTIMATE_NONE = np.zeros(0, ESTIMATE)


def _content_mask(message) -> NDArray[np.uint8]:  # type: ignore[no-untyped-def]  # cantools has no types
    """Return the bits of a payload that are neither counter nor checksum."""
    no_content = {
        signal.name: (1 << signal.length) - 1 if signal.name not in CONTENTS[message.name] else 0
        for signal in message.signals
    }
    return ~np.frombuffer(message.encode(no_content, scaling=False, strict=False), np.uint8)


def _rows(path: Path, table: Table) -> NDArray[np.void]:
    try:
        return read_table(path, table)
    except LogReadError:  # a log that ended at once
        return np.zeros(0, table.dtype)


def _different(logged: NDArray[np.void], again: NDArray[np.void]) -> int:
    """Count rows that differ, and those that are more than there should be."""
    both = min(len(logged), len(again))
    size = logged.dtype.itemsize
    left, right = (
        np.ascontiguousarray(rows[:both]).view(np.uint8).reshape(both, size) for rows in (logged, again)
    )
    return int((left != right).any(1).sum()) + max(len(logged) - len(again), 0)
