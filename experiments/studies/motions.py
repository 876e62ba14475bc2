"""Times into planar motions in closed form: position, velocity and acceleration, all exact.

Time is zero in the first frame of the gap; positions and velocities are continuous everywhere.
A motion is a straight line of piecewise constant acceleration, s = s_i + v_i (t - t_i) +
a_i (t - t_i)^2 / 2 from its change i on, or a circle, p = (v/w) (sin wt, 1 - cos wt).
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from mdkf.tables import FloatArray


@dataclass(frozen=True, eq=False)
class Kinematics:
    """Truth at some times (...): position [m], velocity [m/s], acceleration [m/s2], (..., 2)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True)
class Straight:
    """Along a line through the origin.

    speed: before the first change, or always if there is none [m/s].
    changes: (time [s], acceleration from then on [m/s2]), in the order of time.
    heading: of the line, counter-clockwise from x [rad].
    """

    speed: float
    changes: tuple[tuple[float, float], ...] = ()
    heading: float = 0.0

    def at(self, time: FloatArray) -> Kinematics:
        """The motion at times of any shape [s]."""
        # The stretch before the first change comes first: a stretch is its start (time,
        # distance, speed) and its acceleration.
        start = self.changes[0][0] if self.changes else 0.0
        stretches = [(start, 0.0, self.speed, 0.0)]
        for since, acceleration in self.changes:
            begun, distance, speed, rate = stretches[-1]
            lasted = since - begun
            distance += speed * lasted + rate * lasted**2 / 2
            stretches.append((since, distance, speed + rate * lasted, acceleration))
        place = np.searchsorted([since for since, _ in self.changes], time, side="right")
        begun, distance, speed, rate = np.array(stretches).T[:, place]
        lasted = time - begun
        along = np.array([cos(self.heading), sin(self.heading)])
        return Kinematics(
            (distance + speed * lasted + rate * lasted**2 / 2)[..., None] * along,
            (speed + rate * lasted)[..., None] * along,
            rate[..., None] * along,
        )


@dataclass(frozen=True)
class Turn:
    """On a circle at constant speed [m/s] and yaw rate [rad/s]; heading along x at time zero."""

    speed: float
    rate: float

    def at(self, time: FloatArray) -> Kinematics:
        """The motion at times of any shape [s]."""
        angle = self.rate * time
        forward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        leftward = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        centre = np.array([0.0, self.speed / self.rate])
        return Kinematics(
            centre - leftward * self.speed / self.rate,
            forward * self.speed,
            leftward * self.speed * self.rate,
        )


@dataclass(frozen=True)
class Regime:
    """A kind of motion around a gap that begins at time zero.

    parameters: what the motion does, with units. period: each seed begins at another time of
    the motion, uniform in [0, period) later [s]; zero where all seeds share one motion.
    """

    id: str
    title: str
    parameters: str
    motion: Straight | Turn
    period: float = 0.0


def _repeated(
    cycle: tuple[tuple[float, float], ...], start: float, times: int
) -> tuple[tuple[float, float], ...]:
    """Changes of a cycle of (duration [s], acceleration [m/s2]) that is run through some times."""
    changes = []
    for duration, acceleration in cycle * times:
        changes.append((start, acceleration))
        start += duration
    return tuple(changes)


_STOP_AND_GO = ((2.0, 0.0), (3.0, 2.0), (2.0, 0.0), (2.0, -3.0))
"""Stand, pull away, drive at 6 m/s, brake: (duration [s], acceleration [m/s2])."""

REGIMES = (
    Regime("stationary", "stationary", "stands all the time", Straight(0.0)),
    Regime(
        "stopped",
        "stopped 1 s before the gap",
        "10 m/s, from 3.5 s before the gap -4 m/s2, stands from 1 s before it on",
        Straight(10.0, ((-3.5, -4.0), (-1.0, 0.0))),
    ),
    Regime(
        "constant-velocity",
        "constant velocity 10 m/s along an axis",
        "10 m/s along x all the time",
        Straight(10.0),
    ),
    Regime(
        "acceleration-ended",
        "acceleration just ended",
        "6 m/s, from 2 s before the gap +2 m/s2, 10 m/s as soon as it begins",
        Straight(6.0, ((-2.0, 2.0), (0.0, 0.0))),
    ),
    Regime(
        "stop-and-go",
        "stop-and-go",
        "stands 2 s, +2 m/s2 for 3 s, 6 m/s for 2 s, -3 m/s2 for 2 s, again and again; the gap"
        " begins anywhere in the cycle",
        Straight(0.0, _repeated(_STOP_AND_GO, start=-4.0, times=2)),
        period=9.0,
    ),
    Regime(
        "braking",
        "braking −4 m/s² through the gap",
        "14 m/s, from 1 s before the gap -4 m/s2 to its end: 10 m/s as it begins, 2.4 m/s in its"
        " 20th frame",
        Straight(14.0, ((-1.0, -4.0),)),
    ),
    Regime(
        "accelerating",
        "accelerating +2 m/s²",
        "2 m/s 4 s before the gap, +2 m/s2 all the time: 10 m/s as the gap begins",
        Straight(2.0, ((-4.0, 2.0),)),
    ),
    Regime(
        "turning",
        "turning 0.4 rad/s",
        "10 m/s on a circle of 25 m radius all the time, along x as the gap begins",
        Turn(10.0, 0.4),
    ),
    Regime(
        "crawling",
        "crawling 0.7 m/s at 45 degrees",
        "0.7 m/s at 45 degrees to the axes all the time",
        Straight(0.7, heading=pi / 4),
    ),
)
