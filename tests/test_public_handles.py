"""No public function takes an engine, a connection, a session or the name of a map.

Public are the names that the packages list in `__all__`, with the methods of their classes.
`semmap.connect` opens a database, `Database.map` a map; all else is a method of them, or takes one.
`semmap.database` and `semmap.model`, the SQL and ORM below, are for those who bring an engine.

Below, what reads a map takes a `Snapshot` of it: no function that does takes a connection.
"""

from __future__ import annotations

import ast
import inspect
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import navgrid
import planner
import semmap

HANDLES = re.compile(r"\b(Engine|Connection|Session|Cursor)\b")
NAMES = {"map_name", "engine", "connection", "session"}
BELOW = ("semmap.database", "semmap.model")

READERS = ("navgrid", "planner", "semmap/belief", "semmap/draw", "semmap/fields", "semmap/query")
READERS += ("semmap/manipulation", "semmap/cli/demo")

WITH_CONNECTION = {
    "planner/readers/robot_class.py store_robot_class": "a class of robots is of no map",
    "planner/readers/robot_class.py delete_robot_class": "a class of robots is of no map",
    "planner/readers/robot_class.py _names": "what delete_robot_class says",
    "planner/readers/robot_class.py _no_class": "what delete_robot_class says",
    "semmap/fields/store/field_store.py save": "writes a field",
    "semmap/fields/store/field_store.py prune": "deletes versions of a field",
    "semmap/fields/store/field_store.py forget": "deletes a field",
    "semmap/fields/store/field_store.py _field_to_change": "for save",
    "semmap/fields/store/field_store.py _field": "for prune and forget, too",
    "semmap/fields/store/field_store.py _names": "what prune and forget say, too",
    "semmap/fields/store/map_store.py save_map": "writes a field",
    "semmap/fields/store/source_history.py save": "writes fields",
    "semmap/fields/store/source_history.py _save_map": "writes a field",
    "semmap/fields/store/mirror_state.py origin": "asks which server it is",
    "semmap/fields/store/run_statement.py run": "runs any statement",
    "semmap/query/snapshot.py of": "makes a snapshot of it",
    "semmap/query/sql_statement.py run_sql": "runs a user's statement",
}
"""Functions of the readers' packages that take a connection, and why."""

WITH_SESSION = {
    "planner/mission/grasp_choice.py": {"hand_of"},
    "semmap/fields/service/client.py": {"url_of"},
    "semmap/fields/service/replies.py": {"update_map"},
    "semmap/interlinking/reader.py": {"read_object_models"},
    "semmap/manipulation/automata.py": {
        *(
            "automaton_of",
            "class_automaton",
            "class_gripper",
            "class_urdf",
            "register_robot",
            "stored_arm",
        ),
    },
    "semmap/manipulation/household_objects.py": {"import_household_grasps"},
    "semmap/manipulation/ranking.py": {"evidence_on", "moved_alike", "ranked"},
    "semmap/manipulation/reader.py": {
        *("actions_by_shape", "function_named", "read_shape"),
        *("list_automata", "list_contributors", "list_grippers"),
    },
    "semmap/manipulation/retrieval.py": {
        *("gripper_name", "gripper_or_urdf", "is_default", "register_gripper"),
        *("stored_gripper", "stored_usual", "usual_gripper", "usual_name"),
    },
    "semmap/manipulation/unknown_objects.py": {"grasps_in_cloud", "grasps_of_shape"},
    "semmap/query/entity_query.py": {"changes_since", "entity_id", "list_maps"},
    "semmap/query/meshes.py": {
        *("model_triangles", "models_points", "models_triangles", "world_triangles"),
    },
    "semmap/query/snapshot.py": {"open_snapshot"},
    "semmap/query/sql_statement.py": {"is_superuser", "run_sql"},
}
"""What takes a session of psycopg, beside what stores: it is about what belongs to no map.

Those are grippers, robots, models of objects and their grasps, all maps together, and a user's
statement. An entity's name also becomes its id for what stores.
"""

MISSIONS = "planner/mission/store/"
"""Reads and writes missions, their steps and claims, in the transaction of its caller."""


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


def with_session(file: Path) -> set[str]:
    """The public functions of a file that take a session of psycopg."""
    return {
        node.name
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
        if each.arg == "session" or "psycopg.Connection" in ast.unparse(each.annotation or each)
    }


def with_connection(file: Path) -> Iterator[str]:
    """The functions of a file that take a connection of SQLAlchemy, or one of unknown type."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs):
                given = "" if each.annotation is None else ast.unparse(each.annotation)
                plain = re.search(r"(?<!psycopg\.)\bConnection\b", given) is not None
                if plain or (each.arg == "connection" and given == "Any"):
                    yield node.name


def test_what_reads_a_map_takes_a_snapshot() -> None:
    root = Path(semmap.__file__).parents[1]
    found = {
        f"{file.relative_to(root).as_posix()} {name}"
        for package in READERS
        for file in (root / package).rglob("*.py")
        for name in with_connection(file)
    }
    assert {each for each in found if not each.startswith(MISSIONS)} == {*WITH_CONNECTION}


def test_a_session_is_for_what_belongs_to_no_map() -> None:
    root = Path(semmap.__file__).parents[1]
    found = {
        file.relative_to(root).as_posix(): names
        for package in (*READERS, "semmap/interlinking")
        for file in (root / package).rglob("*.py")
        if "store" not in {*file.parts, file.stem} and (names := with_session(file))
    }
    assert found == WITH_SESSION
