"""What the service writes: handed over to a process of its own that writes MCAP logs."""
