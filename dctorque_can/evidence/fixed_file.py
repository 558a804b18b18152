"""The vehicle file with all that is certain corrected: the user's own text, with a comment at each change."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dctorque_can.config.document import parse
from dctorque_can.config.load import Config
from dctorque_can.errors import DctorqueError
from dctorque_can.evidence.findings import Finding
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.yaml_edits import Edit, edited, old_value

_LONGEST = 110  # characters of a comment


@dataclass(frozen=True, slots=True)
class Fixed:
    """A corrected vehicle file.

    Attributes:
        path: where it was written.
        changes: what was changed.
        left: findings whose correction is not certain: they are still in the file.
    """

    path: Path
    changes: list[Edit]
    left: list[Finding]


def write_fixed(config: Config, findings: Sequence[Finding], path: Path, force: bool = False) -> Fixed:
    """Write a vehicle file with the corrections of findings.

    Args:
        config: of the file as it is.
        findings: of it; hints are left.
        path: of the new file.
        force: whether an existing file is overwritten.

    Raises:
        DctorqueError: it is the file itself or exists, or it cannot be written.
    """
    if path.resolve() == config.path.resolve():
        raise DctorqueError(f"{path}: is the vehicle file itself, which stays as it is: name another file")
    if path.exists() and not force:
        raise DctorqueError(f"{path}: exists already: name another file, or add --force")
    text = config.documents[config.path.name].decode("utf-8-sig")
    changes: dict[str, Edit] = {}
    left = []
    for finding in findings:
        if finding.severity == "hint":
            continue
        if not finding.fix:
            left.append(finding)
        reasons = [(key, value, f"check --log {_reason(finding, key)}") for key, value in finding.fix]
        reasons += [(key, value, f"grows with {finding.key}, all are relative") for key, value in finding.also]
        for key, value, reason in reasons:
            was = old_value(text, key)
            comment = textwrap.shorten(f"{'was ' + was if was else 'added'}: {reason}", _LONGEST, placeholder=" …")
            changes.setdefault(key, Edit(key, value, comment))
    try:
        path.write_text(edited(text, [*changes.values(), *_moved_paths(config, path)]), encoding="utf-8")
    except OSError as error:
        raise DctorqueError(f"{path}: cannot be written: {error.strerror}") from error
    return Fixed(path, list(changes.values()), left)


def _reason(finding: Finding, key: str) -> str:
    """Return what was measured, for a comment."""
    if finding.key == key and finding.value is not None and finding.sigma is not None:
        return f"measured {Number(finding.value, finding.sigma, 0.0).shown()}"
    return f"says: {finding.text}"


def _moved_paths(config: Config, path: Path) -> list[Edit]:
    """Return what files are named from another folder."""
    here, there = config.path.parent.resolve(), path.parent.resolve()
    if here == there:
        return []
    document = parse(config.documents[config.path.name], config.path.name)
    keys = {"output.database": document.value(("output", "database"))}
    for n, entry in enumerate(document.data.get("databases", ())):
        named = isinstance(entry, dict)
        keys[f"databases.{n}.file" if named else f"databases.{n}"] = entry.get("file") if named else entry
    return [
        Edit(key, Path(os.path.relpath(here / name, there)).as_posix(), f"was {name}: seen from this folder")
        for key, name in keys.items()
        if isinstance(name, str) and not Path(name).is_absolute()
    ]
