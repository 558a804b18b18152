"""What is fuzzed: each room takes one file, does with it what a user would, and knows how it may be refused."""

from __future__ import annotations

import shutil
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import dctorque_can.bus.database as databases
from dctorque_can.bus.database import DatabaseFile, load_with_remarks
from dctorque_can.bus.dbc_prepare import Needed
from dctorque_can.chain import Chain
from dctorque_can.config.load import load_config
from dctorque_can.config.overview import overview
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.recover import recover
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import FrameFlag, Frames

from . import mutators
from .mutators import Mutator

ROOT = Path(__file__).resolve().parents[2]
SEEDS = ROOT / "tests" / "fuzz"


@dataclass(frozen=True)
class Room:
    """Something that reads files.

    Attributes:
        file: name under which it gets to see an input; the suffix says the format.
        seeds: folders of whole files.
        read: reads the file; raises nothing but a DctorqueError, which is an answer too.
        mutator: what knows the structure of a file.
        modules: of other packages that do a part of the work: what they do guides the search too.
    """

    file: str
    seeds: tuple[Path, ...]
    read: Callable[[Path], object]
    mutator: Mutator
    modules: tuple[str, ...] = ()

    def seed_files(self) -> list[Path]:
        suffix = Path(self.file).suffix
        return sorted(path for folder in self.seeds for path in folder.iterdir() if path.suffix == suffix)

    def try_file(self, path: Path) -> bool:
        """Read a file; return whether it was taken (False: refused in words)."""
        try:
            self.read(path)
        except DctorqueError as error:
            if not str(error).strip():
                raise AssertionError("a refusal without a word") from error
            return False
        return True


def read_log(path: Path, most_times: float = 1e4) -> int:
    """Read a log as `replay` does, and return the number of its frames."""
    with open_log(path) as log:
        frames = Frames.concatenate(log.dated_frames())
        assert log.fraction == 1.0
        assert all(line.startswith(str(path)) and "\n" not in line for line in log.problems), log.problems
    count = len(frames)
    assert count <= most_times * path.stat().st_size, "more frames than bytes can hold"
    data = frames.flags & FrameFlag.REMOTE == 0  # the others ask for so many bytes and have none
    assert not data.any() or int(frames.length[data].max()) <= frames.data.shape[1], "a length beyond the data"
    return count


def recover_log(path: Path) -> None:
    """Recover an MCAP: what a reader finds in the damaged file is in the new one, and that is whole."""
    out = path.with_suffix(".out.mcap")
    out.unlink(missing_ok=True)
    recovery = recover(path, out)
    count = read_log(path)
    assert recovery.messages >= count, f"{recovery.messages} messages recovered, {count} frames can be read"
    with open_log(out) as log:
        again = sum(map(len, log.frames()))
        assert again >= count, f"{count} frames before, {again} after"


def load_dbc(path: Path) -> None:
    """Load a DBC as a vehicle file names it, strictly or not, all or what is needed: its content says which."""
    content = path.read_bytes()
    kind = zlib.crc32(content)
    needed = Needed(frozenset({"Engine"}), frozenset({"Engine.Speed"})) if kind & 1 else None
    load_with_remarks([DatabaseFile(path, bool(kind & 2), content)], needed)


def use_vehicle_file(path: Path) -> None:
    """Do what `check` does with a vehicle file, and make what `run` makes of one that is right."""
    config = load_config(path)
    overview(str(path), config.warnings, config)
    Chain(config)


def beside_databases(folder: Path) -> Path:
    """Put the shipped DBCs where vehicle files look for them; return the folder for a vehicle file."""
    shutil.copytree(ROOT / "dbc", folder / "dbc", dirs_exist_ok=True)
    (folder / "config").mkdir(exist_ok=True)
    return folder / "config"


def remember_databases() -> None:
    """Let cantools see each text once in this process, for the rest of its life: nine tenths of the time.

    Whoever lists a DBC twice then gets the same messages twice.
    """
    databases.parse = lru_cache(maxsize=8)(databases.parse)


def _log(name: str, file: str, mutator: Mutator, *modules: str, seeds: str = "") -> Room:
    return Room(file, (SEEDS / (seeds or name),), read_log, mutator, modules)


ROOMS = {
    "asc": _log("asc", "x.asc", mutators.lines, "can.io.asc"),
    "candump": _log("candump", "x.log", mutators.lines, "can.io.canutils"),
    "csv": _log("csv", "x.csv", mutators.lines, "can.io.csv"),
    "trc": _log("trc", "x.trc", mutators.lines, "can.io.trc"),
    "gz": _log("gz", "x.log.gz", mutators.gzipped),
    "blf": _log("blf", "x.blf", mutators.blf, "can.io.blf"),
    "mcap": _log("mcap", "x.mcap", mutators.mcap),
    "mf4": _log("mf4", "x.mf4", mutators.bytes_only, "can.io.mf4"),
    "recover": Room("x.mcap", (SEEDS / "mcap",), recover_log, mutators.mcap),
    "configuration": Room("x.yaml", (SEEDS / "configuration",), use_vehicle_file, mutators.lines),
    "dbc": Room("x.dbc", (SEEDS / "dbc",), load_dbc, mutators.lines, ("cantools.database.can.formats.dbc",)),
}
