"""Read any CAN log, write and recover MCAP, and the python-can reader and writer plug-in."""
