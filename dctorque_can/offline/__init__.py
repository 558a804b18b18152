"""What works on recordings: replay, playback, simulated logs, estimators compared with the truth."""
