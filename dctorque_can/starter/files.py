"""DBCs and logs from their files, and the vehicle file to its own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from dctorque_can.errors import DctorqueError
from dctorque_can.logs.output_file import refuse_existing
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames
from dctorque_can.starter.databases import read_dbc
from dctorque_can.starter.propose import propose
from dctorque_can.starter.recording import joined
from dctorque_can.starter.starter import Starter


def propose_from_files(
    dbcs: Sequence[Path], logs: Sequence[Path], progress: Callable[[float], None]
) -> tuple[Starter, list[str]]:
    """Return proposals for a vehicle file, and what of the logs cannot be read.

    Args:
        dbcs: DBC files.
        logs: recordings, of any format that `logs.reader` reads; none at all is allowed.
        progress: takes the share of the logs that is read.

    Raises:
        DctorqueError: a file cannot be read at all.
    """
    databases = [read_dbc(path) for path in dbcs]
    parts: list[Frames] = []
    problems: list[str] = []
    for n, path in enumerate(logs):
        with open_log(path) as reader:
            batches = []
            for frames in reader.dated_frames():
                batches.append(frames)
                progress((n + reader.fraction) / len(logs))
            parts.append(Frames.concatenate(batches))
            problems += reader.problems
    return propose(databases, joined(parts) if logs else None), problems


def write_new(path: Path, text: str, inputs: Sequence[Path], *, force: bool) -> None:
    """Write a vehicle file: whole or not at all, and never over another one unless told.

    Raises:
        DctorqueError: the file exists and ``force`` is false, is an input, or cannot be written.
    """
    refuse_existing(path, inputs, force)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        temporary = Path(name)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            temporary.chmod(0o666 & ~_umask())
            if force:
                temporary.replace(path)
            else:
                os.link(temporary, path)  # fails where another process was quicker
        finally:
            temporary.unlink(missing_ok=True)
    except FileExistsError:
        raise DctorqueError(f"{path}: exists already; give another name, or --force to overwrite it") from None
    except OSError as error:
        raise DctorqueError(f"{path}: cannot be written: {error.strerror}") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
