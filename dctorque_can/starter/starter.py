"""Everything that is proposed for a vehicle file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import ceil

from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.databases import Dbc
from dctorque_can.starter.proposal import Gap, Proposal
from dctorque_can.starter.protection import ProtectionFound
from dctorque_can.starter.recording import Period

_ROOM, _ROOM_USUAL, _ROUND_MS = 3.0, 1.5, 10


@dataclass(frozen=True)
class Starter:
    """Everything that is proposed.

    Attributes:
        dbcs: as they were read.
        j1939: numbers of DBCs that need ``j1939: true``.
        channels: by number of the DBC the channel that its messages are on, where the log has several.
        found: proposals and gaps of ``inputs``, ``gears`` and ``clutch_phase``, in the order of a vehicle file.
        gear_source: "gearbox", "signals", "ratio", or "" for a gap.
        phase_source: "position", "command", "state" or "none".
        protections: of messages that something is read from.
        unprotected: what looks protected, and why no protection is proposed; by message.
        periods: how often the messages come that something is read from; from the log.
        no_value: raw values that mean none, by signal, where table or log tell them.
        units: by signal, where the DBC has none, the unit that fits, with why.
        ratios: total ratio of engine to wheels by gear, as the log shows it.
        seconds: of the log; 0 without.
        remarks: what a reader must know beside that.
    """

    dbcs: tuple[Dbc, ...]
    j1939: frozenset[int]
    channels: dict[int, int]
    found: tuple[Proposal | Gap, ...]
    gear_source: str
    phase_source: str
    protections: tuple[ProtectionFound, ...] = ()
    unprotected: dict[str, str] = field(default_factory=dict)
    periods: dict[str, Period] = field(default_factory=dict)
    no_value: dict[str, tuple[int, ...]] = field(default_factory=dict)
    units: dict[str, tuple[str, str]] = field(default_factory=dict)
    ratios: dict[int, float] = field(default_factory=dict)
    seconds: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def messages(self) -> list[str]:
        """The messages that something proposed is read from, by name."""
        return list(dict.fromkeys(e.message.name for p in self.proposals for e in p.entries))

    @property
    def proposals(self) -> list[Proposal]:
        """What was found."""
        return [each for each in self.found if isinstance(each, Proposal)]

    @property
    def gaps(self) -> list[Gap]:
        """What was not found."""
        return [each for each in self.found if isinstance(each, Gap)]

    def answered(self, key: str, choice: int) -> Starter:
        """Return the proposals after an answer of the user.

        Args:
            key: of a proposal.
            choice: 0 leaves a gap, 1 confirms the proposal, 2 and more take an alternative in its place.

        Raises:
            IndexError: there are not so many alternatives.
        """
        found = [
            _answered(each, choice) if each.key == key and isinstance(each, Proposal) else each
            for each in self.found
        ]
        return replace(self, found=tuple(found))

    def timeout_ms(self, entry: Entry) -> int | None:
        """Return the timeout that fits a message, by the log or the cycle time of the DBC; None without both."""
        period = self.periods.get(entry.message.name)
        if period is not None:
            needed = max(_ROOM * period.median_ms, _ROOM_USUAL * period.longest_usual_ms)
        elif entry.message.cycle_time:
            needed = _ROOM * float(entry.message.cycle_time)
        else:
            return None
        return int(min(max(_ROUND_MS * ceil(needed / _ROUND_MS), 2 * _ROUND_MS), 60_000))


def _answered(proposal: Proposal, choice: int) -> Proposal | Gap:
    if choice == 0:
        return Gap(proposal.key, "left out when asked", False)
    if choice == 1:
        return replace(proposal, level="sure", why=(*proposal.why, "confirmed when asked"))
    other = proposal.alternatives[choice - 2]
    fields = {name: None for name in proposal.fields if name not in ("sum", "times", "signals", "reference_nm")}
    why = (*other.why, "chosen when asked")
    return replace(proposal, level="sure", why=why, entry=other.entry, fields=fields, extra=(), alternatives=())
