"""The connection to the buses: opened, watched, lost and opened again."""
