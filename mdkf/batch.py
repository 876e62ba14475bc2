"""What a kernel does with one track of a batch, whichever estimator it is of.

A batch is a named tuple of the arrays of an estimator's state, with the numbers of its model for
one time step. The functions below are dispatched on its type, as `functools.singledispatch` does
it; compiled code resolves them when it is compiled, so that one loop serves all estimators at the
cost of a loop of their own. Built-in estimators make batches by `batch(state, dt)`.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import Any

from numba.extending import overload

from mdkf.compiled import kernel
from mdkf.tables import FloatArray

Batch = Any
"""A named tuple for which the functions below are registered."""

Pair = tuple[float, float]
"""x and y."""

Noise = tuple[float, float, float]
"""Variance of x, covariance of x and y, variance of y [m2]."""

Moments = tuple[float, float, float, float, float, float, float]
"""Position x, y [m], velocity x, y [m/s], the position's covariance xx, xy, yy [m2]."""


N_MOMENTS = 7
"""How many `Moments` there are."""


@singledispatch
def start(batch: Batch, k: int, z: Pair) -> None:
    """Make track k one that was first seen at z [m]."""
    raise NotImplementedError


@singledispatch
def predict(batch: Batch, k: int) -> None:
    """Predict track k by the batch's time step."""
    raise NotImplementedError


@singledispatch
def update(batch: Batch, k: int, z: Pair, R: Noise) -> None:
    """Update track k with the measurement z [m]; NaN says that there is none."""
    raise NotImplementedError


@singledispatch
def moments(batch: Batch, k: int) -> Moments:
    """What track k's estimate is."""
    raise NotImplementedError


@singledispatch
def diagnose(batch: Batch, k: int, columns: FloatArray, first: int, row: int) -> None:
    """Write track k's diagnostics, in the order of the estimator's `diagnostics`, into
    columns[first:, row]."""
    raise NotImplementedError


@kernel
def predict_all(batch: Batch, n: int) -> None:
    """Predict tracks 0..n-1."""
    for k in range(n):
        predict(batch, k)


@kernel
def update_all(batch: Batch, z: FloatArray, R: FloatArray) -> None:
    """Update all tracks with z (n, 2) [m], a row of NaN where there is none, R (n, 2, 2) [m2]."""
    for k in range(z.shape[0]):
        noise = R[k, 0, 0], R[k, 0, 1], R[k, 1, 1]
        update(batch, k, (z[k, 0], z[k, 1]), noise)


@kernel
def moments_of_all(
    batch: Batch, position: FloatArray, velocity: FloatArray, covariance: FloatArray
) -> None:
    """Positions (n, 2), velocities (n, 2) and the positions' covariances (n, 2, 2)."""
    for k in range(position.shape[0]):
        px, py, vx, vy, cxx, cxy, cyy = moments(batch, k)
        position[k, 0], position[k, 1] = px, py
        velocity[k, 0], velocity[k, 1] = vx, vy
        covariance[k, 0, 0], covariance[k, 1, 1] = cxx, cyy
        covariance[k, 0, 1], covariance[k, 1, 0] = cxy, cxy


@kernel
def filter_all(
    batch: Batch,
    z: FloatArray,
    R: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    covariance: FloatArray,
    predicted: FloatArray,
) -> None:
    """All frames of z (T, n, 2), R (T or 1, n, 2, 2), of tracks that started in the first;
    predicted (T, n, 2, 2): the covariances before the update, or (0, n, 2, 2) for none."""
    for t in range(z.shape[0]):
        if t > 0:
            predict_all(batch, z.shape[1])
            if t < predicted.shape[0]:
                moments_of_all(batch, position[t], velocity[t], predicted[t])
            update_all(batch, z[t], R[t % R.shape[0]])
        moments_of_all(batch, position[t], velocity[t], covariance[t])


def is_batched(estimator: object) -> bool:
    """Whether an estimator has kernels: it is one of this package's very classes. A subclass may
    have changed what they do."""
    return type(estimator).__module__.startswith("mdkf.") and hasattr(estimator, "batch")


def _compile(dispatched: Any, arguments: Callable[..., Any]) -> None:
    """Compiled code takes the function registered for its batch's type."""
    options: Any = {"error_model": "numpy", "forceinline": True, "_nrt": False}
    overload(dispatched, jit_options=options, strict=False)(arguments)


_compile(start, lambda batch, k, z: start.dispatch(batch.instance_class))
_compile(predict, lambda batch, k: predict.dispatch(batch.instance_class))
_compile(update, lambda batch, k, z, R: update.dispatch(batch.instance_class))
_compile(moments, lambda batch, k: moments.dispatch(batch.instance_class))
_compile(diagnose, lambda batch, k, columns, first, row: diagnose.dispatch(batch.instance_class))
