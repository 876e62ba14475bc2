"""Junctions at which drivers give way: highway-env's roundabout and its crossing, longer arms."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.envs.roundabout_env import RoundaboutEnv
from highway_env.road.lane import StraightLane

from sim_bridge.highway_envs.paths import Path, path_along
from sim_bridge.highway_envs.route_drivers import (
    RouteDeliveryTruck,
    RouteDriver,
    RouteRoad,
    RouteVan,
)

ARM = 800.0
"""Length of the arms [m]: nobody reaches their ends, so nobody appears or vanishes."""

FARTHEST = 450.0
"""How far before the junction vehicles start at most [m]."""


class _Junction:
    """Four arms, a path from each to every other, and traffic on them."""

    config: dict[str, Any]
    np_random: np.random.Generator
    road: Any
    VAN_SHARE = 0.15
    YIELD_SPEED = 5.0  # m/s at a line
    HEADWAY = 2.2  # s, the shortest

    def _lengthen(
        self, before: Sequence[tuple[str, str]], after: Sequence[tuple[str, str]]
    ) -> None:
        """Draw out the straight lanes that lead to the junction, and those that lead away."""
        graph = self.road.network.graph
        for roads, is_before in ((before, True), (after, False)):
            for origin, end in roads:
                (lane,) = graph[origin][end]
                reach = (lane.length - ARM, lane.length) if is_before else (0.0, ARM)
                first, last = (lane.position(place, 0.0) for place in reach)
                lane = StraightLane(first, last, line_types=lane.line_types, priority=lane.priority)
                graph[origin][end] = [lane]
        self.road = RouteRoad(network=self.road.network, np_random=self.np_random)

    def _route(self, origin: str, destination: str) -> list[tuple[str, str, int]]:
        nodes = self.road.network.shortest_path(origin, destination)
        return [(a, b, 0) for a, b in pairwise(nodes)]

    def _fill(
        self,
        paths: Sequence[tuple[Path, float]],
        end: float,
        traffic: float,
        trucks: float,
        ego: Path | None,
    ) -> None:
        """Put traffic on an arm of length `end` [m]: `paths` with their shares of the `traffic`
        [1/s], of which the share `trucks` are lorries, which keep to the first path; the second
        one is the ego vehicle, if its path is given."""
        random, speed = self.np_random, float(self.config["speed"])
        shares = np.array([share for _, share in paths])
        place, count = end - random.uniform(15.0, 45.0), 0
        while place > end - FARTHEST:
            path = paths[int(random.choice(len(paths), p=shares / shares.sum()))][0]
            draw, kind = random.random(), RouteDriver
            if draw < trucks:
                path, kind = paths[0][0], RouteDeliveryTruck
            elif draw < trucks + self.VAN_SHARE:
                kind = RouteVan
            wants = speed * random.uniform(0.85, 1.15)
            mine = ego is not None and count == 1
            if ego is not None and mine:
                path, kind = ego, RouteDriver
            vehicle = kind(self.road, path, place, 0.9 * speed, target_speed=wants)
            self.road.vehicles.append(vehicle)
            if mine:
                self.controlled_vehicles = [vehicle]
            count += 1
            headway = self.HEADWAY + random.exponential(max(1.0 / traffic - self.HEADWAY, 0.1))
            # The ego vehicle closes up.
            place -= speed * (self.HEADWAY if ego is not None and count == 1 else headway)


class Roundabout(_Junction, RoundaboutEnv):  # type: ignore[misc]
    """The inner lane of highway-env's roundabout: who enters gives way to who is in it.

    The ego vehicle comes from the south and leaves to the west, three quarters round.
    """

    ARMS = "senw"

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed on the arms [m/s], vehicles per second on each arm."""
        return {**super().default_config(), "speed": 11.0, "traffic": 0.1, "trucks": 0.15}

    def _make_road(self) -> None:
        super()._make_road()
        self._lengthen(
            [(f"{arm}er", f"{arm}es") for arm in self.ARMS],
            [(f"{arm}xs", f"{arm}xr") for arm in self.ARMS],
        )

    def _make_vehicles(self) -> None:
        for k, arm in enumerate(self.ARMS):
            paths = {
                to: path_along(
                    self.road.network,
                    self._route(f"{arm}er", f"{to}xr"),
                    approach=2,
                    yield_speed=self.YIELD_SPEED,
                )
                # Straight on comes first.
                for to in (self.ARMS[(k + turn) % 4] for turn in (2, 1, 3))
            }
            self._fill(
                [(path, 1.0) for path in paths.values()],
                ARM,
                self.config["traffic"],
                self.config["trucks"],
                paths["w"] if arm == "s" else None,
            )


class Intersection(_Junction, IntersectionEnv):  # type: ignore[misc]
    """highway-env's crossing: the road from west to east has priority, who turns left gives way.

    The ego vehicle comes along the minor road and crosses.
    """

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed [m/s], vehicles per second on each arm, share of who turns."""
        ours = {"speed": 9.0, "major": 0.1, "minor": 0.06, "turning": 0.4, "trucks": 0.15}
        return {**super().default_config(), **ours}

    def step(self, action: Any) -> Any:
        """Without the vehicles that highway-env would add and take away."""
        return super(IntersectionEnv, self).step(action)

    def _make_road(self) -> None:
        super()._make_road()
        self._lengthen(
            [(f"o{arm}", f"ir{arm}") for arm in range(4)],
            [(f"il{arm}", f"o{arm}") for arm in range(4)],
        )

    def _make_vehicles(self, n_vehicles: int = 0) -> None:
        turning = self.config["turning"]
        for arm in range(4):
            shares = {2: 1.0 - turning, 1: turning / 2, 3: turning / 2}
            paths = {turn: self._path(arm, (arm + turn) % 4) for turn in shares}
            self._fill(
                [(paths[turn], share) for turn, share in shares.items()],
                ARM,
                self.config["major" if arm % 2 else "minor"],
                self.config["trucks"],
                paths[2] if arm == 0 else None,
            )

    def _path(self, origin: int, end: int) -> Path:
        route = self._route(f"o{origin}", f"o{end}")
        priority = self.road.network.get_lane(route[1]).priority
        slow = self.YIELD_SPEED if priority < 3 else np.inf
        return path_along(self.road.network, route, approach=1, yield_speed=slow, priority=priority)
