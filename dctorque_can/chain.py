"""Frames in, estimates out: the one chain for a live bus, a log and a simulation."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can import __version__
from dctorque_can.bus.decoder import Decoder
from dctorque_can.clutch_maps.commands import Commands
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.clutch_maps.state import BadStateError, go_on_from, moment
from dctorque_can.clutch_maps.windows import LAYOUTS
from dctorque_can.config.identity import database_digest, vehicle_digest
from dctorque_can.config.load import Config
from dctorque_can.pipeline import delays
from dctorque_can.pipeline.estimates import Estimates
from dctorque_can.pipeline.estimator import FEW, Estimator, Moment, warm_up
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Input, Samples
from dctorque_can.pipeline.settings import Settings
from dctorque_can.pipeline.smoothing import Smoother
from dctorque_can.snapshot import BadSnapshotError, Snapshot, layout_of, packed, unpacked

_COMMAND_LAG_S = 1e-3  # of the torque behind a position: none that counts
NO_MAP_ROWS = np.zeros(0, CLUTCH_MAP)


class Chain:
    """Decoder and estimator of one configuration; the same frames give the same bits, however they are cut.

    Args:
        config: the configuration.
        smooth: remember everything, for `smoothed`.
        maps: of the clutches, as they were kept; None: they begin anew, if the configuration asks for maps.

    Attributes:
        maps: of the clutches; None when they are not learned.
        commands: what kept maps say of the torques; None when that is not used. The maps then learn from estimates
            of their own that know nothing of it, so that no map confirms itself.

    Raises:
        DctorqueError: the configured method cannot be smoothed.
    """

    def __init__(self, config: Config, smooth: bool = False, maps: ClutchMaps | None = None) -> None:
        self._config = config
        self.maps: ClutchMaps | None = None
        self.commands: Commands | None = None
        self._teacher: Estimator | None = None
        settings = config.settings
        if config.clutch_map is not None:
            self.maps = maps or ClutchMaps(config.clutch_map)
            self.commands = Commands.of(self.maps) if config.clutch_map.used else None
        if self.commands is not None:
            self._teacher = Estimator(settings)
            settings = _commanded(settings, self.commands)
        self._decoder = Decoder(config.database, config.inputs, config.protections, config.addresses)
        self._smoother = Smoother(settings) if smooth else None
        self._estimator = self._smoother or Estimator(settings)
        self._feed_few: Callable[[Frames], Estimates] | None = None
        if isinstance(self._estimator, Estimator) and self.commands is None:
            learn = None if config.clutch_map is None else self._learn
            self._feed_few = _through_inbox(self._decoder, self._estimator, learn)
        self._map_rows: list[NDArray[np.void]] = []
        self._few = FEW // max(self._decoder.most_per_frame, 1)  # frames, for whose samples there is always room

    def warm_up(self) -> None:
        """Compile everything, or load it where it is compiled already."""
        warm_up(self._config.settings)
        for width in (8, 64):
            self._decoder.decode(Frames.empty(0, width))

    def feed(self, frames: Frames) -> Estimates:
        """Return the estimates that became due with ``frames``."""
        if self._feed_few is not None and len(frames) <= self._few:
            return self._feed_few(frames)
        samples = self._decoder.decode(frames)
        if self.commands is None or self._teacher is None:
            return self._learn(samples, self._estimator.feed(samples))
        self._learn(samples, self._teacher.feed(samples))
        return self._estimator.feed(self.commands.added_to(samples))

    def _learn(self, samples: Samples, estimates: Estimates) -> Estimates:
        """Let the maps learn from what frames gave, and return the estimates as they are."""
        if self.maps is not None:
            rows = self.maps.take(samples, estimates.rows)
            if len(rows):
                self._map_rows.append(rows)
        return estimates

    def state(self) -> Snapshot:
        """Return a copy of all that `feed` changes; what a chain was made to smooth remembers is no part of it."""
        arrays: dict[str, NDArray[Any]] = {
            "messages": self._decoder.messages.copy(),
            "terms": self._decoder.terms.copy(),
            "changes": self._decoder.changes.copy(),
        }
        values: dict[str, Any] = {}
        for name, estimator in self._fed().items():
            now = estimator.snapshot()
            arrays |= {f"{name} memory": now.memory, f"{name} waiting": now.waiting, f"{name} stale": now.stale}
            values[name] = [self._layouts[name], now.frame_us, now.frame]
        if self.maps is not None:
            waiting, values["maps"] = moment(self.maps)
            arrays |= {f"maps {name}": array for name, array in waiting.items()}
        return Snapshot(arrays, values)

    def rename(self, config: Config) -> None:
        """Take a vehicle file that changed in nothing that `feed` depends on: states are of it from now on."""
        self._config = config
        self.__dict__.pop("_identity", None)

    def packed(self, state: Snapshot) -> bytes:
        """Return a `state` as bytes, for `restore`."""
        return packed(state, self._identity)

    def restore(self, content: bytes) -> str:
        """Go on from where the chain stood whose `packed` state it was: the same frames then give the same bits.

        For a chain that has not been fed, but for one that smooths. Nothing in ``content`` is believed unseen.

        Returns:
            "", or why it cannot be used, as a subordinate clause; the chain is as it was then.
        """
        if self._smoother is not None:
            return "smoothing begins anew"
        dtypes: dict[str, np.dtype[Any]] = {
            "messages": self._decoder.messages.dtype,
            "terms": self._decoder.terms.dtype,
            "changes": self._decoder.changes.dtype,
        }
        for name in self._fed():
            dtypes |= {f"{name} memory": np.dtype(np.int64), f"{name} waiting": delays.SAMPLES}
            dtypes[f"{name} stale"] = np.dtype(np.uint8)
        if self.maps is not None:
            dtypes |= {f"maps {name}": dtype for name, dtype in LAYOUTS.items()}
        try:
            self._take_over(unpacked(content, self._identity, dtypes))
        except BadSnapshotError as error:
            return str(error)
        return ""

    def _take_over(self, state: Snapshot) -> None:
        """Take over a state if all of it is good.

        Raises:
            BadSnapshotError: it is not, and nothing has changed.
        """
        arrays = state.arrays
        own = {
            "messages": self._decoder.messages,
            "terms": self._decoder.terms,
            "changes": self._decoder.changes,
        }
        for name, rows in own.items():
            if len(arrays[name]) != len(rows):
                raise BadSnapshotError(f"its {name} are others")
        found: list[tuple[Estimator, Moment]] = []
        for name, estimator in self._fed().items():
            moment_of = _moment(self._layouts[name], name, state)
            wrong = estimator.problem(moment_of)
            if wrong:
                raise BadSnapshotError(f"its numbers are wrong: {wrong}")
            found.append((estimator, moment_of))
        maps = self._maps_of(state)
        for name, rows in own.items():
            rows[:] = arrays[name]
        for estimator, moment_of in found:
            estimator.restore(moment_of)
        if maps is not None:
            self.maps = maps

    def _maps_of(self, state: Snapshot) -> ClutchMaps | None:
        """Return new maps that go on from a state; None where none are learned."""
        if self.maps is None or self._config.clutch_map is None:
            return None
        maps = ClutchMaps(self._config.clutch_map)
        waiting = {name: state.arrays[f"maps {name}"] for name in LAYOUTS}
        try:
            go_on_from(maps, waiting, state.values["maps"])
        except (KeyError, BadStateError) as error:
            raise BadSnapshotError(f"its maps are wrong: {error}") from error
        return maps

    def _fed(self) -> dict[str, Estimator]:
        """Return the estimators by name."""
        assert isinstance(self._estimator, Estimator)
        named = {"estimator": self._estimator}
        return named if self._teacher is None else {**named, "teacher": self._teacher}

    @cached_property
    def _layouts(self) -> dict[str, str]:
        """What the memory of each estimator is made of, in a word."""
        return {name: layout_of(*estimator.dtypes) for name, estimator in self._fed().items()}

    @cached_property
    def _identity(self) -> dict[str, str]:
        """What a state must agree with."""
        commands = self.commands
        return {
            "version of dctorque_can": __version__,
            "vehicle file": vehicle_digest(self._config),
            "database": database_digest(self._config),
            "kept clutch map": "" if commands is None else hashlib.sha256(commands.content()).hexdigest(),
        }

    def told_us(self) -> list[int | None]:
        """Return when each term of an input was told last, in order of inputs and their signals; None: never."""
        terms = self._decoder.terms
        return [
            t_us if known else None
            for t_us, known in zip(terms["t_us"].tolist(), terms["known"].tolist(), strict=True)
        ]

    def map_rows(self) -> NDArray[np.void]:
        """Return the `CLUTCH_MAP` rows that became due since the last call ``[n]``."""
        if not self._map_rows:
            return NO_MAP_ROWS
        rows = np.concatenate(self._map_rows)
        self._map_rows.clear()
        return rows

    def smoothed(self, progress: Callable[[float], None] = lambda fraction: None) -> NDArray[np.void]:
        """Return all estimates that `feed` gave once more, smoothed: `ESTIMATE` ``[n]``."""
        if self._smoother is None:
            raise ValueError("only a chain that was made to smooth can do so")
        return self._smoother.smoothed(progress)

    @property
    def messages(self) -> tuple[list[str], NDArray[np.void]]:
        """The mapped messages: what people call them, and their `MESSAGE_STATE` rows, which `feed` changes."""
        return self._decoder.names, self._decoder.messages

    @property
    def health(self) -> NDArray[np.void]:
        """`HEALTH` ``[1]`` as of the last frame."""
        return self._estimator.health


def _moment(layout: str, name: str, state: Snapshot) -> Moment:
    """Return what a state says of one of the estimators, whose memory has a ``layout``."""
    arrays, values = state.arrays, state.values.get(name)
    if not isinstance(values, list) or len(values) != 3 or not all(isinstance(value, int) for value in values[1:]):
        raise BadSnapshotError(f"its {name} is none")
    found, frame_us, frame = values
    if found != layout:
        raise BadSnapshotError(f"its {name} is another one")
    return Moment(arrays[f"{name} memory"], arrays[f"{name} waiting"], arrays[f"{name} stale"], frame_us, frame)


def _commanded(settings: Settings, commands: Commands) -> Settings:
    """Return the settings of an estimator that takes the torques of kept maps as commands."""
    inputs = tuple(
        Input(
            quantity=command.quantity,
            terms=(),
            minimum=0.0,
            maximum=math.inf,
            timeout_us=command.actuation.timeout_us,
            delay_us=command.actuation.delay_us,
        )
        for command in commands.clutches
    )
    kalman = replace(
        settings.kalman,
        command_error_share=commands.error_share,
        command_error_nm=commands.error_nm,
        command_lag_s=_COMMAND_LAG_S,
    )
    return replace(settings, inputs=(*settings.inputs, *inputs), kalman=kalman)


def _through_inbox(
    decoder: Decoder, estimator: Estimator, learn: Callable[[Samples, Estimates], Estimates] | None
) -> Callable[[Frames], Estimates]:
    """Return what feeds a few frames, as they come live: the decoder writes where the estimator reads."""
    inbox = estimator.inbox
    decode, feed = decoder.into(inbox), estimator.feed_inbox
    if learn is None:
        return lambda frames: feed(decode(frames))

    def through(frames: Frames) -> Estimates:
        n = decode(frames)
        return learn(inbox[:n], feed(n))

    return through
