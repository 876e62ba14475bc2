"""Sightings into a detector profile: every parameter by greatest likelihood or by moments."""

from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl
from scipy.optimize import least_squares, minimize, minimize_scalar
from scipy.special import gammaln, ndtri
from scipy.stats import kstest, t

from experiments.detectors import dependence
from experiments.detectors.false_boxes import fit_clutter
from experiments.detectors.sightings import ERRORS, Sightings
from mdkf.tables import FloatArray
from sim_bridge.laws import (
    detection_probability,
    error_scale,
    flip_odds,
    flip_probability,
    mean_score,
)
from sim_bridge.profile import Detection, Error, Flip, Profile, Score

MAX_TAIL = 100.0
"""Degrees of freedom beyond which Student's distribution is as good as normal."""
FARTHEST = 0.995
"""Share of the detected cars that are within the profile's range."""
ASIDE = 0.1
"""Cars whose visible part is this far from their middle tell whether boxes follow it [m]."""
DIGITS = 4
"""Digits of a number that is written."""
LEAST = 1e-9
"""Numbers below are written as 0."""


def fit_profile(name: str, seen: Sightings, detections: str) -> Profile:
    """The profile of the detector whose sightings these are, in the folder `detections`.

    Raises `ValueError` if there is too little to fit.
    """
    cars, hits = seen.cars, seen.cars.filter(pl.col("hit"))
    if len(hits) < 1000 or len(seen.clutter) < 100:
        raise ValueError(
            f"{name}: {len(hits)} detected cars and {len(seen.clutter)} false boxes, expected at"
            " least 1000 and 100"
        )
    # KITTI's detectors read a rectangle ahead: its corners are farther than the range elsewhere.
    max_range = float(hits["distance"].quantile(FARTHEST))  # type: ignore[arg-type]
    side_share = _side_share(cars)
    unshifted = cars.with_columns(lateral=pl.col("lateral") - side_share * pl.col("side"))
    errors, fits = {}, {}
    for error in ERRORS:
        errors[error], fits[f"ks_{error}"] = _error(unshifted, error, seen.dt)
    score, fits["ks_score"] = _score(cars, seen)
    document: dict[str, Any] = {
        "name": name,
        "max_range": max_range,
        "side_share": side_share,
        "detection": _detection(cars.filter(pl.col("distance") <= max_range)),
        **{error: errors[error] for error in ("radial", "lateral", "vertical", "yaw")},
        "flip": _flip(cars),
        "size": {error: errors[error] for error in ("length", "width", "height")},
        "score": score,
        "clutter": fit_clutter(seen, max_range, score["lowest"]),
    }
    # How flips and misses hang together needs their probabilities.
    distance, visible, points = _columns(cars, "distance", "visible", "points")
    luck = Detection.model_construct(**document["detection"])
    detected = detection_probability(luck, distance, visible, points) * (distance <= max_range)
    flipped = flip_probability(Flip.model_construct(**document["flip"]), distance, visible)
    hit = cars["hit"].cast(pl.Float64).to_numpy()
    document["detection"] |= dependence.of_events(cars, hit, detected, seen.dt)
    document["flip"] |= dependence.of_events(cars, cars["flip"].to_numpy(), flipped, seen.dt)
    document["evidence"] = {
        "detections": detections,
        "sequences": " ".join(seen.frames),
        "frames": seen.n_frames,
        "cars": len(cars),
        "detected": len(hits),
        "flips": int(hits["flip"].sum()),
        "false_boxes": len(seen.clutter),
        "recall": float(hit.mean()),
        "recall_fitted": float(detected.mean()),
        **fits,
    }
    return Profile.model_validate(rounded(document))


def _columns(table: pl.DataFrame, *names: str) -> list[FloatArray]:
    return [table[name].cast(pl.Float64).to_numpy() for name in names]


def _likeliest(loss: Callable[[FloatArray], float], start: list[float]) -> FloatArray:
    """The arguments of least loss, from the best of a simplex and a gradient search."""
    found = minimize(loss, np.array(start), method="Nelder-Mead", options={"maxiter": 4000})
    finer = minimize(loss, found.x, method="L-BFGS-B")
    best = finer if finer.fun < found.fun else found
    arguments: FloatArray = best.x
    return arguments


def _detection(cars: pl.DataFrame) -> dict[str, float]:
    """P(detected) by range, hiddenness and returns."""
    distance, visible, points = _columns(cars, "distance", "visible", "points")
    hit = cars["hit"].to_numpy()

    def law(p: FloatArray) -> dict[str, float]:
        names = ("range", "range_hidden", "range_width", "half_points")
        return dict(zip(names, np.exp(p).tolist(), strict=True))

    def loss(p: FloatArray) -> float:
        own = Detection.model_construct(**law(p))  # type: ignore[arg-type]
        chance = detection_probability(own, distance, visible, points)
        chance = np.clip(chance, 1e-9, 1.0 - 1e-9)
        return -float(np.mean(np.log(np.where(hit, chance, 1.0 - chance))))

    return law(_likeliest(loss, np.log([65.0, 25.0, 8.0, 2.0]).tolist()))


def _error(cars: pl.DataFrame, name: str, dt: float) -> tuple[dict[str, float], float]:
    """An error's law, and the greatest distance between the distributions, real and fitted."""
    distance, visible, error = _columns(cars, "distance", "visible", name)
    there = ~np.isnan(error)
    r, v, e = distance[there], visible[there], error[there]

    def law(p: FloatArray) -> dict[str, float]:
        constant, near, squared, hidden, tail = np.exp(p[1:])
        return {
            "bias_per_range": float(p[0]) / 1000.0,
            "constant": float(constant),
            "near": float(near),
            "per_range_squared": float(squared) / 1000.0,
            "hidden": float(hidden),
            "tail": float(min(2.05 + tail, MAX_TAIL)),
        }

    def standard(of: dict[str, float]) -> tuple[FloatArray, FloatArray]:
        """The errors in units of their scale, and the scale."""
        scale = error_scale(Error.model_construct(**of), r, v)  # type: ignore[arg-type]
        return (e - of["bias_per_range"] * r) / scale, scale

    def loss(p: FloatArray) -> float:
        of = law(p)
        z, scale = standard(of)
        # scipy's logpdf is the same, and ten times slower.
        n = of["tail"]
        norm = gammaln((n + 1.0) / 2.0) - gammaln(n / 2.0) - 0.5 * np.log(n * np.pi)
        return float(np.mean(0.5 * (n + 1.0) * np.log1p(z * z / n) + np.log(scale)) - norm)

    size = np.log(np.median(np.abs(e)) + 1e-6)
    found = law(_likeliest(loss, [0.0, size, size, size, np.log(0.3), np.log(2.0)]))
    quantile = np.full(len(error), np.nan)
    quantile[there] = t.cdf(standard(found)[0], found["tail"])
    noise = ndtri(np.clip(quantile, 1e-12, 1.0 - 1e-12))
    fit = float(kstest(quantile[there], "uniform").statistic)
    return found | dependence.of_noise(cars, noise, dt), fit


def _side_share(cars: pl.DataFrame) -> float:
    """Share of the way towards the middle of what is visible by which boxes are shifted: that of
    the least mean absolute error, the errors in units of their distance."""
    partly = cars.filter(pl.col("hit") & (pl.col("side").abs() > ASIDE))
    if partly.is_empty():
        return 0.0
    distance, side, lateral = _columns(partly, "distance", "side", "lateral")

    def loss(share: float) -> float:
        return float(np.mean(np.abs(lateral - share * side) / distance))

    # A hundredth moves a box by a centimetre at most: labels tell no more.
    return round(float(minimize_scalar(loss, bounds=(-1.0, 1.0), method="bounded").x), 2)


def _flip(cars: pl.DataFrame) -> dict[str, float]:
    """P(the box looks backwards) by range and hiddenness."""
    hits = cars.filter(pl.col("hit"))
    distance, visible, flip = _columns(hits, "distance", "visible", "flip")

    def law(p: FloatArray) -> dict[str, float]:
        return {"constant": float(p[0]), "per_range": float(p[1]) / 10.0, "hidden": float(p[2])}

    def loss(p: FloatArray) -> float:
        odds = flip_odds(Flip.model_construct(**law(p)), distance, visible)  # type: ignore[arg-type]
        return float(np.mean(np.logaddexp(0.0, odds) - flip * odds))

    return law(_likeliest(loss, [-5.0, 0.3, 1.0]))


def _score(cars: pl.DataFrame, seen: Sightings) -> tuple[dict[str, float], float]:
    """The score's law by least squares, and how far its distribution is from the real one."""
    distance, visible, score = _columns(cars, "distance", "visible", "score")
    there = ~np.isnan(score)
    lowest = float(min(score[there].min(), seen.clutter["score"].to_numpy().min()))
    spread = float(score[there].max()) - lowest

    names = ("ceiling", "constant", "per_range", "hidden", "hidden_range")

    def off(p: FloatArray) -> FloatArray:
        own = Score.model_construct(**dict(zip(names, p.tolist(), strict=True)))
        return score - mean_score(own, distance, visible)

    def off_there(p: FloatArray) -> FloatArray:
        return off(p)[there]

    found = least_squares(
        off_there,
        [lowest + 0.8 * spread, lowest + spread, spread / 80.0, spread / 3.0, 25.0],
        bounds=([-np.inf, -np.inf, 0.0, 0.0, 1.0], [np.inf, np.inf, np.inf, np.inf, 70.0]),
        x_scale=[spread, spread, spread / 80.0, spread, 25.0],
    ).x
    left = off(found)
    deviation = float(np.nanstd(left))
    law = {"lowest": lowest, **dict(zip(names, found.tolist(), strict=True)), "noise": deviation}
    fit = float(kstest(left[there] / deviation, "norm").statistic)
    return law | dependence.of_noise(cars, left, seen.dt), fit


def rounded(value: Any) -> Any:
    """Numbers to so many digits as mean something."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if abs(value) > LEAST else 0.0
    return value
