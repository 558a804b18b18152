"""Simulated drives on disk: an estimator that is tuned again and again need not wait for the same cars."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import Frames

Signals = tuple[Frames, NDArray[np.void]]


def kept(folder: Path | None, key: str, make: Callable[[], Signals]) -> Signals:
    """Return frames and truth of a drive: those that are kept under ``key``, or new ones, which then are kept.

    A file that cannot be read is made anew.

    Args:
        folder: is made when missing; None keeps nothing.
        key: says what the drive depends on; it can be a file name.
        make: returns frames, and the truth ``[n]`` as a structured array.

    Raises:
        DctorqueError: the folder cannot be written; or as ``make``.
    """
    if folder is None:
        return make()
    path = folder / f"{key}.npz"
    try:
        with path.open("rb") as file, np.load(file) as columns:
            frames = Frames(**{name: columns[name] for name in Frames.__dataclass_fields__})
            return frames, columns["truth"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        pass
    frames, truth = make()
    columns = {name: getattr(frames, name) for name in Frames.__dataclass_fields__}
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as new:
            np.savez(new, truth=truth, **columns)
        part.rename(path)  # so that nobody ever reads half a drive
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise DctorqueError(f"{path}: cannot be written: {error.strerror}") from error
    return frames, truth
