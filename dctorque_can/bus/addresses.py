"""By what the frames of a message are known: its identifier, for J1939 a part of it, and its channel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from cantools.database.can import Database, Message

from dctorque_can.pipeline.frames import DESTINATION, EXTENDED_ID, SOURCE, Address, group_mask
from dctorque_can.pipeline.samples import Input, Term


def identifier(message: Message) -> int:
    """Return the identifier of a message, with `EXTENDED_ID` set for a 29-bit one."""
    return message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)


def is_j1939(message: Message) -> bool:
    """Return whether the DBC says so, by its attribute VFrameFormat or the default of that."""
    return bool(message.protocol == "j1939" and message.is_extended_frame)


def j1939_addresses(messages: Iterable[Message], sources: Mapping[str, int]) -> dict[str, Address]:
    """Return by what messages of 29 bits are known, by name.

    A message is known by its parameter group number. Of one for which ``sources`` has a source address, only
    frames from there count. Messages of one number are known by their own source address, and if that is the same
    too, by their destination; their priority never matters.
    """
    ids = {m.name: (identifier(m) & ~SOURCE) | sources.get(m.name, m.frame_id & SOURCE) for m in messages}
    groups = Counter(can_id & group_mask(can_id) for can_id in ids.values())
    from_source = Counter(can_id & (group_mask(can_id) | SOURCE) for can_id in ids.values())
    found = {}
    for name, can_id in ids.items():
        mask = group_mask(can_id)
        if name in sources or groups[can_id & mask] > 1:
            mask |= SOURCE
            if from_source[can_id & mask] > 1:
                mask |= DESTINATION
        found[name] = Address(can_id, mask)
    return found


def address_of(message: Message, addresses: Mapping[str, Address]) -> Address:
    """Return by what a message is known: as ``addresses`` say by its name, else by its identifier."""
    return addresses.get(message.name) or Address(identifier(message))


def at_term(term: Term, message: Message, addresses: Mapping[str, Address]) -> Address:
    """Return by what the message of a term is known."""
    address = address_of(message, addresses)
    return address if term.channel is None else replace(address, channel=term.channel)


def read_addresses(
    database: Database, inputs: Sequence[Input], addresses: Mapping[str, Address]
) -> dict[tuple[str, Address], Message]:
    """Return the messages that inputs read, in order of the inputs: by name, once for each channel."""
    by_name = {message.name: message for message in database.messages}
    terms = [term for each in inputs for term in each.signals if term.message in by_name]
    return {(t.message, at_term(t, by_name[t.message], addresses)): by_name[t.message] for t in terms}
