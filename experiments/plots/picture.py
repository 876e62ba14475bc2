"""What all plots share: a figure that notebooks show, and texts that matplotlib takes literally."""

import io
from collections.abc import Mapping

from matplotlib.figure import Figure

from mdkf.registry import built_in_name
from mdkf.tables import Table, TableError, Tracks

LONGEST = 60
"""Characters of a text that a picture shows."""


class Picture(Figure):
    """A figure that a notebook shows by itself, without pyplot; `savefig` writes it to a file."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=110)
        return buffer.getvalue()


def picture(width: float, height: float) -> Picture:
    """An empty figure of this size [inches]."""
    return Picture(figsize=(width, height), layout="constrained")


def plain(text: object) -> str:
    """Any text in one line, in which nothing is a formula: names may come from anywhere."""
    line = " ".join("".join(c if c.isprintable() else " " for c in str(text)).split())
    short = line if len(line) <= LONGEST else line[: LONGEST - 1] + "…"
    return short.replace("$", r"\$")


def origin(table: Table) -> str:
    """Scenario and seed, as far as the table tells."""
    told = table.provenance
    seed = f", seed {told['seed']}" if "seed" in told else ""
    return plain(f"{told.get('scenario', 'own data')}{seed}")


def by_name(tracks: Tracks | Mapping[str, Tracks]) -> dict[str, Tracks]:
    """Tracks by the name of their filter: that of the estimator they tell of, if it is known."""
    if isinstance(tracks, Mapping):
        return dict(tracks)
    told = tracks.provenance.get("estimator", "tracks")
    return {built_in_name(told) or told.partition("(")[0]: tracks}


def check_times(*tables: Table | None) -> None:
    """Raise `TableError` unless all tables have the same frames."""
    given = [table for table in tables if table is not None]
    for table in given[1:]:
        if (table.n_frames, table.dt) != (given[0].n_frames, given[0].dt):
            raise TableError(
                f"{type(table).__name__} of {table.n_frames} frames of {table.dt} s beside"
                f" {type(given[0]).__name__} of {given[0].n_frames} of {given[0].dt} s"
            )
