"""Files that a command writes: never over something by accident, never half done without a word."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dctorque_can.errors import DctorqueError


def refuse_existing(output: Path, inputs: Sequence[Path], force: bool) -> None:
    """Check that ``output`` may be written.

    Raises:
        DctorqueError: it is an input too, or it exists and ``force`` is false, or its directory does not exist.
    """
    if any(path.exists() and output.exists() and path.samefile(output) for path in inputs):
        raise DctorqueError(f"{output}: is an input too; give the output another name")
    if output.is_dir():
        raise DctorqueError(f"{output}: is a directory; give the name of a file")
    if output.exists() and not force:
        raise DctorqueError(f"{output}: exists already; give another name, or --force to overwrite it")
    if not output.parent.is_dir():
        raise DctorqueError(f"{output.parent}: there is no such directory")


def remove_partial(output: Path) -> None:
    """Remove what a failure left of a file, unless it is a device."""
    if output.is_file():
        output.unlink()
