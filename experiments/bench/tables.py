"""Results as tables on a terminal of 120 columns."""

from collections.abc import Iterator, Sequence

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.bench import filters, trackers
from experiments.bench.results import RATIO, Row
from experiments.bench.targets import PAPER_RATIOS, TRACKS, Target


def tables(rows: Sequence[Row], reached: Sequence[Target]) -> Iterator[Table]:
    """The tables of what was measured."""
    filtered = [row for row in rows if row.what == filters.WHAT]
    tracked = [row for row in rows if row.what == trackers.WHAT]
    ratios = [row for row in rows if row.what.endswith(RATIO)]
    others = [row for row in rows if row not in (*filtered, *tracked, *ratios)]
    if filtered:
        yield _filters(filtered)
    if ratios:
        yield _ratios(ratios)
    if tracked:
        yield _trackers(tracked)
    if others:
        yield _others(others)
    if reached:
        yield _targets(reached)


def _filters(rows: Sequence[Row]) -> Table:
    """Times by tier, filter and size, and how they compare with filterpy at 50 tracks; filterpy
    and numpy at the most tracks that they were given."""
    sizes = sorted({row.size for row in rows})
    table = _table("Filters: ns per track and step (predict + update), by number of tracks")
    for heading in ("tier", "filter"):
        table.add_column(heading, no_wrap=True)
    for heading in (*map(_count, sizes), f"x filterpy ca, {TRACKS}"):
        table.add_column(heading, justify="right")
    for tier in filters.TIERS:
        of_tier = [row for row in rows if row.tier == tier]
        for k, name in enumerate(dict.fromkeys(row.name for row in of_tier)):
            by_size = {row.size: row for row in of_tier if row.name == name}
            times = [_time(by_size[size]) if size in by_size else "" for size in sizes]
            compared = by_size.get(TRACKS, by_size[max(by_size)])
            table.add_row("" if k else tier, name, *times, _ratio(compared))
        table.add_section()
    told = [f"{tier}: {text}" for tier, text in filters.TIERS.items()]
    table.caption = "; ".join(told) + ". filterpy and numpy cost the same per track for any number."
    return table


def _ratios(rows: Sequence[Row]) -> Table:
    """Ratios of costs by tier; of the filters the sizes for which there is something to say."""
    names = list(dict.fromkeys(row.name for row in rows))
    table = _table("Ratios of costs [10th, 90th percentile]")
    for heading in ("tier", "size"):
        table.add_column(heading, no_wrap=True)
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    for tier in dict.fromkeys(row.tier for row in rows):
        of_tier = [row for row in rows if row.tier == tier]
        sizes = sorted({row.size for row in of_tier})
        for size in sizes:
            cells = {row.name: _spread(row) for row in of_tier if row.size == size}
            table.add_row(tier, _count(size), *(cells.get(name, "") for name in names))
            tier = ""
    paper = [PAPER_RATIOS.get(name.replace("imm-zero", "imm")) for name in names]
    table.add_section()
    table.add_row("paper", "KITTI", *(f"{value:.2f}" if value else "" for value in paper))
    table.caption = "The paper's are of the whole tracker; it does not say how its IMM mixes."
    return table


def _trackers(rows: Sequence[Row]) -> Table:
    table = _table("Tracker: us per frame, by objects")
    sizes = sorted({row.size for row in rows})
    table.add_column("filter", no_wrap=True)
    for size in sizes:
        table.add_column(_count(size), justify="right", no_wrap=True)
    for name in dict.fromkeys(row.name for row in rows):
        by_size = {row.size: _time(row) for row in rows if row.name == name}
        table.add_row(name, *(by_size[size] for size in sizes))
    return table


def _others(rows: Sequence[Row]) -> Table:
    table = _table("The rest of the flow")
    for heading in ("what", "name", "tier"):
        table.add_column(heading, no_wrap=True)
    for heading in ("size", "time", "times as fast"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("as")
    for row in rows:
        time = f"{_time(row)} {row.unit}"
        compared = (_ratio(row), row.ratio_to) if row.ratio_to else ("", "")
        table.add_row(row.what, row.name, row.tier, _count(row.size), time, *map(str, compared))
    return table


def _targets(reached: Sequence[Target]) -> Table:
    table = _table("Targets")
    table.add_column("target")
    table.add_column("tier", no_wrap=True)
    for heading in ("wanted", "measured [10th, 90th]"):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    table.add_column("met", no_wrap=True)
    for target in reached:
        wanted = f"{'≥' if target.at_least else '≤'} {target.bound:g}"
        measured = f"{_number(target.median)} [{_number(target.low)}, {_number(target.high)}]"
        verdict = ("yes" if target.met else "no") + ("" if target.clear else ", within the spread")
        colour = "green" if target.met else "red"
        cells = map(escape, (target.target, target.tier, wanted, measured))
        table.add_row(*cells, f"[{colour}]{verdict}[/{colour}]")
    return table


def _table(title: str) -> Table:
    table = Table(title=escape(title), box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.title_justify = table.caption_justify = "left"
    return table


def _time(row: Row) -> str:
    """A median with half of its spread in per cent."""
    return f"{_number(row.median)} ±{50 * (row.high - row.low) / row.median:.0f}%"


def _spread(row: Row) -> str:
    """A ratio of costs with its percentiles."""
    return escape(f"{row.median:.2f} [{row.low:.2f}, {row.high:.2f}]")


def _ratio(row: Row) -> str:
    """How many times as fast as what it refers to, with percentiles."""
    if row.ratio is None or row.ratio_low is None or row.ratio_high is None:
        return "1"
    low, high = _number(row.ratio_low), _number(row.ratio_high)
    return escape(f"{_number(row.ratio)} [{low}, {high}]")


def _number(value: float) -> str:
    """Three digits or the whole number, thousands apart."""
    if value >= 100:
        return _count(round(value))
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _count(value: int) -> str:
    return f"{value:,}".replace(",", " ")
