"""Numbers only: errors, lag, consistency of stated deviations, shifts, what a health record says."""
