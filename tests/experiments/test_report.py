"""Claim: the report is one page that needs no network, shows every scenario and filter with the
numbers of the results, draws the gaps, and is the same bytes for the same results."""

import dataclasses
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import polars as pl
import pytest
from scipy import stats

import scenarios
from experiments import OcclusionProtocol
from experiments.report import BINNED, STATES, write_report
from experiments.run import Plan, Results, run
from experiments.terminal import COLUMNS
from tests.experiments.browser import Browser, needs_browser

COMMAND = "mdkf run bus_stop stop_and_go --seeds 2"
LOADING = {"src", "href", "xlink:href", "srcset", "data", "poster", "action", "background"}
"""Attributes from which a browser loads something, or leads to it."""

VOID = {"meta", "br", "hr", "img", "input", "link"}


class Page(HTMLParser):
    """What the tests ask of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.texts: list[str] = []
        self.figures: list[list[str]] = []
        self.drawings = 0  # SVGs in figures: the playbacks have some of their own
        self.tables: dict[str, list[list[str]]] = {}
        self._open: list[str] = []
        self._table: list[list[str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.drawings += tag == "svg" and "figure" in self._open
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self._table = self.tables.setdefault(dict(attrs).get("id") or "", [])
        elif tag == "tr":
            self._table.append([])
        elif tag in ("td", "th"):
            self._table[-1].append("")
        elif tag == "figure":
            self.figures.append([])

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)
        if self._open and self._open[-1] in ("td", "th"):
            self._table[-1][-1] += data
        if "figure" in self._open:
            self.figures[-1].append(data)


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Two short scenarios, two seeds, three filters."""
    both = (scenarios.load("bus_stop"), scenarios.load("stop_and_go"))
    return Plan(
        scenarios=tuple(dataclasses.replace(s, duration=9.0) for s in both),
        seeds=(0, 1),
        filters=("ca", "imm", "md"),
        detector="pointrcnn",
        settings="pointrcnn",
        occlusion=OcclusionProtocol("mid", 20, 35),
    )


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run's folder."""
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def results(plan: Plan, out: Path) -> Results:
    """The run behind the report."""
    return run(plan, out, workers=1)


@pytest.fixture(scope="module")
def text(plan: Plan, results: Results, out: Path) -> str:
    """The report."""
    path = write_report(plan, results, out, COMMAND)
    assert path == out / "report.html"
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    """The report, read as a browser would."""
    return Page(text)


def test_the_page_loads_nothing(page: Page, text: str) -> None:
    """No script, style sheet, font or image from elsewhere: links lead into the page itself."""
    assert not {"link", "iframe", "img", "object", "embed", "base"} & set(page.tags)
    links = [(tag, value) for tag, name, value in page.attributes if name in LOADING]
    assert links
    for tag, value in links:
        assert value.startswith("#"), (tag, value)
    assert all(target.startswith("#") for target in re.findall(r"url\(['\"]?([^)'\"]*)", text))
    assert "@import" not in text


@needs_browser
def test_every_gap_plays_in_a_browser_that_is_asked_for_nothing_else(
    page: Page, text: str, tmp_path: Path
) -> None:
    """As many playbacks as gaps from above; each steps by a key, and nothing is complained of."""
    path = tmp_path / "report.html"
    path.write_text(text, encoding="utf-8")
    with Browser(tmp_path) as browser:
        shown = browser.open(path)
        count = shown.value("document.querySelectorAll('.mdkf-playback').length")
        assert count == len(page.figures) - 1
        for number in range(count):
            root = f"document.querySelectorAll('.mdkf-playback')[{number}].shadowRoot"
            time = f"{root}.querySelector('.time').textContent"
            before = shown.value(time)
            shown.value(f"{root}.querySelector('.slider').focus()")
            shown.press("ArrowLeft")
            assert shown.value(time) != before
        assert shown.complaints == []
        assert shown.requests == [path.as_uri()]


def test_every_scenario_and_filter_is_there(page: Page, plan: Plan) -> None:
    """In the table of scores, and in the heading what the run was."""
    heading, *names = (row[0] for row in page.tables["scores"])
    assert heading == "filter"
    expected = []
    for scenario in plan.scenarios:
        expected += [scenario.name, *plan.filters]
    assert [name.split(":")[0] for name in names] == expected
    visible = " ".join(page.texts)
    for told in ("2 seeds", "mid:20:35", "pointrcnn", COMMAND):
        assert told in visible


def test_every_number_is_that_of_the_results(page: Page, out: Path, plan: Plan) -> None:
    """Cell by cell against results.parquet: mean and half of the interval, as far as shown."""
    stored = pl.read_parquet(out / "results.parquet")
    heading, *rows = page.tables["scores"]
    columns = {shown: column for column, shown, _, _ in COLUMNS}
    scenario, seen = "", 0
    for name, *cells in rows:
        if not cells:
            scenario = name.split(":")[0]
            continue
        own = stored.filter(scenario=scenario, filter=name).row(0, named=True)
        for shown, cell in zip(heading[1:], cells, strict=True):
            column = columns[shown]
            mean, *half = cell.split(" ±")
            assert_shown(mean, own[column])
            if own.get(f"{column}_high") is None:
                assert half == []
            else:
                assert_shown(half[0], own[f"{column}_high"] - own[column])
                assert_shown(half[0], own[column] - own[f"{column}_low"])
            seen += 1
    assert seen == len(COLUMNS) * len(plan.scenarios) * len(plan.filters)


def test_states_are_those_of_the_results(page: Page, out: Path, plan: Plan) -> None:
    """Cell by cell against results.parquet, with the interval where there is one."""
    stored = pl.read_parquet(out / "results.parquet")
    _, *rows = page.tables["states"]
    scenario, seen = "", 0
    for name, *cells in rows:
        if not cells:
            scenario = name
            continue
        own = stored.filter(scenario=scenario, filter=name).row(0, named=True)
        for (column, *_), cell in zip(STATES, cells, strict=True):
            mean, *half = cell.split(" ±")
            assert_shown(mean, own[column])
            if half:
                assert_shown(half[0], own[f"{column}_high"] - own[column])
            assert (half == []) == (own.get(f"{column}_high") is None)
            seen += 1
    assert seen == len(STATES) * len(plan.scenarios) * len(plan.filters)


def test_bins_are_means_over_the_seeds_that_have_a_value(page: Page, out: Path, plan: Plan) -> None:
    """Cell by cell against breakdown.parquet, averaged in numpy; every bin of every scenario."""
    stored = pl.read_parquet(out / "breakdown.parquet")
    for score, group, *_ in BINNED:
        (heading, *rows), scenario, seen = page.tables[f"{score}-{group.replace(',', '-')}"], "", 0
        assert heading[1:] == list(plan.filters)
        for name, *cells in rows:
            if not cells:
                scenario = name
                continue
            for chosen, cell in zip(plan.filters, cells, strict=True):
                own = stored.filter(
                    scenario=scenario, filter=chosen, bin=name, group=group, score=score
                )
                values = own["value"].drop_nulls().to_numpy()
                mean, *half = cell.split(" ±")
                assert_shown(mean, values.mean() if len(values) else None)
                if len(values) > 1:
                    assert_shown(half[0], stats.t.ppf(0.975, 1) * stats.sem(values))
                seen += 1
        bins = stored.filter(group=group, score=score).select("scenario", "bin").n_unique()
        assert seen == bins * len(plan.filters) > 0


def assert_shown(text: str, value: float | None) -> None:
    """The text is the value, rounded to the decimals of the text."""
    if value is None:
        assert text == "–"
        return
    decimals = len(text.partition(".")[2])
    assert float(text) == pytest.approx(value, abs=0.5 * 10**-decimals + 1e-9)


def test_the_best_of_a_column_is_marked(text: str, results: Results) -> None:
    """HOTA: the largest of each scenario is one of the marked cells, the smallest is not."""
    for scenario in ("bus_stop", "stop_and_go"):
        group = text.split(f">{scenario}: ")[1].split('class="group"')[0].split("</table>")[0]
        first = re.findall(r'<td class="name">(\w+)</td><td( class="best")?>', group)
        hota = dict(results.table.filter(scenario=scenario).select("filter", "hota").iter_rows())
        assert {name for name, marked in first if marked} == {
            name for name, value in hota.items() if value == max(hota.values())
        }


def test_errors_over_time_and_gaps_from_above_are_drawn(page: Page) -> None:
    """A figure is an SVG in the page: the mean error of each scenario, and at least one gap with
    truth, detections and every filter."""
    assert page.drawings == len(page.figures) >= 2
    over_time, *above = (" ".join(figure) for figure in page.figures)
    for word in ("bus_stop", "stop_and_go", "ca", "imm", "md", "time since the gap began [s]"):
        assert word in over_time
    for figure in above:
        for word in ("truth", "removed detections", "x [m]", "y [m]", "seed 0", "ca", "imm", "md"):
            assert word in figure
    assert {w for w in ("bus_stop", "stop_and_go") for f in above if w in f} >= {"bus_stop"}


def test_the_same_results_give_the_same_bytes(
    plan: Plan, results: Results, out: Path, text: str, tmp_path: Path
) -> None:
    """Written again, and elsewhere from the files of the run."""
    path = write_report(plan, results, out, COMMAND)
    assert path.read_bytes() == text.encode()
    elsewhere = tmp_path / "copy"
    shutil.copytree(out, elsewhere)
    assert write_report(plan, results, elsewhere, COMMAND).read_bytes() == text.encode()
    assert [p.name for p in out.glob(".*")] == []


def test_names_and_reasons_are_text_not_markup(
    plan: Plan, results: Results, out: Path, tmp_path: Path
) -> None:
    """A scenario's name, the command and the reason of a refusal full of HTML show as they are,
    in tables and in pictures."""
    nasty = "<b onload='x'>&amp;\"</i>"
    folder_name = f"{nasty}-0"
    (scenario, _) = plan.scenarios
    renamed = dataclasses.replace(plan, scenarios=(dataclasses.replace(scenario, name=nasty),))
    tables = {
        name: getattr(results, name)
        .filter(scenario=scenario.name)
        .with_columns(pl.lit(nasty).alias("scenario"))
        for name in ("table", "differences", "worlds", "errors", "breakdown")
    }
    kept = tmp_path / "worlds" / folder_name
    shutil.copytree(out / "worlds" / f"{scenario.name}-0", kept)
    other = dataclasses.replace(results, **tables, refused=(f"{nasty}, seed 9",), kept={nasty: 0})
    page = Page(write_report(renamed, other, tmp_path, f"mdkf run {nasty}").read_text())
    assert "b" not in page.tags
    assert not [name for _, name, _ in page.attributes if name.startswith("on")]
    assert page.tables["scores"][1][0].startswith(f"{nasty}: 2 seeds")
    visible = "".join(page.texts)
    assert f"mdkf run {nasty}" in visible
    assert f"{nasty}, seed 9" in visible
    assert len(page.figures) >= 2
    assert all(any(nasty in line for line in figure) for figure in page.figures)


def test_an_interrupted_run_and_refused_seeds_are_told(
    plan: Plan, results: Results, out: Path, tmp_path: Path
) -> None:
    """Whoever reads the page must know that worlds are missing."""
    partial = dataclasses.replace(results, interrupted=True, refused=("bus_stop, seed 5: crash",))
    visible = " ".join(Page(write_report(plan, partial, tmp_path, COMMAND).read_text()).texts)
    assert "Interrupted" in visible
    assert "bus_stop, seed 5: crash" in visible
    whole = " ".join(Page((out / "report.html").read_text()).texts)
    assert "Interrupted" not in whole
    assert "refused" not in whole


@pytest.mark.parametrize("occlusion", ["none", "mid:20:35"])
def test_results_without_gaps_or_kept_tables_still_make_a_page(
    plan: Plan, results: Results, tmp_path: Path, occlusion: str
) -> None:
    """Scores alone, without figures, if nothing was hidden; no pictures of gaps if the first
    seed's tables are not there."""
    changed = dataclasses.replace(plan, occlusion=OcclusionProtocol.parse(occlusion))
    if occlusion == "none":
        results = dataclasses.replace(results, errors=results.errors.clear())
    page = Page(write_report(changed, results, tmp_path, COMMAND).read_text())
    assert len(page.tables["scores"]) == 1 + 2 * (1 + 3)
    assert len(page.figures) == (occlusion != "none")
