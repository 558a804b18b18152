"""Compiled code from process to process: found again, made anew when it must be, and never fatal."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "dctorque_can"
PROGRAM = """
import json, sys, warnings
import numpy as np
from dctorque_can.logs.blf.objects import _next_object  # which calls little_endian, of another file
from dctorque_can.compiling import watch
with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    found = [_next_object(np.frombuffer(b"  LOBJ  ", np.uint8).copy(), 0) for _ in range(2)]
texts = sorted({str(one.message) for one in said})
print(json.dumps([found, watch.so_far.functions, texts, "numba.np.linalg" in sys.modules]))
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package that can be changed."""
    where = tmp_path / "copy" / "dctorque_can"
    shutil.copytree(PACKAGE, where, ignore=shutil.ignore_patterns("__pycache__", "shipped"))
    return where


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    made = tmp_path / "cache"
    made.mkdir()
    return made


def run(copy: Path, cache: Path, **more: str) -> tuple[list[int], int, list[str], bool]:
    """Return what the program found, how much it compiled, its warnings, and whether a compiler was loaded."""
    environment = os.environ | {
        "NUMBA_OPT": "1",
        "PYTHONPATH": str(copy.parent),
        "NUMBA_CACHE_DIR": str(cache),
        "PYTHONDONTWRITEBYTECODE": "1",
        **more,
    }
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=copy.parent, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found, compiled, said, compiler = json.loads(done.stdout)
    return found, compiled, said, compiler


def files(cache: Path) -> list[Path]:
    return sorted(cache.glob("dctorque/*/*.nbc"))


def test_the_second_process_compiles_nothing_and_loads_no_compiler(copy: Path, cache: Path) -> None:
    """One file is kept, of the function that Python calls: it holds the machine code of what that one calls."""
    assert run(copy, cache)[:3] == ([2, 2], 2, [])
    assert [path.stat().st_mode & 0o777 for path in files(cache)] == [0o644]
    assert run(copy, cache) == ([2, 2], 0, [], False)


def test_a_callee_changed_in_another_file_is_compiled_anew(copy: Path, cache: Path) -> None:
    """Numba's own cache looks at the file of the outermost function alone, and would answer as before."""
    assert run(copy, cache)[:2] == ([2, 2], 2)
    callee = copy / "logs" / "little_endian.py"
    callee.write_text(callee.read_text().replace("    return np.int64(value)", "    return np.int64(0)"))
    assert run(copy, cache)[:2] == ([-1, -1], 2)


def test_damaged_code_is_told_and_made_anew(copy: Path, cache: Path) -> None:
    run(copy, cache)
    for path in files(cache):
        path.write_bytes(path.read_bytes()[:-200])
    found, compiled, said, _ = run(copy, cache)
    assert (found, compiled) == ([2, 2], 2)
    assert said
    assert all("is damaged; it is compiled anew" in text for text in said)
    assert run(copy, cache)[:3] == ([2, 2], 0, [])


def test_code_that_others_may_have_written_is_not_loaded(copy: Path, cache: Path) -> None:
    run(copy, cache)
    for path in files(cache):
        path.write_bytes(b"cos\\nsystem\\n(S'touch owned'\\ntR.")
        path.chmod(0o666)
    found, compiled, said, _ = run(copy, cache)
    assert (found, compiled) == ([2, 2], 2)
    assert "everybody may write to" in said[0]


def test_a_folder_for_everybody_is_left_alone_and_told_once(copy: Path, cache: Path) -> None:
    cache.chmod(0o777)
    found, compiled, said, _ = run(copy, cache)
    assert (found, compiled, files(cache)) == ([2, 2], 2, [])
    (text,) = said
    assert f"everybody may write to {cache}" in text
    assert "NUMBA_CACHE_DIR" in text
    assert "dctorque warm-up" in text


def test_no_place_at_all_is_told_once_with_the_remedy(copy: Path, cache: Path) -> None:
    found, compiled, said, _ = run(copy, Path("/dev/null/nowhere"))
    assert (found, compiled) == ([2, 2], 2)
    (text,) = said
    assert text.startswith("there is no place for compiled code: /dev/null/nowhere/")
    assert "CacheDirectory= in a systemd unit" in text


def test_a_disk_that_is_full_stops_nothing(copy: Path, cache: Path) -> None:
    run(copy, cache)
    for path in files(cache):
        path.unlink()
        path.mkdir()  # nobody can write there, not even root
    found, compiled, said, _ = run(copy, cache)
    assert (found, compiled) == ([2, 2], 2)
    assert any("cannot be kept in" in text for text in said)


def test_code_that_came_with_the_package_is_used_first(copy: Path, cache: Path, tmp_path: Path) -> None:
    assert run(copy, cache, NUMBA_CPU_NAME="generic")[1] == 2
    (folder,) = cache.glob("dctorque/*")
    shutil.copytree(folder, copy / "shipped" / "machine_code" / folder.name)
    assert run(copy, Path("/dev/null/nowhere")) == ([2, 2], 0, [], False)


def test_without_a_compiler_python_runs_it(copy: Path, cache: Path) -> None:
    assert run(copy, cache, NUMBA_DISABLE_JIT="1")[:2] == ([2, 2], 0)
