"""What arguments may be: all words of the annotations are known, and take what they say."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from semmap.api.checked import FORMS, WRONG, form_of
from semmap.api.database import Database
from semmap.api.entity_collection import EntityCollection
from semmap.api.map import Map
from semmap.api.map_entity import Door
from semmap.api.spatial_fields import SpatialFields

ROOT = Path(__file__).parents[2]
FACE = (Database, Map, Door, EntityCollection, SpatialFields)
OTHERS = {"Trimesh", "Event"}
"""Classes of other packages that arguments may be instances of."""


def annotated() -> Iterator[tuple[str, str]]:
    """Each public method with each annotation of its arguments."""
    for owner in FACE:
        for name, function in inspect.getmembers(owner, inspect.isfunction):
            if not name.startswith("_"):
                for key, text in inspect.unwrap(function).__annotations__.items():
                    if key != "return":
                        yield f"{owner.__name__}.{name}", text


def words(node: ast.expr) -> Iterator[str]:
    """The names that an annotation asks a value for."""
    if isinstance(node, ast.BinOp):
        yield from words(node.left)
        yield from words(node.right)
    elif isinstance(node, ast.Name | ast.Attribute):
        yield node.id if isinstance(node, ast.Name) else node.attr


def test_the_words_of_annotations_are_forms_or_classes() -> None:
    classes = {
        node.name
        for package in ("semmap", "navgrid", "planner")
        for file in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ClassDef)
    }
    found = [
        (name, word)
        for name, text in annotated()
        for word in words(ast.parse(text, mode="eval").body)
    ]
    assert len(found) > 300
    assert [(n, word) for n, word in found if word not in {*FORMS, *classes, *OTHERS}] == []


TAKEN: list[tuple[str, Any, Any]] = [
    ("float", 1, 1),
    ("float", Decimal("1.5"), Decimal("1.5")),
    ("float", np.float32(2), np.float32(2)),
    ("float", True, WRONG),
    ("float", "1", WRONG),
    ("Finite", np.inf, WRONG),
    ("Finite", 10**400, WRONG),
    ("Positive | None", 0, WRONG),
    ("Positive | None", None, None),
    ("int", np.int64(3), np.int64(3)),
    ("int", 3.0, WRONG),
    ("datetime | None", datetime(2026, 1, 1, tzinfo=UTC), datetime(2026, 1, 1, tzinfo=UTC)),
    ("datetime | None", "2026", WRONG),
    ("Sequence[str]", "kitchen", ("kitchen",)),
    ("Sequence[str]", ["a", "b"], ("a", "b")),
    ("Sequence[str]", ["a", 5], WRONG),
    ("Sequence[EntityName] | None", 5, WRONG),
    ("Sequence[float]", (1, "a"), (1, "a")),  # the method says how many, and what they are
    ("Sequence[float]", 5, WRONG),
    ("tuple[float, float]", [1, 2], (1, 2)),
    ("tuple[float, float]", (1, 2, 3), WRONG),
    ("LocationLike", (1, 2), (1, 2)),
    ("LocationLike", (1, np.nan), WRONG),
    ("Literal['a', 'b']", "c", WRONG),
    ("str | Path", Path("x"), Path("x")),
    ("str | Path", 5, WRONG),
    ("Properties", {"a": np.nan}, WRONG),
    ("Properties", [1], WRONG),
    ("Callable[[int], str] | None", print, print),
    ("Callable[[int], str] | None", "print", WRONG),
]


@pytest.mark.parametrize(("annotation", "value", "taken"), TAKEN)
def test_a_form_takes_its_values_only(annotation: str, value: Any, taken: Any) -> None:
    form = form_of(annotation)
    assert form is not None
    assert form.take(value) is taken if taken is WRONG else form.take(value) == taken


@pytest.mark.parametrize("owner", [Map, EntityCollection, SpatialFields])
def test_a_wrong_argument_names_the_public_method(owner: type) -> None:
    named = {n: f for n, f in inspect.getmembers(owner, inspect.isfunction) if n[0] != "_"}
    for name, function in named.items():
        if inspect.isgeneratorfunction(inspect.unwrap(function)):
            continue  # a context manager is not `checked`
        with pytest.raises(TypeError, match=rf"^{owner.__name__}\.{name}\(\) "):
            function(no_such_argument=1)
