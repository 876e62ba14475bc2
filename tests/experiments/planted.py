"""A package of filters whose faults are known, installed as pip would, a quick scenario, and the
search that finds the fault in it."""

import os
from pathlib import Path

import polars as pl

import experiments
from tests.experiments.commands import Answer, in_a_process, plain

FILTERS = """
import numpy as np
from mdkf import Kalman


class Drifting:
    '''Constant velocity, but frames without a measurement move it sideways.'''

    def __init__(self):
        self._sound = Kalman(order=1)

    def start(self, position, noise):
        return self._sound.start(position, noise)

    def predict(self, state, dt):
        unseen = np.isnan(state.nis)
        told = self._sound.predict(state, dt)
        told.mean[unseen, 2] += self.sideways(told)[unseen]
        return told

    def update(self, state, position, noise):
        return self._sound.update(state, position, noise)

    def position(self, state):
        return self._sound.position(state)

    def velocity(self, state):
        return self._sound.velocity(state)

    def covariance(self, state):
        return self._sound.covariance(state)

    def diagnostics(self, state):
        return self._sound.diagnostics(state)


class Faulty(Drifting):
    '''By 0.1 m a frame, between 11 and 12 m/s.'''

    def sideways(self, state):
        speed = np.linalg.norm(self.velocity(state), axis=1)
        return 0.1 * ((speed > 11) & (speed < 12))


class Reckless(Faulty):
    '''By 2 m a frame there: out of every gate.'''

    def sideways(self, state):
        return 20 * super().sideways(state)


class Random(Drifting):
    '''By what the last digits of the position make of it: of no use, and of no harm on average.'''

    def __init__(self, phase=0.0):
        super().__init__()
        self.phase = phase

    def __repr__(self):
        return f"Random({self.phase})"

    def sideways(self, state):
        return 0.3 * np.sin(1e6 * self.position(state)[:, 0] + self.phase)


def other():
    return Random(2.0)
"""

POINTS = """[mdkf.estimators]
faulty = planted_filters:Faulty
reckless = planted_filters:Reckless
random = planted_filters:Random
other-random = planted_filters:other
"""

SCENARIO = """
name: passing_by
purpose: A car passes by.
source: closed-form
motion: polynomial
duration: 3.0
parameters:
  x: {unit: m, default: -15.0, minimum: -60.0, maximum: 60.0, description: where it starts}
  y: {unit: m, default: 12.0, minimum: -300.0, maximum: 300.0, description: where it starts}
  heading: {unit: rad, default: 0.0, minimum: 0.0, maximum: 0.0, description: its direction}
  speed: {unit: m/s, default: 6.0, minimum: 2.0, maximum: 20.0, description: its speed}
  acceleration: {unit: m/s2, default: 0.0, minimum: 0.0, maximum: 0.0, description: none}
  jerk: {unit: m/s3, default: 0.0, minimum: 0.0, maximum: 0.0, description: none}
"""

HIDDEN = ("--occlusion", "mid:10:12")
"""Half a second longer than a track needs, and a second's gap: all in the scenario's three."""
SPEEDS = ("--bounds", "speed=2:20")
SMALL = (*HIDDEN, *SPEEDS, "--trials", 32, "--seeds", 2, "--check-seeds", 8, "--workers", 1)
FAULTY = ("search", "--filter", "faulty", "--against", "cv", "--scenario", "passing_by.yaml")


def install(
    folder: Path, source: str = FILTERS, name: str = "planted_filters", points: str = POINTS
) -> Path:
    """The package in a folder that then has to be on the path; returns the folder."""
    (folder / f"{name}.py").write_text(source, encoding="utf-8")
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir(exist_ok=True)
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
    (info / "METADATA").write_text(metadata, encoding="utf-8")
    (info / "entry_points.txt").write_text(points, encoding="utf-8")
    return folder


def passing_by(folder: Path) -> Path:
    """The scenario's file."""
    path = folder / "passing_by.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def plant(folder: Path) -> Path:
    """The scenario in a folder, the filters in its folder `site`, which is returned."""
    passing_by(folder)
    (folder / "site").mkdir()
    return install(folder / "site")


def with_filters(folder: Path) -> dict[str, str]:
    """The environment, for another process, in which the filters are installed."""
    mine = Path(experiments.__file__).parents[1]
    return {**plain(), "PYTHONPATH": os.pathsep.join((str(folder / "site"), str(mine)))}


def searching(folder: Path, *arguments: object) -> Answer:
    """`mdkf ARGUMENTS...` with the filters, in a process of its own."""
    words = map(str, arguments)
    return in_a_process(*words, folder=folder, environment=with_filters(folder))


def tables(folder: Path) -> dict[str, pl.DataFrame]:
    """What a search has written."""
    names = ("trials", "checks", "worlds")
    return {name: pl.read_parquet(folder / f"{name}.parquet") for name in names}
