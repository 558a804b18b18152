"""Estimators of the individual clutch torques: one package each, behind one contract (`contract`)."""
