"""Detector profiles: YAML files of error statistics into frozen, validated dataclasses."""

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
    """How noise hangs together in time: the shares of its variance that drift and that are fixed
    per object (the rest is white), and the drift's time constant [s]."""

    drift_share: Share
    drift_time: Positive
    fixed_share: Share

    @model_validator(mode="after")
    def _shares(self) -> "Correlation":
        if self.drift_share + self.fixed_share > 1:
            raise ValueError("drift_share + fixed_share exceed 1")
        return self


class Noise(Correlation):
    """Standard deviation constant + per_range r + hidden (1 - visible)."""

    constant: NonNegative
    per_range: NonNegative
    hidden: NonNegative


class Detection(Settings):
    """Probability of detection by range [m] and visible fraction."""

    range: Positive
    range_visible: NonNegative
    range_width: Positive
    visible_floor: Annotated[float, Field(gt=0, le=1)]
    persistence: Annotated[float, Field(ge=0, lt=1)]


class Deviation(Settings):
    """Standard deviations of one measure of size, white and fixed per object [m]."""

    white: NonNegative
    fixed: NonNegative


class Size(Settings):
    """Noise of a box's size."""

    length: Deviation
    width: Deviation
    height: Deviation


class Score(Correlation):
    """The raw score by range [m] and visible fraction."""

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


class Clutter(Settings):
    """False boxes: density [1/m2 per frame], from min_range [m], their scores and sizes [m]."""

    density: Annotated[float, Field(ge=0, le=0.1)]
    min_range: NonNegative
    score_mean: Positive
    length: Normal
    width: Normal
    height: Normal


class Profile(Settings):
    """All that a simulated detector's errors depend on; max_range in metres."""

    name: str
    max_range: Positive
    detection: Detection
    radial: Noise
    lateral: Noise
    vertical: Noise
    yaw: Noise
    size: Size
    score: Score
    clutter: Clutter

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
