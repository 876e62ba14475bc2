"""Claim: the tables of `mdkf kitti` tell whole numbers on terminals of 80 and of 120 characters."""

from io import StringIO
from typing import Any

import pytest
from rich.console import Console, RenderableType

from experiments.kitti.compare import OFFICIAL
from experiments.kitti.published import PUBLISHED
from experiments.kitti.rules import RULES
from experiments.kitti.tables import (
    COLUMNS,
    NARROW,
    WIDTH,
    comparison_table,
    gap_table,
    published_table,
    scores_table,
    scores_title,
)
from experiments.terminal import FULL_WIDTH
from mdkf import estimator_names


def printed(table: RenderableType, width: int) -> list[str]:
    """The lines of a table on a terminal of so many characters."""
    out = StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue().splitlines()


def words_of(lines: list[str], first: str) -> list[str]:
    """The cells of the row that begins with a word."""
    (row,) = (line.split() for line in lines if line.split()[:1] == [first])
    return row[1:]


@pytest.mark.parametrize("width", [80, WIDTH])
def test_scores_are_told_in_full(width: int) -> None:
    """Of every filter, with counts of thousands, beside what was published."""
    digits = {column: 12.3456789 if places else 1234 for column, _, places, _ in COLUMNS}
    rows = [{"filter": name, **digits} for name in estimator_names()]
    known = [e for e in PUBLISHED if (e.detector, e.rules) == ("pointrcnn", "robmot")]
    title = scores_title("pointrcnn", RULES["robmot"], "mid:20:35")
    lines = printed(scores_table(title, rows, known, width == WIDTH), width)
    shown = [column for column in COLUMNS if width == WIDTH or column[0] in NARROW]
    for row in rows:
        told = [f"{row[column]:.{places}f}" for column, _, places, _ in shown]
        assert words_of(lines, row["filter"]) == told
    robmot = next(e for e in known if e.source == "RobMOT")
    told = [f"{robmot.values[c]:.{p}f}" for c, _, p, _ in shown if c in robmot.values]
    assert words_of(lines, "RobMOT") == told
    assert "…" not in "".join(lines)


@pytest.mark.parametrize("width", [80, WIDTH])
def test_errors_in_gaps_are_told_in_full(width: int) -> None:
    """With intervals where there is room for them."""
    values: dict[str, Any] = {"captured": 50.0, "deleted": 50.0, "lost": None}
    for name in ("error", "drift", "against"):
        values |= {name: 10.25, f"{name}_low": 9.25, f"{name}_high": 11.25}
    rows = [{"filter": f, "followed": 123, **values} for f in ("ca", "md-innovation")]
    lines = printed(gap_table("pvcnn: errors in 123 gaps", rows, width == WIDTH), width)
    told = ["10.25", "[9.25,", "11.25]"] if width == WIDTH else ["10.25"]
    against = [f"[+{part[1:]}" if part[0] == "[" else f"+{part}" for part in told]
    row = ["123", "50", "50", "–", *told, *told, *against]
    assert words_of(lines, "md-innovation") == row
    assert "…" not in "".join(lines)


@pytest.mark.parametrize("width", [80, WIDTH, FULL_WIDTH])
def test_comparisons_are_told_in_full(width: int) -> None:
    """With ranks and intervals, and with counts, where there is room for them."""
    values: dict[str, Any] = {}
    for name in OFFICIAL:
        values |= {f"{name}_recorded": 78.25, f"{name}_simulated": 68.0}
        values |= {f"{name}_{side}_rank": 16 for side in ("recorded", "simulated")}
        values |= {f"{name}_difference": -10.25, f"{name}_difference_low": -20.5}
        values |= {f"{name}_difference_high": 0.0}
        values |= {f"{name}_influential": "0019", f"{name}_difference_without": -1.5}
    counts = ("idsw", "fp", "fn")
    values |= {f"{name}_{side}": 123 for name in counts for side in ("recorded", "simulated")}
    rows = [{"filter": name, **values} for name in ("ca", "md-innovation")]
    lines = printed(comparison_table("pvcnn", rows, OFFICIAL, counts, width), width)
    told = ["78.25", "68.00", "-10.25"]
    if width >= WIDTH:
        told = ["78.25", "(16)", "68.00", "(16)", "-10.25", "[-20.50,", "+0.00]"]
    told = told * 2 + ["123", "123.0"] * (3 * (width == FULL_WIDTH))
    assert words_of(lines, "md-innovation") == told
    assert "…" not in "".join(lines)
    verdict = " ".join(" ".join(lines).split())
    assert "HOTA within 2 points for 0 of 2 filters (ca -10.25, without sequence 0019" in verdict


def test_what_was_published_of_others_is_told_in_full() -> None:
    """Of detectors of which there are no detections here."""
    lines = printed(published_table([e for e in PUBLISHED if e.detector == "virconv"]), 80)
    assert "…" not in "".join(lines)
    told = next(line.split() for line in lines if line.split()[1:2] == ["md"])
    assert told == ["virconv", "md", "(paper)", "86.36", "91.56", "91.74", "1", "0.615"]
