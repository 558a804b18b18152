"""The Kalman filter of both clutch torques, and the smoother that goes with it."""
