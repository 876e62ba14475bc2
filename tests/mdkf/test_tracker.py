"""Claim: the tracker follows RobMOT's rules, and nothing but the detections decides."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from mdkf import DETECTORS, Detections, Kalman, MotionDynamics, Tracker, TrackerSettings, Tracks
from mdkf.estimator import Estimator
from mdkf.reference import filterpy_kalman

SETTINGS = TrackerSettings(
    gate=2, validity=3, score=0.5, confirmed_score=0.0, x_var=0.03, y_var=0.01
)


def detections(rows: list[tuple[int, float, float, float]], n_frames: int) -> Detections:
    """Detections from (frame, x, y, score)."""
    frame, x, y, score = (np.array(c, dtype=float) for c in zip(*rows, strict=True))
    n = len(rows)
    columns = {"frame": frame, "x": x, "y": y, "score": score}
    columns |= {"z": np.ones(n), "yaw": 0.1 * frame, "source": np.full(n, -1)}
    columns |= {"length": np.full(n, 4.5), "width": np.full(n, 1.8), "height": np.full(n, 1.5)}
    return Detections.from_columns(columns, n_frames=n_frames, dt=0.1)


def track(rows: list[tuple[int, float, float, float]], n_frames: int, **options: Any) -> Tracks:
    """Tracks of the CA filter under SETTINGS."""
    return Tracker(Kalman(), SETTINGS, **options).run(detections(rows, n_frames))


def test_two_objects_keep_their_identities() -> None:
    """Two cars 5 m apart, seen in every frame, are two tracks that follow them."""
    rows = [(k, 0.5 * k, y, 1.0) for k in range(40) for y in (0.0, 5.0)]
    tracks = track(rows, 40)
    assert len(tracks.ids()) == 2
    for identifier, y in zip(tracks.ids(), (0.0, 5.0), strict=True):
        of = tracks.rows_of(identifier)
        assert len(of) == 40
        np.testing.assert_allclose(tracks.y[of], y, atol=1e-9)
        np.testing.assert_allclose(tracks.x[of][20:], 0.5 * np.arange(20, 40), atol=0.02)
        np.testing.assert_allclose(tracks.vx[of][30:], 5.0, atol=0.1)


def test_validity_confirms_by_hand() -> None:
    """s += max(c, 1) exp(-g) - g / max(c, 1): c = 2 in frames 0 and 2 (g = 1), 4.
    After frame 0: 2; frame 2: 2 + 2/e - 1/2 = 2.24; frame 3: 4.24 > 3 confirms."""
    rows = [(0, 0.0, 0.0, 2.0), (2, 0.0, 0.0, 2.0), (3, 0.0, 0.0, 2.0), (4, 0.0, 0.0, 2.0)]
    online = track(rows, 5, confirmation="online")
    assert online.frame.tolist() == [3, 4]
    assert track(rows, 5).frame.tolist() == [0, 1, 2, 3, 4]
    assert len(track(rows[:2], 5)) == 0


def test_weak_detections_count_only_near_confirmed_tracks() -> None:
    """Below `confirmed_score` never; between the two only within a confirmed track's gate."""
    strong = [(k, 0.0, 0.0, 1.0) for k in range(6)]
    weak_near = [(6, 0.5, 0.0, 0.2)]
    weak_far = [(6, 8.0, 0.0, 0.2), (2, 0.5, 0.5, 0.2)]
    tracks = track(strong + weak_near + weak_far, 7)
    assert len(tracks.ids()) == 1
    assert tracks.coasted.tolist() == [False] * 7
    assert track([*strong, (6, 0.5, 0.0, -0.1)], 7).coasted[-1]


def test_a_track_dies_when_its_variance_passes_the_bound() -> None:
    """filterpy says in which missed frame CA's predicted variance passes 4 m2: the 32nd."""
    oracle = filterpy_kalman(np.zeros(2), 2, 0.1)
    for _ in range(39):
        oracle.predict()
        oracle.update(np.zeros(2), R=np.diag([0.030874, 0.009379]))
    survived = -1
    while max(oracle.P[0, 0], oracle.P[3, 3]) <= 4:
        oracle.predict()
        survived += 1
    rows = [(k, 0.0, 0.0, 1.0) for k in range(40)]
    tracks = Tracker(Kalman(), "pointrcnn").run(detections(rows, 100))
    assert tracks.frame.max() - 39 == survived == 31
    short = Tracker(Kalman(), "pointrcnn", max_missed=4).run(detections(rows, 100))
    assert short.frame.max() - 39 == 5
    assert (tracks.cov_xx <= 4).all()


def test_reporting_options_change_only_the_report() -> None:
    """Measurement or posterior, coasting or not: the same tracks underneath."""
    rng = np.random.default_rng(1)
    seen = [k for k in range(40) if k not in range(15, 25)]
    rows = [(k, 0.3 * k + rng.normal(0, 0.2), rng.normal(0, 0.1), 1.0) for k in seen]
    given = detections(rows, 40)
    posterior = Tracker(Kalman(), SETTINGS).run(given)
    measurement = Tracker(Kalman(), SETTINGS, position="measurement").run(given)
    seen_only = Tracker(Kalman(), SETTINGS, coasting=False).run(given)
    matched = ~posterior.coasted
    np.testing.assert_array_equal(measurement.x[matched], given.x)
    np.testing.assert_array_equal(measurement.x[~matched], posterior.x[~matched])
    np.testing.assert_array_equal(measurement.vx, posterior.vx)
    assert seen_only == posterior.take(matched)
    assert posterior.coasted.sum() == 10
    np.testing.assert_array_equal(posterior.yaw[posterior.coasted], 0.1 * 14)


def test_a_track_looks_where_most_of_its_detections_did() -> None:
    """A detection that looks backwards does not turn a track, seen or coasting, unless it is told
    as measured; height and size are those of the last detection while it coasts."""
    rows = [(k, 0.0, 0.0, 1.0) for k in range(20)]
    columns = dict(detections(rows, 20).columns())
    backwards = np.isin(np.arange(20), [5, 11, 19])
    columns["yaw"] = np.where(backwards, 0.3 - np.pi, 0.3)
    columns["z"], columns["length"] = 0.01 * np.arange(20), 4.0 + 0.1 * np.arange(20)
    given = Detections.from_columns(columns, n_frames=25, dt=0.1)
    tracks = Tracker(Kalman(), SETTINGS).run(given)
    np.testing.assert_allclose(tracks.yaw, 0.3, atol=1e-15)
    assert tracks.coasted.sum() == 5
    assert set(tracks.z[tracks.coasted]) == {given.z[-1]}
    assert set(tracks.length[tracks.coasted]) == {given.length[-1]}
    measured = Tracker(Kalman(), SETTINGS, position="measurement").run(given)
    np.testing.assert_array_equal(measured.yaw[~measured.coasted], given.yaw)
    np.testing.assert_allclose(measured.yaw[measured.coasted], 0.3, atol=1e-15)


def test_most_of_all_is_counted_over_a_tracks_life() -> None:
    """Two of three look the other way: from the second of them on, that is where it looks; in
    between, one against one, the last one decides."""
    columns = dict(detections([(k, 0.0, 0.0, 2.0) for k in range(3)], 3).columns())
    columns["yaw"] = np.array([3.0, 3.0 - np.pi, 3.1 - np.pi])
    given = Detections.from_columns(columns, n_frames=3, dt=0.1)
    tracks = Tracker(Kalman(), SETTINGS).run(given)
    np.testing.assert_allclose(tracks.yaw, columns["yaw"], atol=1e-15)


def test_the_source_of_a_detection_is_never_used() -> None:
    """Other sources, the same tracks."""
    rng = np.random.default_rng(2)
    rows = [(k, x + rng.normal(0, 0.1), 0.0, 1.0) for k in range(30) for x in (0.0, 3.0, 9.0)]
    given = detections(rows, 30)
    columns = dict(given.columns())
    columns["source"] = np.tile([4, 8, 6], 30)
    named = Detections.from_columns(columns, n_frames=30, dt=0.1)
    estimator = MotionDynamics()
    assert Tracker(estimator, SETTINGS).run(given) == Tracker(estimator, SETTINGS).run(named)


def test_no_detections_give_no_tracks() -> None:
    """An empty table, and empty frames at either end."""
    empty = detections([(0, 0.0, 0.0, 1.0)], 5).take(np.array([], dtype=int))
    assert len(Tracker(MotionDynamics(), SETTINGS).run(empty)) == 0
    rows = [(k, 0.0, 0.0, 2.0) for k in range(3, 8)]
    assert Tracker(MotionDynamics(), SETTINGS).run(detections(rows, 12)).frame.min() == 3


class AlphaBeta:
    """A user's own estimator in plain numpy: state rows [x, y, vx, vy]."""

    def start(self, position: Any, noise: Any) -> Any:
        return Rows(np.hstack([position, np.zeros_like(position)]))

    def predict(self, state: Any, dt: float) -> Any:
        values = state.values.copy()
        values[:, :2] += dt * values[:, 2:]
        return Rows(values)

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        innovation = np.nan_to_num(position - state.values[:, :2])
        return Rows(state.values + np.hstack([0.5 * innovation, 1.0 * innovation]))

    def position(self, state: Any) -> Any:
        return state.values[:, :2]

    def velocity(self, state: Any) -> Any:
        return state.values[:, 2:]

    def covariance(self, state: Any) -> Any:
        return np.tile(np.eye(2), (len(state.values), 1, 1))

    def diagnostics(self, state: Any) -> Any:
        return {}


@dataclass(frozen=True)
class Rows:
    """The state of AlphaBeta."""

    values: np.ndarray


def test_any_object_with_the_methods_is_an_estimator() -> None:
    """The tracker takes a plain numpy estimator; one without the methods is refused by name."""
    assert isinstance(AlphaBeta(), Estimator)
    rows = [(k, 0.5 * k, 0.0, 1.0) for k in range(30)]
    tracks = Tracker(AlphaBeta(), SETTINGS).run(detections(rows, 30))
    np.testing.assert_allclose(tracks.x[-1], 14.5, atol=0.01)
    for wrong in (object(), AlphaBeta):
        with pytest.raises(TypeError, match="no object with the methods"):
            Tracker(wrong, SETTINGS)  # type: ignore[arg-type]


class ForgetsGaps(AlphaBeta):
    """Takes the NaN that stands for a missing detection for a measurement."""

    def update(self, state: Any, position: Any, noise: Any) -> Any:
        return Rows(np.hstack([position, state.values[:, 2:]]))


class OnePosition(AlphaBeta):
    """Has one position for all of its tracks."""

    def position(self, state: Any) -> Any:
        return state.values[:1, :2]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (ForgetsGaps(), r"ForgetsGaps: positions of 2 tracks .* not finite"),
        (OnePosition(), r"OnePosition: positions of 2 tracks have shape \(1, 2\)"),
    ],
)
def test_tracks_that_are_nowhere_are_told(wrong: Estimator, told: str) -> None:
    """An estimator that loses its numbers is an error, not a scene without tracks."""
    rows = [(k, 0.5 * k, y, 1.0) for k in range(30) for y in (0.0, 20.0) if k != 15 or y == 0.0]
    with pytest.raises(ValueError, match=told):
        Tracker(wrong, SETTINGS).run(detections(rows, 30))


def test_a_state_may_be_a_plain_array() -> None:
    """One row for each track; a state that is neither is told so."""

    class OnArrays(AlphaBeta):
        def start(self, position: Any, noise: Any) -> Any:
            return super().start(position, noise).values

        def predict(self, state: Any, dt: float) -> Any:
            return super().predict(Rows(state), dt).values

        def update(self, state: Any, position: Any, noise: Any) -> Any:
            return super().update(Rows(state), position, noise).values

        def position(self, state: Any) -> Any:
            return state[:, :2]

        def velocity(self, state: Any) -> Any:
            return state[:, 2:]

        def covariance(self, state: Any) -> Any:
            return super().covariance(Rows(state))

    rows = [(k, 0.5 * k, y, 1.0) for k in range(30) for y in (0.0, 5.0) if k > y]
    given = detections(rows, 30)
    assert Tracker(OnArrays(), SETTINGS).run(given) == Tracker(AlphaBeta(), SETTINGS).run(given)

    class OnLists(OnArrays):
        def start(self, position: Any, noise: Any) -> Any:
            return super().start(position, noise).tolist()

        def predict(self, state: Any, dt: float) -> Any:
            return state

        def update(self, state: Any, position: Any, noise: Any) -> Any:
            return state

        def position(self, state: Any) -> Any:
            return np.array(state)[:, :2]

        def velocity(self, state: Any) -> Any:
            return np.array(state)[:, 2:]

        def covariance(self, state: Any) -> Any:
            return np.tile(np.eye(2), (len(state), 1, 1))

    with pytest.raises(TypeError, match="state is list, expected an array, or a dataclass"):
        Tracker(OnLists(), SETTINGS).run(given)


def test_wrong_settings_are_named() -> None:
    """Unknown detectors and impossible values."""
    with pytest.raises(ValueError, match="'pointrccn', expected one of: virconv"):
        Tracker(Kalman(), "pointrccn")
    assert Tracker(Kalman(), "pvcnn").settings == DETECTORS["pvrcnn"]
    with pytest.raises(ValueError, match="gate is -1"):
        Tracker(Kalman(), DETECTORS["pointrcnn"], gate=-1)
    with pytest.raises(ValueError, match="position is 'prior'"):
        Tracker(Kalman(), position="prior")
    for name in ("gate", "max_variance", "validity", "score", "confirmed_score"):
        for given in (np.nan, "wide", None):
            with pytest.raises(ValueError, match=f"{name} is {given!r}, expected a number"):
                Tracker(Kalman(), **{name: given})
    for missed in (-1, 2.5, "3"):
        with pytest.raises(ValueError, match=f"max_missed is {missed!r}, expected a count"):
            Tracker(Kalman(), max_missed=missed)
    with pytest.raises(ValueError, match="coasting is 'no', expected True or False"):
        Tracker(Kalman(), coasting="no")


def test_equal_settings_are_told_alike() -> None:
    """Whole numbers or not; and no count of missed frames is too large for a kernel."""
    rows = [(k, 0.0, 0.0, 1.0) for k in range(4)]
    told = [
        Tracker(Kalman(), SETTINGS, max_variance=most).run(detections(rows, 4)) for most in (4, 4.0)
    ]
    assert told[0].content_hash() == told[1].content_hash()
    assert told[0].provenance == told[1].provenance
    endless = Tracker(Kalman(), SETTINGS, max_missed=10**30).run(detections(rows, 100))
    assert endless == Tracker(Kalman(), SETTINGS).run(detections(rows, 100))
