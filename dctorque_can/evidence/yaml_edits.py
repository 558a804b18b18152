"""Values of a YAML text changed in place: comments, layout, anchors and everything else stay as they are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import yaml

from dctorque_can.config.document import parse, shown

_ALIAS = re.compile(r"\*[^\s,\]\}\{\[]+")


@dataclass(frozen=True, slots=True)
class Edit:
    """One value to be set.

    Attributes:
        key: dotted; entries of a list are counted from 0.
        value: as YAML on one line.
        comment: stands at the end of the line.
    """

    key: str
    value: str
    comment: str


@dataclass(frozen=True, slots=True)
class _Place:
    """Where text is put, and what for."""

    start: int
    end: int
    text: str
    breaks_after: bool = False  # the comment follows at once, and then a new line with this indentation
    indent: int = 0


def edited(text: str, edits: list[Edit]) -> str:
    """Return a text with values set, one after another.

    A key that is not there is added to the mapping that it belongs to; a signal that is told by its name alone
    becomes a mapping; an alias becomes one of its own that merges what it stands for.

    Args:
        text: YAML that can be read, a mapping.
        edits: none below another one.
    """
    for edit in edits:
        before = _leaves(text)
        text = _put(text, _place(text, _root(text), edit.key.split("."), edit.value), edit.comment)
        # whatever shares the text by an alias stays what it was
        for key, value in before.items():
            own = key == edit.key or key.startswith(f"{edit.key}.") or edit.key.startswith(f"{key}.")
            if not own and _leaves(text).get(key) != value:
                text = _put(text, _place(text, _root(text), key.split("."), shown(value)), "as before")
    return text


def old_value(text: str, key: str) -> str | None:
    """Return what stands at a dotted key, as it is written and on one line; None where there is no such key."""
    node: yaml.Node = _root(text)
    for step in key.split("."):
        found = _child(node, step)
        if found is None:
            return None
        node = found[1]
    return " ".join(text[node.start_mark.index : _end(node)].split())


def _root(text: str) -> yaml.MappingNode:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    return root


def _leaves(text: str) -> dict[str, Any]:
    """Return all single values by their dotted keys, aliases and merges resolved."""
    found: dict[str, Any] = {}

    def walk(value: Any, path: str) -> None:
        if isinstance(value, dict | list) and value:
            items = value.items() if isinstance(value, dict) else enumerate(value)
            for step, below in items:
                walk(below, f"{path}.{step}" if path else str(step))
        else:
            found[path] = value

    walk(parse(text.encode(), "").data, "")
    return found


def _place(text: str, node: yaml.Node, steps: list[str], value: str) -> _Place:
    """Return what replaces which part of the text."""
    if not steps:
        return _Place(node.start_mark.index, _end(node), value)
    step, *rest = steps
    if isinstance(node, yaml.ScalarNode):  # a signal by its name alone
        scalar = text[node.start_mark.index : node.end_mark.index]
        return _Place(node.start_mark.index, node.end_mark.index, f"{{signal: {scalar}, {_nested(steps, value)}}}")
    found = _child(node, step)
    if found is None:
        return _addition(node, _nested(steps, value))
    before, child = found
    if child.start_mark.index >= before:
        return _place(text, child, rest, value)
    alias = _ALIAS.search(text, before)
    assert alias is not None
    merged = value if not rest else f"{{<<: {alias.group()}, {_nested(rest, value)}}}"
    return _Place(alias.start(), alias.end(), merged)


def _child(node: yaml.Node, step: str) -> tuple[int, yaml.Node] | None:
    """Return what is at a step below a node, and from where on it stands in the text, unless it is an alias."""
    if isinstance(node, yaml.SequenceNode):
        if not step.isdigit() or int(step) >= len(node.value):
            return None
        n = int(step)
        before = node.start_mark.index if n == 0 else max(_end(each) for each in node.value[:n])
        return before, node.value[n]
    if isinstance(node, yaml.MappingNode):
        for key, child in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value == step:
                return key.end_mark.index, child
    return None


def _nested(steps: list[str], value: str) -> str:
    """Return keys one below another with a value, without the outermost braces."""
    *above, last = steps
    return "".join(f"{step}: {{" for step in above) + f"{last}: {value}" + "}" * len(above)


def _addition(node: yaml.Node, pair: str) -> _Place:
    """Return a pair as the first one of a mapping."""
    assert isinstance(node, yaml.MappingNode)
    start = node.start_mark.index
    if node.flow_style or not node.value:
        opening = start + 1
        return _Place(opening, opening, pair + (", " if node.value else ""))
    first = node.value[0][0].start_mark
    return _Place(first.index, first.index, pair, True, first.column)


def _end(node: yaml.Node) -> int:
    """Return where a node ends; PyYAML lets a block end where the next token begins."""
    if not isinstance(node, yaml.CollectionNode) or node.flow_style or not node.value:
        return int(node.end_mark.index)
    children = [child for pair in node.value for child in (pair if isinstance(pair, tuple) else (pair,))]
    own = [child for child in children if child.start_mark.index >= node.start_mark.index]
    return max(_end(child) for child in own)


def _put(text: str, place: _Place, comment: str) -> str:
    """Return the text with a place filled, and a comment at the end of its line."""
    if place.breaks_after:
        line = f"{place.text}  # {comment}\n{' ' * place.indent}"
        return text[: place.start] + line + text[place.end :]
    text = text[: place.start] + place.text + text[place.end :]
    after = place.start + len(place.text)
    end = text.find("\n", after)
    end = len(text) if end < 0 else end
    has_comment = re.search(r"(^|\s)#", text[after:end]) is not None
    kept = text[:end].rstrip(" \t\r")
    return kept + (f"; {comment}" if has_comment else f"  # {comment}") + text[end:]
