"""Compiled code from run to run: where it is kept, when it is still good, who is told that it has to be made."""
