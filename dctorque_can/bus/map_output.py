"""The learned maps to CAN frames by ``dbc/dctorque_map.dbc``: cyclic on the time of the estimates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from cantools.database.can import Database, Message
from numpy.typing import NDArray

from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.output import arbitration_id
from dctorque_can.bus.problems import nearest
from dctorque_can.bus.protection import declared_protections
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import FrameFlag, Frames

MAP, TOUCH, FRICTION, SLOPE = "DctClutchMap", "DctClutchTouch", "DctClutchFriction", "DctClutchSlope"
MAP_MESSAGES = (MAP, TOUCH, FRICTION, SLOPE)


class MapEncoder:
    """Encoder of the maps, with counters and CRC kept from call to call.

    Nothing is sent before the first map. Then each message is sent with the first estimate that reaches its cycle
    time; `DctClutchMap` has one node after the other. After a pause of two cycles or a step back of the time the
    cycle starts anew. The result does not depend on how the estimates are cut into batches, as long as the maps
    are renewed at the same places.

    Args:
        database: ``dbc/dctorque_map.dbc``.
        ids: other arbitration ids by message name, as for `OutputEncoder`.

    Raises:
        DctorqueError: the DBC or the ids do not fit.
    """

    def __init__(self, database: Database, ids: Mapping[str, int] | None = None) -> None:
        overrides = dict(ids or {})
        protections = {protection.message: protection for protection in declared_protections(database)}
        self._messages: dict[str, _Cyclic] = {}
        for name in overrides:
            if name not in MAP_MESSAGES:
                hint = nearest(name, list(MAP_MESSAGES)) or MAP_MESSAGES
                raise DctorqueError(f"id of {name}: no such message; did you mean {' or '.join(hint)}?")
        for name in MAP_MESSAGES:
            message = database.get_message_by_name(name)
            encoder = MessageEncoder(message, protections.get(name))
            self._messages[name] = _Cyclic(message, encoder, arbitration_id(message, overrides.get(name)))
        self._maps: dict[int, NDArray[np.void]] = {}
        self._node = 0

    @property
    def can_ids(self) -> dict[str, int]:
        """The identifiers that are sent, by message name, with `EXTENDED_ID` set for 29-bit ones."""
        return {name: each.can_id for name, each in self._messages.items()}

    @property
    def periods_s(self) -> dict[int, tuple[str, float]]:
        """Name and cycle time of each message, by its identifier."""
        return {each.can_id: (name, each.period_us / 1e6) for name, each in self._messages.items()}

    def renew(self, rows: NDArray[np.void]) -> None:
        """Take the next `CLUTCH_MAP` rows ``[n]``, of one clutch or both."""
        for i in range(len(rows)):
            self._maps[int(rows["clutch"][i])] = rows[i : i + 1].copy()

    def encode(self, t_us: NDArray[np.int64]) -> Frames:
        """Return the frames that are due with estimates at these times ``[n]``; flags `FrameFlag.SENT`."""
        parts: list[Frames] = []
        if self._maps:
            for t in t_us.tolist():
                parts += [self._frame(name, each, t) for name, each in self._messages.items() if each.is_due(t)]
        return Frames.concatenate(parts) if parts else Frames.empty(0, 8)

    def _frame(self, name: str, message: _Cyclic, t_us: int) -> Frames:
        frames = Frames.empty(1, 8)
        frames.t_us[:], frames.can_id[:], frames.length[:] = t_us, message.can_id, message.length
        frames.flags[:] = FrameFlag.SENT
        values = self._node_values() if name == MAP else self._clutch_values(name)
        frames.data[:, : message.length] = message.encoder.encode({key: [value] for key, value in values.items()})
        return frames

    def _node_values(self) -> dict[str, float]:
        numbers = sorted(self._maps)
        nodes = len(self._maps[numbers[0]]["actuation"][0])
        number, node = numbers[self._node // nodes % len(numbers)], self._node % nodes
        self._node = (self._node + 1) % (nodes * len(numbers))
        row = self._maps[number]
        valid = bool(row["valid"][0, node])
        return {
            "MapNodeValid": float(valid),
            "MapClutch2": float(number == 2),
            "MapNode": float(node),
            "MapActuation": float(row["actuation"][0, node]),
            "MapTorque": float(row["capacity_nm"][0, node]) if valid else np.nan,
            "MapSigma": float(row["sigma_nm"][0, node]) if valid else np.nan,
        }

    def _clutch_values(self, name: str) -> dict[str, float]:
        values: dict[str, float] = {}
        for number in (1, 2):
            row = self._maps.get(number)
            known = row is not None and (
                bool(row["touch_valid"][0]) or (name == FRICTION and bool(row["valid"].any()))
            )
            word, sigma, column, sigma_column, factor = _COLUMNS[name]
            values[f"{word}{number}Valid"] = float(known)
            values[f"{word}{number}"] = factor * float(row[column][0]) if row is not None and known else np.nan
            values[f"{sigma}{number}"] = (
                factor * float(row[sigma_column][0]) if row is not None and known else np.nan
            )
        return values


_COLUMNS = {
    TOUCH: ("TouchPoint", "TouchSigma", "touch_point", "touch_sigma", 1.0),
    FRICTION: ("Friction", "FrictionSigma", "friction", "friction_sigma", 100.0),
    SLOPE: ("Slope", "SlopeSigma", "slope_nm_per_unit", "slope_sigma", 1.0),
}


class _Cyclic:
    def __init__(self, message: Message, encoder: MessageEncoder, can_id: int) -> None:
        self.encoder, self.can_id, self.length = encoder, can_id, message.length
        self.period_us = 1000 * int(message.cycle_time or 1000)
        self._next_us: int | None = None
        self._last_us = 0

    def is_due(self, t_us: int) -> bool:
        """Return whether the message is sent with the estimate of this time."""
        following = self._next_us
        if following is None or t_us >= following + self.period_us or t_us < self._last_us:
            following = t_us
        self._last_us = t_us
        due = t_us >= following
        self._next_us = following + self.period_us if due else following
        return due
