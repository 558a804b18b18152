"""A vehicle file that can be changed key by key."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from dctorque_can.config.load import Config, ConfigError, load_config
from dctorque_can.config.problems import Problem
from dctorque_can.resources import shipped_config, shipped_dbc

REMOVED = object()
PAPER_CAR: dict[str, Any] = yaml.safe_load(shipped_config("paper_car").read_text())


def plain(value: Any) -> Any:
    """Return a deep copy without shared parts, which YAML would write as anchors."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value


def changed(data: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a copy with the values at dotted keys replaced (or removed)."""
    result = plain(data)
    for key, value in changes.items():
        *parents, last = [int(step) if step.isdigit() else step for step in key.split(".")]
        here: Any = result
        for step in parents:
            here = here[step] if isinstance(here, list) else here.setdefault(step, {})
        if value is REMOVED:
            del here[last]
        elif isinstance(here, list) and last == len(here):
            here.append(value)
        else:
            here[last] = value
    return result


@pytest.fixture
def write(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Write the paper car with changes, its DBC beside it."""

    def write_file(changes: dict[str, Any]) -> Path:
        (tmp_path / "demo_car.dbc").write_bytes(shipped_dbc("demo_car").read_bytes())
        data = changed(PAPER_CAR, {"databases.0.file": "demo_car.dbc"} | changes)
        path = tmp_path / "car.yaml"
        path.write_text(yaml.safe_dump(data, allow_unicode=True, sort_keys=False))
        return path

    return write_file


@pytest.fixture
def load(write: Callable[[dict[str, Any]], Path]) -> Callable[..., Config]:
    """Load the paper car with changes."""
    return lambda changes: load_config(write(changes))


@pytest.fixture
def errors(write: Callable[[dict[str, Any]], Path]) -> Callable[..., list[Problem]]:
    """Return the errors of the paper car with changes."""

    def load_badly(changes: dict[str, Any]) -> list[Problem]:
        path = write(changes)
        with pytest.raises(ConfigError) as caught:
            load_config(path)
        assert all(problem.file == str(path) for problem in caught.value.problems)
        return [problem for problem in caught.value.problems if problem.severity == "error"]

    return load_badly


@pytest.fixture
def removed() -> object:
    return REMOVED
