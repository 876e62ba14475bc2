"""Drivers and environments for highway-env: gentle drivers, vehicles of several sizes, scenes.

Drivers follow the Intelligent Driver Model (Treiber et al. 2000) from bumper to bumper,
a = A (1 - (v / v0)^4 - (s* / gap)^2), s* = s0 + v T + v dv / (2 sqrt(A B)), change lanes by MOBIL,
and do what highway-env's own do not: they steer and brake within what tyres and passengers bear,
stand still in a queue, and never drive backwards. Importing this module imports highway-env.
"""

from typing import Any

import gymnasium
import numpy as np
from highway_env.envs.highway_env import HighwayEnv
from highway_env.envs.merge_env import MergeGenericEnv
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle

ENVIRONMENTS = {
    "mdkf/motorway-v0": "Motorway",
    "mdkf/stop-and-go-wave-v0": "StopAndGoWave",
    "mdkf/merge-v0": "Merge",
}


_NEAR = 25.0
"""More than two lorries and what they drive in a step [m]."""


def register() -> None:
    """Make the environments of this module known to gymnasium, once."""
    for name, entry in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(id=name, entry_point=f"{__name__}:{entry}")


class Driver(IDMVehicle):  # type: ignore[misc]
    """A car and its driver."""

    speed: float  # m/s

    KIND, HEIGHT = "car", 1.5  # m
    LENGTH, WIDTH = 4.6, 1.85  # m

    # Names of our own: some environments overwrite the class's, for whoever comes after them.
    JAM_GAP = 2.5  # m, bumper to bumper
    TIME_GAP = 1.4  # s
    ACCELERATION = 1.8  # m/s2
    BRAKING = 2.5  # m/s2, comfortable
    HARDEST_BRAKING = 7.0  # m/s2
    JERK = 8.0  # m/s3
    HALT_SPEED = 0.6  # m/s; slower is no way to follow a queue
    START_ROOM = 2.0  # m beyond the jam gap
    REACTION = 0.1  # s between decisions

    # Lateral control: 4 m aside in some 6 s, at most 2 m/s2; highway-env's 0.2 s and 0.6 s give 30.
    KP_HEADING = 1 / 0.7  # 1/s
    KP_LATERAL = 1 / 2.8  # 1/s
    LANE_CHANGE_MAX_BRAKING_IMPOSED = 1.5  # m/s2
    LANE_CHANGE_ROOM = 4.0  # m to whoever is, or wants to be, in the other lane

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._since_decision = self.REACTION
        self._command = 0.0  # m/s2

    def act(self, action: object = None) -> None:
        """Steer and accelerate; whatever action is given, the driver decides."""
        if self.crashed or self._since_decision < self.REACTION - 1e-9:
            return
        self._since_decision = 0.0
        super().act()
        wish = self._stop_in_queue(self.wish(self.action["acceleration"]))
        # From standstill the brake is off at once.
        before = self._command if self.speed > 0.0 else max(self._command, 0.0)
        change = self.JERK * self.REACTION
        self._command = float(np.clip(wish, before - change, before + change))
        self.action["acceleration"] = self._command

    def wish(self, acceleration: float) -> float:
        """The acceleration that the driver wants, given the model's [m/s2]."""
        return acceleration

    def step(self, dt: float) -> None:
        """Move on, but not backwards."""
        self._since_decision += dt
        self.action["acceleration"] = max(self.action["acceleration"], -self.speed / dt)
        super().step(dt)
        if self.speed < 1e-9:
            self.speed = 0.0

    def handle_collisions(self, other: Any, dt: float = 0) -> None:
        """Look closer only at who is near; there are many pairs and this is half of the time."""
        if abs(self.position[0] - other.position[0]) < _NEAR:
            super().handle_collisions(other, dt)

    def acceleration(
        self, ego_vehicle: Any, front_vehicle: Any = None, rear_vehicle: Any = None
    ) -> float:
        """The model's acceleration [m/s2] of a vehicle behind another."""
        if not isinstance(ego_vehicle, Driver):
            return 0.0
        driver, speed = ego_vehicle, max(ego_vehicle.speed, 0.0)
        limit = driver.lane.speed_limit or np.inf
        target = max(min(driver.target_speed, limit), 0.1)
        share = 1.0 - (speed / target) ** 4
        if front_vehicle:
            gap = max(self._gap(driver, front_vehicle), 0.1)
            closing = speed - float(front_vehicle.velocity @ driver.direction)
            braking = speed * closing / (2.0 * np.sqrt(driver.ACCELERATION * driver.BRAKING))
            wanted = driver.JAM_GAP + max(speed * driver.TIME_GAP + braking, 0.0)
            share -= (wanted / gap) ** 2
        return float(max(driver.ACCELERATION * share, -driver.HARDEST_BRAKING))

    def mobil(self, lane_index: Any) -> bool:
        """Whether to change to a lane: not beside or just before anyone who is or wants there."""
        for other in self.road.vehicles:
            wants = getattr(other, "target_lane_index", other.lane_index)
            if other is not self and lane_index in (other.lane_index, wants):
                apart = abs(self.lane_distance_to(other)) - (self.LENGTH + other.LENGTH) / 2
                if apart < self.LANE_CHANGE_ROOM:
                    return False
        return bool(super().mobil(lane_index))

    def _stop_in_queue(self, wish: float) -> float:
        """Halt behind who stands, where the model alone would creep up for ever, and wait there
        until there is room to drive on."""
        if self.speed > self.HALT_SPEED:
            return wish
        front, _ = self.road.neighbour_vehicles(self, self.lane_index)
        gap = np.inf if front is None else self._gap(self, front)
        if self.speed == 0.0:
            return wish if gap > self.JAM_GAP + self.START_ROOM else 0.0
        halts = front is not None and front.speed < self.HALT_SPEED / 2
        return -0.8 if halts and gap < self.JAM_GAP + self.START_ROOM / 2 else wish

    @staticmethod
    def _gap(behind: Any, ahead: Any) -> float:
        """Bumper to bumper [m]."""
        return float(behind.lane_distance_to(ahead) - (behind.LENGTH + ahead.LENGTH) / 2)


class Truck(Driver):
    """A lorry: long, tall, slow to pull away; it keeps to its lane."""

    KIND, HEIGHT = "truck", 3.5  # m
    LENGTH, WIDTH = 12.0, 2.5  # m
    TIME_GAP = 1.8  # s
    ACCELERATION = 1.0  # m/s2


class Van(Driver):
    """A delivery van."""

    KIND, HEIGHT = "van", 2.4  # m
    LENGTH, WIDTH = 6.0, 2.0  # m
    ACCELERATION = 1.4  # m/s2


class Leader(Driver):
    """A car at the head of a column that brakes and drives on by a script.

    `script`: pairs of a time [s] and the speed [m/s] from then on.
    """

    script: tuple[tuple[float, float], ...] = ()

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._clock = 0.0

    def step(self, dt: float) -> None:
        """Move on, and look at the clock."""
        self._clock += dt
        super().step(dt)

    def wish(self, acceleration: float) -> float:
        """Towards the script's speed; the model's road may be free or not."""
        wanted = next((v for t, v in reversed(self.script) if t <= self._clock), self.speed)
        change = (wanted - self.speed) / 0.8
        if wanted == 0.0 and self.speed > 0.0:
            change = min(change, -0.6)  # to a halt, not ever closer to it
        return float(np.clip(change, -self.BRAKING, self.ACCELERATION))


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
