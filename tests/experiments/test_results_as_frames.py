"""Claim: scores and gaps are frames and notebook summaries of the very numbers they hold."""

import math
from pathlib import Path

import polars as pl
import pytest

import experiments
import mdkf
import sim_bridge
from experiments.gaps import Gaps
from tests.experiments.browser import Browser, needs_browser
from tests.tables import gaps_of, trace_of, tracks_of


@pytest.fixture(scope="module")
def scores(made: Path) -> experiments.Scores:
    """Of the short scenario, tracked through gaps."""
    trace = sim_bridge.read_table(made / "trace.parquet", mdkf.Trace)
    tracks = sim_bridge.read_table(made / "tracks.parquet", mdkf.Tracks)
    return experiments.score(trace, tracks)


def test_scores_are_one_row(scores: experiments.Scores) -> None:
    """The summary's names and values; null is "no value"."""
    (row,) = scores.to_polars().iter_rows(named=True)
    assert row == {k: None if math.isnan(v) else v for k, v in scores.summary().items()}
    assert row["gaps"] > 0
    empty = experiments.score(trace_of([(0, 1, 0.0, 5.0)], 1), tracks_of([], 1))
    assert empty.to_polars()["error_gap"].to_list() == [None]


def test_a_notebook_shows_scores_and_where_they_come_from(scores: experiments.Scores) -> None:
    """HTML and one line hold the numbers; what has no value is left out."""
    told = scores._repr_html_()
    assert "mid:20:35" in told
    assert "MotionDynamics" in told
    assert f"{scores.summary()['hota']:.4g}" in told
    assert "nan" not in told
    assert repr(scores).startswith(f"Scores(hota={scores.summary()['hota']:.4g}, ")
    assert len(repr(scores)) < 120


@needs_browser
@pytest.mark.parametrize("doctype", ["<!DOCTYPE html>", ""])
@pytest.mark.parametrize(("ink", "paper"), [("rgb(1, 2, 3)", "white"), ("rgb(253, 2, 3)", "#111")])
def test_a_summary_takes_the_colours_of_the_page(
    tmp_path: Path, made: Path, doctype: str, ink: str, paper: str
) -> None:
    """In light and dark themes all text has the notebook's colour, and nothing a ground of its
    own; whatever the theme does to every second row."""
    table = sim_bridge.read_table(made / "tracks.parquet", mdkf.Tracks)._repr_html_()
    theme = f"body {{ color: {ink}; background: {paper} }} tr:nth-child(even) {{ background: red }}"
    page_file = tmp_path / "page.html"
    page_file.write_text(f"{doctype}<meta charset=utf-8><style>{theme}</style>{table}")
    script = "[...document.querySelectorAll('div *')].map(e => getComputedStyle(e).{})"
    with Browser(tmp_path) as browser:
        page = browser.open(page_file)
        assert set(page.value(script.format("color"))) == {ink}
        assert set(page.value(script.format("backgroundColor"))) == {"rgba(0, 0, 0, 0)"}


def test_gaps_there_and_back() -> None:
    """A row for each gap, none of none."""
    gaps = gaps_of((4, 10, 30), (7, 12, 20))
    data = gaps.to_polars()
    assert data.equals(pl.DataFrame({"object_id": [4, 7], "start": [10, 12], "stop": [30, 20]}))
    assert Gaps.of(data.rows()).rows() == gaps.rows()
    assert gaps_of().to_polars().rows() == []
