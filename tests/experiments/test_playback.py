"""The playback shows what the tables say, in every frame, and asks nothing of the network."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Polygon
from scipy import stats

import mdkf
import scenarios
import sim_bridge
from experiments.playback import playback, still
from experiments.playback.scene import scene
from mdkf import Detections, Trace, Tracks
from tests.experiments.browser import Browser, Page, needs_browser
from tests.tables import trace_of, tracks_of

FOCUS, GAP, PLAYED = 1, (90, 111), range(60, 136)
"""The car of `passing_bus`, the frames in which the bus hides it by its closed form, and 3 s before
to 2.5 s after."""
FILTERS = ("ca", "imm", "imm-zero", "md")
EVIL = "</script><script>window.hacked = 1</script></script ><!--<script><b>&amp; <!-- 'bus' \u2028"

Tables = tuple[Trace, Detections, dict[str, Tracks]]


@pytest.fixture(scope="module")
def tables() -> Tables:
    """A bus passes between the sensor and a standing car."""
    trace = sim_bridge.simulate(scenarios.load("passing_bus"), 3)
    detections = sim_bridge.detect(trace, "pointrcnn", 3)
    tracks = {
        name: mdkf.Tracker(mdkf.estimator(name), "pointrcnn").run(detections) for name in FILTERS
    }
    return trace, detections, tracks


@pytest.fixture(scope="module")
def page(tables: Tables, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page with two playbacks, the second one with a hostile title."""
    folder = tmp_path_factory.mktemp("playback")
    both = [
        playback(*tables, focus=FOCUS, gap=GAP, title="first"),
        playback(*tables, focus=FOCUS, gap=GAP, title=EVIL, frames=range(80, 120)),
    ]
    path = folder / "page.html"
    path.write_text(f'<!doctype html><meta charset="utf-8">{"".join(both)}', encoding="utf-8")
    with Browser(folder) as browser:
        yield browser.open(path)


class Player:
    """One of the playbacks of a page, by what people see of it."""

    def __init__(self, page: Page, number: int = 0) -> None:
        self.page = page
        self.root = f"document.querySelectorAll('.mdkf-playback')[{number}].shadowRoot"

    def value(self, selector: str, what: str) -> Any:
        """A property of the first element that the selector finds."""
        return self.page.value(f"{self.root}.querySelector({selector!r}).{what}")

    def text(self, selector: str) -> str:
        return str(self.value(selector, "textContent"))

    def frame(self) -> int:
        """The frame that the time says."""
        return int(self.text(".time").rsplit(" ", 1)[1])

    def cell(self, name: str, column: str) -> str:
        return self.text(f"tr[data-filter={name}] .{column}")

    def click(self, selector: str) -> None:
        """With the mouse, in the middle of the element."""
        self.page.value(
            f"{self.root}.querySelector({selector!r}).scrollIntoView({{block: 'center'}})"
        )
        x, y, width, height = self.place(selector)
        self.page.click(x + width / 2, y + height / 2)

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """x, y, width and height in the window [px]."""
        box = self.value(selector, "getBoundingClientRect().toJSON()")
        return box["x"], box["y"], box["width"], box["height"]

    def scrub(self, frame: int, first: int = PLAYED.start) -> None:
        """The slider, to a frame of the trace."""
        self.page.value(
            f"(slider => {{ slider.value = {frame - first};"
            " slider.dispatchEvent(new Event('input')); })"
            f"({self.root}.querySelector('.slider'))"
        )


def believed(tables: Tables, name: str, frame: int) -> dict[str, Any]:
    """What a filter says of the car in a frame, by an independent reading of the tables: the track
    that was on it before the gap while that lives, or else the one on it."""
    trace, _, tracks = tables
    table = tracks[name]

    def away(at: int) -> dict[int, float]:
        """Distance from the car by row of the tracks."""
        true = np.flatnonzero((trace.frame == at) & (trace.object_id == FOCUS))[0]
        own = np.flatnonzero(table.frame == at)
        return {
            int(r): math.dist((table.x[r], table.y[r]), (trace.x[true], trace.y[true])) for r in own
        }

    before = away(GAP[0] - 1)
    followed = table.track_id[min(before, key=lambda row: before[row])]
    now = away(frame)
    row = next((r for r in now if table.track_id[r] == followed), None)
    if row is None:
        row = min(now, key=lambda r: now[r])
        assert now[row] < 2.0
    covariance = [
        [table.cov_xx[row], table.cov_xy[row]],
        [table.cov_xy[row], table.cov_yy[row]],
    ]
    minor, major = np.sqrt(np.linalg.eigvalsh(covariance) * stats.chi2.ppf(0.95, 2))
    track = f"{table.track_id[row]}" + (" (another)" if table.track_id[row] != followed else "")
    true = np.flatnonzero((trace.frame == frame) & (trace.object_id == FOCUS))[0]
    return {
        "error": f"{now[row]:.2f}",
        "speed": f"{np.hypot(table.vx[row], table.vy[row]):.2f}",
        "ellipse-axes": f"{major:.2f} × {minor:.2f}",
        "track": track + (", coasting" if table.coasted[row] else ""),
        "offset": (table.x[row] - trace.x[true], table.y[row] - trace.y[true]),
    }


@needs_browser
@pytest.mark.parametrize("frame", [60, 75, 90, 100, 110, 111, 135])
def test_each_frame_shows_the_numbers_of_the_tables(page: Page, tables: Tables, frame: int) -> None:
    """Error, speed, ellipse and track of every filter are those of the track on the car."""
    player = Player(page)
    player.scrub(frame)
    assert player.frame() == frame
    for name in FILTERS:
        expected = believed(tables, name, frame)
        for column in ("error", "speed", "ellipse-axes", "track"):
            assert player.cell(name, column) == expected[column], (name, column)
    assert page.complaints == []


@needs_browser
def test_estimates_are_drawn_where_they_are(page: Page, tables: Tables) -> None:
    """In the close-up the car is in the middle, and a dot is as far from it as the filter errs,
    in its direction; y is up."""
    player = Player(page)
    player.scrub(GAP[1] - 1)
    per_metre = player.page.value(
        f"(path => path.getBBox().width / 2)({player.root}.querySelector('.close .scale'))"
    )
    for name, number in zip(FILTERS, range(len(FILTERS)), strict=True):
        dot = f".close ellipse:nth-of-type({number + 1})"
        x = float(player.value(dot, "cx.baseVal.value"))
        y = float(player.value(dot, "cy.baseVal.value"))
        expected = believed(tables, name, GAP[1] - 1)
        east, north = expected["offset"]
        assert (x - 280) / per_metre == pytest.approx(east, abs=0.01)
        assert (172 - y) / per_metre == pytest.approx(north, abs=0.01)


@needs_browser
def test_the_state_tells_since_when_the_car_is_hidden(page: Page) -> None:
    player = Player(page)
    for frame, told in (
        (80, "in view, 100 % visible"),
        (GAP[0] + 12, "hidden for 1.2 s"),
        (GAP[1] + 10, "detected again 1.0 s ago, 100 % visible"),
    ):
        player.scrub(frame)
        assert player.text(".state") == told


@needs_browser
def test_it_plays_pauses_and_plays_again_from_the_start(page: Page) -> None:
    """The button starts it, a second click stops it, and there it stays."""
    player = Player(page)
    player.scrub(PLAYED.start)
    player.click(".play")
    page.wait(f"Number({player.root}.querySelector('.slider').value) >= 3")
    assert player.value(".play", "ariaLabel") == "pause"
    player.click(".play")
    assert player.value(".play", "ariaLabel") == "play"
    stopped = player.frame()
    page.value("new Promise(kept => setTimeout(kept, 300))")
    assert player.frame() == stopped
    player.scrub(PLAYED[-1])
    player.click(".play")
    page.wait(f"Number({player.root}.querySelector('.slider').value) < 40")
    player.click(".play")
    assert page.complaints == []


@needs_browser
@pytest.mark.parametrize(("speed", "frames"), [("0.25", 2), ("0.5", 5), ("1", 10), ("2", 20)])
def test_it_plays_at_the_pace_of_the_world(page: Page, speed: str, frames: int) -> None:
    """By the clock of the animation, here the test's own: in 1 s at speed 1 it plays ten frames of
    0.1 s; and a page that was out of sight for 10 s goes on where it was, not 100 frames later."""
    player = Player(page)
    player.scrub(PLAYED.start)
    shown = page.value(
        "(root => { const before = window.requestAnimationFrame, waiting = [];"
        " window.requestAnimationFrame = next => waiting.push(next);"
        f" root.querySelector('.speed').value = '{speed}';"
        " root.querySelector('.play').click(); let moment = 5000;"
        " const at = () => Number(root.querySelector('.slider').value);"
        " const step = passed => { moment += passed; waiting.shift()(moment); return at(); };"
        " step(0); for (let k = 0; k < 20; k++) step(50.001);"
        " const after = [at(), step(10000)]; root.querySelector('.play').click();"
        " waiting.shift()(moment); after.push(waiting.length);"
        " root.querySelector('.speed').value = '1'; window.requestAnimationFrame = before;"
        f" return after; }})({player.root})"
    )
    assert shown[0] == frames
    assert shown[1] - shown[0] <= math.ceil(float(speed))
    assert shown[2] == 0


@needs_browser
def test_keys_step_and_play(page: Page) -> None:
    """Arrows go a frame back and on, space plays and pauses, wherever in the player one is."""
    player = Player(page)
    player.scrub(100)
    page.value(f"{player.root}.querySelector('.player').focus()")
    page.press("ArrowRight")
    assert player.frame() == 101
    page.press("ArrowLeft")
    page.press("ArrowLeft")
    assert player.frame() == 99
    page.press(" ")
    assert player.value(".play", "ariaLabel") == "pause"
    page.press(" ")
    assert player.value(".play", "ariaLabel") == "play"
    page.value(f"{player.root}.querySelector('.slider').focus()")
    player.scrub(100)
    page.press("ArrowRight")
    assert player.frame() == 101


@needs_browser
def test_a_filter_that_is_switched_off_is_gone_from_all_pictures(page: Page) -> None:
    """Its line, box and ellipse; the error's scale is then that of the others."""
    player = Player(page)
    player.scrub(GAP[1] - 1)
    marks = [".chart .line", ".above ellipse", ".close ellipse", ".close .box"]
    before = [player.page.value(f"{player.root}.querySelectorAll({m!r}).length") for m in marks]
    assert before == [4, 4, 4, 4]
    tops = [player.text(".chart text:nth-of-type(6)")]
    for name in ("ca", "imm", "imm-zero"):
        player.click(f"tr[data-filter={name}] input")
    after = [player.page.value(f"{player.root}.querySelectorAll({m!r}).length") for m in marks]
    assert after == [1, 1, 1, 1]
    assert "off" in player.value("tr[data-filter=ca]", "className")
    tops.append(player.text(".chart text:nth-of-type(6)"))
    assert float(tops[1]) < float(tops[0])
    for name in ("ca", "imm", "imm-zero"):
        player.click(f"tr[data-filter={name}] input")


@needs_browser
def test_the_pointer_asks_for_values_and_drags_the_time(page: Page, tables: Tables) -> None:
    """Over a dot stands what the filter says; in the chart, the errors, and a click goes there."""
    player = Player(page)
    player.scrub(GAP[1] - 1)
    page.value(f"{player.root}.querySelector('.player').scrollIntoView()")
    x, y, width, height = player.place(".close")
    place = [float(player.value(".close ellipse", f"c{axis}.baseVal.value")) for axis in "xy"]
    page.move(x + place[0] / 560 * width, y + place[1] / 344 * height)
    expected = believed(tables, "ca", GAP[1] - 1)
    assert f"ca, track {expected['track'].split(',')[0]}\n" in player.text(".tip")
    assert f"error {expected['error']} m" in player.text(".tip")
    x, y, width, height = player.place(".chart")
    # The axis is from 44 to 548 of 560, for all frames that are played.
    at = x + width * (44 + 504 * (100 - PLAYED.start) / (len(PLAYED) - 1)) / 560
    page.click(at, y + height / 2)
    assert player.frame() == 100
    expected = believed(tables, "md", 100)
    assert f"md {expected['error']} m" in player.text(".tip")


@needs_browser
def test_print_shows_the_last_hidden_frame_and_then_all_is_as_it_was(
    page: Page, tmp_path: Path
) -> None:
    player = Player(page)
    player.scrub(70)
    page.value(
        "addEventListener('beforeprint', () => { window.printed ="
        f" {player.root}.querySelector('.time').textContent; }})"
    )
    page.pdf(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    assert page.value("window.printed").endswith(f"frame {GAP[1] - 1}")
    assert player.frame() == 70
    page.as_printed()
    assert player.value(".play", "checkVisibility()") is False
    assert player.value(".above", "checkVisibility()") is True
    page.as_printed(False)


@needs_browser
def test_two_playbacks_in_a_page_do_not_know_of_each_other(page: Page) -> None:
    """Each has its own frames; a hostile title is text; nothing is asked of the network."""
    first, second = Player(page, 0), Player(page, 1)
    first.scrub(70)
    second.scrub(100, first=80)
    assert (first.frame(), second.frame()) == (70, 100)
    assert second.text(".title") == EVIL
    assert page.value("window.hacked") is None
    assert page.value("new Set([...document.querySelectorAll('[id]')].map(e => e.id)).size") == 2
    assert page.complaints == []
    assert [asked.split(":")[0] for asked in page.requests] == ["file"]
    assert page.value("performance.getEntriesByType('resource').length") == 0


@needs_browser
def test_an_error_in_a_page_is_noticed(tmp_path: Path) -> None:
    """The browser of these tests tells of errors and requests: no silence is taken for success."""
    path = tmp_path / "bad.html"
    path.write_text(
        "<!doctype html><script>console.error('told'); null.thrown</script>"
        '<img src="missing.png">'
    )
    with Browser(tmp_path) as browser:
        page = browser.open(path)
        said = "\n".join(page.complaints)
        assert "told" in said
        assert "TypeError" in said
        assert [asked.rsplit("/", 1)[1] for asked in page.requests] == ["bad.html", "missing.png"]


class _Scripts(HTMLParser):
    """Script elements as a browser finds them: their attributes and texts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[dict[str, str | None], str]] = []
        self._inside = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag == "script"
        if self._inside:
            self.found.append((dict(attrs), ""))

    def handle_data(self, data: str) -> None:
        if self._inside:
            attributes, text = self.found.pop()
            self.found.append((attributes, text + data))


def test_text_from_users_ends_no_element(tables: Tables) -> None:
    """A title of markup leaves two scripts, and comes out of the JSON as it went in; so does the
    name of a filter."""
    trace, detections, tracks = tables
    named = {EVIL: tracks["md"]}
    html = playback(trace, detections, named, focus=FOCUS, gap=GAP, title=EVIL)
    scripts = _Scripts(html).found
    assert [attributes.get("type") for attributes, _ in scripts] == ["application/json", None]
    told = json.loads(scripts[0][1])
    assert told["title"] == EVIL
    assert told["filters"][0]["name"] == EVIL
    assert "hacked" not in scripts[1][1]
    assert html.isascii() or "\u2028" not in scripts[1][1]


def test_the_same_tables_give_the_same_text(tables: Tables) -> None:
    assert playback(*tables, focus=FOCUS, gap=GAP) == playback(*tables, focus=FOCUS, gap=GAP)


def test_another_track_takes_over_where_the_followed_one_ended() -> None:
    """The track of the frame before the gap is followed wherever it goes, until it ends; then the
    one on the object is shown, and none where nothing is within 2 m."""
    trace = trace_of([(k, 5, 10.0, 0.0) for k in range(8)], 8)
    detections = Detections.from_columns(
        {name: np.empty(0) for name in Detections.column_types()}, n_frames=8, dt=0.1
    )
    # Track 7 runs away at 2 m a frame from frame 2 on and ends with frame 4; track 9 comes at 6.
    rows = [(k, 7, 10.0 + 2.0 * max(k - 2, 0), 0.3) for k in range(5)]
    rows += [(k, 9, 10.0, 0.4) for k in (6, 7)]
    found = scene(trace, detections, {"ca": tracks_of(rows, 8)}, 5, (3, 6), range(0, 8), "")
    told = found["filters"][0]
    assert told["followed"] == 7
    assert told["track_id"] == [7, 7, 7, 7, 7, None, 9, 9]
    errors = [0.3, 0.3, 0.3, np.hypot(2, 0.3), np.hypot(4, 0.3)]
    assert told["error"][:5] == pytest.approx(errors, abs=5e-4)
    assert told["error"][5:] == [None, 0.4, 0.4]
    assert found["gap"] == [3, 6]


def test_the_still_is_the_last_frame_without_a_detection(tables: Tables) -> None:
    """A gap that reaches beyond the time without detections does not move it."""
    trace, detections, tracks = tables
    found = scene(trace, detections, tracks, FOCUS, (GAP[0], GAP[1] + 3), None, "")
    assert found["first"] + found["still"] == GAP[1] - 1


def test_the_figure_for_paper_is_drawn_from_the_same_tables(tables: Tables) -> None:
    """Its errors are those of the tracks, its dashed box in each moment is the car's, and the
    shadow is what the bus hides: its sides touch the bus and point away from the sensor."""
    trace, detections, tracks = tables
    figure = still(trace, detections, tracks, focus=FOCUS, gap=GAP)
    above, errors = figure.axes[0], figure.axes[4]
    for name, line in zip(FILTERS, errors.lines, strict=True):
        drawn = np.asarray(line.get_ydata())
        for frame in (60, 100, 110, 135):
            assert f"{drawn[frame - 60]:.2f}" == believed(tables, name, frame)["error"]
    polygons = [patch for patch in above.patches if isinstance(patch, Polygon)]
    (truth,) = (
        p for p in polygons if p.get_linestyle() == "--" and p.get_edgecolor()[:3] == (0, 0, 0)
    )
    row = np.flatnonzero((trace.object_id == FOCUS) & (trace.frame == GAP[0]))[0]
    half = np.array([trace.length[row], trace.width[row]]) / 2
    middle = np.array([trace.x[row], trace.y[row]])
    assert np.abs(np.abs(truth.get_xy()[:4] - middle) - half).max() < 2e-3
    bus = np.flatnonzero((trace.object_id == 0) & (trace.frame == GAP[0]))[0]
    (shadow,) = (p for p in polygons if p.get_alpha() == 0.14)
    near_right, far_right, far_left, near_left = shadow.get_xy()[:4]
    front, back = (trace.x[bus] + sign * trace.length[bus] / 2 for sign in (1, -1))
    side = trace.y[bus] - trace.width[bus] / 2
    # The bus has come from the left and reaches past the sensor: its near side is all that is seen.
    assert near_left == pytest.approx([back, side], abs=2e-3)
    assert near_right == pytest.approx([front, side], abs=2e-3)
    for near, far in ((near_right, far_right), (near_left, far_left)):
        assert near[0] * far[1] - near[1] * far[0] == pytest.approx(0, abs=1e-6)
        assert np.hypot(*far) > 500


def test_what_cannot_be_played_is_refused(tables: Tables) -> None:
    trace = tables[0]
    absent = replace(tables[0], **{n: c[trace.frame != 100] for n, c in trace.columns().items()})
    for changed, problem in (
        ({"gap": (0, 10)}, "gap 0..10, expected frames in 1..200, ascending"),
        ({"gap": (90, 90)}, "gap 90..90"),
        ({"gap": (90, 201)}, "gap 90..201"),
        ({"frames": range(95, 120)}, r"range\(95, 120\), expected .* with the gap 90..111"),
        ({"frames": range(80, 201)}, r"0..200"),
        ({"frames": range(80, 120, 2)}, "one frame after the other"),
        ({"focus": 77}, "object 77 is not in every frame from 89 to 110"),
    ):
        with pytest.raises(ValueError, match=problem):
            playback(*tables, **{"focus": FOCUS, "gap": GAP, **changed})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="object 1 is not in every frame from 89 to 110"):
        playback(absent, *tables[1:], focus=FOCUS, gap=GAP)
