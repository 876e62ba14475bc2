"""Scalar kernels of a bank of models: mix them before a prediction, and into one estimate.

The models of track k are the rows k K .. k K + K - 1 of mean (n K, 2m), covariance (n K, 2m, 2m);
their probabilities are row k of probability (n, K).
"""

from mdkf.batch import Moments, Noise, Pair
from mdkf.compiled import inlined
from mdkf.tables import FloatArray, IntArray

Models = tuple[FloatArray, FloatArray]
"""The models of one track: means (K, 2m) and covariances (K, 2m, 2m)."""


@inlined
def copy_track(
    mean: FloatArray, covariance: FloatArray, k: int, K: int, m: int, into: Models
) -> None:
    """Copy the K models of track k."""
    x, P = into
    n = 2 * m
    for i in range(K):
        for a in range(n):
            x[i, a] = mean[k * K + i, a]
            for b in range(n):
                P[i, a, b] = covariance[k * K + i, a, b]


@inlined
def mix_models(
    before: Models,
    weight: FloatArray,
    j: int,
    K: int,
    m: int,
    unbiased: bool,
    mean: FloatArray,
    covariance: FloatArray,
    row: int,
    work: tuple[IntArray, FloatArray],
) -> None:
    """Mix one track's models `before`, weighted (K,), into model j: a row of mean, covariance.

    Model i knows the derivatives 0..i+1 of an axis; entries that model j has no use for stay 0.
    work, (K, 2m) each, is overwritten: the model that entry a of model i is taken from, and its
    distance from the mixed mean.
    """
    x, P = before
    source, spread = work
    known = j + 2
    for axis in range(2):
        for d in range(known):
            a = axis * m + d
            mixed = 0.0
            for i in range(K):
                source[i, a] = j if unbiased and d > i + 1 else i
                mixed += weight[i] * x[source[i, a], a]
            for i in range(K):
                spread[i, a] = x[source[i, a], a] - mixed
            mean[row, a] = mixed
    for axis in range(2):
        for a in range(axis * m, axis * m + known):
            for b in range(a + 1):
                if m > b >= known:
                    continue
                total = 0.0
                for i in range(K):
                    # What is taken from the larger model is uncorrelated with what is not.
                    same = source[i, a] == source[i, b]
                    value = P[source[i, a], a, b] if same else 0.0
                    total += weight[i] * (value + spread[i, a] * spread[i, b])
                covariance[row, a, b] = total
                covariance[row, b, a] = total


@inlined
def mixture_innovation(
    mean: FloatArray,
    covariance: FloatArray,
    probability: FloatArray,
    k: int,
    z: Pair,
    R: Noise,
    K: int,
    m: int,
) -> tuple[float, float, float]:
    """Innovation of track k's mixture and its NIS; its covariance includes the models' spread."""
    yx = yy = 0.0
    for j in range(K):
        yx += probability[k, j] * (z[0] - mean[k * K + j, 0])
        yy += probability[k, j] * (z[1] - mean[k * K + j, m])
    s00, s01, s11 = R
    for j in range(K):
        row = k * K + j
        dx, dy = z[0] - mean[row, 0] - yx, z[1] - mean[row, m] - yy
        s00 += probability[k, j] * (covariance[row, 0, 0] + dx * dx)
        s01 += probability[k, j] * (covariance[row, 0, m] + dx * dy)
        s11 += probability[k, j] * (covariance[row, m, m] + dy * dy)
    nis = (yx * (s11 * yx - s01 * yy) + yy * (s00 * yy - s01 * yx)) / (s00 * s11 - s01 * s01)
    return yx, yy, nis


@inlined
def mixture_moments(
    mean: FloatArray, covariance: FloatArray, probability: FloatArray, k: int, K: int, m: int
) -> Moments:
    """Position and velocity of track k's mixture, and the position's covariance."""
    px = py = vx = vy = cxx = cxy = cyy = 0.0
    for j in range(K):
        mu, row = probability[k, j], k * K + j
        px += mu * mean[row, 0]
        py += mu * mean[row, m]
        vx += mu * mean[row, 1]
        vy += mu * mean[row, m + 1]
    for j in range(K):
        mu, row = probability[k, j], k * K + j
        dx, dy = mean[row, 0] - px, mean[row, m] - py
        cxx += mu * (covariance[row, 0, 0] + dx * dx)
        cxy += mu * (covariance[row, 0, m] + dx * dy)
        cyy += mu * (covariance[row, m, m] + dy * dy)
    return px, py, vx, vy, cxx, cxy, cyy
