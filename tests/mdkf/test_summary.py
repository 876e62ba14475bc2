"""Claim: a table's summary tells what it holds, as text and as HTML that no text in it breaks."""

import json
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from mdkf.tables import Detections, Table, Trace, Tracks
from tests.tables import random_detections, random_trace, random_tracks, trace_of, tracks_of

MAKERS: dict[type[Table], Callable[..., Table]] = {
    Trace: random_trace,
    Detections: random_detections,
    Tracks: random_tracks,
}
every_table = pytest.mark.parametrize("kind", MAKERS)


class Elements(HTMLParser):
    """Names of a page's elements, their attributes, and what is open at the end."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.attributes: set[str] = set()
        self.text = ""
        self.open: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_trace_by_hand() -> None:
    """Three cars, one of them never in view: counted by object and by row."""
    rows = [(0, 4, 3.0, 4.0), (0, 5, 6.0, 8.0), (0, 900, 0.0, 1.0), (1, 4, 3.0, 4.0)]
    trace = trace_of(rows, 2, visible=[1.0, 0.5, 0.0, 1.0], kind=[0, 0, 2, 0], regime=[0, 1, 1, 1])
    told = trace.describe()
    assert "objects      3: 2 car, 1 bus" in told
    assert "25% stationary, 75% constant velocity; 0% turning" in told
    assert "1 to 10 m, median 5" in told
    assert "50% in full, 25% in part, 25% not at all" in told
    assert "2 of 0.1 s: 0.2 s" in told


def test_tracks_and_detections_by_hand() -> None:
    """Lengths in frames, the share that coasts, clutter, frames without a box."""
    tracks = tracks_of(
        [(0, 1, 0, 0), (1, 1, 0, 0), (2, 1, 0, 0), (1, 70000, 5, 5)], 3, [0, 1, 0, 0]
    )
    assert "2 of 1 to 3 frames, median 2" in tracks.describe()
    assert "25.0% of the rows" in tracks.describe()
    whole = random_detections(np.random.default_rng(0), 60)
    some = whole.take((whole.frame != 3) & (whole.frame != 9))
    told = some.describe()
    assert f"{len(some) / 12:.1f} a frame, 2 frames without any" in told
    assert f"{(some.source == -1).sum()} boxes" in told
    assert f"objects  {len(set(some.source.tolist()) - {-1})}\n" in told


@every_table
@pytest.mark.parametrize("rows", [0, 1, 60])
def test_html_has_the_facts_and_the_first_rows(kind: type[Table], rows: int) -> None:
    """Of empty tables too; well-formed, without styles, scripts or ids of the page's."""
    table = MAKERS[kind](np.random.default_rng(1), rows)
    page = Elements(table._repr_html_())
    assert page.open == []
    assert page.names <= {"div", "strong", "table", "thead", "tbody", "tr", "th", "td"}
    assert page.attributes == {"style"}
    for line in table.describe().splitlines()[1:]:
        name, value = line.strip().split("  ", maxsplit=1)
        assert name + value.strip() in page.text
    assert ("yaw" in page.text) == (rows > 0)


HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(1)>\"'&</td>"


@every_table
@pytest.mark.parametrize(
    "occlusion",
    [HOSTILE, "[" * 100_000, "{}", "null", json.dumps({"protocol": HOSTILE, "gaps": []}), "7"],
)
def test_hostile_provenance_is_text(kind: type[Table], occlusion: str) -> None:
    """Whatever a file says of its origin, no element or attribute comes of it, and no error."""
    table = MAKERS[kind](np.random.default_rng(2), 5)
    names = ("scenario", "seed", "source", "detector", "estimator")
    origin = {**dict.fromkeys(names, HOSTILE), "occlusion": occlusion}
    table = replace(table, provenance=origin)
    page = Elements(table._repr_html_())
    assert page.open == []
    assert page.attributes == {"style"}
    assert not page.names & {"script", "img"}
    assert HOSTILE in page.text
    assert len(page.text) < 5000
    assert len(table.describe()) < 2500


def test_hostile_diagnostics_are_text() -> None:
    """Names of an estimator's own columns are anybody's."""
    tracks = random_tracks(np.random.default_rng(3), 5)
    tracks = replace(tracks, diagnostics={HOSTILE: np.full(5, np.nan)})
    page = Elements(tracks._repr_html_())
    assert page.attributes == {"style"}
    assert page.text.count(HOSTILE) == 2
    assert "–" in page.text


def test_identifiers_of_any_size() -> None:
    """Identifiers too large to count by are counted all the same."""
    far = 2**62
    trace = trace_of([(0, 1, 0.0, 1.0), (1, 1, 0.0, 1.0)], 2)
    large = replace(trace, object_id=trace.object_id * far)
    assert large.describe() == trace.describe()
