"""The names of the three packages: one meaning each."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_no_two_public_classes_have_one_name() -> None:
    modules = defaultdict(list)
    for package in ("semmap", "navgrid", "planner"):
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.parse(file.read_text()).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    modules[node.name].append(str(file.relative_to(ROOT)))
    assert len(modules) > 300
    assert {name: files for name, files in modules.items() if len(files) > 1} == {}


def test_no_module_imports_a_private_name_of_another() -> None:
    private = []
    for top in ("semmap", "navgrid", "planner", "tests", "benchmarks", "examples"):
        for file in sorted((ROOT / top).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.ImportFrom):
                    private += [
                        (str(file.relative_to(ROOT)), each.name)
                        for each in node.names
                        if each.name.startswith("_") and not each.name.startswith("__")
                    ]
    assert private == []
