"""Scalar kernels of a whole track: both axes, apart as long as nothing correlates them.

x and y move by the same chain (`mdkf.chain`) and stay independent while the measurement noise is
diagonal; then each axis is predicted and updated by itself. Noise with a covariance between x and
y couples them, and so does mixing (`mdkf.imm`): then the whole state is updated,

    S = H P H' + R,  K = P H' S^-1,  x = x + K y,  P = (I - K H) P (I - K H)' + K R K',

by two independent numbers in turn. As in `mdkf.chain`, Joseph's form is written out for the
optimal gain.
"""

from mdkf.batch import Moments, Noise, Pair
from mdkf.chain import are_coupled, predict_axis, predict_cross, update_axis
from mdkf.compiled import inlined
from mdkf.tables import FloatArray


@inlined
def start_track(x: FloatArray, P: FloatArray, k: int, z: Pair, variance: tuple[float, ...]) -> None:
    """Track k of the batch x (n, 2m), P (n, 2m, 2m) at rest in z; variance (m,) of an axis."""
    m = len(variance)
    for i in range(2 * m):
        x[k, i] = 0.0
        for j in range(2 * m):
            P[k, i, j] = 0.0
    for axis in range(2):
        x[k, axis * m] = z[axis]
        for d in range(m):
            P[k, axis * m + d, axis * m + d] = variance[d]


@inlined
def predict_track(
    x: FloatArray, P: FloatArray, k: int, taylor: tuple[float, ...], Q: FloatArray
) -> None:
    """Predict track k of the batch x (n, 2m), P (n, 2m, 2m); taylor (m,) is the first row of F."""
    m = len(taylor)
    predict_axis(x, P, k, 0, taylor, Q)
    predict_axis(x, P, k, m, taylor, Q)
    if are_coupled(P, k, m):
        predict_cross(P, k, taylor)


@inlined
def update_track(
    x: FloatArray,
    P: FloatArray,
    k: int,
    m: int,
    z: Pair,
    R: Noise,
    work: FloatArray,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Update track k with the measurement z = H x + N(0, R).

    work (2m, 2) is overwritten. Returns the innovation y (2 numbers), its normalised square (NIS)
    y' S^-1 y, det S, and H K (2 x 2, by rows).
    """
    if R[1] == 0.0 and not are_coupled(P, k, m):
        yx, sx, gain_x = update_axis(x, P, k, 0, m, z[0], R[0])
        yy, sy, gain_y = update_axis(x, P, k, m, m, z[1], R[2])
        return yx, yy, yx * yx / sx + yy * yy / sy, sx * sy, gain_x, 0.0, 0.0, gain_y
    return _update_coupled(x, P, k, m, z, R, work)


@inlined
def _update_coupled(
    x: FloatArray,
    P: FloatArray,
    k: int,
    m: int,
    z: Pair,
    R: Noise,
    work: FloatArray,
) -> tuple[float, float, float, float, float, float, float, float]:
    # R = L D L': the errors of px and of py - c px are independent, so these are two updates by
    # one number each. S^-1 by its determinant would lose all digits where x and y are almost
    # fully correlated.
    r00, r01, r11 = R
    c = r01 / r00
    yx, yy = z[0] - x[k, 0], z[1] - x[k, m]
    sx = _update_along(x, P, k, m, 1.0, 0.0, yx, r00, work)
    from_x, to_y = work[0, 1], work[m, 1]
    rest = (z[1] - x[k, m]) - c * (z[0] - x[k, 0])
    sy = _update_along(x, P, k, m, -c, 1.0, rest, (r00 * r11 - r01 * r01) / r00, work)
    gx, gy = work[0, 1], work[m, 1]
    # The two gains as one of (px, py): the second also saw what the first had moved.
    back = c + (to_y - c * from_x)
    nis = yx * yx / sx + rest * rest / sy
    return yx, yy, nis, sx * sy, from_x - gx * back, gx, to_y - gy * back, gy


@inlined
def _update_along(
    x: FloatArray,
    P: FloatArray,
    k: int,
    m: int,
    hx: float,
    hy: float,
    y: float,
    r: float,
    work: FloatArray,
) -> float:
    """Update with a measurement of hx px + hy py, innovation y, variance r; hy is 0 or 1.

    Returns the innovation's variance; P H' is left in work[:, 0], the gain in work[:, 1].
    """
    n = 2 * m
    for i in range(n):
        work[i, 0] = hx * P[k, i, 0] + hy * P[k, i, m]
    s: float = hx * work[0, 0] + hy * work[m, 0] + r
    inverse = 1.0 / s
    for i in range(n):
        work[i, 1] = work[i, 0] * inverse
        x[k, i] += work[i, 1] * y
    for i in range(n):
        for j in range(i + 1):
            value = P[k, i, j] - work[i, 1] * work[j, 0]
            P[k, i, j] = value
            P[k, j, i] = value
    # (I - K H) P H' = K r, which gives the covariances with the position that was measured.
    if hy == 0.0:
        for i in range(n):
            P[k, i, 0] = work[i, 1] * r
            P[k, 0, i] = P[k, i, 0]
    else:
        for i in range(n):
            if i != m:
                P[k, i, m] = work[i, 1] * r - hx * P[k, i, 0]
                P[k, m, i] = P[k, i, m]
        P[k, m, m] = work[m, 1] * r - hx * P[k, 0, m]
    return s


@inlined
def chain_moments(x: FloatArray, P: FloatArray, k: int, m: int) -> Moments:
    """Position and velocity of track k, and the position's covariance."""
    return x[k, 0], x[k, m], x[k, 1], x[k, m + 1], P[k, 0, 0], P[k, 0, m], P[k, m, m]


@inlined
def write_innovation(
    innovation: FloatArray, nis: FloatArray, k: int, columns: FloatArray, first: int, row: int
) -> None:
    """Write track k's innovation and NIS into columns[first : first + 3, row]."""
    columns[first, row] = innovation[k, 0]
    columns[first + 1, row] = innovation[k, 1]
    columns[first + 2, row] = nis[k]
