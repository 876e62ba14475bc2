"""Names into the filters and detectors that they name, looked up once in a process: that takes as
long as a small world."""

from functools import cache

from mdkf import Estimator, estimator
from sim_bridge import Profile, is_recorded, load_profile


@cache
def filter_named(name: str) -> Estimator:
    """`mdkf.estimator`, which asks all installed packages each time."""
    return estimator(name)


@cache
def detector_named(name: str) -> Profile | str:
    """What `sim_bridge.detect` takes: a profile, `ProfileError` as `sim_bridge.load_profile`; the
    detector of a recording stays a name."""
    return name if is_recorded(name) else load_profile(name)
