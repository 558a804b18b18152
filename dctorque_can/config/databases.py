"""The DBCs that a vehicle file names, for what is received and for what is sent."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from cantools.database.can import Database, Message

from dctorque_can.bus.addresses import address_of, identifier, is_j1939, j1939_addresses
from dctorque_can.bus.database import DatabaseError, DatabaseFile, joined_databases, load_with_remarks
from dctorque_can.bus.dbc_prepare import Needed
from dctorque_can.config.document import Document
from dctorque_can.config.edges import LAST_STANDARD_ID, DatabaseSection, OutputSection, OutputSettings
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import nearest, validate
from dctorque_can.pipeline.frames import EXTENDED_ID, Address
from dctorque_can.resources import shipped_dbc

OUTPUT_DBC = "dctorque.dbc"
DATABASES: KeyPath = ("databases",)

Reader = Callable[[str], tuple[Path, bytes]]
"""Gives path and bytes of a file that the vehicle file names; raises OSError."""


class DatabaseFiles:
    """Loads the DBCs that a vehicle file names, and puts them among the documents.

    Attributes:
        addresses: by what the frames of each message of `vehicle` are known, by its name.
    """

    def __init__(self, document: Document, documents: dict[str, bytes], read: Reader, among_documents: bool):
        self._document = document
        self._documents = documents
        self._read = read
        self._among_documents = among_documents
        self.addresses: dict[str, Address] = {}

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
        sections: list[tuple[KeyPath, DatabaseSection]] = []
        for key, file, section in filter(None, files):
            database = self._database((*DATABASES, *key), file, needed)
            if database is not None:
                loaded.append((file.path, database))
                sections.append(((*DATABASES, key[0]), section))
        faults = [self._source_faults(*each) for each in zip(sections, loaded, strict=True)]
        if len(loaded) < len(listed) or any(faults):
            return None
        try:
            joined = joined_databases(loaded, needed, [section.channel for _, section in sections])
        except DatabaseError as error:
            for line in str(error).splitlines():
                self._complain(DATABASES, line)
            return None
        for remark in joined.remarks:
            self._warn(DATABASES, str(remark))
        origin = {
            id(m): section for (_, section), (_, db) in zip(sections, loaded, strict=True) for m in db.messages
        }
        self.addresses = _addresses([(m, origin[id(m)]) for m in joined.database.messages])
        return joined.database

    def _source_faults(self, given: tuple[KeyPath, DatabaseSection], loaded: tuple[Path, Database]) -> bool:
        """Report source addresses of messages that cannot have one."""
        (key, section), (path, database) = given, loaded
        known = {message.name: message for message in database.messages}
        faults = 0
        for name in section.source_addresses:
            at = (*key, "source_addresses", name)
            if name not in known:
                self._complain(at, f"{path.name} has no such message{nearest(name, known)}")
            elif not known[name].is_extended_frame:
                self._complain(at, f"{name} has an identifier of 11 bits, so it is no message of J1939")
            elif not (section.j1939 or is_j1939(known[name])):
                self._complain(at, f"the DBC does not say that {name} is a message of J1939: add j1939: true")
            else:
                continue
            faults += 1
        return faults > 0

    def output(self, vehicle: Database | None, channel: int) -> OutputSettings | None:
        """Return what is sent on a channel; None when there is an error."""
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
        settings = OutputSettings(
            *(section.enabled, file.path, database, dict(section.ids), channel), section.foreign_silence_s
        )
        return settings if self._identifiers_fit(settings, vehicle) else None

    def _file(self, n: int, item: object) -> tuple[KeyPath, DatabaseFile, DatabaseSection] | None:
        """Return the key path below `databases`, the bytes of one DBC, and what is said of it."""
        if isinstance(item, str):
            file = self._content((*DATABASES, n), item)
            return ((n,), file, DatabaseSection(file=item)) if file else None
        section = validate(self._document, (*DATABASES, n), DatabaseSection)
        if section is None:
            return None
        file = self._content((*DATABASES, n, "file"), section.file, section.strict)
        return ((n, "file"), file, section) if file else None

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
        taken = {m.name: address_of(m, self.addresses) for m in vehicle.messages} if vehicle else {}
        sent: dict[tuple[int, bool], str] = {}
        for message in output.database.messages:
            given = output.ids.get(message.name)
            extended = message.is_extended_frame if given is None else given > LAST_STANDARD_ID
            identifier = _identifier(message.frame_id if given is None else given, extended)
            key = ("output", "ids", message.name)
            if identifier in sent:
                errors += 1
                self._complain(key, f"0x{identifier[0]:X} is the id of {sent[identifier]} too; give another one")
            sent_as = Address(identifier[0] | (EXTENDED_ID if extended else 0), channel=output.channel)
            of_vehicle = next((name for name, address in taken.items() if address.meets(sent_as)), None)
            if of_vehicle is not None and output.enabled:
                errors += 1
                self._complain(key, f"0x{identifier[0]:X} is the id of {of_vehicle}, which the vehicle sends")
            sent.setdefault(identifier, message.name)
        return errors == 0

    def _complain(self, path: KeyPath, reason: str) -> None:
        self._document.problems.append(self._document.problem(path, reason))

    def _warn(self, path: KeyPath, reason: str) -> None:
        self._document.problems.append(self._document.problem(path, reason, warning=True))


def _addresses(messages: Sequence[tuple[Message, DatabaseSection]]) -> dict[str, Address]:
    """Return by what each message is known, by name; with each what is said of its DBC."""
    found = {m.name: Address(identifier(m), channel=section.channel) for m, section in messages}
    by_number = [
        (m, section)
        for m, section in messages
        if m.is_extended_frame and (is_j1939(m) if section.j1939 is None else section.j1939)
    ]
    for channel in {section.channel for _, section in by_number}:
        here = [(m, section) for m, section in by_number if section.channel == channel]
        sources = {name: source for _, section in here for name, source in section.source_addresses.items()}
        for name, address in j1939_addresses([m for m, _ in here], sources).items():
            found[name] = replace(address, channel=channel)
    return found


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
