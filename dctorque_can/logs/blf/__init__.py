"""Vector BLF logs."""
