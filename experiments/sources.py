"""A module into all that decides what it computes: the sources it imports, and their versions.

Of this package those that are imported, directly or by way of others; of the filters, scenarios and
simulators all, their data files among them.
"""

import ast
import hashlib
import json
import platform
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import mdkf
import scenarios
import sim_bridge
from mdkf import Estimator

_PACKAGE = Path(__file__).parent
_ROOMS = tuple(Path(str(package.__file__)).parent for package in (mdkf, scenarios, sim_bridge))
_KINDS = (".py", ".yaml")
VERSIONS = ("libsumo", "highway-env", "gymnasium", "numpy", "scipy", "numba", "filterpy")
"""Packages that decide numbers: simulators, and what they and the filters are computed with."""


@cache
def deciding(module: Path) -> str:
    """A text that is the same where the module computes the same: SHA-256 sums of sources by name,
    versions of what they call, and the kind of machine."""
    everything = (path for room in _ROOMS for path in room.rglob("*") if path.suffix in _KINDS)
    sources = sorted({*_imported(module), *everything})
    sums = {_name(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in sources}
    versions = {package: version(package) for package in VERSIONS}
    machine = [platform.python_version(), platform.system(), platform.machine()]
    return json.dumps([sums, versions, machine], sort_keys=True)


def _imported(module: Path) -> set[Path]:
    """The module, and what of this package it imports."""
    found, waiting = set[Path](), [module]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imports(path)
    return found


@cache
def _imports(path: Path) -> list[Path]:
    """Files of this package that a file names in its imports."""
    named: list[str] = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            named += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            named += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return [file for name in named for file in _files(name)]


def _files(name: str) -> Iterator[Path]:
    """The file of a module of this package, if the name is one's."""
    package, *parts = name.split(".")
    if package == _PACKAGE.name:
        place = _PACKAGE.joinpath(*parts)
        for path in (place.with_suffix(".py"), place / "__init__.py"):
            if path.is_file():
                yield path


def _name(path: Path) -> str:
    """A file's name from its package on."""
    roots = (_PACKAGE.parent, *(room.parent for room in _ROOMS))
    within = next((root for root in roots if path.is_relative_to(root)), path.parent)
    return path.relative_to(within).as_posix()


def described(estimator: Estimator) -> str:
    """An estimator's class and options, the same in every process."""
    kind = type(estimator)
    if kind.__repr__ is not object.__repr__:
        return repr(estimator)
    # The default tells the object's address.
    slots = {name: getattr(estimator, name, None) for name in getattr(kind, "__slots__", ())}
    return f"{kind.__qualname__}({slots or vars(estimator)})"


def computing(estimator: Estimator) -> str:
    """A text that is the same where an estimator computes the same: its class, its options, and
    the sources of its package, which `deciding` has of this project's."""
    module = type(estimator).__module__
    package = module.partition(".")[0]
    own = described(estimator)
    return own if package == mdkf.__name__ else f"{module}.{own} {_contents(package)}"


@cache
def _contents(package: str) -> str:
    """SHA-256 of the files of a package, or of a module that is in none; of what was typed into an
    interpreter there are none."""
    module = sys.modules[package]
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    files = [path for folder in folders for path in sorted(folder.rglob("*")) if path.is_file()]
    if not files and getattr(module, "__file__", None):
        files = [Path(str(module.__file__))]
    digest = hashlib.sha256()
    for path in files:
        if path.parent.name != "__pycache__":
            digest.update(path.read_bytes())
    return digest.hexdigest()
