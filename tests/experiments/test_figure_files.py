"""Claim: a figure becomes a file whole or not at all, and equal figures give equal files."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from experiments.figures import write_figure


def drawn(end: float = 2.0) -> Figure:
    figure = Figure(figsize=(3, 2))
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, end], marker="o", clip_on=True)
    axes.set_xlabel("time [s]")
    return figure


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_equal_figures_give_equal_files(tmp_path: Path, kind: str) -> None:
    """Drawn twice, no date and no random name differs; another figure is another file."""
    for name, figure in (("one", drawn()), ("two", drawn()), ("other", drawn(3.0))):
        write_figure(figure, tmp_path / f"{name}.{kind}")
    one, two, other = ((tmp_path / f"{n}.{kind}").read_bytes() for n in ("one", "two", "other"))
    assert one == two != other


def test_each_is_what_its_name_says(tmp_path: Path) -> None:
    """A document that any reader of SVG takes, whose text is text; 150 dots to an inch."""
    for kind in ("svg", "png"):
        write_figure(drawn(), tmp_path / f"figure.{kind}")
    root = ElementTree.parse(tmp_path / "figure.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "time [s]" in "".join(root.itertext())
    head = (tmp_path / "figure.png").read_bytes()[:24]
    assert head.startswith(b"\x89PNG")
    assert [int.from_bytes(head[k : k + 4], "big") for k in (16, 20)] == [450, 300]


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_a_figure_that_cannot_be_drawn_leaves_the_file_as_it_was(tmp_path: Path, kind: str) -> None:
    """And nothing beside it."""
    path = tmp_path / f"figure.{kind}"
    write_figure(drawn(), path)
    before, broken = path.read_bytes(), drawn()
    broken.axes[0].set_title("$\\nosuchcommand$")
    with pytest.raises(ValueError, match="nosuchcommand"):
        write_figure(broken, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
