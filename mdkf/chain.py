"""Scalar kernels of one axis: predict and update a chain [p, v, a, j] and its covariance.

A track's state is x = [px, vx, (ax), (jx), py, vy, (ay), (jy)] with covariance P over the same
entries. The kernels work in place on one axis of one track of a batch: `k` is the track, `o` the
axis's first entry (0 or m), m = order + 1 the derivatives per axis.

    prediction   x = F x,                       P = F P F' + Q        (`mdkf.motion`)
    update       K = P H' / s, s = P_pp + r,    x = x + K y, y = z - p
                 P = (I - K H) P (I - K H)' + K r K'                  (Joseph form)

For the optimal gain (I - K H) P H' = K r, so Joseph's form is K r in the row and column of the
position and P - K H P elsewhere. Written so, no 1 - K is ever rounded, which is what Joseph's form
protects from, and P stays symmetric to the bit.

The entries are spelt out, two letters for a covariance (pv = cov(position, velocity)): compilers
do not keep a small matrix in registers, they do keep scalars (2.7x faster for CA than loops).
"""

from mdkf.compiled import inlined
from mdkf.tables import FloatArray

ABSENT = -0.0
"""A derivative that the model does not have. x + (-0.0) is x to the bit for every x, so the
compiler drops the terms of CJ that CA and CV lack."""


@inlined
def predict_axis(
    x: FloatArray, P: FloatArray, k: int, o: int, taylor: tuple[float, ...], Q: FloatArray
) -> None:
    """x <- F x and P <- F P F' + Q; taylor (m,) is the first row of F."""
    m = len(taylor)
    # dt, dt^2 / 2 and dt^3 / 6
    t1, t2, t3 = _step(taylor, 1), _step(taylor, 2), _step(taylor, 3)

    p, v, a, j = x[k, o], x[k, o + 1], _mean(x, k, o + 2, m > 2), _mean(x, k, o + 3, m > 3)
    x[k, o] = p + t1 * v + t2 * a + t3 * j
    x[k, o + 1] = v + t1 * a + t2 * j
    if m > 2:
        x[k, o + 2] = a + t1 * j

    pp, pv, vv = P[k, o, o], P[k, o, o + 1], P[k, o + 1, o + 1]
    pa, va, aa = _entry(P, k, o, 0, 2, m), _entry(P, k, o, 1, 2, m), _entry(P, k, o, 2, 2, m)
    pj, vj = _entry(P, k, o, 0, 3, m), _entry(P, k, o, 1, 3, m)
    aj, jj = _entry(P, k, o, 2, 3, m), _entry(P, k, o, 3, 3, m)
    # P <- F P, the upper triangle
    pp, pv = pp + t1 * pv + t2 * pa + t3 * pj, pv + t1 * vv + t2 * va + t3 * vj
    vv, pa = vv + t1 * va + t2 * vj, pa + t1 * va + t2 * aa + t3 * aj
    pj, va = pj + t1 * vj + t2 * aj + t3 * jj, va + t1 * aa + t2 * aj
    vj, aa = vj + t1 * aj + t2 * jj, aa + t1 * aj
    aj = aj + t1 * jj
    # P <- P F' + Q
    _put(P, k, o, o, pp + t1 * pv + t2 * pa + t3 * pj + Q[0, 0])
    _put(P, k, o, o + 1, pv + t1 * pa + t2 * pj + Q[0, 1])
    _put(P, k, o + 1, o + 1, vv + t1 * va + t2 * vj + Q[1, 1])
    if m > 2:
        _put(P, k, o, o + 2, pa + t1 * pj + Q[0, 2])
        _put(P, k, o + 1, o + 2, va + t1 * vj + Q[1, 2])
        _put(P, k, o + 2, o + 2, aa + t1 * aj + Q[2, 2])
    if m > 3:
        _put(P, k, o, o + 3, pj + Q[0, 3])
        _put(P, k, o + 1, o + 3, vj + Q[1, 3])
        _put(P, k, o + 2, o + 3, aj + Q[2, 3])
        _put(P, k, o + 3, o + 3, jj + Q[3, 3])


@inlined
def update_axis(
    x: FloatArray, P: FloatArray, k: int, o: int, m: int, z: float, r: float
) -> tuple[float, float, float]:
    """Update with the position z = p + N(0, r); returns the innovation y, its variance s, K_p."""
    pp, pv, vv = P[k, o, o], P[k, o, o + 1], P[k, o + 1, o + 1]
    pa, va, aa = _entry(P, k, o, 0, 2, m), _entry(P, k, o, 1, 2, m), _entry(P, k, o, 2, 2, m)
    pj, vj = _entry(P, k, o, 0, 3, m), _entry(P, k, o, 1, 3, m)
    aj, jj = _entry(P, k, o, 2, 3, m), _entry(P, k, o, 3, 3, m)
    s = pp + r
    y = z - x[k, o]
    inverse = 1.0 / s
    gain_p, gain_v, gain_a, gain_j = pp * inverse, pv * inverse, pa * inverse, pj * inverse

    x[k, o] += gain_p * y
    x[k, o + 1] += gain_v * y
    _put(P, k, o, o, gain_p * r)
    _put(P, k, o, o + 1, gain_v * r)
    _put(P, k, o + 1, o + 1, vv - gain_v * pv)
    if m > 2:
        x[k, o + 2] += gain_a * y
        _put(P, k, o, o + 2, gain_a * r)
        _put(P, k, o + 1, o + 2, va - gain_a * pv)
        _put(P, k, o + 2, o + 2, aa - gain_a * pa)
    if m > 3:
        x[k, o + 3] += gain_j * y
        _put(P, k, o, o + 3, gain_j * r)
        _put(P, k, o + 1, o + 3, vj - gain_j * pv)
        _put(P, k, o + 2, o + 3, aj - gain_j * pa)
        _put(P, k, o + 3, o + 3, jj - gain_j * pj)
    return y, s, gain_p


@inlined
def predict_cross(P: FloatArray, k: int, taylor: tuple[float, ...]) -> None:
    """C <- F C F' of the block C = cov(x axis, y axis)."""
    m = len(taylor)
    t1, t2, t3 = _step(taylor, 1), _step(taylor, 2), _step(taylor, 3)
    for column in range(m, 2 * m):
        p, v = P[k, 0, column], P[k, 1, column]
        a = P[k, 2, column] if m > 2 else ABSENT
        j = P[k, 3, column] if m > 3 else ABSENT
        P[k, 0, column] = p + t1 * v + t2 * a + t3 * j
        P[k, 1, column] = v + t1 * a + t2 * j
        if m > 2:
            P[k, 2, column] = a + t1 * j
    for row in range(m):
        p, v = P[k, row, m], P[k, row, m + 1]
        a = P[k, row, m + 2] if m > 2 else ABSENT
        j = P[k, row, m + 3] if m > 3 else ABSENT
        _put(P, k, row, m, p + t1 * v + t2 * a + t3 * j)
        _put(P, k, row, m + 1, v + t1 * a + t2 * j)
        if m > 2:
            _put(P, k, row, m + 2, a + t1 * j)
        if m > 3:
            _put(P, k, row, m + 3, j)


@inlined
def are_coupled(P: FloatArray, k: int, m: int) -> bool:
    """Whether x and y of a track are correlated."""
    total = 0.0
    for row in range(m):
        for column in range(m, 2 * m):
            total += abs(P[k, row, column])
    return total != 0.0


@inlined
def _step(taylor: tuple[float, ...], d: int) -> float:
    return taylor[d] if d < len(taylor) else 0.0


@inlined
def _mean(x: FloatArray, k: int, entry: int, present: bool) -> float:
    return x[k, entry] if present else ABSENT


@inlined
def _entry(P: FloatArray, k: int, o: int, i: int, j: int, m: int) -> float:
    return P[k, o + i, o + j] if j < m else ABSENT


@inlined
def _put(P: FloatArray, k: int, i: int, j: int, value: float) -> None:
    P[k, i, j] = value
    P[k, j, i] = value
