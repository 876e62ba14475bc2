"""Claim: `mdkf paper` answers items from rows that are kept; every number on its page can be traced
to them, and a second run does only what is missing."""

import json
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from experiments.claims.hypotheses import load
from experiments.estimates import estimate
from experiments.paper.item import CELLS, Answer, Cells, Item, Picture, again
from experiments.paper.items import ITEMS
from experiments.paper.report import write_report
from experiments.paper.run import Results, run
from experiments.paper.tables import told_value
from experiments.studies import seeds, worlds
from experiments.studies.scale import QUICK, SCALES
from experiments.studies.showcase import Scene
from experiments.studies.worlds import Setting, World
from tests.experiments.browser import Browser, needs_browser
from tests.experiments.commands import Mdkf, assert_refused

SETTING = Setting("pointrcnn", "mid:10", ("ca", "md"), ("range,level",))
WORLDS = [World(name, seed, SETTING) for seed in (0, 1) for name in ("passing_van", "roundabout")]
WHERE = {"study": worlds.STUDY, "detector": "pointrcnn", "occlusion": "mid:10", "bin": "all"}


def answer(rows: pl.DataFrame) -> Answer:
    """HOTA and drift of two filters, and the gain of one over the other."""
    cells = Cells("small", rows)
    for name in SETTING.filters:
        where = {**WHERE, "filter": name}
        place = ("scores <&>", name)
        cells.add((*place, "HOTA"), {**where, "metric": "hota"}, "%", better="higher", paper=77.5)
        cells.add((*place, "drift"), {**where, "metric": "drift"}, "m", better="lower")
        cells.add((*place, "nothing"), {**where, "metric": "unheard of"}, "")
    gain = {**WHERE, "filter": "md", "metric": "hota"}
    cells.add(("gain", "md", "over ca"), gain, "%", against={"filter": "ca"})
    from matplotlib.figure import Figure

    picture = Picture("small", "What & why", lambda: Figure(figsize=(2, 1)), rows.head(3))
    return Answer(cells.frame(), {"gain": "paired <b>"}, [picture])


ITEM = Item("small", "nowhere", "does it work?", "<i>", lambda scale: WORLDS, answer)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where it is written."""
    return tmp_path_factory.mktemp("paper")


@pytest.fixture(scope="module")
def results(out: Path) -> Results:
    """Two scenarios, two seeds."""
    found = run([ITEM], QUICK, out, workers=1)
    write_report(
        [ITEM], found.answers, found.cells, found.verdicts, QUICK, out, "mdkf paper <small>"
    )
    return found


class Page(HTMLParser):
    """The numbers of a page: row of results.parquet and text, as they stand in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.numbers: list[tuple[int, str]] = []
        self.paper: list[str] = []
        self._row: int | None = None
        self._paper = False
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """A cell begins, or a part of one."""
        given = dict(attributes)
        if tag == "td":
            row = given.get("data-row")
            self._row = None if row is None else int(row)
        self._paper = given.get("class") == "paper"

    def handle_data(self, data: str) -> None:
        """A number."""
        if self._row is not None and data.strip():
            if self._paper:
                self.paper.append(data)
            else:
                self.numbers.append((self._row, data))

    def handle_endtag(self, tag: str) -> None:
        """The cell ends."""
        if tag == "td":
            self._row = None


def test_every_number_on_the_page_is_a_row_of_the_results(results: Results, out: Path) -> None:
    """By the row that it names, and all rows are there."""
    page = Page((out / "report.html").read_text())
    cells = pl.read_parquet(out / "results.parquet")
    assert dict(cells.schema) == CELLS
    assert sorted(row for row, _ in page.numbers) == list(range(len(cells)))
    for row, text in page.numbers:
        assert text == told_value(cells.row(row, named=True))
    assert page.paper == ["paper 77.5"] * 2


def test_every_result_is_what_the_rows_that_it_names_give(results: Results, out: Path) -> None:
    """From the two files alone: by the estimate, and its value by plain means."""
    cells, rows = (pl.read_parquet(out / f"{name}.parquet") for name in ("results", "runs"))
    for cell in cells.to_dicts():
        found = again(rows, cell)
        if cell["value"] is None:
            assert found.n == 0
            continue
        assert (found.value, found.low, found.high) == (cell["value"], cell["low"], cell["high"])
        own = rows.filter(**json.loads(cell["where"]))
        mean = own.group_by("scenario").agg(pl.col("value").mean())["value"].mean()
        if cell["against"] is not None:
            other = rows.filter(**(json.loads(cell["where"]) | json.loads(cell["against"])))
            means = other.group_by("scenario").agg(pl.col("value").mean())["value"]
            mean = float(mean) - float(means.mean())  # type: ignore[arg-type]
        assert cell["value"] == pytest.approx(mean, rel=1e-12)


def test_a_world_is_scored_as_step_by_step(results: Results) -> None:
    """One row, by the public interface."""
    import experiments
    import mdkf
    import scenarios
    import sim_bridge

    trace = sim_bridge.simulate(scenarios.load("passing_van"), seed=1)
    gap = experiments.OcclusionProtocol(kind="mid", length=10)
    seen = gap.apply(sim_bridge.detect(trace, "pointrcnn", 1))
    tracks = mdkf.Tracker(mdkf.estimator("md"), "pointrcnn").run(seen)
    whole = experiments.score(trace, tracks, gap)
    rows = results.rows.filter(scenario="passing_van", seed=1, filter="md")
    own = dict(rows.filter(bin="all").select("metric", "value").iter_rows())
    for metric in ("hota", "mota", "idsw", "error_gap", "nees"):
        assert own[metric] == whole.summary()[metric]
    binned = whole.by("range,level").filter(bin="30-50 m, LEVEL_1", score="miss_rate")
    found = rows.filter(bin="30-50 m, LEVEL_1", metric="miss_rate")
    assert found["value"].to_list() == binned["value"].to_list()


def test_drift_by_frame_and_by_regime_make_up_the_whole(results: Results) -> None:
    """Weighted by what is behind them."""
    drift = results.rows.filter(metric="drift")
    keys = ("scenario", "seed", "filter")
    whole = drift.filter(bin="all").select(*keys, "value", "n")
    for part in ("frame ", "regime "):
        own = drift.filter(pl.col("bin").str.starts_with(part)).group_by(keys)
        mean = (pl.col("value") * pl.col("n")).sum() / pl.col("n").sum()
        both = whole.join(own.agg(mean=mean, rows=pl.col("n").sum()), on=keys)
        assert len(both) == 8
        assert both["rows"].to_list() == both["n"].to_list()
        assert both["mean"].to_list() == pytest.approx(both["value"].to_list(), rel=1e-9)


def test_a_second_run_does_nothing_and_gives_the_same(results: Results, out: Path) -> None:
    """No job's file is written anew; the results are the same bytes."""
    before = {path: path.stat().st_mtime_ns for path in (out / "jobs").iterdir()}
    content = (out / "results.parquet").read_bytes()
    told = list[tuple[int, int]]()
    found = run([ITEM], QUICK, out, 1, lambda done, of: told.append((done, of)))
    assert told == [(4, 4)]
    assert {path: path.stat().st_mtime_ns for path in (out / "jobs").iterdir()} == before
    assert (out / "results.parquet").read_bytes() == content
    assert_frame_equal(found.rows, results.rows)


def test_what_users_write_is_escaped(results: Results, out: Path) -> None:
    """Names and captions are text, not markup; no address is called."""
    text = (out / "report.html").read_text()
    for given in ("scores <&>", "mdkf paper <small>", "paired <b>", "<i>."):
        assert given not in text
    assert "scores &lt;&amp;&gt;" in text
    for address in ('src="http', "url(http", "@import", "<link"):
        assert address not in text


def test_figures_are_files_with_their_data_beside(results: Results, out: Path) -> None:
    """As SVG and PNG."""
    folder = out / "figures"
    assert (folder / "small.svg").read_text().lstrip().startswith("<?xml")
    assert (folder / "small.png").read_bytes().startswith(b"\x89PNG")
    assert_frame_equal(pl.read_parquet(folder / "small.parquet"), results.rows.head(3))


def test_the_population_is_every_scenario_that_a_simulator_drives() -> None:
    """None left out, none twice; a scale has all of its seeds of all of them."""
    names = seeds.traffic()
    assert len(set(names)) == len(names) == 18
    full = worlds.jobs(SCALES["full"], [SETTING])
    assert len(full) >= 200
    assert {(world.scenario, world.seed) for world in full} == {
        (name, seed) for name in names for seed in range(SCALES["full"].worlds)
    }


def test_a_refused_seed_has_no_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """And is no failure."""
    from sim_bridge import SeedRefused

    def refuse(*given: object) -> None:
        raise SeedRefused("two boxes overlap")

    monkeypatch.setattr("experiments.studies.seeds.simulated", refuse)
    rows = WORLDS[0].rows()
    assert rows.is_empty()
    assert estimate(rows, WHERE).n == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["tabel-occlusion"], "did you mean 'table-occlusion'?"),
        (["--scale", "huge"], "scale 'huge', expected one of: quick, full"),
        (["--seeds", "0"], "--seeds"),
    ],
)
def test_bad_input_is_one_line(
    mdkf_command: Mdkf, tmp_path: Path, arguments: list[str], told: str
) -> None:
    """With what was expected."""
    assert_refused(mdkf_command("paper", *arguments, "--out", str(tmp_path)), tmp_path, told)


def test_the_list_names_every_item(mdkf_command: Mdkf) -> None:
    """With its question and place."""
    listed = json.loads(mdkf_command("paper", "--list", "--json").out)["rows"]
    assert [row["id"] for row in listed] == list(ITEMS)
    assert all(row["question"].endswith("?") and row["place"] for row in listed)


def test_every_item_of_every_room_is_asked() -> None:
    """None is left out of the order, and each asks a question."""
    from experiments.paper import items

    assert set(items.ITEMS) == set(items._BY_ID)
    assert sum(len(room.ITEMS) for room in items._ROOMS) == len(items.ITEMS)


@needs_browser
def test_the_page_loads_scrubs_and_complains_of_nothing(results: Results, tmp_path: Path) -> None:
    """In a browser, without a network: contents, claims, tables, a figure and a playback."""
    bus = ITEMS["playback"]
    shown = bus.answer(Scene("passing_bus").rows())
    answers = {**results.answers, bus.id: replace(shown, pictures=shown.pictures[:1])}
    cells = pl.concat([results.cells, shown.cells])
    given = (answers, cells, results.verdicts, QUICK)
    path = write_report([ITEM, bus], *given, tmp_path, "mdkf paper")
    with Browser(tmp_path) as browser:
        page = browser.open(path)
        assert page.value("document.querySelectorAll('nav a').length") == 3
        assert page.value("document.querySelectorAll('#claims tbody tr').length") == len(load())
        assert page.value("document.querySelectorAll('#figure-small svg').length") == 1
        assert page.value("document.querySelectorAll('td[data-row]').length") == len(cells)
        root = "document.querySelector('.mdkf-playback').shadowRoot"
        slider = f"{root}.querySelector('.slider')"
        before = page.value(f"{root}.querySelector('.time').textContent")
        page.value(f"{slider}.value = 3, {slider}.dispatchEvent(new Event('input'))")
        assert page.value(f"{root}.querySelector('.time').textContent") != before
        widest = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.value(widest) <= 0
        assert page.complaints == []
        assert page.requests == [path.as_uri()]
