"""Claim: an estimator alone is the textbook filter on each object's own detections."""

import numpy as np
import pytest
from scipy import linalg

from experiments.alone import SETTLED, by_object, distance, run_lengths, steps
from mdkf import DETECTORS, Kalman, estimator
from mdkf.motion import process_noise, taylor
from mdkf.reference import filterpy_kalman
from mdkf.tables import FloatArray
from tests.tables import trace_of

SETTINGS = DETECTORS["pointrcnn"]
DT = 0.1


def seen(seed: int, frames: int = 60) -> FloatArray:
    """Three objects that come one after the other, miss detections, and drive at random speeds."""
    rng = np.random.default_rng(seed)
    velocity = rng.uniform(-10, 10, (3, 2))
    measured = DT * np.arange(frames)[:, None, None] * velocity
    measured += rng.normal(0, 0.2, measured.shape)
    measured[rng.random((frames, 3)) < 0.1] = np.nan
    for late in range(3):
        measured[: 4 * late, late] = np.nan
    return measured


@pytest.mark.parametrize(("name", "order"), [("cv", 1), ("ca", 2), ("cj", 3)])
def test_predictions_and_states_are_filterpys(name: str, order: int) -> None:
    """One filterpy filter for each object, however many are followed at once."""
    measured, chosen = seen(order), estimator(name)
    predicted, posterior = np.full((2, *measured.shape), np.nan)
    for step in steps(measured, DT, chosen, SETTINGS):
        predicted[step.frame, step.objects] = step.predicted
        posterior[step.frame, step.objects] = chosen.position(step.state)
    place = [0, order + 1]
    for k in range(measured.shape[1]):
        first = int(np.argmax(np.isfinite(measured[:, k, 0])))
        assert np.isnan(predicted[: first + 1, k]).all()
        assert np.isnan(posterior[:first, k]).all()
        oracle = filterpy_kalman(measured[first, k], order, DT)
        for frame in range(first + 1, len(measured)):
            oracle.predict()
            np.testing.assert_allclose(predicted[frame, k], oracle.x[place], atol=1e-9)
            if np.isfinite(measured[frame, k, 0]):
                oracle.update(measured[frame, k], R=np.diag([SETTINGS.x_var, SETTINGS.y_var]))
            np.testing.assert_allclose(posterior[frame, k], oracle.x[place], atol=1e-9)


def test_errors_at_rest_are_what_the_steady_gain_gives() -> None:
    """CV on a standing object: the mean squared errors of prediction and posterior are those of the
    linear recursion e <- (I - K H) F e + K v with the gain of the discrete Riccati equation."""
    objects, frames = 400, 120
    rng = np.random.default_rng(5)
    deviation = np.sqrt([SETTINGS.x_var, SETTINGS.y_var])
    measured = rng.standard_normal((frames, objects, 2)) * deviation
    chosen = Kalman(order=1)
    squares = []
    for step in steps(measured, DT, chosen, SETTINGS):
        if step.frame >= 60:
            squares.append([step.predicted**2, chosen.position(step.state) ** 2])
    found = np.mean(squares, axis=(0, 2))
    F = np.array([[1.0, DT], [0.0, 1.0]])
    assert tuple(F[0]) == taylor(1, DT)
    H, Q = np.array([[1.0, 0.0]]), process_noise(1, DT, chosen.process_density)
    for axis, R in enumerate(deviation**2):
        prior = linalg.solve_discrete_are(F.T, H.T, Q, np.array([[R]]))
        K = prior @ H.T / (H @ prior @ H.T + R)
        posterior = linalg.solve_discrete_lyapunov((np.eye(2) - K @ H) @ F, R * K @ K.T)
        expected = [(F @ posterior @ F.T)[0, 0], posterior[0, 0]]
        # 400 objects over 60 frames: about 2 % of random error.
        np.testing.assert_allclose(found[:, axis], expected, rtol=0.08)


def test_what_was_out_of_sight_too_long_starts_anew_unless_hidden() -> None:
    """A filter whose variance grew beyond the tracker's bound is forgotten; in a gap it is kept."""
    measured = seen(3, frames=120)[:, :1]
    measured[40:90] = np.nan
    hidden = np.zeros(measured.shape[:2], dtype=np.bool_)
    hidden[40:90] = True
    chosen = estimator("ca")
    followed = {step.frame for step in steps(measured, DT, chosen, SETTINGS)}
    assert 89 not in followed
    assert set(range(40, 90)) <= {
        step.frame for step in steps(measured, DT, chosen, SETTINGS, hidden)
    }


def test_runs_are_counted_up_to_each_frame() -> None:
    """From one after each miss on, each object for itself."""
    x = np.array([[1.0, np.nan], [1.0, 1.0], [np.nan, 1.0], [1.0, 1.0], [1.0, np.nan]])
    lengths = run_lengths(np.stack([x, x], axis=-1))
    assert lengths.T.tolist() == [[1, 2, 0, 1, 2], [0, 1, 2, 3, 0]]
    assert pytest.approx(1.0) == SETTLED * DT


def test_columns_by_object_are_the_rows() -> None:
    """NaN where an object has no row; others' rows stay away."""
    trace = trace_of([(0, 4, 1.0, 2.0), (2, 4, 3.0, 4.0), (1, 7, 5.0, 6.0), (1, 5, 9.0, 9.0)], 3)
    found = by_object(trace, trace.object_id, np.array([4, 7]), "x", "y")
    nothing = [np.nan, np.nan]
    expected = [[[1, 2], nothing], [nothing, [5, 6]], [[3, 4], nothing]]
    np.testing.assert_array_equal(found, expected)
    assert distance(np.array([3.0, 4.0]), np.zeros(2)) == 5.0
