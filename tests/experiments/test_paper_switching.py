"""Claim: the items on switches of regime measure what they say, on motions known by hand."""

import json

import numpy as np
import polars as pl
import pytest

from experiments.drift import drift
from experiments.gaps import Gaps
from experiments.occlusion import OcclusionProtocol
from experiments.paper import switching
from experiments.paper.items import ITEMS
from experiments.regime_switches import frames_since_change
from experiments.studies import switches
from experiments.studies import switching as switching_worlds
from experiments.studies.scale import QUICK
from experiments.studies.seeds import detected, simulated
from experiments.studies.switches import GAP, HISTORY, RESPONSE, Switched, delay
from experiments.studies.switching import (
    KINDS,
    TOLD,
    Followed,
    inferred,
    kinds,
    scored,
    truth_of,
)
from mdkf import DETECTORS, Detections, Trace, estimator
from mdkf.reference import filterpy_kalman
from mdkf.tables import REGIMES, FloatArray
from tests.tables import gaps_of, trace_of

FRAMES = 120
GAPS = gaps_of((2, 60, 80))


@pytest.fixture(scope="module")
def batch() -> pl.DataFrame:
    """Rows of a few tracks."""
    return Switched(0, 6).rows()


@pytest.fixture(scope="module")
def world() -> pl.DataFrame:
    """Rows of a small world."""
    return Followed("emergency_braking", 0).rows()


def scene(gaps: Gaps) -> tuple[Trace, Detections]:
    """Object 1 stands; object 2 drives at 10 m/s; object 3 stands for 50 frames and then speeds up
    at 3 m/s2. All are seen exactly, but for the gaps."""
    k = np.arange(FRAMES)
    since = 0.1 * np.maximum(k - 50, 0)
    speeds = [np.zeros(FRAMES), np.full(FRAMES, 10.0), 3.0 * since]
    places = [np.zeros(FRAMES), 1.0 * k, 1.5 * since**2]
    regimes = [np.full(FRAMES, 0), np.full(FRAMES, 1), np.where(k <= 50, 0, 2)]
    rows = [(t, i + 1, places[i][t], 8.0 * i) for i in range(3) for t in range(FRAMES)]
    columns = {"vx": np.concatenate(speeds), "regime": np.concatenate(regimes)}
    trace = trace_of(rows, FRAMES, **columns)
    hidden = gaps.covers(np.array([row[1] for row in rows]), np.array([row[0] for row in rows]))
    seen = [row for row, gone in zip(rows, hidden, strict=True) if not gone]
    frame, source, x, y = np.array(seen).T
    boxes = {name: np.ones(len(seen)) for name in Detections.column_types()}
    boxes |= {"frame": frame, "source": source, "x": x, "y": y}
    return trace, Detections.from_columns(boxes, n_frames=FRAMES, dt=0.1)


def hand_made(gaps: Gaps = GAPS) -> dict[tuple[str, str], tuple[float, int]]:
    """Value and count by bin and metric, of the scene, by CA."""
    trace, seen = scene(gaps)
    rows = scored(trace, truth_of(trace, seen, gaps, GAP), seen, gaps, estimator("ca"))
    return {(row["bin"], row["metric"]): (row["value"], row["n"]) for row in rows}


def errors_by_filterpy(place: FloatArray, seen: FloatArray) -> FloatArray:
    """CA's errors (frames,) along x [m]; along y nothing moves."""
    settings = DETECTORS[switching_worlds.DETECTOR]
    noise = np.diag([settings.x_var, settings.y_var])
    oracle = filterpy_kalman(np.array([seen[0], 0.0]), 2, 0.1)
    errors = [abs(oracle.x[0] - place[0])]
    for k in range(1, len(place)):
        oracle.predict()
        if np.isfinite(seen[k]):
            oracle.update(np.array([seen[k], 0.0]), R=noise)
        errors.append(abs(oracle.x[0] - place[k]))
    return np.array(errors)


def test_errors_are_filterpys_by_phase() -> None:
    """In view, in the gap and in the second after it, frame by frame."""
    found = hand_made()
    place = 1.0 * np.arange(FRAMES)
    seen = place.copy()
    seen[60:80] = np.nan
    errors = errors_by_filterpy(place, seen)
    in_view = np.concatenate([errors[:60], errors[90:]])
    for phase, expected in (("in view", in_view), ("gap", errors[60:80]), ("after", errors[80:90])):
        value, n = found[f"constant velocity, {phase}", "error"]
        assert value == pytest.approx(expected.mean(), rel=1e-9)
        assert n == len(expected)
    steady = "gap from constant velocity to constant velocity"
    assert found[steady, "error"] == (found["constant velocity, gap", "error"][0], GAP)
    assert found["stationary, gap", "error"][1] == 0


def test_gaps_are_told_by_what_they_begin_and_end_with() -> None:
    """Of the one in which the third object pulls away, only; in its last frame it is fast."""
    found = hand_made(gaps_of((3, 45, 65)))
    away = 1.5 * (0.1 * np.maximum(np.arange(45, 65) - 50, 0)) ** 2
    named = {where: value for (where, _), value in found.items() if where.startswith("gap from")}
    assert {where for where, (_, n) in named.items() if n} == {"gap from rest to manoeuvre"}
    assert named["gap from rest to manoeuvre"] == (pytest.approx(away.mean()), GAP)


def test_standing_and_driving_are_told_apart_without_noise() -> None:
    """With exact measurements a standing object's estimates are exactly zero; that of the third is
    not at once. Nothing recent is told of an object that never changed."""
    found = hand_made()
    assert found["standstill as standstill", "confusion"][0] == 100.0
    assert found["constant velocity as standstill", "confusion"][0] == 0.0
    assert found["all", "speed driving"][0] == 1.0
    moving, quiet = FRAMES - 51, 2 * FRAMES - (FRAMES - 51)
    asked = moving + quiet + FRAMES - GAP - 10 - 3 * switching_worlds.AGE
    assert found["all", "speed moving"][1] == asked
    # The third object moves from frame 51 on; nobody begins to stand.
    assert found["recent", "speed moving"][1] == switching_worlds.RECENT + 1
    assert np.isnan(found["recent", "speed moving"][0])


def test_kinds_and_changes_by_hand() -> None:
    """Creeping is below half a metre per second; a turn is a manoeuvre; an object's first frame is
    no change, nor is another object's."""
    rows = [(k, i, 0.0, 0.0) for k in range(5) for i in (4, 9)]
    speed = {4: (0.0, 0.4, 0.5, 6.0, 6.0), 9: (0.0, 0.0, 0.0, 7.0, 7.0)}
    code = {4: (0, 1, 3, 1, 1), 9: (0, 0, 0, 1, 2)}
    turn = {4: (0, 0, 0, 0, 1), 9: (0, 0, 0, 0, 0)}
    columns = {
        name: [values[i][k] for k, i, _, _ in rows]
        for name, values in (("vx", speed), ("regime", code), ("turning", turn))
    }
    trace = trace_of(rows, 5, **columns)
    names = [KINDS[place] for place in kinds(trace)]
    first, second = names[::2], names[1::2]
    assert first == ["standstill", "creeping", "manoeuvre", "constant velocity", "manoeuvre"]
    assert second == ["standstill"] * 3 + ["constant velocity", "manoeuvre"]
    since = frames_since_change(trace, (kinds(trace) > 0).astype(np.int64))
    assert since[::2].tolist() == [6, 0, 1, 2, 3]
    assert since[1::2].tolist() == [6, 6, 6, 0, 1]


def test_what_filters_take_objects_for_by_hand() -> None:
    """By weights, by probability, and by plain estimates."""
    stands, steady, manoeuvre = range(len(TOLD))
    weights = {"w_v": np.array([0.9, 1.0, 1.0]), "w_a": np.array([1.0, 0.9, 1.0])}
    weights |= {"speed": np.zeros(3), "acceleration": np.ones(3)}
    assert inferred(weights).tolist() == [stands, steady, manoeuvre]
    modes = {"speed": np.array([0.49, 0.5, 0.5]), "not cv": np.array([0.9, 0.5, 0.51])}
    modes |= {"acceleration": np.full(3, 9.0)}
    assert inferred(modes).tolist() == [stands, steady, manoeuvre]
    plain = {"speed": np.array([0.1, 5.0, 5.0]), "acceleration": np.array([2.0, 0.29, 0.3])}
    assert inferred(plain).tolist() == [stands, steady, manoeuvre]


def test_a_worlds_gaps_are_those_of_drift(world: pl.DataFrame) -> None:
    """Over all motions the errors in gaps are the drift of the same gaps; what is taken for what
    adds up to everything."""
    trace = simulated("emergency_braking", 0)
    seen = detected("emergency_braking", 0, switching_worlds.DETECTOR)
    protocol = OcclusionProtocol.parse(switching_worlds.OCCLUSION)
    gaps, settings = protocol.gaps(seen), DETECTORS[switching_worlds.DETECTOR]
    told = drift(trace, protocol.apply(seen), gaps, estimator("md"), settings)
    own = zip(gaps.object_id.tolist(), gaps.start.tolist(), gaps.stop.tolist(), strict=True)
    inside = [
        told.filter(pl.col("frame").is_between(a, min(b, a + GAP) - 1), object_id=i)
        for i, a, b in own
    ]
    expected = pl.concat(inside)["drift"]
    motions = [f"{name.replace('_', ' ')}, gap" for name in REGIMES[:-1]]
    found = world.filter(pl.col("bin").is_in(motions), filter="md", metric="error")
    assert found["n"].sum() == len(expected) > 0
    weighted = (found["value"].fill_null(0.0) * found["n"]).sum() / found["n"].sum()
    assert weighted == pytest.approx(expected.mean(), rel=1e-9)
    between = world.filter(pl.col("bin").str.starts_with("gap from"), filter="md")
    assert between["n"].sum() == len(expected)
    confusion = world.filter(metric="confusion").with_columns(
        pl.col("bin").str.split(" as ").list.first()
    )
    whole = confusion.group_by("filter", "bin").agg(pl.col("value").sum(), pl.col("n").max())
    np.testing.assert_allclose(whole.filter(pl.col("n") > 0)["value"], 100.0)


def test_a_batchs_gaps_are_filterpys_on_its_motions() -> None:
    """Tracks are on their motions and seen up to the gap, never in it; drift is CA's own."""
    job = Switched(3, 2)
    true, seen = job.gaps()
    assert np.isfinite(seen[:HISTORY]).all()
    assert np.isnan(seen[HISTORY:]).all()
    starts = list(switches.STARTS)
    place = 1, starts.index(8)
    time = 0.1 * np.arange(8 - HISTORY, 8 + GAP)
    along = switches.SWITCHES[1].motion.at(time).position[:, 0]
    settings = DETECTORS[switches.DETECTOR]
    noise = np.diag([settings.x_var, settings.y_var])
    errors = np.empty((2, GAP))
    for one in range(2):
        own, measured = true[:, *place, one], seen[:, *place, one]
        np.testing.assert_allclose(np.hypot(*own.T), np.abs(along), atol=1e-9)
        oracle = filterpy_kalman(measured[0], 2, 0.1)
        for k in range(1, HISTORY + GAP):
            oracle.predict()
            if k < HISTORY:
                oracle.update(measured[k], R=noise)
            else:
                errors[one, k - HISTORY] = np.hypot(*(oracle.x[[0, 3]] - own[k]))
    rows = job.rows().filter(scenario="stops", filter="ca", bin="start +8", metric="drift")
    assert rows["value"].item() == pytest.approx(errors.mean(), rel=1e-9)


def test_a_gap_at_the_switch_costs_what_is_hidden(batch: pl.DataFrame) -> None:
    """A car seen standing until it pulls away at a in the gap's first frame: a filter that has it
    stand is off by the mean of a t^2 / 2; likewise one whose speed is known, when it brakes."""
    hidden = np.mean((0.1 * np.arange(GAP)) ** 2 / 2)
    for motion, acceleration, name in (("pulls-away", 2.0, "md"), ("brakes", 3.0, "imm-zero")):
        found = batch.filter(scenario=motion, filter=name, bin="start +0", metric="drift")
        assert found["value"].item() == pytest.approx(acceleration * hidden, abs=0.15)


def test_long_before_a_switch_nothing_is_told_of_it(batch: pl.DataFrame) -> None:
    """A car that stands through a gap that ends a second before it pulls away is where it was."""
    found = batch.filter(scenario="pulls-away", bin="start -30", metric="drift")
    assert found["value"].max() < 1.0
    md = found.filter(filter="md-posterior")["value"].item()
    assert md < found.filter(filter="ca")["value"].item()


def test_delays_are_counted_from_the_switch() -> None:
    """Whichever side is quiet; a signal that stood out before is released."""
    frames = np.array(RESPONSE)
    assert delay(np.where(frames < 7, 0.5, 1.0), "before") == 7
    assert delay(np.where(frames < 12, 1.0, 0.5), "after") == 12
    assert np.isnan(delay(np.full(len(frames), 0.5), "after"))


def test_speed_tells_of_pulling_away_after_and_not_before(batch: pl.DataFrame) -> None:
    """CA's estimate of it cannot stand out before the switch, and does within a second."""
    where = {"scenario": "pulls-away", "filter": "ca", "metric": "speed separation"}
    curve = {row["bin"]: row["value"] for row in batch.filter(**where).to_dicts()}
    before = [curve[f"frame {frame:+d}"] for frame in range(RESPONSE.start, 0, 2)]
    assert np.mean(before) == pytest.approx(0.5, abs=0.15)
    assert min(curve[f"frame {frame:+d}"] for frame in range(10, RESPONSE.stop, 2)) == 1.0
    found = batch.filter(scenario="pulls-away", filter="ca", metric="speed delay")
    assert 0.1 <= found["value"].item() <= 1.0


def test_batches_are_all_tracks_of_a_scale_and_repeat(batch: pl.DataFrame) -> None:
    """The last one is what is left; the same batch gives the same rows, another one others."""
    jobs = switches.jobs(QUICK.with_seeds(25))
    assert [(job.batch, job.tracks) for job in jobs] == [(0, 10), (1, 10), (2, 5)]
    assert Switched(0, 6).rows().equals(batch)
    assert not Switched(1, 6).rows()["value"].equals(batch["value"])
    assert HISTORY > 10 + 2  # MD has formed its weights before a gap and before it is looked at


@pytest.mark.parametrize("item", switching.ITEMS, ids=lambda item: item.id)
def test_every_number_is_the_mean_of_the_rows_it_names(
    item: switching.Item, world: pl.DataFrame, batch: pl.DataFrame
) -> None:
    """One world and one batch: the rows behind a cell are one, or one and its partner; and every
    figure can be drawn of them."""
    rows = pl.concat([world, batch])
    answer = item.answer(rows)
    assert item is ITEMS[item.id]
    shown = 0
    for cell in answer.cells.to_dicts():
        where = json.loads(cell["where"])
        value = rows.filter(**where)["value"].item()
        if cell["against"] is not None and value is not None:
            partner = rows.filter(**{**where, **json.loads(cell["against"])})["value"].item()
            value = None if partner is None else value - partner
        assert cell["value"] == (value if value is None else pytest.approx(value))
        shown += value is not None
    assert shown > len(answer.cells) / 2
    assert set(answer.captions) <= set(answer.cells["table"])
    for picture in answer.pictures:
        figure = picture.draw()
        assert len(picture.data) > 0
        drawn = [axes for axes in figure.axes if axes.axison]
        assert all(axes.lines for axes in drawn)
        assert "[s]" in drawn[-1].get_xlabel()
