"""A profile as a YAML file that says what its numbers mean."""

import inspect
import textwrap

import yaml

from sim_bridge import profile as laws
from sim_bridge.profile import Profile

_EXPLAINED = (
    ("detection", laws.Detection),
    ("radial, lateral, vertical, yaw, size", laws.Error),
    ("flip", laws.Flip),
    ("score", laws.Score),
    ("clutter", laws.Clutter),
    ("clutter.flashes", laws.Flashes),
    ("clutter.ghosts", laws.Ghosts),
    ("..._share, drift_time", laws.Correlation),
)
_WIDTH = 98


def profile_yaml(profile: Profile, made: str) -> str:
    """The file's text; `made` says in a line how it came about."""
    lines = [made, "", "r: distance from the sensor along the ground [m]; v: visible fraction."]
    for key, law in _EXPLAINED:
        lines.append(f"{key}: {' '.join(inspect.getdoc(law).split())}")  # type: ignore[union-attr]
    wrapped = [
        part
        for line in lines
        for part in textwrap.wrap(line, _WIDTH, subsequent_indent="  ") or [""]
    ]
    head = "".join(f"# {line}".rstrip() + "\n" for line in wrapped)
    document = profile.model_dump(exclude_none=True)
    return head + yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100)
