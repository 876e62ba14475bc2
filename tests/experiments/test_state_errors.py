"""Claim: errors of position, velocity and heading, NEES and NIS are those of each estimate's own
object; averages know how many samples they have, and when a covariance tells the truth."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.distance import mahalanobis

import mdkf
from experiments.states import StateErrors, Value, consistency, mean, root_mean_square, state_errors
from mdkf.motion import transition
from mdkf.tables import Trace, Tracks
from tests.tables import random_trace, random_tracks, trace_of, tracks_of

POSTERIOR, MEASURED = {"position": "posterior"}, {"position": "measurement"}


def one_pair(truth: dict[str, float], track: dict[str, float]) -> StateErrors:
    """Errors of one estimate of one car, the columns of both as given, else 0."""
    trace = trace_of([(0, 1, 0.0, 0.0)], 1, **{name: [v] for name, v in truth.items()})
    tracks = tracks_of([(0, 1, 0.0, 0.0)], 1)
    columns = {
        name: np.array([v]) for name, v in ({"yaw": 0.0, "vx": 0.0, "vy": 0.0} | track).items()
    }
    tracks = dataclasses.replace(tracks, **columns)  # type: ignore[arg-type]
    return state_errors(trace, tracks, np.array([0]), np.array([0]))


def test_errors_by_hand() -> None:
    """3-4-5 triangles, and variances 4 and 1: 3^2 / 4 + 4^2 / 1."""
    errors = one_pair(
        {"x": 10.0, "y": 5.0, "vx": 7.0, "vy": -1.0, "yaw": 0.5},
        {"x": 13.0, "y": 9.0, "vx": 7.3, "vy": -0.6, "yaw": 0.2, "cov_xx": 4.0, "cov_yy": 1.0},
    )
    assert errors.position[0] == pytest.approx(5.0)
    assert errors.velocity[0] == pytest.approx(0.5)
    assert errors.heading[0] == pytest.approx(0.3)
    assert errors.nees[0] == pytest.approx(9 / 4 + 16)


@pytest.mark.parametrize("turns", [-3, 0, 2])
@pytest.mark.parametrize(
    ("off", "expected"), [(0.3, 0.3), (-0.3, 0.3), (3.0, 3.0), (4.0, 2.283185)]
)
def test_headings_wrap(turns: int, off: float, expected: float) -> None:
    """The angle between two headings, at most half a turn, whatever turns either has made."""
    errors = one_pair({"yaw": 3.1 - 2 * np.pi * turns}, {"yaw": 3.1 + off})
    assert errors.heading[0] == pytest.approx(expected, abs=1e-6)


def test_headings_that_look_backwards_are_told() -> None:
    """Three of eight boxes are the wrong way round and one is a quarter turn off, which is not."""
    off = np.array([0.0, 0.1, np.pi, -0.1, np.pi - 0.2, 0.0, -np.pi, np.pi / 2])
    values = errors_of(heading=np.abs(off)).values()
    assert values["backwards"] == Value(100 * 3 / 8, 8)
    assert values["heading_error"].value == pytest.approx(np.abs(off).mean())


def errors_of(**columns: Any) -> StateErrors:
    """State errors with some columns given, the others without a value."""
    n = len(next(iter(columns.values())))
    rows = {"truth_row": np.arange(n), "track_row": np.arange(n)}
    names = ("position", "velocity", "heading", "nees", "nis")
    return StateErrors(**(rows | dict.fromkeys(names, np.full(n, np.nan)) | columns))


def test_nees_is_the_squared_mahalanobis_distance() -> None:
    """Against scipy, for any pairs of rows of two tables and correlated covariances."""
    rng = np.random.default_rng(3)
    trace, tracks = random_trace(rng, 80), random_tracks(rng, 60)
    i, j = rng.permutation(80)[:50], rng.permutation(60)[:50]
    errors = state_errors(trace, tracks, i, j)
    for k in range(50):
        P = np.array(
            [
                [tracks.cov_xx[j[k]], tracks.cov_xy[j[k]]],
                [tracks.cov_xy[j[k]], tracks.cov_yy[j[k]]],
            ]
        )
        places = [(table.x[row], table.y[row]) for table, row in ((tracks, j[k]), (trace, i[k]))]
        expected = mahalanobis(*places, np.linalg.inv(P)) ** 2
        assert errors.nees[k] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("provenance", "detected"), [(POSTERIOR, True), (MEASURED, False), ({}, True)]
)
def test_a_measurement_has_no_nees(provenance: dict[str, str], detected: bool) -> None:
    """Where a tracker reports the detection itself, the covariance is not that of the position;
    in frames without a detection it reports the filter's."""
    rows = [(0, 1, 0.0, 0.0), (1, 1, 0.0, 0.0)]
    tracks = tracks_of(rows, 2, [False, True], provenance)
    errors = state_errors(trace_of(rows, 2), tracks, np.arange(2), np.arange(2))
    assert (~np.isnan(errors.nees)).tolist() == [detected, True]


def test_what_nobody_tells_has_no_value() -> None:
    """No nis among the diagnostics, no velocity in a recording's labels: NaN of 0 samples. The
    other scores stay."""
    rows = [(k, 1, 0.0, 0.0) for k in range(4)]
    unknown = dict.fromkeys(("vx", "vy"), [np.nan] * 4) | {"regime": [4] * 4}
    trace = trace_of(rows, 4, **unknown)
    values = state_errors(trace, tracks_of(rows, 4), np.arange(4), np.arange(4)).values()
    for name in ("velocity_error", "velocity_rmse", "nis"):
        assert np.isnan(values[name].value)
        assert values[name].n == 0
        assert values[name].verdict is None
    assert values["position_error"] == Value(0.0, 4)
    assert values["nees"].n == 4


def test_nis_is_what_the_estimator_tells() -> None:
    """Its column, row by row; frames without a measurement do not count."""
    nis = np.array([1.0, np.nan, 4.0])
    rows = [(k, 1, 0.0, 0.0) for k in range(3)]
    tracks = dataclasses.replace(tracks_of(rows, 3), diagnostics={"nis": nis})
    errors = state_errors(trace_of(rows, 3), tracks, np.arange(3), np.arange(3))
    np.testing.assert_array_equal(errors.nis, nis)
    assert (errors.values()["nis"].value, errors.values()["nis"].n) == (2.5, 2)


def test_averages_leave_out_what_has_no_value() -> None:
    """And say how many samples there were; of none there is no value."""
    samples = np.array([3.0, np.nan, 4.0])
    assert mean(samples) == Value(3.5, 2)
    squares = root_mean_square(samples)
    assert (squares.value, squares.n) == (pytest.approx(np.sqrt(12.5)), 2)
    for average in (mean, root_mean_square, lambda none: consistency(none, 2)):
        empty = average(np.full(3, np.nan))
        assert np.isnan(empty.value)
        assert (empty.n, empty.verdict) == (0, None)


@pytest.mark.parametrize("n", [1, 30, 5000])
def test_the_interval_holds_95_percent_of_consistent_filters(n: int) -> None:
    """Of 4000 filters with true covariances and independent errors 95 % are called consistent, and
    of the others as many optimistic as pessimistic: within what 4000 draws allow."""
    rng = np.random.default_rng(n)
    samples = rng.chisquare(2, (4000, n))
    verdicts = [consistency(row, 2).verdict for row in samples]
    for verdict, share in (("consistent", 0.95), ("optimistic", 0.025), ("pessimistic", 0.025)):
        low, high = stats.binom.ppf([1e-4, 1 - 1e-4], 4000, share)
        assert low <= verdicts.count(verdict) <= high, verdict


def test_the_interval_is_chi_squared() -> None:
    """Bar-Shalom's: 50 runs of a 2-dimensional error, 100 degrees of freedom; by the tables
    74.22 / 50 to 129.56 / 50."""
    value = consistency(np.full(50, 2.0), 2)
    assert (value.low, value.high) == (
        pytest.approx(1.4844, abs=1e-4),
        pytest.approx(2.5912, abs=1e-4),
    )
    assert value.verdict == "consistent"


ORDER, RUNS, FRAMES = 1, 3000, 6


def filtered(told: float) -> tuple[Trace, Tracks]:
    """3000 cars that move just as a constant-velocity filter believes, each tracked from its first
    position on by a filter that is told `told` times the noise's true variance."""
    rng = np.random.default_rng(17)
    model = mdkf.Kalman(order=ORDER, process_density=(0.0,))
    R = np.diag([0.09, 0.04])
    z = rng.normal(0, 100, (RUNS, 2))
    truth = rng.normal(size=(RUNS, 2, 2)) * np.sqrt(model.start_variance[:2])
    truth[..., 0] += z
    told_noise = np.broadcast_to(told * R, (RUNS, 2, 2))
    state = model.start(z, told_noise)
    for _ in range(FRAMES):
        truth = truth @ transition(ORDER, 0.1).T
        seen = truth[..., 0] + rng.normal(size=(RUNS, 2)) * np.sqrt(np.diag(R))
        state = model.update(model.predict(state, 0.1), seen, told_noise)
    rows = [(0, i, 0.0, 0.0) for i in range(RUNS)]
    of_truth = {
        "x": truth[:, 0, 0],
        "y": truth[:, 1, 0],
        "vx": truth[:, 0, 1],
        "vy": truth[:, 1, 1],
    }
    trace = trace_of(rows, 1, **of_truth)  # type: ignore[arg-type]
    (px, py), (vx, vy) = model.position(state).T, model.velocity(state).T
    P = model.covariance(state)
    columns = {"x": px, "y": py, "vx": vx, "vy": vy, "cov_xx": P[:, 0, 0]}
    columns |= {"cov_xy": P[:, 0, 1], "cov_yy": P[:, 1, 1]}
    tracks = dataclasses.replace(
        tracks_of(rows, 1), **columns, diagnostics=dict(model.diagnostics(state))
    )  # type: ignore[arg-type]
    return trace, tracks


@pytest.mark.parametrize(
    ("told", "verdict"), [(1.0, "consistent"), (0.25, "optimistic"), (4.0, "pessimistic")]
)
def test_a_filter_is_consistent_if_it_is_told_the_truth(told: float, verdict: str) -> None:
    """One sample of each of 3000 independent runs, for which the interval is exact: with the true
    noise NEES and NIS are 2, with a quarter of it too large, with four times it too small."""
    trace, tracks = filtered(told)
    values = state_errors(trace, tracks, np.arange(RUNS), np.arange(RUNS)).values()
    for name in ("nees", "nis"):
        assert values[name].n == RUNS
        assert values[name].verdict == verdict, (name, values[name])
    if told == 1.0:
        # The covariance tells the errors' size: that of the position is its trace.
        told_square = np.mean(tracks.cov_xx + tracks.cov_yy)
        assert values["position_rmse"].value ** 2 == pytest.approx(told_square, rel=0.1)
