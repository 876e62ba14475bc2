"""Scores on recorded detections on the terminal, with what others published beside them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.kitti.compare import heading, verdict
from experiments.kitti.published import AB3DMOT, PAPER, ROBMOT, Published
from experiments.kitti.rules import Rules
from experiments.terminal import best

COLUMNS = (
    # column, heading, decimals, whether smaller is better
    ("hota", "HOTA %", 2, False),
    ("deta", "DetA %", 2, False),
    ("assa", "AssA %", 2, False),
    ("mota", "MOTA %", 2, False),
    ("motp", "MOTP %", 2, False),
    ("idsw", "IDSW", 0, True),
    ("fp", "FP", 0, True),
    ("fn", "FN", 0, True),
    ("idf1", "IDF1 %", 2, False),
    ("ground_hota", "HOTA 2 m", 2, False),
    ("ground_mota", "MOTA 2 m", 2, False),
    ("ground_idsw", "IDSW 2 m", 0, True),
    ("ms_per_frame", "ms/frame", 3, True),
)

_SOURCES = {
    ROBMOT: "RobMOT: its own program's tracks",
    AB3DMOT: "AB3DMOT: its own program's tracks",
    PAPER: "paper: its own runs in RobMOT's framework, on its own machine, timed on all sequences",
}


def scores_table(
    title: str, rows: Sequence[Mapping[str, Any]], published: Sequence[Published]
) -> Table:
    """Scores by filter, best in bold; under a filter what was published of it."""
    sources = dict.fromkeys(entry.source for entry in published)
    notes = [entry.note for entry in published if entry.note]
    told = "; ".join([*(_SOURCES[source] for source in sources), *notes])
    table = Table(
        title=title,
        title_justify="left",
        caption="2 m: similarity 1 - d / 2 m of the distance on the ground; the rest by overlap in"
        " the picture. ms/frame: the tracker's CPU time." + (f" {told}." if told else ""),
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("filter", no_wrap=True)
    for _, name, _, _ in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    leaders = {column: best(rows, column, smaller) for column, _, _, smaller in COLUMNS}
    for row in rows:
        cells = []
        for column, _, decimals, _ in COLUMNS:
            text = _number(row[column], decimals)
            cells.append(f"[bold]{text}[/bold]" if row[column] == leaders[column] else text)
        table.add_row(escape(row["filter"]), *cells)
        _add_published(table, (entry for entry in published if entry.filter == row["filter"]))
    _add_published(table, (entry for entry in published if not entry.filter))
    return table


def published_table(published: Sequence[Published]) -> Table:
    """What was published of detectors of which there are no detections here."""
    names = {column for entry in published for column in entry.values}
    columns = [column for column in COLUMNS if column[0] in names]
    table = Table(
        title="published of other detectors on the val split",
        title_justify="left",
        caption="; ".join(_SOURCES[name] for name in {entry.source for entry in published}) + ".",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for name in ("detector", "filter"):
        table.add_column(name, no_wrap=True)
    for _, name, _, _ in columns:
        table.add_column(name, justify="right", no_wrap=True)
    for entry in published:
        cells = [_number(entry.values.get(name), decimals, "") for name, _, decimals, _ in columns]
        table.add_row(entry.detector, f"{entry.filter} ({entry.source})", *cells)
    return table


def scores_title(detector: str, rules: Rules, occlusion: str) -> str:
    """What a table of scores is of."""
    gaps = "" if occlusion == "none" else f", occlusion {occlusion}"
    return f"{detector}{gaps}, rules {rules.name}: {rules.meaning}"


def gap_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Errors in gaps by filter, with their intervals."""
    table = Table(
        title=title,
        title_justify="left",
        caption="Means with 95 % intervals by bootstrap over objects. error: of the tracks, while"
        " they live; drift: of the filter alone, in every gap, labels telling which detection is"
        " whose. captured, deleted, lost: percent of the followed tracks that took another"
        " detection in the gap, ended in it, were not with their object afterwards.",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    first = rows[0]["filter"]
    table.add_column("filter", no_wrap=True)
    for name in ("followed", "capt. %", "del. %", "lost %"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("error [m]", "drift [m]", f"drift - {first}'s [m]"):
        table.add_column(escape(name), justify="right", no_wrap=True)
    leaders = {column: best(rows, column, True) for column in ("error", "drift")}
    for row in rows:
        cells = [row["filter"], _number(row["followed"], 0)]
        cells += [_number(row[column], 0) for column in ("captured", "deleted", "lost")]
        for column in ("error", "drift"):
            text = _with_interval(row, column, "")
            leads = row[column] == leaders[column]
            cells.append(f"[bold]{text}[/bold]" if leads else text)
        cells.append("–" if row["filter"] == first else _with_interval(row, "against", "+"))
        table.add_row(*cells)
    return table


def comparison_table(
    title: str, rows: Sequence[Mapping[str, Any]], scores: Sequence[str], counts: Sequence[str]
) -> Table:
    """Recorded against simulated detections, by filter, with the filters' ranks."""
    table = Table(
        title=title,
        title_justify="left",
        caption="rec.: recorded; sim.: simulated, mean over seeds; in brackets the filter's rank;"
        " difference: simulated less recorded, with its 95 % interval over seeds."
        f" {verdict(rows, scores)}.",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("filter", no_wrap=True)
    for name in scores:
        for side in (f"{heading(name)} rec.", "sim.", "difference"):
            table.add_column(side, justify="right", no_wrap=True)
    for name in counts:
        for side in (f"{heading(name)} rec.", "sim."):
            table.add_column(side, justify="right", no_wrap=True)
    for row in rows:
        cells = [escape(row["filter"])]
        for column in scores:
            for side in ("recorded", "simulated"):
                value, rank = row[f"{column}_{side}"], row[f"{column}_{side}_rank"]
                cells.append("–" if value is None else f"{value:.2f} ({rank})")
            cells.append(_with_interval(row, f"{column}_difference", "+"))
        for column in counts:
            cells += [_number(row[f"{column}_recorded"], 0), _number(row[f"{column}_simulated"], 1)]
        table.add_row(*cells)
    return table


def differences_table(
    title: str, rows: Sequence[Mapping[str, Any]], scores: Sequence[str]
) -> Table:
    """Each filter's scores less the first one's, recorded and simulated, and whether they agree."""
    first = rows[0]["filter"]
    table = Table(
        title=title,
        title_justify="left",
        caption=f"Scores less {first}'s on the same detections, with 95 % intervals by jackknife"
        " over sequences. agree: both differ from 0, and alike; contradict: oppositely; not"
        " separable: other sequences might turn one of them round.",
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("filter", no_wrap=True)
    for name in scores:
        for side in (f"{heading(name)} rec.", "sim.", ""):
            table.add_column(side, justify="right", no_wrap=True)
    for row in rows[1:]:
        cells = [escape(row["filter"])]
        for column in scores:
            for side in ("recorded", "simulated"):
                cells.append(_with_interval(row, f"{column}_{side}_against", "+"))
            cells.append(row[f"{column}_verdict"])
        table.add_row(*cells)
    return table


def _add_published(table: Table, entries: Iterable[Published]) -> None:
    for entry in entries:
        cells = [
            _number(entry.values.get(column), decimals, "") for column, _, decimals, _ in COLUMNS
        ]
        table.add_row(f"  {entry.source}", *cells, style="dim")


def _number(value: float | None, decimals: int, missing: str = "–") -> str:
    return missing if value is None else f"{value:.{decimals}f}"


def _with_interval(row: Mapping[str, Any], column: str, sign: str) -> str:
    value, low, high = row[column], row[f"{column}_low"], row[f"{column}_high"]
    if value is None:
        return "–"
    text = f"{value:{sign}.2f}"
    return text if low is None else f"{text} \\[{low:{sign}.2f}, {high:{sign}.2f}]"
