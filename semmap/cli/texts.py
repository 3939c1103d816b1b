"""Texts of options as values, by the annotations of the arguments that get them."""

from __future__ import annotations

import ast
import json
import math
import re
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from semmap.belief.identify import Detection


class Kind(NamedTuple):
    """What an option reads, and the value of what it read; the option is named in errors."""

    type: Any
    value: Callable[[Any, str], Any] = lambda read, option: read
    metavar: str | None = None


def kind_of(annotation: str, shape: str = "") -> Kind | None:
    """The kind of an option for an argument; None where no text becomes such a value.

    `shape` has the names of numbers, as ``X,Y,Z`` or in a docstring's ``(x, y, z)``.

    >>> kind_of("Sequence[float] | None", "(x, y), metres").value("1,2.5", "--near")
    (1.0, 2.5)
    """
    parts = [part for part in re.split(r" \| (?![^\[]*\])", annotation) if part != "None"]
    for part in parts:
        if re.match(r"(Sequence|Iterable|Collection)\[(str|EntityName)", part):
            return Kind(list[str])
    for part, kind in KINDS.items():
        if part in parts:
            return kind
    if parts[0].startswith("Literal["):
        return Kind(Literal[tuple(ast.literal_eval(parts[0].removeprefix("Literal")))])
    if any(part in NUMBERS for part in parts):
        names = re.search(r"\w+(, ?\w+)+(?=\)|$)", shape)
        given = names[0].replace(" ", "").upper() if names else None
        count = len(given.split(",")) if given else None
        named = f" {given}" if given else ""
        return Kind(str, lambda text, option: numbers(text, option + named, count), given)
    return None


def numbers(text: str, option: str, count: int | None = None) -> tuple[float, ...]:
    """Return the finite numbers of a text; `count` of them, where it is given.

    >>> numbers("1,2.5,0", "--near X,Y,Z", 3)
    (1.0, 2.5, 0.0)
    """
    try:
        found = tuple(float(value) for value in text.split(","))
    except ValueError:
        found = ()
    if not found or count not in (None, len(found)) or not all(map(math.isfinite, found)):
        many = "" if count is None else f"{count} "
        raise ValueError(f"{option} takes {many}numbers with commas between them, not {text}")
    return found


def key_values(given: Iterable[str] | None, option: str) -> dict[str, Any]:
    """Return the values of ``KEY=VALUE`` by key; a value is JSON where it is valid, else text.

    >>> key_values(["colour=red", "legs=4"], "--where")
    {'colour': 'red', 'legs': 4}
    """
    found: dict[str, Any] = {}
    for each in given or ():
        key, equals, value = each.partition("=")
        if not equals or not key:
            raise ValueError(f"{option} takes KEY=VALUE, not {each}")
        try:
            found[key] = json.loads(value)
        except ValueError:
            found[key] = value
    return found


def pairs(given: Iterable[str], option: str) -> dict[str, str]:
    """Return the texts of ``NAME=TEXT`` by name.

    >>> pairs(["hand=gripper1"], "--gripper")
    {'hand': 'gripper1'}
    """
    found: dict[str, str] = {}
    for each in given:
        name, equals, text = each.partition("=")
        if not equals or not name:
            raise ValueError(f"{option} takes NAME=TEXT, not {each}")
        if name in found:
            raise ValueError(f"{option} has {name} twice")
        found[name] = text
    return found


def points(given: Iterable[str], option: str) -> dict[str, tuple[float, ...]]:
    """Return the points of ``NAME=X,Y,Z`` by name."""
    return {name: numbers(text, option, 3) for name, text in pairs(given, option).items()}


def detections(given: Iterable[str], option: str) -> list[Detection]:
    """Return the detections of ``TYPE=X,Y,Z`` or ``TYPE=X,Y,Z,W,D,H``, metres."""
    from semmap.belief.identify import Detection

    found = []
    for text in given:
        type_, _, values = text.partition("=")
        count = 6 if values.count(",") > 2 else 3
        x, y, z, *sides = numbers(values, f"{option} TYPE=X,Y,Z[,W,D,H]: {text!r}", count)
        found.append(Detection(type_, (x, y, z), (sides[0], sides[1], sides[2]) if sides else None))
    return found


def file_or_name(text: str, option: str) -> str | Path:
    """Return the path of a file that is there; another text is a name."""
    return Path(text) if Path(text).is_file() else text


def near(text: str, option: str) -> str | tuple[float, ...]:
    """Return the point of ``X,Y,Z``, metres; a text without commas is a name."""
    return numbers(text, option, 3) if "," in text else text


def moment(text: str, option: str) -> datetime:
    """Return the time of a text in ISO 8601 in the local zone, which is also that of the text."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{option} takes an ISO 8601 time (2026-01-31T10:00), not {text}"
        ) from None
    return found.astimezone()


def joints(text: str, option: str) -> dict[str, float]:
    """Return the positions of joints in JSON by name."""
    try:
        return {name: float(value) for name, value in json.loads(text).items()}
    except (ValueError, AttributeError, TypeError):
        raise ValueError(
            f'{option} takes JSON, {{"joint": 0.5}}, with a number for each joint, not {text}'
        ) from None


def corners(text: str, option: str) -> list[tuple[float, ...]]:
    """Return the corners of ``x,y x,y x,y ...``."""
    try:
        found = [tuple(float(v) for v in corner.split(",")) for corner in text.split()]
    except ValueError:
        found = []
    if any(len(corner) != 2 for corner in found) or not found:
        raise ValueError(f'{option} takes points, "x,y x,y x,y", not {text}')
    return found


def place(text: str, option: str) -> str | tuple[float, ...]:
    """Return the point of ``X,Y`` or ``X,Y,Z``, metres; other texts are names."""
    try:
        point = numbers(text, option)
    except ValueError:
        return text
    return point if len(point) in (2, 3) else text


KINDS = {
    "bool": Kind(bool),
    "LocationLike": Kind(str, place),
    "Near": Kind(str, near),
    "RobotLike": Kind(str, file_or_name),
    "EntityName": Kind(str),
    "str": Kind(str),
    "int": Kind(int),
    "float": Kind(float),
    "Positive": Kind(float),
    "datetime": Kind(str, moment, "TIME"),
    "Mapping[str, str]": Kind(list[str], pairs),
    "Mapping[str, float]": Kind(str, joints),
    "Mapping[str, Sequence[float]]": Kind(list[str], points),
    "Sequence[Detection]": Kind(list[str], detections),
    "Mapping[str, Any]": Kind(list[str], key_values),
    "Properties": Kind(list[str], key_values),
    "Sequence[Sequence[float]]": Kind(str, corners),
}
"""What an option reads for an argument, by a part of its annotation; the first that it has."""

NUMBERS = {"Sequence[float]", "tuple[float, float]", "Bounds"}
"""Annotations of numbers with commas between them."""

_SAME = (
    "format= gripper= kept= max_step= pddl= perspectives=True resume=True robot= rooms= storey= "
    "strict=True version= world= write=True"
)
OPTIONS = {
    "drawn=True": "--graph",
    "fields=()": "--no-fields",
    "posture=": "--state",
    "source=": "--source ",
    "start=": "--from",
    "voxel_size=": "--from-voxels",
    **{each: f"--{each.partition('=')[0].replace('_', '-')}" for each in _SAME.split()},
}
"""The options of commands for arguments of the API, as its errors name them."""

_ARGUMENT = re.compile("|".join(rf"\b{re.escape(argument)}" for argument in OPTIONS))


def with_options(message: str) -> str:
    """Return an error of the API in the words of a command.

    >>> with_options("the map has no robot: give its start by start=")
    'the map has no robot: give its start by --from'
    """
    return _ARGUMENT.sub(lambda found: OPTIONS[found[0]], message)


def json_value(text: str, where: str) -> Any:
    """Return the value of a text in JSON; the message of a ValueError begins with `where`."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where}: is not valid JSON: {error}") from error
