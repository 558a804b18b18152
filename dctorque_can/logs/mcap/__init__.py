"""MCAP logs: written, read, recovered, and registered with python-can."""
