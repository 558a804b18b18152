"""Driveline physics only: parameters, the lumped and the compliant model, clutch phases."""
