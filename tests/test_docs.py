"""What the documents name is there: files, modules and what stands in them, and the places that links lead to."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "dctorque_can"
DOCUMENTS = [
    *sorted((ROOT / "docs").glob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "tests/golden/drives/README.md")),
]
FOLDERS = ("config", "dbc", "dctorque_can", "docs", "tests", "tools")
ROOMS = {path.stem for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"}


def words(text: str) -> Iterator[str]:
    """Yield the words that stand in backticks within a line."""
    for quoted in re.findall(r"`([^`\n]+)`", text):
        yield from re.findall(r"[\w./-]+", quoted) if " " in quoted else [quoted]


def missing_files(text: str) -> set[str]:
    """Return paths that no file or folder has: Python files, and what begins with a folder of the repository."""
    paths = {word for word in words(text) if re.fullmatch(r"[\w.-]+(/[\w.-]+)*/?", word)}
    ours = {path for path in paths if path.endswith(".py") or (path.split("/")[0] in FOLDERS and "/" in path)}
    return {path for path in ours if not (ROOT / path).exists() and not (PACKAGE / path).exists()}


def missing_modules(text: str) -> set[str]:
    """Return dotted names of the package that are no module, nor a name that a module has."""
    dotted = {
        word for word in words(text) if re.fullmatch(r"[a-z_]\w*(\.\w+)+", word) and not word.endswith(".py")
    }
    ours = {name.removeprefix("dctorque_can.") for name in dotted}
    return {name for name in ours if name.split(".")[0] in ROOMS and not resolves(name)}


def resolves(name: str) -> bool:
    """Return whether a name is a module, or a module followed by one of its top-level names."""
    if is_module(name):
        return True
    module, _, attribute = name.rpartition(".")
    source = (PACKAGE / module.replace(".", "/")).with_suffix(".py")
    defined = rf"^(?:(?:def|class) {re.escape(attribute)}\b|{re.escape(attribute)}\b[^\n=]*=)"
    return source.is_file() and re.search(defined, source.read_text(encoding="utf-8"), re.MULTILINE) is not None


def is_module(name: str) -> bool:
    path = PACKAGE / name.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


def missing_targets(text: str, document: Path) -> set[str]:
    """Return links within the repository that lead to no file, or to no heading of it."""
    return {target for target in re.findall(r"\]\(([^)\s]+)\)", text) if not leads_somewhere(target, document)}


def leads_somewhere(target: str, document: Path) -> bool:
    if "://" in target:
        return True
    name, _, anchor = target.partition("#")
    path = document.parent / name if name else document
    return path.exists() and (not anchor or anchor in anchors(path.read_text(encoding="utf-8")))


def anchors(text: str) -> set[str]:
    """Return the anchors that a document's headings have where it is shown."""
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_document_names_is_there(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    assert (missing_files(text), missing_modules(text), missing_targets(text, document)) == (set(), set(), set())


def named_tests(text: str) -> list[tuple[str, str]]:
    """Return file and function of every test that a document names."""
    return re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)


def test_each_sentence_about_security_has_a_test() -> None:
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    tables = re.findall(r"^\| sentence \| test \|\n\|---\|---\|\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [row for table in tables for row in table.splitlines()]
    assert len(tables) == 5
    assert [row for row in rows if len(named_tests(row)) != 1] == []
    for file, name in named_tests(text):
        source = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^def {name}\(", source, re.MULTILINE), f"{file} has no {name}"


def test_what_is_not_there_is_found() -> None:
    text = (
        "`dctorque_can/estimators/kalman.py` `kalman_core.py` `tools/nothing --write` `config/paper_car.yaml` "
        "`chain.py` `pipeline.core_state` `bus.loop.nothing` `bus.loop.find_raw` `chain.Chain` `can.Bus` "
        "[a](output.md#nothing) [b](output.md#estimates) [c](nowhere.md) [d](https://example.org)"
    )
    assert missing_files(text) == {"dctorque_can/estimators/kalman.py", "kalman_core.py", "tools/nothing"}
    assert missing_modules(text) == {"pipeline.core_state", "bus.loop.nothing"}
    assert missing_targets(text, ROOT / "docs" / "x.md") == {"output.md#nothing", "nowhere.md"}
