"""Tracks of a world against their baseline: the one function that tests call.

Worse beyond the tolerance fails, and so does a change of what knows no better (how sure the filter
is, how many tracks there are). Better beyond it passes with a notice, unless asked to be strict: a
test that fails on progress is soon switched off, but progress that is not accepted can be lost
again unseen.
"""

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from experiments.regression import baseline as files
from experiments.regression.baseline import Baseline, BaselineError, Pin
from experiments.regression.compare import Row, changes, table, worst
from experiments.regression.metrics import METRICS, error_by_second, measured
from experiments.scoring import Scores, score
from mdkf import Detections, TableError, Trace, Tracks

UPDATE = "MDKF_UPDATE"
"""Environment variable: 1 accepts what is measured. `pytest --mdkf-update` sets it."""

CURRENT_TEST = "PYTEST_CURRENT_TEST"
"""Environment variable of pytest's."""

_TRAVELS = ("trace", "detector", "detector_seed", "occlusion")
"""Provenance of detections that tells tracks from those of other detections."""

_notices: list[str] = []


class Regression(AssertionError):
    """A tracker is worse than its baseline, differs from it, or has none."""


def assert_no_regression(
    tracks: Tracks | Scores,
    trace: Trace,
    detections: Detections,
    baseline: str | Path,
    *,
    tolerances: Mapping[str, str | float] | None = None,
    metrics: Sequence[str] | None = None,
    strict: bool = False,
) -> None:
    """Raise `Regression`, with a table of what changed, unless tracks score as their baseline.

    tracks: of `detections`, which are of `trace`; any tracker's, or scores of them that were made
    with other options. baseline: a JSON file (`.json` may be left out), which `pytest
    --mdkf-update`, or the environment variable MDKF_UPDATE=1, makes or accepts.
    tolerances: by metric (`experiments.regression.METRICS`) a number in its unit or a share of the
    baseline's value as "1 %", in place of what the file says. metrics: those to compare, all that
    the file pins if not given. strict: whether better than the baseline fails too.

    Raises `BaselineError` for a file that cannot be read or is of another trace or detections,
    `TableError` for tracks that cannot be of these detections, `ValueError` for an unknown metric.
    """
    __tracebackhide__ = True
    path = Path(baseline)
    path = path if path.suffix == ".json" else path.with_name(f"{path.name}.json")
    for name in (*(tolerances or {}), *(metrics or ())):
        if name not in METRICS:
            raise ValueError(f"no metric {name!r}, expected one of: {', '.join(METRICS)}")
    if metrics is not None and (not metrics or not set(tolerances or ()) <= set(metrics)):
        raise ValueError("metrics: expected at least one, and all that have a tolerance")
    given = {n: files.checked_tolerance(f"metric {n}", t) for n, t in (tolerances or {}).items()}
    scores = _scored(tracks, trace, detections)
    now = measured(scores)
    world = files.world_of(trace, detections)
    if _updating():
        _accept(path, world, now, metrics, given, scores)
        return
    if not path.is_file():
        raise Regression(f"no baseline {_shown(path)}; make it with:  {_command()}")
    pinned = files.read(path)
    _refuse_other(path, pinned, world)
    names = tuple(pinned.pins if metrics is None else metrics)
    if missing := [name for name in names if name not in pinned.pins]:
        raise BaselineError(
            f"{_shown(path)}: does not pin {', '.join(missing)}; accept with:  {_command()}"
        )
    rows = [Row(name, _pin(pinned, name, given), now[name]) for name in names]
    failing = [r for r in rows if r.verdict in ("worse", "changed")]
    better = [r for r in rows if r.verdict == "better"]
    if failing or (strict and better):
        raise Regression(
            _failure(path, pinned, rows, worst(pinned.seconds, error_by_second(scores)))
        )
    if better:
        _notices.append(
            "\n".join([f"{_shown(path)}: better; accept with:  {_command()}", *changes(better)])
        )


def drain() -> list[str]:
    """What there was to tell since it was last asked: baselines made, accepted or beaten."""
    told = _notices.copy()
    _notices.clear()
    return told


def _scored(given: Tracks | Scores, trace: Trace, detections: Detections) -> Scores:
    """Scores of tracks that are of these detections; a user's own tracker need not say so."""
    told = detections.provenance
    if told.get("trace", trace.content_hash()) != trace.content_hash():
        raise TableError("the detections come from another trace (its content hash differs)")
    if isinstance(given, Scores):
        if given.matched.trace != trace:
            raise TableError("the scores are of another trace (its content hash differs)")
        tracks = given.matched.tracks
    else:
        tracks = given
    for key in _TRAVELS:
        if key in tracks.provenance and tracks.provenance[key] != told.get(key):
            raise TableError(f"the tracks come from other detections (their {key} differs)")
    if isinstance(given, Scores):
        return given
    return score(trace, replace(tracks, provenance={**told, **tracks.provenance}))


def _is_of(pinned: Baseline, world: Mapping[str, str]) -> bool:
    """Whether a baseline is of this world, whatever it is called."""
    return all(pinned.world.get(key) == world[key] for key in ("trace", "detections"))


def _refuse_other(path: Path, pinned: Baseline, world: Mapping[str, str]) -> None:
    """Raise `BaselineError` for a baseline of another world, naming what differs."""
    if _is_of(pinned, world):
        return
    then = pinned.world
    differing = [
        f"{key} {then.get(key, 'none')} -> {world.get(key, 'none')}"
        for key in dict.fromkeys((*then, *world))
        if key not in ("trace", "detections") and then.get(key) != world.get(key)
    ]
    what = "trace" if then.get("trace") != world["trace"] else "detections"
    why = "; ".join(differing) or (
        f"the same by name: mdkf {pinned.mdkf} on {pinned.machine} made other numbers of it, which"
        " golden worlds never do"
    )
    raise BaselineError(
        f"{_shown(path)}: baseline of another {what} ({why}); nothing was compared. If that is"
        f" meant, accept with:  {_command()}"
    )


def _accept(
    path: Path,
    world: Mapping[str, str],
    now: Mapping[str, float],
    metrics: Sequence[str] | None,
    given: Mapping[str, str | float],
    scores: Scores,
) -> None:
    """Write the baseline, unless it says the same already.

    What it pins, and how tightly, is the user's choice and stays."""
    old, what = None, "made"
    if path.is_file():
        try:
            old, what = files.read(path), "accepted"
        except BaselineError as error:
            what = f"made anew: {error}"
    names = tuple(metrics if metrics is not None else old.pins if old else METRICS)
    rows = [Row(name, _pin(old, name, given), now[name]) for name in names]
    if old is not None and _is_of(old, world):
        # A metric that was not pinned before has no value to keep.
        kept = {r.metric for r in rows if r.verdict == "same" and r.metric in old.pins}
        tolerances = {name: pin.tolerance for name, pin in old.pins.items()}
        if kept == set(names) and {r.metric: r.pin.tolerance for r in rows} == tolerances:
            return
        changed = [row for row in rows if row.metric not in kept]
    else:
        kept, changed = set(), []
        what += ", of another world than before" if old else ""
    pins = {
        row.metric: row.pin if row.metric in kept else replace(row.pin, value=row.now)
        for row in rows
    }
    files.write(path, world, pins, error_by_second(scores))
    _notices.append("\n".join([f"{_shown(path)}: {what}", *changes(changed)]))


def _pin(old: Baseline | None, name: str, given: Mapping[str, str | float]) -> Pin:
    """What is pinned of a metric: the tolerance is the call's, else the file's, else its own."""
    pin = old.pins.get(name) if old is not None else None
    tolerance = METRICS[name].tolerance if pin is None else pin.tolerance
    return Pin(float("nan") if pin is None else pin.value, given.get(name, tolerance))


def _failure(path: Path, pinned: Baseline, rows: Sequence[Row], where: Sequence[str]) -> str:
    """What a failing test says."""
    order = ("worse", "changed", "better")
    shown = [row for verdict in order for row in rows if row.verdict == verdict]
    counts = [f"{sum(r.verdict == v for r in rows)} {v}" for v in order]
    same = sum(row.verdict == "same" for row in rows)
    world = ", ".join(
        f"{key} {pinned.world[key]}"
        for key in ("golden", "scenario", "seed", "detector", "occlusion")
        if key in pinned.world
    )
    lines = [
        f"{', '.join(counts)}, {same} the same as in {_shown(path)}",
        f"({world}; baseline of mdkf {pinned.mdkf}, this is {version('mdkf')})",
        "",
        *table(shown),
        *(["", *where] if where else []),
        "",
        f"if this is meant, accept it with:  {_command()}",
    ]
    return "\n".join(lines)


def _updating() -> bool:
    return os.environ.get(UPDATE, "") not in ("", "0")


def _command() -> str:
    """What accepts a change of the test that runs."""
    test = os.environ.get(CURRENT_TEST)
    if test is None:
        return f"{UPDATE}=1 in the environment of the same command"
    return f"pytest --mdkf-update {shlex.quote(test.rpartition(' ')[0])}"


def _shown(path: Path) -> str:
    """A path as the user knows it."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)
