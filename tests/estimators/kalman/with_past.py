"""A Kalman filter in dense matrices, to hold the smoother against."""

import numpy as np

from dctorque_can.estimators.kalman.model import N


def dense_update(x, P, i, z, R):
    H = np.eye(len(x))[i]
    K = P @ H / (H @ P @ H + R)
    rest = np.eye(len(x)) - np.outer(K, H)
    return x + K * (z - x[i]), rest @ P @ rest.T + R * np.outer(K, K)


class WithPast:
    """A filter whose state is the present one and those of all estimates so far."""

    def __init__(self, f):
        self.x, self.P = f["x"].copy(), f["P"].copy()

    def remember(self):
        join = np.vstack([np.eye(len(self.x)), np.eye(N, len(self.x))])
        self.x, self.P = join @ self.x, join @ self.P @ join.T

    def predict(self, F, b, Q):
        whole = np.eye(len(self.x))
        whole[:N, :N] = F
        self.x, self.P = whole @ self.x, whole @ self.P @ whole.T
        self.x[:N] += b
        self.P[:N, :N] += Q

    def measure(self, i, z, R):
        self.x, self.P = dense_update(self.x, self.P, i, z, R)

    def forget(self, i, value, variance):
        self.x[i] = value
        self.P[i], self.P[:, i] = 0.0, 0.0
        self.P[i, i] = variance
