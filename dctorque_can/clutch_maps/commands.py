"""A kept map as a weak measurement: positions become the torques that the clutches should carry."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.maps import ClutchMap, ClutchMaps
from dctorque_can.clutch_maps.settings import Actuation
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus

Floats = NDArray[np.float64]

_FACTOR = 2.0
"""On the σ of a map: it was learned by the estimator that it now helps, so that a part of both errors is one."""


class Command(NamedTuple):
    """The frozen map of one clutch.

    Attributes:
        actuation: what closes the clutch.
        quantity: the command that the map makes of it.
        grid: rising actuations, times the closing sign ``[n]``.
        torque_nm: ``[n]``.
        sigma_nm: ``[n]``.
        valid: ``[n]``.
    """

    actuation: Actuation
    quantity: Quantity
    grid: Floats
    torque_nm: Floats
    sigma_nm: Floats
    valid: NDArray[np.bool_]

    def at(self, values: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the torque at values of the bus ``[n]``, N·m, and where it is known: between two valid nodes."""
        x = self.actuation.closing_sign * values
        place = np.clip(np.searchsorted(self.grid, x) - 1, 0, len(self.grid) - 2)
        inside = (x >= self.grid[0]) & (x <= self.grid[-1])
        return np.interp(x, self.grid, self.torque_nm), inside & self.valid[place] & self.valid[place + 1]


class Commands(NamedTuple):
    """The frozen maps of the clutches that have one.

    Attributes:
        clutches: of which something is known.
        error_nm: standard deviation of the torques, its constant part …
        error_share: … and by how much of the torque it grows; together not below that of any valid node.
    """

    clutches: tuple[Command, ...]
    error_nm: float
    error_share: float

    @classmethod
    def of(cls, maps: ClutchMaps) -> Self | None:
        """Return the maps as they are now, frozen; None where no node is valid."""
        clutches = tuple(command for clutch in maps.clutches if (command := _frozen(clutch)).valid.any())
        if not clutches:
            return None
        torque = np.concatenate([command.torque_nm[command.valid] for command in clutches])
        sigma = _FACTOR * np.concatenate([command.sigma_nm[command.valid] for command in clutches])
        share = float(sigma[np.argmax(torque)] / max(torque.max(), 1.0))
        return cls(clutches, float(np.maximum(sigma - share * torque, 1.0).max()), min(share, 1.0))

    def content(self) -> bytes:
        """Return the numbers of these very maps."""
        arrays = (np.asarray(part) for command in self.clutches for part in command[1:])
        return b"".join(array.tobytes() for array in arrays)

    def added_to(self, samples: Samples) -> Samples:
        """Return samples with a command before each position that the maps know, in the same frame."""
        places: list[NDArray[np.intp]] = [np.zeros(0, np.intp)]
        values: list[Floats] = [np.zeros(0)]
        quantities: list[NDArray[np.uint8]] = [np.zeros(0, np.uint8)]
        for command in self.clutches:
            mine = np.flatnonzero(
                (samples.quantity == command.actuation.quantity) & (samples.status == SampleStatus.OK)
            )
            torque, known = command.at(samples.value[mine])
            places.append(mine[known])
            values.append(torque[known])
            quantities.append(np.full(int(known.sum()), command.quantity, np.uint8))
        at = np.concatenate(places)
        if not len(at):
            return samples
        return Samples(
            np.insert(samples.t_us, at, samples.t_us[at]),
            np.insert(samples.quantity, at, np.concatenate(quantities)),
            np.insert(samples.value, at, np.concatenate(values)),
            np.insert(samples.status, at, np.uint8(SampleStatus.OK)),
            np.insert(samples.last, at, False),
        )


def _frozen(clutch: ClutchMap) -> Command:
    shown = clutch.published
    shown.renew(clutch.learner, 0.0, clutch.slipped_s)
    quantity = Quantity(Quantity.CLUTCH1_COMMAND + clutch.number - 1)
    return Command(
        clutch.actuation,
        quantity,
        shown.grid.copy(),
        shown.capacity_nm.copy(),
        shown.sigma_nm.copy(),
        shown.valid.copy(),
    )
