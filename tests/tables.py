"""Tables for the tests: random ones, and small ones written by hand."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.gaps import Gaps
from mdkf.tables import KINDS, REGIMES, Detections, EgoPath, Trace, Tracks

Rows = Sequence[tuple[int, int, float, float]]
"""(frame, object or track, x [m], y [m])"""


def random_trace(rng: np.random.Generator, rows: int) -> Trace:
    """`rows` objects-in-frames, in random row order, over 12 frames."""
    ego = EgoPath.from_columns(
        {"frame": np.arange(12)[::-1], **_reals(rng, EgoPath, 12)}, n_frames=12, dt=0.1
    )
    columns = _reals(rng, Trace, rows) | _keys(rng, "object_id", rows)
    columns["kind"] = rng.integers(0, len(KINDS), rows)
    columns["regime"] = rng.integers(0, len(REGIMES), rows)
    columns["turning"] = rng.random(rows) < 0.5
    columns["visible"] = rng.random(rows)
    return Trace.from_columns(
        columns, n_frames=12, dt=0.1, ego=ego, provenance={"scenario": "random", "seed": "é 1"}
    )


def random_detections(rng: np.random.Generator, rows: int) -> Detections:
    """`rows` boxes, a third of them clutter."""
    columns = _reals(rng, Detections, rows) | _keys(rng, "source", rows)
    columns["source"] = np.where(rng.random(rows) < 0.3, -1, columns["source"])
    return Detections.from_columns(columns, n_frames=12, dt=0.1)


def random_tracks(rng: np.random.Generator, rows: int) -> Tracks:
    """`rows` estimates with two diagnostics."""
    columns = _reals(rng, Tracks, rows) | _keys(rng, "track_id", rows)
    columns["cov_xx"] = columns["cov_yy"] = 1.0 + rng.random(rows)
    columns["cov_xy"] = rng.random(rows) - 0.5
    columns["coasted"] = rng.random(rows) < 0.5
    diagnostics = {"weight_vx": rng.random(rows), "weight_vy": rng.random(rows)}
    return Tracks.from_columns(columns, n_frames=12, dt=0.1, diagnostics=diagnostics)


def _reals(rng: np.random.Generator, kind: type, rows: int) -> dict[str, Any]:
    """Every real column; lengths above zero."""
    types = kind.column_types()  # type: ignore[attr-defined]
    columns: dict[str, Any] = {
        c: rng.normal(0, 50, rows) for c, t in types.items() if t.kind == "f"
    }
    for size in {"length", "width", "height"} & columns.keys():
        columns[size] = 0.5 + np.abs(columns[size])
    return columns


def _keys(rng: np.random.Generator, name: str, rows: int) -> dict[str, Any]:
    """Distinct (frame, id) pairs in random order, including none at all in some frames."""
    pairs = rng.permutation(12 * 10)[:rows]
    return {"frame": pairs % 12, name: pairs // 12}


def trace_of(rows: Rows, n_frames: int, ego: float = 0.0, **columns: Sequence[float]) -> Trace:
    """Truth of cars in full view; the sensor starts at the origin, `ego` metres along x a frame.

    columns: further columns in the order of `rows`, e.g. visible.
    """
    frame, identifier, x, y = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    values = {name: np.zeros(len(frame)) for name in Trace.column_types()}
    values |= {"frame": frame, "object_id": identifier, "x": x, "y": y}
    values |= {"length": np.full(len(frame), 4.5), "width": np.full(len(frame), 1.8)}
    values |= {"height": np.full(len(frame), 1.5), "visible": np.ones(len(frame))}
    values |= {name: np.asarray(given, dtype=np.float64) for name, given in columns.items()}
    path = {name: np.zeros(n_frames) for name in EgoPath.column_types()}
    path |= {"frame": np.arange(n_frames), "x": ego * np.arange(n_frames)}
    return Trace.from_columns(
        values,
        n_frames=n_frames,
        dt=0.1,
        ego=EgoPath.from_columns(path, n_frames=n_frames, dt=0.1),
    )


def tracks_of(
    rows: Rows,
    n_frames: int,
    coasted: Sequence[bool] | None = None,
    provenance: dict[str, str] | None = None,
) -> Tracks:
    """Tracks at the given places; `coasted` in the order of `rows`."""
    frame, identifier, x, y = np.array(rows, dtype=np.float64).reshape(-1, 4).T
    values = {name: np.ones(len(frame)) for name in Tracks.column_types()}
    values |= {"frame": frame, "track_id": identifier, "x": x, "y": y}
    values |= {"cov_xy": np.zeros(len(frame))}
    values |= {"coasted": np.zeros(len(frame)) if coasted is None else np.asarray(coasted)}
    return Tracks.from_columns(values, n_frames=n_frames, dt=0.1, provenance=provenance or {})


def gaps_of(*gaps: tuple[int, int, int]) -> Gaps:
    """Gaps of (object, start, stop)."""
    return Gaps(*np.array(gaps, dtype=np.int64).reshape(-1, 3).T)
