"""No public function takes an engine, a connection, a session or the name of a map.

Public are the names that the packages list in `__all__`, with the methods of their classes.
`semmap.connect` opens a database, `Database.map` a map; all else is a method of them, or takes one.
`semmap.database` and `semmap.model`, the SQL and ORM below, are for those who bring an engine.
"""

from __future__ import annotations

import inspect
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any

import pytest

import navgrid
import planner
import semmap

HANDLES = re.compile(r"\b(Engine|Connection|Session|Cursor)\b")
NAMES = {"map_name", "engine", "connection", "session"}
BELOW = ("semmap.database", "semmap.model")


def packages() -> list[str]:
    """The packages with a list of public names."""
    found = []
    for top in (semmap, navgrid, planner):
        below = pkgutil.walk_packages(top.__path__, f"{top.__name__}.")
        found += [top.__name__, *(each.name for each in below if each.ispkg)]
    public = [name for name in found if not name.startswith(BELOW)]
    return [name for name in public if getattr(import_module(name), "__all__", None)]


def functions(package: str) -> Iterator[tuple[str, Any]]:
    """Each public function of a package, and each public method of its classes."""
    module = import_module(package)
    for name in module.__all__:
        member = getattr(module, name)
        if inspect.isclass(member):
            for method, function in inspect.getmembers(member, inspect.isfunction):
                if method == "__init__" or not method.startswith("_"):
                    yield f"{package}.{name}.{method}", function
        elif inspect.isfunction(member):
            yield f"{package}.{name}", member


def owner(name: str) -> str:
    """The class of a method."""
    return name.rsplit(".", 2)[1]


@pytest.mark.parametrize("package", packages())
def test_no_public_function_takes_a_handle_of_the_database(package: str) -> None:
    module, taken = import_module(package), []
    for name, function in functions(package):
        try:
            parameters = inspect.signature(function).parameters.values()
        except ValueError:  # of C, without a signature
            continue
        plain = name.endswith(".__init__") and is_dataclass(getattr(module, owner(name)))
        taken += [
            f"{name}({each})"
            for each in parameters
            if HANDLES.search(str(each.annotation)) or (each.name in NAMES and not plain)
        ]
    assert taken == []


def test_the_test_looks_at_the_face() -> None:
    names = {name for package in ("semmap", "planner") for name, _ in functions(package)}
    assert {"semmap.connect", "semmap.Map.route", "planner.plan_task"} <= names
