"""Claim: the table of motion regimes comes from motions that are what they say, on measurements
that every filter shares, with differences paired by seed; `mdkf paper` shows and writes it."""

import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

import mdkf
from experiments.estimates import Estimate
from experiments.paper import regime_figure, regime_tables
from experiments.paper.item import Answer, again
from experiments.paper.regime_tables import NOTES, OPPONENTS, agreement, verdict
from experiments.statistics import mean_interval, mean_intervals
from experiments.studies import regimes
from experiments.studies.motions import REGIMES, Regime
from experiments.studies.regimes import (
    BY_ID,
    DRAWN,
    FILTERS,
    GAPS,
    HISTORIES,
    NOISES,
    READINGS,
    MonteCarlo,
    Noise,
    drawn,
)
from mdkf.reference import filterpy_kalman
from mdkf.tables import FloatArray
from tests.experiments.commands import Mdkf, assert_refused

SEEDS = 4
FEW = ("stopped", "stop-and-go")
HISTORY = max(HISTORIES)


@pytest.fixture(scope="module")
def rows() -> pl.DataFrame:
    """Of a small run."""
    return pl.concat(MonteCarlo(name, SEEDS).rows() for name in FEW)


@pytest.fixture(scope="module")
def answer(rows: pl.DataFrame) -> Answer:
    """Of the same rows."""
    return regime_tables.answer(rows)


def cell(answer: Answer, noise: str, history: int, gap: int, **key: str) -> dict[str, Any]:
    """The one cell of a setting with some of the columns that it is the estimate of."""
    setting = {"detector": noise, "occlusion": f"gap {gap} after {history}", **key}
    against = setting.pop("against", None)
    (found,) = (
        one
        for one in answer.cells.to_dicts()
        if setting.items() <= json.loads(one["where"]).items()
        and json.loads(one["against"] or "{}") == ({"filter": against} if against else {})
    )
    return found


def times(regime: Regime) -> FloatArray:
    """Fine times over the history, the gap and, where it has one, another period [s]."""
    return np.arange(-4.0, 2.0 + regime.period, 1e-3)


@pytest.mark.parametrize("regime", REGIMES, ids=lambda regime: regime.id)
def test_velocity_and_acceleration_are_derivatives_of_the_position(regime: Regime) -> None:
    """Central differences over 2 ms; continuous, because no step exceeds the largest slope's."""
    time = times(regime)
    truth = regime.motion.at(time)
    h = time[1] - time[0]
    slope = (truth.position[2:] - truth.position[:-2]) / (2 * h)
    np.testing.assert_allclose(truth.velocity[1:-1], slope, atol=5e-3)
    assert np.abs(np.diff(truth.position, axis=0)).max() <= 14.0 * h * 1.001
    assert np.abs(np.diff(truth.velocity, axis=0)).max() <= 4.0 * h * 1.001
    slope = (truth.velocity[2:] - truth.velocity[:-2]) / (2 * h)
    # Only where the acceleration jumps do the differences over the jump differ from it.
    wrong = np.abs(truth.acceleration[1:-1] - slope).max(axis=1) > 1e-5
    assert wrong.sum() <= 2 * len(getattr(regime.motion, "changes", ()))


def along(regime: str, *seconds: float) -> tuple[FloatArray, FloatArray]:
    """Speeds and accelerations along x at some times of a regime."""
    truth = BY_ID[regime].motion.at(np.array(seconds))
    return truth.velocity[:, 0], truth.acceleration[:, 0]


def test_every_regime_does_what_its_name_says() -> None:
    """Speeds and accelerations before the gap, as it begins and in its 20th frame (1.9 s)."""
    assert not BY_ID["stationary"].motion.at(times(BY_ID["stationary"])).position.any()
    np.testing.assert_array_equal(along("stopped", -3.6, -2.5, -1.0, 1.9)[0], [10, 6, 0, 0])
    for regime, speed in (("constant-velocity", 10.0), ("crawling", 0.7), ("turning", 10.0)):
        velocity = BY_ID[regime].motion.at(times(BY_ID[regime])).velocity
        np.testing.assert_allclose(np.hypot(*velocity.T), speed, rtol=1e-12)
    crawl = BY_ID["crawling"].motion.at(np.array([1.0])).velocity[0]
    assert crawl[0] == pytest.approx(crawl[1], rel=1e-12)
    np.testing.assert_allclose(along("acceleration-ended", -2, 0, 1.9)[0], [6, 10, 10])
    np.testing.assert_array_equal(along("acceleration-ended", -0.1, 0.0)[1], [2, 0])
    np.testing.assert_allclose(along("braking", -1.1, 0, 1.9)[0], [14, 10, 2.4])
    np.testing.assert_array_equal(along("braking", -1.1, -0.9, 1.9)[1], [0, -4, -4])
    np.testing.assert_allclose(along("accelerating", -4, 0, 1.9)[0], [2, 10, 13.8])
    heading = np.arctan2(*BY_ID["turning"].motion.at(np.array([0.0, 1.0])).velocity.T[::-1])
    np.testing.assert_allclose(heading, [0, 0.4], atol=1e-12)


def test_stop_and_go_stands_and_drives_and_begins_anywhere_in_its_cycle() -> None:
    """Standstill is exactly zero, the speed goes up to 6 m/s, one period later all is the same;
    over the seeds the gap begins in standstill as often as it takes of the cycle (2 of 9 s)."""
    regime = BY_ID["stop-and-go"]
    time = np.arange(-4.0, 2.0, 0.1)
    speed, later = (regime.motion.at(time + shift).velocity[:, 0] for shift in (0, 9))
    assert (speed[time < -2.01] == 0).all()
    assert speed.max() == pytest.approx(6.0)
    np.testing.assert_allclose(later, speed, atol=1e-12)
    truth, _ = drawn(regime, 400)
    standing = (np.diff(truth[:, HISTORY - 2 : HISTORY + 1, 0], axis=1) == 0).all(axis=1)
    assert abs(standing.mean() - 1.8 / 9) < 3 * np.sqrt(0.2 * 0.8 / 400)


def test_measurement_noise_is_white_of_the_stated_variance_and_the_seeds_own() -> None:
    """Standard normal and uncorrelated in time, between axes, seeds and regimes; more seeds
    change nothing for those before."""
    _, white = drawn(BY_ID["stationary"], 200)
    _, other = drawn(BY_ID["crawling"], 200)
    n = white.size
    assert abs(white.mean()) < 4 / np.sqrt(n)
    assert abs(white.var() - 1) < 4 * np.sqrt(2 / n)
    for a, b in (
        (white[:, 1:], white[:, :-1]),
        (white[..., 0], white[..., 1]),
        (white[1:], white[:-1]),
        (white, other),
    ):
        assert abs((a * b).mean()) < 4 / np.sqrt(a.size)
    np.testing.assert_array_equal(drawn(BY_ID["stationary"], 3)[1], white[:3])
    pointrcnn = Noise.of_detector("pointrcnn")
    assert (pointrcnn.x_var, pointrcnn.y_var) == (0.030874, 0.009379)
    assert Noise.of_deviation(0.2) == Noise("0.2 m", 0.2**2, 0.2**2)


def filterpy_errors(history: int) -> FloatArray:
    """CA's errors (seeds, gap) in stop-and-go, one track at a time on filterpy's Kalman filter."""
    noise = Noise.of_detector("pointrcnn")
    R = np.diag([noise.x_var, noise.y_var])
    truth, white = drawn(BY_ID["stop-and-go"], SEEDS)
    seen = truth[:, :HISTORY] + white * np.sqrt(np.diag(R))
    errors = np.empty((SEEDS, max(GAPS)))
    for seed in range(SEEDS):
        track = filterpy_kalman(seen[seed, HISTORY - history], 2, regimes.DT)
        for z in seen[seed, HISTORY - history + 1 :]:
            track.predict()
            track.update(z, R=R)
        for k in range(max(GAPS)):
            track.predict()
            errors[seed, k] = np.linalg.norm(track.x[[0, 3]] - truth[seed, HISTORY + k])
    return errors


@pytest.mark.parametrize("history", HISTORIES)
def test_a_cell_is_filterpys(answer: Answer, history: int) -> None:
    """CA's mean error over the gap; its interval holds all but about 2.5 % of all the means that
    a bootstrap can draw on either side (4 seeds: 256 of them)."""
    errors = filterpy_errors(history)
    for gap in GAPS:
        own = errors[:, :gap].mean(axis=1)
        key = {"scenario": "stop-and-go", "filter": "ca"}
        found = cell(answer, "pointrcnn", history, gap, **key)
        assert found["value"] == pytest.approx(own.mean(), rel=1e-9)
        assert (found["n"], found["scenarios"], found["unit"]) == (SEEDS, 1, "m")
        means = np.array([np.mean(drawing) for drawing in product(own, repeat=SEEDS)])
        for outside in (means < found["low"] - 1e-9, means > found["high"] + 1e-9):
            assert outside.mean() <= 0.035
        for beyond in (means <= found["low"] + 1e-9, means >= found["high"] - 1e-9):
            assert beyond.mean() >= 0.015


def test_the_figure_draws_filterpys_errors_in_each_frame(answer: Answer) -> None:
    """With Student's interval over seeds, of the longest history."""
    errors = filterpy_errors(HISTORY)
    (picture,) = (one for one in answer.pictures if one.name == "regimes-pointrcnn")
    own = picture.data.filter(regime="stop-and-go", filter="ca").sort("time")
    np.testing.assert_allclose(own["time"], regimes.DT * np.arange(max(GAPS)))
    expected = [mean_interval(frame) for frame in errors.T]
    for column, of in (("error", "mean"), ("low", "low"), ("high", "high")):
        np.testing.assert_allclose(own[column], [getattr(e, of) for e in expected], rtol=1e-9)
    assert set(own["seeds"]) == {SEEDS}


def test_differences_are_paired_by_seed(answer: Answer) -> None:
    """The mean of the differences of single seeds, each of its own run; MD's opponents are the
    filters of its own start."""
    truth, white = drawn(BY_ID["stopped"], SEEDS)
    noise = Noise.of_deviation(0.1)
    seen = truth[:, :HISTORY] + 0.1 * white
    by_filter = {}
    for name in ("md", "imm", "imm-zero", "md-retuned", "imm-retuned"):
        singly = [
            regimes.gap_errors(regimes.named(name), seen[[k]], truth[[k], HISTORY:], noise)[0]
            for k in range(SEEDS)
        ]
        by_filter[name] = np.mean(singly, axis=1)
    pairs = (("md", "imm"), ("md", "imm-zero"), ("md-retuned", "imm-retuned"))
    for name, against in pairs:
        own = by_filter[name] - by_filter[against]
        key = {"scenario": "stopped", "filter": name, "against": against}
        found = cell(answer, "0.1 m", 40, 20, **key)
        assert found["value"] == pytest.approx(own.mean(), rel=1e-9)
        assert own.min() - 1e-9 <= found["low"] <= found["high"] <= own.max() + 1e-9
    differences = answer.cells.drop_nulls("against").select("where", "against").unique()
    shown = {(json.loads(w)["filter"], json.loads(a)["filter"]) for w, a in differences.rows()}
    assert shown == {(f"md{start}", o + start) for start in ("", "-retuned") for o in OPPONENTS}


def test_the_same_job_gives_the_same_bytes(rows: pl.DataFrame) -> None:
    """Of every row."""
    again = pl.concat(MonteCarlo(name, SEEDS).rows() for name in FEW)
    assert again.write_ndjson() == rows.write_ndjson()


def test_more_seeds_change_no_number_of_those_before(rows: pl.DataFrame) -> None:
    """To the last bit."""
    fewer = MonteCarlo("stop-and-go", SEEDS - 2).rows()
    kept = rows.filter(pl.col("seed") < SEEDS - 2, scenario="stop-and-go")
    assert_frame_equal(fewer, kept, check_exact=True)


def test_what_decides_the_rows_is_in_the_key() -> None:
    """Other seeds and other motions have other keys, as JSON takes them."""
    jobs = [MonteCarlo(name, seeds) for name in BY_ID for seeds in (1, 2)]
    keys = {json.dumps(job.key(), sort_keys=True) for job in jobs}
    assert len(keys) == len(jobs)
    assert json.loads(json.dumps(jobs[0].key()))["regime"]["motion"]["speed"] == 0.0


def test_every_row_that_is_kept_is_shown(rows: pl.DataFrame, answer: Answer) -> None:
    """Tables and figure use all filters, noises, histories and gaps: each pair of a regime's row
    and a cell's `where` is found, and single frames are only kept of what is drawn."""
    settings = {
        (where["detector"], where["occlusion"], where["filter"], where["scenario"], where["bin"])
        for where in map(json.loads, answer.cells["where"])
        if where["scenario"] in FEW
    }
    columns = ("detector", "occlusion", "filter", "scenario", "bin")
    frames = pl.col("bin").str.starts_with("frame")
    kept = set(rows.filter(~frames).select(columns).rows())
    assert kept == settings
    assert len(kept) == len(FEW) * len(NOISES) * (len(FILTERS) * 4 + len(READINGS))
    single = rows.filter(frames)
    assert set(single["filter"]) == set(DRAWN)
    assert set(single["occlusion"]) == {"gap 20 after 40"}


def test_every_number_is_found_again_in_all_rows(rows: pl.DataFrame, answer: Answer) -> None:
    """From what the cell names, whatever else was measured; of every 25th cell."""
    other = rows.with_columns(pl.lit("another").alias("study"), pl.col("value") + 1)
    shown = answer.cells.filter(pl.col("value").is_not_null()).gather_every(25).to_dicts()
    assert len(shown) > 5
    for one in shown:
        estimate = again(pl.concat([other, rows]), one)
        assert (estimate.value, estimate.low, estimate.high) == (
            one["value"],
            one["low"],
            one["high"],
        )


def test_md_is_ca_while_its_window_is_not_full(answer: Answer) -> None:
    """The window of ten values needs eleven positions: ten frames of history do not fill it."""
    for noise, name in product(NOISES, FEW):
        key = {"scenario": name, "filter": "md", "against": "ca"}
        short = cell(answer, noise.name, 10, 20, **key)
        assert (short["value"], short["low"], short["high"]) == (0.0, 0.0, 0.0)
        assert cell(answer, noise.name, 40, 20, **key)["value"] != 0


def found(value: float, low: float, high: float) -> Estimate:
    """An estimate of four seeds."""
    return Estimate(value, low, high, n=4, scenarios=1)


def test_the_sign_is_held_against_the_notes() -> None:
    """Agrees, disagrees or not separable; nothing with a single seed."""
    below, above = NOTES["stationary"], NOTES["braking"]
    assert (below.difference, above.difference) == (-0.10, 0.62)
    assert agreement(found(-0.2, -0.3, -0.1), below) == "agrees"
    assert agreement(found(-0.2, -0.3, -0.1), above) == "disagrees"
    assert agreement(found(-0.2, -0.3, 0.1), below) == "not separable"
    assert agreement(found(-0.2, np.nan, np.nan), below) is None
    assert NOTES.keys() == BY_ID.keys()


def test_the_verdict_tells_where_the_sign_is_not_the_notes() -> None:
    """By name, with the notes' value."""
    differences = {
        "stationary": found(-0.2, -0.3, -0.1),
        "braking": found(-0.2, -0.3, -0.1),
        "turning": found(-0.2, -0.3, 0.1),
    }
    assert verdict(differences) == (
        "md − imm has the sign of the project's notes in 1 of 3 regimes; not in braking (notes"
        " +0.62 ±0.02 m: disagrees), turning (notes +1.09 ±0.01 m: not separable)."
    )


def test_notes_stand_beside_what_they_speak_of(answer: Answer) -> None:
    """In words below tables of 40 frames of history, in no column of the paper's."""
    assert answer.cells["paper"].null_count() == answer.cells.height
    after = {table: text for table, text in answer.captions.items() if "notes" in text}
    assert all("40 frames of history" in table for table in after)
    assert len(after) == 2 * (len(GAPS) + 1)
    (errors,) = (t for name, t in after.items() if "error: noise 0.1 m" in name and "20" in name)
    assert "md 0.12 0.13 0.18 0.61 2.66 4.86 2.50 3.56 0.36" in errors


@pytest.mark.parametrize("n", [2, 5, 40])
def test_many_intervals_at_once_are_the_single_ones(n: int) -> None:
    """Column by column."""
    values = np.random.default_rng(n).normal(2.0, 3.0, (n, 7))
    found = np.stack(mean_intervals(values), axis=1)
    single = [mean_interval(column) for column in values.T]
    np.testing.assert_allclose(found, [(i.mean, i.low, i.high) for i in single], rtol=1e-12)


def test_one_seed_is_shown_in_120_columns_without_intervals(
    mdkf_command: Mdkf, tmp_path: Path
) -> None:
    """Every filter by name, units, a verdict on nothing for each noise, and two pictures."""
    out = tmp_path / "out"
    shown = mdkf_command("paper", "regimes", "--seeds", 1, "--workers", 1, "--out", out)
    assert shown.status == 0, shown.err
    assert max(map(len, shown.out.splitlines())) <= 120
    for word in (*FILTERS, *READINGS, "[m]", "noise 0.1 m", "noise pointrcnn"):
        assert word in shown.out
    assert shown.out.count("has the sign of the project's notes in 0 of 9") == len(NOISES)
    assert "too few seeds" in shown.out
    assert "it is still CA" in shown.out
    assert "nan" not in shown.out
    assert "±0.00" not in shown.out
    cells = pl.read_parquet(out / "results.parquet")
    assert cells["value"].null_count() == 0
    assert cells.select("low", "high").null_count().row(0) == (cells.height, cells.height)
    for noise in ("pointrcnn", "0.1-m"):
        picture = out / "figures" / f"regimes-{noise}.png"
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_picture_has_a_panel_for_each_regime(answer: Answer) -> None:
    """With the filters of the question, and units on the axes."""
    assert [picture.name for picture in answer.pictures] == ["regimes-pointrcnn", "regimes-0.1-m"]
    for picture in answer.pictures:
        panels = [axes for axes in picture.draw().axes if axes.get_title()]
        assert [axes.get_title() for axes in panels] == [BY_ID[name].title for name in FEW]
        for axes in panels:
            assert [line.get_label() for line in axes.lines] == ["ca", "imm", "imm-zero", "md"]
            assert axes.get_xlabel() == "time since the gap began [s]"
        assert panels[0].get_ylabel() == "mean position error [m]"


def test_the_picture_of_one_seed_has_no_bands() -> None:
    """Lines all the same."""
    one = MonteCarlo("stopped", 1).rows()
    data = regime_figure.data(one, "pointrcnn")
    assert data["low"].null_count() == data.height
    panel = regime_figure.figure(data).axes[0]
    assert len(panel.lines) == len(DRAWN)
    assert not panel.collections


def test_the_item_is_listed(mdkf_command: Mdkf) -> None:
    """With the question and its place, without work."""
    listed = json.loads(mdkf_command("paper", "regimes", "--list", "--json").out)["rows"]
    (row,) = listed
    assert row["id"] == "regimes"
    assert row["question"].endswith("?")
    assert "Occlusion" in row["place"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("regime",), ("'regime'", "did you mean 'regimes'?")),
        (("table9", "--list"), ("'table9'", "known items: ", "regimes")),
        (("--seeds", "0"), ("--seeds",)),
    ],
)
def test_bad_choices_are_answered_with_one_line(
    mdkf_command: Mdkf, tmp_path: Path, arguments: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    """Status 2, nothing written, before any work."""
    answer = mdkf_command("paper", *arguments, "--out", "out")
    assert_refused(answer, tmp_path, *parts)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_a_file_is_bad_input(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """Told before the work."""
    (tmp_path / "taken").write_text("")
    answer = mdkf_command("paper", "regimes", "--seeds", 2, "--out", "taken")
    assert answer.status == 2
    assert "taken" in answer.err
    assert answer.err.count("\n") == 1


def test_every_variant_is_an_estimator_with_a_name_of_its_own() -> None:
    """The registry's names are not taken."""
    assert not regimes.VARIANTS.keys() & mdkf.ESTIMATORS.keys()
    for name in (*FILTERS, *READINGS):
        assert isinstance(regimes.named(name), mdkf.Estimator)
