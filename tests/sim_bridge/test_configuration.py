"""Claim: a user's own SUMO configuration is a scenario, and nothing of the user's is written."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import scenarios
from mdkf.tables import KINDS, Trace
from scenarios import ConfiguredScenario, ScenarioError
from sim_bridge import SimulationError, simulate, sumo, write_table
from sim_bridge.overlap import disjoint, first_overlap
from tests.sim_bridge.town import Edit, instead, replaced, write_town
from tests.sim_bridge.worlds import neighbours

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("town")


@pytest.fixture(scope="module")
def trace(folder: Path) -> Trace:
    return simulate(scenarios.load(write_town(folder)), 5)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_trace_is_that_of_the_traffic(trace: Trace, folder: Path) -> None:
    """Cars and lorries of the declared sizes, between begin and end; the sensor moves; outputs,
    logs and detectors of the configuration wrote nothing."""
    expected = {KINDS.index("car"): (4.5, 1.8, 1.5), KINDS.index("truck"): (9.0, 2.5, 3.5)}
    sizes = set(zip(trace.kind, trace.length, trace.width, trace.height, strict=True))
    assert sizes == {(kind, *size) for kind, size in expected.items()}
    # From 100 to 160 s, but for the ego's run-up and the margins of its smooth motion.
    assert 45.0 < trace.n_frames * trace.dt < 60.0
    assert np.hypot(np.diff(trace.ego.x), np.diff(trace.ego.y)).sum() > 200.0
    assert trace.provenance["source"] == "sumo"
    assert trace.provenance["scenario"] == "town"
    write_town(folder.parent / "fresh")
    assert contents(folder) == contents(folder.parent / "fresh")


def test_truth_is_smooth(trace: Trace) -> None:
    """The gate of the catalogue holds for what matters to a filter: no jumps, physical motion."""
    before, after = neighbours(trace)
    consecutive = trace.frame[after] - trace.frame[before] == 1
    moved = (trace.x[after] - trace.x[before]) + 1j * (trace.y[after] - trace.y[before])
    across = np.abs((moved * np.exp(-1j * trace.yaw[before])).imag)
    assert across[consecutive].max() < 0.5
    moving = np.hypot(trace.vx, trace.vy) > 0
    assert np.quantile(np.hypot(trace.jx, trace.jy)[moving], 0.99) < 15.0


def test_objects_are_those_within_reach(trace: Trace) -> None:
    """Nobody further off than the reach, up to a bumper; within it nobody is missing."""
    assert trace.sensor_distance().max() < sumo.REACH + 10.0
    assert trace.sensor_distance().max() > sumo.REACH - 20.0


def test_within_reach_nobody_is_missing(tmp_path: Path) -> None:
    """The rows of a recording are those of one without a limit, as far as they are near."""
    scenario = scenarios.load(write_town(tmp_path), duration=40)
    assert isinstance(scenario, ConfiguredScenario)
    staged = sumo.with_ego(scenario, 2, margin=1.5)
    near = sumo.run_sumo(staged, 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sumo, "REACH", 1e6)
        every = sumo.run_sumo(staged, 2)
    ego = every.rows_of(every.names.index(staged.ego))
    at = every.time_index - every.time_index[ego][0]
    distance = np.hypot(every.x - every.x[ego][at], every.y - every.y[ego][at])
    columns = ("time_index", "x", "y", "heading", "speed")
    rows = [
        sorted(zip(*(getattr(recording, name)[mask] for name in columns), strict=True))
        for recording, mask in ((near, np.ones(len(near.x), bool)), (every, distance <= 200.0))
    ]
    assert len(every.x) > 1.3 * len(near.x)
    # SUMO measures from the ego's front bumper to the nearest point of a vehicle.
    assert set(rows[1]) <= set(rows[0])
    assert len(rows[0]) < 1.1 * len(rows[1])


def test_the_ego_is_the_vehicle_longest_on_the_road(tmp_path: Path) -> None:
    """By SUMO's own report of trips, clipped to the recorded time; the first of equals."""
    scenario = scenarios.load(write_town(tmp_path))
    assert isinstance(scenario, ConfiguredScenario)
    staged = sumo.with_ego(scenario, 5, margin=1.5)
    times: dict[str, list[int]] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sumo, "REACH", 1e6)
        window = dataclasses.replace(staged, warmup=1.6, duration=58.4)
        recording = sumo.run_sumo(window, 5, margin=1.5)
    for vehicle, name in enumerate(recording.names):
        rows = recording.rows_of(vehicle)
        times[name] = recording.time_index[rows].tolist()
    longest = max(len(own) for own in times.values())
    first = min(own[0] for own in times.values() if len(own) == longest)
    assert staged.ego in [n for n, own in times.items() if (len(own), own[0]) == (longest, first)]
    # It is there throughout: no frame of its trace lacks it, whatever the seed.
    assert staged.duration <= longest * sumo.STEP - 2 * 1.5 + sumo.STEP + 1e-9


@pytest.mark.parametrize(
    ("edits", "ego"),
    [
        ({"demand.rou.xml": replaced('trip id="second"', 'trip id="ego"')}, "ego"),
        ({}, None),
    ],
)
def test_a_vehicle_called_ego_carries_the_sensor(
    edits: dict[str, Edit], ego: str | None, tmp_path: Path
) -> None:
    """However short its trip; without one another vehicle does."""
    trace = simulate(scenarios.load(write_town(tmp_path, edits)), 0)
    assert (trace.provenance["ego"] == ego) == (ego is not None)


YAML = """\
name: my_town
purpose: A town around a lorry.
source: sumo
configuration: town.sumocfg
duration: 20.0
warmup: 15.0
ego: {ego}
sensor_height: 3.2
statics:
  - {{kind: wall, x: 100.0, y: 30.0, length: 20.0, width: 1.0, height: 5.0}}
"""


def test_a_scenario_file_says_more_about_a_configuration(tmp_path: Path) -> None:
    """Ego, times, sensor height and boxes that never move; a misspelt ego is told of."""
    write_town(tmp_path)
    path = tmp_path / "mine.yaml"
    path.write_text(YAML.format(ego="lorries.0"))
    trace = simulate(scenarios.load(path), 1)
    assert trace.provenance["ego"] == "lorries.0"
    assert (trace.n_frames, trace.ego.z[0]) == (200, 3.2)
    assert (trace.kind == KINDS.index("wall")).sum() == 200
    path.write_text(YAML.format(ego="lorry.0"))
    with pytest.raises(SimulationError, match=r"'lorry.0' is not on the road between 115 s and"):
        simulate(scenarios.load(path), 1)


def test_warmup_and_duration_are_parameters(tmp_path: Path) -> None:
    """The recording begins later and is shorter; what is there at a time stays the same."""
    path = write_town(tmp_path)
    trace = simulate(scenarios.load(path, warmup=30, duration=20), 5)
    assert trace.n_frames == 200
    with pytest.raises(ScenarioError, match=r"warmup of 60 s"):
        scenarios.load(path, warmup=60)


CHAIN = """
import scenarios
from sim_bridge import simulate, write_table
write_table(simulate(scenarios.load({path!r}), 5), "trace.parquet")
"""


def test_a_seed_is_the_same_bytes_in_any_process(trace: Trace, tmp_path: Path) -> None:
    """A copy of the configuration elsewhere, in another process: the same file; another seed
    gives another."""
    path = write_town(tmp_path / "copy")
    subprocess.run(
        [sys.executable, "-P", "-c", CHAIN.format(path=str(path))],
        cwd=tmp_path,
        env=os.environ | {"PYTHONHASHSEED": "7", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        check=True,
    )
    write_table(trace, tmp_path / "here.parquet")
    assert (tmp_path / "here.parquet").read_bytes() == (tmp_path / "trace.parquet").read_bytes()
    assert simulate(scenarios.load(path, duration=20), 6) != simulate(
        scenarios.load(path, duration=20), 5
    )


BAD = {
    "unknown type": ("demand.rou.xml", replaced('type="lorry"', 'type="ufo"'), "'ufo'"),
    "unknown edge": ("demand.rou.xml", replaced('from="north_in"', 'from="moon"'), "'moon'"),
    "no vehicles": ("demand.rou.xml", instead("<routes/>"), "no vehicle, trip or flow departs"),
    "not XML": ("demand.rou.xml", instead("hello"), "not well-formed"),
    "routes of another kind": ("types.rou.xml", instead("<net/>"), "expected <routes>"),
    "vehicles too late": (
        "demand.rou.xml",
        instead('<routes><trip id="t" depart="900" from="west_in" to="west_out"/></routes>'),
        "no vehicle is on the road between 100 s and 160 s",
    ),
    "too short a trip": (
        "demand.rou.xml",
        instead('<routes><trip id="t" depart="158" from="west_in" to="west_out"/></routes>'),
        "is on the road for only",
    ),
    "empty network": ("network.net.xml", instead("<net/>"), "no <location>"),
    "another network": ("network.net.xml", instead("<OpenDRIVE/>"), "found <OpenDRIVE>"),
    "compressed": ("network.net.xml", instead("\x1f\x8b"), "not well-formed"),
    "entities": (
        "demand.rou.xml",
        instead('<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><routes>&b;</routes>'),
        "document type",
    ),
    "include": ("demand.rou.xml", instead('<routes><include href="x"/></routes>'), "<include>"),
    "a device that writes": (
        "types.rou.xml",
        replaced(
            'length="4.5"/>',
            'length="4.5"><param key="device.ssm.file" value="x.xml"/></vType>',
        ),
        "would write a file",
    ),
    "additional of another kind": ("detectors.add.xml", instead("<net/>"), "<additional>"),
    "additional that refers": (
        "detectors.add.xml",
        instead('<additional><rerouter id="r" edges="a" file="r.xml"/></additional>'),
        "other files are not accepted",
    ),
    "rail": (
        "types.rou.xml",
        replaced('vClass="truck"', 'vClass="tram"'),
        "tram",
    ),
    "a traffic light that writes": (
        "detectors.add.xml",
        instead(
            '<additional><tlLogic id="t" programID="1"><param key="file" value="x.xml"/>'
            "</tlLogic></additional>"
        ),
        "'file' would write a file",
    ),
    "a network that writes": (
        "network.net.xml",
        replaced("</net>", '<tlLogic id="t"><param key="file" value="x"/></tlLogic></net>'),
        "'file' would write a file",
    ),
    "an option in a value": (
        "town.sumocfg",
        replaced("<time>", '<time><sloppy-insert value="--summary-output=summary.xml"/>'),
        "sloppy-insert",
    ),
    "bad option": (
        "town.sumocfg",
        replaced('speeddev value="0.05"', 'speeddev value="wide"'),
        "wide",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_that_names_the_file(name: str, tmp_path: Path) -> None:
    """The user's file, not a copy; nothing is written beside it."""
    file, edit, expected = BAD[name]
    path = write_town(tmp_path / "town", {file: edit})
    before = contents(path.parent)
    with pytest.raises(SimulationError) as caught:
        simulate(scenarios.load(path), 0)
    message = str(caught.value)
    assert expected in message
    assert "\n" not in message
    assert "mdkf-sumo-" not in message
    assert contents(path.parent) == before


@pytest.mark.parametrize(
    ("precedence", "kept"),
    [
        ([1, 2, 9], [False, True, True]),
        ([2, 1, 9], [False, False, True]),  # 1 goes for 0, and then 0 for 2
        ([1, 1, 9], [False, False, True]),  # of equals the later
        ([9, 1, 9], [True, False, True]),  # the highest stay, and overlap
    ],
)
def test_who_drives_through_another_is_left_out(precedence: list[int], kept: list[bool]) -> None:
    """Of two that overlap the one of less precedence goes; what stays does not overlap. Object 0
    overlaps 1 in the first frame and 2 in the second."""
    boxes = np.array(
        [[0, 0, 0, 4, 2], [3, 0, 0, 4, 2], [20, 0, 0, 4, 2], [22, 0, 0, 4, 2], [9, 9, 0, 4, 2]],
        dtype=np.float64,
    )
    start, owner = np.array([0, 2, 5]), np.array([0, 1, 0, 2, 1])
    stays = disjoint(start, boxes, owner, np.array(precedence))
    assert stays.tolist() == kept
    rows = stays[owner]
    left = np.array([0, rows[:2].sum(), rows.sum()])
    assert (first_overlap(left, boxes[rows]) == (-1, -1)) == (precedence[0] != 9)
