"""A vehicle file made to fit recordings: the most likely parameters, by the Kalman filter's own innovations."""
