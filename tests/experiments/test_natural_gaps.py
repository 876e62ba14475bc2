"""Claim: a natural gap is where a car is hidden between two detections; nothing else is one."""

from collections.abc import Sequence

import numpy as np
import pytest

import scenarios
import sim_bridge
from experiments.studies.natural import (
    STEADY,
    leaving_gaps,
    measured,
    natural_gaps,
    populations,
    steady,
)
from mdkf import Detections, Trace, estimator
from mdkf.sequence import filter_sequence
from mdkf.tables import KINDS
from tests.tables import gaps_of, trace_of

N = 60


def scene(
    hidden: range,
    missed: Sequence[int],
    *,
    speed: Sequence[float] = (0.0,) * N,
    distance: float = 20.0,
    kind: str = "car",
) -> tuple[Trace, Detections]:
    """Object 7 in all of 60 frames, 10 % visible in some, and detected in all but some."""
    visible = [0.1 if k in hidden else 1.0 for k in range(N)]
    rows = [(k, 7, distance, 0.0) for k in range(N)]
    kinds = [KINDS.index(kind)] * N
    trace = trace_of(rows, N, visible=visible, vy=speed, kind=kinds)
    seen = np.setdiff1d(np.arange(N), missed)
    columns = {name: np.ones(len(seen)) for name in Detections.column_types()}
    columns |= {"frame": seen, "source": np.full(len(seen), 7)}
    return trace, Detections.from_columns(columns, n_frames=N, dt=0.1)


@pytest.mark.parametrize("hidden", [range(20, 29), range(20, 28), range(22, 27)])
def test_it_is_from_the_last_detection_to_the_next(hidden: range) -> None:
    """Frames 20 to 27 without a detection, the car hidden in most of them, or in one more."""
    assert natural_gaps(*scene(hidden, range(20, 28))).rows() == [(7, 20, 28)]


@pytest.mark.parametrize(
    ("hidden", "missed"),
    [
        (range(20, 23), range(20, 23)),  # three frames are too few
        (range(20, 24), range(20, 28)),  # missed in full view in half of them
        (range(20, 27), [*range(20, 23), *range(24, 27)]),  # detected in between
        (range(9, 20), range(9, 20)),  # nine detections before
        (range(50, 60), range(50, 60)),  # never seen again
        (range(0), range(20, 28)),  # not hidden at all
    ],
)
def test_anything_less_is_none(hidden: range, missed: Sequence[int]) -> None:
    """Each breaks one of the rules."""
    assert len(natural_gaps(*scene(hidden, missed))) == 0


def test_four_frames_after_ten_detections_are_enough() -> None:
    """The bounds themselves count."""
    assert natural_gaps(*scene(range(10, 14), range(10, 14))).rows() == [(7, 10, 14)]


@pytest.mark.parametrize("other", [{"kind": "van"}, {"distance": 61.0}])
def test_only_cars_in_range_count(other: dict[str, str | float]) -> None:
    """Vans are not the question; beyond 60 m truth does not count."""
    assert len(natural_gaps(*scene(range(20, 28), range(20, 28), **other))) == 0  # type: ignore[arg-type]


def test_a_car_leaves_when_it_drives_off_hidden_and_is_never_detected_again() -> None:
    """Its first second counts; one that stands has not left, one in view is missed."""
    driving = [5.0] * N
    gone = scene(range(40, 60), range(40, 60), speed=driving)
    assert leaving_gaps(*gone).rows() == [(7, 40, 50)]
    assert not leaving_gaps(*gone).reappear
    assert len(leaving_gaps(*scene(range(40, 60), range(40, 60)))) == 0
    assert len(leaving_gaps(*scene(range(40, 45), range(40, 60), speed=driving))) == 0
    assert len(leaving_gaps(*scene(range(40, 60), range(40, 59), speed=driving))) == 0
    late = scene(range(51, 60), range(51, 60), speed=driving)
    assert len(leaving_gaps(*late)) == 0, "the recording ends within the second"


@pytest.mark.parametrize(
    ("speed", "expected"),
    [
        ([0.0] * N, {"standing", "parked"}),
        ([3.0] * 10 + [0.0] * 50, {"standing"}),
        ([3.0] * 11 + [0.0] * 49, set()),  # moved at the tenth last detection
        ([0.0] * 40 + [3.0] * 20, {"standing"}),  # drives off after what is measured
        ([0.0] * 39 + [3.0] * 21, set()),
        ([0.0] * 20 + [1.0] * 40, {"moving"}),
        ([0.0] * 20 + [0.9] * 40, set()),
        ([5.0] * 21 + [0.0] * 39, {"moving"}),  # moves as the gap begins
    ],
)
def test_populations_are_by_what_the_car_does(speed: list[float], expected: set[str]) -> None:
    """A gap of 25 frames from the 20th on; its first 20 are measured."""
    trace, detections = scene(range(20, 45), range(20, 45), speed=speed)
    gaps = natural_gaps(trace, detections)
    found = populations(trace, detections, gaps)
    assert {name for name, own in found.items() if own} == expected
    assert all(own in ([], [(7, 20, 45)]) for own in found.values())
    assert measured(gaps).rows() == [(7, 20, 40)]


@pytest.mark.parametrize(
    ("missed", "expected"), [([], True), ([18], True), ([19], False), ([30], False)]
)
def test_steady_is_twelve_detections_in_a_row(missed: list[int], expected: bool) -> None:
    """Before a gap that begins with frame 31: from frame 19 to frame 30."""
    _, detections = scene(range(31, 40), [*missed, *range(31, 40)])
    assert steady(detections, (7, 31, 40)) == expected


def test_mds_windows_are_formed_of_as_many() -> None:
    """With one detection fewer MD is the plain filter, with as many it is not."""
    noise = np.random.default_rng(0).normal(0, 0.1, (STEADY, 1, 2))
    alike = []
    for n in (STEADY - 1, STEADY):
        gap = np.full((5, 1, 2), np.nan)
        seen = np.concatenate([noise[:n], gap])
        both = (
            filter_sequence(estimator(name), seen, np.eye(2) / 50, 0.1) for name in ("cj", "md3")
        )
        plain, weighted = (one.position[-1] for one in both)
        alike.append(np.array_equal(plain, weighted))
    assert alike == [True, False]


def test_a_short_gap_is_measured_whole() -> None:
    """Only what is longer than 20 frames is cut."""
    assert measured(gaps_of((1, 5, 9), (2, 5, 25), (3, 5, 26))).rows() == [
        (1, 5, 9),
        (2, 5, 25),
        (3, 5, 25),
    ]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("speed", [4.0, 5.0, 8.0])
def test_the_bus_hides_the_car_as_long_as_the_formula_says(speed: float, seed: int) -> None:
    """passing_bus: wholly hidden for (L - 4.5 m Y'/y') / v, in one gap with all of these frames."""
    whole = (12.0 - 4.5 * (8.0 - 1.275) / (20.0 - 0.9)) / speed
    scenario = scenarios.load("passing_bus", bus_speed=speed)
    trace = sim_bridge.simulate(scenario, seed)
    detections = sim_bridge.detect(trace, "pointrcnn", seed)
    ((car, start, stop),) = natural_gaps(trace, detections).rows()
    frames = trace.frame[trace.rows_of(car)[trace.visible[trace.rows_of(car)] == 0.0]]
    assert abs(len(frames) * trace.dt - whole) <= trace.dt
    assert set(frames.tolist()) <= set(range(start, stop))
    assert not (set(detections.frame[detections.rows_of(car)].tolist()) & set(range(start, stop)))
