"""The scenes to look at are chosen by what happens in them, and told by the tables."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import scenarios
import sim_bridge
from experiments.jobs import ROWS
from experiments.paper.item import again
from experiments.paper.showcase import ITEMS, answer
from experiments.studies.showcase import FILTERS, Scene, hidden_cars, show
from mdkf import Detections, Trace
from mdkf.tables import KINDS

BUS, CAR = 0, 1


@pytest.fixture(scope="module")
def world() -> tuple[Trace, Detections]:
    """A bus passes between the sensor and a standing car."""
    trace = sim_bridge.simulate(scenarios.load("passing_bus"), 0)
    return trace, sim_bridge.detect(trace, "pointrcnn", 0)


def test_the_car_behind_the_bus_is_found(world: tuple[Trace, Detections]) -> None:
    """The time is the scenario's closed form, with the near sides of bus and car 8 - 1.275 m and
    20 - 0.9 m away: (12 m - 4.5 m * 6.725 / 19.1) / 5 m/s = 2.083 s wholly hidden, in the middle
    of the 20 s; less than 15 % visible is a little longer."""
    (found,) = hidden_cars(*world)
    assert (found.object_id, found.by) == (CAR, BUS)
    wholly = (12.0 - 4.5 * (8.0 - 1.275) / (20.0 - 0.9)) / 5.0
    assert wholly - 0.1 < (found.stop - found.start) * 0.1 < wholly + 0.3
    assert (found.start + found.stop) / 2 == pytest.approx(100, abs=1)
    assert found.distance == pytest.approx(20.0)
    _, detections = world
    seen = detections.frame[detections.source == CAR]
    assert not np.isin(np.arange(*found.gap), seen).any()


def test_of_two_that_drive_past_the_one_between_is_named(world: tuple[Trace, Detections]) -> None:
    """A second bus, on the other side of the sensor, hides nothing: its number comes first."""
    trace, detections = world
    bus = trace.object_id == BUS
    columns = {
        name: np.concatenate([values, values[bus]]) for name, values in trace.columns().items()
    }
    columns["object_id"] = np.concatenate([np.where(bus, 2, CAR), np.full(bus.sum(), 0)])
    columns["y"] = np.concatenate([trace.y, -trace.y[bus]])
    both = Trace.from_columns(columns, n_frames=trace.n_frames, dt=trace.dt, ego=trace.ego)
    (found,) = hidden_cars(both, detections)
    assert found.by == 2


@pytest.mark.parametrize(
    "change", ["bus stands", "car drives", "car arrives", "bus is low", "car is missed"]
)
def test_others_are_not(world: tuple[Trace, Detections], change: str) -> None:
    """What stands does not drive past; what drives does not stand; what is lower than the sensor
    hides by chance; a car that was hardly detected before tells of detectors."""
    trace, detections = world
    bus, car = trace.object_id == BUS, trace.object_id == CAR
    if change == "bus stands":
        still = {name: np.where(bus, 0.0, getattr(trace, name)) for name in ("vx", "vy")}
        trace = replace(trace, **still)
    elif change == "car drives":
        trace = replace(trace, regime=np.where(car, 1, trace.regime).astype(np.uint8))
    elif change == "car arrives":
        arrives = car & (trace.frame > 75) & (trace.frame < 80)
        trace = replace(trace, regime=np.where(arrives, 2, trace.regime).astype(np.uint8))
    elif change == "bus is low":
        low = np.where(bus, 1.0, trace.height)
        trace = replace(trace, height=low, z=np.where(bus, 0.5, trace.z))
    else:
        before = (detections.source == CAR) & (detections.frame < 90) & (detections.frame > 75)
        detections = detections.take(~before)
    assert list(hidden_cars(trace, detections)) == []


def test_the_rows_are_of_the_tables() -> None:
    """Errors by frame, mean and last are distances of track and car; every number of the answer
    comes from the rows that it names."""
    shown = show("passing_bus")
    rows = Scene("passing_bus").rows()
    assert dict(rows.schema) == ROWS
    start, stop = shown.hidden.gap
    trace = shown.trace
    car = np.flatnonzero(trace.object_id == shown.hidden.object_id)
    for name in FILTERS:
        table = shown.tracks[name]
        before = np.flatnonzero(table.frame == start - 1)
        at = car[trace.frame[car] == start - 1][0]
        nearest = np.argmin(
            (table.x[before] - trace.x[at]) ** 2 + (table.y[before] - trace.y[at]) ** 2
        )
        own = table.take(table.track_id == table.track_id[before[nearest]]).between(start, stop)
        there = car[(trace.frame[car] >= start) & (trace.frame[car] < stop)]
        assert own.frame.tolist() == trace.frame[there].tolist()
        errors = np.sqrt((own.x - trace.x[there]) ** 2 + (own.y - trace.y[there]) ** 2)
        said = rows.filter(filter=name, metric="error")
        by_frame = [said.filter(bin=f"frame {k}")["value"].item() for k in range(start, stop)]
        np.testing.assert_allclose(by_frame, errors, rtol=1e-12)
        assert said.filter(bin="gap")["value"].item() == pytest.approx(errors.mean())
        assert said.filter(bin="end")["value"].item() == pytest.approx(errors[-1])
    cells = answer(rows).cells
    told = cells.filter(table="passing_bus, one car", source="closed form")
    assert len(told) == 2 * len(FILTERS)
    for cell in told.to_dicts():
        assert again(rows, cell).value == cell["value"]
    assert cells.filter(pl.col("table") != "passing_bus, one car")["value"].is_null().all()


def test_the_page_is_of_the_scene() -> None:
    """Title and car are those that were found."""
    shown = show("passing_bus")
    kind = KINDS[shown.trace.kind[shown.trace.rows_of(shown.hidden.object_id)[0]]]
    assert kind == "car"
    assert shown.title() == "passing_bus, seed 0: a bus hides a standing car for 2.1 s"
    page = next(item for item in ITEMS if item.id == "playback").answer(Scene("passing_bus").rows())
    assert page.pictures[0].page is not None
    assert f'"focus":{CAR},' in page.pictures[0].page()
