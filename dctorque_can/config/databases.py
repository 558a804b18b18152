"""The DBCs that a vehicle file names, for what is received and for what is sent."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path, PurePath

from cantools.database.can import Database

from dctorque_can.bus.database import DatabaseError, DatabaseFile, joined_databases, load_with_remarks
from dctorque_can.bus.dbc_prepare import Needed
from dctorque_can.config.document import Document
from dctorque_can.config.edges import LAST_STANDARD_ID, DatabaseSection, OutputSection, OutputSettings
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import nearest, validate
from dctorque_can.pipeline.frames import EXTENDED_ID
from dctorque_can.resources import shipped_dbc

OUTPUT_DBC = "dctorque.dbc"
DATABASES: KeyPath = ("databases",)

Reader = Callable[[str], tuple[Path, bytes]]
"""Gives path and bytes of a file that the vehicle file names; raises OSError."""


class DatabaseFiles:
    """Loads the DBCs that a vehicle file names, and puts them among the documents.

    Attributes:
        channels: identifier of a message, with `EXTENDED_ID` set for a 29-bit one, to the channel that it is on;
            of the messages of `vehicle` whose database is on one.
    """

    def __init__(self, document: Document, documents: dict[str, bytes], read: Reader, among_documents: bool):
        self._document = document
        self._documents = documents
        self._read = read
        self._among_documents = among_documents
        self.channels: dict[int, int] = {}

    def vehicle(self) -> Database | None:
        """Return the messages of all DBCs; None when one of them has an error."""
        listed = self._document.value(DATABASES)
        if listed is None or listed == []:
            return None
        if not isinstance(listed, list):
            self._complain(DATABASES, "must be a list, such as [{file: my_car.dbc}]")
            return None
        needed = needed_signals(self._document)
        files = [self._file(n, item) for n, item in enumerate(listed)]
        loaded: list[tuple[Path, Database]] = []
        for key, file in filter(None, files):
            database = self._database((*DATABASES, *key), file, needed)
            if database is not None:
                loaded.append((file.path, database))
                channel = self._document.value((*DATABASES, key[0], "channel"))
                if isinstance(channel, int):
                    ids = (m.frame_id | (EXTENDED_ID if m.is_extended_frame else 0) for m in database.messages)
                    self.channels |= dict.fromkeys(ids, channel)
        if len(loaded) < len(listed):
            return None
        try:
            joined = joined_databases(loaded, needed)
        except DatabaseError as error:
            for line in str(error).splitlines():
                self._complain(DATABASES, line)
            return None
        for remark in joined.remarks:
            self._warn(DATABASES, str(remark))
        return joined.database

    def output(self, vehicle: Database | None) -> OutputSettings | None:
        """Return what is sent; None when there is an error."""
        section = validate(self._document, ("output",), OutputSection)
        if section is None:
            return None
        where: KeyPath = ("output", "database")
        if section.database is not None:
            file = self._content(where, section.database)
        elif self._among_documents and self._has(OUTPUT_DBC):
            file = self._content(where, OUTPUT_DBC)
        else:
            path = shipped_dbc(OUTPUT_DBC)
            file = DatabaseFile(path, content=path.read_bytes())
            self._documents[self._stored_name(OUTPUT_DBC)] = path.read_bytes()
        database = self._database(where, file) if file is not None else None
        if file is None or database is None:
            return None
        settings = OutputSettings(section.enabled, file.path, database, dict(section.ids))
        return settings if self._identifiers_fit(settings, vehicle) else None

    def _file(self, n: int, item: object) -> tuple[KeyPath, DatabaseFile] | None:
        """Return the key path below `databases` and the bytes of one DBC."""
        if isinstance(item, str):
            file = self._content((*DATABASES, n), item)
            return ((n,), file) if file else None
        section = validate(self._document, (*DATABASES, n), DatabaseSection)
        if section is None:
            return None
        file = self._content((*DATABASES, n, "file"), section.file, section.strict)
        return ((n, "file"), file) if file else None

    def _content(self, key: KeyPath, name: str, strict: bool = True) -> DatabaseFile | None:
        stored = self._stored_name(name)
        try:
            path, content = self._read(stored if self._among_documents else name)
        except OSError as error:
            file = stored if self._among_documents else str(self._path(name))
            self._complain(key, f"{file} cannot be read: {error.strerror}")
            return None
        self._documents[stored] = content
        return DatabaseFile(path, strict, content)

    def _has(self, name: str) -> bool:
        try:
            self._read(self._stored_name(name))
        except OSError:
            return False
        return True

    def _path(self, name: str) -> Path:
        return Path(self._document.name).parent / name

    def _stored_name(self, name: str) -> str:
        """Return the name of a DBC among the documents: its base name, numbered when that is taken.

        It depends on the text of the vehicle file only, so that `load_documents` comes to the same names.
        """
        base = PurePath(name.replace("\\", "/")).name
        stored, n = base, 1
        while stored in self._documents:
            n += 1
            stored = f"{n}-{base}"
        return stored

    def _database(self, key: KeyPath, file: DatabaseFile, needed: Needed | None = None) -> Database | None:
        try:
            loaded = load_with_remarks([file], needed)
        except DatabaseError as error:
            for line in str(error).splitlines():
                self._complain(key, line)
            for remark in error.remarks:
                self._warn(key, str(remark))
            return None
        for remark in loaded.remarks:
            self._warn(key, str(remark))
        return loaded.database

    def _identifiers_fit(self, output: OutputSettings, vehicle: Database | None) -> bool:
        """Report ids of unknown messages, ids given twice, and ids that the vehicle itself sends."""
        errors = 0
        names = [message.name for message in output.database.messages]
        for name in output.ids:
            if name not in names:
                errors += 1
                self._complain(
                    ("output", "ids", name), f"{output.path.name} has no such message{nearest(name, names)}"
                )
        taken = {_identifier(m.frame_id, m.is_extended_frame): m.name for m in vehicle.messages} if vehicle else {}
        sent: dict[tuple[int, bool], str] = {}
        for message in output.database.messages:
            given = output.ids.get(message.name)
            extended = message.is_extended_frame if given is None else given > LAST_STANDARD_ID
            identifier = _identifier(message.frame_id if given is None else given, extended)
            key = ("output", "ids", message.name)
            if identifier in sent:
                errors += 1
                self._complain(key, f"0x{identifier[0]:X} is the id of {sent[identifier]} too; give another one")
            if identifier in taken and output.enabled:
                errors += 1
                self._complain(
                    key, f"0x{identifier[0]:X} is the id of {taken[identifier]}, which the vehicle sends"
                )
            sent.setdefault(identifier, message.name)
        return errors == 0

    def _complain(self, path: KeyPath, reason: str) -> None:
        self._document.problems.append(self._document.problem(path, reason))

    def _warn(self, path: KeyPath, reason: str) -> None:
        self._document.problems.append(self._document.problem(path, reason, warning=True))


def needed_signals(document: Document) -> Needed:
    """Return the messages and signals that a vehicle file names, sound or not."""
    signals = {
        text
        for section in ("inputs", "gears", "clutch_phase")
        for text in _texts(document.value((section,)))
        if re.fullmatch(r"[^.\s]+\.[^.\s]+", text)
    }
    protection = document.value(("protection",))
    if isinstance(protection, dict):
        signals |= {f"{message}.{text}" for message, data in protection.items() for text in ("", *_texts(data))}
    return Needed(frozenset(name.partition(".")[0] for name in signals), frozenset(signals))


def _texts(value: object) -> Iterator[str]:
    """Yield every text in what stands below a key."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _texts(item)


def _identifier(frame_id: int, extended: bool) -> tuple[int, bool]:
    return frame_id, extended
