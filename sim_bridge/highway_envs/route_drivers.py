"""Drivers who follow a route and give way: at a roundabout, a crossing, past an obstacle.

Along their path they steer by its curvature and by their errors, both of which die out over
`SETTLING`; ahead they keep the distance of the Intelligent Driver Model to whatever stands or
drives in their corridor; and where their path is in conflict with another's of higher right of
way they wait at their line until the gap is long enough to be clear of it (gap acceptance). All
decide on the same snapshot of the road, so nobody's place in a list matters.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.road.road import Road

from mdkf.tables import FloatArray
from sim_bridge.highway_envs.drivers import NEAR, Bicycle, Driver, Truck, Van
from sim_bridge.highway_envs.paths import SPACING, Conflict, Path, conflicts


class RouteRoad(Road):  # type: ignore[misc]
    """A road that knows where the paths of its vehicles are in conflict, and who is where."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._conflicts: dict[tuple[int, int], tuple[Conflict, ...]] = {}
        self._paths: dict[int, Path] = {}  # whose ids are in use, and so stay theirs
        self._snapshot: Snapshot | None = None

    def step(self, dt: float) -> None:
        """Move on, and look closer at those who are near each other."""
        for vehicle in self.vehicles:
            vehicle.step(dt)
        self._snapshot = None
        place = np.array([vehicle.position for vehicle in self.vehicles])
        near = (np.abs(place[:, None] - place) < NEAR).all(axis=2)
        near &= ~np.array([isinstance(vehicle, Parked) for vehicle in self.vehicles])[:, None]
        # Each pair once: two who move both have a row, who is parked has none.
        for i, j in np.argwhere(near & ~(np.tri(len(near), dtype=bool) & near.T)).tolist():
            self.vehicles[i].handle_collisions(self.vehicles[j], dt)

    def snapshot(self) -> "Snapshot":
        """What all who decide now look at."""
        if self._snapshot is None:
            self._snapshot = Snapshot.of(self.vehicles)
        return self._snapshot

    def conflicts(self, mine: Path, theirs: Path) -> tuple[Conflict, ...]:
        """`paths.conflicts`, computed once for every pair of paths."""
        key = (id(mine), id(theirs))
        if key not in self._conflicts:
            self._paths |= {id(mine): mine, id(theirs): theirs}
            self._conflicts[key] = conflicts(mine, theirs)
        return self._conflicts[key]


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All n vehicles: rear, centre and front x, y (n, 3, 2) [m], heading (n,) [rad], speed (n,)
    [m/s], width (n,) [m]."""

    points: FloatArray
    heading: FloatArray
    speed: FloatArray
    width: FloatArray

    @classmethod
    def of(cls, vehicles: list[Any]) -> "Snapshot":
        """What is to be seen now."""
        heading = np.array([v.heading for v in vehicles])
        half = np.array([v.LENGTH / 2 for v in vehicles])
        forward = half[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        centre = np.array([v.position for v in vehicles])
        return cls(
            points=np.stack([centre - forward, centre, centre + forward], axis=1),
            heading=heading,
            speed=np.array([v.speed for v in vehicles]),
            width=np.array([v.WIDTH for v in vehicles]),
        )


class RouteDriver(Driver):
    """A car that follows a path, `place` [m] from its start at first, `aside` [m] to its right."""

    SETTLING = 8.0  # m
    SIGHT = 80.0  # m
    PREVIEW = 0.6  # s of driving ahead of which the path's speed is looked up
    CORRIDOR = 0.3  # m beside the vehicles
    LINE_GAP = 0.5  # m from bumper to line in standstill
    MARGIN = 1.0  # s between who gives way and is gone, and who has it and comes
    MERGE_MARGIN = 1.5  # s where he stays in front
    AFTER = 0.3  # s between who has passed and who comes after
    HARD_STOP = 3.5  # m/s2; who would have to brake harder before the line drives on

    departure = 0.0
    """For how long [s] a vehicle that stands at first goes on doing so."""

    def __init__(
        self,
        road: RouteRoad,
        path: Path,
        place: float,
        speed: float,
        *,
        target_speed: float,
        aside: float = 0.0,
    ) -> None:
        x, y, course, _, allowed = path.at(place)
        position = [x - aside * np.sin(course), y + aside * np.cos(course)]
        speed = min(speed, float(allowed))
        super().__init__(
            road, position, course, speed, target_speed=target_speed, enable_lane_change=False
        )
        self.path, self.place, self.aside = path, place, aside

    @property
    def front(self) -> float:
        """The front bumper's place on the path [m]."""
        return self.place + self.LENGTH / 2

    @property
    def rear(self) -> float:
        """The rear bumper's place on the path [m]."""
        return self.place - self.LENGTH / 2

    def act(self, action: object = None) -> None:
        """Steer and accelerate, when the road asks for it; an action is an order from elsewhere."""
        if action is not None or self.crashed or self._since_decision < self.REACTION - 1e-9:
            return
        self._since_decision = 0.0
        self.departure -= self.REACTION
        if self.departure > 0.0:
            return
        self.decide()
        self.action["steering"] = self._steering()
        target = min(self.target_speed, self._allowed(self.place + self.PREVIEW * self.speed))
        gap, ahead = self._leader()
        wish = self.follow(target, gap, ahead)
        room = self._room()
        if room < np.inf:
            # A line may be approached closer than a bumper.
            room += self.JAM_GAP - self.LINE_GAP
            wish = min(wish, self.follow(target, room))
            if room < gap:
                gap, ahead = room, 0.0
        self.press(self.wish(wish), gap, ahead)

    def decide(self) -> None:
        """What else there is to decide, before steering and accelerating."""

    def lateral(self) -> tuple[float, float, float]:
        """The wanted offset to the right of the path [m] with its rates [m/s, m/s2]."""
        return self.aside, 0.0, 0.0

    def lanes(self) -> tuple[float, ...]:
        """The offsets [m] at which others are in this driver's way."""
        return (self.aside,)

    def on_state_update(self) -> None:
        """Where the vehicle is on its path; highway-env would look through all lanes."""
        x, y, course, curvature, _ = self.path.at(self.place)
        dx, dy = self.position[0] - x, self.position[1] - y
        along, across = dx * np.cos(course) + dy * np.sin(course), self._across(dx, dy, course)
        self.place += float(along / max(1.0 - curvature * across, 0.1))

    def _steering(self) -> float:
        """The front wheels' angle [rad] of highway-env's bicycle, whose slip angle is b at the
        centre and whose path bends by sin(b) / (L/2)."""
        x, y, course, _, _ = self.path.at(self.place)
        aside, rate, change = self.lateral()
        half, speed = self.LENGTH / 2, max(self.speed, 1.0)
        across = self._across(self.position[0] - x, self.position[1] - y, course) - aside
        bend = self.path.at(self.place)[3] + change / speed**2
        heading = course + np.arctan(rate / speed) - np.arcsin(np.clip(half * bend, -0.9, 0.9))
        turned = (self.heading - heading + np.pi) % (2 * np.pi) - np.pi
        bend -= across / self.SETTLING**2 + 2.0 * turned / self.SETTLING
        return float(np.arctan(2.0 * np.tan(np.arcsin(np.clip(half * bend, -0.9, 0.9)))))

    @staticmethod
    def _across(dx: float, dy: float, course: float) -> float:
        return float(dy * np.cos(course) - dx * np.sin(course))

    def _allowed(self, place: float) -> float:
        return float(self.path.at(place)[4])

    def _leader(self) -> tuple[float, float]:
        """Gap [m] to and speed along the path [m/s] of the next one in the corridor ahead."""
        seen = self.road.snapshot()
        begin = int(self.place / SPACING)
        k = slice(begin, begin + int(self.SIGHT / SPACING))
        course = self.path.course[k]
        if not len(course):
            return np.inf, 0.0
        close = np.hypot(*(seen.points[:, 1] - self.position).T) < self.SIGHT
        close[self.road.vehicles.index(self)] = False
        who = np.flatnonzero(close)
        points = seen.points[who]
        dx, dy = points[..., 0, None] - self.path.x[k], points[..., 1, None] - self.path.y[k]
        nearest = (dx * dx + dy * dy).argmin(axis=2)
        dx, dy = (np.take_along_axis(d, nearest[..., None], axis=2)[..., 0] for d in (dx, dy))
        away = dy * np.cos(course[nearest]) - dx * np.sin(course[nearest])
        distance = np.min([np.abs(away - aside) for aside in self.lanes()], axis=0)
        # The nearest sample of who is beyond the stretch is its last, and says nothing.
        distance[nearest == len(course) - 1] = np.inf
        turned = np.cos(seen.heading[who, None] - course[nearest])
        half = (seen.width[who, None] + self.WIDTH) / 2 + self.CORRIDOR
        # The nearest sample of who is beside or behind is the first.
        in_the_way = (distance < half) & (turned > 0.3) & (nearest > 0)
        if not in_the_way.any():
            return np.inf, 0.0
        gaps = np.where(in_the_way, begin * SPACING + nearest * SPACING - self.front, np.inf)
        row, column = np.unravel_index(int(gaps.argmin()), gaps.shape)
        return float(gaps[row, column]), float(seen.speed[who[row]] * turned[row, column])

    def _room(self) -> float:
        """How far one may drive [m] because of others' right of way."""
        room, path = np.inf, self.path
        to_line = path.line - self.front
        decided = to_line < self.speed**2 / (2.0 * self.HARD_STOP)
        for other in self.road.vehicles:
            if other is self or not isinstance(other, RouteDriver) or other.path is path:
                continue
            for conflict in self.road.conflicts(path, other.path):
                ahead = conflict.mine[0] - self.front
                if not 0.0 < ahead < self.SIGHT or other.rear > conflict.theirs[1]:
                    continue
                if self._gives_way(other, conflict):
                    if not decided and not self._fits(other, conflict):
                        room = min(room, to_line)
                    elif decided and other.front > conflict.theirs[0]:
                        room = min(room, ahead)
                elif other.front > other.path.line and not self._clears(other, conflict):
                    room = min(room, ahead)
        return room

    def _gives_way(self, other: "RouteDriver", conflict: Conflict) -> bool:
        """To a path of higher priority; among equals, to who has left his line further behind."""
        mine = (self.path.priority, conflict.mine[0] - self.path.line)
        theirs = (other.path.priority, conflict.theirs[0] - other.path.line)
        return mine < theirs

    def _fits(self, other: "RouteDriver", conflict: Conflict) -> bool:
        """Whether I shall be through before the other comes, however fast, or come after him."""
        enter, leave = conflict.mine
        arrives, margin = other.earliest(conflict.theirs[0]), self.MARGIN
        if conflict.merges:
            # Being in front is enough, if who follows need not brake hard.
            leave, ahead = enter, max(enter - self.front, 0.0)
            reached = np.sqrt(self.speed**2 + 2.0 * self.ACCELERATION * ahead)
            theirs = min(other.target_speed, other._allowed(conflict.theirs[0]))
            closing = max(theirs - min(self._allowed(enter), reached), 0.0)
            margin = self.MERGE_MARGIN + closing / (2.0 * self.BRAKING)
        if self._time(leave + self.LENGTH - self.front) + margin < arrives:
            return True
        return other.front > other.path.line and self._clears(other, conflict)

    def _clears(self, other: "RouteDriver", conflict: Conflict) -> bool:
        """Whether the other will have left, at the speed at which he drives, before I come."""
        leaves = (conflict.theirs[1] - other.rear) / max(other.speed, 1.0)
        return leaves + self.AFTER < self.earliest(conflict.mine[0])

    def earliest(self, place: float) -> float:
        """The time [s] after which the front bumper may be there."""
        return self._time(place - self.front)

    def _time(self, distance: float) -> float:
        """For a distance [m], accelerating up to the target speed."""
        if distance <= 0.0:
            return 0.0
        speed, a = self.speed, self.ACCELERATION
        top = max(min(self.target_speed, self._allowed(self.front + distance)), speed, 1.0)
        rising = (top**2 - speed**2) / (2.0 * a)
        if distance < rising:
            return float((np.sqrt(speed**2 + 2.0 * a * distance) - speed) / a)
        return float((top - speed) / a + (distance - rising) / top)


class RouteVan(RouteDriver, Van):
    """A delivery van on a route."""


class RouteTruck(RouteDriver, Truck):
    """A long lorry on a route."""


class RouteDeliveryTruck(RouteTruck):
    """A lorry for towns on a route."""

    LENGTH, WIDTH = 8.5, 2.45  # m


class RouteBicycle(RouteDriver, Bicycle):
    """A bicycle on a route."""


class Parked(Driver):
    """A car that never moves."""

    def act(self, action: object = None) -> None:
        """Nobody is in it."""

    def step(self, dt: float) -> None:
        """It stands."""


class ParkedVan(Parked, Van):
    """A delivery van that never moves."""


class ParkedTruck(Parked, Truck):
    """A long lorry that never moves."""
