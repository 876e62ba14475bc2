"""Templates into self-contained HTML pages, figures into the SVG that stands in them."""

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments import figures
from sim_bridge.parquet import replacing


def write_page(template: str, path: Path, **content: Any) -> None:
    """Write a template of this package, filled in, whole or not at all; all that is not `Markup`
    is escaped, and a name that the template uses and nobody gave is an error."""
    environment = Environment(
        loader=PackageLoader("experiments", "."),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template).render(**content)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def svg(figure: Figure) -> Markup:
    """The figure as it stands in a page."""
    return Markup(figures.as_svg(figure))
