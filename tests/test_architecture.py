"""The rooms of the package, who may know whom, and what the core may never touch (docs/architecture.md)."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from dctorque_can.compiling.sources import COMPILED_ROOMS

PACKAGE = Path(__file__).resolve().parents[1] / "dctorque_can"
NAME = PACKAGE.name
DOCUMENT = PACKAGE.parent / "docs" / "architecture.md"

# What two columns of an estimate mean, `ClutchPhase`, is physics: its definition is a word too.
WORDS = ("pipeline.frames", "pipeline.samples", "pipeline.estimates", "driveline.phases", "plausibility.findings")
DESIGNS = ("estimators.kalman.design", "estimators.oh2014.design")
ALLOWED: dict[str, tuple[str, ...]] = {
    "driveline": (),
    "estimators": ("driveline", *WORDS),
    "plausibility": ("driveline", "estimators", *WORDS),
    "pipeline": ("plausibility", "estimators", "driveline"),
    "bus": WORDS,
    "logs": WORDS,
    "simulation": ("driveline", *WORDS, "bus"),
    "clutch_maps": WORDS,
    "config": (
        "bus",
        "clutch_maps.settings",
        *WORDS,
        "pipeline.settings",
        "driveline",
        "estimators.methods",
        *DESIGNS,
    ),
    "snapshot": (),
    "chain": ("snapshot", "bus", "pipeline", "config", "clutch_maps"),
    "analysis": WORDS,
    "daemon": ("chain", *WORDS, "bus", "logs", "config", "analysis", "clutch_maps"),
    # What plays onto a bus needs its link; the demo is the service on a simulated car.
    "offline": (
        "chain",
        "driveline",
        "estimators.methods",
        "pipeline",
        "bus",
        "logs",
        "simulation",
        "config",
        "analysis",
        "clutch_maps",
        "daemon.kept_maps",
        "daemon.wire.link",
        "daemon.log.plan",
        "daemon.service",
    ),
    "study": (
        "chain",
        "driveline",
        *WORDS,
        "simulation",
        "config",
        "analysis",
        "offline.bound",
        "offline.simulated_car",
    ),
    "design": ("driveline", "estimators", *WORDS, "pipeline.settings", "config"),
    "evidence": ("chain", "driveline", *WORDS, "bus", "logs", "config", "analysis", "offline"),
    "identify": ("chain", "driveline", *WORDS, "logs", "config", "analysis", "evidence"),
    "starter": (*WORDS, "driveline.parameters", "bus", "logs", "config.units"),
    "report": (
        *WORDS,
        "clutch_maps.rows",
        "analysis",
        "config",
        "design",
        "study",
        "evidence",
        "identify",
        "starter",
    ),
    "cli": (
        "driveline",
        "estimators",
        "plausibility",
        "pipeline",
        "bus",
        "logs",
        "simulation",
        "config",
        "analysis",
        "daemon",
        "design",
        "clutch_maps",
        "offline",
        "evidence",
        "identify",
        "study",
        "starter",
        "report",
    ),
}
"""What each room, or file at the top of the package, may know besides `FOR_ALL`."""
FOR_ALL = ("compiled", "compiling", "errors", "resources")

CORE = ("driveline", "estimators", "plausibility", "pipeline", "clutch_maps")
CORE_MODULES = {"numpy", "scipy", "numba", NAME}
CORE_STANDARD_MODULES = {
    "__future__",
    "collections",
    "dataclasses",
    "enum",
    "functools",
    "itertools",
    "math",
    "typing",
}
CORE_CALLS = {"open", "print", "input", "exec", "eval", "__import__", "breakpoint"}
CORE_TOP_FILES = {"compiled", "errors"}

ONLY_IN = {"matplotlib": ("report",), "rich": ("cli", "report"), "typer": ("cli",)}
COMPUTES = {"numpy", "scipy", "statistics", "numba"}
"""What the rooms that present have no use for; `report` hands arrays to its plots."""

NO_COMPILED_CODE = (
    "analysis",
    "chain.py",
    "clutch_maps",
    "cli",
    "config",
    "daemon",
    "design",
    "evidence",
    "identify",
    "offline",
    "report",
    "snapshot.py",
    "starter",
    "study",
)
NAMES_THAT_SAY_NOTHING = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
LONGEST_FILE = 400

FILES = sorted(PACKAGE.rglob("*.py"))


def room_of(path: Path) -> str:
    """Return the room of a file, or its own name for a file at the top of the package."""
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py")


def imported(tree: ast.AST, path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and full dotted module of every import, wherever in the file it stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:
                parents = path.relative_to(PACKAGE.parent).parts[: -node.level]
                module = ".".join([*parents, module] if module else parents)
            folder = PACKAGE.parent.joinpath(*module.split("."))
            for alias in node.names:  # `from dctorque_can.pipeline import frames` names a module too
                is_module = (folder / f"{alias.name}.py").is_file() or (folder / alias.name).is_dir()
                yield node.lineno, f"{module}.{alias.name}" if is_module else module


def may_import(room: str, module: str) -> bool:
    """Tell whether a file of ``room`` may import ``module`` of this package."""
    inner = module.removeprefix(NAME).removeprefix(".")
    target = inner.split(".")[0]
    if room not in ALLOWED:  # a file at the top of the package that is for all
        return target in ("", *FOR_ALL)
    if target in ("", room):
        return True
    if target in FOR_ALL:
        return room not in CORE or target in CORE_TOP_FILES
    return any(inner == allowed or inner.startswith(f"{allowed}.") for allowed in ALLOWED[room])


def violations(source: str, path: Path) -> list[str]:
    """Return what a file does against the rules, one line each."""
    tree = ast.parse(source)
    room = room_of(path)
    imports = list(imported(tree, path))
    found = []
    for line, module in imports:
        top = module.split(".")[0]
        if top == NAME:
            if not may_import(room, module):
                found.append(f"{path}:{line}: {room} may not know {module}")
        elif room in CORE and top not in CORE_MODULES | CORE_STANDARD_MODULES:
            found.append(f"{path}:{line}: the core may not import {module}")
        elif room not in ONLY_IN.get(top, (room,)):
            found.append(f"{path}:{line}: {module} is for {' and '.join(ONLY_IN[top])}")
        elif (room == "cli" and top in COMPUTES) or (room == "report" and top in COMPUTES - {"numpy"}):
            found.append(f"{path}:{line}: {room} computes nothing, so it may not import {module}")
    if room in CORE:
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CORE_CALLS:
                found.append(f"{path}:{node.lineno}: the core may not call {node.func.id}()")
            if isinstance(node, ast.Attribute) and node.attr == "random":
                found.append(f"{path}:{node.lineno}: the core may not draw random numbers")
    if path.relative_to(PACKAGE).parts[0] in NO_COMPILED_CODE and any(
        module == f"{NAME}.compiled" for _, module in imports
    ):
        found.append(f"{path}: compiled code has no place in {room} (see compiling/sources.py)")
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_file_keeps_to_its_room(path: Path) -> None:
    assert violations(path.read_text(encoding="utf-8"), path) == []


def test_every_room_has_a_rule() -> None:
    rooms = {room_of(path) for path in FILES} - {*FOR_ALL, "__init__"}
    assert rooms == set(ALLOWED)


def documented() -> dict[str, set[str]]:
    """Return what each room may know as the table of docs/architecture.md has it."""
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in text.split("## Rooms")[1].split("\n\n**")[0].splitlines()]
    found = {}
    for room, _, known in (row for row in rows if len(row) == 3 and row[0].startswith("| `")):
        name = room.strip("| `")
        found[name] = set(re.findall(r"`([\w.]+)`", known))
        if "the words" in known:
            found[name] |= set(WORDS)
        if "every other folder" in known:
            found[name] |= set(ALLOWED) - {name, "chain", "snapshot"}
    return found


def test_the_document_tells_the_same() -> None:
    assert documented() == {room: set(known) for room, known in ALLOWED.items()}
    named = DOCUMENT.read_text(encoding="utf-8").split("**The words**")[1].split("\n\n")[0]
    assert set(re.findall(r"`([\w.]+)`", named)) == set(WORDS)


def test_compiled_code_depends_on_exactly_the_rooms_that_compile() -> None:
    rooms = {path.relative_to(PACKAGE).parts[0] for path in FILES} - {f"{NAME}.py", "__init__.py"}
    for_all = {"compiled.py", "compiling", "errors.py", "resources.py"}
    assert set(COMPILED_ROOMS) == rooms - for_all - set(NO_COMPILED_CODE)


def test_files_have_one_reason_and_a_name_that_says_it() -> None:
    lengths = {str(path): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert {path: lines for path, lines in lengths.items() if lines > LONGEST_FILE} == {}
    assert [path for path in FILES if NAMES_THAT_SAY_NOTHING & {path.stem, *path.relative_to(PACKAGE).parts}] == []


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("driveline/x.py", "from dctorque_can.pipeline.frames import Frames"),
        ("driveline/x.py", "from ..pipeline import frames"),
        ("estimators/x.py", "import time"),
        ("estimators/x.py", "def f():\n    import can.message"),
        ("pipeline/x.py", "from dctorque_can import bus"),
        ("pipeline/x.py", "from dctorque_can import resources"),
        ("pipeline/x.py", "open('x')"),
        ("pipeline/x.py", "import numpy as np\nnp.random.default_rng()"),
        ("bus/x.py", "from dctorque_can.pipeline.estimator import Estimator"),
        ("logs/x.py", "import dctorque_can.bus.decoder"),
        ("logs/mcap/x.py", "from dctorque_can.config import model"),
        ("simulation/x.py", "from dctorque_can.estimators import methods"),
        ("config/x.py", "from dctorque_can.estimators.oh2014.observer import step"),
        ("daemon/x.py", "from dctorque_can.cli import main"),
        ("daemon/x.py", "from dctorque_can.offline import replay"),
        ("daemon/x.py", "from dctorque_can.simulation import plant"),
        ("offline/x.py", "from dctorque_can.daemon.output.publisher import Publisher"),
        ("pipeline/x.py", "from dctorque_can.chain import Chain"),
        ("pipeline/x.py", "from dctorque_can.compiling import watch"),
        ("chain.py", "from dctorque_can.daemon.service import Service"),
        ("cli/x.py", "from dctorque_can.compiled import compiled"),
        ("cli/x.py", "def f():\n    import numpy as np"),
        ("report/x.py", "from statistics import mean"),
        ("report/x.py", "from dctorque_can.offline.replay import replay_logs"),
        ("analysis/x.py", "from matplotlib.figure import Figure"),
        ("analysis/x.py", "from dctorque_can.report import torque_table"),
        ("analysis/x.py", "from dctorque_can.logs import reader"),
        ("offline/x.py", "from rich.table import Table"),
        ("errors.py", "from dctorque_can.logs import reader"),
    ],
)
def test_the_rules_catch(file: str, source: str) -> None:
    assert len(violations(source, PACKAGE / file)) == 1


@pytest.mark.parametrize(
    ("file", "source"),
    [
        (
            "estimators/x.py",
            "import math\nimport numpy as np\nfrom dctorque_can.driveline.parameters import Vehicle",
        ),
        ("pipeline/x.py", "from .frames import Frames\nfrom dctorque_can.compiled import compiled"),
        ("config/x.py", "from dctorque_can.estimators.oh2014.design import Oh2014Design"),
        ("simulation/x.py", "from dctorque_can.pipeline import frames\nimport random"),
    ],
)
def test_the_rules_allow(file: str, source: str) -> None:
    assert violations(source, PACKAGE / file) == []
