"""A user's own SUMO scenario for the tests: small, plain, and made for no bridge."""

import shutil
from collections.abc import Callable
from pathlib import Path

import scenarios
from scenarios import RoutedScenario

OFF_SCENE = scenarios.load("off_scene")
assert isinstance(OFF_SCENE, RoutedScenario)

CONFIGURATION = """\
<?xml version="1.0" encoding="UTF-8"?>
<configuration>
    <input>
        <net-file value="network.net.xml"/>
        <route-files value="types.rou.xml, demand.rou.xml"/>
        <additional-files value="detectors.add.xml"/>
    </input>
    <output>
        <fcd-output value="fcd.xml"/>
        <tripinfo-output value="tripinfo.xml"/>
        <tripinfo-output.write-unfinished value="true"/>
    </output>
    <time>
        <begin value="100"/>
        <end value="0:02:40"/>
        <step-length value="1"/>
    </time>
    <processing>
        <time-to-teleport value="300"/>
        <default.speeddev value="0.05"/>
    </processing>
    <report>
        <log value="sumo.log"/>
        <verbose value="true"/>
    </report>
    <random_number>
        <seed value="42"/>
    </random_number>
    <gui_only>
        <gui-settings-file value="view.xml"/>
        <start value="true"/>
    </gui_only>
    <traci_server>
        <remote-port value="8813"/>
    </traci_server>
</configuration>
"""

TYPES = """\
<routes>
    <vType id="car" length="4.5"/>
    <vType id="lorry" vClass="truck" length="9.0" width="2.5" height="3.5"/>
</routes>
"""

DEMAND = """\
<routes>
    <route id="east" edges="east_in east_wait east_leave east_out"/>
    <flow id="east" type="car" begin="100" end="400" probability="0.15" route="east"/>
    <flow id="lorries" type="lorry" begin="100" end="400" period="20" route="east"/>
    <trip id="first" type="car" depart="104" from="west_in" to="west_out"/>
    <trip id="second" type="car" depart="0:01:50" from="north_in" to="south_out"/>
</routes>
"""

DETECTORS = """\
<additional>
    <inductionLoop id="loop" lane="east_in_0" pos="50" period="10" file="loop.xml"/>
    <edgeData id="edges" period="60" file="edges.xml"/>
</additional>
"""

FILES = {
    "town.sumocfg": CONFIGURATION,
    "types.rou.xml": TYPES,
    "demand.rou.xml": DEMAND,
    "detectors.add.xml": DETECTORS,
}

Edit = Callable[[str], str]


def write_town(folder: Path, edits: dict[str, Edit] | None = None) -> Path:
    """The files in a folder, some of them edited; the path of the configuration."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(OFF_SCENE.network, folder / "network.net.xml")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    for name, edit in (edits or {}).items():
        path = folder / name
        path.write_text(edit(path.read_text()))
    return folder / "town.sumocfg"


def replaced(old: str, new: str) -> Edit:
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return edit


def instead(text: str) -> Edit:
    return lambda _: text
