"""Searches of a map: one statement, names and patterns, what stands on something."""

from __future__ import annotations

import fnmatch
from typing import Any

import pytest
import shapely

import semmap
from tests.api.round_trips import round_trips

FOUND: list[dict[str, Any]] = [
    {},
    {"type": "furniture"},
    {"in_": "kitchen"},
    {"near": "mug7", "within": 1},
    {"near": (1, 1, 1)},
    {"on": "desk4"},
    {"name": "mug*", "limit": 1},
    {"type": "object", "in_": "kitchen", "near": "desk4", "within": 2, "on": "desk4"},
]


@pytest.mark.parametrize("given", FOUND, ids=str)
def test_find_is_one_statement(flat: semmap.Map, given: dict[str, Any]) -> None:
    assert flat.connection.info.dbname
    with round_trips(flat.connection) as counted:
        found = flat.find(**given)
    assert found
    assert counted == [1]


def test_names_are_exact_or_patterns(flat: semmap.Map) -> None:
    for name in ("mug1", "mug_1", "mug%", "mugs", "a\\b", "MUG2"):
        flat.add_object(name, size=(0.1, 0.1, 0.1), pose=(1, 1, 0))
    everything = [entity.name for entity in flat]
    for pattern in ("mug?", "mug*", "*", "m?g_*", "*%", "a\\*", "*l*", "?", "mug1"):
        found = {entity.name for entity in flat.find(name=pattern)}
        # a backslash and brackets mean nothing else, here as there
        assert found == {n for n in everything if fnmatch.fnmatchcase(n, pattern)}
    assert [e.name for e in flat.find(name="mug_1")] == ["mug_1"]
    assert [e.name for e in flat.find(name="mug%")] == ["mug%"]
    assert flat.find(name="nothing") == []


def test_on_is_what_stands_on_it(flat: semmap.Map) -> None:
    flat.add_object("tray", size=(0.4, 0.3, 0.02), on="desk4")
    flat.add_object("muffin", size=(0.05, 0.05, 0.05), on="tray")
    assert [e.name for e in flat.find(on="desk4")] == ["mug7", "tray"]
    assert [e.name for e in flat.find(on="tray")] == ["muffin"]
    assert [e.name for e in flat.find("mug", on="desk4")] == ["mug7"]
    assert flat.find(on="kitchen") == [], "it stands in it"


def test_limit_takes_the_first(flat: semmap.Map) -> None:
    whole = flat.find(near=(7, 1, 1))
    assert flat.find(near=(7, 1, 1), limit=2) == whole[:2]
    assert flat.find(limit=0) == []
    with pytest.raises(ValueError, match="limit takes a number from 0 on, not -1"):
        flat.find(limit=-1)


def test_what_is_not_there_is_named(flat: semmap.Map) -> None:
    for given, message in (
        ({"in_": "kichen"}, "no entity kichen; did you mean kitchen"),
        ({"on": "desk"}, "no entity desk; did you mean desk4"),
        ({"near": "mug"}, "no entity mug; did you mean mug7"),
        ({"type": "mugg", "near": "mug7"}, "no type mugg; did you mean mug"),
    ):
        with pytest.raises(LookupError, match=message):
            flat.find(**given)
    flat.add_object("bare")
    with pytest.raises(ValueError, match="bare has no placement: give a point"):
        flat.find(near="bare")
    assert "bare" in {e.name for e in flat.find(near=(0, 0, 0))}, "the last ones"


def test_near_orders_by_shapelys_distance(flat: semmap.Map) -> None:
    for number, x in enumerate((0.5, 1.5, 2.5, 3.5)):
        flat.add_object(f"post{number}", size=(0.1, 0.1, 2), pose=(x, 2.7, 0, 0.3 * number))
    point = (2.2, 2.5, 1)
    rows = {e: e.footprint.distance(shapely.Point(point[:2])) for e in flat.find(name="post*")}
    assert flat.find(name="post*", near=point) == sorted(rows, key=rows.__getitem__)
