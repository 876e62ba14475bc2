"""Scalar kernels of MD's window: how much the recent positions and their differences vary.

window (n, k + order - 1, 2) holds each track's denoised positions, oldest first. Every update
shifts it by one and forms the deviations anew in the same pass over its k values, so that they
carry no error from one frame to the next, however far the object has come.

All sums run over deviations from the newest value: it is one of the values, so the squares lose no
more than a factor k of their digits, and a large coordinate costs none. Both axes go through one
loop, because a sum by itself keeps the processor waiting for its last addition.
"""

import math

from mdkf.compiled import inlined
from mdkf.tables import FloatArray

Pair = tuple[float, float]
"""A value on x and one on y."""

Sums = tuple[float, float, float, float]
"""Sums of values on x and y, and of their squares."""


@inlined
def remember(window: FloatArray, k: int, x: float, y: float, m: int) -> tuple[Pair, Pair, Pair]:
    """Append the position x, y to track k's window of a filter with m derivatives per axis.

    Returns the sample variances (ddof = 1) of the last k positions, first differences and second
    differences [m2]; the last are 0 for m = 3.
    """
    length = window.shape[1]
    n = length + 2 - m
    x1, y1 = _position(window, k, length - 1)
    x2, y2 = _position(window, k, length - 2)
    # The newest first and second differences.
    dx, dy = x - x1, y - y1
    ddx, ddy = dx - (x1 - x2), dy - (y1 - y2)

    positions = steps = changes = (0.0, 0.0, 0.0, 0.0)
    x1, y1 = _position(window, k, 1)
    sx, sy = 0.0, 0.0
    _put(window, k, 0, x1, y1)
    if m > 3:
        x2, y2 = _position(window, k, 2)
        sx, sy = x2 - x1, y2 - y1
        x1, y1 = x2, y2
        _put(window, k, 1, x1, y1)
    for i in range(m - 1, length):
        x2, y2 = _position(window, k, i)
        _put(window, k, i - 1, x2, y2)
        positions = _add(positions, x2 - x, y2 - y)
        steps = _add(steps, x2 - x1 - dx, y2 - y1 - dy)
        if m > 3:
            changes = _add(changes, x2 - x1 - sx - ddx, y2 - y1 - sy - ddy)
        sx, sy = x2 - x1, y2 - y1
        x1, y1 = x2, y2
    _put(window, k, length - 1, x, y)
    return _variances(positions, n), _variances(steps, n), _variances(changes, n)


@inlined
def weigh(weight: FloatArray, k: int, d: int, variances: Pair, factor: float, joint: bool) -> None:
    """Weigh the d-th derivative of track k: w = min(sigma / l, 1) (paper, eq. weights)."""
    x, y = variances
    if joint:
        x = y = x + y
    weight[k, 0, d] = min(math.sqrt(x) / factor, 1.0)
    weight[k, 1, d] = min(math.sqrt(y) / factor, 1.0)


@inlined
def _position(window: FloatArray, k: int, i: int) -> Pair:
    return window[k, i, 0], window[k, i, 1]


@inlined
def _put(window: FloatArray, k: int, i: int, x: float, y: float) -> None:
    window[k, i, 0] = x
    window[k, i, 1] = y


@inlined
def _add(sums: Sums, x: float, y: float) -> Sums:
    return sums[0] + x, sums[1] + y, sums[2] + x * x, sums[3] + y * y


@inlined
def _variances(sums: Sums, n: int) -> Pair:
    """Sample variances of n values, of which one is 0, from the sums of the others."""
    by_n, by_rest = 1.0 / n, 1.0 / (n - 1)
    x = sums[2] - by_n * sums[0] * sums[0]
    y = sums[3] - by_n * sums[1] * sums[1]
    return by_rest * max(x, 0.0), by_rest * max(y, 0.0)
