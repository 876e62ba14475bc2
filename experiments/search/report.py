"""What was found into files: a page, tables, and of each confirmed worst case a sweep file and a
picture."""

from pathlib import Path

from experiments.figures import write_figure
from experiments.page import svg, write_page
from experiments.search.picture import marginal_figure, worst_picture
from experiments.search.run import Found
from experiments.search.sweep_file import write_sweep
from experiments.search.tables import (
    cells,
    check_rows,
    effect_told,
    heading,
    headline,
    told_missing,
    trial_rows,
    world_rows,
)
from sim_bridge.parquet import write_frame

NAME = "report.html"


def write_results(found: Found, out: Path, command: str) -> Path:
    """Write all files of `experiments.search.run` but the kept worlds, and the page, whose path is
    returned; worst cases of an earlier search in the same folder are deleted."""
    for file in out.glob("worst-*"):
        if file.suffix in (".yaml", ".svg", ".png"):
            file.unlink()
    write_frame(trial_rows(found), out / "trials.parquet")
    write_frame(check_rows(found), out / "checks.parquet")
    write_frame(world_rows(found), out / "worlds.parquet")
    plan = found.plan
    cases = []
    for one in found.checks.confirmed if found.checks else ():
        file = out / f"{one.name}.yaml"
        write_sweep(plan, one.trial.point, file)
        picture = worst_picture(found, one)
        for kind in ("svg", "png"):
            write_figure(picture.figure, out / f"{one.name}.{kind}")
        place = (
            f"{axis.name} {one.trial.point[axis.name]:g} {axis.unit}" for axis in plan.space.axes
        )
        cases.append(
            {
                "name": one.name,
                "where": ", ".join(place),
                "svg": svg(picture.figure),
                "caption": picture.caption,
                "file": file.name,
            }
        )
    page = out / NAME
    write_page(
        "search/report.html.j2",
        page,
        plan=plan,
        headline=headline(found),
        scenario=plan.space.defaults.name,
        trials=len(found.trials),
        command=command,
        missing=told_missing(found),
        parameters=[heading(axis) for axis in plan.space.axes],
        lines=cells(found),
        told=effect_told(found),
        unit=plan.goal.unit,
        marginal=svg(marginal_figure(found)),
        cases=cases,
    )
    return page
