"""How much of a log may be unpacked: a small file must not fill the memory, or keep a command busy for hours.

Real logs unpack to 2 to 20 times their size.
"""

from __future__ import annotations

MIB = 1 << 20
MOST_RATIO = 200
"""Times that a piece, and a file as a whole, may be larger when it is unpacked, beyond what is free."""

FREE_PIECE = 64 * MIB
"""So much a piece may unpack to whatever its size."""

FREE_FILE = 256 * MIB
"""So much a file may unpack to whatever its size."""

LARGEST_CHUNK = 256 * MIB  # of MCAP; recorders write 1 to 10 MiB
LARGEST_CONTAINER = 64 * MIB  # of BLF; those of Vector's tools hold 128 kB


class Unpacked:
    """Counts what was unpacked of one file.

    Args:
        size: bytes of the file as it is on the disk.
    """

    def __init__(self, size: int) -> None:
        self.left = max(FREE_FILE, MOST_RATIO * size)

    def most(self, packed: int, largest: int) -> int:
        """Return how many bytes a piece of ``packed`` bytes may unpack to, at most ``largest``."""
        return max(min(largest, max(FREE_PIECE, MOST_RATIO * packed), self.left), 0)

    def refuse(self, most: int) -> None:
        """Note that a piece would unpack to more than ``most``; where the file allows no more, that is its end."""
        if most >= self.left:
            self.left = 0

    def take(self, count: int) -> None:
        """Note that so many bytes were unpacked."""
        self.left -= count


def too_large(what: str, packed: int, most: int) -> str:
    """Return that a piece unpacks to more than it may."""
    return f"{what} unpacks to more than {max(most // MIB, 1)} MiB, the limit for its {packed} bytes"


def file_too_large() -> str:
    """Return that a file unpacks to more than it may."""
    limit = f"{MOST_RATIO} times its size and {FREE_FILE // MIB} MiB"
    return f"unpacks to more than {limit}, the limit: no more of it is read"
