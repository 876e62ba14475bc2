"""Claim: fig-dynamics has the errors of predictions and posteriors, by true regime, of the same
frames for every filter."""

import io
from itertools import product

import numpy as np
import polars as pl
import pytest

import scenarios
import sim_bridge
from experiments.alone import SETTLED
from experiments.estimates import chosen
from experiments.jobs import ROWS
from experiments.paper import dynamics
from experiments.paper.item import again
from experiments.studies import dynamics as study
from experiments.studies.dynamics import BINS, DETECTOR, FILTERS, METRICS, RETUNED, UNSETTLED
from experiments.studies.journeys import journeys
from experiments.studies.scale import QUICK
from mdkf import DETECTORS, estimator, filter_sequence

SETTINGS = DETECTORS[DETECTOR]


@pytest.fixture(scope="module")
def rows() -> pl.DataFrame:
    """Of three journeys and of one small world."""
    return pl.concat(
        [study.Journey(0, 3, study.DETECTOR).rows(), study.Alone("small_roundabout", 0).rows()]
    )


def test_a_frame_counts_for_its_regime_after_a_second_of_detections() -> None:
    """Not at all without a detection, or where there was none in the frame before."""
    measured = np.zeros((16, 1, 2))
    measured[13] = np.nan
    regime = np.full((16, 1), 3.0)
    place = study.bins(measured, regime)[:, 0]
    young = BINS.index(UNSETTLED)
    expected = [np.nan, *[young] * (SETTLED - 1), 3, 3, 3, np.nan, np.nan, young]
    np.testing.assert_array_equal(place, expected)


@pytest.mark.parametrize("name", ["cv", "imm", "md3"])
def test_errors_of_a_journey_are_those_of_the_compiled_pass(rows: pl.DataFrame, name: str) -> None:
    """Seed 2, by regime: `filter_sequence` gives the posteriors, one step more the predictions."""
    driven = journeys(range(2, 3), SETTINGS)
    noise = np.diag([SETTINGS.x_var, SETTINGS.y_var])
    own = filter_sequence(estimator(name), driven.measured, noise, driven.dt)
    error = np.linalg.norm(own.position - driven.true, axis=-1)[:, 0]
    regime = driven.traces[0].regime
    for code in range(4):
        mine = rows.filter(study="journey", seed=2, filter=name, metric="posterior", bin=BINS[code])
        settled = np.flatnonzero(regime == code)
        settled = settled[settled >= SETTLED]
        assert mine["n"].sum() == len(settled)
        if len(settled):
            assert mine["value"].item() == pytest.approx(error[settled].mean(), rel=1e-9)


def test_a_journey_does_not_depend_on_those_beside_it(rows: pl.DataFrame) -> None:
    """Blocks are only for speed."""
    alone = study.Journey(1, 1, study.DETECTOR).rows()
    beside = rows.filter(study="journey", seed=1)
    assert alone.equals(beside)


def test_white_noise_has_the_variances_the_filters_are_told() -> None:
    """About each seed's true path, and another for each seed."""
    driven = journeys(range(8), SETTINGS)
    off = driven.measured - driven.true
    # 3200 values: the variance of one is off by 2.5 % at random.
    variances = off.reshape(-1, 2).var(axis=0)
    np.testing.assert_allclose(variances, [SETTINGS.x_var, SETTINGS.y_var], rtol=0.12)
    assert abs(np.corrcoef(off[:, 0, 0], off[:, 1, 0])[0, 1]) < 0.25
    trace = sim_bridge.simulate(scenarios.load("journey"), 5)
    np.testing.assert_array_equal(driven.true[:, 5], np.column_stack([trace.x, trace.y]))


def test_every_filter_is_asked_about_the_same_frames(rows: pl.DataFrame) -> None:
    """As many in each bin, although filters lose their tracks at different times."""
    own = rows.filter(study="alone")
    assert set(own["filter"]) == {*FILTERS, *RETUNED}
    counts = own.group_by("bin").agg(pl.col("n").n_unique())
    assert set(counts["n"]) == {1}
    assert dict(rows.schema) == ROWS


def test_every_number_is_an_estimate_of_rows(rows: pl.DataFrame) -> None:
    """Whatever is shown can be had again, and CV's own error stands in each table of errors."""
    answer = dynamics.answer(rows)
    for cell in answer.cells.to_dicts():
        found = again(rows, cell)
        assert cell["n"] == found.n
        assert cell["value"] == pytest.approx(found.value, nan_ok=True)
    where = {"study": "alone", "filter": "cv", "metric": "predicted", "bin": BINS[1]}
    shown = answer.cells.filter(line="cv", column=BINS[1]).filter(
        pl.col("table").str.contains("simulated traffic.*prediction")
    )
    assert shown["value"].item() == pytest.approx(chosen(rows, where)["value"].item())


def test_the_figure_draws_one_journey(rows: pl.DataFrame) -> None:
    """Its data are the errors and the truth in every frame; SVG comes out."""
    (picture,) = dynamics.answer(rows).pictures
    trace = sim_bridge.simulate(scenarios.load("journey"), 0)
    speed = picture.data.filter(filter="truth", metric="speed").sort("frame")["value"]
    np.testing.assert_array_equal(speed, np.hypot(trace.vx, trace.vy))
    for name, metric in product(("cv", "ca", "cj"), METRICS):
        drawn = picture.data.filter(filter=name, metric=metric).sort("frame")
        mean = rows.filter(study="journey", seed=0, filter=name, metric=metric)
        mean = mean.filter(pl.col("bin").is_in(BINS))
        total = (mean["value"] * mean["n"]).sum()
        # The first frame has no prediction, and its posterior is the detection.
        assert drawn["value"][1:].sum() == pytest.approx(total, rel=1e-9)
    buffer = io.BytesIO()
    picture.draw().savefig(buffer, format="svg")
    text = buffer.getvalue()
    assert b"<svg" in text


def test_jobs_are_a_world_for_each_seed_and_all_journeys_once() -> None:
    """Blocks of journeys cover each seed exactly once, also where they do not fill the last."""
    for count in (1, 20, 47):
        jobs = dynamics.ITEMS[0].jobs(QUICK.with_seeds(count))
        blocks = [job for job in jobs if isinstance(job, study.Journey)]
        seeds = [k for job in blocks for k in range(job.first, job.first + job.seeds)]
        assert seeds == list(range(count))
        assert len({repr(job.key()) for job in jobs}) == len(jobs)
