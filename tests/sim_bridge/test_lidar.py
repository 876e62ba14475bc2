"""Claim: a LiDAR that cannot be is refused, with what was given and what was expected."""

import math

import pytest

from sim_bridge.lidar import Lidar


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("rays", 15, "rays: expected at least 16, got 15"),
        ("beams", 65, "beams: expected 2 to 64, got 65"),
        ("beams", 1, "beams: expected 2 to 64, got 1"),
        ("lowest", 0.1, "expected elevations within 1.396 rad, the second above"),
        ("lowest", -1.5, "expected elevations within 1.396 rad, the second above"),
        ("highest", math.nan, "expected elevations within 1.396 rad, the second above"),
        ("max_range", 0.0, "max_range: expected a distance above 0 m"),
    ],
)
def test_impossible_lidars_are_refused(field: str, value: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Lidar(**{field: value})  # type: ignore[arg-type]
