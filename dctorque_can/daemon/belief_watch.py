"""Notices when a protected message is not believed any more, and when it is again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.message_faults import BAD, WORDS
from dctorque_can.bus.belief import RIGHT_IN_A_ROW

FIRST = 10  # times of a message that are told one by one


class BeliefWatch:
    """Tells beginning and end of each time; of many of one message fewer and fewer.

    Args:
        names: of the messages.
        messages: `MESSAGE_STATE` ``[n]`` of them, as the decoder keeps them.
        tell: ``tell(is_error, text)``.
    """

    def __init__(
        self, names: Sequence[str], messages: NDArray[np.void], tell: Callable[[bool, str], None]
    ) -> None:
        self._names = names
        self._messages = messages
        self._tell = tell
        self._doubts = messages["doubts"].copy()  # that are told
        self._doubted = messages["doubted"] != 0

    def look(self) -> None:
        """Look whether something has changed."""
        messages = self._messages
        new = messages["doubts"] != self._doubts
        if not self._doubted.any() and not new.any():
            return
        for m in np.flatnonzero(new | self._doubted).tolist():
            times, doubted = int(messages["doubts"][m]), bool(messages["doubted"][m])
            worth = times <= FIRST or not times & (times - 1)
            if new[m] and worth:
                self._tell(True, self._reason(m))
            if (new[m] or self._doubted[m]) and not doubted and worth:
                self._tell(False, f"{self._names[m]}: believed again")
            self._doubts[m], self._doubted[m] = times, doubted

    def _reason(self, m: int) -> str:
        counts = self._messages["counts"][m]
        why = ", ".join(f"{counts[status]} {WORDS[status]}" for status in BAD if counts[status])
        return (
            f"{self._names[m]}: not believed: too many of its frames are bad (so far {why}); its signals are left "
            f"out until {RIGHT_IN_A_ROW} right ones follow each other"
        )
