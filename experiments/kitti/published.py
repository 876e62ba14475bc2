"""What RobMOT's program and the paper give for KITTI's validation split, to stand beside ours.

RobMOT and AB3DMOT: their own programs' tracks, scored by TrackEval; on the ground by the same rows'
distance. The paper ran its filters in RobMOT's framework, on its own machine and detections: its
tables give HOTA, MOTA, MOTP, AssA, identity switches and run time, each for some detectors and
filters. It does not say how its IMM mixes, so that its values stand at both of ours.
"""

from collections.abc import Mapping
from dataclasses import dataclass

ROBMOT, AB3DMOT, PAPER = "RobMOT", "AB3DMOT", "paper"

VALIDATION = frozenset(f"{k:04d}" for k in (1, 6, 8, 10, 12, 13, 14, 15, 16, 18, 19))
"""Sequences of the validation split."""
VALIDATION_FRAMES = 3908


@dataclass(frozen=True)
class Published:
    """Values of one filter on one detector's detections, by the names that ours have.

    detector: name of the tracker's settings. filter: ours that does the same, "" for none.
    rules: ours that they are to be compared with. note: what people need to know of the values.
    """

    source: str
    detector: str
    filter: str
    rules: str
    values: Mapping[str, float]
    note: str = ""


_NOTES: dict[tuple[str, ...], str] = {
    (ROBMOT, "second"): "RobMOT's program lets in 97 of 12447 weak detections, by comparing the"
    " LiDAR's coordinates with the world's; here none is",
    (PAPER, "pointrcnn", "md3"): "the paper's md3 has 2 identity switches in its Table 3, 4 in its"
    " table of identity switches",
}

_SCORES = ("hota", "deta", "assa", "mota", "motp", "idsw", "fp", "fn", "idf1")
_GROUND = ("ground_hota", "ground_mota", "ground_idsw")


def _program(source: str, detector: str, name: str, *values: float) -> Published:
    columns = dict(zip((*_SCORES, *_GROUND)[: len(values)], values, strict=True))
    return Published(source, detector, name, "robmot", columns, _NOTES.get((source, detector), ""))


_PROGRAMS = (
    _program(
        *(ROBMOT, "pointrcnn", "ca", 78.01, 74.58, 81.86, 86.56, 86.13, 3, 452, 671, 93.19),
        *(84.26, 86.10, 0),
    ),
    _program(
        *(ROBMOT, "pvrcnn", "ca", 79.92, 76.88, 83.32, 86.92, 88.37, 1, 362, 733, 93.23),
        *(84.52, 86.38, 0),
    ),
    _program(
        *(ROBMOT, "second", "ca", 78.74, 74.97, 82.96, 85.75, 87.43, 7, 372, 815, 92.66),
        *(83.63, 85.28, 0),
    ),
    _program(AB3DMOT, "pointrcnn", "", 74.97, 73.17, 77.11, 84.35, 86.40, 12, 458, 841, 88.27),
)

MIXINGS = {"imm": ("imm", "imm-zero"), "imm3": ("imm3", "imm3-zero")}
"""Ours that the paper's IMM may be."""

_TABLES: tuple[tuple[str, dict[str, dict[str, float]]], ...] = (
    # Table 1: evaluation on the validation split with VirConv.
    (
        "virconv",
        {
            "ca": {"hota": 85.95, "mota": 90.98, "motp": 91.71},
            "imm": {"hota": 86.10, "mota": 91.09, "motp": 91.72},
            "md": {"hota": 86.36, "mota": 91.56, "motp": 91.74},
        },
    ),
    # Table 3: higher-order motion derivatives with PointRCNN.
    (
        "pointrcnn",
        {
            "ca": {"hota": 77.29, "assa": 82.20, "idsw": 5},
            "imm": {"hota": 77.42, "assa": 82.20, "idsw": 4},
            "md": {"hota": 77.47, "assa": 82.24, "idsw": 4},
            "cj": {"hota": 77.47, "assa": 82.08, "idsw": 6},
            "imm3": {"hota": 77.49, "assa": 82.22, "idsw": 4},
            "md3": {"hota": 77.56, "assa": 82.40, "idsw": 2},
        },
    ),
    # Identity switches across five detectors, where Table 3 has none.
    *(
        (name, {"ca": {"idsw": ca}, "cj": {"idsw": cj}, "md": {"idsw": md}, "md3": {"idsw": md3}})
        for name, ca, cj, md, md3 in (
            ("virconv", 1.0, 1.0, 1.0, 1.0),
            ("casa", 1.0, 1.0, 1.0, 1.0),
            ("pvrcnn", 1.0, 1.0, 1.0, 1.0),
            ("second", 1.0, 3.0, 1.0, 1.0),
        )
    ),
    # Processing time per frame, on training and validation sequences.
    *(
        (name, {"ca": {"ms_per_frame": baseline}, "md": {"ms_per_frame": dynamic}})
        for name, baseline, dynamic in (
            ("virconv", 0.542, 0.615),
            ("casa", 0.585, 0.653),
            ("pointrcnn", 0.859, 0.953),
            ("second", 0.643, 0.714),
            ("pvrcnn", 0.613, 0.696),
        )
    ),
)


def _paper() -> tuple[Published, ...]:
    """The tables' values by detector and filter, joined."""
    joined: dict[tuple[str, str], dict[str, float]] = {}
    for detector, by_filter in _TABLES:
        for told, values in by_filter.items():
            for name in MIXINGS.get(told, (told,)):
                joined.setdefault((detector, name), {}).update(values)
    return tuple(
        Published(PAPER, *key, "paper", values, _NOTES.get((PAPER, *key), ""))
        for key, values in joined.items()
    )


PUBLISHED = (*_PROGRAMS, *_paper())
