"""Somebody's own tracker: nearest neighbours, alpha-beta filters. Of mdkf it knows tables only."""

from dataclasses import dataclass

import numpy as np

from mdkf import Tracks

MEASUREMENT_VARIANCE = 0.03  # of a detection's position along x and y [m2]
ACCELERATION = 2.0  # standard deviation of what the filter does not know [m/s2]
GATE = 2.5  # between a prediction and its detection [m]
LONGEST_COAST = 25  # frames without a detection, once confirmed
CONFIRMED = 5  # detections in a row: what is gone before was clutter


@dataclass
class Track:
    number: int
    position: np.ndarray
    velocity: np.ndarray
    box: dict
    seen: int = 1
    missed: int = 0

    def confirmed(self):
        return self.seen >= CONFIRMED


def gains(dt):
    """Steady-state gains of the alpha-beta filter, by the tracking index (Kalata, 1984)."""
    index = ACCELERATION * dt**2 / np.sqrt(MEASUREMENT_VARIANCE)
    r = (4 + index - np.sqrt(8 * index + index**2)) / 4
    alpha = 1 - r**2
    return alpha, 2 * (2 - alpha) - 4 * np.sqrt(1 - alpha)


def track(seen):
    """Tracks of detections."""
    alpha, beta = gains(seen.dt)
    live, rows, born = [], [], 0
    for frame in range(seen.n_frames):
        here = seen.frame_rows(frame)
        measured = np.column_stack([seen.x[here], seen.y[here]])
        boxes = [
            {name: getattr(seen, name)[row] for name in ("z", "yaw", "length", "width", "height")}
            | {"score": seen.score[row]}
            for row in range(here.start, here.stop)
        ]
        free = set(range(len(boxes)))
        for one in live:
            one.position = one.position + seen.dt * one.velocity
            one.missed += 1
            near = {k: float(np.hypot(*(measured[k] - one.position))) for k in free}
            if near and min(near.values()) < GATE:
                k = min(near, key=near.get)
                free.remove(k)
                innovation = measured[k] - one.position
                one.position = one.position + alpha * innovation
                one.velocity = one.velocity + beta / seen.dt * innovation
                one.box, one.missed, one.seen = boxes[k], 0, one.seen + 1
        live = [one for one in live if one.missed <= LONGEST_COAST * one.confirmed()]
        for k in sorted(free):
            live.append(Track(born, measured[k], np.zeros(2), boxes[k]))
            born += 1
        for one in filter(Track.confirmed, live):
            rows.append(
                {"frame": frame, "track_id": one.number, "coasted": one.missed > 0, **one.box}
                | {"x": one.position[0], "y": one.position[1]}
                | {"vx": one.velocity[0], "vy": one.velocity[1]}
                | dict.fromkeys(("cov_xx", "cov_yy"), alpha * MEASUREMENT_VARIANCE)
                | {"cov_xy": 0.0}
            )
    columns = {name: [row[name] for row in rows] for name in Tracks.column_types()}
    return Tracks.from_columns(columns, n_frames=seen.n_frames, dt=seen.dt)


class AlphaBeta:
    """The same filter as an estimator, for mdkf's tracker: rows of x, y [m], vx, vy [m/s]."""

    def start(self, position, noise):
        return np.hstack([position, 0 * position])

    def predict(self, state, dt):
        self.alpha, beta = gains(dt)
        self.beta = beta / dt
        return state + dt * np.hstack([state[:, 2:], 0 * state[:, 2:]])

    def update(self, state, position, noise):
        error = np.nan_to_num(position - state[:, :2])  # a row of NaN: not measured
        return state + np.hstack([self.alpha * error, self.beta * error])

    def position(self, state):
        return state[:, :2]

    def velocity(self, state):
        return state[:, 2:]

    def covariance(self, state):
        return np.tile(MEASUREMENT_VARIANCE * np.eye(2), (len(state), 1, 1))

    def diagnostics(self, state):
        return {}
