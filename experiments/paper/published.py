"""What the paper's tables give, by our names of filters and scores.

Of KITTI's validation split as `experiments.kitti.published` has it; here is what it gives of other
data: KITTI's test split, Waymo's, and its own simulated occlusions.
"""

from collections.abc import Mapping

from experiments.kitti.published import MIXINGS, PAPER, PUBLISHED

Scores = Mapping[str, Mapping[str, float]]
"""Values by filter and score."""

TEST_SPLIT: Scores = {
    "ca": {"hota": 81.22, "mota": 90.48, "assa": 85.77, "assre": 89.68, "idsw": 6},
    "md": {"hota": 81.29, "mota": 90.55, "assa": 85.85, "assre": 89.72, "idsw": 6},
}
"""RobMOT with the baseline and with MD on KITTI's test split."""

_RANGES = {
    "0-30 m": ((59.69, 59.49, 70.08), (59.72, 59.55, 70.13)),
    "30-50 m": ((60.70, 57.35, 74.24), (60.74, 57.44, 74.26)),
    "50+ m": ((52.87, 47.09, 65.78), (53.10, 47.81, 66.00)),
}
"""HOTA, MOTA and AssA of IMM and of MD on Waymo's validation split with CasA."""

_GAINS = {
    ("casa-waymo", "0-30 m"): ((0.25, -0.35, 0.26, -0.35), (0.44, -0.56, 0.45, -0.13)),
    ("casa-waymo", "30-50 m"): ((0.46, -0.62, 0.47, -0.25), (0.81, -0.40, 0.81, -0.80)),
    ("casa-waymo", "50+ m"): ((0.56, -0.27, 0.53, -0.83), (0.85, -1.09, 0.78, -0.95)),
    ("ctrl-waymo", "0-30 m"): ((0.09, -0.05, 0.09, -0.08), (0.25, -0.12, 0.25, -0.13)),
    ("ctrl-waymo", "30-50 m"): ((0.27, -0.33, 0.29, -0.14), (0.63, -0.49, 0.63, -0.31)),
    ("ctrl-waymo", "50+ m"): ((0.38, -0.17, 0.36, -0.17), (0.56, -0.66, 0.53, -0.95)),
}
"""MD less the baseline on Waymo, of order 2 and 3: MOTA and misses at level 1, at level 2."""

_OCCLUSIONS = {
    "late:10": ((81.01, 83.85, 91.04), (81.68, 84.72, 91.48)),
    "late:20": ((75.60, 76.56, 87.13), (76.84, 78.05, 87.92)),
    "mid:10": ((76.44, 78.20, 86.62), (77.32, 79.07, 86.97)),
    "mid:20": ((65.83, 67.38, 74.74), (67.05, 68.93, 76.21)),
}
"""HOTA, MOTA and IDF1 of CJ and of MD with jerk on KITTI with VirConv, by occlusion."""


def of_validation(detector: str) -> Scores:
    """KITTI's validation split with a detector."""
    return {
        entry.filter: entry.values
        for entry in PUBLISHED
        if entry.source == PAPER and entry.detector == detector
    }


def of_range(name: str) -> Scores:
    """Waymo with CasA, at a range."""
    imm, md = (dict(zip(("hota", "mota", "assa"), row, strict=True)) for row in _RANGES[name])
    return {**dict.fromkeys(MIXINGS["imm"], imm), "md": md}


def of_occlusion(occlusion: str) -> Scores:
    """KITTI with VirConv, with simulated occlusions."""
    rows = (dict(zip(("hota", "mota", "idf1"), row, strict=True)) for row in _OCCLUSIONS[occlusion])
    return dict(zip(("cj", "md3"), rows, strict=True))


def waymo_gain(detector: str, near: str, order: int, level: int, metric: str) -> float:
    """MD less the baseline on Waymo, at a range and level (1, 2): mota or miss_rate."""
    values = _GAINS[detector, near][order - 2]
    return values[2 * (level - 1) + ("mota", "miss_rate").index(metric)]
