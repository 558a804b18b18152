"""The process in which atheris runs: one room, until a count or a time is reached or the process dies.

An exception is noted with the input that raised it, once for each place, and the search goes on. A crash, a hang
and memory beyond the limit end the process: `tools/fuzz` notes these and starts another one.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import sys
import time
import traceback
import types
import warnings
from pathlib import Path

import atheris

from dctorque_can.compiled import CompiledFunction

from .rooms import ROOMS, Room, beside_databases, remember_databases

PACKAGE = "dctorque_can."
NOT_INSTRUMENTED = ("dctorque_can.compiled", "dctorque_can.compiling.")
MIB = 1 << 20
ENDLESS = 12  # times the processor time that a file may take: then it is ended by the clock on the wall


class Trial:
    """Gives a room one input after the other and keeps count in a file.

    Args:
        room: what reads them.
        options: as `tools/fuzz` gives them.
    """

    def __init__(self, room: Room, options: argparse.Namespace) -> None:
        folder = Path(options.work)
        self._room = room
        if room.file.endswith(".yaml"):
            folder = beside_databases(folder)
            remember_databases()
        self._path = folder / room.file
        self._options = options
        begun = [*room.seed_files(), *Path(options.corpus).iterdir()]
        self._known = {path.read_bytes() for path in begun}  # read again, but not counted again
        self._found: dict[str, str] = {}
        self._until = 0.0
        self._told = 0.0
        self._rss = 0
        self.count = self.taken = 0
        self.slowest_s, self.slowest = 0.0, ""

    def warm_up(self) -> None:
        """Read every seed, so that all that is used is imported and compiled."""
        for seed in self._room.seed_files():
            self._path.write_bytes(seed.read_bytes())
            self._room.try_file(self._path)

    def begin(self) -> None:
        """Let the time run."""
        self._until = time.monotonic() + self._options.seconds

    def one(self, data: bytes) -> None:
        self._path.write_bytes(data)
        new = data not in self._known
        began = time.process_time()  # of a busy machine's time we may get a small share
        try:
            self.taken += self._room.try_file(self._path) and new
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            self._note(error, data)
        lasted = time.process_time() - began
        if lasted > self._options.hang:
            self._note(TimeoutError(f"{lasted:.1f} s of processor time"), data)
        self.count += new
        if lasted > self.slowest_s:
            self.slowest_s = lasted
            Path(self._options.found, "slowest").write_bytes(data)
        rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        if rss > self._rss:
            if rss > self._rss + 50:
                Path(self._options.found, "largest").write_bytes(data)
            self._rss = rss
        now = time.monotonic()
        over = self.count >= self._options.count or now >= self._until
        if over or now - self._told > 0.5:
            self._told = now
            self._tell()
        if over:
            sys.stdout.flush()
            os._exit(0)  # atheris has no other way to end

    def _note(self, error: Exception, data: bytes) -> None:
        """Keep the first input for each place that raises."""
        frames = traceback.extract_tb(error.__traceback__)
        inner = [f for f in frames if "fuzzing" not in f.filename][-1:] or frames[-1:]
        where = f"{Path(inner[0].filename).name}:{inner[0].lineno}" if inner else "?"
        kind = f"{type(error).__name__} {where}"
        if kind in self._found:
            return
        name = "exception-" + "".join(c if c.isalnum() else "_" for c in kind)
        self._found[kind] = name
        folder = Path(self._options.found)
        (folder / name).write_bytes(data)
        trace = "".join(traceback.format_exception(error))
        (folder / f"{name}.txt").write_text(trace)
        print(f"FOUND {kind}: {error}"[:300], flush=True)

    def _tell(self) -> None:
        stats = {
            "count": self.count,
            "taken": self.taken,
            "slowest_s": self.slowest_s,
            "rss_mb": self._rss,
            "found": self._found,
        }
        part = Path(self._options.stats + ".part")
        part.write_text(json.dumps(stats))
        part.replace(self._options.stats)


def instrument(modules: tuple[str, ...]) -> int:
    """Let the functions of the package, and of some modules, tell atheris which way they go; return how many do.

    Not at their import, as atheris proposes: numba compiles what is written, not what atheris makes of it. So
    what is compiled stays as it is, and everything around it is instrumented in place. With
    NUMBA_DISABLE_JIT=1 the loops are instrumented too; the next run without it reads what that one kept,
    compiled and checked. Of MCAP (20 s each, a busy machine) 4261 files were read compiled and 2552 not, at
    403 and 472 places. Compiled is the rule: what an unchecked index would damage is compiled code, and
    numpy's scalars wrap round where the compiled ones do not.
    """
    count = 0
    for name, module in list(sys.modules.items()):
        ours = name.startswith(PACKAGE) and not name.startswith(NOT_INSTRUMENTED)
        if not ours and name not in modules:
            continue
        for value in list(vars(module).values()):
            for function in _functions(value, name):
                try:
                    function.__code__ = atheris.patch_code(function.__code__, True, True)
                    count += 1
                except (RuntimeError, ValueError, KeyError, AssertionError) as error:
                    print(f"not instrumented: {name}.{function.__qualname__}: {error!r}", flush=True)
    return count


def _functions(value: object, module: str) -> list[types.FunctionType]:
    if getattr(value, "__module__", None) != module:
        return []
    if isinstance(value, CompiledFunction):
        if os.environ.get("NUMBA_DISABLE_JIT") == "1":
            return [value._function]
        return []
    if isinstance(value, types.FunctionType):
        return [value]
    if isinstance(value, type):
        found = []
        for each in vars(value).values():
            inner = each.fget if isinstance(each, property) else getattr(each, "__func__", each)
            if isinstance(inner, types.FunctionType) and inner.__module__ == module:
                found.append(inner)
        return found
    return []


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("room")
    for name in ("work", "corpus", "found", "stats"):
        parser.add_argument(f"--{name}", required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hang", type=int, default=5)
    parser.add_argument("--memory", type=int, default=1024)
    options = parser.parse_args()
    room = ROOMS[options.room]
    trial = Trial(room, options)
    trial.warm_up()
    warnings.simplefilter("error")
    functions = instrument(room.modules)
    print(f"{functions} functions instrumented", flush=True)
    resource.setrlimit(resource.RLIMIT_DATA, (3 * options.memory * MIB, resource.RLIM_INFINITY))

    whole = [path.read_bytes() for path in room.seed_files()]

    def mutate(data: bytes, largest: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < 0.3:  # what is kept for its new ways is mostly broken, and its children even more
            data = rng.choice(whole)
        return room.mutator(data, atheris.Mutate, rng, largest)

    largest = max(4096, 2 * max(path.stat().st_size for path in room.seed_files()))
    seeds = Path(options.corpus)
    for path in room.seed_files():
        (seeds / path.name).write_bytes(path.read_bytes())
    arguments = [
        *(f"-timeout={ENDLESS * options.hang}", f"-rss_limit_mb={options.memory}", f"-seed={options.seed}"),
        *(
            f"-max_len={largest}",
            f"-artifact_prefix={options.found}/",
            "-len_control=0",
            "-mutate_depth=2",
            str(seeds),
        ),
    ]
    atheris.Setup([sys.argv[0], *arguments], trial.one, custom_mutator=mutate)
    trial.begin()
    atheris.Fuzz()


if __name__ == "__main__":
    main()
