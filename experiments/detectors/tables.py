"""Comparisons of recorded and simulated detections on the terminal."""

from collections.abc import Sequence
from math import isnan

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from experiments.detectors.compare import PART, POINTS, Row
from sim_bridge import Profile


def comparison_table(title: str, rows: Sequence[Row]) -> Table:
    """One row per comparison; what is farther off than allowed says so."""
    judged = [row for row in rows if row.within is not None]
    within, near = (sum(verdict(row) == word for row in judged) for word in ("yes", "in CI"))
    table = Table(
        title=f"{title}: {within} of {len(judged)} within the limits (recall"
        f" ±{100 * POINTS:g} points, errors and false boxes ±{100 * PART:g} %), {near} more within"
        " the 95 % interval of the recorded value",
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        caption="Errors are medians, false boxes counted per frame; 'there again': with another"
        " within a metre in the next frame.",
        caption_justify="left",
    )
    table.add_column("", no_wrap=True)
    table.add_column("of", no_wrap=True)
    for heading in ("recorded", "95 % CI", "simulated", "within"):
        table.add_column(heading, justify="right", no_wrap=True)
    before = None
    for row in rows:
        interval = "–" if isnan(row.low) else f"{row.low:.3f}, {row.high:.3f}"
        what = row.what if row.what != before else ""
        before = row.what
        values = (what, row.of, f"{row.real:.3f}", interval, f"{row.simulated:.3f}")
        word = verdict(row)
        table.add_row(*map(escape, values), f"[bold]{word}[/bold]" if word == "no" else word)
    return table


def verdict(row: Row) -> str:
    """yes: within the limit; in CI: not, but the recorded value is not known more closely."""
    if row.within is None:
        return "–"
    if row.within:
        return "yes"
    return "in CI" if row.low <= row.simulated <= row.high else "no"


def distance_line(distances: dict[str, float]) -> str:
    """The distributions' distances in a line."""
    listed = ", ".join(f"{name} {value:.3f}" for name, value in distances.items()) or "none"
    return f"Kolmogorov-Smirnov distances, recorded against simulated: {listed}\n"


def evidence_table(profile: Profile) -> Table:
    """What a profile was fitted to, and how well it fits there."""
    table = Table(
        title=f"{profile.name}: fitted to", title_justify="left", show_header=False, box=SIMPLE_HEAD
    )
    for key, value in profile.evidence.items():
        table.add_row(key.replace("_", " "), escape(str(value)))
    return table
