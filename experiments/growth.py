"""Placeholder until the growth room is merged."""

import polars as pl

GROWTH = {"regime": pl.String, "offset": pl.Int64, "drift": pl.Float64, "gaps": pl.Int64}


def growth(errors: pl.DataFrame) -> pl.DataFrame:
    """Rows by regime and offset."""
    own = errors.filter(pl.col("phase") != "after", pl.col("offset") >= -1).drop_nulls("drift")
    found = own.group_by("regime", "offset").agg(
        pl.col("drift").mean(), pl.len().cast(pl.Int64).alias("gaps")
    )
    return found.sort("regime", "offset").select(*GROWTH).cast(GROWTH)  # type: ignore[arg-type]
