"""Loading of DBC files, with errors that lead to the line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import InvalidOperation
from pathlib import Path

import cantools
from cantools.database.can import Database, Message

from dctorque_can.errors import DctorqueError


@dataclass(frozen=True, slots=True)
class DatabaseFile:
    """One DBC file.

    Attributes:
        path: where it is; also its name in error messages.
        strict: refuse overlapping signals and signals outside their message.
        content: the bytes of the file when they are already at hand (from a log), else None.
    """

    path: Path
    strict: bool = True
    content: bytes | None = None


class DatabaseError(DctorqueError):
    """A DBC cannot be loaded, or several contradict each other."""


def load_database(files: Sequence[DatabaseFile]) -> Database:
    """Load DBC files into one database.

    Args:
        files: DBCs, whose messages may repeat each other only when they are equal.

    Raises:
        DatabaseError: a file is missing or is no DBC, or two messages of different files share a name or an
            identifier. Every faulty file has its line in the message.
    """
    databases: list[tuple[Path, Database]] = []
    faults: list[str] = []
    for file in files:
        try:
            databases.append((file.path, _load(file)))
        except DatabaseError as error:
            faults.append(str(error))
    messages, conflicts = _merge(databases)
    if faults or conflicts:
        raise DatabaseError("\n".join(faults + conflicts))
    if len(databases) == 1:
        return databases[0][1]
    nodes = {node.name: node for _, database in databases for node in database.nodes}
    return Database(
        messages=messages, nodes=list(nodes.values()), strict=False
    )  # each was checked as strictly as asked


def _load(file: DatabaseFile) -> Database:
    try:
        content = file.path.read_bytes() if file.content is None else file.content
    except OSError as error:
        raise DatabaseError(f"{file.path}: cannot be read: {error.strerror}") from error
    text = content.decode("cp1252", errors="replace")  # the encoding that cantools assumes for DBC files
    database, reason = _parse(text, file.strict)
    if database is None:
        line = _line_of(reason, text)
        place = f"{file.path}:{line}" if line else f"{file.path}"
        hint = ""
        if file.strict and _parse(text, strict=False)[0] is not None:
            hint = "; it loads with `strict: false`"
        elif not re.search(r"^\s*BO_\s", text, re.MULTILINE):
            hint = "; is this a DBC file?"
        raise DatabaseError(f"{place}: {reason}{hint}")
    if not database.messages:
        raise DatabaseError(f"{file.path}: holds no message")
    return database


def _parse(text: str, strict: bool) -> tuple[Database | None, str]:
    try:
        database = cantools.database.load_string(text, "dbc", strict=strict)
    except cantools.Error as error:
        # cantools wraps whatever its loader raised; a missing definition is a bare KeyError
        cause = getattr(error, "e_dbc", None) or error
        if isinstance(cause, KeyError):
            return None, f"{cause} is used but not defined"
        if isinstance(cause, InvalidOperation):
            return None, "a number is expected where there is none"
        return None, " ".join(str(cause).split()).rstrip(".") or type(cause).__name__
    assert isinstance(database, Database)
    return database, ""


def _line_of(reason: str, text: str) -> int:
    """Return the line that cantools' reason points at, 0 when it tells nothing that can be found."""
    stated = re.search(r"\bline (\d+)", reason)
    if stated:
        return int(stated.group(1))
    message = re.search(r"in message (\w+)", reason)
    signal = re.search(r"[Tt]he signals? (\w+)", reason)
    undefined = re.match(r"'([^']+)' is used but not defined|.*?VAL_ \d+ (\w+)", reason)
    start = 0
    if message:
        found = re.search(rf"^\s*BO_\s+\d+\s+{message.group(1)}\s*:", text, re.MULTILINE)
        start = found.start() if found else 0
    if signal:
        pattern = rf"^\s*SG_\s+{signal.group(1)}\s"
    elif message:
        pattern = rf"^\s*BO_\s+\d+\s+{message.group(1)}\s*:"
    elif undefined:
        pattern = rf"^.*\b{re.escape(undefined.group(1) or undefined.group(2))}\b"
    else:
        return 0
    place = re.compile(pattern, re.MULTILINE).search(text, start)
    if place is None:
        return 0
    return text.count("\n", 0, place.end()) + 1


def _merge(databases: Sequence[tuple[Path, Database]]) -> tuple[list[Message], list[str]]:
    """Return the messages of all files, and a line for each that contradicts one of an earlier file."""
    messages: list[Message] = []
    earlier: dict[object, tuple[Path, Message]] = {}
    conflicts: list[str] = []
    for path, database in databases:
        added: dict[object, tuple[Path, Message]] = {}
        for message in database.messages:
            identifier = (message.frame_id, message.is_extended_frame)
            found = earlier.get(message.name) or earlier.get(identifier)
            if found is None:
                messages.append(message)
                added[message.name] = added[identifier] = (path, message)
            elif _definition(found[1]) != _definition(message):
                conflicts.append(
                    f"{path}: message {message.name} (id 0x{message.frame_id:X}) contradicts "
                    f"{found[1].name} (id 0x{found[1].frame_id:X}) of {found[0]}; leave one of them out"
                )
        earlier |= added
    return messages, conflicts


def _definition(message: Message) -> tuple[object, ...]:
    signals = [
        (
            *(s.name, s.start, s.length, s.byte_order, s.is_signed, s.is_float, s.scale, s.offset, s.unit),
            *(s.is_multiplexer, s.multiplexer_signal, tuple(s.multiplexer_ids or ())),
        )
        for s in message.signals
    ]
    return message.name, message.frame_id, message.is_extended_frame, message.length, signals
