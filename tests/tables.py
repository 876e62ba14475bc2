"""Random valid tables for property tests."""

from typing import Any

import numpy as np

from mdkf.tables import KINDS, REGIMES, Detections, EgoPath, Trace, Tracks


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
