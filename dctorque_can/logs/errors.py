"""What can go wrong with a log, for the one who reads the message."""

from dctorque_can.errors import DctorqueError


class LogReadError(DctorqueError):
    """A file is no log that can be read."""


class LogWriteError(DctorqueError):
    """A log can not be written (further): disk full, no permission, no such directory."""
