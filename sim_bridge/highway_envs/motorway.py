"""Roads of parallel lanes: a motorway, a stop-and-go wave, a slip road."""

from typing import Any

import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from highway_env.envs.merge_env import MergeGenericEnv
from highway_env.road.road import Road, RoadNetwork

from sim_bridge.highway_envs.drivers import Driver, Leader, Truck, Van


class _Scene(HighwayEnv):  # type: ignore[misc]
    """A straight road whose vehicles a subclass puts on it."""

    LENGTH = 10_000.0  # m
    SPEED_LIMIT = 45.0  # m/s; drivers want less
    TRUCK_SHARE, VAN_SHARE = 0.2, 0.15

    def _create_road(self) -> None:
        network = RoadNetwork.straight_road_network(
            self.config["lanes_count"], length=self.LENGTH, speed_limit=self.SPEED_LIMIT
        )
        self.road = Road(network=network, np_random=self.np_random)

    def _put(self, kind: type[Driver], lane: int, place: float, speed: float, **named: Any) -> Any:
        position = self.road.network.get_lane(("0", "1", lane)).position(place, 0.0)
        vehicle = kind(self.road, position, 0.0, speed, **named)
        self.road.vehicles.append(vehicle)
        return vehicle

    def _any_kind(self, trucks: float) -> type[Driver]:
        draw = self.np_random.random()
        if draw < trucks:
            return Truck
        return Van if draw < trucks + self.VAN_SHARE else Driver


class Motorway(_Scene):
    """Cars that overtake and trucks that do not, behind traffic that is sometimes slow.

    The ego vehicle starts in the rightmost lane.
    """

    BEHIND, AHEAD = 140.0, 100.0  # m of traffic behind and ahead of the ego vehicle
    TIME_GAP = 0.9  # s
    BRAKING_IMPOSED = 4.0  # m/s2 by a lane change, as in Kesting et al. 2007; less finds no gap

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's, and the speed of the left lane [m/s] and vehicles per km and lane."""
        ours = {"lanes_count": 4, "speed": 28.0, "traffic": 26.0}
        return {**super().default_config(), **ours}

    def _create_vehicles(self) -> None:
        lanes, random = self.config["lanes_count"], self.np_random
        start, spacing = 500.0, 1000.0 / self.config["traffic"]
        pace = self._pace()
        self.controlled_vehicles: list[Driver] = []
        for lane in range(lanes):
            # The lane numbered 0 is the leftmost.
            usual = self.config["speed"] * (1.0 - 0.05 * lane)
            rightmost = lane == lanes - 1
            place = start - self.BEHIND + spacing * random.random()
            while place < start + self.AHEAD:
                mine = rightmost and abs(place - start) <= spacing / 2
                kind = Driver if mine else self._any_kind(0.5 * lane / (lanes - 1))
                wants = usual * random.uniform(0.85, 1.15)
                if kind is Truck:
                    wants = min(wants, 23.0)
                vehicle = self._put(kind, lane, place, 0.9 * usual, target_speed=wants)
                vehicle.enable_lane_change = kind is not Truck
                vehicle.TIME_GAP = self.TIME_GAP
                vehicle.LANE_CHANGE_MAX_BRAKING_IMPOSED = self.BRAKING_IMPOSED
                if rightmost and (mine or not self.controlled_vehicles):
                    self.controlled_vehicles = [vehicle]
                place += spacing * random.uniform(0.75, 1.35)
            leader = self._put(Leader, lane, place, 0.9 * usual, enable_lane_change=False)
            leader.script = tuple((time, usual * share) for time, share in pace)

    def _pace(self) -> tuple[tuple[float, float], ...]:
        """Ten minutes of traffic ahead: times [s] and shares of the usual speed, in all lanes."""
        random = self.np_random
        times = np.cumsum(random.uniform(4.0, 9.0, size=100))
        shares = random.uniform(0.4, 1.1, size=100)
        return tuple(zip(times.tolist(), shares.tolist(), strict=True))


class StopAndGoWave(_Scene):
    """Columns on adjacent lanes, each behind a leader who brakes, waits and drives on."""

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed [m/s], vehicles per lane, the longest halt [s], seconds driven."""
        ours = {"lanes_count": 3, "speed": 12.0, "vehicles": 9, "halt": 20.0, "drive": 12.0}
        return {**super().default_config(), **ours}

    def _create_vehicles(self) -> None:
        lanes, random = self.config["lanes_count"], self.np_random
        speed, count = self.config["speed"], self.config["vehicles"]
        for lane in range(lanes):
            place = 500.0 + random.uniform(-10.0, 10.0)
            leader = self._put(Leader, lane, place, speed, enable_lane_change=False)
            leader.script = self._script()
            for k in range(1, count):
                ego = lane == lanes // 2 and k == count // 2
                kind = Driver if ego else self._any_kind(self.TRUCK_SHARE)
                headway = kind.JAM_GAP + kind.TIME_GAP * speed * random.uniform(1.0, 1.3)
                place -= headway + (self.road.vehicles[-1].LENGTH + kind.LENGTH) / 2
                wants = speed * random.uniform(1.1, 1.3)
                vehicle = self._put(
                    kind, lane, place, speed, target_speed=wants, enable_lane_change=False
                )
                if ego:
                    self.controlled_vehicles = [vehicle]

    def _script(self) -> tuple[tuple[float, float], ...]:
        """Ten minutes of driving, halting or slowing, driving on."""
        random, speed = self.np_random, self.config["speed"]
        drive, halt = self.config["drive"], self.config["halt"]
        script, time = [(0.0, speed)], 0.0
        while time < 600.0:
            time += drive * random.uniform(0.5, 1.5)
            slow = 0.0 if random.random() < 0.7 else speed * random.uniform(0.2, 0.5)
            script.append((time, slow))
            # Braking takes its time too.
            time += speed / Driver.BRAKING + halt * random.uniform(0.5, 1.0)
            script.append((time, speed * random.uniform(0.8, 1.1)))
        return tuple(script)


class Merge(MergeGenericEnv):  # type: ignore[misc]
    """Cars from a slip road squeeze into dense traffic before their lane ends."""

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed [m/s], vehicles per km and lane, vehicles on the slip road."""
        ours = {
            "speed": 16.0,
            "traffic": 25.0,
            "merging": 6,
            "neighbour_vehicles_connected_lanes": True,
        }
        return {**super().default_config(), **ours}

    def _make_vehicles(self) -> None:
        lanes, random, speed = self.config["lanes_count"], self.np_random, self.config["speed"]
        before = self.config["before_merge_length"]
        spacing = 1000.0 / self.config["traffic"]
        self.controlled_vehicles: list[Driver] = []
        for lane in range(lanes):
            place = 40.0 + spacing * random.random()
            while place < before:
                kind = Truck if random.random() < 0.2 + 0.1 * lane else Driver
                ego = lane == lanes - 1 and place > before / 2 and not self.controlled_vehicles
                kind = Driver if ego else kind
                vehicle = self._put(kind, ("a", "b", lane), place, random)
                if ego:
                    self.controlled_vehicles = [vehicle]
                place += spacing * random.uniform(0.75, 1.35)
        place = before - 20.0
        for _ in range(self.config["merging"]):
            kind = Truck if random.random() < 0.2 else Driver
            self._put(kind, ("j", "k", 0), place, random)
            place -= (15.0 + 1.5 * speed) * random.uniform(0.8, 1.3)

    def _put(
        self, kind: type[Driver], lane: tuple[str, str, int], place: float, random: Any
    ) -> Any:
        speed = self.config["speed"]
        vehicle = kind(
            self.road,
            self.road.network.get_lane(lane).position(place, 0.0),
            0.0,
            0.85 * speed,
            target_speed=speed * random.uniform(0.85, 1.2),
        )
        vehicle.TIME_GAP, vehicle.LANE_CHANGE_MAX_BRAKING_IMPOSED = 0.9, 4.0  # s, m/s2
        self.road.vehicles.append(vehicle)
        return vehicle
