"""A Kalman filter in dense matrices, to hold the smoother against."""

import numpy as np

from dctorque_can.estimators.kalman.model import N, State

SCALES = {State.W_W: State.SCALE, State.W_C1: State.RATIO_1, State.W_C2: State.RATIO_2}


def sensor_row(f, i):
    """What a sensor of x_i sees of the state ``[N]``: a share too much; wheels d/2 late, shafts early."""
    H = np.eye(N)[i]
    if i in SCALES:
        H[SCALES[i]] = f["x"][i]
    if not f["spins"]:
        if i in (State.W_W, State.W_B):
            H[State.LATE] = -0.5 * f["rate"][State.W_B]
        elif i in (State.W_C1, State.W_C2):
            H[State.LATE] = 0.5 * f["ratio"][i - State.W_C1] * f["rate"][State.W_B]
    return H


def dense_update(x, P, H, z, R):
    K = P @ H / (H @ P @ H + R)
    rest = np.eye(len(x)) - np.outer(K, H)
    return x + K * (z - H @ x), rest @ P @ rest.T + R * np.outer(K, K)


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

    def measure(self, H, z, R):
        row = np.zeros(len(self.x))
        row[:N] = H
        self.x, self.P = dense_update(self.x, self.P, row, z, R)

    def forget(self, i, value, variance):
        self.x[i] = value
        self.P[i], self.P[:, i] = 0.0, 0.0
        self.P[i, i] = variance
