"""Claim: every number in the paper's tables is the mean, or the paired difference, of the rows that
its line and column name, with the paper's own value beside it."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from experiments.jobs import as_rows
from experiments.paper import detector_tables, occlusion_tables, range_tables
from experiments.paper.item import Answer, Item, again
from experiments.paper.scores import RETUNED_2
from experiments.paper.tables import told_value
from experiments.studies import worlds
from experiments.studies.recorded import METRICS, Recorded
from experiments.studies.scale import QUICK
from experiments.studies.worlds import World

ITEMS: dict[str, Item] = {
    item.id: item
    for module in (detector_tables, range_tables, occlusion_tables)
    for item in module.ITEMS
}
SCENARIOS, SEEDS = ("bus_stop", "merge"), range(3)
SEQUENCES = ("val", "val-0001", "val-0006", "val-0008")
BINS = tuple(
    f"{near}, LEVEL_{level}" for near in ("0-30 m", "30-50 m", "50+ m") for level in (1, 2)
)


def made_up(*what: object) -> float:
    """A number between 0 and 100 that only these texts have."""
    return int(hashlib.sha256(repr(what).encode()).hexdigest()[:8], 16) / 2**32 * 100


def rows_of(detector: str, occlusion: str, bins: tuple[str, ...]) -> pl.DataFrame:
    """Rows as the study `worlds` has them, all different."""
    metrics = ("hota", "mota", "motp", "assa", "assre", "idf1", "idsw", "miss_rate", "drift")
    measured = [
        {"scenario": scenario, "seed": seed, "filter": name, "bin": one, "metric": metric}
        | {"value": made_up(detector, occlusion, name, one, metric, scenario, seed)}
        for scenario in SCENARIOS
        for seed in SEEDS
        for name in (*worlds.FILTERS, *RETUNED_2)
        for one in bins
        for metric in metrics
    ]
    return as_rows(measured, study="worlds", detector=detector, occlusion=occlusion)


def rows_on_recordings(detector: str, occlusion: str) -> pl.DataFrame:
    """Rows as the study `recorded` has them."""
    measured = [
        {"scenario": scenario, "filter": name, "metric": metric}
        | {"value": made_up("recorded", detector, occlusion, name, metric, scenario)}
        for scenario in SEQUENCES
        for name in worlds.FILTERS
        for metric in METRICS
    ]
    return as_rows(measured, study="recorded", detector=detector, occlusion=occlusion)


@pytest.fixture(scope="module")
def simulated_rows() -> pl.DataFrame:
    """Of all detectors and occlusions that the items need."""
    plain = [rows_of(name, "none", ("all",)) for name in detector_tables.FIVE]
    ranged = [rows_of(name, "none", ("all", *BINS)) for name in range_tables.TWO]
    hidden = [rows_of("virconv", each, ("all",)) for each in occlusion_tables.OCCLUSIONS]
    return pl.concat([*plain, *ranged, *hidden])


@pytest.fixture(scope="module")
def rows(simulated_rows: pl.DataFrame) -> pl.DataFrame:
    """With the recorded ones."""
    plain = [rows_on_recordings(name, "none") for name in ("pointrcnn", "pvrcnn", "second")]
    hidden = [rows_on_recordings("pointrcnn", each) for each in occlusion_tables.OCCLUSIONS]
    return pl.concat([simulated_rows, *plain, *hidden])


@pytest.fixture(scope="module")
def answers(rows: pl.DataFrame) -> dict[str, Answer]:
    """Every item's."""
    return {name: item.answer(rows) for name, item in ITEMS.items()}


def cell(answer: Answer, table: str, line: str, column: str) -> dict[str, Any]:
    """One cell."""
    (found,) = answer.cells.filter(table=table, line=line, column=column).to_dicts()
    return found


def mean(detector: str, occlusion: str, name: str, one: str, metric: str) -> float:
    """Over the seeds of each scenario, then over scenarios."""
    by_scenario = [
        np.mean([made_up(detector, occlusion, name, one, metric, scenario, k) for k in SEEDS])
        for scenario in SCENARIOS
    ]
    return float(np.mean(by_scenario))


@pytest.mark.parametrize(
    ("item", "place", "what", "paper"),
    [
        (
            "table-models",
            ("VirConv", "md", "MOTP"),
            ("virconv", "none", "md", "all", "motp"),
            91.74,
        ),
        (
            "table-models",
            ("VirConv", "imm-zero", "HOTA"),
            ("virconv", "none", "imm-zero", "all", "hota"),
            86.10,
        ),
        (
            "table-models",
            ("VirConv", "imm-retuned", "HOTA"),
            ("virconv", "none", "imm-retuned", "all", "hota"),
            None,
        ),
        (
            "table-derivative",
            ("3rd derivative, jerk", "cj", "IDSW"),
            ("pointrcnn", "none", "cj", "all", "idsw"),
            6.0,
        ),
        (
            "table-baseline",
            ("VirConv, acceleration", "ca", "AssRe"),
            ("virconv", "none", "ca", "all", "assre"),
            89.68,
        ),
        (
            "table-range",
            ("50+ m", "md", "AssA"),
            ("casa-waymo", "none", "md", "50+ m, LEVEL_2", "assa"),
            66.00,
        ),
        (
            "table-idsw",
            ("3rd derivative, jerk", "cj", "SECOND"),
            ("second", "none", "cj", "all", "idsw"),
            3.0,
        ),
        (
            "fig-detectors",
            ("MOTA, 2nd derivative, acceleration", "PV-RCNN", "imm"),
            ("pvrcnn", "none", "imm", "all", "mota"),
            None,
        ),
        (
            "table-occlusion",
            ("late, 20 frames", "md3", "IDF1"),
            ("virconv", "late:20", "md3", "all", "idf1"),
            87.92,
        ),
        (
            "table-occlusion",
            ("mid, 10 frames", "imm", "drift"),
            ("virconv", "mid:10", "imm", "all", "drift"),
            None,
        ),
    ],
)
def test_a_score_is_the_mean_over_scenarios_of_the_mean_over_seeds(
    answers: dict[str, Answer],
    item: str,
    place: tuple[str, str, str],
    what: tuple[str, str, str, str, str],
    paper: float | None,
) -> None:
    """Of its own detector, occlusion, filter, bin and metric, beside the paper's value."""
    found = cell(answers[item], *place)
    assert found["value"] == pytest.approx(mean(*what), rel=1e-12)
    assert found["low"] < found["value"] < found["high"]
    assert (found["n"], found["scenarios"]) == (len(SCENARIOS) * len(SEEDS), len(SCENARIOS))
    assert (found["paper"], found["source"]) == (paper, "synthetic")


@pytest.mark.parametrize(
    ("item", "place", "what", "pair", "paper"),
    [
        (
            "table-models",
            ("VirConv", "md \N{MINUS SIGN} ca", "MOTA"),
            ("virconv", "none", "all", "mota"),
            ("md", "ca"),
            0.58,
        ),
        (
            "table-derivative",
            ("3rd derivative, jerk", "md3 \N{MINUS SIGN} imm3", "AssA"),
            ("pointrcnn", "none", "all", "assa"),
            ("md3", "imm3"),
            0.18,
        ),
        (
            "table-waymo",
            ("CasA (Waymo), jerk", "50+ m: md3 \N{MINUS SIGN} cj", "miss rate, level 1"),
            ("casa-waymo", "none", "50+ m, LEVEL_1", "miss_rate"),
            ("md3", "cj"),
            -1.09,
        ),
        (
            "table-waymo",
            ("CTRL (Waymo), acceleration", "30-50 m: md \N{MINUS SIGN} ca", "MOTA, level 2"),
            ("ctrl-waymo", "none", "30-50 m, LEVEL_2", "mota"),
            ("md", "ca"),
            0.29,
        ),
        (
            "table-waymo",
            ("CTRL (Waymo), acceleration", "0-30 m: md \N{MINUS SIGN} imm", "MOTA, level 1"),
            ("ctrl-waymo", "none", "0-30 m, LEVEL_1", "mota"),
            ("md", "imm"),
            None,
        ),
        (
            "table-occlusion",
            ("mid, 20 frames", "md3 \N{MINUS SIGN} cj", "IDF1"),
            ("virconv", "mid:20", "all", "idf1"),
            ("md3", "cj"),
            1.47,
        ),
    ],
)
def test_a_gain_is_the_mean_of_paired_differences(
    answers: dict[str, Answer],
    item: str,
    place: tuple[str, str, str],
    what: tuple[str, str, str, str],
    pair: tuple[str, str],
    paper: float | None,
) -> None:
    """The first filter's less the second's on the same worlds."""
    found = cell(answers[item], *place)
    detector, occlusion, one, metric = what
    own, other = (mean(detector, occlusion, name, one, metric) for name in pair)
    assert found["value"] == pytest.approx(own - other, rel=1e-9)
    assert found["paper"] == paper
    assert json.loads(found["against"]) == {"filter": pair[1]}


def test_a_recorded_value_is_of_all_sequences_with_a_jackknife_interval(
    answers: dict[str, Answer],
) -> None:
    """Tukey's formula by hand: n - 1 over n times the sum of squares, Student's t of n - 1."""
    place = ("mid, 20 frames", "md", "IDF1 rec.")
    found = cell(answers["table-occlusion"], *place)
    overall, *without = (
        made_up("recorded", "pointrcnn", "mid:20", "md", "idf1", name) for name in SEQUENCES
    )
    error = np.sqrt(2 / 3 * np.sum((np.array(without) - np.mean(without)) ** 2))
    half = 4.302652729911275 * error  # t of 2 degrees of freedom at 97.5 %
    assert found["source"] == "recorded"
    assert found["value"] == overall
    assert (found["low"], found["high"]) == pytest.approx((overall - half, overall + half))
    switches = cell(answers["table-idsw"], "2nd derivative, acceleration", "ca", "SECOND rec.")
    assert switches["value"] == made_up("recorded", "second", "none", "ca", "idsw", "val")
    assert switches["paper"] == 1.0


@pytest.mark.parametrize("item", ITEMS)
def test_every_cell_names_the_rows_behind_it(
    answers: dict[str, Answer], rows: pl.DataFrame, item: str
) -> None:
    """From them it comes out again (of every fifth cell), and none is empty; every place is there
    once."""
    cells = answers[item].cells
    assert not cells.select("table", "line", "column").is_duplicated().any()
    assert cells["value"].null_count() == 0
    for one in cells.to_dicts()[::5]:
        assert again(rows, one).value == one["value"]


@pytest.mark.parametrize("item", ITEMS)
def test_both_mixings_of_imm_stand_in_every_table(answers: dict[str, Answer], item: str) -> None:
    """The paper does not say how its IMM mixes."""
    for (_,), cells in answers[item].cells.group_by("table"):
        told = {name for text in (*cells["line"], *cells["column"]) for name in words(text)}
        orders = {name for name in ("imm", "imm3") if name in told}
        assert orders
        assert {f"{name}-zero" for name in orders} <= told


def words(text: str) -> list[str]:
    """The filters in a heading."""
    return re.findall(r"[a-z]+3?(?:-zero)?", text)


@pytest.mark.parametrize("item", ITEMS)
def test_without_recordings_a_table_stands_without_them(
    simulated_rows: pl.DataFrame, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, item: str
) -> None:
    """No folder, no jobs and no columns of it; all others are there."""
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path))
    assert {type(job) for job in ITEMS[item].jobs(QUICK)} == {World}
    cells = ITEMS[item].answer(simulated_rows).cells
    assert set(cells["source"]) == {"synthetic"}
    assert not cells.filter(
        pl.col("line").str.contains("rec") | pl.col("column").str.contains("rec")
    ).height
    assert cells["value"].null_count() == 0


def test_differences_are_shown_with_their_sign_and_nothing_is_minus_zero() -> None:
    """Others are shown without."""
    one: dict[str, Any] = {"decimals": 2, "low": None, "high": None}
    for value, plain, signed in ((-0.001, "0.00", "+0.00"), (0.5, "0.50", "+0.50")):
        assert told_value({**one, "value": value, "against": None}) == plain
        assert told_value({**one, "value": value, "against": "{}"}) == signed
    low = {**one, "value": -0.5, "low": -0.75, "high": -0.25, "against": "{}"}
    assert told_value(low) == "-0.50 ±0.25"


def test_items_share_their_work() -> None:
    """Eleven settings with all filters make all tables, one more the other start variances; hidden
    detections are recorded of one detector."""
    wanted = [job for item in ITEMS.values() for job in item.jobs(QUICK)]
    every = {job.setting for job in wanted if isinstance(job, World)}
    settings = {one for one in every if one.filters == worlds.FILTERS}
    assert len(every - settings) == 1
    assert sum(one.occlusion == "none" for one in settings) == 7
    assert sum(one.occlusion != "none" for one in settings) == 4
    on_recordings = {job for job in wanted if isinstance(job, Recorded)}
    assert {job.detector for job in on_recordings if job.occlusion != "none"} <= {"pointrcnn"}


def test_the_picture_draws_the_gains(answers: dict[str, Answer]) -> None:
    """Each at its cell's value, in the panel of its table; recorded ones hollow."""
    (picture,) = answers["fig-detectors"].pictures
    gains = answers["fig-detectors"].cells.filter(pl.col("against").is_not_null())
    assert picture.data.equals(gains)
    figure = picture.draw()
    for axes in figure.axes:
        own = gains.filter(table=axes.get_title())
        drawn = {
            (round(float(x), 9), bool(np.allclose(points.get_facecolor()[0, :3], 1.0)))
            for points in axes.collections
            if len(points.get_offsets()) and points.get_label() is not None
            for x, _ in np.asarray(points.get_offsets()).tolist()
            if hasattr(points, "get_sizes") and len(points.get_sizes())
        }
        expected = {(round(row["value"], 9), row["source"] == "recorded") for row in own.to_dicts()}
        assert drawn == expected
