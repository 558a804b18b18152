"""What works on recordings gets the drive and the car that the service gets."""

from ..recorded_drive import clock, config, connect, drive  # noqa: F401  fixtures
