"""YAML with places: types, lines, and what is reported about broken files."""

from pathlib import Path

import pytest

from dctorque_can.config.document import MOST_NODES, parse


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1e4", 10000.0),
        (".5", 0.5),
        ("-3.", -3.0),
        ("0x1F0", 496),
        ("0o17", 15),
        ("010", 10),
        ("true", True),
        ("no", "no"),
        ("on", "on"),
        ("1:30", "1:30"),
        ("2024-01-02", "2024-01-02"),
        ("~", None),
        ("", None),
        ("'12'", "12"),
        ("N·m", "N·m"),
    ],
)
def test_yaml_1_2_core_schema(text: str, value: object) -> None:
    document = parse(f"key: {text}".encode(), "a.yaml")
    assert document.problems == []
    assert document.data["key"] == value
    assert type(document.data["key"]) is type(value)


def test_every_key_has_its_line() -> None:
    document = parse(b"\xef\xbb\xbfa: 1\nb:\n  c: 2\n  list:\n    - x\n    - {y: 3}\n", "a.yaml")
    assert document.data == {"a": 1, "b": {"c": 2, "list": ["x", {"y": 3}]}}
    lines = {path: line for path, (_, line) in document.places.items()}
    assert lines == {
        ("a",): 1,
        ("b",): 2,
        ("b", "c"): 3,
        ("b", "list"): 4,
        ("b", "list", 0): 5,
        ("b", "list", 1): 6,
        ("b", "list", 1, "y"): 6,
    }
    assert document.place(("b", "missing", "deeper")) == ("a.yaml", 2)


def test_all_duplicates_are_reported_and_the_first_value_stays() -> None:
    document = parse(b"a: 1\nb: {c: 1, c: 2}\na: 3\n", "a.yaml")
    assert [str(problem) for problem in document.problems] == [
        "a.yaml:3: a: the key is given twice, first in line 1",
        "a.yaml:2: b.c: the key is given twice, first in line 2",
    ]
    assert document.data == {"a": 1, "b": {"c": 1}}


def test_merge_keys_may_be_overridden_and_are_no_duplicates() -> None:
    text = b"base: &base {x: 1, y: 2}\none: &one {<<: *base, y: 3}\ntwo: *one\nthree: {<<: [*one, *base], x: 9}\n"
    document = parse(text, "a.yaml")
    assert document.problems == []
    assert document.data["one"] == document.data["two"] == {"x": 1, "y": 3}
    assert document.data["three"] == {"x": 9, "y": 3}


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"a: 1\nb: [1, 2\nc: 3\n", "a.yaml:3: not valid YAML"),
        (b"a: 1\n\tb: 2\n", "a.yaml:2: not valid YAML"),
        (b"a: *unknown\n", "a.yaml:1: not valid YAML: found undefined alias"),
        (b"a: 1\n---\nb: 2\n", "a.yaml:2: not valid YAML"),
        (b"a: 1\nb: \xff\xfe\n", "a.yaml:2: not UTF-8 text"),
        (b"a: 1\nb: \x07\n", "a.yaml:2: not valid YAML: the character"),
        (b"", "a.yaml: the file is empty"),
        (b"# only a comment\n", "a.yaml: the file is empty"),
        (b"- a\n- b\n", "a.yaml:1: the file must be a mapping"),
        (b"a: 1\n? [x, y]\n: 2\n", "a.yaml:2: a key must be a word"),
        (b"1.5: 1\n", "a.yaml:1: 1.5: a key must be a word"),
        (b"a: !!int hello\n", "a.yaml:1: a = hello: not understood"),
        (b"a: !python/object x\n", "a.yaml:1: a = x: not understood"),
        (b"a: &a [1, *a]\n", "a.yaml:1: a.1: the alias refers to something that contains it"),
        (b"a: {<<: 3}\n", "a.yaml:1: a: expected a mapping"),
        (b"[" * 5000, "a.yaml: not valid YAML: nested too deeply"),
    ],
)
def test_broken_files_have_a_place_and_a_reason(content: bytes, expected: str) -> None:
    (problem,) = parse(content, "a.yaml").problems
    assert str(problem).startswith(expected)


def test_aliases_cannot_blow_up() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    (problem,) = parse("\n".join(lines).encode(), "a.yaml").problems
    assert problem.reason.startswith(f"more than {MOST_NODES} values")


def test_a_tag_runs_nothing(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    for tag in ("python/object/apply:os.mkdir", "python/object/new:os.mkdir", "python/name:os.mkdir"):
        document = parse(f'a: !!{tag} ["{mark}"]\n'.encode(), "a.yaml")
        assert "not understood: the tag" in document.problems[0].reason
    assert not mark.exists()
