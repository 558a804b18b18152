"""The maps of the clutches learned from recordings, beginning anew or from what a vehicle's service keeps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.map_errors import MapErrors, map_errors
from dctorque_can.analysis.traffic import Traffic
from dctorque_can.bus.decoder import Decoder
from dctorque_can.chain import NO_MAP_ROWS, Chain
from dctorque_can.clutch_maps.summary import maps_json
from dctorque_can.config.load import Config
from dctorque_can.daemon.kept_maps import KeptMaps, begun, packed
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.reader import LogReader
from dctorque_can.logs.reorder import Reorder
from dctorque_can.offline.replay import mapped_messages, reorder_window_us
from dctorque_can.offline.truth_log import truth_of
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus


@dataclass(frozen=True)
class LearnedMaps:
    """What recordings taught.

    Attributes:
        start: "new" or "kept".
        frames: read.
        rows: `CLUTCH_MAP` ``[n]``, a row per clutch and period, those of the end last.
        clutches: number of these last ones.
        problems: what could not be read, one line each.
        errors: of each clutch against the truth, when that was asked for.
        state: where the maps are kept now, or None.
    """

    start: str
    frames: int
    rows: NDArray[np.void]
    clutches: int
    problems: list[str]
    errors: dict[int, MapErrors | None]
    state: Path | None

    @property
    def last(self) -> NDArray[np.void]:
        """`CLUTCH_MAP` of the end, a row per clutch."""
        return self.rows[len(self.rows) - self.clutches :]

    def as_json(self) -> dict[str, Any]:
        """Return the result for scripts."""
        return {
            "start": self.start,
            "frames": self.frames,
            "state": None if self.state is None else str(self.state),
            "problems": self.problems,
            "errors": {str(n): None if e is None else e.as_json() for n, e in self.errors.items()},
            "clutches": maps_json(self.last),
        }


def learn_maps(
    logs: Sequence[LogReader],
    config: Config,
    progress: Callable[[float], None],
    tell: Callable[[bool, str], None],
    directory: Path | None = None,
    truth: bool = False,
) -> LearnedMaps:
    """Learn from logs, one after another as one sequence.

    Args:
        logs: recordings of one car.
        config: its vehicle file; the maps are learned whether it asks for them or not.
        progress: is told the finished fraction, 0..1.
        tell: is told what is wrong with a kept state: ``tell(is_error, text)``.
        directory: from where a kept state is taken and where it is written again; None: nowhere.
        truth: compare with the truth of simulated logs.

    Raises:
        DctorqueError: there is no truth, the logs hold nothing that teaches, or the state cannot be written.
    """
    if config.clutch_map is None:
        raise DctorqueError(f"{config.path}: no maps are learned: set clutch_map.enabled: true")
    kept = None if directory is None else KeptMaps(config, tell, directory)
    content = None if kept is None else kept.read()
    chain = Chain(config, maps=None if content is None else begun(content, config)[0])
    truths = [truth_of(reader.path) for reader in logs] if truth else []
    actuations = _Actuations(config) if truth else None
    traffic = Traffic(mapped_messages(config))
    found: list[NDArray[np.void]] = [NO_MAP_ROWS]
    for number, reader in enumerate(logs):
        for frames in Reorder(reorder_window_us(reader, config)).sorted(reader.dated_frames()):
            traffic.take(frames)
            chain.feed(frames)
            found.append(chain.map_rows())
            if actuations is not None:
                actuations.take(frames)
            progress((number + reader.fraction) / len(logs))
    assert chain.maps is not None
    last = chain.maps.now()
    if not len(last):
        raise DctorqueError(
            "no estimate: nothing in the logs is what the vehicle file reads (see `dctorque check`)"
        )
    rows = np.concatenate([*found, last])
    if kept is not None and not kept.write(packed(chain.maps, config)):
        raise DctorqueError(f"{kept.path}: cannot be written; what was learned is not kept")
    all_truth = np.concatenate(truths) if truths else None
    return LearnedMaps(
        start="new" if content is None else "kept",
        frames=traffic.frames,
        rows=rows,
        clutches=len(last),
        problems=[problem for reader in logs for problem in reader.problems],
        errors={}
        if all_truth is None or actuations is None
        else {
            n: map_errors(rows, all_truth, n, actuations.at(n, all_truth["t_us"]))
            for n in sorted(set(last["clutch"].tolist()))
        },
        state=None if kept is None else kept.path,
    )


class _Actuations:
    """What the bus tells of what closes the clutches, to be had at any time.

    Args:
        config: of the car.
    """

    def __init__(self, config: Config) -> None:
        self._inputs = {}
        for clutch in (1, 2):
            command = config.settings.phases.clutches[clutch - 1].source is PhaseSource.COMMAND
            first = Quantity.CLUTCH1_COMMAND if command else Quantity.CLUTCH1_POSITION
            for given in config.inputs:
                if given.quantity == first + clutch - 1:
                    self._inputs[clutch] = given
        self._decoder = Decoder(config.database, config.inputs, config.protections, config.addresses)
        self._samples: list[Samples] = []

    def take(self, frames: Frames) -> None:
        """Keep the samples of frames."""
        samples = self._decoder.decode(frames)
        wanted = [given.quantity for given in self._inputs.values()]
        self._samples.append(samples[(samples.status == SampleStatus.OK) & np.isin(samples.quantity, wanted)])

    def at(self, clutch: int, t_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the actuation at times ``[n]``, by straight lines between samples; NaN where it is not told."""
        given = self._inputs.get(clutch)
        mine = [each[each.quantity == given.quantity] for each in self._samples] if given is not None else []
        if given is None or not sum(map(len, mine)):
            return np.full(len(t_us), np.nan)
        taken_us = np.concatenate([each.t_us for each in mine]) - given.delay_us
        values = np.concatenate([each.value for each in mine])
        return np.asarray(np.interp(t_us, taken_us, values, left=np.nan, right=np.nan), np.float64)
