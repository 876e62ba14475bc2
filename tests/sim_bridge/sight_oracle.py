"""The visible fraction by ray casting and by quadrature, to compare the kernel with.

Nothing is shared with it: rays are clipped by the slabs of each box in the box's own frame; there
are no wall equations, no events and no envelope.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad

Floats = NDArray[np.float64]


def chord(sensor: Floats, box: Floats, theta: Floats) -> tuple[Floats, Floats]:
    """Distances at which rays along theta enter and leave a footprint, (inf, -inf) on a miss."""
    c, s = np.cos(box[3]), np.sin(box[3])
    dx, dy = sensor[0] - box[0], sensor[1] - box[1]
    origin = (c * dx + s * dy, -s * dx + c * dy)
    heading = (np.cos(theta - box[3]), np.sin(theta - box[3]))
    enter, leave = np.zeros_like(theta), np.full_like(theta, np.inf)
    for o, h, half in zip(origin, heading, box[4:6] / 2, strict=True):
        h = np.where(np.abs(h) < 1e-300, 1e-300, h)
        t1, t2 = (-half - o) / h, (half - o) / h
        enter, leave = np.maximum(enter, np.minimum(t1, t2)), np.minimum(leave, np.maximum(t1, t2))
    hit = leave > enter
    return np.where(hit, enter, np.inf), np.where(hit, leave, -np.inf)


def azimuths(sensor: Floats, box: Floats) -> tuple[float, Floats]:
    """Azimuth of the centre, and of the four corners relative to it, continuous over the cut."""
    c, s = np.cos(box[3]), np.sin(box[3])
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    corners = box[:2] + (signs * box[4:6] / 2) @ np.array([(c, s), (-s, c)]) - sensor[:2]
    centre = complex(*(box[:2] - sensor[:2]))
    relative = np.angle((corners[:, 0] + 1j * corners[:, 1]) / centre)
    relative[relative - relative[0] > math.pi] -= 2 * math.pi  # seen from close by, a box
    relative[relative - relative[0] < -math.pi] += 2 * math.pi  # reaches past pi from its centre
    return float(np.angle(centre)), relative


def blocked(sensor: Floats, points: Floats, box: Floats) -> NDArray[np.bool_]:
    """Does the 3-D segment from sensor to point run through a box that reaches down forever?"""
    c, s = np.cos(box[3]), np.sin(box[3])
    turn = np.array([(c, -s), (s, c)])
    start = (sensor[:2] - box[:2]) @ turn
    step = (points[:, :2] - sensor[:2]) @ turn
    enter, leave = np.zeros(len(points)), np.ones(len(points))
    for axis in range(2):
        h = np.where(np.abs(step[:, axis]) < 1e-300, 1e-300, step[:, axis])
        t1, t2 = (-box[4 + axis] / 2 - start[axis]) / h, (box[4 + axis] / 2 - start[axis]) / h
        enter, leave = np.maximum(enter, np.minimum(t1, t2)), np.minimum(leave, np.maximum(t1, t2))
    climb = points[:, 2] - sensor[2]
    room = box[2] + box[6] / 2 - sensor[2]  # below the top where climb * t < room
    cut = room / np.where(climb == 0.0, 1e-300, climb)
    leave = np.where(climb > 0.0, np.minimum(leave, cut), leave)
    enter = np.where(climb < 0.0, np.maximum(enter, cut), enter)
    leave = np.where((climb == 0.0) & (room <= 0.0), -1.0, leave)
    return leave - enter > 1e-9


def cast_fractions(sensor: Floats, boxes: Floats, n_azimuth: int) -> Floats:
    """Visible fractions by segments to points on the silhouettes, the shadow line by bisection."""
    fractions = np.empty(len(boxes))
    for i, target in enumerate(boxes):
        centre, relative = azimuths(sensor, target)
        low, high = relative.min(), relative.max()
        theta = centre + low + (np.arange(n_azimuth) + 0.5) / n_azimuth * (high - low)
        reach = chord(sensor, target, theta)[0]
        foot = sensor[:2] + reach[:, None] * np.column_stack([np.cos(theta), np.sin(theta)])
        bottom, top = target[2] - target[6] / 2, target[2] + target[6] / 2
        dark, lit = np.full(n_azimuth, bottom), np.full(n_azimuth, top)
        for _ in range(24):
            middle = (dark + lit) / 2
            points = np.column_stack([foot, middle])
            hidden = np.zeros(n_azimuth, dtype=bool)
            for j, box in enumerate(boxes):
                if j != i:
                    hidden |= blocked(sensor, points, box)
            dark, lit = np.where(hidden, middle, dark), np.where(hidden, lit, middle)
        fractions[i] = np.mean((top - dark) / (top - bottom))
    return fractions


def gauss(f: Callable[[Floats], Floats], a: Floats, b: Floats, n: int) -> Floats:
    """Gauss-Legendre integrals of f over the panels [a, b] with n nodes each."""
    node, weight = np.polynomial.legendre.leggauss(n)
    x = (a + b)[:, None] / 2 + (b - a)[:, None] / 2 * node
    values: Floats = f(x.ravel()).reshape(x.shape) @ weight * (b - a) / 2
    return values


def quad_fraction(sensor: Floats, boxes: Floats, i: int) -> float:
    """Visible fraction of box i by quadrature over azimuth, adaptive wherever it is not smooth.

    Panels end at every corner and are fine enough that no dip slips between their nodes.
    """
    target = boxes[i]
    centre, relative = azimuths(sensor, target)
    low, high = float(relative.min()), float(relative.max())
    bottom, top = target[2] - target[6] / 2, target[2] + target[6] / 2

    def visible(offset: Floats) -> Floats:
        theta = centre + offset
        reach = np.minimum(
            chord(sensor, target, theta)[0], 1e9
        )  # inf where an end rounds to a miss
        hidden = np.full_like(theta, bottom)
        for j, box in enumerate(boxes):
            enter, leave = chord(sensor, box, theta)
            rise = box[2] + box[6] / 2 - sensor[2]
            before = (enter < reach) & (leave > 0.0) & (j != i)
            slope = np.maximum(rise / enter, rise / leave)
            hidden = np.where(before, np.maximum(hidden, sensor[2] + slope * reach), hidden)
        return (top - np.minimum(hidden, top)) / (top - bottom)

    cuts = {low, high}
    for box in boxes:
        other, corners = azimuths(sensor, box)
        cuts |= {math.remainder(other + c - centre, 2 * math.pi) for c in corners}
    edges = sorted(c for c in cuts if low <= c <= high)
    grid = np.concatenate([np.linspace(a, b, 1001) for a, b in pairwise(edges)])
    a, b = grid[:-1][np.diff(grid) > 0.0], grid[1:][np.diff(grid) > 0.0]
    fine = gauss(visible, a, b, 9)
    rough = np.abs(fine - gauss(visible, a, b, 6)) > 1e-13 * (b - a)
    total = fine[~rough].sum()
    for c, d in zip(a[rough], b[rough], strict=True):
        total += quad(lambda x: visible(np.array([x]))[0], c, d, epsabs=1e-14, epsrel=1e-10)[0]
    return float(total / (high - low))
