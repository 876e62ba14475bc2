"""A scene into a piece of HTML that plays it: no network, nothing shared with the page around it.

The piece is a `div` with an id of its own that holds a template (`player.html`, `player.css`), the
scene as JSON and the script that draws it in a shadow tree: neither its styles nor
its ids meet those of the page, so that a page can hold several.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import escape

from experiments.playback.scene import scene
from mdkf.tables import Detections, Trace, Tracks


def playback(
    trace: Trace,
    detections: Detections,
    tracks: Mapping[str, Tracks],
    *,
    focus: int,
    gap: tuple[int, int],
    frames: range | None = None,
    title: str = "",
) -> str:
    """An interactive bird's-eye playback of one object's gap, as a self-contained HTML fragment.

    detections: what the filters were given. tracks: by the name of the filter. focus: object_id of
    the object that is hidden. gap: its first frame and the first after it. frames: what is played,
    3 s before the gap to 2.5 s after it if None, as far as the trace goes. title: plain text.

    The page needs UTF-8 and JavaScript. It begins with, and prints, the last frame of
    the gap without a detection of the object. Raises `ValueError`
    where gap or frames are not in the trace, or the object is not there throughout its gap and in
    the frame before it.
    """
    told = _json(scene(trace, detections, tracks, focus, gap, frames, title))
    name = f"playback-{hashlib.sha256(told.encode()).hexdigest()[:12]}"
    return (
        f'<div class="mdkf-playback" id="{name}">\n'
        f"<noscript><p>{escape(title)}: this playback needs JavaScript.</p></noscript>\n"
        f"<template><style>{_asset('player.css')}</style>{_asset('player.html')}</template>\n"
        f'<script type="application/json">{told}</script>\n'
        f"<script>(() => {{\n{_script()}}})();</script>\n</div>\n"
    )


def _script() -> str:
    parts = (_asset(name) for name in ("world.js", "picture.js", "chart.js", "player.js"))
    return '"use strict";\n' + "".join(parts)


@cache
def _asset(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _json(value: Any) -> str:
    """JSON that stands in a `script` element: no text in it can end the element, or open one."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
