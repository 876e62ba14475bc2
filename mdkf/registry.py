"""Estimators by name, as the commands take them: the built-in ones and those of other packages.

A package adds its own by an entry point of the group `mdkf.estimators`, in its pyproject.toml:

    [project.entry-points."mdkf.estimators"]
    alpha-beta = "my_package.filters:AlphaBeta"

The object is an estimator, or a class or function that makes one without arguments. It is imported
when its name is asked for, never before. `NAME-retuned` is a built-in with another start variance.
"""

import difflib
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from mdkf.estimator import Estimator
from mdkf.imm import InteractingMultipleModel
from mdkf.kalman import Kalman
from mdkf.motion_dynamics import MotionDynamics

GROUP = "mdkf.estimators"
"""The entry points' group."""

RETUNED = "-retuned"
RETUNED_START_VARIANCE = (2.0, 100.0, 8.0, 8.0)
"""Start variances with a speed of 10 m/s in them; RobMOT's 4 (m/s)2 handicaps every filter
on tracks with a short history."""

_NAMED: dict[str, Kalman | InteractingMultipleModel | MotionDynamics] = {
    "cv": Kalman(order=1),
    "ca": Kalman(order=2),
    "cj": Kalman(order=3),
    "imm": InteractingMultipleModel(order=2, mixing="unbiased"),
    "imm-zero": InteractingMultipleModel(order=2, mixing="zero"),
    "imm3": InteractingMultipleModel(order=3, mixing="unbiased"),
    "imm3-zero": InteractingMultipleModel(order=3, mixing="zero"),
    "md": MotionDynamics(order=2),
    "md-keep": MotionDynamics(order=2, after_gap="keep"),
    "md-fw": MotionDynamics(order=2, covariance_by="FW"),
    "md-joint": MotionDynamics(order=2, axes="joint"),
    "md-innovation": MotionDynamics(order=2, denoise="innovation"),
    "md-posterior": MotionDynamics(order=2, denoise="posterior"),
    "md-raw": MotionDynamics(order=2, denoise="raw"),
    "md3": MotionDynamics(order=3),
    "md3-keep": MotionDynamics(order=3, after_gap="keep"),
}

_BUILT: dict[str, Estimator] = {
    **_NAMED,
    **{
        f"{name}{RETUNED}": replace(built, start_variance=RETUNED_START_VARIANCE)
        for name, built in _NAMED.items()
    },
}

# Names stand between commas on the command line and in the names of files.
_USABLE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


class _Estimators(Mapping[str, Estimator]):
    """All names, each value made when it is asked for."""

    def __getitem__(self, name: str) -> Estimator:
        # Only an unknown name is a KeyError: one that cannot be used is there, and says why.
        if name not in self:
            raise KeyError(name)
        return estimator(name)

    def __contains__(self, name: object) -> bool:
        return name in _BUILT or any(name == point.name for point in _points())

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*_BUILT, *_plugin_names())))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        return f"ESTIMATORS({', '.join(estimator_names())})"


ESTIMATORS: Mapping[str, Estimator] = _Estimators()
"""Estimators by every name that `estimator` takes; an installed package's is imported when asked
for. A list for people to read is `estimator_names()`."""


def estimator_names() -> tuple[str, ...]:
    """Names of the built-in estimators, without their `-retuned` variants, and of the installed
    packages'. Imports none of them."""
    return tuple(dict.fromkeys((*_NAMED, *_plugin_names())))


def built_in_name(description: str) -> str | None:
    """The name of the built-in estimator that a `Tracks` table's provenance describes so."""
    return next((name for name, built in _BUILT.items() if repr(built) == description), None)


def estimator(name: str) -> Estimator:
    """The estimator of a name.

    Raises `ValueError` for an unknown name, with the known ones, and for one that an installed
    package gives but that cannot be used, with the package and the reason.
    """
    points = [point for point in _points() if point.name == name]
    givers = [_origin(point) for point in points]
    if name in _BUILT:
        if points:
            raise ValueError(
                f"filter {name!r} is built in, and {givers[0]} takes its name; rename the entry"
                " point or uninstall the package"
            )
        return _BUILT[name]
    if len(points) > 1:
        raise ValueError(f"filter {name!r} is given twice: by {' and by '.join(givers)}")
    if points:
        return _loaded(points[0])
    close = difflib.get_close_matches(name, ESTIMATORS, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    known = ", ".join(estimator_names())
    raise ValueError(
        f"unknown filter {name!r}{hint}; known filters: {known}; a built-in NAME{RETUNED} starts"
        " with a larger speed variance"
    )


def _points() -> list[EntryPoint]:
    """Read anew each time (2 ms): a package may be installed while a notebook is open."""
    return sorted(entry_points(group=GROUP), key=lambda point: (point.name, point.value))


def _plugin_names() -> list[str]:
    return [point.name for point in _points()]


def _origin(point: EntryPoint) -> str:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown package"
    return f"entry point '{point.name} = {point.value}' of {package}"


@cache
def _loaded(point: EntryPoint) -> Estimator:
    """The estimator of an entry point, made once in a process."""
    if not _USABLE.fullmatch(point.name):
        raise ValueError(f"{_origin(point)}: a filter's name is of letters, digits, '.', '_', '-'")
    try:
        given = point.load()
    except Exception as error:
        raise ValueError(f"{_origin(point)} cannot be imported: {_told(error)}") from error
    made = given
    if isinstance(given, type) or not isinstance(given, Estimator):
        if not callable(given):
            raise ValueError(
                f"{_origin(point)} is a {type(given).__name__}, expected an estimator, or a class"
                " or function that makes one"
            )
        try:
            made = given()
        except Exception as error:
            raise ValueError(f"{_origin(point)} cannot be called: {_told(error)}") from error
    if isinstance(made, type) or not isinstance(made, Estimator):
        raise ValueError(
            f"{_origin(point)} makes a {type(made).__name__} without the methods of mdkf.Estimator;"
            " mdkf.testing.check_estimator names what is missing"
        )
    return made


def _told(error: Exception) -> str:
    """An error in one line, as the commands print it."""
    return " ".join(f"{type(error).__name__}: {error}".split())
