"""``tools/fuzz``: seeds that are whole, mutators that reach inside, and a search that tells what it finds."""

import importlib
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"
FUZZ = TOOLS / "fuzz"
LOGS = ("asc", "candump", "csv", "trc", "gz", "blf", "mcap", "mf4")
HANG_S = 900  # so late that no load of the machine explains it


@pytest.fixture
def rooms(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("fuzzing.rooms")


def change(data, largest):
    """Stand in for atheris' own mutator: one byte of another value."""
    changed = bytearray(data)
    if changed:
        changed[len(changed) // 2] ^= 1
    return bytes(changed[:largest])


@pytest.mark.parametrize("name", LOGS)
def test_every_seed_of_a_log_is_whole(rooms, name, tmp_path):
    room = rooms.ROOMS[name]
    if name == "mf4":
        pytest.importorskip("asammdf")
    assert room.seed_files()
    for seed in room.seed_files():
        path = tmp_path / room.file
        path.write_bytes(seed.read_bytes())
        assert rooms.read_log(path) > 1, seed


def test_the_other_rooms_take_their_seeds(rooms, tmp_path):
    taken = {}
    for name in ("recover", "dbc", "configuration"):
        room = rooms.ROOMS[name]
        folder = rooms.beside_databases(tmp_path) if name == "configuration" else tmp_path
        for seed in room.seed_files():
            path = folder / room.file
            path.write_bytes(seed.read_bytes())
            taken[f"{name}/{seed.name}"] = room.try_file(path)
    assert not taken.pop("configuration/small_and_wrong.yaml")
    assert len(taken) >= 8
    assert all(taken.values())


@pytest.mark.parametrize("name", ["gz", "blf", "mcap", "candump"])
def test_what_a_mutator_changed_is_read_further(rooms, name, tmp_path):
    """Of the files that it made, most are opened, and most are not what they were."""
    room = rooms.ROOMS[name]
    rng = random.Random(name)
    path = tmp_path / room.file
    opened = other = 0
    for seed in room.seed_files():
        whole = seed.read_bytes()
        for _ in range(40):
            path.write_bytes(room.mutator(whole, change, rng, 10_000))
            opened += room.try_file(path)
            other += path.read_bytes() != whole
    assert opened > 25 * len(room.seed_files())
    assert other > 30 * len(room.seed_files())


def test_a_count_of_files_is_read_and_told(tmp_path):
    pytest.importorskip("atheris")
    done = subprocess.run(
        [sys.executable, FUZZ, "csv", "--count", "300", "--keep", tmp_path],
        capture_output=True,
        text=True,
        timeout=HANG_S,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("| csv | 300 |")


def test_a_room_that_fails_is_told_with_the_input_that_did_it(tmp_path):
    """A reader that raises what it must not, by a module that Python loads before the room."""
    pytest.importorskip("atheris")
    (tmp_path / "sitecustomize.py").write_text(
        "import dctorque_can.logs.reader as reader\n"
        "whole = reader.open_log\n"
        "def open_log(path):\n"
        "    if b'7' not in path.read_bytes():\n"
        "        raise KeyError('planted')\n"
        "    return whole(path)\n"
        "reader.open_log = open_log\n"
    )
    done = subprocess.run(
        [sys.executable, FUZZ, "csv", "--count", "300", "--keep", tmp_path],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=HANG_S,
    )
    assert done.returncode == 1, done.stderr
    assert "FOUND in csv: KeyError sitecustomize.py:5" in done.stderr
    (kept,) = [path for path in (tmp_path / "csv" / "found").glob("exception-KeyError*") if path.suffix != ".txt"]
    assert b"7" not in kept.read_bytes()
