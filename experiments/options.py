"""What several commands share: options, and a spinner while one works."""

from contextlib import nullcontext
from typing import Annotated, Any

import typer
from rich.console import Console

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of tables.")]


def busy(what: str) -> Any:
    """A context in which a terminal shows that something is being done."""
    console = Console(stderr=True)
    return console.status(what) if console.is_terminal else nullcontext()
