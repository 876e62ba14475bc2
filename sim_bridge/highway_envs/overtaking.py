"""Drivers who overtake through the oncoming lane when what they see of it is free.

They follow the slow one ahead, pull out, pass as soon as they are beside his path, and pull in
again in front of him. To get past takes T = t1 + sqrt(2 D / A) + t2, where D is what has to be
gained, and t1 and t2 are the times to get out of his way and back; in that time nobody may come.
"""

import numpy as np

from sim_bridge.highway_envs.drivers import Van
from sim_bridge.highway_envs.route_drivers import RouteDriver

LANE = 4.0  # m from lane to lane


class OvertakingCar(RouteDriver):
    """A car whose driver overtakes."""

    ACCELERATION = 2.2  # m/s2
    TIME_GAP = 1.1  # s
    SHIFT = 3.6  # s from lane to lane
    IMPATIENCE = 3.0  # m/s less than wanted
    CLOSE = 35.0  # m behind who is to be overtaken
    PULL_IN_GAP = 8.0  # m
    RESERVE = 3.0  # s in which nobody has come yet when all is over

    _from, _to, _clock = 0.0, 0.0, np.inf  # offsets of the lanes [m], s since the change began
    _passed: RouteDriver | None = None  # who is being overtaken

    def decide(self) -> None:
        """Pull out, pull in, or stay."""
        if self._clock < self.SHIFT:
            return
        ahead = [v for v in self._same_way() if v.place > self.place]
        if self._to == 0.0:
            if ahead and self._wants_past(ahead[0]) and self._can_pass(*ahead[:2]):
                self._passed = ahead[0]
                self._change_to(-LANE)
        elif self._may_pull_in():
            self._change_to(0.0)

    def step(self, dt: float) -> None:
        """Move on, and aside."""
        self._clock += dt
        super().step(dt)

    def lateral(self) -> tuple[float, float, float]:
        """From lane to lane by a polynomial of fifth degree, at rest at both ends."""
        t = min(self._clock / self.SHIFT, 1.0)
        way = self._to - self._from
        return (
            self._from + way * t**3 * (10.0 - 15.0 * t + 6.0 * t**2),
            way * 30.0 * t**2 * (1.0 - t) ** 2 / self.SHIFT,
            way * 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / self.SHIFT**2,
        )

    def lanes(self) -> tuple[float, ...]:
        """Where it is, and where it is going: back, once it is past."""
        past = self._passed is not None and self._passed.front < self.rear
        return (self.lateral()[0], 0.0 if past else self._to)

    @property
    def overtakes(self) -> bool:
        """Whether any of it is, or is about to be, in the oncoming lane."""
        return self._to != 0.0 or self._clock < self.SHIFT

    def _change_to(self, offset: float) -> None:
        self._from, self._to, self._clock = self._to, offset, 0.0

    def _same_way(self) -> list[RouteDriver]:
        """Who else drives along this path, the rearmost first."""
        others = (v for v in self.road.vehicles if v is not self and isinstance(v, RouteDriver))
        return sorted((v for v in others if v.path is self.path), key=lambda v: v.place)

    def _wants_past(self, ahead: RouteDriver) -> bool:
        slow = min(ahead.speed, ahead.target_speed) < self.target_speed - self.IMPATIENCE
        return slow and ahead.rear - self.front < self.CLOSE and not overtakes(ahead)

    def _can_pass(self, ahead: RouteDriver, next_one: RouteDriver | None = None) -> bool:
        """Whether there is room before the one ahead, nobody else overtakes, and nobody comes."""
        gain = ahead.front - self.rear + self.PULL_IN_GAP
        if next_one is not None:
            # He pulls in fast and has to slow down to who is next.
            faster = min(np.sqrt(2.0 * self.ACCELERATION * gain), self.target_speed - ahead.speed)
            closing = max(ahead.speed + faster - next_one.speed, 0.0)
            room = self.PULL_IN_GAP + self.LENGTH + self.JAM_GAP + self.TIME_GAP * next_one.speed
            if next_one.rear - ahead.front < room + closing**2 / (2.0 * self.BRAKING):
                return False
        time = self.SHIFT + np.sqrt(2.0 * gain / self.ACCELERATION)
        reach = gain + ahead.speed * time
        if any(overtakes(v) and abs(v.place - self.place) < 1.5 * reach for v in self._same_way()):
            return False
        return self._nobody_comes(reach, time + self.RESERVE)

    def _nobody_comes(self, reach: float, time: float) -> bool:
        """Whether whoever is oncoming stays away from the next `reach` [m] for a time [s]."""
        forward = np.array([np.cos(self.heading), np.sin(self.heading)])
        for other in self.road.vehicles:
            if isinstance(other, RouteDriver) and other.path is not self.path:
                away = float((other.position - self.position) @ forward)
                if 0.0 < away < reach + max(other.speed, other.target_speed) * time:
                    return False
        return True

    def _may_pull_in(self) -> bool:
        """Whether he is past, and nobody is beside or close before or behind in the lane."""
        gap = self.PULL_IN_GAP
        return (self._passed is None or self._passed.front < self.rear) and all(
            v.front < self.rear - gap or v.rear > self.front + gap
            for v in self._same_way()
            if not overtakes(v)
        )


class OvertakingVan(OvertakingCar, Van):
    """A delivery van whose driver overtakes."""

    ACCELERATION = 1.8  # m/s2


def overtakes(driver: RouteDriver) -> bool:
    """Whether a driver is overtaking."""
    return isinstance(driver, OvertakingCar) and driver.overtakes
