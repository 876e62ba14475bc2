"""Motion models: constant velocity (order 1), acceleration (2) and jerk (3), per axis.

A chain [p, v, a, j] of one axis obeys x(t + dt) = F x(t) + w, w ~ N(0, Q), with F the Taylor
chain of the order and Q the exact integral of white noise that enters at every derivative:
Q = sum over d of q_d * integral_0^dt phi_d(s) phi_d(s)^T ds, phi_d(s)_i = s^(d-i) / (d-i)!.
For order 2 this is the matrix of RobMOT (Nagy et al., 2024).
"""

from math import factorial

import numpy as np

from mdkf.tables import FloatArray

PROCESS_NOISE = (0.1, 0.01, 0.001)
"""Spectral densities of RobMOT's white noise at velocity, acceleration, jerk
[m2/s, m2/s3, m2/s5]."""

START_VARIANCE = (2.0, 4.0, 8.0, 8.0)
"""RobMOT's variances of a track's first state: position, velocity, acceleration, jerk
[m2, (m/s)2, (m/s2)2, (m/s3)2]."""


def derivatives(order: int) -> tuple[int, ...]:
    """Entries of a chain, 0 for position up to the order: a tuple, because compiled kernels know
    its length beforehand."""
    return tuple(range(order + 1))


def taylor(order: int, dt: float) -> tuple[float, ...]:
    """First row of F, 1, dt, dt^2 / 2, ..: F[i, j] = taylor[j - i]."""
    return tuple(dt**d / factorial(d) for d in range(order + 1))


def transition(order: int, dt: float) -> FloatArray:
    """Transition matrix F of one axis, (order + 1, order + 1), for a step of dt [s]."""
    row = taylor(order, dt)
    F = np.zeros((order + 1, order + 1))
    for i in range(order + 1):
        F[i, i:] = row[: order + 1 - i]
    return F


def process_noise(order: int, dt: float, density: tuple[float, ...] = PROCESS_NOISE) -> FloatArray:
    """Process noise Q of one axis, (order + 1, order + 1), for a step of dt [s].

    density[d - 1] is the spectral density of the noise at derivative d = 1..order.
    """
    size = order + 1
    Q = np.zeros((size, size))
    for d in range(1, size):
        for i in range(d + 1):
            for j in range(d + 1):
                power = 2 * d - i - j + 1
                scale = factorial(d - i) * factorial(d - j) * power
                Q[i, j] += density[d - 1] * dt**power / scale
    return Q
