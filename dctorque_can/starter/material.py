"""What proposals are made of: the signals of the DBCs and, with logs, what came of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.naming import Rule, named
from dctorque_can.starter.proposal import Candidate, Verdict
from dctorque_can.starter.recording import Recording

ABSENT = Verdict("absent", "its message is not in the log")
CONSTANT = Verdict("contradicts", "constant in the log")


@dataclass(frozen=True)
class Material:
    """Signals, and a recording of them.

    Attributes:
        entries: of all DBCs.
        recording: of all logs; None without any, or if no message of the DBCs is in them.
    """

    entries: Sequence[Entry]
    recording: Recording | None

    def candidates(self, rule: Rule, among: Iterable[Entry] | None = None) -> list[Candidate]:
        """Return the signals that fit a rule by name and unit, with what the log says of any of them.

        That is that a message is not there, or that a value never changes; all else is for who asks.
        """
        return [self.seen(each) for each in named(self.entries if among is None else among, rule)]

    def seen(self, candidate: Candidate) -> Candidate:
        """Return the candidate with a verdict where its message is absent or its value constant."""
        if self.recording is None:
            return candidate
        if not self.recording.has(candidate.entry):
            return replace(candidate, verdict=ABSENT)
        return replace(candidate, verdict=CONSTANT) if self.recording.is_constant(candidate.entry) else candidate

    def lives(self, entry: Entry) -> bool:
        """Return whether a signal is in the log, and changes."""
        return self.recording is not None and self.recording.has(entry) and not self.recording.is_constant(entry)


def open_verdict(candidate: Candidate) -> bool:
    """Return whether nothing speaks against a candidate yet."""
    return candidate.verdict.says == "nothing"
