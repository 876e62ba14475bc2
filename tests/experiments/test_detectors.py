"""Claim: `fit-detector` finds the parameters that made the detections it is given."""

from functools import cache

import numpy as np
import polars as pl
import pytest
from scipy import stats

from experiments.detectors.compare import Row, compare, distances
from experiments.detectors.dependence import fit_law
from experiments.detectors.fit import fit_profile
from experiments.detectors.interpolate import BASE, PRECISION, interpolated
from experiments.detectors.sightings import ERRORS, Sightings, sightings
from experiments.detectors.tables import comparison_table, distance_line, verdict
from mdkf.tables import FloatArray
from sim_bridge import Profile, detect, load_profile
from sim_bridge.clutter import nearness
from sim_bridge.laws import detection_probability, error_scale, flip_probability
from tests.sim_bridge.worlds import convoy

CARS, FRAMES, WORLDS = 800, 50, 3


@cache
def made(name: str, seed: int = 0) -> Sightings:
    """What a profile of the package makes of cars at all distances, hidden more and less.

    The cars keep their places by the driving sensor, so they are of every kind for long.
    """
    parts = []
    for k in range(WORLDS):
        rng = np.random.default_rng([seed, k])
        distance, visible = rng.uniform(4.0, 69.0, CARS), rng.uniform(0.05, 1.0, CARS)
        trace = convoy(distance, np.linspace(-3, 3, CARS), visible, FRAMES, seed=f"{seed} {k}")
        level = np.digitize(trace.visible, [0.4, 0.8])
        every = np.ones(len(trace), dtype=np.bool_)
        found = detect(trace, load_profile(name), seed)
        parts.append(sightings(str(k), trace, found, 2 - level, every))
    # Long, and without cars: ghosts are few at a time.
    empty = convoy([], [], [], 20_000, seed=f"{seed} empty")
    found = detect(empty, load_profile(name), seed)
    nothing = np.empty(0, dtype=np.int64)
    parts.append(sightings("empty", empty, found, nothing, nothing.astype(np.bool_)))
    return Sightings.joined(parts)


@cache
def refitted() -> tuple[Profile, Profile]:
    """The profile, and what a fit to its own detections makes of it."""
    return load_profile("pointrcnn"), fit_profile("pointrcnn", made("pointrcnn"), "made")


def grid() -> tuple[FloatArray, FloatArray]:
    """Distances [m] and visible fractions at which laws are compared."""
    r, v = np.meshgrid(np.linspace(5.0, 65.0, 13), np.linspace(0.2, 1.0, 5))
    return r.ravel(), v.ravel()


def test_the_chance_of_detection_is_found() -> None:
    """At every distance and visible fraction, to five points of a hundred: cars are
    lucky or not for long, so that 2400 of them tell no more."""
    given, found = refitted()
    r, v = grid()
    points = np.full(len(r), 50.0)
    a, b = (detection_probability(of.detection, r, v, points) for of in (given, found))
    apart = b - a
    assert np.abs(apart[r < found.max_range]).max() < 0.05


@pytest.mark.parametrize("error", ERRORS)
def test_the_size_of_errors_is_found(error: str) -> None:
    """The median error at every distance and visible fraction to 12 %, so often the fits' own
    spread; heavy tails are found as such."""
    laws = [getattr(p, error, None) or getattr(p.size, error) for p in refitted()]
    medians = [error_scale(law, *grid()) * stats.t.ppf(0.75, law.tail) for law in laws]
    np.testing.assert_allclose(medians[1], medians[0], rtol=0.12)
    assert 1 / laws[1].tail == pytest.approx(1 / laws[0].tail, abs=0.05)


def test_what_hangs_together_is_found() -> None:
    """Correlations a frame, a second and three seconds apart, to 0.08, of errors and of luck."""
    given, found = refitted()
    for law in ("detection", "radial", "lateral", "vertical", "yaw", "score", "flip"):
        for time in (0.1, 1.0, 3.0):
            a, b = (
                own.drift_share * np.exp(-time / own.drift_time) + own.fixed_share
                for own in (getattr(given, law), getattr(found, law))
            )
            assert b == pytest.approx(a, abs=0.08), (law, time)


def test_flips_scores_and_clutter_are_found() -> None:
    """Flips to half a point of a hundred where they are rare; scores; density at every distance,
    life and jitter of ghosts to 12 %."""
    given, found = refitted()
    r, v = grid()
    a, b = flip_probability(given.flip, r, v), flip_probability(found.flip, r, v)
    np.testing.assert_allclose(b, a, atol=0.005 + 0.15 * a.max())
    assert found.score.noise == pytest.approx(given.score.noise, rel=0.05)
    for law in ("flashes", "ghosts"):
        own, other = getattr(given.clutter, law), getattr(found.clutter, law)
        densities = (
            of.density * nearness(p.clutter, r) for of, p in ((other, found), (own, given))
        )
        np.testing.assert_allclose(*densities, rtol=0.12)
        assert other.score_mean == pytest.approx(own.score_mean, rel=0.12)
    ghosts, again = given.clutter.ghosts, found.clutter.ghosts
    # Ghosts that leave the picture seem to end.
    assert 0.8 * ghosts.life < again.life < 1.05 * ghosts.life
    assert again.reported == pytest.approx(ghosts.reported, rel=0.05)
    assert again.jitter == pytest.approx(ghosts.jitter, rel=0.1)


def test_a_detector_is_like_itself_and_unlike_another() -> None:
    """Of another seed's detections all judged comparisons hold; of another detector's not."""
    itself = compare(made("pointrcnn"), made("pointrcnn", seed=1))
    judged = [row for row in itself if row.within is not None]
    assert len(judged) >= 30
    assert sum(bool(row.within) for row in judged) >= 0.9 * len(judged)
    assert max(distances(made("pointrcnn"), made("pointrcnn", seed=1)).values()) < 0.05
    other = [row for row in compare(made("pointrcnn"), made("second")) if row.within is not None]
    assert sum(bool(row.within) for row in other) < 0.7 * len(other)
    assert max(distances(made("pointrcnn"), made("second")).values()) > 0.3


def test_a_detector_that_reports_nothing_is_compared_all_the_same() -> None:
    """It has a recall, of 0, and no false boxes; what it has no values of is left out, not NaN."""
    seen = made("pointrcnn")
    cars = seen.cars.with_columns(
        pl.lit(False).alias("hit"),
        *(pl.lit(float("nan")).alias(name) for name in (*ERRORS, "flip", "score")),
    )
    blind = Sightings(cars, seen.clutter.clear(), seen.frames, seen.dt)
    rows = compare(blind, seen)
    assert {row.what for row in rows} == {"recall", "miss after miss", "false boxes"}
    assert all(row.real == (row.what == "miss after miss") for row in rows)
    assert distances(blind, seen) == {}
    assert "none" in distance_line({})


def test_a_law_is_found_from_its_own_correlations() -> None:
    """Exactly, where there is no noise; white noise is white."""
    time = np.array([0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
    law = fit_law(time, 0.5 * np.exp(-time / 0.8) + 0.2, np.ones(6))
    assert law["drift_share"] == pytest.approx(0.5, abs=0.01)
    assert law["drift_time"] == pytest.approx(0.8, rel=0.05)
    assert law["fixed_share"] == pytest.approx(0.2, abs=0.01)
    white = fit_law(time, np.zeros(6), np.ones(6))
    assert white["drift_share"] == white["fixed_share"] == 0.0


def test_too_little_to_fit_is_refused() -> None:
    """With what there is and what is needed."""
    seen = made("pointrcnn")
    few = Sightings(seen.cars.head(500), seen.clutter, seen.frames, seen.dt)
    with pytest.raises(ValueError, match=r"mine: \d+ detected cars .* at least 1000"):
        fit_profile("mine", few, "made")


def test_the_table_tells_limits_from_chance() -> None:
    """yes within the limit, in CI beyond it but no farther than the recorded value is known, no
    otherwise, a dash where nothing is asked; the title counts them."""
    common = {"what": "recall", "of": "all", "real": 0.9, "low": 0.8, "high": 0.96}
    rows = [
        Row(**common, simulated=0.92, limit=0.03, within=True),
        Row(**common, simulated=0.84, limit=0.03, within=False),
        Row(**common, simulated=0.7, limit=0.03, within=False),
        Row(**common, simulated=0.7, limit=None, within=None),
    ]
    assert [verdict(row) for row in rows] == ["yes", "in CI", "no", "–"]
    title = str(comparison_table("mine", rows).title)
    assert "1 of 3 within the limits" in title
    assert "1 more within the 95 % interval" in title


@pytest.mark.parametrize("name", sorted(PRECISION.keys() - {BASE}))
def test_guessed_profiles_are_what_their_rule_gives(name: str) -> None:
    """The shipped file of each detector without recordings, after any new fit of the base."""
    assert load_profile(name) == interpolated(name)
    assert "detections" not in load_profile(name).evidence
