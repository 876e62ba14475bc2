"""Errors around the gaps of recorded objects into one row per filter."""

from typing import Any

import polars as pl

from experiments.statistics import clustered_interval, told

OBJECT = ("sequence", "object_id")
GAP = (*OBJECT, "gap_start")


def gap_rows(errors: pl.DataFrame) -> list[dict[str, Any]]:
    """One row for each filter; intervals are over objects, the differences paired by object.

    errors: `Results.errors`. gaps: how many there are; followed: how many a track follows;
    captured, deleted: percent of these in which another detection took the track, or it ended;
    lost: percent of those with a reappearing object whose track is not with it afterwards.
    error: mean distance of the followed tracks in the gaps while they live [m]. drift: the
    filter's own, in every gap (`experiments.drift`) [m]; against: its difference to the first
    filter's, negative where it drifts less.
    """
    if errors.is_empty():
        return []
    in_gap = errors.filter(pl.col("phase") == "gap")
    rows: list[dict[str, Any]] = []
    names = errors["filter"].unique(maintain_order=True).to_list()
    first = in_gap.filter(pl.col("filter") == names[0])
    for name in names:
        own = in_gap.filter(pl.col("filter") == name)
        followed = own.filter(pl.col("track_id") >= 0)
        by_gap = errors.filter(filter=name).filter(pl.col("track_id") >= 0)
        by_gap = by_gap.group_by(GAP).agg(
            pl.col("captured", "deleted", "recovered").first(),
            (pl.col("phase") == "after").any().alias("reappears"),
        )
        paired = own.join(first, on=[*OBJECT, "frame"], suffix="_first").with_columns(
            against=pl.col("drift") - pl.col("drift_first")
        )
        rows.append(
            {
                "filter": name,
                "gaps": errors.filter(filter=name).select(GAP).n_unique(),
                "followed": len(by_gap),
                "captured": _percent(by_gap["captured"]),
                "deleted": _percent(by_gap["deleted"]),
                "lost": _percent(~by_gap.filter("reappears")["recovered"]),
                **_over_objects(followed, "error"),
                **_over_objects(own, "drift"),
                **_over_objects(paired, "against"),
            }
        )
    return rows


def _over_objects(errors: pl.DataFrame, column: str) -> dict[str, float | None]:
    """A column's mean over all frames that have a value, with its interval over objects."""
    totals = (
        errors.filter(pl.col(column).is_not_null())
        .group_by(OBJECT)
        .agg(pl.col(column).sum().alias("total"), pl.len().alias("frames"))
        .sort(OBJECT)
    )
    interval = clustered_interval(totals["total"].to_numpy(), totals["frames"].to_numpy())
    return {
        name: told(value)
        for name, value in (
            (column, interval.mean),
            (f"{column}_low", interval.low),
            (f"{column}_high", interval.high),
        )
    }


def _percent(flags: pl.Series) -> float | None:
    share = flags.mean()
    return None if share is None else 100.0 * float(share)  # type: ignore[arg-type]
