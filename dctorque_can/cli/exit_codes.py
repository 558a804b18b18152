"""Exit codes of every subcommand (docs/cli.md)."""

from enum import IntEnum


class ExitCode(IntEnum):
    """What the shell is told."""

    OK = 0
    ERROR = 1  # bad input or a failure: one line on stderr says what, where and what would be right
    USAGE = 2  # the command line itself is wrong
    INCOMPLETE = 3  # the result is written, but something was missing: damaged input, dropped log frames
    CONFIG = 78  # `run`: the vehicle file is wrong (EX_CONFIG of sysexits.h); starting it again does not help
    INTERRUPTED = 130  # Ctrl-C; whatever was written is closed and readable
