"""Where the vehicle files and DBCs that ship with the package are found."""

from __future__ import annotations

from pathlib import Path

from dctorque_can.errors import DctorqueError

_PACKAGE = Path(__file__).resolve().parent
_INSTALLED = _PACKAGE / "shipped"


def _root() -> Path:
    """Return the directory with ``config/`` and ``dbc/``: inside an installed wheel, else the source tree."""
    return _INSTALLED if _INSTALLED.is_dir() else _PACKAGE.parent


def _shipped(directory: str, name: str, suffix: str) -> Path:
    path = _root() / directory / (name if name.endswith(suffix) else name + suffix)
    if not path.is_file():
        have = ", ".join(sorted(p.stem for p in path.parent.glob("*" + suffix))) or "nothing"
        raise DctorqueError(f"{path}: no such file ships with dctorque; there is: {have}")
    return path


def shipped_config(name: str) -> Path:
    """Return the path of the shipped vehicle file ``name`` ("paper_car" or "paper_car.yaml").

    Raises:
        DctorqueError: no such file ships; the message names those that do.
    """
    return _shipped("config", name, ".yaml")


def shipped_dbc(name: str) -> Path:
    """Return the path of the shipped DBC ``name`` ("dctorque" or "dctorque.dbc").

    Raises:
        DctorqueError: no such file ships; the message names those that do.
    """
    return _shipped("dbc", name, ".dbc")


def shipped_configs() -> list[Path]:
    """Return the paths of all shipped vehicle files, sorted by name."""
    return sorted((_root() / "config").glob("*.yaml"))


def shipped_studies() -> list[Path]:
    """Return the paths of all shipped studies, sorted by name."""
    return sorted((_root() / "config" / "studies").glob("*.yaml"))


def shipped_class(name: str) -> Path:
    """Return the path of the shipped class of cars ``name`` ("compact_dct7_dry").

    Raises:
        DctorqueError: no such class ships; the message names those that do.
    """
    return _shipped("config/classes", name, ".yaml")


def shipped_classes() -> list[Path]:
    """Return the paths of all shipped classes of cars, sorted by name."""
    return sorted((_root() / "config" / "classes").glob("*.yaml"))


def find_config(text: str | Path, folder: Path = Path()) -> Path:
    """Return ``text`` as a path below ``folder``, or else the shipped vehicle file of that bare name."""
    return _find(text, folder, shipped_configs())


def find_study(text: str | Path) -> Path:
    """Return ``text`` as a path, or the shipped study of that bare name when no such file exists here."""
    return _find(text, Path(), shipped_studies())


def _find(text: str | Path, folder: Path, shipped: list[Path]) -> Path:
    path = folder / text
    if not path.exists() and Path(text).name == str(text):
        for known in shipped:
            if str(text) in (known.name, known.stem):
                return known
    return path
