"""Claim: what is hidden, out of range or without returns is never seen, what is half hidden is seen
where it shows, and a wrong pose of the sensor misplaces all alike.
"""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from mdkf.tables import CLUTTER, FloatArray, Trace
from sim_bridge import detect
from sim_bridge.lidar import HDL_64E
from tests.sim_bridge.beams import cast_counts
from tests.sim_bridge.measured import (
    MAX_RANGE,
    autocorrelation,
    changed,
    dense,
    quiet,
    with_columns,
)
from tests.sim_bridge.worlds import CAR, SIZE, convoy

# --- what is never seen ---------------------------------------------------------------------


def test_nothing_is_detected_beyond_the_maximum_range() -> None:
    """A decimetre before it some detections come, a decimetre beyond it none, clutter included."""
    trace = convoy([MAX_RANGE - 0.1, MAX_RANGE + 0.1] * 20, np.linspace(-3, 3, 40), 1.0, 50)
    detections = detect(trace, seed=6)
    x = detections.x - trace.ego.x[detections.frame]
    y = detections.y - trace.ego.y[detections.frame]
    clutter = detections.source == CLUTTER
    assert np.hypot(x, y)[clutter].max() <= MAX_RANGE
    counts = np.bincount(detections.source[~clutter], minlength=40)
    assert (counts[0::2] > 0).all()
    assert (counts[1::2] == 0).all()


def test_objects_that_drive_out_of_range_are_lost_there() -> None:
    """Of objects that drive from 3.95 m before it to 4 m beyond it, 0.1 m a frame, the last
    detections are just within it."""
    trace = convoy(MAX_RANGE - 3.95, np.zeros(30), 1.0, 81)
    leaving = with_columns(trace, x=trace.x + 0.1 * trace.frame)
    detections = detect(leaving, seed=6)
    true = detections.source != CLUTTER
    assert 35 <= detections.frame[true].max() <= 39


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


def test_without_noise_the_truth_is_reported() -> None:
    """A profile with no noise, full detection and no clutter gives every box as it is, under its
    object's id."""
    trace = convoy([10.0, 30.0, 69.0], [0.3, 2.0, -2.5], 1.0, 20)
    detections = detect(trace, changed(quiet), seed=8)
    np.testing.assert_array_equal(detections.source, trace.object_id)
    np.testing.assert_array_equal(detections.frame, trace.frame)
    for name in ("x", "y", "z", "length", "width", "height"):
        np.testing.assert_array_equal(getattr(detections, name), getattr(trace, name))
    np.testing.assert_allclose(detections.yaw, trace.yaw, atol=1e-14)


def test_sizes_stay_positive() -> None:
    """However large the noise, no side is shorter than 0.3 m; yaw stays within half a turn."""

    def rough(profile: dict[str, Any]) -> None:
        profile["size"]["width"]["constant"] = 3.0
        profile["yaw"]["constant"] = 2.0

    trace = convoy(20.0, np.linspace(-3, 3, 50), 1.0, 50)
    detections = detect(trace, changed(rough), seed=9)
    assert detections.width.min() == 0.3
    assert np.ptp(detections.width) > CAR[1]
    assert np.abs(detections.yaw).max() <= np.pi


# --- what the scene is to the sensor ---------------------------------------------------------


def test_few_returns_are_detected_less_often() -> None:
    """With half_points 50, 1 - 2^(-points / 50) of independent objects, as binomial chance allows;
    points is what every beam of the LiDAR cast at the box alone gives, times visible. Half of
    them where that is 50."""

    def demanding(profile: dict[str, Any]) -> None:
        quiet(profile)
        profile["detection"]["half_points"] = 50.0

    n, bearing, yaw = 4000, 0.4, 1.7
    groups = [(r, points) for r in (12.0, 30.0, 60.0) for points in (10.0, 50.0, 100.0)]
    alone = {}
    for r, _ in groups:
        box = [r * np.cos(bearing), r * np.sin(bearing), CAR[2] / 2, yaw, *CAR]
        alone[r] = cast_counts(np.array([0.0, 0.0, 1.73]), np.array([box]), HDL_64E)[0]
    visible = np.repeat([points / alone[r] for r, points in groups], n)
    trace = convoy(np.repeat([r for r, _ in groups], n), bearing, visible, 1)
    trace = with_columns(trace, yaw=np.full(len(trace), yaw))
    seen = dense(trace, detect(trace, changed(demanding), seed=16))["seen"]
    for group, counted in zip(groups, seen.reshape(-1, n).sum(axis=1), strict=True):
        chance = stats.binomtest(int(counted), n, 1 - 2 ** (-group[1] / 50))
        assert chance.pvalue > 1e-3, (group, counted)


@pytest.mark.parametrize("half_points", [0.0, 0.5])
def test_without_returns_nothing_is_detected(half_points: float) -> None:
    """Of two boxes near the sensor in full view, the one above all beams is never reported; the
    other always, by any return if half_points is 0."""

    def sharp(profile: dict[str, Any]) -> None:
        quiet(profile)
        profile["detection"]["half_points"] = half_points

    trace = convoy(20.0, [0.5, 1.5], 1.0, 50)
    trace = with_columns(trace, z=np.where(trace.object_id == 0, 30.0, trace.z))
    detections = detect(trace, changed(sharp), seed=17)
    np.testing.assert_array_equal(detections.source, np.ones(50))


@pytest.mark.parametrize("share", [1.0, 0.4, -0.5])
@pytest.mark.parametrize("hidden", [-1, 1])
@pytest.mark.parametrize("bearing", [0.7, 3.1])
def test_half_hidden_boxes_are_shifted_to_what_is_visible(
    share: float, hidden: int, bearing: float
) -> None:
    """A car whose left (1) or right (-1) part is behind a tall screen is reported to the other
    side, by side_share of the way to the middle of the rest; neither nearer nor farther, and the
    screen, in full view, and the car without it are where they are."""

    def shifted(profile: dict[str, Any]) -> None:
        quiet(profile)
        profile["side_share"] = share

    trace = convoy([20.0, 10.0], [bearing, bearing + 0.2 * hidden], [0.5, 1.0], 4)
    screen = trace.object_id == 1
    trace = with_columns(
        trace,
        yaw=np.where(screen, bearing + 0.2 * hidden, bearing) + np.pi / 2,
        z=np.full(len(trace), 5.0),
        height=np.full(len(trace), 10.0),
        length=np.where(screen, 3.0, CAR[0]),
        width=np.where(screen, 0.4, CAR[1]),
    )
    profile = changed(shifted)
    table = dense(trace, detect(trace, profile, seed=18))
    # The car's near side is 19.1 m away; the screen's end nearest to the line of sight is on its
    # nearer side.
    end = np.arctan2(CAR[0] / 2, 20.0 - CAR[1] / 2)
    inner = 0.2 - np.arctan2(1.5, 9.8)
    middle = -hidden * (end - inner) / 2
    expected = [[20.0 * share * middle] * 4, [0.0] * 4]
    np.testing.assert_allclose(table["lateral"], expected, atol=1e-9)
    for name in ("radial", "vertical", "yaw", *SIZE):
        np.testing.assert_allclose(table[name], 0.0, atol=1e-9)
    alone = detect(trace.take(~screen), profile, seed=18)
    np.testing.assert_allclose(alone.x, trace.x[~screen], atol=1e-9)


# --- a wrong pose of the sensor ---------------------------------------------------------------


def poses(trace: Trace, *seeds: int) -> tuple[FloatArray, FloatArray]:
    """Offsets, x and y (seeds, frames, 2) [m], and turns (seeds, frames) [rad] by which a wrong
    pose moves all boxes of a frame; asserts that it moves all alike and changes nothing else."""

    def lost(profile: dict[str, Any]) -> None:
        profile["pose"] = {"position": 0.3, "yaw": 0.02, "drift_time": 0.5}

    known, unknown = changed(lambda _: None), changed(lost)
    offsets, turns = (
        np.empty((len(seeds), trace.n_frames, 2)),
        np.empty((len(seeds), trace.n_frames)),
    )
    for k, seed in enumerate(seeds):
        right, wrong = detect(trace, known, seed), detect(trace, unknown, seed)
        # Rows are paired by their scores: clutter may have changed its order within a frame.
        i, j = (np.lexsort((d.score, d.frame)) for d in (right, wrong))
        for name in ("frame", "source", "z", "length", "width", "height", "score"):
            np.testing.assert_array_equal(getattr(right, name)[i], getattr(wrong, name)[j])
        frame = right.frame[i]
        turn = np.angle(np.exp(1j * (wrong.yaw[j] - right.yaw[i])))
        sensor = trace.ego.x[frame] + 1j * trace.ego.y[frame]
        before, after = right.x[i] + 1j * right.y[i], wrong.x[j] + 1j * wrong.y[j]
        offset = after - sensor - (before - sensor) * np.exp(1j * turn)
        first = right.frame_start[:-1]
        assert (np.diff(right.frame_start) > 1).all()
        np.testing.assert_allclose(turn, turn[first][frame], atol=1e-9)
        np.testing.assert_allclose(offset, offset[first][frame], atol=1e-6)
        offsets[k] = np.stack([offset[first].real, offset[first].imag], axis=-1)
        turns[k] = turn[first]
    return offsets, turns


def test_a_wrong_pose_moves_all_boxes_of_a_frame_alike() -> None:
    """Clutter included, by an offset and a turn about the sensor with the profile's deviations,
    independent of each other, forgotten with the pose's time constant."""
    trace = convoy(15.0, np.linspace(-3, 3, 8), 1.0, 20_000)
    (offset,), (turn,) = poses(trace, 19)
    parts = np.array([offset[:, 0] / 0.3, offset[:, 1] / 0.3, turn / 0.02])
    np.testing.assert_allclose(parts.std(axis=1), 1.0, atol=0.06)
    np.testing.assert_allclose(parts.mean(axis=1), 0.0, atol=0.08)
    assert np.abs(np.corrcoef(parts) - np.eye(3)).max() < 0.08
    for lag in (1, 5, 15):
        expected = np.exp(-0.1 * lag / 0.5)
        for part in parts:
            assert autocorrelation(part[None], lag) == pytest.approx(expected, abs=0.07)


def test_a_wrong_pose_is_wrong_from_the_first_frame() -> None:
    """Over runs, the first frame's offsets and turns are normal with the profile's deviations."""
    trace = convoy(15.0, np.linspace(-3, 3, 8), 1.0, 1)
    offsets, turns = poses(trace, *range(300))
    for values, deviation in (
        (offsets[:, 0, 0], 0.3),
        (offsets[:, 0, 1], 0.3),
        (turns[:, 0], 0.02),
    ):
        assert stats.kstest(values, stats.norm(0.0, deviation).cdf).pvalue > 1e-3
