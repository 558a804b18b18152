"""A log carries its vehicle file and DBCs: loading them again gives the same; overrides go with them."""

import re
from pathlib import Path

import pytest

from dctorque_can.config.load import Config, ConfigError, load_config, load_documents
from dctorque_can.config.overrides import parse_overrides
from dctorque_can.resources import shipped_config, shipped_configs, shipped_dbc


def same(first: Config, second: Config) -> bool:
    def messages(config: Config) -> list[tuple[object, ...]]:
        databases = (config.database, config.output.database)
        return [(m.name, m.frame_id, str(m.signals)) for database in databases for m in database.messages]

    return messages(first) == messages(second) and all(
        getattr(first, name) == getattr(second, name)
        for name in ("name", "settings", "protections", "can", "logging", "entries")
    )


@pytest.mark.parametrize("path", shipped_configs(), ids=lambda path: path.stem)
def test_documents_load_again(path: Path) -> None:
    config = load_config(path)
    assert set(config.documents) == {path.name, "demo_car.dbc", "dctorque.dbc"}
    assert config.documents[path.name] == path.read_bytes()
    again = load_documents(config.documents | {"notes.txt": b"other attachments do not disturb"})
    assert same(config, again)
    assert again.documents == config.documents
    assert again.path == Path(path.name)


def test_overrides_travel_with_the_documents() -> None:
    overrides = {
        "can.channel": "vcan0",
        "vehicle.chassis.mass_kg": "1700",
        "databases.0.strict": "false",
        "estimator.oh2014.road_load": "none",
        "gears.shaft1.timeout_ms": "5e2",
    }
    config = load_config(shipped_config("paper_car"), overrides)
    assert config.can.channel == "vcan0"
    assert config.settings.vehicle.chassis.mass_kg == 1700
    assert load_config(shipped_config("paper_car")).settings.vehicle.chassis.mass_kg == 1600
    again = load_documents(config.documents)
    assert same(config, again)
    assert again.documents == config.documents
    assert not same(load_config(shipped_config("paper_car")), again)


def test_an_alias_is_overridden_in_one_place_only() -> None:
    config = load_config(shipped_config("paper_car"), {"vehicle.clutches.1.surfaces": "6"})
    assert [clutch.surfaces for clutch in config.settings.vehicle.clutches] == [6, 4]


def test_dbcs_of_the_same_name_are_kept_apart(write, tmp_path: Path) -> None:
    path = write({"databases": ["demo_car.dbc", "body/demo_car.dbc"]})
    (tmp_path / "body").mkdir()
    text = re.sub(r"\b17([78]\d)\b", r"10\1", shipped_dbc("dctorque").read_text())  # other ids
    (tmp_path / "body" / "demo_car.dbc").write_text(text)
    config = load_config(path)
    assert set(config.documents) == {"car.yaml", "demo_car.dbc", "2-demo_car.dbc", "dctorque.dbc"}
    assert {"EngineData", "DctStatus"} <= {message.name for message in config.database.messages}
    assert same(config, load_documents(config.documents))


def test_an_output_dbc_of_ones_own(write, tmp_path: Path) -> None:
    path = write({"output": {"enabled": True, "database": "mine.dbc", "ids": {"DctStatus": 0x1ABC}}})
    (tmp_path / "mine.dbc").write_bytes(shipped_dbc("dctorque").read_bytes())
    config = load_config(path)
    assert (config.output.enabled, config.output.path) == (True, tmp_path / "mine.dbc")
    assert config.output.ids == {"DctStatus": 0x1ABC}
    assert "mine.dbc" in config.documents
    assert same(config, load_documents(config.documents))


@pytest.mark.parametrize(
    ("overrides", "key", "reason"),
    [
        ({"can.chanel": "vcan0"}, "can.chanel", "did you mean channel"),
        ({"vehicle.gears.1.ratio": "big"}, "vehicle.gears.1.ratio", "must be a number"),
        ({"can.channel": "[1"}, "can.channel", "not valid YAML"),
        ({"databases.3.file": "x.dbc"}, "databases.3.file", "list of 1"),
        ({"name.first": "x"}, "name.first", "is paper car and has no keys"),
        ({"vehicle.shafts.3": "{}"}, "vehicle.shafts.3", "1 or 2"),
    ],
)
def test_errors_of_an_override_name_the_command_line(overrides, key, reason) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(shipped_config("paper_car"), overrides)
    found = [p for p in caught.value.problems if p.file == "--set"]
    assert any(p.key == key and reason in p.reason for p in found), caught.value.problems


def test_overrides_of_the_command_line() -> None:
    assert parse_overrides(["can.channel=vcan0", " name = a=b"]) == {"can.channel": "vcan0", "name": " a=b"}
    for wrong in ("can.channel", "=x"):
        with pytest.raises(ValueError, match="must be KEY=VALUE"):
            parse_overrides([wrong])


def test_documents_that_are_incomplete() -> None:
    documents = load_config(shipped_config("paper_car")).documents
    with pytest.raises(ConfigError, match="no vehicle file"):
        load_documents({"demo_car.dbc": documents["demo_car.dbc"]})
    with pytest.raises(ConfigError, match=r"2 vehicle files \(paper_car.yaml, b.yaml\)"):
        load_documents(documents | {"b.yaml": b""})
    with pytest.raises(
        ConfigError, match=r"databases\.0\.file = \.\./dbc/demo_car\.dbc: .*is not among the documents"
    ):
        load_documents({name: content for name, content in documents.items() if name != "demo_car.dbc"})
    without_output = {name: content for name, content in documents.items() if name != "dctorque.dbc"}
    assert load_documents(without_output).output.database.messages
