"""Another tracker's results into a table of tracks, from the files that commands are given."""

from pathlib import Path

import sim_bridge
from mdkf import Detections, TableError, Trace, Tracks


def read_results(
    path: Path, trace: Trace, detections: Path | None, root: Path | None = None
) -> Tracks:
    """What `sim_bridge.read_results` reads; detections: their table's file, which errors name."""
    seen = None if detections is None else sim_bridge.read_table(detections, Detections)
    try:
        return sim_bridge.read_results(path, trace, seen, root)
    except TableError as error:
        raise TableError(f"{detections or path}: {error}") from None
