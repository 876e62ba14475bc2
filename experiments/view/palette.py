"""What colours mean in a recording."""

import numpy as np
from numpy.typing import NDArray

from experiments.view.scene import Scene

KINDS_SHOWN = {
    "car": ("white", "#e8eaed"),
    "van": ("lilac", "#c9b6ff"),
    "bus": ("yellow", "#f2c94c"),
    "truck": ("brown", "#b08968"),
    "bicycle": ("turquoise", "#4dd0e1"),
    "pedestrian": ("pink", "#f48fb1"),
    "wall": ("grey", "#8d8d8d"),
}
"""Names and colours of the kinds of objects."""

GAP = "#ff2fd0"
SENSOR = "#ff5252"
SIGHT = "#5c8fb0"
DETECTIONS = {"given": "#b0bec5", "removed": GAP, "clutter": SENSOR}
TRUE_PATH = "#9aa0a6"

_LEGEND = """\
## {name}

**Plots**: {plotted}

**Truth**: filled boxes: {kinds}; the darker, the less of them the sensor sees. \
Magenta: in a gap of the occlusion protocol.

**Detections**: thin boxes. Grey: given to the filters; magenta: removed by the protocol; \
red: false.

**Tracks**: boxes in the colour of their filter: {filters}. Filled: coasting, without a \
detection. The ellipse on the roof holds the position with 95 %, if the filter is right. \
Lines: the last seconds of the way.

**Sensor**: red, with an arrow ahead.
"""

_PLOTTED = """\
{}, around its gap: the stretch that is marked on the time line. Click there. All objects with a \
gap are under `objects/` in the streams; `--object ID` looks at another."""


def codes(*colours: str) -> NDArray[np.uint32]:
    """Of each #rrggbb what rerun takes: 0xRRGGBBAA."""
    return np.array([int(colour[1:], 16) << 8 | 0xFF for colour in colours], dtype=np.uint32)


def legend(scene: Scene, plotted: str | None) -> str:
    """What is what, as Markdown. plotted: the object whose gap is looked at, None if there is
    none."""
    told = "none: there is no gap." if plotted is None else _PLOTTED.format(plotted)
    kinds = ", ".join(f"{kind} {name}" for kind, (name, _) in KINDS_SHOWN.items())
    filters = ", ".join(scene.tracks) or "none"
    return _LEGEND.format(name=scene.name, kinds=kinds, filters=filters, plotted=told)
