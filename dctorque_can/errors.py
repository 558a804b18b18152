"""The one exception that a user is meant to see."""


class DctorqueError(Exception):
    """Bad input: the message says what is wrong, where, and what would be right, in one readable line each.

    Attributes:
        exit_code: exit code of the command line.
    """

    exit_code = 1
