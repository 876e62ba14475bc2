"""Your own scenario: a car passes behind a parked truck: python own_scenario.py [FOLDER]."""

import sys
from pathlib import Path

import yaml

import experiments
import scenarios
import sim_bridge
from experiments.plots import birds_eye

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "mdkf-out/own_scenario")
folder.mkdir(parents=True, exist_ok=True)


def parameter(unit: str, default: float, low: float, high: float, what: str) -> dict[str, object]:
    """What `scenarios.load(..., speed=9.0)` or `mdkf run --set speed=9` may change."""
    return {"unit": unit, "default": default, "minimum": low, "maximum": high, "description": what}


# The sensor stands at the origin, 1.73 m above the ground.
described = {
    "name": "behind_a_truck",
    "purpose": "A car drives by behind a parked truck.",
    "source": "closed-form",
    "motion": "polynomial",
    "duration": 10.0,
    "parameters": {
        "x": parameter("m", -30.0, -60.0, 0.0, "where the car starts"),
        "y": parameter("m", 12.0, 9.0, 40.0, "how far to the left of the sensor it drives"),
        "heading": parameter("rad", 0.0, -0.2, 0.2, "direction in which it drives"),
        "speed": parameter("m/s", 6.0, 1.0, 20.0, "its speed at the start"),
        "acceleration": parameter("m/s2", 0.0, -2.0, 2.0, "its acceleration at the start"),
        "jerk": parameter("m/s3", 0.0, -1.0, 1.0, "its jerk"),
    },
    "statics": [{"kind": "truck", "x": 0, "y": 6, "length": 9, "width": 2.5, "height": 3.5}],
}
file = folder / "behind_a_truck.yaml"
file.write_text(yaml.safe_dump(described, sort_keys=False))

# A mistake in the file is one line that names file, key and what was expected.
scenario = scenarios.load(file, speed=8.0)
trace = sim_bridge.simulate(scenario, seed=0)
print(trace.describe())

# The frame in which the car is hidden from the sensor, and the whole way.
frame = int(trace.frame[trace.visible.argmin()])
birds_eye(trace, frame=frame, view=(-30, 30, -5, 20)).savefig(folder / "hidden.png")
experiments.plot(trace).savefig(folder / "all.png")
print(f"mdkf run {file} --seeds 5")
