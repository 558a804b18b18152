"""The sans-I/O heart: frames, samples, estimates, health, and the loop that joins inputs and estimator."""
