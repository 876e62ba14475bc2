"""Profiles of detectors whose recorded detections we do not have, by what is published of them.

They are pvrcnn's profile, with
- position errors scaled by the root of the detector's variance over pvrcnn's, along and across, as
  RobMOT measured both (`mdkf.DETECTORS`; its x and y are ahead and to the left),
- misses of hidden cars and false boxes scaled by (100 - AP) / (100 - pvrcnn's AP), with the average
  precision for cars, moderate, in three dimensions, of KITTI's test set,
- scores that begin at the lowest that RobMOT reads.

`python -m experiments.detectors.interpolate` writes them anew. They are guesses until recordings
can be fitted: `evidence` says so, and `mdkf check-detector` leaves them out.
"""

from collections.abc import Mapping
from math import sqrt
from pathlib import Path
from typing import Any

from experiments.detectors.fit import rounded
from experiments.detectors.profile_file import profile_yaml
from mdkf import DETECTORS
from sim_bridge import Profile, load_profile, profile

BASE = "pvrcnn"
PRECISION: Mapping[str, float | None] = {
    BASE: 81.4,
    "casa": 83.1,
    "virconv": 87.2,
    "ctrl-waymo": None,
}
"""Average precision in percent; none for a detector that only Waymo's data has been given to."""


def interpolated(name: str) -> Profile:
    """The profile of one of the detectors above but the base."""
    base, own, known = load_profile(BASE), DETECTORS[name], DETECTORS[BASE]
    precision, of_base = PRECISION[name], PRECISION[BASE]
    assert of_base is not None
    misses = 1.0 if precision is None else (100.0 - precision) / (100.0 - of_base)
    document: dict[str, Any] = base.model_dump(exclude_none=True)
    document["name"] = name
    for error, ratio in (("radial", own.x_var / known.x_var), ("lateral", own.y_var / known.y_var)):
        for term in ("constant", "near", "per_range_squared"):
            document[error][term] *= sqrt(ratio)
    document["detection"]["range_hidden"] *= misses
    for kind in ("flashes", "ghosts"):
        document["clutter"][kind]["density"] *= misses
    shift = own.confirmed_score - base.score.lowest
    for level in ("lowest", "ceiling", "constant"):
        document["score"][level] += shift
    document["evidence"] = {
        "interpolated_from": BASE,
        "position_error_by": "variances of RobMOT's settings",
        "average_precision": "unknown" if precision is None else precision,
        "misses_and_false_boxes_times": misses,
    }
    return Profile.model_validate(rounded(document))


def main() -> None:
    """Write every profile anew."""
    folder = Path(profile.__file__).with_name("detectors")
    for name in PRECISION.keys() - {BASE}:
        made = "A guess, not a measurement: see experiments/detectors/interpolate.py."
        (folder / f"{name}.yaml").write_text(profile_yaml(interpolated(name), made), "utf-8")


if __name__ == "__main__":
    main()
