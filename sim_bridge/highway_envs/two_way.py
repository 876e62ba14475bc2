"""Two-way roads: a street with parked cars and a lorry in the way, a country road to overtake on.

In highway-env's frame the eastern direction keeps to y = 4 m, the western one to y = 0.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from highway_env.envs.two_way_env import TwoWayEnv
from highway_env.road.lane import SineLane, StraightLane

from sim_bridge.highway_envs.overtaking import OvertakingCar, OvertakingVan
from sim_bridge.highway_envs.paths import Path, path_along
from sim_bridge.highway_envs.route_drivers import (
    Parked,
    ParkedTruck,
    ParkedVan,
    RouteBicycle,
    RouteDeliveryTruck,
    RouteDriver,
    RouteRoad,
    RouteTruck,
    RouteVan,
)

EAST, WEST = 4.0, 0.0  # m, y of the lanes
LENGTH = 3200.0
"""Length of the road [m]: nobody reaches its ends, so nobody appears or vanishes."""


class _TwoWay(TwoWayEnv):  # type: ignore[misc]
    """A straight road with one lane in each direction."""

    HEADWAY = 2.4  # s, the shortest
    road: Any

    def _rewards(self, action: int) -> dict[str, float]:
        """None: nobody learns here."""
        return {}

    def _make_road(self, length: float = LENGTH) -> None:
        super()._make_road(length)
        self.road = RouteRoad(network=self.road.network, np_random=self.np_random)
        self.east = path_along(self.road.network, [("a", "b", 1)])
        self.west = path_along(self.road.network, [("b", "a", 0)])

    def _put(
        self, kind: type[RouteDriver], path: Path, x: float, speed: float, **named: Any
    ) -> RouteDriver:
        """A vehicle on a path, at x [m], that wants to drive at about `speed` [m/s]."""
        place = LENGTH - x if path is self.west else x
        wants = speed * self.np_random.uniform(0.9, 1.1)
        vehicle = kind(self.road, path, place, 0.9 * wants, target_speed=wants, **named)
        self.road.vehicles.append(vehicle)
        return vehicle

    def _headway(self, traffic: float) -> float:
        """Time to the next vehicle [s], with `traffic` vehicles per second on average, of which
        every other one closes up."""
        closed_up, wait = self.np_random.random() < 0.5, self.np_random.exponential()
        return self.HEADWAY + (0.0 if closed_up else 2.0 * (1.0 / traffic - self.HEADWAY) * wait)


class Street(_TwoWay):
    """A lorry stands in the lane of the ego vehicle, who passes it through the other lane when
    that is free. It hides some of the cars parked along both kerbs; two of those pull out.
    """

    TRUCK = 1000.0  # m, where the lorry stands
    BESIDE = 1.0  # m, y of the way past it
    SHIFT, AIR = 17.0, 2.0  # m to get there, m between that and the lorry
    KERB = 3.4  # m from the middle of the lane to that of the parked cars
    ROW = (-100.0, 140.0)  # m around the lorry
    SLOT, PULL_OUT = 6.6, 20.0  # m
    VAN_SHARE = 0.15

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed [m/s], vehicles per second in the ego vehicle's direction and
        in the other, share of lorries among them, share of the parking places in use."""
        ours = {"speed": 9.0, "traffic": 0.1, "oncoming": 0.04, "trucks": 0.2, "parked": 0.6}
        return {**super().default_config(), **ours}

    def _make_road(self, length: float = LENGTH) -> None:
        super()._make_road(length)
        half = ParkedTruck.LENGTH / 2 + self.AIR
        x = [self.TRUCK + d for d in (-half - self.SHIFT, -half, half, half + self.SHIFT)]
        net = self.road.network
        net.add_lane("a", "out", StraightLane([0.0, EAST], [x[0], EAST]))
        net.add_lane("out", "beside", self._shift(x[0], x[1], EAST, self.BESIDE))
        net.add_lane("beside", "back", StraightLane([x[1], self.BESIDE], [x[2], self.BESIDE]))
        net.add_lane("back", "in", self._shift(x[2], x[3], self.BESIDE, EAST))
        net.add_lane("in", "b", StraightLane([x[3], EAST], [length, EAST]))
        nodes = ["a", "out", "beside", "back", "in", "b"]
        route = [(a, b, 0) for a, b in pairwise(nodes)]
        self.past = path_along(net, route, approach=1, yield_speed=5.0)

    @staticmethod
    def _shift(x0: float, x1: float, y0: float, y1: float) -> SineLane:
        """From one side to the other in half a period of a sine."""
        middle, turn = (y0 + y1) / 2, np.pi / abs(x1 - x0)
        aside = (y1 - y0) / 2 * np.sign(x1 - x0)  # to the right of the way
        return SineLane([x0, middle], [x1, middle], aside, turn, -np.pi / 2)

    def _make_vehicles(self) -> None:
        random, speed = self.np_random, float(self.config["speed"])
        lorry = ParkedTruck(self.road, [self.TRUCK, EAST + 0.7], 0.0)
        self.road.vehicles.append(lorry)
        for y, heading in ((EAST + self.KERB, 0.0), (WEST - self.KERB, np.pi)):
            self._park(y, heading)
        x = self.TRUCK - random.uniform(60.0, 90.0)
        for k in range(8):
            ego = k == 1
            vehicle = self._put(RouteDriver if ego else self._any_kind(), self.past, x, speed)
            if ego:
                self.controlled_vehicles = [vehicle]
            x -= speed * (self.HEADWAY if k == 0 else self._headway(self.config["traffic"]))
        x = self.TRUCK - random.uniform(50.0, 90.0)
        while x < self.TRUCK + 500.0:
            self._put(self._any_kind(), self.west, x, speed)
            x += speed * self._headway(self.config["oncoming"])

    def _any_kind(self) -> type[RouteDriver]:
        draw, trucks = self.np_random.random(), self.config["trucks"]
        if draw < trucks:
            return RouteDeliveryTruck
        return RouteVan if draw < trucks + self.VAN_SHARE else RouteDriver

    def _park(self, y: float, heading: float) -> None:
        """A row of parked cars along a kerb, one of which will pull out."""
        random = self.np_random
        way = np.cos(heading)  # 1 to the east, -1 to the west
        leaver = self.TRUCK + random.uniform(25.0, 60.0)
        x = self.TRUCK + self.ROW[0]
        self._pull_out(leaver, y, heading)
        while x < self.TRUCK + self.ROW[1]:
            kind = ParkedVan if random.random() < self.VAN_SHARE else Parked
            place = [x + random.uniform(-0.3, 0.3), y + random.uniform(-0.15, 0.15)]
            # Room to pull out, and to have stood there.
            free = not -self.SLOT < way * (x - leaver) < self.PULL_OUT + 2.0
            if random.random() < self.config["parked"] and free:
                self.road.vehicles.append(kind(self.road, place, heading))
            x += self.SLOT

    def _pull_out(self, x: float, y: float, heading: float) -> None:
        """A car at the kerb that drives off some time later, when there is a gap."""
        net, way = self.road.network, np.cos(heading)
        lane, end = (EAST, LENGTH) if way > 0 else (WEST, 0.0)
        # It stands behind its line.
        behind, begin, clear = (x + way * d for d in (-10.0, 4.5, 4.5 + self.PULL_OUT))
        names = [f"{name} {'east' if way > 0 else 'west'}" for name in ("kerb", "go", "gone")]
        net.add_lane(names[0], names[1], StraightLane([behind, y], [begin, y]))
        net.add_lane(names[1], names[2], self._shift(begin, clear, y, lane))
        net.add_lane(names[2], "b" if way > 0 else "a", StraightLane([clear, lane], [end, lane]))
        nodes = [*names, "b" if way > 0 else "a"]
        route = [(a, b, 0) for a, b in pairwise(nodes)]
        path = path_along(net, route, approach=1, setback=0.0)
        car = RouteDriver(self.road, path, 10.0, 0.0, target_speed=float(self.config["speed"]))
        car.departure = float(self.np_random.uniform(8.0, 25.0))
        self.road.vehicles.append(car)


class Overtaking(_TwoWay):
    """Cars behind slow lorries and bicycles, which they overtake when nobody comes the other way;
    a few stand on the verge.

    The ego vehicle is the first behind the second slow one.
    """

    START, FARTHEST = 1000.0, 2500.0  # m, where the rearmost queue and the last oncoming one start
    QUEUES = 5
    VERGE = 4.2  # m from the middle of the lane to that of cars left beside the road

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        """highway-env's; speed and that of slow lorries [m/s], vehicles behind each slow one,
        oncoming vehicles per second."""
        ours = {"speed": 17.0, "slow": 7.0, "followers": 2, "oncoming": 0.05}
        return {**super().default_config(), **ours}

    def _make_vehicles(self) -> None:
        random, config = self.np_random, self.config
        speed, slow = float(config["speed"]), float(config["slow"])
        x = self.START
        for queue in range(self.QUEUES):
            if queue != 1 and random.random() < 0.5:
                mine = [self._put(RouteBicycle, self.east, x, 5.0, aside=1.0)]
            else:
                mine = [self._put(RouteTruck, self.east, x, slow)]
            back = x
            for k in range(config["followers"]):
                back -= mine[-1].LENGTH / 2 + random.uniform(14.0, 24.0)
                ego = queue == 1 and k == 0
                follower = OvertakingVan if random.random() < 0.2 and not ego else OvertakingCar
                mine.append(self._put(follower, self.east, back, speed))
                mine[-1].speed = mine[0].speed
                if ego:
                    self.controlled_vehicles = [mine[-1]]
            x += random.uniform(35.0, 45.0) * (config["followers"] + 1)
        for y, heading in ((EAST + self.VERGE, 0.0), (WEST - self.VERGE, np.pi)):
            x = self.START + random.uniform(0.0, 60.0)
            while x < self.START + 900.0:
                self.road.vehicles.append(Parked(self.road, [x, y], heading))
                x += random.uniform(30.0, 90.0)
        x = self.START - 50.0
        while x < self.FARTHEST:
            kinds = (RouteDriver, RouteVan, RouteTruck)
            kind = kinds[int(random.choice(3, p=[0.6, 0.15, 0.25]))]
            self._put(kind, self.west, x, 0.9 * speed)
            x += 0.9 * speed * self._headway(config["oncoming"])
