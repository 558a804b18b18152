"""What `tools/fuzz` feeds: rooms, mutators, and the process in which atheris runs."""
