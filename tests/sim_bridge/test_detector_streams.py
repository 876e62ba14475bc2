"""Claim: every object draws its own noise: what happens to others changes none of its numbers, and
the same inputs give the same bytes.
"""

import importlib

import numpy as np
import pytest

from mdkf.tables import CLUTTER, Detections, Trace
from sim_bridge import detect, load_profile
from tests.sim_bridge.measured import MAX_RANGE, POINTRCNN, with_columns
from tests.sim_bridge.worlds import convoy


def scene(seed: str = "0") -> Trace:
    rng = np.random.default_rng(10)
    n = 40
    return convoy(
        rng.uniform(3, MAX_RANGE + 3, n), rng.uniform(-3, 3, n), rng.random(n), 80, seed=seed
    )


def same_rows(a: Detections, b: Detections) -> bool:
    return a.columns().keys() == b.columns().keys() and all(
        np.array_equal(column, b.columns()[name]) for name, column in a.columns().items()
    )


def test_removing_objects_changes_nothing_of_the_others() -> None:
    """Without every third object, the rest and the clutter are detected as before, bit for bit."""
    trace = scene()
    some = trace.take(trace.object_id % 3 != 0)
    all_of_them, rest = detect(trace, seed=11), detect(some, seed=11)
    kept = (all_of_them.source == CLUTTER) | (all_of_them.source % 3 != 0)
    assert 0 < len(rest) < len(all_of_them)
    assert same_rows(all_of_them.take(kept), rest)


def test_hiding_an_object_removes_rows_and_changes_no_number() -> None:
    """Where an object's visible fraction drops to 0 for some frames, only those rows go: neither
    its own later noise nor anybody else's changes."""
    trace = scene()
    target = int(trace.object_id[np.argmin(trace.sensor_distance())])
    gap = (trace.object_id == target) & (trace.frame >= 30) & (trace.frame < 50)
    hidden = with_columns(trace, visible=np.where(gap, 0.0, trace.visible))
    before, after = detect(trace, seed=12), detect(hidden, seed=12)
    gone = (before.source == target) & (before.frame >= 30) & (before.frame < 50)
    assert gone.sum() > 5
    assert same_rows(before.take(~gone), after)


@pytest.mark.parametrize("batch", [1, 97, 1000])
def test_batches_change_nothing(monkeypatch: pytest.MonkeyPatch, batch: int) -> None:
    """However few rows are worked on at a time, the bytes are the same, also with objects that
    come and go."""
    trace = scene()
    trace = trace.take((7 * trace.object_id + trace.frame) % 80 > 2 * trace.object_id)
    whole = detect(trace, seed=20).content_hash()
    module = importlib.import_module("sim_bridge.detect")
    assert len(trace) < module.BATCH
    monkeypatch.setattr(module, "BATCH", batch)
    assert detect(trace, seed=20).content_hash() == whole


def test_the_same_seed_is_the_same_table_and_another_is_not() -> None:
    """Twice the same is the same bytes; another detector seed, or another seed of the trace,
    gives other noise everywhere."""
    first = detect(scene(), seed=13)
    assert first.content_hash() == detect(scene(), seed=13).content_hash()
    for other in (detect(scene(), seed=14), detect(scene(seed="1"), seed=13)):
        assert not np.isin(first.x, other.x).any()
        assert not np.isin(first.score, other.score).any()


def test_a_profile_is_given_by_name_path_or_itself() -> None:
    """The same bytes."""
    named = detect(scene(), "pointrcnn", seed=15)
    for detector in (POINTRCNN, str(POINTRCNN), load_profile("pointrcnn")):
        assert detect(scene(), detector, seed=15).content_hash() == named.content_hash()


def test_detections_say_where_they_come_from() -> None:
    """Profile, seed and the trace's hash are added to the trace's own provenance."""
    trace = scene()
    provenance = detect(trace, seed=15).provenance
    expected = {
        **trace.provenance,
        "detector": "pointrcnn",
        "detector_seed": "15",
        "trace": trace.content_hash(),
    }
    assert provenance == expected
