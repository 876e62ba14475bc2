"""Claims about `scenarios.load`: what it gives, and what it says of bad names and parameters."""

import dataclasses
import json
import math
import pickle
import shutil
from pathlib import Path

import pytest

import scenarios
from scenarios import Scenario, ScenarioError
from tests.sim_bridge.worlds import SUMO


def one_line_error(name: str | Path, /, **parameters: object) -> str:
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(name, **parameters)  # type: ignore[arg-type]
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 500
    return message


def test_the_catalogue_lists_its_scenarios(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`scenarios.list()` gives the names under which `load` finds them, here without recordings."""
    monkeypatch.setenv("MDKF_KITTI", str(tmp_path))
    assert set(scenarios.list()) == {
        *("bus_stop", "emergency_braking", "green_wave", "off_scene", "parked_row", "roundabout"),
        *("stop_and_go", "merge", "motorway", "stop_and_go_wave", "brake_to_standstill", "circle"),
        *("constant_acceleration", "constant_jerk", "constant_velocity", "journey"),
        *("lane_change", "passing_bus", "pull_away", "stationary"),
        *("intersection", "overtaking", "parked_truck", "small_roundabout"),
        *("city_grid", "dense_jam", "mixed_traffic", "passing_van"),
    }
    for name in scenarios.list():
        assert scenarios.load(name).name == name


@pytest.mark.parametrize("name", SUMO)
def test_every_parameter_works_at_both_bounds_and_not_beyond(name: str) -> None:
    """The declared bounds are the accepted ones, and values reach the scenario."""
    for spec in scenarios.load(name).parameter_specs:
        for value in (spec.minimum, spec.maximum):
            assert scenarios.load(name, **{spec.name: value}).parameters[spec.name] == value
        for value in (spec.minimum - 0.001, spec.maximum + 0.001, math.nan, math.inf):
            message = one_line_error(name, **{spec.name: value})
            assert spec.name in message
            assert spec.unit in message


@pytest.mark.parametrize("name", SUMO)
def test_every_parameter_changes_the_route_file(name: str) -> None:
    """No declared parameter is without effect."""
    default = scenarios.load(name).route_xml()
    for spec in scenarios.load(name).parameter_specs:
        assert scenarios.load(name, **{spec.name: spec.minimum}).route_xml() != default


def test_an_unknown_name_is_answered_with_the_known_ones() -> None:
    """The message names what was given, a close match, and the catalogue."""
    message = one_line_error("bus_stpo")
    assert "bus_stpo" in message
    assert "did you mean bus_stop?" in message
    assert "stop_and_go" in message


def test_an_unknown_parameter_is_answered_with_the_known_ones() -> None:
    """A misspelt parameter is refused, never ignored."""
    message = one_line_error("bus_stop", sped=9.0)
    assert "sped" in message
    assert "did you mean speed?" in message
    assert "dwell" in message


@pytest.mark.parametrize("value", ["11", True, None, [11.0], 1 + 0j])
def test_a_parameter_must_be_a_number(value: object) -> None:
    """Strings, truth values and others are refused with what was expected."""
    assert "expected a number from 6 to 13 [m/s]" in one_line_error("bus_stop", speed=value)


@pytest.mark.parametrize("name", ["", "../etc", "no/such/file.yaml", "bus_stop\0", "a" * 5000, "."])
def test_a_name_that_is_no_scenario_is_one_line(name: str) -> None:
    """Whatever string is given, the answer is a ScenarioError."""
    one_line_error(name)


def test_a_scenario_can_be_sent_to_another_process() -> None:
    """Pickling gives an equal scenario back."""
    scenario = scenarios.load("bus_stop", speed=9.5)
    assert pickle.loads(pickle.dumps(scenario)) == scenario


def test_a_scenario_cannot_be_changed() -> None:
    """It is frozen: provenance would otherwise lie."""
    scenario = scenarios.load("bus_stop")
    with pytest.raises(AttributeError):
        scenario.duration = 1.0  # type: ignore[misc]


def copy_of(name: str, folder: Path) -> Path:
    source = scenarios.load(name).definition.parent
    shutil.copytree(source, folder)
    return folder / "scenario.yaml"


def test_identity_holds_everything_but_paths(tmp_path: Path) -> None:
    """A copy elsewhere has the same identity; a changed value or file has another."""
    original = scenarios.load("bus_stop").identity()
    assert json.dumps(json.loads(original), sort_keys=True, separators=(",", ":")) == original
    path = copy_of("bus_stop", tmp_path / "copy")
    copied = scenarios.load(path)
    assert copied.identity() == original
    assert str(tmp_path) not in original

    def changed(scenario: Scenario) -> bool:
        return scenario.identity() != original

    assert changed(scenarios.load("bus_stop", speed=9.0))
    assert changed(dataclasses.replace(copied, duration=5.0))
    assert changed(dataclasses.replace(copied, statics=copied.statics[1:]))
    assert scenarios.load("bus_stop", speed=10).identity() == original
    for name in ("network.net.xml", "routes.rou.xml", "scenario.yaml"):
        path = copy_of("bus_stop", tmp_path / name)
        file = path.parent / name
        comment = "\n# more" if name.endswith("yaml") else "\n<!-- more -->"
        file.write_text(file.read_text() + comment)
        assert changed(scenarios.load(path)), name


def test_an_undeclared_placeholder_is_found_on_loading(tmp_path: Path) -> None:
    """A route file that asks for a parameter nobody declared does not reach the simulator."""
    path = copy_of("bus_stop", tmp_path / "copy")
    routes = path.parent / "routes.rou.xml"
    routes.write_text(routes.read_text().replace("${dwell}", "${dwel}"))
    message = one_line_error(path)
    assert "${dwel}" in message
    assert "routes.rou.xml" in message
    assert "dwell" in message
