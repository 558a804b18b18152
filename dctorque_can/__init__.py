"""Online estimation of the individual clutch torques of a dual clutch transmission from CAN."""

__version__ = "0.1.0"
