"""Claim: every table draws itself in one call, at the right places, whatever it holds."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy.stats import chi2

import experiments
import mdkf
import scenarios
import sim_bridge
from experiments.plots import Picture, birds_eye, error_over_time, weights_over_time
from mdkf.tables import REGIMES, TableError, Trace, Tracks
from tests.tables import random_detections, random_trace, random_tracks, trace_of, tracks_of

FRAMES = 60


def straight(n_frames: int = FRAMES, **columns: Any) -> Trace:
    """Car 7 at 1 m a frame along x, 10 m beside a standing sensor."""
    return trace_of([(k, 7, float(k), 10.0) for k in range(n_frames)], n_frames, **columns)


def off_by(error: float, gap: tuple[int, int] | None = None, drift: float = 0.0) -> Tracks:
    """Track 3 beside car 7 by `error` [m], and by `drift` more with every frame of a gap."""
    rows, provenance = [], {}
    for k in range(FRAMES):
        more = 0.0 if gap is None or not gap[0] <= k < gap[1] else drift * (k - gap[0] + 1)
        rows.append((k, 3, float(k), 10.0 + error + more))
    if gap is not None:
        told = {"protocol": "mid:20:35", "gaps": [[7, *gap]]}
        provenance = {"occlusion": json.dumps(told)}
    coasted = [gap is not None and gap[0] <= k < gap[1] for k in range(FRAMES)]
    return tracks_of(rows, FRAMES, coasted, provenance)


def weighted(tracks: Tracks, **columns: Any) -> Tracks:
    """The same tracks with diagnostics."""
    return replace(tracks, diagnostics={k: np.asarray(v, dtype=float) for k, v in columns.items()})


def assert_drawn(figure: Figure, least: float = 0.02) -> None:
    """It becomes a PNG that is not blank, and every axis with ticks says what it is."""
    pixels = imread(io.BytesIO(png := figure._repr_png_()))[..., :3]  # type: ignore[attr-defined]
    assert png.startswith(b"\x89PNG")
    assert pixels.std() > least
    for axes in figure.axes:
        assert axes.get_ylabel()
    assert figure.axes[-1].get_xlabel() in ("x [m]", "time [s]")


def lines(figure: Figure) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """What is plotted in the first panel, by label."""
    found = {str(line.get_label()): line.get_data() for line in figure.axes[0].get_lines()}
    return {name: (np.asarray(x), np.asarray(y)) for name, (x, y) in found.items()}


def test_an_objects_error_is_its_distance() -> None:
    """By name of the filter and in seconds; the strip below shows the true regimes."""
    regime = [REGIMES.index("constant_velocity")] * 25 + [REGIMES.index("stationary")] * 35
    trace = straight(regime=regime)
    figure = error_over_time(trace, {"near": off_by(0.25), "far": off_by(-1.5)}, 7)
    for name, error in (("near", 0.25), ("far", 1.5)):
        time, drawn = lines(figure)[name]
        np.testing.assert_allclose(time, 0.1 * np.arange(FRAMES))
        np.testing.assert_allclose(drawn, error)
    strip = {c.get_label(): c.get_paths()[0] for c in figure.axes[1].collections}
    extents = {name: path.get_extents().intervalx for name, path in strip.items()}
    np.testing.assert_allclose(extents["constant velocity"], [-0.05, 2.45])
    np.testing.assert_allclose(extents["stationary"], [2.45, 5.95])
    assert_drawn(figure)


def test_in_a_gap_the_track_is_followed_wherever_it_goes() -> None:
    """Six metres off it still counts, and the gap is shaded; untold, the track is on nothing."""
    trace, gap = straight(), (30, 40)
    figure = error_over_time(trace, {"md": off_by(0.0, gap, drift=0.6)}, 7)
    _, drawn = lines(figure)["md"]
    np.testing.assert_allclose(drawn[30:40], 0.6 * np.arange(1, 11))
    (shade,) = [p for p in figure.axes[0].patches if p.get_label() == "gap: no detections"]
    extent = shade.get_extents().transformed(figure.axes[0].transData.inverted())
    np.testing.assert_allclose(extent.intervalx, [2.95, 3.95])
    untold = replace(off_by(0.0, gap, drift=0.6), provenance={})
    _, without = lines(error_over_time(trace, {"md": untold}, 7))["md"]
    assert np.isnan(without[34:40]).all()


def test_without_an_object_it_is_the_mean_of_those_that_count() -> None:
    """Two cars, 0.2 and 0.6 m off: 0.4 m; a third out of range does not count."""
    rows = [(k, o, float(k), y) for k in range(20) for o, y in ((1, 5.0), (2, 15.0), (3, 200.0))]
    trace = trace_of(rows, 20)
    off = {1: 0.2, 2: 0.6, 3: 1.9}
    tracks = tracks_of([(k, o, x, y + off[o]) for k, o, x, y in rows], 20)
    figure = error_over_time(trace, tracks)
    np.testing.assert_allclose(lines(figure)["tracks"][1], 0.4)
    assert_drawn(figure)


def test_weights_are_the_diagnostics_and_coasting_is_shaded() -> None:
    """Of the longest track unless told; NaN is a break, axes of one weight share a colour."""
    weights = np.linspace(0, 1, FRAMES)
    weights[5] = np.nan
    tracks = off_by(0.1, (30, 40))
    tracks = weighted(tracks, weight_vx=weights, weight_vy=1 - weights, nis=np.full(FRAMES, np.nan))
    figure = weights_over_time(tracks, trace=straight())
    assert set(lines(figure)) == {"weight_vx", "weight_vy"}
    np.testing.assert_array_equal(lines(figure)["weight_vx"][1], weights)
    one, other = figure.axes[0].get_lines()
    assert one.get_color() == other.get_color()
    assert one.get_linestyle() != other.get_linestyle()
    assert "coasting" in figure.axes[0].get_legend_handles_labels()[1]
    assert figure.axes[0].get_ylabel() == "weight [–]"
    assert "constant velocity" not in figure.axes[1].get_legend_handles_labels()[1]
    assert "stationary" in figure.axes[1].get_legend_handles_labels()[1]
    assert_drawn(figure)


def test_a_frame_from_above_has_boxes_and_ellipses_where_they_are() -> None:
    """The true box, the track's, and the 95 % ellipse of its covariance, by scipy's chi-square."""
    trace = straight()
    tracks = off_by(0.5)
    wide, narrow = np.full(FRAMES, 0.09), np.full(FRAMES, 0.04)
    tracks = replace(tracks, yaw=np.zeros(FRAMES), cov_xx=wide, cov_yy=narrow)
    figure = birds_eye(trace, tracks=tracks, frame=20)
    (axes,) = figure.axes
    drawn = [c for c in axes.collections if type(c) is PolyCollection]
    corners = [np.array(path.vertices)[:4] for c in drawn for path in c.get_paths()]
    spans = {tuple(np.round([*np.ptp(c, axis=0), *c.mean(axis=0)], 9)) for c in corners}
    assert spans == {(4.5, 1.8, 20.0, 10.0), (1.0, 1.0, 20.0, 10.5)}
    (ellipse,) = [c for c in axes.collections if isinstance(c, EllipseCollection)]
    np.testing.assert_allclose(ellipse.get_offsets(), [[20.0, 10.5]])
    sizes = 2 * np.sqrt(chi2.ppf(0.95, 2) * np.array([0.09, 0.04]))
    np.testing.assert_allclose([ellipse.get_widths()[0], ellipse.get_heights()[0]], sizes)
    assert axes.get_aspect() == 1.0
    assert [t.get_text() for t in axes.texts] == ["3"]
    assert_drawn(figure)


def test_all_frames_from_above_are_coloured_by_regime() -> None:
    """Beside tracks the truth is plain: colours are the filters' there."""
    regime = [REGIMES.index("constant_velocity")] * 25 + [REGIMES.index("stationary")] * 35
    trace = straight(regime=regime)

    def colours(figure: Figure) -> int:
        (axes,) = figure.axes
        own = [c for c in axes.collections if isinstance(c, LineCollection)]
        return len({tuple(row) for c in own[:1] for row in c.get_colors()})

    assert colours(birds_eye(trace)) == 2
    assert colours(birds_eye(trace, tracks=off_by(0.5))) == 1


@pytest.mark.parametrize(("scenario", "kind"), [("circle", "mid"), ("merge", "none")])
def test_simulated_tables_draw_themselves_in_one_call(scenario: str, kind: str) -> None:
    """Every table and the scores, of a closed form and of highway-env, with gaps and without."""
    trace = sim_bridge.simulate(scenarios.load(scenario), 1)
    gap = experiments.OcclusionProtocol(kind)  # type: ignore[arg-type]
    seen = gap.apply(sim_bridge.detect(trace, seed=1))
    tracks = {n: mdkf.Tracker(mdkf.estimator(n)).run(seen) for n in ("imm", "md")}
    for table in (trace, trace.ego, seen, tracks["md"], tracks):
        assert_drawn(experiments.plot(table))
    shown = experiments.plot(experiments.score(trace, tracks["md"]))
    assert "md" in lines(shown)
    both = experiments.plot(tracks, trace)
    np.testing.assert_array_equal(lines(both)["md"][1], lines(shown)["md"][1])
    assert_drawn(both)
    assert_drawn(experiments.plot(seen, trace, frame=50))
    assert_drawn(birds_eye(trace, seen, tracks, frame=trace.n_frames - 1))
    assert_drawn(weights_over_time(tracks["imm"], trace=trace))


def test_tables_of_random_rows_are_drawn() -> None:
    """Objects of every regime and kind, anywhere, also without derivatives."""
    rng = np.random.default_rng(0)
    for rows in (0, 1, 80):
        trace = random_trace(rng, rows)
        lost = np.full(rows, np.nan)
        recorded = replace(trace, regime=np.full(rows, REGIMES.index("unknown"), np.uint8), vx=lost)
        tracks = random_tracks(rng, rows)
        for table in (trace, recorded, random_detections(rng, rows), tracks):
            assert_drawn(experiments.plot(table), least=0.005)
            assert_drawn(experiments.plot(table, frame=11), least=0.005)
        for truth in (trace, recorded):
            assert_drawn(experiments.plot(tracks, truth), least=0.005)
            for object_id in truth.ids()[:1].tolist():
                assert_drawn(error_over_time(truth, tracks, object_id), least=0.005)


def test_tables_of_no_frames_are_drawn() -> None:
    """Nothing at all is a plain picture."""
    trace, seen = trace_of([], 0), random_detections(np.random.default_rng(1), 0)
    for table in (trace, trace.ego, replace(seen, n_frames=0), tracks_of([], 0)):
        figure = experiments.plot(table)
        assert_drawn(figure, least=0.005)
    assert "no rows" in [t.get_text() for t in experiments.plot(trace).axes[0].texts]
    assert_drawn(experiments.plot(tracks_of([], 0), trace), least=0.005)


def test_no_text_of_a_table_is_a_formula() -> None:
    """Provenance, filters and diagnostics of any name are drawn as they are."""
    name = "$\\frac{$\n_" * 9
    origin = {"scenario": name, "seed": name, "estimator": name}
    trace = replace(straight(), provenance=origin)
    tracks = weighted(off_by(0.1), **{name: np.full(FRAMES, np.nan)})
    for figure in (
        experiments.plot(trace),
        error_over_time(trace, {name: tracks}),
        error_over_time(trace, {name: tracks}, 7),
        birds_eye(trace, tracks={name: tracks}, frame=3),
        weights_over_time(replace(tracks, provenance=origin), trace=trace),
    ):
        assert_drawn(figure)
        assert len(figure.axes[0].get_title()) < 300


def test_what_cannot_be_drawn_is_named() -> None:
    """Each error says what is wrong; none is matplotlib's."""
    trace, tracks = straight(), off_by(0.1)
    with pytest.raises(TypeError, match="plot: int, expected a Trace"):
        experiments.plot(7)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="birds_eye: no table"):
        birds_eye()
    with pytest.raises(IndexError, match=r"frame 60 is outside 0\.\.59"):
        birds_eye(trace, frame=FRAMES)
    with pytest.raises(TableError, match=r"of 60 frames .* beside Trace of 10"):
        birds_eye(straight(10), tracks=tracks)
    with pytest.raises(ValueError, match=r"from x = 5 to 5 m .* expected ascending numbers"):
        birds_eye(trace, view=(5.0, 5.0, 0.0, 1.0))
    for far in (1e12, 1e308):
        with pytest.raises(ValueError, match="expected ascending numbers up to 1e"):
            birds_eye(tracks=replace(tracks, x=np.full(FRAMES, -far)), frame=3)
    with pytest.raises(ValueError, match="no object 8, expected one of 7"):
        error_over_time(trace, tracks, 8)
    with pytest.raises(ValueError, match="error_over_time: no tracks"):
        error_over_time(trace, {})
    with pytest.raises(TableError, match="different gaps, expected the same"):
        error_over_time(trace, {"a": tracks, "b": off_by(0.1, (30, 40))})
    with pytest.raises(TableError, match="come from another trace"):
        error_over_time(trace, replace(tracks, provenance={"trace": "another"}))
    with pytest.raises(TableError, match="expected a JSON object"):
        error_over_time(trace, replace(tracks, provenance={"occlusion": "[" * 10}))
    with pytest.raises(ValueError, match="no weights or probabilities, diagnostics: nis"):
        weights_over_time(weighted(tracks, nis=np.zeros(FRAMES)))
    with pytest.raises(ValueError, match="no track 4, expected one of 3"):
        weights_over_time(weighted(tracks, weight_vx=np.zeros(FRAMES)), 4)
    with pytest.raises(ValueError, match="weights_over_time: no tracks"):
        weights_over_time(weighted(tracks_of([], 5), weight_vx=np.zeros(0)))


def test_a_picture_is_saved_as_any_figure_is(tmp_path: Path) -> None:
    """PNG and SVG, without pyplot's global list of figures."""
    import matplotlib.pyplot as plt

    figure = experiments.plot(straight())
    assert isinstance(figure, Picture)
    for name in ("picture.png", "picture.svg"):
        figure.savefig(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5000
    assert plt.get_fignums() == []
