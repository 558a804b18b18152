"""The maps of the clutches in the service: begun from what is kept, kept again, logged and sent."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.bus.map_output import MapEncoder
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.clutch_maps.summary import maps_json
from dctorque_can.config.load import Config
from dctorque_can.daemon.background import finished, in_background
from dctorque_can.daemon.kept_maps import KeptMaps, begun, packed, renamed, state_name
from dctorque_can.resources import shipped_dbc

_LAST_WRITE_S = 5.0


class MapKeeper:
    """What the service does with the maps of its chain; nothing where none are learned.

    A file is written in a thread of its own: waiting for a disk would hold up the receive loop.

    Args:
        config: of the service.
        tell: is told what is wrong with the kept state: ``tell(is_error, text)``.

    Attributes:
        maps: of the clutches, for the chain, as they were kept or new; None where none are learned.
        documents: the state that the maps began from, by its name among the documents of a log.
    """

    def __init__(self, config: Config, tell: Callable[[bool, str], None]) -> None:
        self._config = config
        self._kept: KeptMaps | None = None
        self._writing: Future[bool] | None = None
        self._due_s: float | None = None
        self._start = "new"
        self.documents: dict[str, bytes] = {}
        self.maps = None if config.clutch_map is None else ClutchMaps(config.clutch_map)
        if self.maps is None or config.state.directory is None:
            return
        self._kept = KeptMaps(config, tell)
        content = self._kept.read()
        if content is not None:
            self.maps, _ = begun(content, config)
            self._start = "kept"
            self.documents[state_name(config)] = content

    def rename(self, config: Config) -> None:
        """Keep the maps as those of a vehicle file that has changed in nothing that they depend on, and soon."""
        self._config = config
        self.documents = {name: renamed(content, config) for name, content in self.documents.items()}
        self._due_s = 0.0

    def encoder(self) -> MapEncoder | None:
        """Return what makes the frames of the maps; None when there are none to send."""
        if self.maps is None or not self._config.output.enabled:
            return None
        database = load_database([DatabaseFile(shipped_dbc("dctorque_map"))])
        return MapEncoder(database, self._config.map_ids)

    def keep_time(self, now_s: float) -> None:
        """Write the maps when it is time; to be called after every receive."""
        if self._kept is None or self.maps is None:
            return
        if self._due_s is None:
            self._due_s = now_s + self._config.state.save_s
        if now_s < self._due_s or (self._writing is not None and not self._writing.done()):
            return
        self._due_s = now_s + self._config.state.save_s
        kept, content = self._kept, packed(self.maps, self._config)
        self._writing = in_background(lambda: kept.write(content), "keep maps")

    def last_rows(self) -> NDArray[np.void]:
        """Return the `CLUTCH_MAP` rows of the end ``[n]``."""
        assert self.maps is not None
        return self.maps.now()

    def close(self) -> None:
        """Write the maps for the last time."""
        if self._kept is None or self.maps is None:
            return
        if self._writing is None or finished(self._writing, _LAST_WRITE_S):
            kept, content = self._kept, packed(self.maps, self._config)
            finished(in_background(lambda: kept.write(content), "keep maps"), _LAST_WRITE_S)

    def as_json(self) -> dict[str, Any] | None:
        """Return what was learned by now, and what it began from; None where nothing is."""
        if self.maps is None:
            return None
        return {"start": self._start, "clutches": maps_json(self.maps.now())}
