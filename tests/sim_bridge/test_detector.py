"""Claim: a detector's errors follow the laws of its profile.

Expected values are closed forms and scipy's distributions of the numbers in pointrcnn.yaml, not
taken from the code.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from mdkf.tables import CLUTTER, FloatArray
from sim_bridge import detect
from tests.sim_bridge.measured import (
    ERRORS,
    LAW,
    autocorrelation,
    changed,
    clutter_area,
    dense,
    errors_of,
    quiet,
)
from tests.sim_bridge.worlds import convoy

every_error = pytest.mark.parametrize("name", ERRORS)

# Distance [m] and visible fraction; together they separate all terms of every law.
CELLS = ((5.0, 1.0), (8.0, 0.1), (30.0, 0.55), (40.0, 1.0), (60.0, 0.9), (65.0, 0.5))
PER_CELL, N_FRAMES = 8000, 8
CHANCE = 1e-4  # of a false alarm of one of a hundred comparisons
FAR = 66.0  # m: here many objects are missed and many boxes look backwards


@cache
def cells() -> dict[str, FloatArray]:
    """Errors of `PER_CELL` objects in each cell, at bearings all around: (cells, objects,
    frames)."""
    distance, visible = np.repeat(np.array(CELLS), PER_CELL, axis=0).T
    trace = convoy(distance, np.arange(len(distance)) * 2.4, visible, N_FRAMES)
    table = dense(trace, detect(trace, seed=1))
    return {name: e.reshape(len(CELLS), PER_CELL, N_FRAMES) for name, e in table.items()}


@cache
def column_of_cars(dt: float) -> dict[str, FloatArray]:
    """Errors of 1000 objects in full view at 20 m."""
    trace = convoy(20.0, np.linspace(-3, 3, 1000), 1.0, 150, dt)
    return dense(trace, detect(trace, seed=2))


@cache
def far_cars() -> dict[str, FloatArray]:
    """Errors of 3000 objects in full view at `FAR`."""
    trace = convoy(FAR, np.linspace(-3, 3, 3000), 1.0, 50)
    return dense(trace, detect(trace, seed=3))


def scale(name: str, r: float, v: float) -> float:
    """Scale of an error's distribution at r [m], visible fraction v."""
    law = ERRORS[name]
    by_range = law["constant"] + law["near"] / max(r, 3.0) + law["per_range_squared"] * r**2
    return float(by_range * (1 + law["hidden"] * (1 - v) ** 2))


def rate(r: float, v: float) -> float:
    """Probability of detection with returns in plenty."""
    law = LAW["detection"]
    return float(expit((law["range"] - law["range_hidden"] * (1 - v) - r) / law["range_width"]))


def flip_rate(r: float, v: float) -> float:
    law = LAW["flip"]
    return float(expit(law["constant"] + law["per_range"] * r + law["hidden"] * (1 - v)))


def mean_score(r: float, v: float) -> float:
    """Before noise, and before what is below the lowest is turned upwards."""
    law = LAW["score"]
    hidden = law["hidden"] * (1 - v) * min(1.0, r / law["hidden_range"])
    return float(min(law["ceiling"], law["constant"] - law["per_range"] * r) - hidden)


def student(name: str, r: float, v: float, errors: FloatArray) -> FloatArray:
    """Errors in scales, without bias."""
    return (errors - ERRORS[name]["bias_per_range"] * r) / scale(name, r, v)


def normal(name: str, r: float, v: float, errors: FloatArray) -> FloatArray:
    """The standard normal numbers behind errors: those of the same probability."""
    if name == "score":
        return (errors - mean_score(r, v)) / LAW["score"]["noise"]
    numbers = student(name, r, v, errors)
    # By lower probabilities, which keep their digits.
    lower = stats.norm.ppf(stats.t.cdf(-np.abs(numbers), ERRORS[name]["tail"]))
    return np.copysign(lower, numbers)


def correlation(law: dict[str, float], time: float) -> float:
    """Autocorrelation of a law's normal numbers after a time [s]."""
    drift = law["drift_share"] * np.exp(-time / law["drift_time"])
    return float(drift + law["fixed_share"])


def twice(probability: float, correlation: float) -> float:
    """Probability that two standard normal numbers are both below the same quantile."""
    quantile = stats.norm.ppf(probability)
    law = stats.multivariate_normal([0, 0], [[1, correlation], [correlation, 1]])
    return float(law.cdf([quantile, quantile]))


# --- laws -----------------------------------------------------------------------------------


def test_detection_rates_are_the_profiles() -> None:
    """In each cell: sigmoid((range - range_hidden (1 - v) - r) / range_width), within 1.5 %; there
    are returns enough."""
    for cell, (r, v) in enumerate(CELLS):
        assert cells()["seen"][cell].mean() == pytest.approx(rate(r, v), abs=0.015), (r, v)


@every_error
def test_scales_are_the_profiles(name: str) -> None:
    """In each cell errors have the median bias_per_range r, and half of them are within the
    quartile of Student's distribution, in scales (constant + near / r + per_range_squared r^2)
    (1 + hidden (1 - v)^2), within 4 %."""
    quartile = stats.t.ppf(0.75, ERRORS[name]["tail"])
    for cell, (r, v) in enumerate(CELLS):
        errors = cells()[name][cell]
        unbiased = errors - ERRORS[name]["bias_per_range"] * r
        expected = quartile * scale(name, r, v)
        assert np.nanmedian(np.abs(unbiased)) == pytest.approx(expected, rel=0.04), (r, v)
        assert abs(np.nanmedian(unbiased)) < 0.1 * expected


def test_the_near_term_stops_at_three_metres() -> None:
    """An object's noise is the same numbers wherever it is, so that errors at 2.6 m, 3 m and 6 m
    are to each other, exactly, as constant + near / max(r, 3 m) + per_range_squared r^2."""
    numbers = []
    for r in (2.6, 3.0, 6.0):
        trace = convoy(r, np.arange(20) * 2.4, 1.0, 3)
        errors = dense(trace, detect(trace, seed=22))
        numbers.append(
            {
                name: student(name, r, 1.0, errors[name])
                for name in ("radial", "lateral", "vertical")
            }
        )
    for name in numbers[0]:
        assert ERRORS[name]["near"] > 0.0
        for others in numbers[1:]:
            np.testing.assert_allclose(others[name], numbers[0][name], rtol=1e-6, atol=1e-6)


@every_error
@pytest.mark.parametrize("frame", [0, N_FRAMES - 1])
def test_tails_are_the_profiles(name: str, frame: int) -> None:
    """In scales, errors of independent objects have Student's distribution: all of it by a
    Kolmogorov-Smirnov test, and beyond 3 and 6 scales as many as binomial chance allows."""
    tail = ERRORS[name]["tail"]
    of_cells = [
        student(name, r, v, cells()[name][cell, :, frame]) for cell, (r, v) in enumerate(CELLS)
    ]
    errors = np.concatenate(of_cells)
    errors = errors[~np.isnan(errors)]
    assert len(errors) > 30_000
    assert stats.kstest(errors, stats.t(tail).cdf).pvalue > CHANCE
    for scales in (3.0, 6.0):
        beyond = int((np.abs(errors) > scales).sum())
        assert stats.binomtest(beyond, len(errors), 2 * stats.t.sf(scales, tail)).pvalue > CHANCE


@every_error
def test_bias_grows_with_range(name: str) -> None:
    """Without noise, an error of bias_per_range r: away from the sensor, to the left, upwards,
    counter-clockwise, larger; nothing else is off."""

    def biased(profile: dict[str, Any]) -> None:
        quiet(profile)
        errors_of(profile)[name]["bias_per_range"] = 0.004

    distance = np.array([5.0, 30.0, 65.0])
    trace = convoy(distance, [0.3, 2.0, -2.5], 1.0, 5)
    table = dense(trace, detect(trace, changed(biased), seed=1))
    for other in ERRORS:
        expected = 0.004 * distance if other == name else np.zeros(3)
        np.testing.assert_allclose(table[other], np.tile(expected[:, None], 5), atol=1e-12)


@every_error
@pytest.mark.parametrize("dt", [0.1, 0.2])
def test_errors_hang_together_in_time(name: str, dt: float) -> None:
    """The autocorrelation of the normal numbers behind errors after a time t is
    drift_share exp(-t / drift_time) + fixed_share, whatever the frame rate."""
    numbers = normal(name, 20.0, 1.0, column_of_cars(dt)[name])
    for lag in (1, 5, 20):
        expected = correlation(ERRORS[name], lag * dt)
        assert autocorrelation(numbers, lag) == pytest.approx(expected, abs=0.035)


@pytest.mark.parametrize("name", [*ERRORS, "score"])
def test_noise_is_stationary_from_the_first_frame(name: str) -> None:
    """An object that has just appeared is measured as badly as one seen for long."""
    numbers = normal(name, 20.0, 1.0, column_of_cars(0.1)[name])
    overall = np.sqrt(np.nanmean(numbers**2))
    assert np.sqrt(np.nanmean(numbers[:, 0] ** 2)) == pytest.approx(overall, rel=0.1)


def test_errors_of_different_kinds_are_independent() -> None:
    """Radial, lateral, vertical and yaw errors, sizes and scores have no correlation, neither
    with each other nor with those of another object."""
    table = column_of_cars(0.1)
    names = (*ERRORS, "score")
    seen = ~np.isnan(table["score"])
    errors = np.array([normal(name, 20.0, 1.0, table[name][seen]) for name in names])
    assert np.abs(np.corrcoef(errors) - np.eye(len(names))).max() < 0.08
    radial = normal("radial", 20.0, 1.0, table["radial"])
    assert abs(np.nanmean(radial[1:] * radial[:-1]) / np.nanmean(radial**2)) < 0.05


def test_flips_and_misses_are_independent_of_errors() -> None:
    """Whether a box looks backwards has no correlation with its errors, nor how often an object
    is seen with how it is measured on average, nor two objects' misses."""
    table = far_cars()
    names = (*ERRORS, "score")
    seen = table["seen"] == 1
    errors = [normal(name, FAR, 1.0, table[name]) for name in names]
    flips = np.corrcoef([table["flip"][seen], *(e[seen] for e in errors)])
    assert np.abs(flips[0, 1:]).max() < 0.08
    ever = seen.any(axis=1)
    luck = [table["seen"][ever].mean(axis=1), np.nanmean(table["flip"][ever], axis=1)]
    of_objects = np.corrcoef([*luck, *(np.nanmean(e[ever], axis=1) for e in errors)])
    assert np.abs(of_objects - np.eye(len(of_objects))).max() < 0.08
    missed = table["seen"] - table["seen"].mean()
    assert abs((missed[1:] * missed[:-1]).mean() / (missed**2).mean()) < 0.05


def test_misses_come_in_bursts() -> None:
    """Being seen is a correlated normal number below a quantile: its autocorrelation and the
    share of misses that follow a miss are those of two such numbers."""
    seen, p = far_cars()["seen"], rate(FAR, 1.0)
    assert seen.mean() == pytest.approx(p, abs=0.015)
    for lag in (1, 2, 4):
        both = twice(p, correlation(LAW["detection"], 0.1 * lag))
        expected = (both - p**2) / (p * (1 - p))
        assert autocorrelation(seen - p, lag) == pytest.approx(expected, abs=0.015)
    missed = seen == 0
    again = missed[:, 1:][missed[:, :-1]].mean()
    expected = twice(1 - p, correlation(LAW["detection"], 0.1)) / (1 - p)
    assert again == pytest.approx(expected, abs=0.01)


def test_boxes_look_backwards_at_the_profiles_rate() -> None:
    """In each cell sigmoid(constant + per_range r + hidden (1 - v)) of independent objects do, as
    binomial chance allows, in the first frame as in the last; what they are turned by is half a
    turn and the same error as others have."""
    for frame in (0, N_FRAMES - 1):
        for cell, (r, v) in enumerate(CELLS):
            flips = cells()["flip"][cell, :, frame]
            flips = flips[~np.isnan(flips)]
            chance = stats.binomtest(int(flips.sum()), len(flips), flip_rate(r, v))
            assert chance.pvalue > CHANCE, (r, v)
    r, v = CELLS[-1]
    errors = student("yaw", r, v, cells()["yaw"][-1, :, 0])[cells()["flip"][-1, :, 0] == 1]
    assert len(errors) > 300
    assert stats.kstest(errors, stats.t(LAW["yaw"]["tail"]).cdf).pvalue > CHANCE


def test_boxes_look_backwards_for_a_while() -> None:
    """Flips hang together in time: of two detections some frames apart, both are flipped as often
    as two correlated normal numbers are below the rate's quantile; at even odds the flips'
    autocorrelation is 2 / pi asin of the numbers'."""
    flips, p = far_cars()["flip"], flip_rate(FAR, 1.0)

    def even(profile: dict[str, Any]) -> None:
        profile["flip"] |= {"constant": 0.0, "per_range": 0.0, "hidden": 0.0}

    trace = convoy(20.0, np.linspace(-3, 3, 2000), 1.0, 50)
    signs = 2 * dense(trace, detect(trace, changed(even), seed=21))["flip"] - 1
    for lag in (1, 4, 20):
        together = correlation(LAW["flip"], 0.1 * lag)
        both = np.nanmean(flips[:, lag:] * flips[:, :-lag])
        assert both == pytest.approx(twice(p, together), abs=0.01), lag
        expected = 2 / np.pi * np.arcsin(together)
        assert autocorrelation(signs, lag) == pytest.approx(expected, abs=0.02), lag


def test_scores_are_the_profiles() -> None:
    """Mean and deviation are those of |min(ceiling, constant - per_range r) - hidden (1 - v)
    min(1, r / hidden_range) + noise N|; noise drifts and is fixed by the score's shares."""
    noise = LAW["score"]["noise"]
    assert LAW["score"]["lowest"] == 0.0
    for cell, (r, v) in enumerate(CELLS):
        folded = stats.foldnorm(abs(mean_score(r, v)) / noise, scale=noise)
        scores = cells()["score"][cell]
        assert np.nanmean(scores) == pytest.approx(folded.mean(), abs=0.25), (r, v)
        assert np.nanstd(scores) == pytest.approx(folded.std(), rel=0.05), (r, v)
        assert np.nanmin(scores) >= 0.0
        first = scores[:, 0][~np.isnan(scores[:, 0])]
        assert stats.kstest(first, folded.cdf).pvalue > CHANCE, (r, v)
    numbers = normal("score", 20.0, 1.0, column_of_cars(0.1)["score"])
    for lag in (1, 5, 20):
        expected = correlation(LAW["score"], 0.1 * lag)
        assert autocorrelation(numbers, lag) == pytest.approx(expected, abs=0.035)


def test_scores_are_turned_upwards_at_the_lowest() -> None:
    """Whatever the lowest is, none is below it, and what would be is as far above."""

    def raised(profile: dict[str, Any]) -> None:
        profile["score"] |= {"lowest": 11.0, "noise": 3.0}

    trace = convoy(20.0, np.linspace(-3, 3, 4000), 1.0, 1)
    scores = dense(trace, detect(trace, changed(raised), seed=4))["score"]
    above = mean_score(20.0, 1.0) - 11.0
    law = stats.foldnorm(above / 3.0, loc=11.0, scale=3.0)
    assert 0.0 < above < 3.0
    assert stats.kstest(scores[~np.isnan(scores)], law.cdf).pvalue > 1e-3


def test_clutter_is_all_around_the_sensor() -> None:
    """On an empty road as many false boxes, within 3 %, as density x area of flashes and reported
    ghosts together, uniform in bearing around the driving sensor, and all of them clutter."""
    trace = convoy([], [], [], 30_000)
    clutter = detect(trace, seed=4)
    assert (clutter.source == CLUTTER).all()
    law = LAW["clutter"]
    density = law["flashes"]["density"] + law["ghosts"]["density"] * law["ghosts"]["reported"]
    assert len(clutter) / 30_000 == pytest.approx(density * clutter_area(), rel=0.03)
    apart = clutter.frame % 60 == 0  # no ghost lives as long
    x = (clutter.x - trace.ego.x[clutter.frame])[apart]
    y = (clutter.y - trace.ego.y[clutter.frame])[apart]
    bearing = stats.uniform(-np.pi, 2 * np.pi)
    assert stats.kstest(np.arctan2(y, x), bearing.cdf).pvalue > 1e-3


def test_errors_are_aligned_with_the_line_of_sight() -> None:
    """Seen in eight directions from a moving sensor, whatever way the objects look, the
    covariance of (x, y) errors has its axes along and across the line of sight; with 1000 degrees
    of freedom, for few have no covariance that could be measured."""

    def light_tailed(profile: dict[str, Any]) -> None:
        for error in errors_of(profile).values():
            error |= {"tail": 1000.0, "bias_per_range": 0.0}

    bearings = np.repeat(np.arange(8) * np.pi / 4 + 0.2, 400)
    trace = convoy(50.0, bearings, 1.0, 40)
    table = dense(trace, detect(trace, changed(light_tailed), seed=5))
    radial, lateral = scale("radial", 50.0, 1.0), scale("lateral", 50.0, 1.0)
    for k, bearing in enumerate(bearings[::400]):
        rows = slice(400 * k, 400 * (k + 1))
        errors = np.stack([table[c][rows][table["seen"][rows] == 1] for c in "xy"])
        measured = errors @ errors.T / errors.shape[1]
        along = np.array([np.cos(bearing), np.sin(bearing)])
        across = np.array([-along[1], along[0]])
        expected = radial**2 * np.outer(along, along) + lateral**2 * np.outer(across, across)
        np.testing.assert_allclose(measured, expected, atol=0.12 * radial**2)
