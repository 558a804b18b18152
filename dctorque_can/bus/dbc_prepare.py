"""A DBC that cantools refuses, prepared for it: mended, without what is broken and not needed, its lines kept."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from dctorque_can.bus.dbc_text import Mender, Statement, statements
from dctorque_can.bus.dbc_trial import TooManyFaultsError, Trials, stated_line, without_line

LEFT_OUT = "it is left out"
SIGNAL_FORM = 'a signal is written SG_ Name : start|length@1+ (factor,offset) [min|max] "unit" receiver'
MESSAGE_FORM = "a message is written BO_ identifier Name: bytes sender"
STRICT_HINT = "it loads with `strict: false`"

_DEFINITIONS = ("BA_DEF_", "BA_DEF_DEF_", "BA_DEF_REL_", "BA_DEF_DEF_REL_", "VAL_TABLE_", "EV_", "ENVVAR_DATA_")
_ABOUT_SIGNALS = ("VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_")
_DECODING = ("SIG_VALTYPE_", "SG_MUL_VAL_")
_WITHOUT_END = ("", "VERSION", "NS_", "BS_", "BU_", "BO_", "SG_")


@dataclass(frozen=True, slots=True)
class Needed:
    """What of a DBC is needed.

    Attributes:
        messages: their names.
        signals: "Message.Signal".
    """

    messages: frozenset[str]
    signals: frozenset[str]


@dataclass(slots=True)
class Prepared:
    """A DBC for cantools.

    Attributes:
        text: with the lines of the original.
        remarks: line and text of what was mended or left out.
        errors: line and text of what is broken and needed.
        names: what stands for a name that cantools cannot read, to that name.
    """

    text: str = ""
    remarks: list[tuple[int, str]] = field(default_factory=list)
    errors: list[tuple[int, str]] = field(default_factory=list)
    names: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class _Block:
    """A message with its signals, as cantools gets to see them."""

    head: Statement
    name: str
    signals: list[Statement] = field(default_factory=list)

    @property
    def text(self) -> str:
        return self.head.text + "".join(signal.text for signal in self.signals)

    def at(self, line: int) -> Statement:
        """Return the statement that holds a line of `text`, from 1."""
        for each in (self.head, *self.signals):
            if line <= each.lines:
                return each
            line -= each.lines
        return self.signals[-1] if self.signals else self.head


def prepare(text: str, strict: bool, needed: Needed | None) -> Prepared:
    """Return a DBC's text prepared for cantools.

    Args:
        text: the text of the file.
        strict: whether signals that overlap or lie outside their message are faults.
        needed: what must not be left out; None: every message and signal.
    """
    return _Preparation(text, strict, needed).run()


class _Preparation:
    def __init__(self, text: str, strict: bool, needed: Needed | None) -> None:
        self._lines = text.count("\n") + 1
        self._all = statements(text)
        self._strict = strict
        self._needed = needed
        self._trials = Trials()
        self._mender = Mender(self._all)
        self._result = Prepared(names=self._mender.names)
        self._mended: list[tuple[int, str]] = []
        self._kept: list[Statement] = []

    def run(self) -> Prepared:
        try:
            blocks, others = self._blocks()
            self._messages(blocks)
            self._others(blocks, others)
        except TooManyFaultsError:
            self._result.errors.append((0, "has more faults than can be told one by one; is this a DBC file?"))
        self._tell_mended()
        self._result.text = self._joined()
        self._result.remarks.sort()
        self._result.errors.sort()
        return self._result

    def _blocks(self) -> tuple[list[_Block], list[Statement]]:
        """Return the messages with their signals, and all other statements."""
        blocks: list[_Block] = []
        others: list[Statement] = []
        current: _Block | None = None
        between: list[Statement] = []
        for each in self._all:
            mended = self._mender.mend(each)
            self._mended += [(each.line, remark) for remark in mended.remarks]
            statement = mended.statement
            if each.keyword == "BO_":
                current = _Block(statement, each.name)
                blocks.append(current)
                between = []
            elif each.keyword == "SG_" and current is not None:
                for line in between:
                    others.remove(line)
                    self._leave_out(line.line, "stands between the signals of a message")
                between = []
                current.signals.append(statement)
            elif each.keyword == "SG_":
                self._leave_out(each.line, "the signal stands below no message that is understood")
            else:
                others.append(statement)
                if each.keyword == "CM_" or (each.keyword == "" and not re.match(r"\s*B", each.text)):
                    if each.text.strip() and each.line > 1:
                        between.append(statement)
                else:
                    current = None
        return blocks, others

    def _messages(self, blocks: list[_Block]) -> None:
        for block in self._refused(blocks):
            if not self._sound(block):
                blocks.remove(block)
        for block in blocks:
            self._kept += [block.head, *block.signals]

    def _refused(self, blocks: Sequence[_Block]) -> list[_Block]:
        """Return the messages that cantools refuses as they are."""
        if not blocks or not self._trials.reason("".join(block.text for block in blocks), self._strict):
            return []
        if len(blocks) == 1:
            return list(blocks)
        half = len(blocks) // 2
        return self._refused(blocks[:half]) + self._refused(blocks[half:])

    def _sound(self, block: _Block) -> bool:
        """Take what is broken out of a message; return whether the message stays."""
        needed = self._is_needed(block)
        found: list[tuple[Statement, str, bool]] = []
        for fault in self._faults(block):
            found.append(fault)
            if fault[2] and not needed:  # the message goes, whatever else is wrong
                break
        broken = [each for each, _, _ in found]
        stays = True
        for statement, reason, only_strict in found:
            head = statement is block.head
            hint = _hint(reason, only_strict, head)
            if needed and (head or only_strict or self._is_needed_signal(block, statement)):
                self._result.errors.append((statement.line, reason + hint))
                stays = False
            elif head or only_strict:
                if stays:
                    self._leave_out(
                        statement.line, reason + hint, f"the message {block.name} is left out".replace("  ", " ")
                    )
                stays = False
            else:
                self._leave_out(statement.line, reason, "the signal is left out")
        block.signals = [signal for signal in block.signals if not any(signal is each for each in broken)]
        return stays

    def _faults(self, block: _Block) -> Iterator[tuple[Statement, str, bool]]:
        """Yield each statement of a message that is broken, why, and whether `strict: false` would take it."""
        trial = _Block(block.head, block.name, list(block.signals))
        while reason := self._trials.reason(trial.text, self._strict):
            lax = self._strict and not self._trials.reason(trial.text)
            line = stated_line(reason)
            named = re.search(r"[Tt]he signals? (\w+)", reason)
            culprit = trial.at(line) if line else trial.head
            if named and not line:
                name = self._mender.original(named.group(1))
                culprit = next((each for each in trial.signals if each.name == name), trial.head)
            yield culprit, self._mender.original(without_line(reason)), lax
            if culprit is trial.head:
                return
            trial.signals = [each for each in trial.signals if each is not culprit]

    def _others(self, blocks: Sequence[_Block], others: Sequence[Statement]) -> None:
        known = {block.head.identifier: {signal.name for signal in block.signals} for block in blocks}
        written = {each.identifier for each in self._all if each.keyword == "BO_"}
        left_out = written - set(known)
        candidates = []
        for each in others:
            if not each.text.strip():
                continue
            reason = _form(each)
            if each.identifier in left_out:
                continue
            if not reason and each.keyword in _ABOUT_SIGNALS and each.identifier >= 0:
                reason = _absent(each, known)
            if reason:
                self._broken(each, reason, blocks)
            else:
                candidates.append(each)
        definitions = [each for each in candidates if each.keyword in _DEFINITIONS]
        sound = self._without_faults("", definitions, blocks)
        names = {name.group(1) for each in sound if (name := re.match(r'\s*BA_DEF_[^"]*"([^"]*)"', each.text))}
        rest = []
        for each in candidates:
            if each.keyword in _DEFINITIONS:
                continue
            attribute = re.match(r'\s*BA_\s*"([^"]*)"', each.text)
            if attribute and attribute.group(1) not in names:
                self._broken(each, f"{attribute.group(1)!r} is used but not defined", blocks)
            else:
                rest.append(each)
        context = "".join(each.text for each in sound)
        self._kept += sound + self._without_faults(context, rest, blocks)

    def _without_faults(
        self, context: str, candidates: Sequence[Statement], blocks: Iterable[_Block]
    ) -> list[Statement]:
        broken = self._trials.faulty(context, candidates)
        for statement, reason in broken:
            self._broken(statement, self._mender.original(reason), blocks)
        return [each for each in candidates if not any(each is other for other, _ in broken)]

    def _broken(self, statement: Statement, reason: str, blocks: Iterable[_Block]) -> None:
        if statement.keyword in _DECODING:
            for block in blocks:
                of_block = block.head.identifier == statement.identifier and self._is_needed(block)
                signal = next((each for each in block.signals if each.name == statement.name), None)
                if of_block and signal is not None and self._is_needed_signal(block, signal):
                    hint = f"it says how {block.name}.{signal.name} is read"
                    self._result.errors.append((statement.line, f"{reason}; {hint}"))
                    return
        self._leave_out(statement.line, reason)

    def _is_needed(self, block: _Block) -> bool:
        if self._needed is None or block.name in self._needed.messages:
            return True
        return not block.name and any(
            re.search(rf"\b{re.escape(each)}\b", block.head.text) for each in self._needed.messages
        )

    def _is_needed_signal(self, block: _Block, signal: Statement) -> bool:
        if self._needed is None or f"{block.name}.{signal.name}" in self._needed.signals:
            return True
        if re.search(r"\s(M|m\d+M)\s*:", signal.text):  # others are selected by it
            return True
        words = [name.partition(".")[2] for name in self._needed.signals if name.startswith(f"{block.name}.")]
        return not signal.name and any(re.search(rf"\b{re.escape(word)}\b", signal.text) for word in words)

    def _leave_out(self, line: int, reason: str, what: str = LEFT_OUT) -> None:
        self._result.remarks.append((line, f"{reason}; {what}"))

    def _tell_mended(self) -> None:
        """Tell what was mended, each kind once."""
        for reason in dict.fromkeys(remark for _, remark in self._mended):
            lines = [line for line, remark in self._mended if remark == reason]
            others = ", ".join(map(str, lines[1:6]))
            more = f" and {len(lines) - 6} more" if len(lines) > 6 else ""
            also = f" (also line{'s' if len(lines) > 2 else ''} {others}{more})" if others else ""
            self._result.remarks.append((lines[0], reason + also))

    def _joined(self) -> str:
        """Return the statements that are kept, at their lines; all other lines are empty."""
        parts: list[str] = []
        line = 1
        for each in sorted(self._kept, key=lambda statement: statement.line):
            parts.append("\n" * (each.line - line) + each.text)
            line = each.line + each.text.count("\n")
        return "".join(parts)


def _hint(reason: str, only_strict: bool, head: bool) -> str:
    """Return what would be right instead, behind a semicolon; "" when the reason says it."""
    if only_strict:
        return f"; {STRICT_HINT}"
    if reason.startswith("Standard frame id"):
        return "; an identifier has 11 bits, or 29 bits and bit 31 set"
    if reason.startswith("Invalid syntax"):
        return f"; {MESSAGE_FORM if head else SIGNAL_FORM}"
    return ""


def _form(statement: Statement) -> str:
    """Return what the form of a statement lacks, in words; "" when it has all that is looked for."""
    text = statement.text.strip()
    if statement.keyword == "":
        shown = text.splitlines()[0][:40]
        return "" if text.startswith("//") else f"{shown!r} begins with no keyword of a DBC"
    if text.replace('\\"', "").count('"') % 2:
        return f"{statement.keyword} has a quote that is not closed"
    if statement.keyword not in _WITHOUT_END and not re.sub(r"//[^\n\"]*$", "", text).rstrip().endswith(";"):
        return f"{statement.keyword} has no ; at its end"
    if statement.keyword == "CM_" and re.match(r'CM_\s*SG_\s+\d+\s*"', text):
        return "the comment of a signal does not name the signal"
    if statement.keyword == "CM_" and not re.match(r'CM_\s*("|(BO_|SG_|BU_|EV_)\s)', text):
        return "the comment does not say what it is about: BO_, SG_, BU_ or EV_"
    return ""


def _absent(statement: Statement, known: dict[int, set[str]]) -> str:
    """Return that a statement is about a signal that is not there, or ""."""
    signals: Collection[str] | None = known.get(statement.identifier)
    if signals is None:
        what = f"the message {statement.identifier}"
    elif statement.name not in signals:
        what = f"the signal {statement.name!r} of the message {statement.identifier}"
    else:
        return ""
    return f"{statement.keyword} is about {what}, which is not there"
