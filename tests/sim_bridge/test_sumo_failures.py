"""Claims about what goes wrong in SUMO: each failure is one line that names file and fault."""

import dataclasses
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

import scenarios
from scenarios import Scenario
from sim_bridge import sumo
from sim_bridge.network_check import SimulationError
from sim_bridge.sumo import Accident, run_sumo

ROOT = Path(__file__).resolve().parents[2]
BUS_STOP = scenarios.load("bus_stop")


@pytest.fixture(autouse=True)
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Temporary files go to a folder that must be empty after every failure."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def scenario_with(
    folder: Path, *, network: str | None = None, routes: str | None = None
) -> Scenario:
    """bus_stop, shortened, with other file contents."""
    changed = dataclasses.replace(BUS_STOP, duration=2.0)
    if network is not None:
        (folder / "own.net.xml").write_text(network)
        changed = dataclasses.replace(changed, network=folder / "own.net.xml")
    if routes is not None:
        (folder / "own.rou.xml").write_text(routes)
        changed = dataclasses.replace(changed, routes=folder / "own.rou.xml")
    return changed


def failure(scenario: Scenario, scratch: Path, **options: float) -> str:
    with pytest.raises(SimulationError) as caught:
        run_sumo(scenario, 1, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert list(scratch.iterdir()) == []
    return message


NETWORK = BUS_STOP.network.read_text()
ROUTES = BUS_STOP.routes.read_text()

BAD_NETWORKS = {
    "empty net": ("<net/>", "no <location>"),
    "not xml": ("not xml", "not well-formed"),
    "cut off": (NETWORK[: len(NETWORK) // 2], "not well-formed"),
    "another root": ("<routes/>", "expected a SUMO network <net>, found <routes>"),
    "no edges": ('<net><location netOffset="0,0"/></net>', "no <edge>"),
    "no lanes": (
        '<net><location netOffset="0,0"/><edge id="a"/><junction id="j"/></net>',
        "edge a has no <lane>",
    ),
    "edge into nowhere": (NETWORK.replace('to="east"', 'to="nowhere"'), "'nowhere'"),
    "lane without a shape": (
        NETWORK.replace('shape="0.00,-16.00 1000.00,-16.00"', 'shape="0.00"'),
        "lane frontage_0",
    ),
    "entity": ('<!DOCTYPE x [<!ENTITY e "e">]><net>&e;</net>', "document type"),
}


@pytest.mark.parametrize("name", BAD_NETWORKS)
def test_a_bad_network_is_refused_before_sumo_sees_it(
    name: str, tmp_path: Path, scratch: Path
) -> None:
    """The message names the file and what is wrong in it."""
    content, expected = BAD_NETWORKS[name]
    message = failure(scenario_with(tmp_path, network=content), scratch)
    assert "own.net.xml" in message
    assert expected in message


def test_a_missing_network_is_named(tmp_path: Path, scratch: Path) -> None:
    """A file that vanished since loading is an error as well."""
    lost = dataclasses.replace(BUS_STOP, network=tmp_path / "lost.net.xml")
    assert "lost.net.xml: cannot be read" in failure(lost, scratch)


BAD_ROUTES = {
    "unsorted": (("</routes>", '<trip id="x" depart="1" from="frontage"/></routes>'), "trip x"),
    "unknown route": (('route="westward"', 'route="nowhere"'), "unknown route 'nowhere'"),
    "unknown type": (('type="ego"', 'type="ufo"'), "unknown vType 'ufo'"),
    "unknown edge": (('edges="frontage"', 'edges="backage"'), "unknown edge 'backage'"),
    "unknown stop": (('lane="east_in_0" startPos="195"', 'lane="gone_0"'), "unknown edge 'gone'"),
    "no ego": (('vehicle id="ego"', 'vehicle id="alter"'), "ego's id 'ego'"),
    "time as text": (('depart="52"', 'depart="noon"'), "'noon'"),
    "malformed": (("</routes>", ""), "not well-formed"),
}


@pytest.mark.parametrize("name", BAD_ROUTES)
def test_a_bad_route_file_is_refused_before_sumo_sees_it(
    name: str, tmp_path: Path, scratch: Path
) -> None:
    """The message names the user's file, not the filled-in copy, and what is wrong in it."""
    (old, new), expected = BAD_ROUTES[name]
    assert old in ROUTES
    message = failure(scenario_with(tmp_path, routes=ROUTES.replace(old, new)), scratch)
    assert "own.rou.xml" in message
    assert expected in message


def test_a_crash_of_sumo_is_an_error(tmp_path: Path, scratch: Path) -> None:
    """A network without some connections looks whole and is a segmentation fault."""
    network = re.sub(r'<connection from="east_in".*/>', "", NETWORK)
    assert network != NETWORK
    message = failure(scenario_with(tmp_path, network=network), scratch)
    assert message == f"SUMO crashed (SIGSEGV) on {tmp_path / 'own.net.xml'}"


def test_an_empty_network_that_slips_through_is_an_error(
    tmp_path: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the check, `<net/>` kills only the child process."""
    monkeypatch.setattr(sumo, "check_network", lambda _: frozenset())
    monkeypatch.setattr(sumo, "check_routes", lambda *_: None)
    message = failure(scenario_with(tmp_path, network="<net/>"), scratch)
    assert message == f"SUMO crashed (SIGSEGV) on {tmp_path / 'own.net.xml'}"


def test_what_sumo_would_silently_drop_is_an_error(
    tmp_path: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Behind the check, SUMO's own "ignoring" warning is an error too, with the user's file."""
    monkeypatch.setattr(sumo, "check_routes", lambda *_: None)
    (old, new), _ = BAD_ROUTES["unsorted"]
    message = failure(scenario_with(tmp_path, routes=ROUTES.replace(old, new)), scratch)
    assert "ignoring" in message
    assert str(scratch) not in message


def test_sumos_own_error_is_passed_on(tmp_path: Path, scratch: Path) -> None:
    """What only SUMO can find: a stop beyond the end of its lane."""
    routes = ROUTES.replace('startPos="195" endPos="215"', 'startPos="5195" endPos="5215"')
    message = failure(scenario_with(tmp_path, routes=routes), scratch)
    assert "Invalid start or end position for stop" in message
    assert "bus_1" in message


def test_a_collision_names_the_vehicles_and_the_time(tmp_path: Path, scratch: Path) -> None:
    """A trace with vehicles inside each other is refused."""
    pair = "".join(
        f'<vehicle id="{name}" depart="53" route="frontage" departPos="300" departSpeed="0"'
        ' insertionChecks="none"/>'
        for name in ("upper", "lower")
    )
    routes = ROUTES.replace("</routes>", pair + "</routes>")
    scenario = scenario_with(tmp_path, routes=routes)
    with pytest.raises(Accident):
        run_sumo(scenario, 1)
    message = failure(scenario, scratch)
    assert "upper" in message
    assert "lower" in message
    assert "collided at 53" in message


def test_an_ego_that_never_drives_is_an_error(tmp_path: Path, scratch: Path) -> None:
    """An ego whose departure lies after the recording is not a sensor."""
    routes = ROUTES.replace('depart="52"', 'depart="900"')
    message = failure(scenario_with(tmp_path, routes=routes), scratch)
    assert "the ego vehicle 'ego' is not on the road" in message


def test_a_simulation_that_takes_too_long_is_stopped(scratch: Path) -> None:
    """The time limit ends the child and says so."""
    assert "did not finish within 0.05 s" in failure(BUS_STOP, scratch, timeout=0.05)


def test_a_warm_up_shorter_than_the_margin_is_named(scratch: Path) -> None:
    """Nothing can be recorded before the simulation begins."""
    hasty = dataclasses.replace(BUS_STOP, warmup=0.5)
    assert "warmup is 0.5 s, expected at least the 2 s" in failure(hasty, scratch, margin=2.0)


@pytest.mark.parametrize("seed", [-1, 2**31])
def test_a_seed_that_sumo_cannot_read_is_refused(seed: int) -> None:
    """SUMO's seed is a 32-bit integer."""
    with pytest.raises(SimulationError, match="seed must be from 0 to 2147483647"):
        run_sumo(BUS_STOP, seed)


def test_a_libsumo_that_cannot_be_loaded_names_the_packages(
    tmp_path: Path, scratch: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A missing system library comes with the line that installs it."""
    (tmp_path / "libsumo.py").write_text(
        "raise ImportError('libXrender.so.1: cannot open shared object file')"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    message = failure(BUS_STOP, scratch)
    assert "libXrender.so.1" in message
    assert "apt-get install libx11-6 libxext6 libxrender1 libgl1 libatomic1 libexpat1" in message


def test_ctrl_c_ends_the_child_and_cleans_up(scratch: Path) -> None:
    """Neither SUMO's process nor its directory survives an interrupt."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); import dataclasses, scenarios;"
        "from sim_bridge.sumo import run_sumo;"
        "s = dataclasses.replace(scenarios.load('bus_stop'), duration=3600.0, warmup=3600.0);"
        "run_sumo(s, 1)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env=os.environ | {"TMPDIR": str(scratch)},
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 60
    while not list(scratch.glob("*/request.json")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.5)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    child = int(children.read_text().split()[0]) if children.exists() else None
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)
    assert list(scratch.iterdir()) == []
    if child is not None:
        assert not Path(f"/proc/{child}").exists()
