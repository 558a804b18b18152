"""What two versions of a vehicle file differ in, key by key, and what of that may change in a running service."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import PurePath
from typing import Any

import yaml

from dctorque_can.config.document import parse
from dctorque_can.config.load import OVERRIDES_SUFFIX, Config
from dctorque_can.config.overrides import apply_overrides
from dctorque_can.config.problems import KeyPath, dotted

_WHILE_IT_RUNS = ("logging", "output.foreign_silence_s", "state.save_s")
_NOT_SO = ("logging.enabled", "logging.frames")  # the latter: what is received may depend on it


def changed_keys(old: Config, new: Config) -> list[str]:
    """Return the dotted keys whose values differ, and ``databases: FILE`` for each DBC that does."""
    before, after = dict(_leaves(_values(old), ())), dict(_leaves(_values(new), ()))
    keys = [dotted(path) for path in {**before, **after} if before.get(path, _NONE) != after.get(path, _NONE)]
    names = {name for name in {**old.documents, **new.documents} if PurePath(name).suffix not in (".yaml", ".yml")}
    others = [f"databases: {name}" for name in sorted(names) if old.documents.get(name) != new.documents.get(name)]
    return sorted(keys) + others


def needs_restart(key: str) -> bool:
    """Return whether a changed key cannot take effect in a service that goes on as it is."""
    below = any(key == each or key.startswith(f"{each}.") for each in _WHILE_IT_RUNS)
    return not below or key in _NOT_SO


_NONE = object()


def _values(config: Config) -> dict[Any, Any]:
    """Return what a vehicle file says, with its overrides."""
    document = parse(config.documents[config.path.name], config.path.name)
    laid_over = config.documents.get(config.path.stem + OVERRIDES_SUFFIX)
    apply_overrides(document, yaml.safe_load(laid_over) if laid_over else {})
    return document.data


def _leaves(value: Any, path: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    items: Iterator[tuple[Any, Any]]
    if isinstance(value, dict) and value:
        items = iter(value.items())
    elif isinstance(value, list) and value:
        items = iter(enumerate(value))
    else:
        yield path, (type(value), value)  # 1 is not true
        return
    for key, item in items:
        yield from _leaves(item, (*path, key))
