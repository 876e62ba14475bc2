"""Claim: false boxes come in the numbers, places and lives of their profile.

Expected values are closed forms of the numbers in pointrcnn.yaml; areas are integrated by scipy.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from mdkf.tables import CLUTTER, EgoPath, FloatArray, IntArray
from sim_bridge.clutter import flashes, ghosts
from sim_bridge.profile import Profile
from tests.sim_bridge.measured import LAW, MAX_RANGE, changed, clutter_area
from tests.sim_bridge.worlds import SIZE

CLUTTER_LAW = LAW["clutter"]
FLASHES, GHOSTS = CLUTTER_LAW["flashes"], CLUTTER_LAW["ghosts"]
MIN_RANGE: float = CLUTTER_LAW["min_range"]  # m
LIFE: float = GHOSTS["life"]  # s
REPORTED: float = GHOSTS["reported"]
SIZES = {
    name: stats.norm(CLUTTER_LAW[name]["mean"], CLUTTER_LAW[name]["deviation"]) for name in SIZE
}
DT = 0.1  # s
RARE = 1e-4
"""Probability of a sample that stands against its law: some fifty are looked at here."""
every_speed = pytest.mark.parametrize("speed", [0.0, 5.0, 15.0])  # m/s
either_kind = pytest.mark.parametrize("kind", [flashes, ghosts])

Columns = Mapping[str, NDArray[Any]]
Kind = Callable[[EgoPath, Profile, np.random.Generator], Columns]


@cache
def radial_distribution() -> tuple[FloatArray, FloatArray]:
    distance = np.linspace(MIN_RANGE, MAX_RANGE, 400)
    return distance, np.array([clutter_area(r) for r in distance]) / clutter_area()


def radial_law(distance: FloatArray) -> FloatArray:
    """Cumulative distribution (n,) of false boxes over distances (n,) [m]."""
    share: FloatArray = np.interp(distance, *radial_distribution())
    return share


def profile(
    flashes: dict[str, float] | None = None,
    ghosts: dict[str, float] | None = None,
    lowest: float = 0.0,
) -> Profile:
    """The pointrcnn profile with other numbers of flashes, of ghosts, or another lowest score."""

    def change(numbers: dict[str, Any]) -> None:
        numbers["clutter"]["flashes"] |= flashes or {}
        numbers["clutter"]["ghosts"] |= ghosts or {}
        numbers["score"]["lowest"] = lowest

    return changed(change)


def path(speed: float, n_frames: int) -> EgoPath:
    """A sensor that drives straight on at a steady speed [m/s], neither along x nor along y."""
    way = speed * DT * np.arange(n_frames)
    columns = {
        "frame": np.arange(n_frames),
        "x": 40.0 + 0.8 * way,
        "y": -20.0 - 0.6 * way,
        "z": np.full(n_frames, 1.73),
        "yaw": np.full(n_frames, np.arctan2(-0.6, 0.8)),
    }
    return EgoPath.from_columns(columns, n_frames=n_frames, dt=DT)


def rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng([30, *seed])


def from_sensor(boxes: Columns, ego: EgoPath) -> tuple[FloatArray, FloatArray]:
    """x, y of every box from the sensor [m]."""
    return boxes["x"] - ego.x[boxes["frame"]], boxes["y"] - ego.y[boxes["frame"]]


def poisson_agrees(count: int, mean: float) -> bool:
    """Neither tail of the Poisson distribution is beyond `count` with less than 5 in 10 000."""
    law = stats.poisson(mean)
    return bool(law.cdf(count) > 5e-4 and law.sf(count - 1) > 5e-4)


# --- flashes --------------------------------------------------------------------------------

FLASH_FRAMES = 6000


@cache
def driving_flashes() -> tuple[EgoPath, Columns]:
    ego = path(15.0, FLASH_FRAMES)
    return ego, (flashes(ego, profile(), rng(1)))


def test_flashes_are_poisson_with_the_laws_mean() -> None:
    """In every frame density x effective area of them, by a chi-square test of the counts."""
    ego, boxes = driving_flashes()
    mean = FLASHES["density"] * clutter_area()
    assert poisson_agrees(len(boxes["frame"]), mean * FLASH_FRAMES)
    counts = np.bincount(boxes["frame"], minlength=ego.n_frames)
    most = int(stats.poisson.ppf(0.999, mean))
    observed = np.bincount(np.minimum(counts, most))
    probability = stats.poisson.pmf(np.arange(most), mean)
    expected = FLASH_FRAMES * np.append(probability, 1 - probability.sum())
    assert stats.chisquare(observed, expected).pvalue > RARE


def test_flashes_are_white_in_time() -> None:
    """Their numbers have no correlation from frame to frame, and none comes twice."""
    _, boxes = driving_flashes()
    counts = np.bincount(boxes["frame"], minlength=FLASH_FRAMES)
    for lag in (1, 2, 10):
        assert abs(np.corrcoef(counts[lag:], counts[:-lag])[0, 1]) < 4 / np.sqrt(FLASH_FRAMES)
    for name in ("x", "score", "yaw", "length"):
        assert len(np.unique(boxes[name])) == len(boxes[name])


def test_flashes_lie_around_the_sensor_by_the_laws() -> None:
    """Distances by the effective area, bearings and headings uniform, sizes normal, scores
    exponential; all on the ground and all clutter."""
    ego, boxes = driving_flashes()
    x, y = from_sensor(boxes, ego)
    turn = stats.uniform(-np.pi, 2 * np.pi)
    for values, law in (
        (np.hypot(x, y), radial_law),
        (np.arctan2(y, x), turn.cdf),
        (boxes["yaw"], turn.cdf),
        (boxes["score"], stats.expon(scale=FLASHES["score_mean"]).cdf),
        *((boxes[name], law.cdf) for name, law in SIZES.items()),
    ):
        assert stats.kstest(values, law).pvalue > RARE
    np.testing.assert_array_equal(boxes["z"], boxes["height"] / 2)
    assert (boxes["source"] == CLUTTER).all()
    # Nothing ties distance, bearing and score together.
    together = np.corrcoef([np.hypot(x, y), np.arctan2(y, x), boxes["yaw"], boxes["score"]])
    assert np.abs(together - np.eye(4)).max() < 4.5 / np.sqrt(len(x))


@either_kind
def test_scores_begin_at_the_lowest(kind: Kind) -> None:
    """`lowest` + exponential of mean `score_mean`, whatever the lowest."""
    boxes = kind(path(0.0, 3000), profile(lowest=-3.0), rng(2))
    score = np.unique(boxes["score"])  # a ghost's is one number
    law = stats.expon(-3.0, (FLASHES if kind is flashes else GHOSTS)["score_mean"])
    assert stats.kstest(score, law.cdf).pvalue > RARE


@either_kind
def test_no_density_no_frames_no_boxes(kind: Kind) -> None:
    """Empty columns, and no error."""
    none = profile(flashes={"density": 0.0}, ghosts={"density": 0.0})
    for ego, numbers in ((path(5.0, 100), none), (path(5.0, 0), profile())):
        boxes = kind(ego, numbers, rng(3))
        assert {len(column) for column in boxes.values()} == {0}


# --- ghosts ---------------------------------------------------------------------------------

GHOST_FRAMES = 120_000
APART = 60  # frames after which a ghost has gone on: exp(-6 s / life) is about 0.001


@cache
def haunted(speed: float) -> tuple[EgoPath, Columns]:
    ego = path(speed, GHOST_FRAMES)
    return ego, (ghosts(ego, profile(), rng(4, int(speed))))


def lives(boxes: Columns) -> tuple[IntArray, IntArray]:
    """Rows in order of ghosts and frames, and the ghost of each: size and score name it."""
    _, ghost = np.unique(boxes["score"], return_inverse=True)
    order = np.lexsort((boxes["frame"], ghost))
    return order, ghost[order]


@every_speed
def test_ghosts_are_as_many_at_any_speed(speed: float) -> None:
    """In frames so far apart that they have no ghost in common: a Poisson number of mean
    density x effective area x reported."""
    _, boxes = haunted(speed)
    counts = np.bincount(boxes["frame"], minlength=GHOST_FRAMES)[::APART]
    mean = GHOSTS["density"] * clutter_area() * REPORTED
    assert poisson_agrees(counts.sum(), mean * len(counts))
    # Variance of a Poisson sample's variance: (mean + 2 mean^2) / n.
    bound = 4 * np.sqrt((mean + 2 * mean**2) / len(counts))
    assert counts.var() == pytest.approx(mean, abs=bound)


@every_speed
def test_ghosts_are_there_in_the_first_frame(speed: float) -> None:
    """As many as ever, and in the second and the last of a short drive too."""
    ego, law = path(speed, 20), profile()
    frames = np.concatenate([ghosts(ego, law, rng(5, k))["frame"] for k in range(1000)])
    mean = GHOSTS["density"] * clutter_area() * REPORTED
    for frame in (0, 1, 19):
        assert poisson_agrees(int((frames == frame).sum()), 1000 * mean)


@every_speed
def test_ghosts_lie_ahead_as_behind(speed: float) -> None:
    """Distances by the effective area, on either side of a sensor however fast, and bearings all
    around it."""
    ego, boxes = haunted(speed)
    apart = boxes["frame"] % APART == 0
    x, y = (place[apart] for place in from_sensor(boxes, ego))
    bearing = np.arctan2(y, x) - np.arctan2(-0.6, 0.8)
    bearing = np.arctan2(np.sin(bearing), np.cos(bearing))
    assert stats.kstest(bearing, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > RARE
    for side in (np.cos(bearing) > 0.0, np.cos(bearing) < 0.0):
        assert side.sum() > 1000
        assert stats.kstest(np.hypot(x, y)[side], radial_law).pvalue > RARE


@pytest.mark.parametrize("reported", [REPORTED, 1.0])
def test_ghosts_recur_at_their_place(reported: float) -> None:
    """After a time t at the very same place with probability reported x exp(-t / life)."""
    steady = profile(ghosts={"jitter": 0.0, "reported": reported})
    boxes = ghosts(path(0.0, 20_000), steady, rng(6))
    _, ghost = np.unique(boxes["x"] + 1j * boxes["y"], return_inverse=True)
    keys = ghost * 100_000 + boxes["frame"]
    for lag in (1, 2, 5, 20):
        going_on = boxes["frame"] < 20_000 - lag
        again = np.isin(keys[going_on] + lag, keys).mean()
        assert again == pytest.approx(reported * np.exp(-lag * DT / LIFE), abs=0.012)


def test_gaps_within_a_life_come_one_by_one() -> None:
    """Whether a living ghost is reported has nothing to do with the frame before: with three
    frames known to be of one life, the middle one is there with probability `reported`."""
    boxes = haunted(0.0)[1]
    order, ghost = lives(boxes)
    keys = ghost * 100_000 + boxes["frame"][order]
    both = np.isin(keys + 2, keys)
    between = np.isin(keys[both] + 1, keys)
    assert between.mean() == pytest.approx(REPORTED, abs=0.01)


@every_speed
def test_ghosts_stay_at_their_place_in_the_world(speed: float) -> None:
    """From frame to frame they move by jitter alone, however long they live and however fast the
    sensor drives: x and y each normal, independent, about a fixed place."""
    _, boxes = haunted(speed)
    order, ghost = lives(boxes)
    still = stats.norm(0.0, GHOSTS["jitter"] * np.sqrt(2)).cdf
    for lag in (1, 8):
        same = ghost[lag:] == ghost[:-lag]
        # One difference for a ghost, so that they are independent.
        pairs = np.flatnonzero(same)
        pairs = pairs[np.unique(ghost[pairs], return_index=True)[1]]
        assert len(pairs) > 1000
        steps = np.array(
            [boxes[c][order[pairs + lag]] - boxes[c][order[pairs]] for c in ("x", "y")]
        )
        for moved in steps:
            assert stats.kstest(moved, still).pvalue > RARE
        assert abs(np.corrcoef(steps)[0, 1]) < 4.5 / np.sqrt(len(pairs))


def test_a_ghost_is_the_same_box_all_its_life() -> None:
    """Score, size, height and heading are one for a ghost and another for the next."""
    _, boxes = haunted(5.0)
    order, ghost = lives(boxes)
    first = np.unique(ghost, return_index=True)[1]
    for name in ("yaw", "z", "length", "width", "height"):
        values = boxes[name][order]
        np.testing.assert_array_equal(values, values[first][ghost])
        assert len(np.unique(values[first])) == len(first)
    assert len(first) > 10_000
    assert len(order) > 2 * len(first)


def test_ghosts_sizes_headings_and_scores_are_the_laws() -> None:
    """Taken once a ghost: normal, uniform, exponential; all on the ground and all clutter."""
    _, boxes = haunted(15.0)
    order, ghost = lives(boxes)
    first = order[np.unique(ghost, return_index=True)[1]]
    for name, law in (
        ("yaw", stats.uniform(-np.pi, 2 * np.pi)),
        ("score", stats.expon(scale=GHOSTS["score_mean"])),
        *SIZES.items(),
    ):
        assert stats.kstest(boxes[name][first], law.cdf).pvalue > RARE
    np.testing.assert_array_equal(boxes["z"], boxes["height"] / 2)
    assert (boxes["source"] == CLUTTER).all()


@every_speed
def test_no_ghost_is_reported_out_of_range(speed: float) -> None:
    """Neither nearer than min_range nor farther than max_range, jitter included."""
    ego, boxes = haunted(speed)
    distance = np.hypot(*from_sensor(boxes, ego))
    assert distance.min() >= MIN_RANGE
    assert distance.max() <= MAX_RANGE


@either_kind
def test_the_same_stream_gives_the_same_boxes(kind: Kind) -> None:
    """Byte for byte; another stream gives others."""
    ego = path(15.0, 50)
    first, again, other = (kind(ego, profile(), rng(seed)) for seed in (7, 7, 8))
    for name, column in first.items():
        np.testing.assert_array_equal(column, again[name])
    assert not np.isin(first["x"], other["x"]).any()
