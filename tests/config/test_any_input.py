"""Whatever stands in a vehicle file, it loads or says why: never another exception, never a wrong type."""

import copy
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.config.load import Config, ConfigError, load_documents
from dctorque_can.resources import shipped_config, shipped_dbc

DOCUMENTS = {"demo_car.dbc": shipped_dbc("demo_car").read_bytes()}
TEXT = shipped_config("paper_car").read_bytes()
PAPER_CAR: dict[str, Any] = yaml.safe_load(TEXT)


def paths(value: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the key path of every value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path for key, item in items for path in [(*above, key), *paths(item, (*above, key))]]


WORDS = ["", "R", "neutral", "EngineData.EngineSpeed", "Gearbox.GearShaft1", "ratio", "flag", "%", "rpm", "a.b.c"]
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.sampled_from([-1, 0, 1, 2, 3, 1e300, 1e-300])
    | st.floats()
    | st.sampled_from(WORDS)
    | st.text(max_size=8)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.integers(-2, 9) | st.sampled_from(WORDS), inner)
    ),
    max_leaves=5,
)


def judged(text: bytes) -> Config | ConfigError:
    """Return what a vehicle file says, or what is wrong in it; anything else that is raised fails the test."""
    try:
        return load_documents(DOCUMENTS | {"car.yaml": text})
    except ConfigError as error:
        return error


@settings(max_examples=80)
@given(st.lists(st.tuples(st.sampled_from(paths(PAPER_CAR)), VALUES), min_size=1, max_size=3))
def test_any_values(changes: list[tuple[tuple[Any, ...], Any]]) -> None:
    data = copy.deepcopy(PAPER_CAR)
    for path, value in changes:
        here: Any = data
        for step in path[:-1]:
            here = here.get(step) if isinstance(here, dict) else None
        if isinstance(here, dict):  # else an earlier change has taken the place away
            here[path[-1]] = value
    text = yaml.safe_dump(data, allow_unicode=True).encode()
    verdict = judged(text)
    loaded = isinstance(verdict, Config)
    problems = verdict.warnings if isinstance(verdict, Config) else verdict.problems
    assert all(problem.reason for problem in problems)
    assert any(problem.severity == "error" for problem in problems) is not loaded


@settings(max_examples=60)
@given(st.integers(0, len(TEXT) - 1), st.integers(0, 400), st.binary(max_size=6))
def test_any_damage(start: int, length: int, junk: bytes) -> None:
    damaged = TEXT[:start] + junk + TEXT[start + length :]
    verdict = judged(damaged)
    assert isinstance(verdict, Config) or verdict.problems


@pytest.mark.parametrize("section", list(PAPER_CAR))
@pytest.mark.parametrize("value", [3, "text", [1], {"x": 1}, True])
def test_sections_of_the_wrong_shape(errors, section: str, value: object) -> None:
    if (section, value) != ("name", "text"):
        assert errors({section: value})
