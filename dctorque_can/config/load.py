"""A vehicle file, from bytes to everything the service needs; all its errors at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TypeVar

import yaml
from cantools.database.can import Database

from dctorque_can.bus.database import DatabaseError, DatabaseFile, load_database
from dctorque_can.config.build import Parts, build_parts
from dctorque_can.config.document import Document, parse
from dctorque_can.config.edges import (
    LAST_STANDARD_ID,
    CanSection,
    DatabaseSection,
    LoggingSection,
    OutputSection,
    OutputSettings,
)
from dctorque_can.config.inputs import InputEntry
from dctorque_can.config.overrides import apply_overrides
from dctorque_can.config.problems import ConfigError, KeyPath, Problem
from dctorque_can.config.section import Section, absent, nearest, problem_order, validate
from dctorque_can.pipeline.samples import Input, Protection
from dctorque_can.pipeline.settings import Settings
from dctorque_can.resources import shipped_dbc

__all__ = ["Config", "ConfigError", "Problem", "load_config", "load_documents"]

S = TypeVar("S", bound=Section)

OUTPUT_DBC = "dctorque.dbc"
OVERRIDES_SUFFIX = ".overrides.yaml"
DATABASES: KeyPath = ("databases",)
SECTIONS = {
    "name": "a name for the vehicle",
    "vehicle": "the physical parameters of the vehicle",
    "databases": "the DBC files, such as [{file: my_car.dbc}]",
    "inputs": "which signals are measured",
    "gears": "where the gears come from: source: signals or ratio",
    "clutch_phase": "what tells whether a clutch is open: source: position, flag or command",
}
OPTIONAL_SECTIONS = ("protection", "estimator", "can", "output", "logging")

Reader = Callable[[str], tuple[Path, bytes]]
"""Gives path and bytes of a file that the YAML names; raises OSError."""


@dataclass(frozen=True, slots=True)
class Config:
    """Everything that one vehicle file says.

    Attributes:
        path: the file; only its name when it came out of a log.
        name: name of the vehicle.
        settings: of the estimator core.
        protections: of received messages.
        database: the messages of all DBCs.
        can: the bus; ``can.arguments()`` goes to ``can.Bus``.
        output: the messages that are sent.
        logging: the log.
        documents: vehicle file, DBCs and overrides as they were loaded; `load_documents` reads them again.
        entries: the inputs with their keys, units and periods, for people.
        warnings: what is doubtful but usable.
    """

    path: Path
    name: str
    settings: Settings
    protections: tuple[Protection, ...]
    database: Database
    can: CanSection
    output: OutputSettings
    logging: LoggingSection
    documents: dict[str, bytes]
    entries: tuple[InputEntry, ...]
    warnings: tuple[Problem, ...]

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs of the decoder."""
        return self.settings.inputs


def load_config(path: str | Path, overrides: Mapping[str, str] | None = None) -> Config:
    """Load a vehicle file.

    Args:
        path: YAML file; files that it names are relative to it.
        overrides: dotted key to value as written in YAML, laid over the file: ``{"can.channel": "vcan0"}``.

    Raises:
        ConfigError: with every error of the file.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        near = sorted(str(p) for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
        hint = nearest(str(path), near) if near else ""
        reason = f"cannot be read: {error.strerror}{hint}"
        raise ConfigError([Problem(str(path), 0, "", "", reason)]) from error

    def read(name: str) -> tuple[Path, bytes]:
        file = path.parent / name
        return file, file.read_bytes()

    return _load(path, content, dict(overrides or {}), read)


def load_documents(documents: Mapping[str, bytes], overrides: Mapping[str, str] | None = None) -> Config:
    """Load a vehicle file and its DBCs from memory, as a log carries them (`Config.documents`).

    Args:
        documents: content by name, with the overrides that it was loaded with.
        overrides: dotted key to value as written in YAML, laid over those.

    Raises:
        ConfigError: there is not exactly one vehicle file, a DBC is missing, or the file has errors.
    """
    names = [n for n in documents if n.endswith((".yaml", ".yml")) and not n.endswith(OVERRIDES_SUFFIX)]
    if len(names) != 1:
        found = f"{len(names)} vehicle files ({', '.join(names)})" if names else "no vehicle file (.yaml)"
        raise ConfigError(
            [Problem("documents", 0, "", "", f"{found} among {len(documents)} documents; one is right")]
        )
    (name,) = names
    laid_over: dict[str, str] = {}
    laid = PurePath(name).stem + OVERRIDES_SUFFIX
    if laid in documents:
        stored = parse(documents[laid], laid)
        if stored.problems:
            raise ConfigError(stored.problems)
        laid_over = {str(key): str(value) for key, value in stored.data.items()}
    laid_over |= overrides or {}

    def read(wanted: str) -> tuple[Path, bytes]:
        if wanted not in documents:
            raise FileNotFoundError(2, f"is not among the documents{nearest(wanted, documents)}")
        return Path(wanted), documents[wanted]

    return _load(Path(name), documents[name], laid_over, read, among_documents=True)


def _load(
    path: Path, content: bytes, overrides: dict[str, str], read: Reader, *, among_documents: bool = False
) -> Config:
    document = parse(content, str(path))
    if document.data:
        apply_overrides(document, overrides)
        _check_sections(document)
    if not document.data:
        raise ConfigError(document.problems)
    documents = {path.name: content}
    if overrides:
        documents[path.stem + OVERRIDES_SUFFIX] = _quoted(overrides)
    files = _DatabaseFiles(document, documents, read, among_documents)
    database = files.vehicle()
    parts = build_parts(document, database)
    can = validate(document, ("can",), CanSection)
    logging = validate(document, ("logging",), LoggingSection)
    output = files.output(database)
    problems = sorted(document.problems, key=problem_order)
    sound = parts is not None and database is not None and can and logging and output
    if not sound or any(problem.severity == "error" for problem in problems):
        raise ConfigError(problems)
    assert isinstance(parts, Parts)
    assert database is not None
    assert can is not None
    assert logging is not None
    assert output is not None
    return Config(
        path=path,
        name=str(document.data["name"]),
        settings=parts.settings,
        protections=parts.protections,
        database=database,
        can=can,
        output=output,
        logging=logging,
        documents=documents,
        entries=parts.entries,
        warnings=tuple(problems),
    )


def _quoted(overrides: dict[str, str]) -> bytes:
    """Return the overrides as YAML whose every value is read back as text."""
    return yaml.safe_dump(overrides, sort_keys=False, default_style='"', width=10_000).encode()


def _check_sections(document: Document) -> None:
    """Report unknown and missing keys at the top of the file."""
    known = (*SECTIONS, *OPTIONAL_SECTIONS)
    for key in document.data:
        if key not in known:
            document.problems.append(document.problem((key,), "unknown section" + nearest(str(key), known)))
    for key, what in SECTIONS.items():
        if absent(document.data.get(key)):
            document.problems.append(document.problem((key,), f"missing: {what}"))
    name = document.data.get("name")
    if name is not None and not (isinstance(name, str) and name.strip()):
        document.problems.append(document.problem(("name",), "must be text"))


class _DatabaseFiles:
    """Loads the DBCs that a vehicle file names, and puts them among the documents."""

    def __init__(self, document: Document, documents: dict[str, bytes], read: Reader, among_documents: bool):
        self._document = document
        self._documents = documents
        self._read = read
        self._among_documents = among_documents

    def vehicle(self) -> Database | None:
        """Return the messages of all DBCs; None when one of them has an error."""
        listed = self._document.value(DATABASES)
        if listed is None or listed == []:
            return None
        if not isinstance(listed, list):
            self._complain(DATABASES, "must be a list, such as [{file: my_car.dbc}]")
            return None
        files = [self._file(n, item) for n, item in enumerate(listed)]
        loadable = [file for file in files if file is not None and self._loads((*DATABASES, *file[0]), file[1])]
        if len(loadable) < len(listed):
            return None
        try:
            return load_database([file for _, file in loadable])
        except DatabaseError as error:
            for line in str(error).splitlines():
                self._complain(DATABASES, line)
            return None

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
        if file is None or not self._loads(where, file):
            return None
        settings = OutputSettings(section.enabled, file.path, load_database([file]), dict(section.ids))
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

    def _loads(self, key: KeyPath, file: DatabaseFile) -> bool:
        try:
            load_database([file])
        except DatabaseError as error:
            for line in str(error).splitlines():
                self._complain(key, line)
            return False
        return True

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


def _identifier(frame_id: int, extended: bool) -> tuple[int, bool]:
    return frame_id, extended
