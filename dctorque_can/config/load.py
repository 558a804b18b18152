"""A vehicle file, from bytes to everything the service needs; all its errors at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import yaml
from cantools.database.can import Database

from dctorque_can.clutch_maps.settings import MapSettings
from dctorque_can.config.build import Parts, build_parts
from dctorque_can.config.buses import output_channel, read_buses
from dctorque_can.config.clutch_map import ClutchMapSection, StateSection, map_settings
from dctorque_can.config.databases import DatabaseFiles, Reader
from dctorque_can.config.document import Document, parse
from dctorque_can.config.edges import CanSection, LoggingSection, OutputSettings, StatusSection
from dctorque_can.config.input_builder import InputEntry
from dctorque_can.config.overrides import apply_overrides
from dctorque_can.config.problems import ConfigError, Problem
from dctorque_can.config.section import absent, nearest, problem_order, validate
from dctorque_can.config.vehicle_class import class_sigmas, take_class, take_sigmas
from dctorque_can.pipeline.frames import Address
from dctorque_can.pipeline.samples import Input, Protection
from dctorque_can.pipeline.settings import Settings

__all__ = ["Config", "ConfigError", "Problem", "load_config", "load_documents"]

OVERRIDES_SUFFIX = ".overrides.yaml"
SECTIONS = {
    "name": "a name for the vehicle",
    "vehicle": "the physical parameters of the vehicle",
    "databases": "the DBC files, such as [{file: my_car.dbc}]",
    "inputs": "which signals are measured",
    "gears": "where the gears come from: source: signals or ratio",
    "clutch_phase": "what tells whether a clutch is open: source: position, flag or command",
}
OPTIONAL_SECTIONS = ("protection", "estimator", "clutch_map", "state", "can", "output", "logging", "status")


@dataclass(frozen=True, slots=True)
class Config:
    """Everything that one vehicle file says.

    Attributes:
        path: the file; only its name when it came out of a log.
        name: name of the vehicle.
        settings: of the estimator core.
        protections: of received messages.
        database: the messages of all DBCs.
        buses: of a live service, at least one; ``arguments()`` of each goes to ``can.Bus``.
        output: the messages that are sent.
        logging: the log.
        status: where the status of a live service can be read.
        clutch_map: how the maps of the clutches are learned; None: they are not.
        map_ids: of the messages of the maps, message name to arbitration id, where it is not the DBC's.
        state: what is kept over a restart.
        documents: vehicle file, DBCs and overrides as they were loaded; `load_documents` reads them again.
        entries: the inputs with their keys, units and periods, for people.
        reorder_us: window within which frames of logs are sorted; None: as their origin asks for.
        addresses: by what the frames of each message are known, by its name.
        sigmas: standard deviation of a number, by its dotted key, where the file or its class of cars tells one.
        of_class: the numbers that the class of the car gave, by dotted key.
        warnings: what is doubtful but usable.
    """

    path: Path
    name: str
    settings: Settings
    protections: tuple[Protection, ...]
    database: Database
    buses: tuple[CanSection, ...]
    output: OutputSettings
    logging: LoggingSection
    status: StatusSection
    clutch_map: MapSettings | None
    map_ids: dict[str, int]
    state: StateSection
    documents: dict[str, bytes]
    entries: tuple[InputEntry, ...]
    reorder_us: int | None
    addresses: dict[str, Address]
    sigmas: dict[str, float]
    of_class: dict[str, float]
    warnings: tuple[Problem, ...]

    @property
    def can(self) -> CanSection:
        """The first bus, which simulations and recordings are played onto."""
        return self.buses[0]

    @property
    def inputs(self) -> tuple[Input, ...]:
        """The inputs of the decoder."""
        return self.settings.inputs

    def listening_only(self) -> Config:
        """Return the same with nothing sent on any bus."""
        buses = tuple(bus.model_copy(update={"listen_only": True}) for bus in self.buses)
        return replace(self, buses=buses, output=replace(self.output, enabled=False))


def load_config(path: str | Path, overrides: Mapping[str, str] | None = None) -> Config:
    """Load a vehicle file.

    Args:
        path: YAML file; files that it names are relative to it.
        overrides: dotted key to value as written in YAML, laid over the file: ``{"can.channel": "vcan0"}``.

    Raises:
        ConfigError: with every error of the file.
    """
    path = Path(path)
    content = read_content(path)

    def read(name: str) -> tuple[Path, bytes]:
        file = path.parent / name
        return file, file.read_bytes()

    return _load(path, content, dict(overrides or {}), read)


def read_content(path: Path) -> bytes:
    """Return what is in a YAML file.

    Raises:
        ConfigError: it cannot be read; names the files beside it that are nearest.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        near = sorted(str(p) for p in path.parent.glob("*.yaml")) if path.parent.is_dir() else []
        hint = nearest(str(path), near) if near else ""
        reason = f"cannot be read: {error.strerror}{hint}"
        raise ConfigError([Problem(str(path), 0, "", "", reason)]) from error


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
        sigmas = take_sigmas(document)
        of_class = take_class(document)
        _check_sections(document)
    if not document.data:
        raise ConfigError(document.problems)
    documents = {path.name: content}
    if overrides:
        documents[path.stem + OVERRIDES_SUFFIX] = _quoted(overrides)
    files = DatabaseFiles(document, documents, read, among_documents)
    database = files.vehicle()
    parts = build_parts(document, database, files.addresses)
    buses = read_buses(document)
    logging = validate(document, ("logging",), LoggingSection)
    status = validate(document, ("status",), StatusSection)
    learned = validate(document, ("clutch_map",), ClutchMapSection)
    state = validate(document, ("state",), StateSection)
    maps = map_settings(document, learned, parts.settings) if learned is not None and parts is not None else None
    output = files.output(database, output_channel(document, buses) if buses else 0)
    problems = sorted(document.without_consequences(), key=problem_order)
    sound = (
        parts is not None
        and database is not None
        and buses
        and logging
        and output
        and learned
        and state
        and status
    )
    if not sound or any(problem.severity == "error" for problem in problems):
        raise ConfigError(problems)
    assert isinstance(parts, Parts)
    assert database is not None
    assert buses is not None
    assert logging is not None
    assert output is not None
    assert learned is not None
    assert status is not None
    assert state is not None
    return Config(
        path=path,
        name=str(document.data["name"]),
        settings=parts.settings,
        protections=parts.protections,
        database=database,
        buses=buses,
        output=output,
        logging=logging,
        status=status,
        clutch_map=maps,
        map_ids=dict(learned.ids),
        state=state,
        documents=documents,
        entries=parts.entries,
        reorder_us=parts.reorder_us,
        addresses=files.addresses,
        sigmas=class_sigmas(of_class) | sigmas,
        of_class=of_class,
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
