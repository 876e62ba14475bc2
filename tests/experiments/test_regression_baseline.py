"""Claim: a baseline says in a readable file what a tracker scored, fails on worse, passes on better
with a notice, is never compared with another world, and changes only when that is asked for."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import mdkf
from experiments import OcclusionProtocol, score
from experiments.regression import (
    METRICS,
    BaselineError,
    Regression,
    assert_no_regression,
    check,
    golden_detections,
    golden_trace,
)
from mdkf import Detections, TableError, Tracker, Tracks

COMPARED = ("baseline", "now", "change", "allowed", "verdict")
COVARIANCE = ("cov_xx", "cov_xy", "cov_yy")
Edit = Callable[[dict[str, Any]], object]
TRACE = golden_trace("golden:v1/journey")
SEEN = OcclusionProtocol().apply(golden_detections("golden:v1/journey"))


@pytest.fixture(scope="module")
def tracks() -> Tracks:
    return Tracker(mdkf.estimator("md")).run(SEEN)


@pytest.fixture
def baseline(tmp_path: Path, tracks: Tracks) -> Path:
    """A baseline of the tracks; nothing is waiting to be told."""
    path = tmp_path / "folder" / "it.json"
    accept(tracks, path)
    check.drain()
    return path


def accept(tracks: Tracks, path: Path, seen: Detections = SEEN, **options: Any) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MDKF_UPDATE", "1")
        assert_no_regression(tracks, TRACE, seen, path, **options)


def edited(path: Path, edit: Edit) -> None:
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))


def moved(metric: str, by: float) -> Edit:
    """The pinned value of a metric is another one."""

    def edit(document: dict[str, Any]) -> None:
        document["metrics"][metric]["value"] += by

    return edit


def test_the_file_is_for_people(baseline: Path, tracks: Tracks) -> None:
    """One metric a line with unit, direction and tolerance; the values are those of the scores to
    ten digits; the world is told by name and by content; errors are told by object and second."""
    text = baseline.read_text()
    summary = score(TRACE, tracks).summary()
    document = json.loads(text)
    assert list(document["metrics"]) == list(METRICS)
    for name, entry in document["metrics"].items():
        assert len(re.findall(rf'^    "{name}": {{.*}},?$', text, re.MULTILINE)) == 1
        assert entry["unit"] == METRICS[name].unit
        if name in summary:
            assert entry["value"] == pytest.approx(summary[name], rel=1e-9)
    line = '    "idsw": {"value": 0.0, "unit": "", "better": "lower", "tolerance": 0.0},\n'
    assert line in text
    world = document["world"]
    assert (world["golden"], world["detector"], world["occlusion"]) == (
        "v1/journey",
        "pointrcnn",
        "mid:20:35",
    )
    assert world["trace"] == TRACE.content_hash()
    assert world["detections"] == SEEN.content_hash()
    (errors,) = document["position_error_by_second"].values()
    assert len(errors) == 20
    assert 0 < min(error for error in errors if error is not None) < 0.3


def test_what_is_missing_is_asked_for(tmp_path: Path, tracks: Tracks) -> None:
    """No baseline: a failure that names the file and the command; nothing is written."""
    with pytest.raises(
        Regression, match=r"no baseline .*it\.json; .*pytest --mdkf-update .*::test_"
    ):
        assert_no_regression(tracks, TRACE, SEEN, tmp_path / "it")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("metric", "by", "verdict"),
    [
        ("hota", 1.0, "worse"),
        ("hota", -1.0, "better"),
        ("position_error", -0.001, "worse"),
        ("position_error", 0.001, "better"),
        ("fp", -1.0, "worse"),
        ("fp", 1.0, "better"),
        ("position_sigma", 0.001, "changed"),
        ("position_sigma", -0.001, "changed"),
        ("estimates", 1.0, "changed"),
    ],
)
def test_worse_and_changed_fail_and_better_passes(
    baseline: Path, tracks: Tracks, metric: str, by: float, verdict: str
) -> None:
    """Better is told, and fails if asked to be strict; a wide tolerance of the call, and one of the
    file, lets anything pass."""
    edited(baseline, moved(metric, by))
    check_it = lambda **options: assert_no_regression(tracks, TRACE, SEEN, baseline, **options)  # noqa: E731
    row = rf"(?m)^{metric} .* {verdict}$"
    if verdict == "better":
        check_it()
        (notice,) = check.drain()
        assert re.search(rf"(?m)^  {metric} .* -> .* better$", notice)
        with pytest.raises(Regression, match=row):
            check_it(strict=True)
    else:
        with pytest.raises(Regression, match=row):
            check_it()
    assert check.drain() == []
    check_it(tolerances={metric: 2.0}, strict=True)
    others = [name for name in METRICS if name != metric]
    check_it(metrics=others, strict=True)
    edited(baseline, lambda document: document["metrics"][metric].update(tolerance="5000 %"))
    check_it(strict=True)
    assert check.drain() == []


@pytest.mark.parametrize(("then", "now", "worse"), [(1.5, 2.2, False), (2.2, 1.5, True)])
def test_consistency_is_better_nearer_to_two(
    baseline: Path, tracks: Tracks, then: float, now: float, worse: bool
) -> None:
    """Of NEES neither more nor less is better: covariances that are what they say are."""
    nees = json.loads(baseline.read_text())["metrics"]["nees"]["value"]
    scale = nees / now  # a covariance that is so many times as large has NEES `now`
    columns = {**tracks.columns(), **{c: scale * getattr(tracks, c) for c in COVARIANCE}}
    own = {name: columns.pop(name) for name in tracks.diagnostics}
    scaled = Tracks.from_columns(columns, n_frames=tracks.n_frames, dt=tracks.dt, diagnostics=own)
    edited(baseline, lambda document: document["metrics"]["nees"].update(value=then))
    if worse:
        with pytest.raises(Regression, match=r"(?m)^nees .* worse$"):
            assert_no_regression(scaled, TRACE, SEEN, baseline, metrics=["nees"])
    else:
        assert_no_regression(scaled, TRACE, SEEN, baseline, metrics=["nees"])
        assert "better" in check.drain()[0]


def test_the_table_says_what_and_where(baseline: Path, tracks: Tracks) -> None:
    """Unit, both values, the change and what is allowed of it; and the second in which the error
    grew most, planted there."""
    edited(baseline, moved("hota", 10.0))

    def halved(document: dict[str, Any]) -> None:
        (errors,) = document["position_error_by_second"].values()
        errors[7] /= 2

    edited(baseline, halved)
    with pytest.raises(Regression) as failed:
        assert_no_regression(tracks, TRACE, SEEN, baseline)
    lines = str(failed.value).splitlines()
    assert lines[0].startswith("1 worse, 0 changed, 0 better, 33 the same as in")
    assert "golden v1/journey" in lines[1]
    assert re.split(" +", lines[3]) == ["metric", "unit", *COMPARED]
    hota = json.loads(baseline.read_text())["metrics"]["hota"]["value"]
    now = f"{hota - 10:.7g}"
    assert lines[4].split()[:4] == ["hota", "%", f"{hota:.7g}", now]
    assert re.search(r" -10 \(-[\d.]+ %\) +[\d.e-]+ +worse$", lines[4])
    assert re.match(r" +0 +7-8 ", lines[8])
    assert lines[-1].startswith("if this is meant, accept it with:  pytest --mdkf-update ")


def test_accepting_writes_what_changed_and_nothing_else(baseline: Path, tracks: Tracks) -> None:
    """Unchanged: the file keeps its bytes. Changed: only the changed lines are others, the notice
    tells old and new; tolerances and the choice of metrics stay as the user edited them."""
    before = baseline.read_bytes()
    accept(tracks, baseline)
    assert (baseline.read_bytes(), check.drain()) == (before, [])
    text = baseline.read_text()
    text = re.sub(r'("hota": {"value": )[\d.]+(.*)"0.0001 %"', r"\g<1>10.5\g<2>0.5", text)
    text = re.sub(r'    "idf1": .*\n', "", text)
    text = re.sub(r'("position_error": {"value": [\d.]+)', r"\g<1>0000001", text)
    baseline.write_text(text)
    accept(tracks, baseline)
    (notice,) = check.drain()
    changed = [
        (old, new)
        for old, new in zip(text.splitlines(), baseline.read_text().splitlines(), strict=True)
        if old != new and not re.match(r'\s+"position_error"', old)
    ]
    ((old, new),) = changed
    assert '"hota": {"value": 10.5' in old
    assert new.endswith('"tolerance": 0.5},')
    assert re.search(r"(?m)^  hota  10\.5  ->  \d+\.\d+  %  better$", notice)
    assert_no_regression(tracks, TRACE, SEEN, baseline, strict=True)


def test_another_world_is_not_compared(baseline: Path, tracks: Tracks) -> None:
    """Other detections, another trace, the same world with another last bit: an error that says
    which; the same file is accepted for the new world if that is asked for."""
    other = OcclusionProtocol(length=10).apply(golden_detections("golden:v1/journey"))
    there = Tracker(mdkf.estimator("md")).run(other)
    with pytest.raises(
        BaselineError, match=r"another detections .*occlusion mid:20:35 -> mid:10:35"
    ):
        assert_no_regression(there, TRACE, other, baseline)
    edited(baseline, lambda document: document["world"].update(trace="0" * 64))
    with pytest.raises(BaselineError, match=r"another trace \(the same by name: mdkf .* golden"):
        assert_no_regression(tracks, TRACE, SEEN, baseline)
    accept(there, baseline, other)
    assert "of another world" in check.drain()[0]
    assert_no_regression(there, TRACE, other, baseline, strict=True)


def test_tracks_of_other_detections_are_refused(baseline: Path, tracks: Tracks) -> None:
    """Tracks that tell of other gaps, detections and scores of another trace; tracks that tell
    nothing are taken for those of the detections."""
    other = OcclusionProtocol("none").apply(golden_detections("golden:v1/journey"))
    with pytest.raises(TableError, match="other detections"):
        assert_no_regression(tracks, TRACE, other, baseline)
    elsewhere = golden_trace("golden:v1/bus_stop")
    with pytest.raises(TableError, match="another trace"):
        assert_no_regression(tracks, elsewhere, SEEN, baseline)
    foreign = golden_detections("golden:v1/bus_stop")
    scores = score(elsewhere, Tracker(mdkf.estimator("md")).run(foreign))
    with pytest.raises(TableError, match="another trace"):
        assert_no_regression(scores, TRACE, SEEN, baseline)
    assert_no_regression(replace(tracks, provenance={}), TRACE, SEEN, baseline, strict=True)
    assert_no_regression(score(TRACE, tracks), TRACE, SEEN, baseline, strict=True)


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda d: d.update(schema=2), "schema 1"),
        (lambda d: d.pop("world"), "key world: expected dict"),
        (lambda d: d["metrics"].clear(), "key metrics: expected at least one"),
        (lambda d: d["metrics"].update(speed={"value": 1.0, "tolerance": 0}), "metrics.speed: no"),
        (lambda d: d["metrics"]["hota"].pop("value"), "metrics.hota: expected an object"),
        (lambda d: d["metrics"]["hota"].update(value="1"), "metrics.hota: value is '1'"),
        (lambda d: d["metrics"]["hota"].update(tolerance="1"), "metrics.hota: tolerance is '1'"),
        (lambda d: d["metrics"]["hota"].update(tolerance=-1), "metrics.hota: tolerance is -1"),
        (lambda d: d.update(position_error_by_second={"0": 1}), "position_error_by_second.0"),
    ],
)
def test_a_damaged_file_is_named(baseline: Path, tracks: Tracks, edit: Edit, told: str) -> None:
    """File, key and what was expected in one line; accepting makes it anew."""
    edited(baseline, edit)
    with pytest.raises(BaselineError) as failed:
        assert_no_regression(tracks, TRACE, SEEN, baseline)
    assert str(baseline) in str(failed.value)
    assert told in str(failed.value)
    assert "\n" not in str(failed.value)
    accept(tracks, baseline)
    assert_no_regression(tracks, TRACE, SEEN, baseline, strict=True)


def test_text_that_is_no_json_is_named(baseline: Path, tracks: Tracks) -> None:
    """Such as what a merge left behind."""
    baseline.write_text("<<<<<<< HEAD\n" + baseline.read_text())
    with pytest.raises(BaselineError, match=r"it\.json: expected JSON"):
        assert_no_regression(tracks, TRACE, SEEN, baseline)


def test_bad_choices_are_refused(baseline: Path, tracks: Tracks) -> None:
    """Unknown metrics and tolerances; metrics that the file does not pin."""
    with pytest.raises(ValueError, match="no metric 'speed', expected one of: hota, "):
        assert_no_regression(tracks, TRACE, SEEN, baseline, metrics=["speed"])
    with pytest.raises(ValueError, match="no metric 'speed', expected one of: hota, "):
        assert_no_regression(tracks, TRACE, SEEN, baseline, tolerances={"speed": 1.0})
    for options in ({"metrics": []}, {"metrics": ["hota"], "tolerances": {"nees": 1.0}}):
        with pytest.raises(ValueError, match="expected at least one, and all that have a tol"):
            assert_no_regression(tracks, TRACE, SEEN, baseline, **options)
    for bad in ("1", "x %", -1.0, float("nan"), True, None):
        with pytest.raises(BaselineError, match="metric hota: tolerance is"):
            assert_no_regression(tracks, TRACE, SEEN, baseline, tolerances={"hota": bad})
    edited(baseline, lambda document: document["metrics"].pop("hota"))
    with pytest.raises(BaselineError, match="does not pin hota"):
        assert_no_regression(tracks, TRACE, SEEN, baseline, metrics=["hota"])
    assert_no_regression(tracks, TRACE, SEEN, baseline)


def test_no_value_is_a_value_of_its_own(baseline: Path, tracks: Tracks) -> None:
    """A metric that has no value any more, or has one now, has changed."""
    silent = replace(tracks, diagnostics={}, provenance={})
    with pytest.raises(Regression, match=r"(?m)^nis .* – +– .*changed$"):
        assert_no_regression(silent, TRACE, SEEN, baseline)
    accept(silent, baseline)
    assert len(check.drain()) == 1
    assert json.loads(baseline.read_text())["metrics"]["nis"]["value"] is None
    assert_no_regression(silent, TRACE, SEEN, baseline, strict=True)
    with pytest.raises(Regression, match=r"(?m)^nis .*changed$"):
        assert_no_regression(tracks, TRACE, SEEN, baseline)


def test_a_trace_without_any_track_can_be_pinned(tmp_path: Path) -> None:
    """A tracker that finds nothing has scores too, and is worse than one that does."""
    found = Tracker(mdkf.estimator("md")).run(SEEN)
    nothing = found.take(found.frame < 0)
    accept(nothing, tmp_path / "nothing")
    assert_no_regression(nothing, TRACE, SEEN, tmp_path / "nothing", strict=True)
    accept(found, tmp_path / "found")
    with pytest.raises(Regression, match=r"(?m)^miss_rate .* worse$"):
        assert_no_regression(nothing, TRACE, SEEN, tmp_path / "found")
