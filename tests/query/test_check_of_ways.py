"""`Map.check` on doors side by side, doors of one direction, low rooms, and people in the air."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import combinations

import networkx as nx
import pytest
import shapely

import semmap

LONG = 6.0


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def found(here: semmap.Map, kind: str) -> set[tuple[str, ...]]:
    return {finding.entities for finding in here.check() if finding.kind == kind}


@pytest.mark.parametrize("seed", range(4))
def test_doors_overlap_where_shapely_says_so(db: semmap.Database, seed: int) -> None:
    chance = random.Random(seed)
    here = db.create_map("portes")
    here.add_room("salle", shapely.box(0, 0, 20, 4), floor=0, ceiling=3)
    here.add_room("cour", shapely.box(0, 4.1, 20, 8), floor=0, ceiling=3)
    lines = {}
    for number in range(6):
        x, wide = chance.uniform(0, 18), chance.uniform(0.7, 1.5)
        lines[f"p{number}"] = shapely.LineString([(x, 4.05), (x + wide, 4.05)])
        here.add_door(f"p{number}", "salle", "cour", [*lines[f"p{number}"].coords])
    x, _ = lines["p0"].coords[1]
    lines["battant"] = shapely.LineString([(x, 4.05), (x + 0.9, 4.05)])
    here.add_door("battant", "salle", "cour", [*lines["battant"].coords])
    expected = {
        tuple(sorted(pair))
        for pair in combinations(lines, 2)
        if lines[pair[0]].intersection(lines[pair[1]]).length > 0.1
    }
    at_one_point = found(here, "doors at one point")
    assert found(here, "overlapping doors") | at_one_point == expected


@pytest.mark.parametrize("seed", [0, 2, 4, 5, 6, 7])  # of which one circle is the largest
def test_rooms_of_one_way_are_those_of_the_graph(db: semmap.Database, seed: int) -> None:
    chance = random.Random(seed)
    here, ways = db.create_map("Einbahn"), nx.DiGraph()
    for n in range(6):
        x = LONG * n
        here.add_room(f"r{n}", shapely.box(x, 0, x + LONG - 0.1, 4), floor=0, ceiling=3)
        here.add_room(f"o{n}", shapely.box(x, 4.1, x + LONG - 0.1, 8), floor=0, ceiling=3)
        ways.add_nodes_from([f"r{n}", f"o{n}"])
    for n in range(6):
        doors = [(f"r{n}", f"o{n}", ((LONG * n + 2, 4.05), (LONG * n + 3, 4.05)))]
        if n:
            line = ((LONG * n - 0.05, 1), (LONG * n - 0.05, 2))
            doors.append((f"r{n - 1}", f"r{n}", line))
        for a, b, line in doors:
            direction = chance.choice(["both", "both", "forward", "backward"])
            here.add_door(f"{a} {b}", a, b, line, direction=direction)
            ways.add_edges_from([(a, b)] if direction != "backward" else [])
            ways.add_edges_from([(b, a)] if direction != "forward" else [])
    circles = sorted(nx.strongly_connected_components(ways), key=len)
    main = next(iter(circles[-1]))
    inside = nx.descendants(ways, main) & nx.ancestors(ways, main) | {main}
    assert found(here, "one-way room") == {(name,) for name in set(ways) - inside}


@pytest.mark.parametrize(("height", "low"), [(0.4, True), (1.4, True), (1.9, False), (3.0, False)])
def test_low_rooms_and_doors_are_named(db: semmap.Database, height: float, low: bool) -> None:
    here = db.create_map("altura")
    here.add_room("a", shapely.box(0, 0, 4, 4), floor=1, ceiling=1 + height)
    here.add_room("b", shapely.box(4.1, 0, 8, 4), floor=1, ceiling=4)
    here.add_door("d", "a", "b", ((4.05, 1), (4.05, 2)), height=1)
    here.execute("UPDATE connector SET height = %s", height)
    low_door = {("d",)} if height < 0.9 else set()
    assert found(here, "improbable height") == ({("a",)} if low else set()) | low_door


def test_a_person_stands_on_a_floor_a_thing_or_stairs(db: semmap.Database) -> None:
    here = db.create_map("gente")
    here.add_storey("bajo", elevation=0)
    here.add_storey("alto", elevation=3)
    here.add_room("a", shapely.box(0, 0, 9, 4), floor=0, ceiling=2.8)
    here.add_room("b", shapely.box(0, 6, 9, 9), floor=3, ceiling=5.8)
    here.add_door("escalera", "a", "b", ((8, 3.5), (8, 6.5)), form="stairs", height=0)
    here.add_object("mesa", size=(1, 1, 0.7), pose=(2, 2, 0, 0))
    size = (0.4, 0.4, 1.7)
    for name, pose in {
        "de pie": (4, 2, 0),
        "sobre la mesa": (2, 2, 0.7),
        "en la escalera": (8, 5, 1.5),
        "en el aire": (5.5, 2, 1.0),
    }.items():
        here.add_agent(name, type="person", size=size, pose=pose)
    assert found(here, "agent in the air") == {("en el aire",)}


@pytest.mark.parametrize(("high", "over"), [(2.5, False), (2.55, False), (2.7, True), (3.4, True)])
def test_furniture_is_no_higher_than_its_room(db: semmap.Database, high: float, over: bool) -> None:
    here = db.create_map("Schrank")
    here.add_room("Flur", shapely.box(0, 0, 4, 4), floor=0, ceiling=2.5)
    here.add_object("Schrank", type="wardrobe", size=(0.6, 1, high), pose=(2, 2, 0, 0))
    assert found(here, "through a ceiling") == ({("Schrank", "Flur")} if over else set())
