"""Claim: drift is the filter's own error in the gap, fed its object's detections alone."""

from dataclasses import replace

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


def by_filterpy(
    seen: Detections,
    identifier: int,
    truth: dict[int, tuple[float, float]],
    hidden: range,
    max_variance: float = SETTINGS.max_variance,
) -> dict[int, float]:
    """Errors by frame of one filterpy filter, deleted when its prediction is too uncertain outside
    the gap, and started anew by the next detection."""
    own = seen.rows_of(identifier)
    measured = {int(seen.frame[k]): np.array([seen.x[k], seen.y[k]]) for k in own}
    found, oracle = {}, None
    for k in range(N):
        if oracle is not None:
            oracle.predict()
            if k not in hidden and oracle.P[[0, 3], [0, 3]].max() > max_variance:
                oracle = None
            else:
                z = measured.get(k)
                oracle.update(z, R=np.diag([SETTINGS.x_var, SETTINGS.y_var]))
        if oracle is None and k in measured:
            oracle = filterpy_kalman(measured[k], 2, 0.1)
        if oracle is not None:
            found[k] = float(np.hypot(*(oracle.x[[0, 3]] - truth[k])))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_it_equals_filterpy_object_by_object(seed: int) -> None:
    """CA, one filterpy filter for each object; neither clutter nor other objects come near."""
    rows, seen = scene(seed)
    told = drift(trace_of(rows, N), seen, GAPS, estimator("ca"), SETTINGS)
    assert sorted(told["object_id"].unique()) == [1, 2]
    for identifier, hidden in ((1, range(30, 45)), (2, range(40, 55))):
        truth = {k: (x, y) for k, i, x, y in rows if i == identifier}
        expected = by_filterpy(seen, identifier, truth, hidden)
        got = told.filter(object_id=identifier).sort("frame")
        assert got["frame"].to_list() == list(expected)
        np.testing.assert_allclose(got["drift"], list(expected.values()), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("max_variance", "unseen", "again"), [(4.0, [18, 19, 20], 21), (3.0, [], 17)]
)
def test_a_track_lost_from_sight_starts_anew(
    max_variance: float, unseen: list[int], again: int
) -> None:
    """Object 1 is away naturally for so long that its track is deleted, the second time only in the
    frame in which it is seen again; in the protocol's own gap no track is deleted."""
    rows, seen = scene(0)
    seen = seen.take((seen.source != 1) | (seen.frame < 8) | (seen.frame >= again))
    settings = replace(SETTINGS, max_variance=max_variance)
    told = drift(trace_of(rows, N), seen, GAPS, estimator("ca"), settings).filter(object_id=1)
    truth = {k: (x, y) for k, i, x, y in rows if i == 1}
    expected = by_filterpy(seen, 1, truth, range(30, 45), max_variance)
    assert [k for k in range(N) if k not in expected] == unseen
    assert told["frame"].to_list() == list(expected)
    np.testing.assert_allclose(told["drift"], list(expected.values()), rtol=1e-9, atol=1e-12)
    # A start is where the detection is: the track did not live on.
    row = seen.rows_of(1)[seen.frame[seen.rows_of(1)] == again]
    assert expected[again] == np.hypot(seen.x[row] - truth[again][0], seen.y[row] - truth[again][1])


def test_no_gaps_give_no_rows() -> None:
    """With the columns all the same, so that errors can be joined."""
    rows, seen = scene(0)
    empty = drift(trace_of(rows, N), seen, gaps_of(), estimator("md"), SETTINGS)
    assert empty.columns == ["object_id", "frame", "drift"]
    assert len(empty) == 0
