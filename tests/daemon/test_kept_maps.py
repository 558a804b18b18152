"""The file in which maps are kept: what is wrong with it is told and put aside, never used, never an exception."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.config import vehicle_class
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.kept_maps import KeptMaps, begun, identity, packed, state_name, state_of
from dctorque_can.resources import shipped_class, shipped_config

ENABLED = {"clutch_map.enabled": "true"}


@pytest.fixture
def car() -> Config:
    return load_config(shipped_config("paper_car"), ENABLED)


@pytest.fixture
def kept(car: Config, tmp_path: Path) -> tuple[KeptMaps, list[str]]:
    told: list[str] = []
    return KeptMaps(car, lambda is_error, text: told.append(text), tmp_path / "state"), told


def content_of(car: Config) -> bytes:
    assert car.clutch_map is not None
    return packed(ClutchMaps(car.clutch_map), car)


def test_what_was_written_is_read_again(kept, car: Config) -> None:
    file, told = kept
    assert file.read() is None  # nothing yet, which is no mistake
    assert file.write(content_of(car))
    assert file.read() == content_of(car)
    assert told == []
    assert [path.name for path in file.path.parent.iterdir()] == [state_name(car)]


def spoiled(change: Callable[[dict], None]) -> Callable[[bytes], bytes]:
    def spoil(content: bytes) -> bytes:
        found = json.loads(content)
        change(found)
        return json.dumps(found).encode()

    return spoil


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda content: content[:-20], "it is damaged"),
        (lambda content: b"", "it is damaged"),
        (lambda content: b"\xff\xfe\x00", "it is damaged"),
        (lambda content: b"[" * 100_000, "it is damaged"),
        (lambda content: b"[1]", "it is damaged (no mapping)"),
        (spoiled(lambda found: found.update(version="0.0.1")), "it is of another version of dctorque_can"),
        (spoiled(lambda found: found.update(vehicle_file="0")), "it is of another vehicle file"),
        (spoiled(lambda found: found.update(format=99)), "it is of another format"),
        (spoiled(lambda found: found["clutches"].pop("1")), "it is damaged"),
    ],
)
def test_what_cannot_be_used_is_put_aside_and_named(kept, car: Config, spoil, why: str) -> None:
    file, told = kept
    file.write(content_of(car))
    bad = spoil(content_of(car))
    for number in (1, 2):
        file.path.write_bytes(bad)
        assert file.read() is None
        assert not file.path.exists()
        assert (file.path.parent / f"{file.path.name}.bad{number}").read_bytes() == bad
        assert told[-1].startswith(f"{file.path}: {why}")
        assert told[-1].endswith(f"put aside as {file.path.name}.bad{number}, the maps begin anew")


def test_a_power_cut_while_writing_leaves_the_old_one(kept, car: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    file, told = kept
    file.write(content_of(car))

    def cut(number: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", cut)
    assert not file.write(b"half of a st")
    monkeypatch.undo()
    assert file.read() == content_of(car)
    assert told == [f"{file.path}: cannot be written: Input/output error; the maps are not kept"]


def test_a_folder_that_cannot_be_is_told_once(car: Config, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    told: list[str] = []
    file = KeptMaps(car, lambda is_error, text: told.append(text), tmp_path / "file" / "state")
    assert file.read() is None
    assert not file.write(b"x")
    assert not file.write(b"x")
    assert len([line for line in told if "cannot be written" in line]) == 1


def test_only_what_is_learned_from_makes_another_car() -> None:
    """The bus, the log and how the map is published may change; the vehicle and its inputs may not."""
    path = shipped_config("paper_car")
    plain = identity(load_config(path, ENABLED))
    same = load_config(path, ENABLED | {"can.channel": "vcan7", "clutch_map.period_s": "1", "state.save_s": "5"})
    other = load_config(path, ENABLED | {"clutch_phase.clutch1.kissing_point": "3.2"})
    assert identity(same) == plain
    assert identity(other)["vehicle_file"] != plain["vehicle_file"]


def test_other_numbers_of_its_class_make_another_car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As far as the vehicle file has them from there: what it says itself stays."""
    path = shipped_config("paper_car")
    text = path.read_text().replace("../dbc", str(path.parent.parent / "dbc"))
    owned = yaml.safe_load(text)
    del owned["vehicle"]["chassis"]["drag_coefficient"], owned["vehicle"]["clutches"]
    owned["vehicle"]["class"] = "compact_dct7_dry"
    file = tmp_path / "car.yaml"
    file.write_text(yaml.safe_dump(owned))

    def with_class(old: str, new: str) -> dict:
        content = shipped_class("compact_dct7_dry").read_text()
        assert old in content
        other = tmp_path / "class.yaml"
        other.write_text(content.replace(old, new))
        with monkeypatch.context() as patch:
            patch.setattr(vehicle_class, "shipped_class", lambda name: other)
            return identity(load_config(file, ENABLED))

    plain = identity(load_config(file, ENABLED))
    assert with_class("mass_kg: 1400", "mass_kg: 1400.0001") == plain
    assert with_class("friction_kinetic: 0.3", "friction_kinetic: 0.31") != plain
    assert with_class("drag_coefficient: 0.31", "drag_coefficient: 0.3") != plain


def test_the_state_travels_with_a_log(car: Config) -> None:
    content = content_of(car)
    assert state_of(car.documents) is None
    assert state_of(car.documents | {state_name(car): content}) == content
    maps, why = begun(content, car)
    assert why == ""
    assert maps is not None
    assert [clutch.restored for clutch in maps.clutches] == [True, True]
