"""Error figures, shift events and plots from logs."""
