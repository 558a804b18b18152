"""The text of a DBC as statements with their lines, and what in them is written so that cantools cannot read it.

Nothing here understands a DBC: cantools does. A statement begins at a line whose first word is a keyword and
goes on to the next such line. So a quote that is never closed costs one statement, not the rest of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

KEYWORDS = (
    *("VERSION", "NS_", "BS_", "BU_", "VAL_TABLE_", "BO_", "SG_", "BO_TX_BU_", "EV_", "ENVVAR_DATA_", "CM_"),
    *("BA_DEF_DEF_REL_", "BA_DEF_REL_", "BA_DEF_DEF_", "BA_DEF_", "BA_REL_", "BA_", "VAL_", "SIG_GROUP_"),
    *("SIG_VALTYPE_", "SG_MUL_VAL_", "SGTYPE_", "SGTYPE_VAL_", "SIG_TYPE_REF_", "SIGTYPE_VALTYPE_", "NS_DESC_"),
    *("CAT_DEF_", "CAT_", "FILTER", "BA_DEF_SGTYPE_", "BA_SGTYPE_", "BU_SG_REL_", "BU_EV_REL_", "BU_BO_REL_"),
    "EV_DATA_",
)
"""First words of statements. Keywords cannot be names."""

NO_BIT_31 = (
    "the identifier has more than 11 bits without bit 31, the mark of 29 bits: it is read as one of 29 bits"
)
ODD_NAME = "a name that is not made of letters, digits and _, or begins with a digit, is read as it stands"
NO_LEADING_DIGIT = "a number without a digit before its point, such as .25, is read as 0.25"
NO_QUOTES = "a default that lacks its quotes is read as if it had them"
NO_NODE = "no sender or receiver is named: it is read as Vector__XXX"

LAST_STANDARD_ID = 0x7FF
LAST_EXTENDED_ID = 0x1FFF_FFFF
EXTENDED = 1 << 31

_BEGIN = re.compile(rf"\s*({'|'.join(KEYWORDS)})(?=[\s:\"])\s*\S|\s*(BO_|SG_|CM_|VAL_|BA_)\s*\r?$")
_SURE = re.compile(  # begins a statement even where a quote is still open
    r'\s*(?:BO_\s+\d+\s+\S+\s*:\s*\d|SG_\s+\S+(?:\s+(?:M|m\d+M?))?\s*:\s*\d+\|\d+@|CM_\s+(?:(?:SG_|BO_|BU_|EV_)\s|")'
    r'|VAL_\s+\d+\s+\w+\s+-?\d|BA_\s+"|BA_DEF_(?:DEF_)?(?:REL_)?\s+(?:(?:SG_|BO_|BU_|EV_)\s+)?"|SIG_VALTYPE_\s+\d)'
)
_STRING = re.compile(r'"(?:\\"|[^"])*"', re.DOTALL)
_POINT = re.compile(r"(?<![\w.])([-+]?)\.(?=\d)")
_HEAD = re.compile(r"(\s*BO_\s+)(\S+)(\s+)(\S.*?)(\s*:\s*)(\S+)(.*)", re.DOTALL)
_SIGNAL = re.compile(r"(\s*SG_\s+)(\S.*?)((?:\s+(?:M|m\d+M?))?\s*:.*)", re.DOTALL)
_TARGET = re.compile(
    r'\s*(?:(?:CM_|BA_\s*"[^"]*")\s*(BO_|SG_)|VAL_|SIG_VALTYPE_|SG_MUL_VAL_|SIG_GROUP_)\s*(\d+)(.*)', re.DOTALL
)
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_UNQUOTED = re.compile(r'(\s*BA_DEF_DEF_\s*"[^"]*"\s*)([A-Za-z_]\w*)(\s*;\s*)')


@dataclass(frozen=True, slots=True)
class Statement:
    """Some lines of a DBC that belong together.

    Attributes:
        line: number of the first of them, from 1.
        keyword: the first word, "" when it is none of `KEYWORDS`.
        text: the lines, with their ends.
        identifier: of the message that it is or is about, as it is written; -1: none.
        name: of the message or signal that it is or is about, "" for none.
    """

    line: int
    keyword: str
    text: str
    identifier: int = -1
    name: str = ""

    @property
    def lines(self) -> int:
        """How many lines it has."""
        return self.text.count("\n") or 1


def decoded(content: bytes) -> str:
    """Return the text of a DBC: UTF-8 or UTF-16 as its first bytes say, else each line as UTF-8 or cp1252.

    Line ends become ``\\n``.
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = "".join(_line(line) for line in content.removeprefix(b"\xef\xbb\xbf").splitlines(keepends=True))
    return text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a\x00")


def _line(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def statements(text: str) -> list[Statement]:
    """Return the statements of a DBC, in their order; together they are all lines."""
    found: list[Statement] = []
    lines: list[str] = []
    first, keyword, quotes, complete = 1, "", 0, True
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        begin = _BEGIN.match(line)
        open_quote = quotes % 2 == 1
        begins = _SURE.match(line) is not None if open_quote else begin is not None
        if keyword == "NS_" and len(line.split()) == 1 and ":" not in line:
            begins = False  # the section lists keywords
        unknown = not begins and not open_quote and complete and line.strip() != "" and not _is_remark(line)
        if keyword == "BU_" and re.fullmatch(r"[\w\s]+", line):
            unknown = False  # more nodes
        if begins or unknown:
            if lines:
                found.append(_statement(first, keyword, "".join(lines)))
            first, lines, quotes = number, [], 0
            keyword = (begin.group(1) or begin.group(2)) if begins and begin else ""
        lines.append(line)
        quotes += line.replace('\\"', "").count('"')
        if line.strip():
            complete = quotes % 2 == 0 and _is_complete(keyword, line)
    if lines:
        found.append(_statement(first, keyword, "".join(lines)))
    return found


def _is_remark(line: str) -> bool:
    return line.lstrip().startswith("//")


def _is_complete(keyword: str, line: str) -> bool:
    """Return whether a statement can end with this line, so that a line without a keyword is none of it."""
    if keyword in ("BO_", "SG_"):
        return ":" in line and not line.rstrip().endswith(",")
    if keyword in ("VERSION", "BS_", ""):
        return True
    return keyword == "BU_" or (keyword != "NS_" and line.rstrip().endswith(";"))


def _statement(line: int, keyword: str, text: str) -> Statement:
    if keyword == "BO_":
        head = _HEAD.match(text)
        return (
            Statement(line, keyword, text, _number(head.group(2)), head.group(4))
            if head
            else Statement(line, keyword, text)
        )
    if keyword == "SG_":
        signal = _SIGNAL.match(text)
        return Statement(line, keyword, text, name=signal.group(2)) if signal else Statement(line, keyword, text)
    target = _TARGET.match(text)
    if target is None:
        return Statement(line, keyword, text)
    named = (
        re.match(r"\s*([^\s\";:]+)", target.group(3))
        if target.group(1) != "BO_" and keyword != "SIG_GROUP_"
        else None
    )
    return Statement(line, keyword, text, _number(target.group(2)), named.group(1) if named else "")


def _number(text: str) -> int:
    return int(text) if re.fullmatch(r"\d{1,10}", text, re.ASCII) else -1


@dataclass(frozen=True, slots=True)
class Mended:
    """A statement that cantools can read.

    Attributes:
        statement: with the text for cantools.
        remarks: what was written otherwise.
    """

    statement: Statement
    remarks: tuple[str, ...] = ()


class Mender:
    """Writes statements so that cantools reads what they mean, where that is beyond doubt; lines stay lines.

    Attributes:
        names: what stands for a name that cantools cannot read, to that name.
    """

    def __init__(self, all_statements: Iterable[Statement]) -> None:
        self.names: dict[str, str] = {}
        self._written: dict[str, str] = {}
        self._extended: set[int] = set()
        for each in all_statements:
            if each.keyword in ("BO_", "SG_") and each.name and not is_name(each.name):
                self._stand_in(each.name)
            if each.keyword == "BO_" and LAST_STANDARD_ID < each.identifier <= LAST_EXTENDED_ID:
                self._extended.add(each.identifier)

    def mend(self, statement: Statement) -> Mended:
        """Return a statement as cantools can read it, where it is known to be written otherwise."""
        remarks: list[str] = []
        text = statement.text
        if statement.keyword in ("BO_", "SG_"):
            text = "".join(self._definition(statement, remarks))
        elif statement.keyword == "BU_":
            text = re.sub(r"(?<![\w])(\d+\w*[A-Za-z_])", r"_\1", text)
        elif statement.identifier >= 0:
            text = self._referring(statement)
        if statement.keyword in ("SG_", "BA_", "BA_DEF_", "BA_DEF_DEF_"):
            text = _outside_strings(text, lambda part: _POINT.sub(r"\g<1>0.", part), remarks, NO_LEADING_DIGIT)
        if statement.keyword == "BA_DEF_DEF_":
            quoted = _UNQUOTED.fullmatch(text)
            if quoted:
                text = f'{quoted.group(1)}"{quoted.group(2)}"{quoted.group(3)}'
                remarks.append(NO_QUOTES)
        return Mended(replace(statement, text=text), tuple(remarks))

    def original(self, text: str) -> str:
        """Return a text of cantools with the names as they stand in the DBC."""
        for stand_in, name in self.names.items():
            text = re.sub(rf"\b{stand_in}\b", lambda _, name=name: name, text)  # type: ignore[misc]
        return text

    def _stand_in(self, name: str) -> str:
        if name not in self._written:
            stand_in = f"odd_{len(self.names)}_{re.sub(r'[^A-Za-z0-9]', '_', name)}"
            self.names[stand_in] = name
            self._written[name] = stand_in
        return self._written[name]

    def _definition(self, statement: Statement, remarks: list[str]) -> Iterator[str]:
        head = _HEAD.match(statement.text) if statement.keyword == "BO_" else None
        signal = _SIGNAL.match(statement.text) if statement.keyword == "SG_" else None
        if statement.name in self._written:
            remarks.append(ODD_NAME)
        name = self._written.get(statement.name, statement.name)
        if head:
            identifier = head.group(2)
            if statement.identifier in self._extended:
                identifier = str(statement.identifier | EXTENDED)
                remarks.append(NO_BIT_31)
            sender = head.group(7)
            if not sender.strip():
                remarks.append(NO_NODE)
                sender = f" Vector__XXX{sender}"
            sender = re.sub(r"^(\s+)(\d\w*)", r"\1_\2", sender)
            yield f"{head.group(1)}{identifier}{head.group(3)}{name}{head.group(5)}{head.group(6)}{sender}"
        elif signal:
            before, quote, receivers = signal.group(3).rpartition('"')
            receivers = re.sub(r"(?<![\w])(\d\w*)", r"_\1", receivers) if quote else receivers
            stripped = receivers.rstrip()
            if quote and stripped.endswith(","):
                receivers = stripped.rstrip(", ") + receivers[len(stripped) :]
            yield f"{signal.group(1)}{name}{before}{quote}{receivers}"
        else:
            yield statement.text

    def _referring(self, statement: Statement) -> str:
        """Return a statement about a message or signal with the identifier and names for cantools."""
        text, identifier = statement.text, statement.identifier
        if statement.name in self._written:
            pattern = rf"(?<=\b{identifier})(\s+){re.escape(statement.name)}"
            text = re.sub(pattern, rf"\g<1>{self._written[statement.name]}", text, count=1)
        if statement.keyword in ("SG_MUL_VAL_", "SIG_GROUP_"):
            for name, stand_in in self._written.items():
                text = re.sub(rf"(?<=\s){re.escape(name)}(?=[\s;])", stand_in, text)
        if identifier in self._extended:
            text = re.sub(rf"\b{identifier}\b", str(identifier | EXTENDED), text, count=1)
        return text


def is_name(name: str) -> bool:
    """Return whether cantools can read a name."""
    return _NAME.fullmatch(name) is not None and name not in KEYWORDS


def _outside_strings(text: str, change: Callable[[str], str], remarks: list[str], remark: str) -> str:
    """Return a text whose parts outside of strings are changed; append the remark when any was."""
    parts, end = [], 0
    for string in _STRING.finditer(text):
        parts += [change(text[end : string.start()]), string.group()]
        end = string.end()
    changed = "".join([*parts, change(text[end:])])
    if changed != text:
        remarks.append(remark)
    return changed
