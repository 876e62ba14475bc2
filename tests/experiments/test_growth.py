"""Claim: errors grow in the gaps as they should, and a curve tells how, by the time without a
detection."""

from collections.abc import Sequence

import numpy as np
import polars as pl
import pytest
from rich.console import Console

import scenarios
import sim_bridge
from experiments.growth import CURVE, GROWTH, growth, growth_curve, growth_figure, growth_table
from experiments.occlusion import OcclusionProtocol
from experiments.world import Followed, follow
from mdkf import DETECTORS, Detections, Trace, estimator
from mdkf.reference import filterpy_kalman

SETTINGS = DETECTORS["pointrcnn"]
LENGTHS = (0, 5, 10, 20, 30)
WARMUP = 40


def exactly_detected(trace: Trace) -> Detections:
    """Every object in every frame, without noise."""
    names = ("frame", "x", "y", "z", "yaw", "length", "width", "height")
    columns = {name: getattr(trace, name) for name in names}
    columns |= {"source": trace.object_id, "score": np.full(len(trace), 10.0)}
    return Detections.from_columns(columns, n_frames=trace.n_frames, dt=trace.dt)


def followed(trace: Trace, name: str, occlusion: str) -> Followed:
    protocol = OcclusionProtocol.parse(occlusion)
    occluded = protocol.apply(exactly_detected(trace), trace)
    return follow(trace, occluded, estimator(name), SETTINGS, protocol)


def swept(trace: Trace, name: str, lengths: Sequence[int] = LENGTHS) -> pl.DataFrame:
    """Rows of one filter with gaps of all lengths."""
    parts = []
    for length in lengths:
        occlusion = f"mid:{length}:{WARMUP}"
        own = growth(followed(trace, name, occlusion).errors)
        which = {"scenario": "by hand", "seed": 0, "filter": name, "occlusion": occlusion}
        labels = {**which, "length": length}
        parts.append(own.with_columns(pl.lit(value).alias(key) for key, value in labels.items()))
    return pl.concat(parts)


@pytest.fixture(scope="module")
def speeding_up() -> Trace:
    return sim_bridge.simulate(scenarios.load("constant_acceleration", acceleration=2.0), 0)


# One run


def test_a_filter_without_acceleration_falls_behind_by_half_a_t_squared(speeding_up: Trace) -> None:
    """From the last estimate, filterpy's, on: its error there, that of its speed times t, and half
    of 2 m/s² times t²."""
    rows = growth(followed(speeding_up, "cv", f"mid:20:{WARMUP}").errors)
    oracle, x = None, speeding_up.x
    first = 40  # 80 frames, 20 of them hidden: 30 before, but for the warm-up
    for k in range(first):
        z = np.array([x[k], speeding_up.y[k]])
        if oracle is None:
            oracle = filterpy_kalman(z, 1, speeding_up.dt)
        else:
            oracle.predict()
            oracle.update(z, R=np.diag([SETTINGS.x_var, SETTINGS.y_var]))
    assert oracle is not None
    behind, slower = x[first - 1] - oracle.x[0], speeding_up.vx[first - 1] - oracle.x[1]
    t = speeding_up.dt * np.arange(21)
    assert rows["offset"].to_list() == list(range(-1, 20))
    np.testing.assert_allclose(rows["drift"], behind + slower * t + 2.0 * t**2 / 2, rtol=1e-9)
    assert rows["regime"].unique().to_list() == ["constant_acceleration"]
    assert rows["gaps"].unique().to_list() == [1]


def test_a_filter_that_knows_the_speed_stays() -> None:
    """At constant velocity and without noise: within a millimetre for four seconds."""
    trace = sim_bridge.simulate(scenarios.load("constant_velocity"), 0)
    rows = growth(followed(trace, "cv", "mid:40:50").errors)
    assert len(rows) == 41
    assert rows["drift"].max() < 1e-3  # type: ignore[operator]


def test_rows_are_means_over_the_gaps_that_begin_in_a_regime() -> None:
    """By hand: two gaps of two regimes, one with an error past the protocol's length, frames
    before and after, and one that the filter does not know."""
    gaps = [
        (
            "stationary",
            [(-2, "before", 9.0), (-1, "before", 0.1), (0, "gap", 0.2), (1, "gap", 0.6)],
        ),
        ("stationary", [(-1, "before", 0.3), (0, "gap", 0.4), (1, "gap", None), (2, "after", 7.0)]),
        ("constant_velocity", [(-1, "before", 0.5), (0, "after", 8.0)]),  # empty
    ]
    frame = pl.DataFrame(
        [(regime, *row) for regime, rows in gaps for row in rows],
        ["regime", "offset", "phase", "drift"],
        orient="row",
    )
    found = growth(frame)
    assert dict(found.schema) == GROWTH
    assert found.rows() == [
        ("constant_velocity", -1, 0.5, 1),
        ("stationary", -1, pytest.approx(0.2), 2),
        ("stationary", 0, pytest.approx(0.3), 2),
        ("stationary", 1, 0.6, 1),
    ]


def test_a_run_without_gaps_has_no_growth(speeding_up: Trace) -> None:
    """With the same columns all the same."""
    rows = growth(followed(speeding_up, "cv", "none").errors)
    assert rows.is_empty()
    assert dict(rows.schema) == GROWTH


# Curves


def test_ends_of_gaps_lie_on_one_parabola(speeding_up: Trace) -> None:
    """Each length is a run of its own; a filter that lags steadily is as far behind after as long,
    wherever the gap begins. The first is the error of the last estimate."""
    rows = swept(speeding_up, "cv", (0, 10, 20, 30))
    curve = growth_curve(rows).filter(regime="all")
    assert curve["length"].to_list() == [0, 10, 20, 30]
    ends = curve["error"].to_numpy()
    np.testing.assert_allclose(np.diff(ends, 2), 2.0 * 1.0**2, rtol=1e-3)
    within = growth_curve(rows, within=True).filter(regime="all")
    assert within["length"].to_list() == list(range(31))
    np.testing.assert_allclose(np.diff(within["error"], 2), 2.0 * 0.1**2, rtol=1e-9)
    assert within["error"][30] == ends[-1]


RATES = {("slow", 0): 1.0, ("slow", 1): 3.0, ("fast", 0): 10.0}
"""Growth per frame [m] of a scenario's seed, by hand."""


def by_hand(
    occlusion: str, length: int, lasting: int, counts: Sequence[int] = (1,)
) -> pl.DataFrame:
    """Rows of the filters `a`, whose drift is the rate times the frames, and `b`, twice as far off,
    in a regime each of standing and of driving, where it is ten times as large. counts: of gaps,
    in turn."""
    rows = [
        (scenario, seed, name, occlusion, length, regime, offset, factor * rate * (offset + 1), n)
        for ((scenario, seed), rate), n in zip(RATES.items(), [*counts] * 3, strict=False)
        for name, times in (("a", 1.0), ("b", 2.0))
        for regime, factor in (("stationary", times), ("constant_velocity", 10.0 * times))
        for offset in range(-1, lasting)
    ]
    columns = ["scenario", "seed", "filter", "occlusion", "length", *GROWTH]
    return pl.DataFrame(rows, columns, orient="row")


def test_scenarios_count_alike_whatever_their_seeds_and_gaps() -> None:
    """Standing, after 4 frames: (4 and 12) and 40, so 24; `b` twice; driving ten times."""
    curve = growth_curve(by_hand("mid:4:9", 4, 4, counts=(7, 1, 2)))
    assert dict(curve.schema) == CURVE
    assert set(curve["length"]) == {4}
    told = {(row["filter"], row["regime"]): row for row in curve.to_dicts()}
    assert list(told) == [(f, r) for r in ("all", "stationary", "constant_velocity") for f in "ab"]
    standing = told["a", "stationary"]
    assert (standing["error"], standing["gaps"]) == (pytest.approx(24.0), 10)
    assert (standing["seeds"], standing["scenarios"], standing["protocol"]) == (3, 2, "mid:*:9")
    assert told["b", "stationary"]["error"] == pytest.approx(48.0)
    assert told["a", "constant_velocity"]["error"] == pytest.approx(240.0)
    assert told["a", "all"]["error"] == pytest.approx((24.0 + 240.0) / 2)
    assert told["a", "all"]["gaps"] == 20
    assert 4.0 <= standing["low"] < 24.0 < standing["high"] <= 40.0
    # The same draws: twice as far off has twice the interval.
    assert told["b", "stationary"]["high"] == pytest.approx(2 * standing["high"])


def test_a_single_seed_has_no_interval() -> None:
    """It is null, and neither zero nor NaN."""
    rows = by_hand("mid:4:9", 4, 4).filter(scenario="fast")
    assert growth_curve(rows).select("low", "high").null_count().row(0) == (6, 6)


def test_all_gaps_weigh_alike_in_a_seed() -> None:
    """Of all regimes together: three standing gaps of 1 m and one driving of 9 m are 3 m."""
    rows = by_hand("mid:1:9", 1, 1).filter(scenario="slow", seed=0, filter="a", offset=0)
    rows = rows.with_columns(drift=pl.Series([1.0, 9.0]), gaps=pl.Series([3, 1]))
    assert growth_curve(rows).filter(regime="all")["error"].to_list() == [3.0]


def test_lengths_of_a_protocol_are_one_curve_and_warm_ups_are_two() -> None:
    """However they are written."""
    texts = (("mid:5:9", 5), ("mid:2:9:gaps=1", 2), ("mid:5:8", 5), ("mid:5:9:gaps=3", 5))
    curve = growth_curve(pl.concat([by_hand(text, n, n) for text, n in texts]))
    lengths = curve.group_by("protocol", maintain_order=True).agg(pl.col("length").unique().sort())
    assert dict(lengths.rows()) == {"mid:*:9": [2, 5], "mid:*:8": [5], "mid:*:9:gaps=3": [5]}


def test_natural_occlusions_are_told_at_the_lengths_of_the_others() -> None:
    """They last as long as they do; alone, every frame is told."""
    natural = by_hand("natural:30:9", 30, 12)
    others = pl.concat([by_hand(f"mid:{n}:9", n, n) for n in (0, 5, 10, 20)])
    curve = growth_curve(pl.concat([natural, others]))
    by_protocol = curve.group_by("protocol").agg(pl.col("length").unique().sort())
    assert dict(by_protocol.rows()) == {"natural:*:9": [0, 5, 10], "mid:*:9": [0, 5, 10, 20]}
    same = {"filter": "a", "regime": "stationary", "length": 10}
    assert curve.filter(protocol="natural:*:9", **same)["error"].item() == pytest.approx(60.0)
    assert growth_curve(natural)["length"].unique().sort().to_list() == list(range(13))


def test_no_rows_are_no_curve() -> None:
    """Neither is there a picture; the table is empty."""
    curve = growth_curve(by_hand("mid:4:9", 4, 4).clear())
    assert dict(curve.schema) == CURVE
    assert curve.is_empty()
    assert growth_figure(curve, 0.1) is None
    assert list(growth_table(curve).renderables) == []


# Pictures and tables


@pytest.fixture(scope="module")
def curve() -> pl.DataFrame:
    """Two protocols and two regimes; at 20 frames one seed alone is left."""
    lone = pl.col("length").ne(20) | (pl.col("scenario") == "fast")
    rows = pl.concat(
        [by_hand(f"{kind}:{n}:9", n, n) for kind in ("mid", "late") for n in (0, 5, 20)]
    )
    return growth_curve(rows.filter(lone))


def test_the_picture_draws_the_curve(curve: pl.DataFrame) -> None:
    """A row of panels for each protocol, a column for each regime: each line's points are the
    means, with time in seconds, and its band the interval; a mean of one seed has none and is not
    drawn. Each panel says how many gaps it is of."""
    figure = growth_figure(curve, 0.1)
    assert figure is not None
    panels = [
        (protocol, regime)
        for protocol in ("mid:*:9", "late:*:9")
        for regime in ("all", "stationary", "constant_velocity")
    ]
    assert len(figure.axes) == len(panels)
    for axes, (protocol, regime) in zip(figure.axes, panels, strict=True):
        own = curve.filter(pl.col("length") < 20, protocol=protocol, regime=regime)
        assert len(axes.get_lines()) == len(axes.collections) == 2
        for line, band in zip(axes.get_lines(), axes.collections, strict=True):
            one = own.filter(filter=line.get_label())
            np.testing.assert_allclose(line.get_xdata(), one["length"] * 0.1)
            np.testing.assert_allclose(line.get_ydata(), one["error"])
            (outline,) = band.get_paths()
            assert outline.vertices[:, 1].max() == pytest.approx(one["high"].max())
        gaps = own.filter(length=5)["gaps"][0]
        assert axes.get_title() == f"{regime.replace('_', ' ')}\n{gaps} gaps"
        assert axes.get_ylim()[0] == 0.0
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["a", "b"]


def test_the_table_shows_every_mean_and_its_interval(curve: pl.DataFrame) -> None:
    """As the curve has them, by protocol."""
    console = Console(width=140)
    with console.capture() as shown:
        console.print(growth_table(curve))
    text = shown.get()
    for row in curve.to_dicts():
        decimals = 2 if row["error"] < 10 else 1
        cell = f"{row['error']:.{decimals}f}"
        if row["low"] is not None:
            cell += f" ±{(row['high'] - row['low']) / 2:.{decimals}f}"
        assert cell in text
    assert "mid, warm-up 9" in text
    assert "late, warm-up 9" in text
    assert "drift [m]" in text
