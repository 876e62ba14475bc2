"""Scores on recorded detections on the terminal, with what others published beside them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.kitti.compare import heading, verdict
from experiments.kitti.published import AB3DMOT, PAPER, ROBMOT, Published
from experiments.kitti.rules import Rules
from experiments.terminal import FULL_WIDTH, best

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
    ("ms_per_frame", "ms", 3, True),
)

WIDTH = 120
"""Characters that the tables of scores and gaps need with all that they tell."""

NARROW = ("hota", "assa", "mota", "idsw", "fp", "fn", "idf1", "ms_per_frame")
"""Columns for which a terminal of 80 characters has room."""

_SOURCES = {
    ROBMOT: "RobMOT: its own program's tracks",
    AB3DMOT: "AB3DMOT: its own program's tracks",
    PAPER: "paper: its own runs in RobMOT's framework, on its own machine, timed on all sequences",
}


def scores_table(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    published: Sequence[Published],
    wide: bool = True,
) -> Table:
    """Scores by filter, best in bold; under a filter what was published of it. Not wide: some."""
    columns = [column for column in COLUMNS if wide or column[0] in NARROW]
    sources = dict.fromkeys(entry.source for entry in published)
    notes = [entry.note for entry in published if entry.note]
    sentences = "; ".join([*(_SOURCES[source] for source in sources), *notes])
    overlap = "by overlap in the picture."
    meaning = f"2 m: similarity 1 - d / 2 m of the distance on the ground; the rest {overlap}"
    table = _table(
        title,
        f"{meaning if wide else overlap.capitalize()} ms: the tracker's CPU time per frame."
        + (f" {sentences}." if sentences else ""),
    )
    table.add_column("filter", no_wrap=True)
    for _, name, _, _ in columns:
        table.add_column(name, justify="right", no_wrap=True)
    leaders = {column: best(rows, column, smaller) for column, _, _, smaller in columns}
    for row in rows:
        cells = []
        for column, _, decimals, _ in columns:
            text = _number(row[column], decimals)
            cells.append(f"[bold]{text}[/bold]" if row[column] == leaders[column] else text)
        table.add_row(escape(row["filter"]), *cells)
        _add_published(table, columns, (e for e in published if e.filter == row["filter"]))
    _add_published(table, columns, (e for e in published if not e.filter))
    return table


def published_table(published: Sequence[Published]) -> Table:
    """What was published of detectors of which there are no detections here."""
    names = {column for entry in published for column in entry.values}
    columns = [column for column in COLUMNS if column[0] in names]
    table = _table(
        "published of other detectors on the val split",
        "; ".join(_SOURCES[name] for name in dict.fromkeys(e.source for e in published)) + ".",
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


def gap_table(title: str, rows: Sequence[Mapping[str, Any]], wide: bool = True) -> Table:
    """Errors in gaps by filter; wide: with their intervals."""
    table = _table(
        title,
        ("Means with 95 % intervals by bootstrap over objects." if wide else "Means.")
        + " error: of the tracks, while"
        " they live; drift: of the filter alone, in every gap, labels telling which detection is"
        " whose. captured, deleted, lost: percent of the followed tracks that took another"
        " detection in the gap, ended in it, were not with their object afterwards.",
    )
    first = rows[0]["filter"]
    table.add_column("filter", no_wrap=True)
    for name in ("followed", "capt. %", "del. %", "lost %"):
        table.add_column(name, justify="right", no_wrap=True)
    end = " " if wide else "\n"
    for name in (f"error{end}[m]", f"drift{end}[m]", f"drift -{end}{first}'s [m]"):
        table.add_column(escape(name), justify="right", no_wrap=True)
    leaders = {column: best(rows, column, True) for column in ("error", "drift")}
    for row in rows:
        cells = [row["filter"], _number(row["followed"], 0)]
        cells += [_number(row[column], 0) for column in ("captured", "deleted", "lost")]
        for column in ("error", "drift"):
            text = _with_interval(row, column, "", wide)
            leads = row[column] == leaders[column]
            cells.append(f"[bold]{text}[/bold]" if leads else text)
        cells.append("–" if row["filter"] == first else _with_interval(row, "against", "+", wide))
        table.add_row(*cells)
    return table


def comparison_table(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    scores: Sequence[str],
    counts: Sequence[str],
    width: int = FULL_WIDTH,
) -> Table:
    """Recorded against simulated detections, by filter; in less than `FULL_WIDTH` characters
    without the counts, in less than `WIDTH` also without ranks and intervals."""
    wide = width >= WIDTH
    if width < FULL_WIDTH:
        counts = ()
    end = " " if wide else "\n"
    rank = "in brackets the filter's rank; " if wide else ""
    interval = ", with its 95 % interval over seeds" if wide else ""
    table = _table(
        title,
        f"rec.: recorded; sim.: simulated, mean over seeds; {rank}difference:"
        f" simulated less recorded{interval}. {verdict(rows, scores)}.",
    )
    table.add_column("filter", no_wrap=True)
    for name in scores:
        for side in (f"{heading(name)}{end}rec.", "sim.", "difference"):
            table.add_column(side, justify="right", no_wrap=True)
    for name in counts:
        for side in (f"{heading(name)} rec.", "sim."):
            table.add_column(side, justify="right", no_wrap=True)
    for row in rows:
        cells = [escape(row["filter"])]
        for column in scores:
            for side in ("recorded", "simulated"):
                text = _number(row[f"{column}_{side}"], 2)
                place = row[f"{column}_{side}_rank"]
                cells.append(f"{text} ({place})" if wide and place is not None else text)
            cells.append(_with_interval(row, f"{column}_difference", "+", wide))
        for column in counts:
            cells += [_number(row[f"{column}_recorded"], 0), _number(row[f"{column}_simulated"], 1)]
        table.add_row(*cells)
    return table


def differences_table(
    title: str,
    rows: Sequence[Mapping[str, Any]],
    scores: Sequence[str],
    width: int = FULL_WIDTH,
) -> Table:
    """Each filter's scores less the first one's, recorded and simulated, and whether they agree; in
    less than `FULL_WIDTH` characters without intervals."""
    first, wide = rows[0]["filter"], width >= FULL_WIDTH
    end, interval = (" ", ", with 95 % intervals") if wide else ("\n", "; 95 % intervals are")
    table = _table(
        title,
        f"Scores less {first}'s on the same detections{interval} by jackknife over"
        " sequences. agree: both differ from 0, and alike; contradict: oppositely; not"
        " separable: other sequences might turn one of them round.",
    )
    table.add_column("filter", no_wrap=True)
    for name in scores:
        for side in (f"{heading(name)}{end}rec.", "sim.", ""):
            table.add_column(side, justify="right", no_wrap=True)
    for row in rows[1:]:
        cells = [escape(row["filter"])]
        for column in scores:
            for side in ("recorded", "simulated"):
                cells.append(_with_interval(row, f"{column}_{side}_against", "+", wide))
            cells.append(row[f"{column}_verdict"])
        table.add_row(*cells)
    return table


def _table(title: str, caption: str) -> Table:
    """A table without columns yet, the words above and below it flush left."""
    return Table(
        title=title,
        title_justify="left",
        caption=caption,
        caption_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )


def _add_published(
    table: Table, columns: Iterable[tuple[str, str, int, bool]], entries: Iterable[Published]
) -> None:
    for entry in entries:
        cells = [
            _number(entry.values.get(column), decimals, "") for column, _, decimals, _ in columns
        ]
        table.add_row(f"  {entry.source}", *cells, style="dim")


def _number(value: float | None, decimals: int, missing: str = "–") -> str:
    return missing if value is None else f"{value:.{decimals}f}"


def _with_interval(row: Mapping[str, Any], column: str, sign: str, told: bool = True) -> str:
    """A value, and its interval if that is to be told and there is one."""
    value, low, high = row[column], row[f"{column}_low"], row[f"{column}_high"]
    if value is None:
        return "–"
    text = f"{value:{sign}.2f}"
    return text if low is None or not told else f"{text} \\[{low:{sign}.2f}, {high:{sign}.2f}]"
