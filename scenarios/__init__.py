"""Turns a name and parameters into a validated scenario: what happens on the road.

``scenarios.load("bus_stop", speed=11.0)`` gives a `Scenario`; ``scenarios.list()`` names them all.
"""

from scenarios.catalogue import list_names as list
from scenarios.catalogue import load
from scenarios.scenario import (
    ClosedFormScenario,
    HighwayScenario,
    KittiScenario,
    ParameterSpec,
    Pause,
    Scenario,
    ScenarioError,
    StaticBox,
    SumoScenario,
    Walker,
)

__all__ = [
    "ClosedFormScenario",
    "HighwayScenario",
    "KittiScenario",
    "ParameterSpec",
    "Pause",
    "Scenario",
    "ScenarioError",
    "StaticBox",
    "SumoScenario",
    "Walker",
    "list",
    "load",
]
