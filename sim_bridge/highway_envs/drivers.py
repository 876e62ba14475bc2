"""Drivers for highway-env, who follow lanes, and what they drive.

They follow the Intelligent Driver Model (Treiber et al. 2000) from bumper to bumper,
a = A (1 - (v / v0)^4 - (s* / gap)^2), s* = s0 + v T + v dv / (2 sqrt(A B)), change lanes by MOBIL,
and do what highway-env's own do not: they steer and brake within what tyres and passengers bear,
stand still in a queue, and never drive backwards.
"""

from typing import Any

import numpy as np
from highway_env.vehicle.behavior import IDMVehicle

NEAR = 25.0
"""More than two lorries and what they drive in a step [m]."""


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
        gap, ahead = np.inf, 0.0
        if self.speed <= self.HALT_SPEED:
            front, _ = self.road.neighbour_vehicles(self, self.lane_index)
            if front is not None:
                gap, ahead = self._gap(self, front), front.speed
        self.press(self.wish(self.action["acceleration"]), gap, ahead)

    def wish(self, acceleration: float) -> float:
        """The acceleration that the driver wants, given the model's [m/s2]."""
        return acceleration

    def press(self, wish: float, gap: float, ahead: float) -> None:
        """Put a wish [m/s2] on the pedals, never abruptly: a free `gap` [m] is before the bumper,
        and behind it something drives at `ahead` [m/s]."""
        wish = self._stop_in_queue(wish, gap, ahead)
        # From standstill the brake is off at once.
        before = self._command if self.speed > 0.0 else max(self._command, 0.0)
        change = self.JERK * self.REACTION
        self._command = float(np.clip(wish, before - change, before + change))
        self.action["acceleration"] = self._command

    def step(self, dt: float) -> None:
        """Move on, but not backwards."""
        self._since_decision += dt
        self.action["acceleration"] = max(self.action["acceleration"], -self.speed / dt)
        super().step(dt)
        if self.speed < 1e-9:
            self.speed = 0.0

    def handle_collisions(self, other: Any, dt: float = 0) -> None:
        """Look closer only at who is near; there are many pairs and this is half of the time."""
        if abs(self.position[0] - other.position[0]) < NEAR:
            super().handle_collisions(other, dt)

    def acceleration(
        self, ego_vehicle: Any, front_vehicle: Any = None, rear_vehicle: Any = None
    ) -> float:
        """The model's acceleration [m/s2] of a vehicle behind another."""
        if not isinstance(ego_vehicle, Driver):
            return 0.0
        driver = ego_vehicle
        target = min(driver.target_speed, driver.lane.speed_limit or np.inf)
        if not front_vehicle:
            return driver.follow(target)
        ahead = float(front_vehicle.velocity @ driver.direction)
        return driver.follow(target, self._gap(driver, front_vehicle), ahead)

    def follow(self, target: float, gap: float = np.inf, ahead: float = 0.0) -> float:
        """The model's acceleration [m/s2] towards `target` [m/s], `gap` [m] behind something that
        drives at `ahead` [m/s]."""
        speed = max(self.speed, 0.0)
        braking = speed * (speed - ahead) / (2.0 * np.sqrt(self.ACCELERATION * self.BRAKING))
        wanted = self.JAM_GAP + max(speed * self.TIME_GAP + braking, 0.0)
        share = 1.0 - (speed / max(target, 0.1)) ** 4 - (wanted / max(gap, 0.1)) ** 2
        return float(max(self.ACCELERATION * share, -self.HARDEST_BRAKING))

    def mobil(self, lane_index: Any) -> bool:
        """Whether to change to a lane: not beside or just before anyone who is or wants there."""
        for other in self.road.vehicles:
            wants = getattr(other, "target_lane_index", other.lane_index)
            if other is not self and lane_index in (other.lane_index, wants):
                apart = abs(self.lane_distance_to(other)) - (self.LENGTH + other.LENGTH) / 2
                if apart < self.LANE_CHANGE_ROOM:
                    return False
        return bool(super().mobil(lane_index))

    def _stop_in_queue(self, wish: float, gap: float, ahead: float) -> float:
        """Halt behind who stands, where the model alone would creep up for ever, and wait there
        until there is room to drive on."""
        if self.speed > self.HALT_SPEED:
            return wish
        if self.speed == 0.0:
            return wish if gap > self.JAM_GAP + self.START_ROOM else 0.0
        halts = ahead < self.HALT_SPEED / 2
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


class Bicycle(Driver):
    """A bicycle and its rider."""

    KIND, HEIGHT = "bicycle", 1.7  # m
    LENGTH, WIDTH = 1.8, 0.6  # m
    ACCELERATION = 1.0  # m/s2


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
