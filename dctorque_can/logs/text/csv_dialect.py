"""What the columns of a CSV with CAN frames mean, by their names: SavvyCAN, PEAK-Converter, cabana and others."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

_NAMES = {
    "time": "time|timestamp|t|timeoffset|offset|timeabs|abstime|timerel|reltime|relativetime|absolutetime|"
    "recordtime|timestamps|date|datetime|systemtime",
    "id": "id|canid|arbitrationid|arbid|addr|address|identifier|messageid|msgid|frameid|pgnid",
    "data": "data|payload|databytes|bytes|message|datafield|msgdata|framedata",
    "length": "len|length|dlc|dl|datalength|datalen|datalengthcode|messagelength|size|bytecount",
    "extended": "extended|ext|ide|isextended|extendedid|isextendedid|xtd",
    "bus": "bus|channel|ch|chn|busnumber|canbus|port",
    "direction": "dir|direction|rxtx|txrx",
    "type": "type|frametype|messagetype",
    "remote": "remote|rtr|isremote|isrtr|isremoteframe",
    "error": "error|iserror|iserrorframe",
}
_ROLES = {name: role for role, names in _NAMES.items() for name in names.split("|")}
_BYTE = re.compile(r"(?:d|b|data|byte|databyte)(\d{1,2})$")
_UNITS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
_PEAK_COLUMNS = re.compile(r"\$COLUMNS=([\w,;]+)", re.I)
_PEAK_START = re.compile(r"\$STARTTIME=(\d+[.,]\d+)", re.I)
_PEAK_ROLES = {
    "O": "time",
    "B": "bus",
    "d": "direction",
    "T": "type",
    "I": "id",
    "l": "dlc",
    "L": "length",
    "D": "data",
}
_PEAK_EPOCH = datetime(1899, 12, 30)  # days are counted from there, as spreadsheets do
_DELIMITERS = (",", ";", "\t")
_MOST_LINES = 60  # before the names of the columns
NEEDED = (
    "a line of column names with time, identifier and data, such as 'Time Stamp,ID,Extended,Dir,Bus,LEN,D1,…' of "
    "SavvyCAN, 'time,addr,bus,data' of cabana, or that of PEAK-Converter"
)


@dataclass(frozen=True)
class CsvDialect:
    """How a CSV is read.

    Attributes:
        delimiter: between cells.
        columns: role to column. "data" holds all bytes, or is the first of columns with one each.
        bytes_from: first column with a single byte; -1: all are in one cell.
        scale: seconds that 1 is in the column of times; 0: as the size of the number says.
        decimal_comma: numbers may have a comma.
        base: of identifiers without 0x.
        long_is_extended: an identifier of eight digits has 29 bits.
        start_us: µs since 1970 at time 0.
        header_line: number of the line with the names, from 1; 0: none.
    """

    delimiter: str
    columns: dict[str, int] = field(default_factory=dict)
    bytes_from: int = -1
    scale: float = 0.0
    decimal_comma: bool = False
    base: int = 16
    long_is_extended: bool = False
    start_us: int = 0
    header_line: int = 0


def dialect_of(text: str) -> CsvDialect | None:
    """Return how a CSV that begins with ``text`` is read; None when no line names time, identifier and data."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[:_MOST_LINES]
    peak = _peak(lines)
    for number, line in enumerate(lines, 1):
        bare = line.strip().lstrip(";").strip()
        for delimiter in _DELIMITERS:
            cells = [cell.strip().strip('"').strip() for cell in bare.split(delimiter)]
            if len(cells) < 3:
                continue
            found = _named(cells, delimiter, number)
            if found is not None:
                return found
    return peak


def _named(cells: Sequence[str], delimiter: str, number: int) -> CsvDialect | None:
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    first_byte = -1
    for column, cell in enumerate(cells):
        name, unit = _split(cell)
        byte = _BYTE.match(name)
        if byte and first_byte < 0 and int(byte.group(1)) <= 1:
            first_byte = column
        role = _ROLES.get(name)
        if role is not None and role not in columns:
            columns[role] = column
            units[role] = unit
    if "data" not in columns and first_byte >= 0:
        columns["data"] = first_byte
    if not {"time", "id", "data"} <= set(columns):
        return None
    savvycan = [_split(cell)[0] for cell in cells[:3]] == ["timestamp", "id", "extended"]
    scale = _UNITS.get(units["time"], 1e-6 if savvycan else 0.0)
    base = {"dec": 10, "decimal": 10}.get(units["id"], 16)
    if _split(cells[columns["id"]])[0] in ("addr", "address") and not units["id"]:
        base = 10
    one_each = first_byte if columns["data"] == first_byte else -1
    return CsvDialect(delimiter, columns, one_each, scale, delimiter != ",", base, False, 0, number)


def _split(cell: str) -> tuple[str, str]:
    """Return the letters and digits of a name in lower case, and the unit that stands behind it in brackets."""
    match = re.match(r"(.*?)[\s_]*[\[(]([^\])]*)[\])]\s*$", cell.lower())
    name, unit = (match.group(1), match.group(2).strip()) if match else (cell.lower(), "")
    if not unit:
        behind = re.match(r"(time\w*?)[\s_]+(s|ms|us|µs|ns|sec)$", name)
        name, unit = (behind.group(1), behind.group(2)) if behind else (name, unit)
    return re.sub(r"[^a-z0-9]", "", name), unit


def _peak(lines: Sequence[str]) -> CsvDialect | None:
    """Return the dialect of a file whose remarks list the columns by PEAK's letters."""
    head = "\n".join(line for line in lines if line.lstrip().startswith(";"))
    listed = _PEAK_COLUMNS.search(head)
    if listed is None:
        return None
    letters = re.split(r"[,;]", listed.group(1))
    columns = {_PEAK_ROLES[letter]: k for k, letter in enumerate(letters) if letter in _PEAK_ROLES}
    columns["length"] = columns.get("length", columns.pop("dlc", -1))
    if not {"time", "id", "data"} <= set(columns):
        return None
    row = next((line for line in lines if line.strip() and not line.lstrip().startswith(";")), "")
    delimiter = max(_DELIMITERS, key=row.count)
    start = _PEAK_START.search(head)
    start_us = 0
    if start is not None:
        moment = _PEAK_EPOCH + timedelta(days=float(start.group(1).replace(",", ".")))
        start_us = round(moment.timestamp() * 1e6)
    return CsvDialect(delimiter, columns, columns["data"], 1e-3, delimiter != ",", 16, True, start_us, 0)
