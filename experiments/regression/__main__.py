"""Makes the golden worlds anew, and the manifest that says what they were made with."""

import json

from experiments.regression.golden import (
    FOLDER,
    MANIFEST,
    PIECES,
    PREFIX,
    VERSION,
    golden_file,
    made,
    makers,
)
from sim_bridge import write_table
from sim_bridge.parquet import replacing

COMMAND = "python -m experiments.regression"


def main() -> None:
    """Simulate every piece, write its tables."""
    worlds = {}
    FOLDER.mkdir(exist_ok=True)
    for name, piece in PIECES.items():
        trace, detections = made(piece, name)
        write_table(trace, golden_file(f"{PREFIX}{name}", "trace"))
        write_table(detections, golden_file(f"{PREFIX}{name}", "detections"))
        worlds[name] = {
            "scenario": piece.scenario,
            "seed": 0,
            "first_frame": piece.first,
            "frames": piece.frames,
            "objects": list(piece.objects),
            "trace": trace.content_hash(),
            "detections": detections.content_hash(),
        }
        print(f"{PREFIX}{name}: {trace!r}, {detections!r}")
    told = {"version": VERSION, "command": COMMAND, "made_with": makers(), "worlds": worlds}
    with replacing(MANIFEST) as temporary:
        temporary.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
