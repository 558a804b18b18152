"""Estimators of the individual clutch torques, their gains and their stability."""
