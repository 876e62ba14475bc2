"""Claim: the occlusion protocol removes exactly what the paper says, and changes nothing else."""

import json
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from experiments.occlusion import OcclusionProtocol
from mdkf.tables import CLUTTER, Detections, EgoPath, Trace
from sim_bridge import detect

Frames = Mapping[int, Sequence[int] | range]


def detections_of(frames: Frames, n_frames: int = 200, seed: int = 0) -> Detections:
    """Detections of each source in the given frames; every other number is random."""
    rng = np.random.default_rng(seed)
    frame = np.concatenate([np.asarray(f, dtype=np.int64) for f in frames.values()])
    columns = {"frame": frame, "source": np.repeat([*frames], [len(f) for f in frames.values()])}
    for name in ("x", "y", "z", "yaw", "length", "width", "height", "score"):
        columns[name] = rng.uniform(1.0, 50.0, len(frame))
    provenance = {"scenario": "by hand", "trace": "abc"}
    return Detections.from_columns(columns, n_frames=n_frames, dt=0.1, provenance=provenance)


def random_detections(seed: int) -> Detections:
    """Twelve objects that come and go and are missed now and then, and clutter."""
    rng = np.random.default_rng(seed)
    frames: dict[int, Sequence[int]] = {}
    for identifier in rng.permutation(40)[:12]:
        begin, end = np.sort(rng.integers(0, 200, 2))
        every = np.arange(begin, end + 1)
        frames[int(identifier)] = every[rng.random(len(every)) > rng.choice([0.0, 0.02, 0.2])]
    frames[CLUTTER] = rng.integers(0, 200, 60)
    return detections_of(frames, seed=seed)


def removed_rows(before: Detections, after: Detections) -> np.ndarray:
    """Mask of the rows that are gone; all others must be there with every number, bit for bit."""
    rows = [column.tobytes() for column in _as_rows(before)]
    left = {row.tobytes() for row in _as_rows(after)}
    gone = np.array([row not in left for row in rows], dtype=bool)
    assert after == before.take(~gone)
    return gone


def _as_rows(table: Detections) -> np.ndarray:
    return np.column_stack([c.astype(np.float64) for c in table.columns().values()])


PROTOCOLS = [
    OcclusionProtocol(kind, length, warmup)
    for kind in ("mid", "late")
    for length, warmup in ((20, 35), (7, 12), (1, 1), (40, 3))
]


@pytest.mark.parametrize("protocol", PROTOCOLS, ids=str)
def test_an_object_is_eligible_from_exactly_the_papers_count_on(
    protocol: OcclusionProtocol,
) -> None:
    """n >= warmup + length detections for `late`; one more for `mid`, where it reappears."""
    least = protocol.warmup + protocol.length + (protocol.kind == "mid")
    given = detections_of({1: range(least - 1), 2: range(50, 50 + least), 3: range(least + 1)})
    assert protocol.gaps(given).object_id.tolist() == [2, 3]


@pytest.mark.parametrize("protocol", PROTOCOLS, ids=str)
@pytest.mark.parametrize("seed", range(10))
def test_exactly_the_lengths_consecutive_detections_go_and_all_else_stays(
    protocol: OcclusionProtocol, seed: int
) -> None:
    """Of every eligible object one unbroken run of its detections, after the warm-up; of the
    others and of clutter nothing; what stays keeps every number."""
    given = random_detections(seed)
    gone = removed_rows(given, protocol.apply(given))
    gaps = protocol.gaps(given)
    spans = {int(i): (a, b) for i, a, b in zip(gaps.object_id, gaps.start, gaps.stop, strict=True)}
    assert len(spans) == len(gaps)
    for identifier in given.ids():
        rows = given.rows_of(identifier)
        removed = np.flatnonzero(gone[rows])
        eligible = len(rows) >= protocol.warmup + protocol.length + (protocol.kind == "mid")
        assert (int(identifier) in spans) == (eligible and identifier != CLUTTER)
        if int(identifier) not in spans:
            assert len(removed) == 0
            continue
        first, last = removed[0], removed[-1]
        assert removed.tolist() == list(range(first, first + protocol.length))
        assert first >= protocol.warmup
        assert last < len(rows) - 1 if protocol.kind == "mid" else last == len(rows) - 1
        start, stop = spans[int(identifier)]
        frames = given.frame[rows]
        assert frames[first - 1] + 1 == start
        assert stop == (frames[last + 1] if protocol.kind == "mid" else frames[last] + 1)


@pytest.mark.parametrize("seed", range(30))
def test_mid_takes_the_unbroken_window_nearest_to_the_middle(seed: int) -> None:
    """All windows are tried one by one; only where none is unbroken, a broken one is taken."""
    rng = np.random.default_rng(seed)
    protocol = OcclusionProtocol("mid", length=6, warmup=10)
    every = np.arange(int(rng.integers(30, 90)))
    frames = every[rng.random(len(every)) > rng.choice([0.05, 0.15, 0.5])]
    given = detections_of({4: frames})
    gone = np.flatnonzero(removed_rows(given, protocol.apply(given)))
    windows = range(protocol.warmup, len(frames) - protocol.length)
    if not windows:
        assert len(gone) == 0
        return
    unbroken = [
        first
        for first in windows
        if all(frames[k + 1] == frames[k] + 1 for k in range(first - 1, first + protocol.length))
    ]
    middle = (len(frames) - protocol.length) // 2
    nearest = min(abs(first - middle) for first in unbroken or windows)
    assert gone[0] in (unbroken or windows)
    assert abs(gone[0] - middle) == nearest


def test_mid_hides_the_middle_of_an_unbroken_trajectory() -> None:
    """100 detections, 20 hidden: 40 before and 40 after."""
    given = detections_of({5: range(30, 130)})
    gaps = OcclusionProtocol("mid", 20, 35).gaps(given)
    assert (gaps.start.tolist(), gaps.stop.tolist()) == ([70], [90])


def test_a_long_warm_up_moves_the_gap_back() -> None:
    """60 detections with 35 before the gap: the middle would leave 20."""
    gaps = OcclusionProtocol("mid", 20, 35).gaps(detections_of({5: range(60)}))
    assert (gaps.start.tolist(), gaps.stop.tolist()) == ([35], [55])


def test_late_hides_the_end() -> None:
    """The last detections go, wherever the frames end."""
    gaps = OcclusionProtocol("late", 20, 35).gaps(detections_of({5: range(30, 130)}))
    assert (gaps.start.tolist(), gaps.stop.tolist()) == ([110], [130])


def test_a_natural_miss_at_the_edge_belongs_to_the_gap() -> None:
    """Seen in every other frame: from the frame after the last detection to the next one."""
    given = detections_of({5: range(0, 40, 2)})
    gaps = OcclusionProtocol("mid", 4, 5).gaps(given)
    assert (gaps.start.tolist(), gaps.stop.tolist()) == ([15], [24])
    late = OcclusionProtocol("late", 4, 5).gaps(given)
    assert (late.start.tolist(), late.stop.tolist()) == ([31], [39])


def test_clutter_is_never_removed() -> None:
    """Hundreds of false boxes, also in one frame each, are no object."""
    given = detections_of({CLUTTER: [k % 200 for k in range(600)]})
    for kind in ("mid", "late"):
        protocol = OcclusionProtocol(kind, 20, 35)
        assert len(protocol.gaps(given)) == 0
        assert protocol.apply(given) == given


def test_none_removes_nothing() -> None:
    """The protocol `none` gives the same table."""
    given = random_detections(3)
    protocol = OcclusionProtocol("none")
    assert len(protocol.gaps(given)) == 0
    assert protocol.apply(given) == given


def test_the_gaps_travel_in_the_provenance() -> None:
    """The protocol and each gap as object, start, stop, beside what was there before."""
    given = detections_of({5: range(30, 130), 9: range(10), 7: range(100)})
    told = OcclusionProtocol("mid", 20, 35).apply(given).provenance
    assert told.items() >= given.provenance.items()
    assert json.loads(told["occlusion"]) == {
        "protocol": "mid:20:35",
        "gaps": [[5, 70, 90], [7, 40, 60]],
    }
    assert "occlusion" not in given.provenance


def test_removing_one_objects_detections_changes_no_other_objects_gap() -> None:
    """Each object's gap depends on its own detections alone."""
    given = random_detections(5)
    protocol = OcclusionProtocol("mid", 7, 12)
    all_gaps = protocol.gaps(given)
    assert len(all_gaps) >= 3
    hidden = int(all_gaps.object_id[0])
    fewer = protocol.gaps(given.take(given.source != hidden))
    for name in ("object_id", "start", "stop"):
        np.testing.assert_array_equal(getattr(fewer, name), getattr(all_gaps, name)[1:])


def test_removing_an_object_from_the_trace_changes_no_other_detection() -> None:
    """The noise is each object's own: all other detections keep every bit."""
    n_frames, n_objects = 50, 6
    frame, identifier = np.divmod(np.arange(n_frames * n_objects), n_objects)
    rng = np.random.default_rng(1)
    columns = {name: np.zeros(len(frame)) for name in Trace.column_types()}
    columns |= {"frame": frame, "object_id": identifier, "visible": rng.random(len(frame))}
    columns |= {"x": 5.0 + 8.0 * identifier, "y": 0.2 * frame}
    columns |= {name: np.full(len(frame), 2.0) for name in ("length", "width", "height")}
    path = {name: np.zeros(n_frames) for name in EgoPath.column_types()}
    ego = EgoPath.from_columns(path | {"frame": np.arange(n_frames)}, n_frames=n_frames, dt=0.1)
    trace = Trace.from_columns(columns, n_frames=n_frames, dt=0.1, ego=ego)
    everything = detect(trace, seed=2)
    assert set(range(n_objects)) | {CLUTTER} == set(everything.ids())
    for hidden in range(n_objects):
        without = detect(trace.take(trace.object_id != hidden), seed=2)
        assert without == everything.take(everything.source != hidden)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mid:20", OcclusionProtocol("mid", 20, 35)),
        ("late:10", OcclusionProtocol("late", 10, 35)),
        ("late:10:5", OcclusionProtocol("late", 10, 5)),
        ("mid", OcclusionProtocol("mid", 20, 35)),
        ("none", OcclusionProtocol("none")),
        ("mid:0", OcclusionProtocol("mid", 0, 35)),
        ("mid:20:35:gaps=3", OcclusionProtocol("mid", 20, 35, n_gaps=3)),
        ("switch:20", OcclusionProtocol("switch", 20, 35)),
        ("switch:20:start=-5", OcclusionProtocol("switch", 20, 35, start=-5)),
        ("switch:5:9:start=7:gaps=2", OcclusionProtocol("switch", 5, 9, start=7, n_gaps=2)),
        ("switch:5:9:gaps=2:start=7", OcclusionProtocol("switch", 5, 9, start=7, n_gaps=2)),
        ("natural:40:10", OcclusionProtocol("natural", 40, 10)),
    ],
)
def test_a_protocol_is_read_from_text(text: str, expected: OcclusionProtocol) -> None:
    """KIND:LENGTH[:WARMUP], the paper's 20 and 35 where they are left out, and what else the kind
    has; and back."""
    assert OcclusionProtocol.parse(text) == expected
    assert OcclusionProtocol.parse(str(expected)) == expected


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("none", "none"),
        ("mid:20", "mid:20:35"),
        ("late:10:5", "late:10:5"),
        ("mid:20:35:gaps=1", "mid:20:35"),
        ("mid:20:gaps=3", "mid:20:35:gaps=3"),
        ("switch:20:start=-5", "switch:20:35:start=-5"),
        ("switch:20:start=0", "switch:20:35"),
        ("switch:20:9:start=4:gaps=2", "switch:20:9:gaps=2:start=4"),
    ],
)
def test_a_protocol_is_told_in_one_way(text: str, told: str) -> None:
    """What names results names them always alike: numbers first, then what is not as usual."""
    assert str(OcclusionProtocol.parse(text)) == told


@pytest.mark.parametrize(
    "text",
    [
        *("", "early:20", "mid:", "mid:-3", "mid:20:0", "mid:x", "mid:1.5", "mid:1:2:3", ":20"),
        *("late:20:gaps=2", "mid:20:gaps=0", "mid:20:gaps=x", "mid:20:gaps=", "mid:20:gaps=2:35"),
        *("mid:20:start=5", "mid:20:gaps=2:gaps=2", "mid:20:speed=3", "natural:20:gaps=2"),
        *("natural:0", "none:20", "none:gaps=2", "switch:20:start=1e3", f"mid:{10**30}"),
    ],
)
def test_a_bad_text_is_refused_with_what_was_expected(text: str) -> None:
    """The message quotes the text and shows the form, in one line."""
    with pytest.raises(ValueError, match=r"expected KIND:LENGTH\[:WARMUP\]") as caught:
        OcclusionProtocol.parse(text)
    assert repr(text) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "options",
    [
        *({"kind": "early"}, {"warmup": 0}, {"length": -1}, {"n_gaps": 0}, {"start": 3}),
        *({"kind": "natural", "length": 0}, {"kind": "late", "n_gaps": 2}),
        *({"kind": "natural", "n_gaps": 2}, {"kind": "none", "start": 1}),
    ],
)
def test_an_impossible_protocol_cannot_be_made(options: dict[str, object]) -> None:
    """Unknown kinds, impossible counts and settings of another kind are refused when the protocol
    is made."""
    with pytest.raises(ValueError, match="expected"):
        OcclusionProtocol(**options)  # type: ignore[arg-type]
