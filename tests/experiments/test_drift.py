"""Claim: drift is the filter's own error in the gap, fed its object's detections alone."""

import numpy as np
import pytest

from experiments.drift import drift
from mdkf import DETECTORS, Detections, estimator
from mdkf.reference import filterpy_kalman
from tests.tables import gaps_of, trace_of

SETTINGS = DETECTORS["pointrcnn"]
GAPS = gaps_of((1, 30, 45), (2, 40, 55))
N = 70


def scene(seed: int) -> tuple[list[tuple[int, int, float, float]], Detections]:
    """Two objects that appear at different frames, and their noisy detections without the gaps;
    a third without a gap, and clutter on top of the first."""
    rng = np.random.default_rng(seed)
    rows = [(k, 1, 0.8 * k, 0.0) for k in range(N)]
    rows += [(k, 2, 30.0, 0.01 * k**2) for k in range(3, N)]
    rows += [(k, 3, -10.0, 4.0) for k in range(N)]
    seen = [
        (k, i, x + rng.normal(0, 0.2), y + rng.normal(0, 0.1))
        for k, i, x, y in rows
        if not (i == 1 and 30 <= k < 45) and not (i == 2 and 40 <= k < 55) and rng.random() > 0.1
    ]
    seen += [(k, -1, 0.8 * k, 0.1) for k in range(30, 45)]
    frame, source, x, y = np.array(seen, dtype=float).T
    columns = {name: np.ones(len(seen)) for name in Detections.column_types()}
    columns |= {"frame": frame, "source": source, "x": x, "y": y}
    return rows, Detections.from_columns(columns, n_frames=N, dt=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_it_equals_filterpy_object_by_object(seed: int) -> None:
    """CA, one filterpy filter for each object; neither clutter nor other objects come near."""
    rows, seen = scene(seed)
    told = drift(trace_of(rows, N), seen, GAPS, estimator("ca"), SETTINGS)
    assert sorted(told["object_id"].unique()) == [1, 2]
    for identifier in (1, 2):
        own = seen.rows_of(identifier)
        measured = dict(zip(seen.frame[own].tolist(), own, strict=True))
        truth = {k: (x, y) for k, i, x, y in rows if i == identifier}
        expected, oracle = {}, None
        for k in range(min(measured), N):
            z = None
            if k in measured:
                z = np.array([seen.x[measured[k]], seen.y[measured[k]]])
            if oracle is None:
                oracle = filterpy_kalman(z, 2, 0.1)
            else:
                oracle.predict()
                oracle.update(z, R=np.diag([SETTINGS.x_var, SETTINGS.y_var]))
            expected[k] = np.hypot(*(oracle.x[[0, 3]] - truth[k]))
        got = told.filter(object_id=identifier).sort("frame")
        assert got["frame"].to_list() == list(expected)
        np.testing.assert_allclose(got["drift"], list(expected.values()), rtol=1e-9, atol=1e-12)


def test_no_gaps_give_no_rows() -> None:
    """With the columns all the same, so that errors can be joined."""
    rows, seen = scene(0)
    empty = drift(trace_of(rows, N), seen, gaps_of(), estimator("md"), SETTINGS)
    assert empty.columns == ["object_id", "frame", "drift"]
    assert len(empty) == 0
