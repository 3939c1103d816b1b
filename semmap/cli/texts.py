"""Texts of options as values: numbers with commas between them, KEY=VALUE, and JSON."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from typing import Any


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


OPTIONS = {
    "drawn=True": "--graph",
    "fields=()": "--no-fields",
    "format=": "--format",
    "gripper=": "--gripper",
    "kept=": "--kept",
    "max_step=": "--max-step",
    "pddl=": "--pddl",
    "perspectives=True": "--perspectives",
    "posture=": "--state",
    "rooms=": "--rooms",
    "source=": "--source ",
    "start=": "--from",
    "storey=": "--storey",
    "strict=True": "--strict",
    "version=": "--version",
    "voxel_size=": "--from-voxels",
    "world=": "--world",
    "write=True": "--write",
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
