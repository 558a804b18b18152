"""A log to estimates in a log, stage by stage: by our own parts, and by the stock libraries.

The stock chain reads with python-can (or the mcap package as a stream, frames unpacked by `struct`), decodes with
cantools (without checking any CRC), feeds the same estimator one frame at a time, and writes with the mcap
package.
"""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can
import numpy as np
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Samples


@dataclass
class Stages:
    """Seconds by stage."""

    seconds: dict[str, float] = field(default_factory=dict)
    frames: int = 0
    estimates: int = 0
    _mark: float = 0.0

    def start(self) -> None:
        self._mark = time.perf_counter()

    def took(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._mark
        self._mark = now

    @property
    def total(self) -> float:
        return sum(self.seconds.values())

    def scaled(self, factor: float) -> dict[str, float]:
        return {stage: seconds * factor for stage, seconds in self.seconds.items()} | {
            "total": self.total * factor
        }


def our_chain(path: Path, config: Config, out: Path) -> tuple[Stages, np.ndarray]:
    stages = Stages()
    decoder = Decoder(config.database, config.inputs, config.protections)
    estimator = Estimator(config.settings)
    kept = []
    stages.start()
    with open_log(path) as log, McapLog(out, documents=config.documents) as result:
        for frames in log.frames():
            stages.took("read")
            samples = decoder.decode(frames)
            stages.took("decode")
            estimates = estimator.feed(samples)
            stages.took("estimate")
            result.write_table(ESTIMATES, estimates.rows)
            result.write_table(HEALTH, estimates.health)
            stages.took("write")
            stages.frames += len(frames)
            stages.estimates += len(estimates.rows)
            kept.append(estimates.rows)
        stages.took("read")
    stages.took("write")
    return stages, np.concatenate(kept)


def stock_messages(path: Path) -> Iterator[tuple[int, int, bytes]]:
    """Yield time (µs), identifier and payload with the stock readers."""
    if path.suffix != ".mcap":
        with can.LogReader(path) as reader:
            for message in reader:
                yield round(message.timestamp * 1e6), message.arbitration_id, bytes(message.data)
        return
    head = struct.Struct("<iII")
    body = struct.Struct("<I3xB8s")
    with path.open("rb") as file:
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if not channel.topic.startswith("/can"):
                continue
            data = message.data
            seconds, nanoseconds, size = head.unpack_from(data, 4)
            can_id, length, payload = body.unpack_from(data, 16 + (size + 3) // 4 * 4)
            yield seconds * 1_000_000 + nanoseconds // 1000, can_id, payload[:length]


class StockDecoder:
    """cantools, one message at a time, and the sums and units of the configuration."""

    def __init__(self, config: Config) -> None:
        self._messages = {m.frame_id: m for m in config.database.messages}
        self._inputs: dict[str, list[Any]] = {}
        for given in config.inputs:
            for message in {term.message for term in given.terms}:
                self._inputs.setdefault(message, []).append(given)
        self._not_available: dict[tuple[str, str], set[float]] = {}
        for given in config.inputs:
            for term in given.terms:
                signal = config.database.get_message_by_name(term.message).get_signal_by_name(term.signal)
                conversion = signal.conversion
                self._not_available[term.message, term.signal] = {
                    float(raw * conversion.scale + conversion.offset) for raw in term.not_available
                }

    def decode(self, t_us: int, can_id: int, data: bytes) -> Samples | None:
        message = self._messages.get(can_id)
        if message is None or message.name not in self._inputs:
            return None
        signals = message.decode(data, decode_choices=False)
        quantities, values, statuses = [], [], []
        for given in self._inputs[message.name]:
            value, status = 0.0, 0
            for term in given.terms:
                number = float(signals[term.signal])
                unknown = bool(term.values) and number not in term.values
                if unknown or number in self._not_available[term.message, term.signal]:
                    status = 1
                else:
                    value += term.factor * (term.values[int(number)] if term.values else number) + term.offset
            if status == 0 and not given.minimum <= value <= given.maximum:
                status = 2
            quantities.append(int(given.quantity))
            values.append(0.0 if status else value)
            statuses.append(status)
        n = len(quantities)
        return Samples(
            np.full(n, t_us, np.int64),
            np.array(quantities, np.uint8),
            np.array(values),
            np.array(statuses, np.uint8),
            np.arange(n) == n - 1,
        )


def stock_chain(path: Path, config: Config, out: Path, limit_s: float) -> tuple[Stages, np.ndarray]:
    stages = Stages()
    decoder = StockDecoder(config)
    estimator = Estimator(config.settings)
    kept = []
    with out.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="bench")
        schema = writer.register_schema(ESTIMATES.type_name, "ros2msg", ESTIMATES.schema_text.encode())
        channel = writer.register_channel(ESTIMATES.topic, "cdr", schema)
        stages.start()
        for t_us, can_id, data in stock_messages(path):
            stages.took("read")
            samples = decoder.decode(t_us, can_id, data)
            stages.took("decode")
            stages.frames += 1
            if samples is None:
                continue
            rows = estimator.feed(samples).rows
            stages.took("estimate")
            for row in rows:
                writer.add_message(channel, t_us * 1000, row.tobytes(), t_us * 1000)
            stages.took("write")
            stages.estimates += len(rows)
            kept.append(rows)
            if stages.total > limit_s:
                break
        writer.finish()
        stages.took("write")
    return stages, np.concatenate(kept)


def agreement(ours: np.ndarray, stock: np.ndarray) -> float:
    """Return the largest difference of a clutch torque between both chains, N·m; they must have the same times."""
    n = min(len(ours), len(stock))
    shift = int(ours["t_us"][0] - stock["t_us"][0])
    if not np.array_equal(ours["t_us"][:n] - shift, stock["t_us"][:n]):
        sys.exit("tools/bench: the two chains do not give estimates at the same times")
    return max(
        float(np.abs(ours[name][:n] - stock[name][:n]).max())
        for name in ("clutch1_torque_nm", "clutch2_torque_nm")
    )
