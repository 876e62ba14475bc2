"""Scalar kernels that the estimators share: one track at a time, in place, strict floating point.

A state is x = [px, vx, ax, ..., py, vy, ay, ...] with covariance P over the same entries; both
axes move by the same chain F, Q (`mdkf.motion`), and the measurement is H x = [px, py].
"""

import numpy as np
from numba import njit

from mdkf.tables import FloatArray


@njit(cache=True)
def predict_mean(x: FloatArray, F: FloatArray) -> None:
    """x <- blockdiag(F, F) x; F is upper triangular, so rows can be replaced from the top."""
    m = F.shape[0]
    for axis in range(2):
        for i in range(m):
            total = 0.0
            for j in range(i, m):
                total += F[i, j] * x[axis * m + j]
            x[axis * m + i] = total


@njit(cache=True)
def predict_covariance(P: FloatArray, F: FloatArray, Q: FloatArray) -> None:
    """P <- F P F' + Q for both axes, cross-axis terms included."""
    m = F.shape[0]
    for column in range(2 * m):
        predict_mean(P[:, column], F)
    for row in range(2 * m):
        predict_mean(P[row, :], F)
    for axis in range(2):
        for i in range(m):
            for j in range(m):
                P[axis * m + i, axis * m + j] += Q[i, j]


@njit(cache=True)
def update_state(
    x: FloatArray, P: FloatArray, z: FloatArray, R: FloatArray
) -> tuple[float, float, float, float, float, float, float]:
    """Kalman update of x and P with z = H x + N(0, R), covariance in Joseph form.

    Returns the log-likelihood of z, the innovation y (2 numbers) and H K (2 x 2, by rows).
    """
    n = x.shape[0]
    m = n // 2
    s00 = P[0, 0] + R[0, 0]
    s01 = P[0, m] + R[0, 1]
    s11 = P[m, m] + R[1, 1]
    determinant = s00 * s11 - s01 * s01
    i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
    y0 = z[0] - x[0]
    y1 = z[1] - x[m]
    K = np.empty((n, 2))
    for i in range(n):
        K[i, 0] = P[i, 0] * i00 + P[i, m] * i01
        K[i, 1] = P[i, 0] * i01 + P[i, m] * i11
        x[i] += K[i, 0] * y0 + K[i, 1] * y1
    # Joseph: (I - K H) P (I - K H)' + K R K', the left product first.
    A = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            A[i, j] = P[i, j] - K[i, 0] * P[0, j] - K[i, 1] * P[m, j]
    for i in range(n):
        kr0 = K[i, 0] * R[0, 0] + K[i, 1] * R[1, 0]
        kr1 = K[i, 0] * R[0, 1] + K[i, 1] * R[1, 1]
        for j in range(i + 1):
            value = A[i, j] - A[i, 0] * K[j, 0] - A[i, m] * K[j, 1] + kr0 * K[j, 0] + kr1 * K[j, 1]
            P[i, j] = value
            P[j, i] = value
    distance = y0 * (i00 * y0 + i01 * y1) + y1 * (i01 * y0 + i11 * y1)
    likelihood = -0.5 * (distance + np.log(determinant)) - np.log(2.0 * np.pi)
    return likelihood, y0, y1, K[0, 0], K[0, 1], K[m, 0], K[m, 1]
