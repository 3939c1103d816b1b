"""The packages know no place and no name of the example: the demo finds all in the world."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely

from semmap.ingest.annotation.annotation import read_annotation
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import Entry
from tests.office import OFFICE_FILES

ROOT = Path(__file__).parents[3]
PACKAGES = ("semmap", "navgrid", "planner")
READERS = {".geojson": read_annotation, ".sdf": read_sdf}


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    """All that the example has."""
    return [entry for file in OFFICE_FILES for entry in READERS[file.suffix](file).entries]


def places(entry: Entry) -> Iterator[tuple[float, float]]:
    """Its position, and the corners of its outlines, in the map's frame."""
    if entry.pose is not None and entry.holder is None:
        yield entry.pose.x, entry.pose.y
    for shape in entry.shapes:
        if shape.outline is not None:
            yield from map(tuple, shapely.get_coordinates(shape.outline).tolist())


def literals(package: str) -> Iterator[tuple[str, ast.AST]]:
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            yield f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}", node


def numbers(node: ast.AST) -> tuple[float, ...]:
    """The numbers of a tuple, list or call that has nothing else in front."""
    parts = node.args if isinstance(node, ast.Call) else getattr(node, "elts", [])
    found = []
    for part in parts:
        try:
            value = ast.literal_eval(part)
        except ValueError:
            break
        if not isinstance(value, int | float) or isinstance(value, bool):
            break
        found.append(float(value))
    return tuple(found)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_coordinate_of_the_example(entries: list[Entry], package: str) -> None:
    known = {(round(x, 3), round(y, 3)) for e in entries for x, y in places(e)}
    known = {(x, y) for x, y in known if not (x.is_integer() and y.is_integer())}
    assert len(known) > 20
    found = [
        (where, values)
        for where, node in literals(package)
        if len(values := numbers(node)) >= 2 and values[:2] in known
    ]
    assert not found


def test_no_name_of_the_example_in_the_demo(entries: list[Entry]) -> None:
    names = {e.name for e in entries if re.search(r"\d", e.name)}
    assert {"desk4", "office4", "muffin1"} <= names
    found = [
        (where, node.value)
        for where, node in literals("semmap/cli/demo")
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and names & set(re.findall(r"[\w-]+", node.value))
    ]
    assert not found
