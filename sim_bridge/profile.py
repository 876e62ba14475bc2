"""Detector profiles: YAML files of error statistics into frozen, validated dataclasses.

r is the distance from the sensor along the ground [m], v the visible fraction. What hangs together
in time is a standard normal process z of unit variance, its parts white, drifting (first-order
Markov) and fixed per object; `sim_bridge.detect` says what is made of it.
"""

import difflib
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from scenarios.settings import Settings, read_settings

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]

_FOLDER = Path(__file__).with_name("detectors")


class ProfileError(ValueError):
    """A detector profile that cannot be used; the message is one line."""


class Correlation(Settings):
    """How z hangs together in time: the shares of its variance that drift and that are fixed per
    object (the rest is white), and the drift's time constant [s]."""

    drift_share: Share
    drift_time: Positive
    fixed_share: Share

    @model_validator(mode="after")
    def _shares(self) -> "Correlation":
        if self.drift_share + self.fixed_share > 1:
            raise ValueError("drift_share + fixed_share exceed 1")
        return self


class Detection(Correlation):
    """P(detected) = sigmoid((range - range_hidden (1 - v) - r) / range_width)
    * (1 - 2^(-points / half_points)); ranges in metres."""

    range: Positive
    range_hidden: NonNegative
    range_width: Positive
    half_points: NonNegative


class Error(Correlation):
    """An error of bias_per_range r + scale t, t of Student's distribution with `tail` degrees of
    freedom, scale = (constant + near / max(r, 3 m) + per_range_squared r^2) (1 + hidden (1 - v)^2).

    Of lengths: constant [m], near [m2], per_range_squared [1/m]; of angles: constant [rad], near
    [rad m], per_range_squared [rad/m2], bias_per_range [rad/m]. Few degrees of freedom are heavy
    tails. Close by, the line of sight often runs across a car, along which boxes are the less sure.
    """

    bias_per_range: float
    constant: NonNegative
    near: NonNegative
    per_range_squared: NonNegative
    hidden: NonNegative
    tail: Annotated[float, Field(gt=2, le=1000)]


class Flip(Correlation):
    """P(the box looks backwards) = sigmoid(constant + per_range r + hidden (1 - v))."""

    constant: float
    per_range: float
    hidden: float


class Size(Settings):
    """Errors of a box's size."""

    length: Error
    width: Error
    height: Error


class Score(Correlation):
    """The raw score: lowest + |min(ceiling, constant - per_range r)
    - hidden (1 - v) min(1, r / hidden_range) + noise z - lowest|."""

    lowest: float
    ceiling: float
    constant: float
    per_range: NonNegative
    hidden: NonNegative
    hidden_range: Positive
    noise: NonNegative


class Normal(Settings):
    """A normal distribution."""

    mean: Positive
    deviation: NonNegative


class Flashes(Settings):
    """False boxes of one frame: density [1/m2]; their scores begin at the lowest and have an
    exponential distribution of mean `score_mean` above it."""

    density: Annotated[float, Field(ge=0, le=0.1)]
    score_mean: Positive


class Ghosts(Flashes):
    """False boxes that stay where they are: density [1/m2] of those alive at a time, their mean
    life [s], the share of it in which each is reported, and the standard deviation of its
    position from frame to frame, x and y each [m]."""

    life: Positive
    reported: Share
    jitter: NonNegative


class Clutter(Settings):
    """False boxes from min_range [m] on, their sizes [m]. Both densities hold near the sensor;
    they fall with distance as sigmoid((reach - r) / reach_width)."""

    min_range: NonNegative
    reach: Positive
    reach_width: Positive
    flashes: Flashes
    ghosts: Ghosts
    length: Normal
    width: Normal
    height: Normal


class Pose(Settings):
    """How wrongly the sensor's own pose is known: standard deviations of x and y each [m] and of
    the yaw [rad], and the time constant with which the error drifts [s]."""

    position: NonNegative
    yaw: NonNegative
    drift_time: Positive


class Profile(Settings):
    """All that a simulated detector's errors depend on.

    max_range: nothing farther away is detected [m]; side_share: share of the way from a box's
    middle to the middle of what is visible of it, across the line of sight, by which it is shifted;
    pose: none means exactly known; evidence: what the numbers were measured on, and how well they
    fit.
    """

    name: str
    max_range: Positive
    detection: Detection
    radial: Error
    lateral: Error
    vertical: Error
    yaw: Error
    flip: Flip
    size: Size
    score: Score
    clutter: Clutter
    side_share: Annotated[float, Field(ge=-1, le=1)] = 0.0
    pose: Pose | None = None
    evidence: dict[str, str | int | float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _ring(self) -> "Profile":
        if self.clutter.min_range >= self.max_range:
            raise ValueError("clutter.min_range must be below max_range")
        return self


def profile_names() -> tuple[str, ...]:
    """The profiles that come with the package."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


def load_profile(name: str | Path) -> Profile:
    """The profile of a name, or of a path to a YAML file.

    Raises `ProfileError`, one line, for an unknown name, unreadable YAML, an unknown or missing
    key, or a value out of bounds.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        if str(name) not in profile_names():
            close = difflib.get_close_matches(str(name), profile_names(), n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            known = ", ".join(profile_names())
            raise ProfileError(f"unknown detector {str(name)!r}{hint}; known detectors: {known}")
        path = _FOLDER / f"{name}.yaml"
    return read_settings(path, lambda _: Profile, ProfileError)
