"""Claim: the pictures of single scenes show the filters' errors in natural gaps, by exact truth."""

import io
from functools import cache

import numpy as np
import polars as pl
import pytest

import scenarios
import sim_bridge
from experiments.jobs import ROWS
from experiments.paper.item import Answer, again
from experiments.paper.items import ITEMS
from experiments.paper.scene_items import SCENES
from experiments.studies.natural import natural_gaps
from experiments.studies.scale import FULL, QUICK
from experiments.studies.scenes import Scene, jobs
from mdkf import DETECTORS, Detections, Trace, Tracker, estimator
from mdkf.reference import filterpy_kalman
from mdkf.tables import FloatArray

BUS = "passing_bus"
SEEDS = range(3)
NAMES = ("fig-stationary", "fig-occlusion", "fig-trajectory", "fig-offscene")


@cache
def rows(seed: int) -> pl.DataFrame:
    """The rows of one seed in closed form."""
    return Scene(BUS, seed).rows()


@cache
def world(seed: int) -> tuple[Trace, Detections, tuple[int, int, int]]:
    """Truth, detections and the one gap of the hidden car."""
    trace = sim_bridge.simulate(scenarios.load(BUS), seed)
    detections = sim_bridge.detect(trace, "pointrcnn", seed)
    (gap,) = natural_gaps(trace, detections).rows()
    return trace, detections, gap


def value(seed: int, **where: str) -> float:
    """The one value of a filter, bin and metric."""
    return float(rows(seed).filter(**where)["value"].item())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("name", "order"), [("ca", 2), ("cj", 3)])
def test_the_drift_of_each_frame_is_that_of_filterpy(seed: int, name: str, order: int) -> None:
    """A filterpy filter on the car's own detections, predicted through its gap; mean and standard
    deviation are of its first 20 frames."""
    trace, detections, (car, start, stop) = world(seed)
    own = detections.rows_of(car)
    measured = dict(zip(detections.frame[own].tolist(), own, strict=True))
    settings = DETECTORS["pointrcnn"]
    oracle, errors = None, []
    truth = trace.rows_of(car)
    true = np.array([trace.x[truth[0]], trace.y[truth[0]]])
    for frame in range(min(measured), min(stop, start + 20)):
        z = None
        if frame in measured:
            row = measured[frame]
            z = np.array([detections.x[row], detections.y[row]])
        if oracle is None:
            oracle = filterpy_kalman(z, order, trace.dt)
        else:
            oracle.predict()
            oracle.update(z, R=np.diag([settings.x_var, settings.y_var]))
        if frame >= start:
            errors.append(np.hypot(*(oracle.x[[0, order + 1]] - true)))
    for nth, error in enumerate(errors, 1):
        found = value(seed, filter=name, bin=f"standing, frame {nth}", metric="drift")
        assert found == pytest.approx(error, rel=1e-9)
    whole = {"filter": name, "bin": "standing"}
    assert value(seed, **whole, metric="drift") == pytest.approx(np.mean(errors), rel=1e-9)
    assert value(seed, **whole, metric="drift sd") == pytest.approx(np.std(errors, ddof=1))
    assert value(seed, **whole, metric="end drift") == pytest.approx(errors[-1], rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["imm", "md3"])
def test_the_box_of_the_track_is_laid_over_the_true_one(seed: int, name: str) -> None:
    """Overlap and distance in the last measured frame, counted on a grid of 2 cm; the track is the
    one nearest to the car in the last frame before the gap."""
    trace, detections, (car, start, stop) = world(seed)
    tracks = Tracker(estimator(name), DETECTORS["pointrcnn"]).run(detections)
    own = trace.rows_of(car)[0]
    before = np.arange(len(tracks))[tracks.frame_rows(start - 1)]
    away = np.hypot(tracks.x[before] - trace.x[own], tracks.y[before] - trace.y[own])
    track = tracks.rows_of(int(tracks.track_id[before[np.argmin(away)]]))
    (last,) = track[tracks.frame[track] == min(stop, start + 20) - 1]
    grid = np.stack(np.meshgrid(np.arange(-6, 6, 0.02), np.arange(-6, 6, 0.02)), axis=-1)
    grid += np.array([trace.x[own], trace.y[own]])
    truly, estimated = inside(grid, trace, own), inside(grid, tracks, last)
    overlap = (truly & estimated).sum() / (truly | estimated).sum()
    where = {"filter": name, "bin": "standing"}
    assert value(seed, **where, metric="end iou") == pytest.approx(overlap, abs=0.01)
    distance = np.hypot(tracks.x[last] - trace.x[own], tracks.y[last] - trace.y[own])
    assert value(seed, **where, metric="end distance") == pytest.approx(distance)


def inside(points: FloatArray, table: object, row: int) -> np.ndarray:
    """Whether points (..., 2) lie in the box of a row."""
    x, y, yaw, length, width = (
        float(getattr(table, name)[row]) for name in ("x", "y", "yaw", "length", "width")
    )
    offset = points - np.array([x, y])
    along = offset @ np.array([np.cos(yaw), np.sin(yaw)])
    across = offset @ np.array([-np.sin(yaw), np.cos(yaw)])
    return (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)


@pytest.mark.parametrize("seed", SEEDS)
def test_md_is_nearer_in_as_many_frames_as_are_counted(seed: int) -> None:
    """With one gap the frames' means are the errors themselves."""
    drifts = rows(seed).filter(
        pl.col("bin").str.starts_with("standing, frame"), pl.col("metric") == "drift"
    )
    by_filter = {str(name): own["value"] for (name,), own in drifts.group_by("filter")}
    for subject, name in (("md", "ca"), ("md", "imm-zero"), ("md3", "imm3")):
        expected = 100 * (by_filter[subject] < by_filter[name]).mean()  # type: ignore[operator]
        assert value(seed, filter=name, bin="standing", metric="nearer") == pytest.approx(expected)


def test_the_retuned_start_stands_beside() -> None:
    """Another start, another drift; the order of the filters is not asked."""
    for name in ("ca", "imm-zero", "md3"):
        where = {"bin": "standing", "metric": "drift"}
        assert value(0, filter=f"{name}-retuned", **where) != value(0, filter=name, **where)


@pytest.mark.parametrize("seed", SEEDS)
def test_drift_is_told_apart_by_what_came_before(seed: int) -> None:
    """With one gap all of it is steady, or all of it is not, also of MD that keeps its window."""
    _, detections, (car, start, _) = world(seed)
    seen = set(detections.frame[detections.rows_of(car)].tolist())
    steady = set(range(start - 12, start)) <= seen
    for name in ("imm", "md", "md-keep"):
        own = rows(seed).filter(
            pl.col("bin").is_in(["standing, steady", "standing, unsteady"]), filter=name
        )
        assert own["bin"].to_list() == ["standing, steady" if steady else "standing, unsteady"]
        whole = value(seed, filter=name, bin="standing", metric="drift")
        assert own["value"].item() == pytest.approx(whole)


@cache
def answered(item: str) -> Answer:
    """An item's answer from the closed form alone."""
    return ITEMS[item].answer(pl.concat([rows(seed) for seed in SEEDS]))


def test_the_stationary_car_stands_beside_the_papers() -> None:
    """MD's fourth frame is the mean of the seeds', 0.07 m the paper's; every cell leads to rows."""
    answer = answered("fig-stationary")
    cell = answer.cells.filter(table="passing_bus, alone", line="md", column="frame 4")
    drifts = [value(s, filter="md", bin="standing, frame 4", metric="drift") for s in SEEDS]
    assert cell["value"].item() == pytest.approx(np.mean(drifts))
    assert cell["paper"].item() == 0.07
    assert cell["source"].item() == "closed form"
    everything = pl.concat([rows(seed) for seed in SEEDS])
    for one in answer.cells.filter(pl.col("table").str.starts_with(BUS)).to_dicts():
        assert one["n"] == len(SEEDS)
        assert again(everything, one).value == one["value"]


def test_what_is_drawn_is_what_was_measured() -> None:
    """Every point of the curves is the mean of its seeds, with their standard deviation."""
    (picture,) = answered("fig-stationary").pictures
    point = picture.data.filter(scenario=BUS, metric="error", filter="imm", frame=7)
    errors = [value(s, filter="imm", bin="standing, frame 7", metric="error") for s in SEEDS]
    assert point["mean"].item() == pytest.approx(np.mean(errors))
    assert point["sd"].item() == pytest.approx(np.std(errors, ddof=1))
    assert point["low"].item() <= point["mean"].item() <= point["high"].item()


def drawn_rows() -> pl.DataFrame:
    """A car hidden in four frames of a straight path, and boxes: of each population one car."""
    found = [("truth", "path", "frames", 4.0)]
    for frame in range(-2, 8):
        found += [("truth", f"path, frame {frame}", "x", float(frame))]
        found += [("truth", f"path, frame {frame}", "y", 1.0)]
    for name, off in (("detections", 0.2), ("ca", 0.5), ("md", 0.3), ("cj", 0.1), ("md3", 0.4)):
        for frame in range(0, 5) if name != "detections" else (-1, 0, 5):
            found += [(name, f"path, frame {frame}", "x", float(frame))]
            found += [(name, f"path, frame {frame}", "y", 1.0 + off)]
    for name, off in (("truth", 0.0), ("md", 0.5)):
        for kind in ("parked 1", "leaving 1"):
            box = {"x": 3.0 + off, "y": 2.0, "yaw": 0.3, "length": 4.0, "width": 2.0}
            found += [(name, kind, metric, number) for metric, number in box.items()]
    columns = pl.DataFrame(found, ["filter", "bin", "metric", "value"], orient="row")
    everywhere = {"study": "scenes", "seed": 0, "detector": "pointrcnn", "occlusion": "natural"}
    several = [
        columns.with_columns(pl.lit(v).alias(k) for k, v in {**everywhere, "scenario": s}.items())
        for s in ("bus_stop", "stop_and_go", "passing_van", "off_scene")
    ]
    whole = pl.concat(several).with_columns(n=1)
    return whole.select(*ROWS).cast(ROWS)  # type: ignore[arg-type]


def test_each_dotted_line_is_from_the_nearest_state() -> None:
    """Of order 2 MD is nearest in all four frames, of order 3 CJ; nothing is dotted elsewhere."""
    (picture,) = ITEMS["fig-trajectory"].answer(drawn_rows()).pictures
    for axes, off in zip(picture.draw().axes, (0.3, 0.1), strict=True):
        dotted = [line.get_xydata() for line in axes.lines if line.get_linestyle() == ":"]
        expected = [[[frame, 1 + off], [frame, 1]] for frame in range(1, 5)]
        np.testing.assert_allclose(dotted, expected)


def test_boxes_are_drawn_around_the_true_one() -> None:
    """One car of each scenario, the truth and MD's box half a metre ahead; axes have units."""
    (picture,) = ITEMS["fig-offscene"].answer(drawn_rows()).pictures
    axes = picture.draw().axes
    assert [one.get_title() for one in axes[:2]] == [
        "passing_van: parked 1",
        "off_scene: leaving 1",
    ]
    for one, boxes in zip(axes, (2, 2, 1, 1), strict=True):
        assert len(one.patches) == boxes
    middles = [patch.get_center() for patch in axes[0].patches]
    np.testing.assert_allclose(sorted(map(tuple, middles)), [[0, 0], [0.5, 0]], atol=1e-12)
    assert "[m]" in axes[0].get_ylabel()
    assert "[m]" in axes[2].get_xlabel()


@pytest.mark.parametrize("item", NAMES)
def test_an_item_without_rows_has_empty_cells_and_pictures(item: str) -> None:
    """Every seed may be refused: nothing is invented, nothing fails."""
    answer = ITEMS[item].answer(pl.DataFrame(schema=ROWS))
    assert answer.cells["value"].is_null().all()
    for picture in answer.pictures:
        assert picture.data.is_empty()
        picture.draw().savefig(io.BytesIO())


@pytest.mark.parametrize("item", NAMES)
def test_more_is_run_at_full_scale(item: str) -> None:
    """All that is done for a first look is part of the whole."""
    few, many = ITEMS[item].jobs(QUICK), ITEMS[item].jobs(FULL)
    assert set(few) < set(many)


def test_all_scenes_are_those_that_every_item_asks_for() -> None:
    """Cells over all scenes are the same whichever items are run: no other item's job has rows of
    moving cars, as the car that the bus hides stands."""
    every = {job.scenario for name in NAMES for job in ITEMS[name].jobs(QUICK)}
    assert every == {*SCENES, BUS}
    assert rows(0).filter(pl.col("bin").str.starts_with("moving")).is_empty()


def test_sumo_has_fewer_seeds_than_the_closed_form() -> None:
    """Of one seed at least one."""
    one = jobs(QUICK.with_seeds(1), (BUS, "bus_stop"))
    assert [(job.scenario, job.seed) for job in one] == [(BUS, 0), ("bus_stop", 0)]
    full = [job.scenario for job in jobs(FULL, (BUS, "bus_stop"))]
    assert (full.count(BUS), full.count("bus_stop")) == (200, 200)
