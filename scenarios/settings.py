"""Turns a YAML file into a validated pydantic model, or into one line that says what is wrong.

Only plain YAML is accepted: no tags, no aliases (a few lines of them expand to gigabytes), no
repeated keys (YAML would silently keep the last). Scenarios and detector profiles are read so.
"""

from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

MAX_FILE_SIZE = 1_000_000  # bytes; a scenario of a thousand parked cars is a tenth of this
MAX_SHOWN_INPUT = 60  # characters of a refused value that are quoted in the message


class Settings(BaseModel):
    """Base of all settings: frozen, no unknown keys, no conversions, finite numbers."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


AnySettings = TypeVar("AnySettings", bound=Settings)


def read_settings(
    path: Path,
    model_of: Callable[[Mapping[str, Any]], type[AnySettings]],
    error: type[ValueError],
) -> AnySettings:
    """Read and check a YAML file; `model_of` its document says what it must be.

    Raises `error`, one line with the file, the key and what was expected there.
    """
    try:
        document = _parse(path)
        if not isinstance(document, dict):
            raise _Problem(f"expected a mapping of keys, found {_shown(document)}")
        model = model_of(document)
        return model.model_validate(document)
    except _Problem as problem:
        raise error(f"{path}: {problem}") from None
    except ValidationError as problem:
        raise error(f"{path}: {_first_problem(problem, model)}") from None
    except RecursionError:
        raise error(f"{path}: is nested too deeply") from None


class _Problem(Exception):
    """What is wrong with a file, without its name."""


class _PlainLoader(yaml.SafeLoader):
    """SafeLoader that refuses aliases and repeated keys."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            parser: Any = self  # this method has no type in the stubs
            mark = parser.get_event().start_mark
            raise yaml.composer.ComposerError(None, None, "aliases (*name) are not accepted", mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None,
                        None,
                        f"key {key.value[:MAX_SHOWN_INPUT]!r} is given twice",
                        key.start_mark,
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parse(path: Path) -> object:
    try:
        if not path.is_file():
            what = "is not a regular file" if path.exists() else "does not exist"
            raise _Problem(f"{what}; expected a YAML file")
        with path.open("rb") as file:
            content = file.read(MAX_FILE_SIZE + 1)
    except (OSError, ValueError) as error:
        raise _Problem(f"cannot be read: {error}") from None
    if len(content) > MAX_FILE_SIZE:
        raise _Problem(f"is larger than {MAX_FILE_SIZE} bytes; expected a YAML file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise _Problem("is not UTF-8 text; expected a YAML file") from None
    try:
        # _PlainLoader is a SafeLoader: it constructs no Python objects.
        return yaml.load(text, Loader=_PlainLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise _Problem(f"YAML error{where}: {_one_line(error.problem)}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # e.g. the date 2024-99-99
        raise _Problem(f"YAML error: {_one_line(error)}") from None


def _first_problem(error: ValidationError, model: type[BaseModel]) -> str:
    problems = error.errors(include_url=False, include_context=False)
    # A misspelt key is also a missing one: the misspelling is what the user needs to see.
    problem = min(problems, key=lambda problem: problem["type"] != "extra_forbidden")
    # Steps in brackets are pydantic's own: which of several types was meant, or a key itself.
    steps = [step for step in map(_one_line, problem["loc"]) if not step.startswith("[")]
    key = ".".join(steps) or "(top level)"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    if problem["type"] == "extra_forbidden":
        known = _known_keys(model, problem["loc"])
        return f"unknown key {key}; expected one of: {', '.join(known)}{more}"
    if problem["type"] == "missing":
        return f"missing key {key}{more}"
    expected = problem["msg"].removeprefix("Value error, ")
    return f"key {key}: {expected}, found {_shown(problem['input'])}{more}"


def _known_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """The keys of the model in which the last step of a location was not found."""
    inside: Any = model
    for step in location[:-1]:
        if isinstance(inside, type) and issubclass(inside, BaseModel):
            inside = inside.model_fields[str(step)].annotation
        else:
            # An entry of a list or of a dictionary, whose values are models themselves.
            inside = get_args(inside)[-1]
    return list(inside.model_fields)


def _shown(value: object) -> str:
    """A refused value, quoted only if it is short by construction."""
    if isinstance(value, str):
        return repr(value[:MAX_SHOWN_INPUT]) + ("..." if len(value) > MAX_SHOWN_INPUT else "")
    if value is None or isinstance(value, bool | int | float):
        text = str(value) if not isinstance(value, int) or abs(value) < 10**30 else "a huge integer"
        return "nothing" if value is None else text
    if isinstance(value, BaseModel):
        return "these values"
    names = {"dict": "a mapping", "list": "a list"}
    return names.get(type(value).__name__, f"a {type(value).__name__}")


def _one_line(text: object) -> str:
    return " ".join(str(text).split())[:200]
