"""Logs of text, a frame a line: ASC and candump."""
