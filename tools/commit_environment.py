"""Another commit of this repository, installed in an environment of its own, and this checkout in the one it has.

Each commit is installed once, with the library versions of this checkout where its own requirements allow them, so
that a difference between both is a difference of the code.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import os
import platform
import runpy
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTALLED = "installed"  # written last: an installation that was interrupted is done again


class CommitError(Exception):
    """What went wrong, for the one who called the tool."""


@dataclass(frozen=True)
class Side:
    """One installed version.

    Attributes:
        name: for people: an abbreviated commit, or "checkout".
        python: its interpreter.
        folder: where its files may be kept.
        environment: variables of every process of it.
    """

    name: str
    python: Path
    folder: Path
    environment: dict[str, str] = field(default_factory=dict)

    def dctorque(self, *arguments: str) -> str:
        """Run ``dctorque`` away from any checkout and return what it printed.

        Raises:
            CommitError: its exit code is not 0.
        """
        command = [str(self.python.with_name("dctorque")), *arguments]
        return output_of(command, cwd=self.folder, environment=self.environment)


def progress(text: str) -> None:
    print(f"  … {text}", file=sys.stderr, flush=True)


def default_keep() -> Path:
    """Return the folder of the user's caches in which commits are kept."""
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(caches) / "dctorque-commits"


def output_of(command: Sequence[str], cwd: Path, environment: dict[str, str] | None = None) -> str:
    """Run a command to its end and return its standard output.

    Raises:
        CommitError: its exit code is not 0; the message ends with what it said.
    """
    variables = {**os.environ, **(environment or {})}
    done = subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True)
    if done.returncode != 0:
        said = "\n".join((done.stderr or done.stdout).strip().splitlines()[-15:])
        raise CommitError(f"{' '.join(command)}: exit code {done.returncode}\n{said}")
    return done.stdout


def checkout_side() -> Side:
    """Return this checkout, installed for the interpreter that runs the tool.

    Compiled code is shared with the tests.

    Raises:
        CommitError: what is installed here is not this checkout.
    """
    session = runpy.run_path(str(ROOT / "tests" / "conftest.py"))
    different = session["differences"](session["PACKAGE"])
    if different:
        raise CommitError(f"{session['PACKAGE']} is not this checkout ({different[0]}): pip install -e '.[dev]'")
    cache = os.environ["NUMBA_CACHE_DIR"]  # set by conftest
    return Side("checkout", Path(sys.executable), Path(cache), {"NUMBA_CACHE_DIR": cache})


def plain_checkout_side(keep: Path) -> Side:
    """Return this checkout in an environment below ``keep`` that has only what it needs to run, as a commit has.

    An environment for development is slower: python-can imports asammdf, which the tests bring, if it is there.
    Compiled code is kept apart from that of the tests, which may have been compiled with NUMBA_OPT=1.

    Raises:
        CommitError: it could not be installed.
    """
    state = Path(checkout_side().environment["NUMBA_CACHE_DIR"]).name
    requirements = hashlib.sha256(str(ROOT).encode() + (ROOT / "pyproject.toml").read_bytes()).hexdigest()[:12]
    folder = keep / f"checkout-{requirements}"
    compiled = folder / f"numba-{state}-{digest_of_compiler()}"
    side = Side("checkout", folder / "venv" / "bin" / "python", folder, {"NUMBA_CACHE_DIR": str(compiled)})
    if not (folder / INSTALLED).exists():
        progress(f"installing this checkout in {folder}")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        _make_environment(side, "--editable", str(ROOT))
    return side


def resolve(commit: str) -> str:
    """Return the full hash of a commit.

    Raises:
        CommitError: git knows no such commit.
    """
    return output_of(["git", "rev-parse", "--verify", "--quiet", f"{commit}^{{commit}}"], ROOT).strip()


def install(commit: str, keep: Path) -> Side:
    """Install ``commit`` (a full hash) below ``keep``, unless it is there already.

    Raises:
        CommitError: it could not be installed.
    """
    folder = keep / commit[:12]
    compiled = {"NUMBA_CACHE_DIR": str(folder / f"numba-{digest_of_compiler()}")}
    side = Side(commit[:12], folder / "venv" / "bin" / "python", folder, compiled)
    if (folder / INSTALLED).exists():
        return side
    progress(f"installing {side.name} in {folder}")
    shutil.rmtree(folder, ignore_errors=True)
    source = folder / "source"
    source.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(source, filter="data")
    _make_environment(side, str(source))
    return side


def _make_environment(side: Side, *what: str) -> None:
    output_of([sys.executable, "-m", "venv", str(side.folder / "venv")], side.folder)
    pip = [str(side.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *what]
    versions = side.folder / "constraints.txt"
    here = output_of([sys.executable, "-m", "pip", "freeze", "--exclude-editable"], ROOT).splitlines()
    versions.write_text("".join(f"{line}\n" for line in here if "==" in line))
    try:
        output_of([*pip, "--constraint", str(versions)], side.folder)
    except CommitError:
        progress(f"{side.name} does not take the library versions of this checkout: it gets its own")
        output_of(pip, side.folder)
    (side.folder / INSTALLED).touch()


@contextmanager
def alone(keep: Path, commit: str) -> Iterator[None]:
    """Wait until nobody else works below ``keep`` for ``commit``."""
    keep.mkdir(parents=True, exist_ok=True)
    with (keep / f"{commit[:12]}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def digest_of_compiler() -> str:
    """Return a word for what changes compiled code beside its source: the processor and settings of numba."""
    return _digest(("NUMBA_",))


def digest_of_arithmetic() -> str:
    """Return a word for what may change the last bit of a result: that, and settings of the BLAS."""
    return _digest(("NUMBA_", "OPENBLAS_", "OMP_", "MKL_"))


def _digest(prefixes: tuple[str, ...]) -> str:
    words = [platform.machine()]
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith(("model name", "flags", "Features", "CPU part")):
            words.append(line)
    for name, value in sorted(os.environ.items()):
        if name.startswith(prefixes) and name != "NUMBA_CACHE_DIR":
            words.append(f"{name}={value}")
    return hashlib.sha256("\n".join(words).encode()).hexdigest()[:12]
