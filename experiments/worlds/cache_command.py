"""The command `mdkf cache`: the simulated worlds that are kept, and how to be rid of them."""

import json
import sys
from typing import Annotated

import typer

import sim_bridge
from experiments.options import Json

MEGABYTE = 1e6


def show_cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete what is kept.")] = False,
    as_json: Json = False,
) -> None:
    """Show, or clear, the cache of simulated worlds; MDKF_CACHE names its folder, or is "off"."""
    cache = sim_bridge.user_cache()
    if cache is not None and clear:
        print(f"{cache.folder}: {cache.clear()} traces deleted", file=sys.stderr)
    count, size = (0, 0) if cache is None else cache.size()
    if as_json:
        folder = None if cache is None else str(cache.folder)
        bound = None if cache is None else cache.max_bytes
        print(json.dumps({"folder": folder, "traces": count, "bytes": size, "max_bytes": bound}))
    elif cache is None:
        print("no cache: MDKF_CACHE is off, or there is no home folder")
    else:
        of = f"{size / MEGABYTE:.1f} of {cache.max_bytes / MEGABYTE:.0f} MB"
        print(f"{cache.folder}: {count} traces, {of}")
