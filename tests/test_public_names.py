"""The names of the packages: one meaning each."""

from __future__ import annotations

import ast
import pkgutil
from collections import defaultdict
from importlib import import_module
from pathlib import Path

from semmap.error import Error

ROOT = Path(__file__).parents[1]


def test_no_two_public_classes_have_one_name() -> None:
    modules = defaultdict(list)
    for package in ("semmap", "navgrid", "planner", "ros/semmap_ros/semmap_ros"):
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.parse(file.read_text()).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    modules[node.name].append(str(file.relative_to(ROOT)))
    assert len(modules) > 300
    assert {name: files for name, files in modules.items() if len(files) > 1} == {}


def test_a_name_of_modules_means_one_thing() -> None:
    tops = ("semmap", "navgrid", "planner", "ros")
    files = [f for top in tops for f in (ROOT / top).rglob("*.py")]
    vague = {"shapes", "statements", "helpers", "utils", "common"}
    assert [file for file in files if file.stem in vague] == []
    readers = [file for file in files if file.stem == "reader"]
    assert len(readers) > 5
    assert [file for file in readers if "seen: Snapshot" not in file.read_text()] == []


def test_no_module_imports_a_private_name_of_another() -> None:
    private = []
    for top in ("semmap", "navgrid", "planner", "ros", "tests", "benchmarks", "examples"):
        for file in sorted((ROOT / top).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.ImportFrom):
                    private += [
                        (str(file.relative_to(ROOT)), each.name)
                        for each in node.names
                        if each.name.startswith("_") and not each.name.startswith("__")
                    ]
    assert private == []


def test_errors_have_one_base() -> None:
    others = []
    for package in ("semmap", "navgrid", "planner"):
        for each in pkgutil.walk_packages(import_module(package).__path__, f"{package}."):
            for name, member in vars(import_module(each.name)).items():
                own = isinstance(member, type) and member.__module__ == each.name
                known = name in SIGNALS or name.startswith("_") or not own
                if not known and issubclass(member, Exception) and not issubclass(member, Error):
                    others.append(f"{each.name}.{name}")
    assert others == []


SIGNALS = {
    "EndOfPercepts",
    "NotWrittenError",
    "ProcessEnded",
    "PrunedError",
    "Refused",
    "RelationsToKeep",
    "ServerError",
    "UntranslatedError",
    "UnsettledError",
    "Unusable",
    "WholeError",
}
"""Exceptions between modules, which no user of a map sees."""
