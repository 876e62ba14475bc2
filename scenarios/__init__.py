"""Turns a name and parameters into a validated scenario: what happens on the road.

``scenarios.load("bus_stop", speed=11.0)`` gives a `Scenario`; ``scenarios.list()`` names them all;
``scenarios.load("town.sumocfg")`` makes one of a user's own SUMO configuration,
``scenarios.load("USA_US101-1_1_T-1.xml")`` one of a CommonRoad scenario.
"""

from scenarios.catalogue import list_names as list
from scenarios.catalogue import load
from scenarios.commonroad import CommonRoadScenario
from scenarios.scenario import (
    ClosedFormScenario,
    ConfiguredScenario,
    HighwayScenario,
    KittiScenario,
    ParameterSpec,
    Pause,
    RoutedScenario,
    Scenario,
    ScenarioError,
    StaticBox,
    SumoScenario,
    Walker,
)

__all__ = [
    "ClosedFormScenario",
    "CommonRoadScenario",
    "ConfiguredScenario",
    "HighwayScenario",
    "KittiScenario",
    "ParameterSpec",
    "Pause",
    "RoutedScenario",
    "Scenario",
    "ScenarioError",
    "StaticBox",
    "SumoScenario",
    "Walker",
    "list",
    "load",
]
