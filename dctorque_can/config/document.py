"""YAML text to plain data, with the line of every key, so that an error can point at its place.

The YAML 1.2 core schema is read: ``1e-3`` is a number, ``no`` and ``on`` are text, dates are text. Duplicate keys
are errors. Only the first syntax error of a file can be found.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import yaml

from dctorque_can.config.problems import KeyPath, Problem, dotted

MOST_NODES = 100_000  # a few nested aliases can stand for billions of values
MERGE = "tag:yaml.org,2002:merge"


class _Loader(yaml.SafeLoader):
    """The safe loader with the YAML 1.2 core schema."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012


def _float(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float:
    text = str(loader.construct_scalar(node)).lower().replace(".inf", "inf").replace(".nan", "nan")
    return float(text)


def _int(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node))
    return int(text, {"0x": 16, "0o": 8}.get(text[:2], 10))


_TAG = "tag:yaml.org,2002:"
_TAGS: dict[type[yaml.Node], tuple[str, ...]] = {
    yaml.ScalarNode: tuple(_TAG + name for name in ("str", "int", "float", "bool", "null", "merge")),
    yaml.SequenceNode: (_TAG + "seq",),
    yaml.MappingNode: (_TAG + "map",),
}
"""Those of the core schema, by the kind of node."""

_Loader.add_implicit_resolver(_TAG + "bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
_Loader.add_implicit_resolver(_TAG + "null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""])
_Loader.add_implicit_resolver(_TAG + "merge", re.compile(r"^<<$"), ["<"])
_Loader.add_implicit_resolver(
    _TAG + "int", re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"), list("-+0123456789")
)
_Loader.add_implicit_resolver(
    _TAG + "float",
    re.compile(
        r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
    ),
    list("-+.0123456789"),
)
_Loader.add_constructor(_TAG + "int", _int)
_Loader.add_constructor(_TAG + "float", _float)


@dataclass
class Document:
    """A parsed YAML file.

    Attributes:
        name: the file as the user named it.
        data: the top-level mapping; empty when the text could not be parsed.
        places: file and 1-based line of every key path.
        problems: syntax errors, duplicate keys, unusable keys.
        unreadable: keys, dotted, whose value could not be read, which has been reported.
    """

    name: str
    data: dict[Any, Any] = field(default_factory=dict)
    places: dict[KeyPath, tuple[str, int]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    unreadable: dict[str, Problem] = field(default_factory=dict)

    def without_consequences(self) -> list[Problem]:
        """Return the problems but for those that are there only because a value could not be read."""
        above = tuple(f"{key}." for key in self.unreadable)
        return [p for p in self.problems if self.unreadable.get(p.key, p) is p and not p.key.startswith(above)]

    def place(self, path: KeyPath) -> tuple[str, int]:
        """Return file and line of ``path`` or of its nearest ancestor that is in the file."""
        for n in range(len(path), 0, -1):
            if path[:n] in self.places:
                return self.places[path[:n]]
        return (self.name, 1 if self.data else 0)

    def value(self, path: KeyPath) -> Any:
        """Return the value at ``path``, or None."""
        value: Any = self.data
        for step in path:
            in_list = isinstance(value, list) and isinstance(step, int) and step < len(value)
            if not in_list and not (isinstance(value, dict) and step in value):
                return None
            value = value[step]
        return value

    def problem(self, path: KeyPath, reason: str, *, warning: bool = False) -> Problem:
        """Return a problem at ``path`` with its place and value filled in."""
        while path and path not in self.places and isinstance(self.value(path[:-1]), str):
            path = path[:-1]  # a shorthand: the text stands for the mapping that was asked for
        file, line = self.place(path)
        value = self.value(path)
        text = "" if value in (None, {}, []) else shown(value)
        return Problem(file, line, dotted(path), text, reason, "warning" if warning else "error")


def shown(value: object) -> str:
    """Return a value as one line of YAML."""
    text = yaml.safe_dump(value, default_flow_style=True, allow_unicode=True, width=10_000, sort_keys=False)
    return text.removesuffix("...\n").strip()


def parse(content: bytes, name: str) -> Document:
    """Parse the bytes of a YAML file; whatever is wrong is in ``problems`` of the result.

    The same file is mostly wanted several times, with other keys laid over it, and reading YAML is slow.
    """
    known = _parsed(content, name)
    return replace(
        known,
        data=deepcopy(known.data),
        places=known.places.copy(),
        problems=known.problems.copy(),
        unreadable=known.unreadable.copy(),
    )


@lru_cache(maxsize=32)
def _parsed(content: bytes, name: str) -> Document:
    document = Document(name)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        document.problems.append(Problem(name, line, "", "", "not UTF-8 text; save the file as UTF-8"))
        return document
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = f"not valid YAML: {error.problem or error.context}"
        if mark is not None:
            reason += f" (column {mark.column + 1})"
        document.problems.append(Problem(name, mark.line + 1 if mark else 0, "", "", reason))
        return document
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        reason = f"not valid YAML: the character {error.character!r} is not allowed"
        document.problems.append(Problem(name, line, "", "", reason))
        return document
    except RecursionError:
        document.problems.append(Problem(name, 0, "", "", "not valid YAML: nested too deeply"))
        return document
    if root is None:
        document.problems.append(Problem(name, 0, "", "", "the file is empty; see docs/configuration.md"))
        return document
    if not isinstance(root, yaml.MappingNode):
        reason = "the file must be a mapping of keys such as 'vehicle:' and 'inputs:'"
        document.problems.append(Problem(name, 1, "", "", reason))
        return document
    document.data = _Builder(document, loader).build(root, (), ())
    return document


class _Builder:
    """Walks the node tree once, building data, places and problems."""

    def __init__(self, document: Document, loader: _Loader):
        self._document = document
        self._loader = loader
        self._flat: list[yaml.Node] = []  # mappings whose merges have been resolved, in place
        self._built = 0

    def build(self, node: yaml.Node, path: KeyPath, above: tuple[yaml.Node, ...]) -> Any:
        if any(node is ancestor for ancestor in above):
            self._complain(node, path, "the alias refers to something that contains it")
            return None
        self._built += 1
        if self._built >= MOST_NODES:
            if self._built == MOST_NODES:
                self._complain(node, path, f"more than {MOST_NODES} values, counting each alias in full")
            return None
        above = (*above, node)
        if node.tag not in _TAGS[type(node)]:
            self._complain_of_tag(node, path)
            node = self._without_tag(node)
        if isinstance(node, yaml.MappingNode):
            return {key: self.build(value, (*path, key), above) for key, value in self._pairs(node, path)}
        if isinstance(node, yaml.SequenceNode):
            values = []
            for n, item in enumerate(node.value):
                self._document.places[*path, n] = (self._document.name, item.start_mark.line + 1)
                values.append(self.build(item, (*path, n), above))
            return values
        try:
            return self._loader.construct_object(node)
        except (yaml.YAMLError, ValueError, KeyError, AttributeError, TypeError):
            self._complain(
                node, path, f"not understood: it is no {_shown_tag(node)}; leave the tag out, or correct the value"
            )
            self._document.unreadable[dotted(path)] = self._document.problems[-1]
            return None

    def _complain_of_tag(self, node: yaml.Node, path: KeyPath) -> None:
        reason = f"not understood: the tag {_shown_tag(node)} is not known here; no value needs one, leave it out"
        self._complain(node, path, reason)
        if path:
            self._document.unreadable[dotted(path)] = self._document.problems[-1]

    def _without_tag(self, node: yaml.Node) -> yaml.Node:
        """Return a node as it would be without its tag."""
        if not isinstance(node, yaml.ScalarNode):
            return node
        plain = node.style is None
        tag = self._loader.resolve(yaml.ScalarNode, node.value, (plain, not plain))  # type: ignore[no-untyped-call]
        return yaml.ScalarNode(tag, node.value, node.start_mark, node.end_mark, node.style)

    def _pairs(self, node: yaml.MappingNode, path: KeyPath) -> Iterator[tuple[str | int, yaml.Node]]:
        """Yield the pairs of a mapping, merged ones (``<<``) first."""
        try:
            self._flatten(node, path)
        except yaml.MarkedYAMLError as error:
            self._complain(node, path, str(error.problem))
            return
        for key_node, value in node.value:
            key = self._key(key_node)
            if key is not None:
                self._document.places[*path, key] = (self._document.name, key_node.start_mark.line + 1)
                yield key, value

    def _flatten(self, node: yaml.MappingNode, path: KeyPath) -> None:
        """Resolve the merges of a mapping in place; of a key that comes twice then, the mapping's own stays.

        What is merged is flattened first: PyYAML 6.0.4 loses overridden keys of a merge within a merge.
        """
        if any(node is flat for flat in self._flat):
            return
        self._flat.append(node)
        self._find_duplicates(node, path)
        for key_node, value in node.value:
            if key_node.tag == MERGE:
                for source in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                    if isinstance(source, yaml.MappingNode):
                        self._flatten(source, path)
        self._loader.flatten_mapping(node)
        node.value = list({self._key(pair[0]) or pair[0]: pair for pair in node.value}.values())

    def _find_duplicates(self, node: yaml.MappingNode, path: KeyPath) -> None:
        """Report keys that are given twice and things that cannot be keys, and keep the others."""
        first: dict[str | int, int] = {}
        kept: list[tuple[yaml.Node, yaml.Node]] = []
        for key_node, value in node.value:
            key = self._key(key_node)
            if key is None and key_node.tag != MERGE:
                tagged = not isinstance(key_node, yaml.ScalarNode) or key_node.tag in _TAGS[yaml.ScalarNode]
                reason = "" if tagged else f", without the tag {_shown_tag(key_node)}"
                self._complain(key_node, path, f"a key must be a word or a whole number{reason}")
                continue
            if key in first:
                self._complain(key_node, (*path, key), f"the key is given twice, first in line {first[key]}")
                continue
            if key is not None:
                first[key] = key_node.start_mark.line + 1
            kept.append((key_node, value))
        node.value = kept

    def _key(self, node: yaml.Node) -> str | int | None:
        """Return a key, or None for a merge and for what cannot be a key."""
        if not isinstance(node, yaml.ScalarNode) or node.tag not in (_TAG + "str", _TAG + "int"):
            return None
        try:
            key = self._loader.construct_object(node)
        except ValueError:  # tagged as a number
            return None
        return key if isinstance(key, str | int) else None

    def _complain(self, node: yaml.Node, path: KeyPath, reason: str) -> None:
        value = str(node.value) if isinstance(node, yaml.ScalarNode) else ""
        if path and value == str(path[-1]):
            value = ""  # the key itself is shown already
        line = node.start_mark.line + 1
        self._document.problems.append(Problem(self._document.name, line, dotted(path), value, reason))


def _shown_tag(node: yaml.Node) -> str:
    """Return the tag of a node as it is written."""
    tag = str(node.tag)
    return "!!" + tag.removeprefix(_TAG) if tag.startswith(_TAG) else tag
