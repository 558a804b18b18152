"""A bus on which nobody speaks: from the start on, or after it had given frames."""

from __future__ import annotations

from collections.abc import Callable

SILENCE_S = 2.0  # without a frame: told
WHERE_TO_LOOK = (
    "is the ignition on, is this the right channel, does its bit rate fit, is the bus terminated (60 Ω between "
    "CAN high and low) and wired?"
)


class SilenceWatch:
    """Tells, once each, that a bus is silent and that it speaks again. The bus stays open meanwhile.

    A car that is switched off is silent too. So a silence is a remark after frames, and an error only on a bus of
    which nothing came at all: that is what a wrong bit rate or channel looks like. Error frames are no speech.

    Args:
        tell: ``tell(is_error, text)``.

    Attributes:
        mute: whether nothing came at all for `SILENCE_S`, until something comes.
    """

    def __init__(self, tell: Callable[[bool, str], None]) -> None:
        self.mute = False
        self._tell = tell
        self._heard_s: float | None = None  # None: this bus has not given anything yet
        self._since_s: float | None = None  # of a bus that has not: since when it is listened to
        self._silent = False

    def opened_again(self, now_s: float) -> None:
        """Note that the bus was away and is back: nobody could be heard meanwhile."""
        self._since_s = None
        if self._heard_s is not None:
            self._heard_s, self._silent = now_s, False

    def heard(self, now_s: float, name: str) -> None:
        """Note that a frame came that is no error frame."""
        if self.mute:
            self.mute = False
            self._tell(False, f"first frame on {name}")
        elif self._silent and self._heard_s is not None:
            self._tell(False, f"frames again after {now_s - self._heard_s:.1f} s on {name}")
        self._silent = False
        self._heard_s = now_s

    def quiet(self, now_s: float, name: str, error_frames: int) -> bool:
        """Note that none has come, but so many error frames; return whether a silence after frames is told now."""
        if self._heard_s is None:
            if self._since_s is None:
                self._since_s = now_s
            elif not self.mute and now_s - self._since_s >= SILENCE_S:
                self.mute = True
                self._tell(True, nothing_came(name, error_frames))
        elif not self._silent and now_s - self._heard_s >= SILENCE_S:
            self._silent = True
            self._tell(False, f"no frame for {SILENCE_S:g} s on {name}")
            return True
        return False


def nothing_came(name: str, error_frames: int) -> str:
    """Return that nothing came on a bus, and where to look."""
    if error_frames:
        return (
            f"nothing but {error_frames} error frames for {SILENCE_S:g} s on {name}: does the bit rate fit? Is "
            "the bus terminated (60 Ω between CAN high and low)?"
        )
    return f"no frame at all for {SILENCE_S:g} s on {name}: {WHERE_TO_LOOK}"
