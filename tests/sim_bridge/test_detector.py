"""Claim: a detector's errors have the moments of its profile, and every object draws its own.

Expected values are written out from the numbers in pointrcnn.yaml, not taken from the code.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy import stats

import sim_bridge
from mdkf.tables import CLUTTER, Detections, FloatArray, Trace
from sim_bridge import detect
from tests.sim_bridge.worlds import CAR, SIZE, convoy

POINTRCNN = Path(sim_bridge.__file__).with_name("detectors") / "pointrcnn.yaml"
LAW: dict[str, Any] = yaml.safe_load(POINTRCNN.read_text(encoding="utf-8"))
MAX_RANGE = 72.0  # m
NOISES = ("radial", "lateral", "vertical", "yaw")

# Distance [m] and visible fraction; together they separate all terms of every law.
CELLS = ((5.0, 1.0), (8.0, 0.1), (30.0, 0.55), (40.0, 1.0), (60.0, 0.9), (70.0, 0.3))
PER_CELL, N_FRAMES = 500, 100


def dense(trace: Trace, detections: Detections) -> dict[str, FloatArray]:
    """Errors of every object (rows) in every frame (columns) of a convoy; NaN where missed."""
    true = detections.source != CLUTTER
    source, frame = detections.source[true], detections.frame[true]
    row = frame * len(trace.ids()) + source
    error = {
        name: getattr(detections, name)[true] - getattr(trace, name)[row]
        for name in ("x", "y", "z", "yaw", *SIZE)
    }
    x, y = trace.x[row] - trace.ego.x[frame], trace.y[row] - trace.ego.y[frame]
    r = np.hypot(x, y)
    values = {
        **error,
        "radial": (error["x"] * x + error["y"] * y) / r,
        "lateral": (error["y"] * x - error["x"] * y) / r,
        "vertical": error["z"],
        "yaw": np.angle(np.exp(1j * error["yaw"])),
        "score": detections.score[true],
        "seen": np.ones(len(row)),
    }
    shape = (len(trace.ids()), trace.n_frames)
    table = {name: np.full(shape, np.nan) for name in values}
    for name, column in values.items():
        table[name][source, frame] = column
    table["seen"] = np.nan_to_num(table["seen"])
    return table


@cache
def cells() -> dict[str, FloatArray]:
    """Errors of `PER_CELL` objects in each cell, at bearings all around: (cells, objects,
    frames)."""
    distance, visible = np.repeat(np.array(CELLS), PER_CELL, axis=0).T
    trace = convoy(distance, np.arange(len(distance)) * 2.4, visible, N_FRAMES)
    table = dense(trace, detect(trace, seed=1))
    return {name: e.reshape(len(CELLS), PER_CELL, N_FRAMES) for name, e in table.items()}


@cache
def column_of_cars(dt: float) -> dict[str, FloatArray]:
    """Errors of 1000 objects in full view at 20 m."""
    trace = convoy(20.0, np.linspace(-3, 3, 1000), 1.0, 150, dt)
    return dense(trace, detect(trace, seed=2))


def autocorrelation(errors: FloatArray, lag: int) -> float:
    """Of errors (objects, frames) with a known mean of zero, over pairs without a NaN."""
    return float(
        np.nanmean(errors[:, lag:] * errors[:, : errors.shape[1] - lag]) / np.nanmean(errors**2)
    )


def with_columns(trace: Trace, **columns: FloatArray) -> Trace:
    """The trace with some columns replaced."""
    return Trace.from_columns(
        trace.columns() | columns,
        n_frames=trace.n_frames,
        dt=trace.dt,
        ego=trace.ego,
        provenance=trace.provenance,
    )


def profile_file(folder: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """The pointrcnn profile with a change, as a file of its own."""
    document = yaml.safe_load(POINTRCNN.read_text(encoding="utf-8"))
    change(document)
    path = folder / "changed.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


# --- moments --------------------------------------------------------------------------------


def test_detection_rates_are_the_profiles() -> None:
    """In each cell: sigmoid((71.8 + 27.5 (v - 0.9) - r) / 8.8) min(v / 0.15, 1), within 1.5 %."""
    for cell, (r, v) in enumerate(CELLS):
        near = 1 / (1 + np.exp(-(71.8 + 27.5 * (v - 0.9) - r) / 8.8))
        assert cells()["seen"][cell].mean() == pytest.approx(near * min(v / 0.15, 1), abs=0.015)


@pytest.mark.parametrize("noise", NOISES)
def test_deviations_are_the_profiles(noise: str) -> None:
    """In each cell errors have mean zero and the deviation constant + per_range r +
    hidden (1 - v), within 4 %."""
    law = LAW[noise]
    for cell, (r, v) in enumerate(CELLS):
        expected = law["constant"] + law["per_range"] * r + law["hidden"] * (1 - v)
        errors = cells()[noise][cell]
        assert np.sqrt(np.nanmean(errors**2)) == pytest.approx(expected, rel=0.04), (r, v)
        assert abs(np.nanmean(errors)) < 0.1 * expected


@pytest.mark.parametrize("dt", [0.1, 0.2])
@pytest.mark.parametrize("noise", NOISES)
def test_errors_hang_together_in_time(noise: str, dt: float) -> None:
    """The autocorrelation after a time t is drift_share exp(-t / drift_time) + fixed_share,
    whatever the frame rate."""
    law, errors = LAW[noise], column_of_cars(dt)[noise]
    for lag in (1, 5, 20):
        drift = law["drift_share"] * np.exp(-lag * dt / law["drift_time"])
        assert autocorrelation(errors, lag) == pytest.approx(drift + law["fixed_share"], abs=0.035)


@pytest.mark.parametrize("noise", [*NOISES, "score"])
def test_noise_is_stationary_from_the_first_frame(noise: str) -> None:
    """An object that has just appeared is measured as badly as one seen for long."""
    errors = column_of_cars(0.1)[noise]
    if noise == "score":
        errors = errors - (17.5 - 0.24 * 20.0)
    overall = np.sqrt(np.nanmean(errors**2))
    assert np.sqrt(np.nanmean(errors[:, 0] ** 2)) == pytest.approx(overall, rel=0.1)


def test_errors_of_different_kinds_are_independent() -> None:
    """Radial, lateral, vertical and yaw errors, sizes and scores have no correlation, neither
    with each other nor with those of another object."""
    table = column_of_cars(0.1)
    names = (*NOISES, *SIZE, "score")
    seen = ~np.isnan(table["score"])
    errors = np.array([table[name][seen] for name in names])
    assert np.abs(np.corrcoef(errors) - np.eye(len(names))).max() < 0.08
    radial = table["radial"]
    assert abs(np.nanmean(radial[1:] * radial[:-1]) / np.nanmean(radial**2)) < 0.05


@pytest.mark.parametrize("side", SIZE)
def test_sizes_have_a_white_and_a_fixed_part(side: str) -> None:
    """Size errors spread over objects by `fixed` and over an object's frames by `white`."""
    law, errors = LAW["size"][side], column_of_cars(0.1)[side]
    within = np.nanmean(np.nanvar(errors, axis=1, ddof=1))
    assert np.sqrt(within) == pytest.approx(law["white"], rel=0.03)
    assert np.nanstd(np.nanmean(errors, axis=1)) == pytest.approx(law["fixed"], rel=0.1)
    share = law["fixed"] ** 2 / (law["fixed"] ** 2 + law["white"] ** 2)
    for lag in (1, 20):
        assert autocorrelation(errors, lag) == pytest.approx(share, abs=0.05)


def test_misses_come_in_bursts() -> None:
    """Luck is repeated with probability 0.47, so being seen has autocorrelation 0.47^lag, and a
    miss is followed by a miss with probability 0.47 + 0.53 P(miss)."""
    trace = convoy(68.0, np.linspace(-3, 3, 600), 1.0, 200)
    seen = dense(trace, detect(trace, seed=3))["seen"]
    rate = seen.mean()
    for lag in (1, 2, 4):
        expected = 0.47**lag
        assert autocorrelation(seen - rate, lag) == pytest.approx(expected, abs=0.015)
    missed = seen == 0
    again = missed[:, 1:][missed[:, :-1]].mean()
    assert again == pytest.approx(0.47 + 0.53 * (1 - rate), abs=0.01)


def test_scores_are_the_profiles() -> None:
    """Mean and deviation are those of |min(13, 17.5 - 0.24 r) - 5.35 (1 - v) min(1, r / 25) +
    2.4 N|; noise drifts and is fixed by the score's shares."""
    for cell, (r, v) in enumerate(CELLS):
        mean = min(13.0, 17.5 - 0.24 * r) - 5.35 * (1 - v) * min(1.0, r / 25.0)
        folded = stats.foldnorm(abs(mean) / 2.4, scale=2.4)
        scores = cells()["score"][cell]
        assert np.nanmean(scores) == pytest.approx(folded.mean(), abs=0.25), (r, v)
        assert np.nanstd(scores) == pytest.approx(folded.std(), rel=0.05), (r, v)
        assert np.nanmin(scores) >= 0.0
    noise = column_of_cars(0.1)["score"] - (17.5 - 0.24 * 20.0)
    for lag in (1, 5, 20):
        expected = 0.45 * np.exp(-lag * 0.1 / 0.86) + 0.34
        assert autocorrelation(noise, lag) == pytest.approx(expected, abs=0.035)


def test_clutter_is_uniform_around_the_sensor() -> None:
    """As many false boxes as density x area, Poisson, uniform over the ring from 3 to 72 m around
    the driving sensor, sizes normal, scores exponential, nothing in common in time."""
    trace = convoy([], [], [], 4000)
    clutter = detect(trace, seed=4)
    assert (clutter.source == CLUTTER).all()
    counts = np.bincount(clutter.frame, minlength=4000)
    expected = 3.5e-4 * np.pi * (72.0**2 - 3.0**2)
    assert counts.mean() == pytest.approx(expected, rel=0.03)
    assert counts.var() == pytest.approx(expected, rel=0.1)
    assert abs(np.corrcoef(counts[1:], counts[:-1])[0, 1]) < 0.05
    x = clutter.x - trace.ego.x[clutter.frame]
    y = clutter.y - trace.ego.y[clutter.frame]
    for values, law in (
        ((x**2 + y**2 - 9.0) / (72.0**2 - 9.0), stats.uniform()),
        (np.arctan2(y, x), stats.uniform(-np.pi, 2 * np.pi)),
        (clutter.yaw, stats.uniform(-np.pi, 2 * np.pi)),
        (clutter.score, stats.expon(scale=1.5)),
        (clutter.length, stats.norm(3.95, 0.31)),
        (clutter.width, stats.norm(1.63, 0.10)),
        (clutter.height, stats.norm(1.52, 0.12)),
    ):
        assert stats.kstest(values, law.cdf).pvalue > 1e-3
    np.testing.assert_array_equal(clutter.z, clutter.height / 2)


def test_errors_are_aligned_with_the_line_of_sight() -> None:
    """Seen in eight directions from a moving sensor, whatever way the objects look, the
    covariance of (x, y) errors has its axes along and across the line of sight."""
    bearings = np.repeat(np.arange(8) * np.pi / 4 + 0.2, 400)
    trace = convoy(50.0, bearings, 1.0, 40)
    table = dense(trace, detect(trace, seed=5))
    radial, lateral = 0.0285 + 0.0045 * 50, 0.015 + 0.00195 * 50
    for k, bearing in enumerate(bearings[::400]):
        rows = slice(400 * k, 400 * (k + 1))
        errors = np.stack([table[c][rows][table["seen"][rows] == 1] for c in "xy"])
        measured = errors @ errors.T / errors.shape[1]
        along = np.array([np.cos(bearing), np.sin(bearing)])
        across = np.array([-along[1], along[0]])
        expected = radial**2 * np.outer(along, along) + lateral**2 * np.outer(across, across)
        np.testing.assert_allclose(measured, expected, atol=0.12 * radial**2)


# --- what is never seen ---------------------------------------------------------------------


def test_nothing_is_detected_beyond_the_maximum_range() -> None:
    """At 71.9 m some detections come, at 72.1 m none, clutter included."""
    trace = convoy([71.9, 72.1] * 20, np.linspace(-3, 3, 40), 1.0, 50)
    detections = detect(trace, seed=6)
    x = detections.x - trace.ego.x[detections.frame]
    y = detections.y - trace.ego.y[detections.frame]
    clutter = detections.source == CLUTTER
    assert np.hypot(x, y)[clutter].max() <= MAX_RANGE
    counts = np.bincount(detections.source[~clutter], minlength=40)
    assert (counts[0::2] > 0).all()
    assert (counts[1::2] == 0).all()


def test_objects_that_drive_out_of_range_are_lost_there() -> None:
    """Of objects that drive from 68 m to 76 m, the last detections are just within 72 m."""
    trace = convoy(68.0, np.zeros(30), 1.0, 81)
    leaving = with_columns(trace, x=trace.x + 0.1 * trace.frame)
    detections = detect(leaving, seed=6)
    true = detections.source != CLUTTER
    assert 35 <= detections.frame[true].max() <= 40


def test_hidden_objects_are_never_detected() -> None:
    """Visible 0 is never reported, not even at arm's length."""
    trace = convoy([5.0, 20.0] * 10, np.linspace(-3, 3, 20), [0.0, 1.0] * 10, 200)
    detections = detect(trace, seed=7)
    counts = np.bincount(detections.source[detections.source != CLUTTER], minlength=20)
    assert (counts[0::2] == 0).all()
    assert (counts[1::2] > 150).all()


def test_an_empty_road_gives_clutter_only() -> None:
    """No objects, no frames, or objects that are all too far away: no error, and valid tables."""
    assert (detect(convoy([], [], [], 50), seed=1).source == CLUTTER).all()
    assert len(detect(convoy([], [], [], 0), seed=1)) == 0
    assert (detect(convoy([500.0], [0.0], [1.0], 50), seed=1).source == CLUTTER).all()


def test_without_noise_the_truth_is_reported(tmp_path: Path) -> None:
    """A profile with no noise, full detection and no clutter gives every box as it is, under its
    object's id."""

    def quiet(profile: dict[str, Any]) -> None:
        for noise in NOISES:
            profile[noise] |= {"constant": 0.0, "per_range": 0.0, "hidden": 0.0}
        for side in SIZE:
            profile["size"][side] = {"white": 0.0, "fixed": 0.0}
        profile["detection"] |= {"range": 1e6}
        profile["clutter"]["density"] = 0.0

    trace = convoy([10.0, 30.0, 70.0], [0.3, 2.0, -2.5], 1.0, 20)
    detections = detect(trace, profile_file(tmp_path, quiet), seed=8)
    np.testing.assert_array_equal(detections.source, trace.object_id)
    np.testing.assert_array_equal(detections.frame, trace.frame)
    for name in ("x", "y", "z", "length", "width", "height"):
        np.testing.assert_array_equal(getattr(detections, name), getattr(trace, name))
    np.testing.assert_allclose(detections.yaw, trace.yaw, atol=1e-14)


def test_sizes_stay_positive(tmp_path: Path) -> None:
    """However large the noise, no side is shorter than 0.3 m; yaw stays within half a turn."""

    def rough(profile: dict[str, Any]) -> None:
        profile["size"]["width"] = {"white": 3.0, "fixed": 3.0}
        profile["yaw"]["constant"] = 2.0

    trace = convoy(20.0, np.linspace(-3, 3, 50), 1.0, 50)
    detections = detect(trace, profile_file(tmp_path, rough), seed=9)
    assert detections.width.min() == 0.3
    assert np.ptp(detections.width) > CAR[1]
    assert np.abs(detections.yaw).max() <= np.pi


# --- every object draws its own -------------------------------------------------------------


def scene(seed: str = "0") -> Trace:
    rng = np.random.default_rng(10)
    n = 40
    return convoy(rng.uniform(3, 75, n), rng.uniform(-3, 3, n), rng.random(n), 80, seed=seed)


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


def test_the_same_seed_is_the_same_table_and_another_is_not() -> None:
    """Twice the same is the same bytes; another detector seed, or another seed of the trace,
    gives other noise everywhere."""
    first = detect(scene(), seed=13)
    assert first.content_hash() == detect(scene(), seed=13).content_hash()
    for other in (detect(scene(), seed=14), detect(scene(seed="1"), seed=13)):
        assert not np.isin(first.x, other.x).any()
        assert not np.isin(first.score, other.score).any()


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
