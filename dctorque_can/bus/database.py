"""Loading of DBC files, with errors and remarks that lead to the line.

A file that cantools takes as it is goes no other way. One that it refuses is prepared for it (`bus.dbc_prepare`):
what is not needed never costs the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from cantools.database.can import Database, Message

from dctorque_can.bus.dbc_prepare import STRICT_HINT, Needed, Prepared, prepare
from dctorque_can.bus.dbc_text import decoded
from dctorque_can.bus.dbc_trial import line_of, lines_of, parse
from dctorque_can.errors import DctorqueError

MOST_LEFT_OUT_BY_LINE = 20
"""Statements that are left out because cantools names their line in the prepared text."""


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


@dataclass(frozen=True, slots=True)
class Remark:
    """What was left out of a DBC, or read otherwise than it stands there.

    Attributes:
        path: the file.
        line: 1-based, 0 when it is about no line.
        reason: what and why.
    """

    path: Path
    line: int
    reason: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.reason}" if self.line else f"{self.path}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Loaded:
    """A database, and what was remarkable about its files."""

    database: Database
    remarks: tuple[Remark, ...] = ()


class DatabaseError(DctorqueError):
    """A DBC cannot be loaded, or several contradict each other.

    Attributes:
        remarks: what is remarkable about the files beside that.
    """

    def __init__(self, message: str, remarks: Sequence[Remark] = ()) -> None:
        super().__init__(message)
        self.remarks = tuple(remarks)


def load_database(files: Sequence[DatabaseFile], needed: Needed | None = None) -> Database:
    """Load DBC files into one database; as `load_with_remarks`, without the remarks."""
    return load_with_remarks(files, needed).database


def load_with_remarks(files: Sequence[DatabaseFile], needed: Needed | None = None) -> Loaded:
    """Load DBC files into one database.

    Args:
        files: DBCs, whose messages may repeat each other only when they are equal.
        needed: what must be right. Anything else that is broken is left out, with a remark. None: every message.

    Raises:
        DatabaseError: a file is missing or is no DBC, something that is needed is broken, or two messages of
            different files share a name or an identifier. Every fault has its line in the message.
    """
    databases: list[tuple[Path, Database]] = []
    faults: list[str] = []
    remarks: list[Remark] = []
    for file in files:
        try:
            loaded = _load(file, needed)
        except DatabaseError as error:
            faults.append(str(error))
            remarks += error.remarks
            continue
        databases.append((file.path, loaded.database))
        remarks += loaded.remarks
    try:
        joined = joined_databases(databases, needed)
    except DatabaseError as error:
        raise DatabaseError("\n".join([*faults, str(error)]), [*remarks, *error.remarks]) from None
    if faults:
        raise DatabaseError("\n".join(faults), [*remarks, *joined.remarks])
    return Loaded(joined.database, (*remarks, *joined.remarks))


def joined_databases(
    databases: Sequence[tuple[Path, Database]],
    needed: Needed | None = None,
    channels: Sequence[int | None] | None = None,
) -> Loaded:
    """Join databases into one.

    Args:
        databases: each with the path of its file. A message may be in several only if all say the same.
        needed: other messages are left out where they contradict, with a remark. None: all are needed.
        channels: that each database is on, None for any. One identifier on two channels is no contradiction.

    Raises:
        DatabaseError: two messages contradict each other.
    """
    remarks: list[Remark] = []
    messages, conflicts = _merge(databases, needed, remarks, channels or [None] * len(databases))
    if conflicts:
        raise DatabaseError("\n".join(conflicts), remarks)
    if len(databases) == 1:
        return Loaded(databases[0][1])
    nodes = {node.name: node for _, database in databases for node in database.nodes}
    joined = Database(messages=messages, nodes=list(nodes.values()), strict=False)
    return Loaded(joined, tuple(remarks))  # each was checked as strictly as asked


def _load(file: DatabaseFile, needed: Needed | None) -> Loaded:
    try:
        content = file.path.read_bytes() if file.content is None else file.content
    except OSError as error:
        raise DatabaseError(f"{file.path}: cannot be read: {error.strerror}") from error
    text = decoded(content)
    database, reason = parse(text, file.strict)
    remarks: list[Remark] = []
    if database is None:
        if not re.search(r"^\s*BO_\s", text, re.MULTILINE):
            line = line_of(reason, text)
            place = f"{file.path}:{line}" if line else f"{file.path}"
            raise DatabaseError(f"{place}: {reason}; is this a DBC file?")
        prepared = prepare(text, file.strict, needed)
        database, reason = _parse_prepared(prepared, file.strict, needed)
        remarks = [Remark(file.path, line, remark) for line, remark in prepared.remarks]
        if prepared.errors or database is None:
            if database is None and not prepared.errors:
                line = line_of(reason, prepared.text)
                lax = file.strict and parse(prepared.text, strict=False)[0] is not None
                prepared.errors.append((line, reason + (f"; {STRICT_HINT}" if lax else "")))
            errors = [str(Remark(file.path, line, error)) for line, error in prepared.errors]
            raise DatabaseError("\n".join(errors), remarks)
        _rename(database, prepared.names)
    if not database.messages:
        raise DatabaseError(f"{file.path}: holds no message", remarks)
    remarks += _doubles(file.path, text, database.messages)
    return Loaded(database, tuple(remarks))


def _parse_prepared(prepared: Prepared, strict: bool, needed: Needed | None) -> tuple[Database | None, str]:
    """Parse a prepared text; what cantools refuses only now and nobody needs is left out as well."""
    if prepared.errors:
        return None, ""
    if not prepared.text.strip():
        return Database(), ""
    for _ in range(MOST_LEFT_OUT_BY_LINE):
        database, reason = parse(prepared.text, strict)
        if database is not None:
            return database, ""
        lines = prepared.text.split("\n")
        at = [line for line in lines_of(reason, prepared.text) if _can_go(lines[line - 1])]
        if not at:
            return None, reason
        for line in at:
            prepared.remarks.append((line, f"{reason}; it is left out"))
            lines[line - 1] = ""
        prepared.text = "\n".join(lines)
    return None, reason


def _doubles(path: Path, text: str, messages: Sequence[Message]) -> list[Remark]:
    """Return a remark for each message that differs from another one of its name or identifier."""
    found: list[Remark] = []
    earlier: dict[object, Message] = {}
    for message in messages:
        identifier = (message.frame_id, message.is_extended_frame)
        other = earlier.get(message.name) or earlier.get(identifier)
        if other is not None and _definition(other) != _definition(message):
            lines = [text.count("\n", 0, each.start()) + 1 for each in _named(message.name, text)]
            what = f"{message.name} (id 0x{message.frame_id:X}) and {other.name} (id 0x{other.frame_id:X})"
            found.append(Remark(path, lines[-1] if lines else 0, f"{what} share a name or an identifier"))
        earlier.setdefault(message.name, message)
        earlier.setdefault(identifier, message)
    return found


def _named(name: str, text: str) -> Iterator[re.Match[str]]:
    """Yield where messages of a name begin."""
    return re.finditer(rf"^[ \t]*BO_\s+\d+\s+{re.escape(name)}\s*:", text, re.MULTILINE)


def _can_go(line: str) -> bool:
    """Return whether a line is a whole statement that no message needs to be read."""
    whole = re.match(
        r"\s*(CM_|BA_|BA_DEF_|BA_DEF_DEF_|VAL_|VAL_TABLE_|SIG_GROUP_|BO_TX_BU_|EV_)[\s\"].*;\s*$", line
    )
    return whole is not None


def _rename(database: Database, names: dict[str, str]) -> None:
    """Give messages and signals the names back that cantools could not read."""
    if not names:
        return
    for message in database.messages:
        message.name = names.get(message.name, message.name)
        for signal in message.signals:
            signal.name = names.get(signal.name, signal.name)
            if signal.multiplexer_signal is not None:
                signal.multiplexer_signal = names.get(signal.multiplexer_signal, signal.multiplexer_signal)
        message.refresh()
    database.refresh()


def _merge(
    databases: Sequence[tuple[Path, Database]],
    needed: Needed | None,
    remarks: list[Remark],
    channels: Sequence[int | None],
) -> tuple[list[Message], list[str]]:
    """Return the messages of all files, and a line for each needed one that contradicts one of an earlier file."""
    messages: list[Message] = []
    earlier: dict[object, tuple[Path, Message]] = {}
    channel_of: dict[str, int | None] = {}
    conflicts: list[str] = []
    for (path, database), channel in zip(databases, channels, strict=True):
        added: dict[object, tuple[Path, Message]] = {}
        others = {None, channel} if channel is not None else {None, *channels}
        for message in database.messages:
            identifier = (message.frame_id, message.is_extended_frame)
            same = [earlier.get(message.name), *(earlier.get((*identifier, other)) for other in others)]
            found = next(filter(None, same), None)
            if found is None:
                messages.append(message)
                added[message.name] = added[*identifier, channel] = (path, message)
                channel_of[message.name] = channel
            elif _definition(found[1]) != _definition(message):
                contradiction = (
                    f"message {message.name} (id 0x{message.frame_id:X}) contradicts "
                    f"{found[1].name} (id 0x{found[1].frame_id:X}) of {found[0]}"
                )
                if needed is None or {message.name, found[1].name} & needed.messages:
                    conflicts.append(f"{path}: {contradiction}; leave one of them out")
                else:
                    remarks.append(Remark(path, 0, f"{contradiction}; it is left out, no input comes from it"))
            elif needed is not None and message.name in needed.messages and channel_of[message.name] != channel:
                where = channel_of[message.name]
                taken = "any channel" if where is None else f"channel {where}"
                reason = (
                    f"{message.name} is taken from {taken} already, as {found[0].name} says; for an input from "
                )
                remarks.append(Remark(path, 0, reason + "another channel give channel: to that input"))
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
