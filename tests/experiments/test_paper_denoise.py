"""Claim: fig-denoise compares detection, posterior and post-processed position with the truth."""

import io
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from experiments.alone import SETTLED
from experiments.estimates import estimate
from experiments.paper import denoise
from experiments.paper.item import again
from experiments.studies.denoise import (
    AFTER_START,
    ESTIMATES,
    READINGS,
    Denoised,
    DenoisedJourneys,
    Errors,
    OneCar,
    estimate_errors,
    recordings,
)
from experiments.studies.journeys import journeys
from mdkf import DETECTORS, MotionDynamics, filter_sequence
from mdkf.reference import filterpy_kalman
from mdkf.tables import FloatArray
from tests.sim_bridge.kitti_folder import STILL, detection, files, label, written

DETECTOR = "pointrcnn"
SETTINGS = DETECTORS[DETECTOR]
CAR = denoise.CARS[1]
NOISE = np.diag([SETTINGS.x_var, SETTINGS.y_var])


@pytest.fixture(scope="module")
def rows() -> pl.DataFrame:
    """Of one small world, two journeys and one of the cars of the figure."""
    return pl.concat(
        [
            *(Denoised(CAR, 0, name).rows() for name in denoise.DETECTORS),
            DenoisedJourneys(0, 2, DETECTOR).rows(),
            OneCar(CAR, 0, denoise.CARS_DETECTOR).rows(),
        ]
    )


def gains(frames: int) -> list[FloatArray]:
    """H K (2, 2) of a filterpy CA filter in each frame after the first: they depend on neither
    measurements nor weights, as MD's covariance is F P F' + Q."""
    oracle = filterpy_kalman(np.zeros(2), 2, 0.1)
    found = []
    for _ in range(frames):
        oracle.predict()
        oracle.update(np.zeros(2), R=NOISE)
        found.append(oracle.K[[0, 3]].copy())
    return found


@pytest.mark.parametrize("reading", ["literal", "innovation", "posterior", "raw"])
def test_the_denoised_position_is_the_papers_equation(reading: str) -> None:
    """z^ = z - H K diag(D), D the variances or the innovation, with filterpy's gain; or H x, or z
    as it is; and it is what the window holds."""
    rng = np.random.default_rng(4)
    z = np.cumsum(rng.normal(0.5, 0.3, (40, 2)), axis=0)
    md = MotionDynamics(denoise=reading)  # type: ignore[arg-type]
    state = md.start(z[:1], NOISE[None])
    np.testing.assert_array_equal(md.denoised(state)[0], z[0])
    for measured, gain in zip(z[1:], gains(39), strict=True):
        state = md.predict(state, 0.1)
        innovation = measured - md.position(state)[0]
        state = md.update(state, measured[None], NOISE[None])
        residual = {"literal": np.diag(NOISE), "innovation": innovation, "raw": np.zeros(2)}
        expected = md.position(state)[0]
        if reading != "posterior":
            expected = measured - gain @ residual[reading]
        np.testing.assert_allclose(md.denoised(state)[0], expected, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(md.denoised(state), state.window[:, -1])


def test_posteriors_are_those_of_the_compiled_pass() -> None:
    """The posterior is the literal reading's; that of the reading `posterior` is its own filter's;
    the detection's error is the noise."""
    driven = journeys(range(3), SETTINGS)
    errors = estimate_errors(driven.measured, driven.true, driven.dt, DETECTOR)
    assert tuple(errors.of) == ESTIMATES
    noise = np.linalg.norm(driven.measured - driven.true, axis=-1)
    np.testing.assert_allclose(errors.of["detection"], noise.T.ravel(), rtol=1e-12)
    for name, reading in (
        ("posterior", "literal"),
        ("post-processed (posterior)", "posterior"),
    ):
        md = MotionDynamics(denoise=reading)  # type: ignore[arg-type]
        own = filter_sequence(md, driven.measured, NOISE, driven.dt).position
        expected = np.linalg.norm(own - driven.true, axis=-1).T.ravel()
        np.testing.assert_allclose(errors.of[name], expected, rtol=1e-9)
    n_frames = len(driven.true)
    expected = np.tile(np.arange(n_frames) >= SETTLED, 3)
    np.testing.assert_array_equal(errors.settled, expected)


def test_mse_and_spread_are_of_the_errors() -> None:
    """Squares' mean and standard deviation, of all and of the settled."""
    of = {name: np.array([1.0, 3.0, 4.0]) for name in ESTIMATES}
    told = {
        (row["filter"], row["bin"], row["metric"]): row["value"]
        for row in Errors(of, np.array([False, True, True])).summary()
    }
    assert len(told) == 4 * len(ESTIMATES)
    assert told["posterior", "all", "mse"] == pytest.approx(26 / 3)
    assert told["posterior", AFTER_START, "mse"] == pytest.approx(12.5)
    assert told["posterior", AFTER_START, "spread"] == pytest.approx(0.5)


def test_the_literal_reading_is_a_shift_that_adds_to_the_error() -> None:
    """By H K diag(R), the same for every car: with white noise the mean squared error becomes the
    noise's variance and the shift's square."""
    driven = journeys(range(20), SETTINGS)
    errors = estimate_errors(driven.measured, driven.true, driven.dt, DETECTOR)
    off = driven.measured - driven.true
    shift = np.array([gain @ np.diag(NOISE) for gain in gains(len(off) - 1)])
    off[1:] -= shift[:, None]
    literal = errors.of["post-processed (literal)"]
    np.testing.assert_allclose(literal, np.linalg.norm(off, axis=-1).T.ravel(), atol=1e-9)
    variance = SETTINGS.x_var + SETTINGS.y_var
    # 7800 values, half of them as many of a variance: 1.3 % at random.
    added = shift[-1] @ shift[-1]
    assert np.mean(literal[errors.settled] ** 2) == pytest.approx(variance + added, rel=0.07)
    assert np.mean(errors.of["detection"] ** 2) == pytest.approx(variance, rel=0.07)


@pytest.fixture
def kitti(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two sequences with a standing car each, which pointrcnn always saw 0.1 m and 0.3 m off, and
    detections of a detector that nobody knows."""
    frames = 15
    for name, off in (("0003", 0.1), ("0004", 0.3)):
        labels = [label(k, 1, (3, 1.65, 20), 0.1) for k in range(frames)]
        found = [detection(k, (3 + off, 1.65, 20), 0.1, 4.0) for k in range(frames)]
        own = files(labels, found, [STILL] * frames)
        written(tmp_path, {path.replace("0003", name): lines for path, lines in own.items()})
    (tmp_path / "detections" / "mine").rename(tmp_path / "detections" / "pointrcnn")
    shutil.copytree(tmp_path / "detections" / "pointrcnn", tmp_path / "detections" / "mine")
    known = "".join(f"{name} empty 000000 {frames:06d}\n" for name in ("0003", "0004"))
    for split in ("training", "val"):
        (tmp_path / f"evaluate_tracking.seqmap.{split}").write_text(known)
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path))
    return tmp_path


def test_recordings_are_taken_together_and_one_by_one_left_out(kitti: Path) -> None:
    """MSE over both sequences, and over each without the other; the interval is the jackknife's."""
    (job,) = recordings(denoise.DETECTORS)
    rows = job.rows()
    mse = rows.filter(filter="detection", metric="mse", bin="all")
    assert dict(zip(mse["scenario"], mse["value"], strict=True)) == pytest.approx(
        {"val": 0.05, "val-0003": 0.09, "val-0004": 0.01}, rel=1e-6
    )
    found = estimate(
        rows, {"study": "recorded", "filter": "detection", "metric": "mse", "bin": "all"}
    )
    assert (found.value, found.n) == (pytest.approx(0.05), 2)
    assert found.low < 0.01 < 0.09 < found.high
    assert recordings(()) == []
    shutil.rmtree(kitti / "detections")
    assert recordings(denoise.DETECTORS) == []


def test_every_number_is_an_estimate_of_rows(rows: pl.DataFrame) -> None:
    """Whatever is shown can be had again; what nobody recorded has no tables."""
    answer = denoise.answer(rows)
    for cell in answer.cells.to_dicts():
        found = again(rows, cell)
        assert cell["n"] == found.n > 0
        assert cell["value"] == pytest.approx(found.value)
    assert not answer.cells["table"].str.contains("recorded").any()
    lines = set(answer.cells["line"])
    assert (
        lines
        == set(ESTIMATES)
        == {"detection", "posterior", *(f"post-processed ({r})" for r in READINGS)}
    )


def test_the_figures_draw_cells_and_rows(rows: pl.DataFrame) -> None:
    """The bars are the tables' numbers; each drawn car's MSE is that of its errors by frame, of
    which there are more than 300."""
    answer = denoise.answer(rows)
    of_cars, of_bars = answer.pictures
    own = of_cars.data.filter(scenario=CAR, filter="posterior")
    errors = own.filter(metric="error")["value"]
    assert len(errors) > 300
    assert own.filter(metric="mse")["value"].item() == pytest.approx((errors**2).mean())
    bar = of_bars.data.filter(part="simulated traffic", detector="second", filter="posterior")
    cells = answer.cells.filter(line="posterior", column="second")
    cells = cells.filter(pl.col("table").str.starts_with("MSE, simulated"))
    assert bar["value"].to_list() == cells["value"].to_list()
    for picture in answer.pictures:
        buffer = io.BytesIO()
        picture.draw().savefig(buffer, format="svg")
        assert b"<svg" in buffer.getvalue()
