"""The maps of the clutches in a file: kept over restarts, never trusted blindly, never half written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dctorque_can import __version__
from dctorque_can.clutch_maps import state
from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.config.identity import vehicle_digest
from dctorque_can.config.load import Config
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.table import Table

STATE_SUFFIX = ".clutch_map.json"
_WORDS = {"format": "format", "version": "version of dctorque_can", "vehicle_file": "vehicle file"}
_LARGEST_BYTES = 10_000_000

MAPS = Table("/dctorque/clutch_map", "dctorque_msgs/msg/ClutchMap", CLUTCH_MAP)


def state_name(config: Config) -> str:
    """Return the name of the file, or of the document of a log, that keeps the maps of a vehicle file."""
    return config.path.stem + STATE_SUFFIX


def identity(config: Config) -> dict[str, Any]:
    """Return what a kept state must agree with: format, version, and all that the vehicle is."""
    return {"format": state.FORMAT, "version": __version__, "vehicle_file": vehicle_digest(config)}


def packed(maps: ClutchMaps, config: Config) -> bytes:
    """Return the maps as bytes, for a file or a document of a log."""
    content = identity(config) | state.kept(maps)
    return json.dumps(content, allow_nan=False).encode()


def renamed(content: bytes, config: Config) -> bytes:
    """Return packed maps as those of a vehicle file that has changed in nothing that they depend on."""
    return json.dumps(json.loads(content) | identity(config), allow_nan=False).encode()


def begun(content: bytes, config: Config) -> tuple[ClutchMaps | None, str]:
    """Return maps that go on from packed ones, and ""; or None, and why they cannot."""
    assert config.clutch_map is not None
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as error:
        return None, f"it is damaged ({error})"
    if not isinstance(found, dict):
        return None, "it is damaged (no mapping)"
    for key, wanted in identity(config).items():
        if found.get(key) != wanted:
            return None, f"it is of another {_WORDS[key]}"
    maps = ClutchMaps(config.clutch_map)
    try:
        state.begin_from(maps, found)
    except state.BadStateError as error:
        return None, f"it is damaged ({error})"
    return maps, ""


class KeptMaps:
    """The file in which a vehicle's maps are kept.

    Args:
        config: with a `state.directory`.
        tell: is told what goes wrong: ``tell(is_error, text)``.
        directory: instead of that of the vehicle file.

    Attributes:
        path: of the file.
    """

    def __init__(self, config: Config, tell: Callable[[bool, str], None], directory: Path | None = None) -> None:
        self._config, self._tell = config, tell
        folder = directory if directory is not None else Path(config.state.directory or ".")
        self.path = folder / state_name(config)
        self._failing = False

    def read(self) -> bytes | None:
        """Return what is kept; None when there is nothing, or nothing to be used: that is told and put aside."""
        try:
            with self.path.open("rb") as file:
                content = file.read(_LARGEST_BYTES + 1)
        except FileNotFoundError:
            return None
        except OSError as error:
            self._tell(True, f"{self.path}: cannot be read: {error.strerror}; the maps begin anew")
            return None
        why = "it is too large" if len(content) > _LARGEST_BYTES else begun(content, self._config)[1]
        if not why:
            return content
        aside = self._free_name()
        try:
            self.path.rename(aside)
        except OSError as error:
            self._tell(True, f"{self.path}: {why}, and cannot be put aside: {error.strerror}; it is overwritten")
        else:
            self._tell(True, f"{self.path}: {why}; put aside as {aside.name}, the maps begin anew")
        return None

    def write(self, content: bytes) -> bool:
        """Replace the file at once or not at all, also in a power cut; return whether it could be written."""
        partial = self.path.with_name(self.path.name + ".part")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with partial.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(self.path)
            _sync_folder(self.path.parent)
        except OSError as error:
            if not self._failing:
                self._tell(True, f"{self.path}: cannot be written: {error.strerror}; the maps are not kept")
            self._failing = True
            return False
        self._failing = False
        return True

    def _free_name(self) -> Path:
        number = 1
        while True:
            path = self.path.with_name(f"{self.path.name}.bad{number}")
            if not os.path.lexists(path):
                return path
            number += 1


def read_state(directory: Path, config: Config) -> bytes:
    """Return what is kept of a vehicle's maps in a folder, which stays as it is.

    Raises:
        DctorqueError: there is no such file.
    """
    path = directory / state_name(config)
    try:
        return path.read_bytes()
    except OSError as error:
        raise DctorqueError(f"{path}: no kept maps: {error.strerror}") from error


def state_of(documents: Mapping[str, bytes]) -> bytes | None:
    """Return the state of maps among the documents of a log, or None."""
    return next((content for name, content in documents.items() if name.endswith(STATE_SUFFIX)), None)


def _sync_folder(folder: Path) -> None:
    """Let the name of a new file survive a power cut, where a folder can be opened."""
    with suppress(PermissionError, IsADirectoryError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
