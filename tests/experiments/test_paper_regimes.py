"""Claim: the table of motion regimes comes from motions that are what they say, on measurements
that every filter shares, with differences paired by seed; `mdkf paper` shows and writes it."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

import mdkf
from experiments.paper import regimes
from experiments.paper.motions import REGIMES, Regime
from experiments.paper.regime_figure import figure
from experiments.paper.regimes import GAPS, HISTORIES, NOTES, Noise, Plan, Results, agreement, drawn
from experiments.statistics import mean_interval, mean_intervals
from mdkf.reference import filterpy_kalman
from mdkf.tables import FloatArray
from tests.experiments.commands import Mdkf, assert_refused

BY_ID = {regime.id: regime for regime in REGIMES}
SEEDS = 4
FILTERS = ("ca", "imm", "md", "md-joint", "md-retuned", "ca-retuned")
FEW = Plan(seeds=SEEDS, filters=FILTERS, regimes=(BY_ID["stopped"], BY_ID["stop-and-go"]))
HISTORY = max(HISTORIES)


@pytest.fixture(scope="module")
def few() -> Results:
    """A small run."""
    return regimes.run(FEW)


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
    pointrcnn = Noise.parse("pointrcnn")
    assert (pointrcnn.x_var, pointrcnn.y_var) == (0.030874, 0.009379)
    assert Noise.parse("0.2") == Noise("0.2", 0.2**2, 0.2**2)


def test_a_cell_is_filterpys(few: Results) -> None:
    """CA's mean error over the gap, one track at a time on filterpy's Kalman filter."""
    noise = Noise.parse("pointrcnn")
    R = np.diag([noise.x_var, noise.y_var])
    truth, white = drawn(BY_ID["stop-and-go"], SEEDS)
    seen = truth[:, :HISTORY] + white * np.sqrt(np.diag(R))
    for history in HISTORIES:
        errors = np.empty((SEEDS, max(GAPS)))
        for seed in range(SEEDS):
            track = filterpy_kalman(seen[seed, HISTORY - history], 2, regimes.DT)
            for z in seen[seed, HISTORY - history + 1 :]:
                track.predict()
                track.update(z, R=R)
            for k in range(max(GAPS)):
                track.predict()
                errors[seed, k] = np.linalg.norm(track.x[[0, 3]] - truth[seed, HISTORY + k])
        for gap in GAPS:
            key = {"regime": "stop-and-go", "noise": "pointrcnn", "history": history, "gap": gap}
            (row,) = few.rows.filter(**key, filter="ca").to_dicts()
            expected = mean_interval(errors[:, :gap].mean(axis=1))
            assert row["error"] == pytest.approx(expected.mean, rel=1e-9)
            assert row["low"] == pytest.approx(expected.low, rel=1e-9)
            assert row["high"] == pytest.approx(expected.high, rel=1e-9)
            assert row["seeds"] == SEEDS
        own = {**key, "filter": "ca"}
        del own["gap"]
        drift = few.over_time.filter(**own)["error"].to_numpy()
        np.testing.assert_allclose(drift, errors.mean(axis=0), rtol=1e-9)


def test_differences_are_paired_by_seed(few: Results) -> None:
    """Mean and interval of the differences of single seeds, each of its own run; MD's opponents
    are the filters of its own start."""
    truth, white = drawn(BY_ID["stopped"], SEEDS)
    noise = Noise.parse("0.1")
    seen = truth[:, :HISTORY] + 0.1 * white
    by_filter = {}
    for name in ("md", "imm", "md-joint"):
        singly = [
            regimes.gap_errors(regimes.named(name), seen[[k]], truth[[k], HISTORY:], noise)[0]
            for k in range(SEEDS)
        ]
        by_filter[name] = np.mean(singly, axis=1)
    own = few.differences.filter(regime="stopped", noise="0.1", history=40, gap=20)
    for against in ("imm", "md-joint"):
        expected = mean_interval(by_filter["md"] - by_filter[against])
        (row,) = own.filter(filter="md", against=against).to_dicts()
        found = (row["difference"], row["low"], row["high"])
        np.testing.assert_allclose(found, (expected.mean, expected.low, expected.high), rtol=1e-9)
    assert own.select("filter", "against").rows() == [
        *(("md", name) for name in ("ca", "imm", "md-joint")),
        ("md-retuned", "ca-retuned"),
    ]


def test_the_same_plan_gives_the_same_bytes(few: Results) -> None:
    """Of every table."""
    again = regimes.run(FEW)
    for name in ("rows", "differences", "over_time"):
        frames = (getattr(few, name), getattr(again, name))
        assert frames[0].write_ndjson() == frames[1].write_ndjson()


def test_leaving_out_a_filter_a_noise_or_a_regime_changes_no_other_number(few: Results) -> None:
    """To the last bit."""
    plan = Plan(SEEDS, (Noise.parse("0.1"),), ("ca", "md"), (BY_ID["stop-and-go"],))
    less = regimes.run(plan)
    kept = {"noise": "0.1", "regime": "stop-and-go"}
    named = pl.col("filter").is_in(plan.filters)
    assert_frame_equal(less.rows, few.rows.filter(named, **kept), check_exact=True)
    against = few.differences.filter(filter="md", against="ca", **kept)
    assert_frame_equal(less.differences, against, check_exact=True)


def test_md_is_ca_while_its_window_is_not_full(few: Results) -> None:
    """The window of ten values needs eleven positions: ten frames of history do not fill it."""
    short = few.differences.filter(filter="md", against="ca", history=10)
    assert short["difference"].to_list() == [0.0] * short.height
    long = few.differences.filter(filter="md", against="ca", history=40)
    assert (long["difference"] != 0).all()


def test_the_sign_is_held_against_the_notes() -> None:
    """Agrees, disagrees or not separable, where the notes have a value."""
    base = {"notes": -0.5, "difference": -0.2, "low": -0.3, "high": -0.1}
    assert agreement(base) == "agrees"
    assert agreement({**base, "notes": 0.5}) == "disagrees"
    assert agreement({**base, "high": 0.1}) == "not separable"
    assert agreement({**base, "notes": None}) is None
    assert agreement({**base, "low": None, "high": None}) is None
    assert NOTES.keys() == BY_ID.keys()


def test_notes_stand_beside_what_they_speak_of(few: Results) -> None:
    """MD minus unbiased IMM over 20 frames after 40 of history; CA, zero IMM and MD there."""
    noted = few.differences.drop_nulls("notes")
    columns = ("filter", "against", "history", "gap")
    assert set(noted.select(columns).rows()) == {("md", "imm", 40, 20)}
    assert set(noted["notes"]) == {-0.28, -0.52}
    assert noted["sign"].null_count() == 0
    cell = few.rows.filter(regime="stopped", noise="0.1", history=40, gap=20)
    assert dict(cell.select("filter", "notes").drop_nulls().rows()) == {"ca": 3.25, "md": 0.13}


@pytest.mark.parametrize("n", [2, 5, 40])
def test_many_intervals_at_once_are_the_single_ones(n: int) -> None:
    """Column by column."""
    values = np.random.default_rng(n).normal(2.0, 3.0, (n, 7))
    found = np.stack(mean_intervals(values), axis=1)
    single = [mean_interval(column) for column in values.T]
    np.testing.assert_allclose(found, [(i.mean, i.low, i.high) for i in single], rtol=1e-12)


def test_one_seed_has_no_intervals_and_is_shown_all_the_same(mdkf_command: Mdkf) -> None:
    """Null in JSON, no interval in the tables, a verdict on nothing."""
    options = ("paper", "regimes", "--seeds", 1, "--filters", "ca,imm,md", "--noise", "0.1")
    (item,) = json.loads(mdkf_command(*options, "--json").out)["items"]
    for row in (*item["rows"], *item["differences"]):
        assert row["low"] is None
        assert row["high"] is None
    shown = mdkf_command(*options)
    assert shown.status == 0
    assert "too few seeds" in shown.out
    assert "nan" not in shown.out


def test_json_is_one_document_and_equals_the_files(mdkf_command: Mdkf, tmp_path: Path) -> None:
    """Every cell, every difference; the picture is there; noise by name and by number, in one
    option or in several."""
    noise = ("--noise", "pointrcnn,0.1", "--noise", "0.05")
    options = ("--seeds", SEEDS, *noise, "--filters", "ca,imm,md")
    answer = mdkf_command("paper", "regimes", *options, "--out", "deep/out", "--json")
    assert (answer.status, answer.err) == (0, "")
    (item,) = json.loads(answer.out)["items"]
    out = tmp_path / "deep" / "out"
    assert item["id"] == "regimes"
    assert item["rows"] == pl.read_parquet(out / "regimes.parquet").to_dicts()
    paired = pl.read_parquet(out / "regimes-differences.parquet")
    assert item["differences"] == paired.to_dicts()
    assert len(item["rows"]) == len(REGIMES) * 3 * len(HISTORIES) * len(GAPS) * 3
    assert (out / "regimes.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(out.iterdir())) == 3


def test_tables_fit_120_columns_and_say_where_the_sign_differs(mdkf_command: Mdkf) -> None:
    """All default filters by name, units, and a sentence for each noise."""
    answer = mdkf_command("paper", "--seeds", 2, "--noise", "0.1")
    assert answer.status == 0
    assert max(map(len, answer.out.splitlines())) <= 120
    for word in (*regimes.FILTERS, *BY_ID, "[m]", "noise 0.1 m: the notes' sign in"):
        assert word in answer.out
    assert "identical" in answer.out


def test_the_picture_has_a_panel_for_each_regime_and_noise(few: Results) -> None:
    """With the filters of the question, and units on the axes."""
    parts = figure(few).subfigs
    assert len(parts) == 2
    for part in parts:
        panels = [axes for axes in part.axes if axes.get_title()]
        assert [axes.get_title() for axes in panels] == [regime.title for regime in FEW.regimes]
        for axes in panels:
            assert [line.get_label() for line in axes.lines] == ["ca", "imm", "md"]
            assert axes.get_xlabel() == "time since the gap began [s]"
        assert panels[0].get_ylabel() == "mean position error [m]"


def test_items_are_listed(mdkf_command: Mdkf) -> None:
    """With the question and its place, without work."""
    answer = mdkf_command("paper", "--list")
    assert answer.status == 0
    assert "regimes" in answer.out
    (row,) = json.loads(mdkf_command("paper", "--list", "--json").out)["rows"]
    assert row["id"] == "regimes"
    assert row["question"].endswith("?")
    assert "Occlusion" in row["where"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("regime",), ("'regime'", "did you mean 'regimes'?")),
        (("table9", "--list"), ("'table9'", "known items: regimes")),
        (("--filters", "ca,mdd"), ("'mdd'", "did you mean 'md'?", "md-joint", "md-window5")),
        (("--filters", ""), ("filter ''",)),
        (("--noise", "pointrcn"), ("'pointrcn'", "pvrcnn")),
        (("--noise", "0.1,-1"), ("'-1'", "above 0 m")),
        (("--noise", "nan"), ("'nan'",)),
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
    answer = mdkf_command("paper", "--seeds", 2, "--out", "taken")
    assert answer.status == 2
    assert "taken" in answer.err
    assert answer.err.count("\n") == 1


def test_every_variant_is_an_estimator_with_a_name_of_its_own() -> None:
    """The registry's names are not taken."""
    assert not regimes.VARIANTS.keys() & mdkf.ESTIMATORS.keys()
    for name in regimes.FILTERS:
        assert isinstance(regimes.named(name), mdkf.Estimator)
