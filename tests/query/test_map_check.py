"""`Map.check` on random buildings with planted faults, and on real worlds."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from sqlalchemy import URL

import semmap
from planner.robot_class import RobotClass
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.query.map_check.rules import Finding
from semmap.robot import Part
from tests.conftest import Import, MakeDatabase
from tests.geometry.test_overlay import BESIDE
from tests.navgrid.scenes import BASE
from tests.query.planted_faults import FAULTS, NAMES, Fault, sound_building


@pytest.fixture
def db(database: str) -> Iterator[semmap.Database]:
    with semmap.connect(database) as found:
        yield found


def seen(here: semmap.Map) -> set[tuple[str, frozenset[str]]]:
    return {(each.kind, frozenset(each.entities)) for each in here.check()}


def done(here: semmap.Map, finding: Finding) -> bool:
    """Does as a fix says; whether that call removes the finding, and makes no other."""
    before = seen(here)
    exec(finding.fix, {"map": here})
    return seen(here) <= before - {(finding.kind, frozenset(finding.entities))}


def test_sound_buildings_have_no_findings(db: semmap.Database) -> None:
    for seed in range(6):
        here = sound_building(db, seed)
        assert here.check() == []
        pose = here["d01"].pose
        assert pose is not None
        leaf = box_mesh((-0.02, -0.49, 0), (0.02, 0.49, 2))
        here.add_object("qxz", type="door_leaf", mesh=leaf, pose=(pose.x, pose.y, 0))
        (found,) = here.check()
        assert (found.kind, found.entities) == ("shut leaf of an open door", ("d01", "qxz"))
        assert done(here, found)


FAULTY = range(10, 13)
"""The seeds of the buildings in which faults are planted."""


@pytest.fixture(scope="module")
def sound(make_database: MakeDatabase) -> URL:
    """A database with sound buildings."""
    url = make_database()
    with semmap.connect(url.render_as_string(hide_password=False)) as db:
        for seed in FAULTY:
            sound_building(db, seed)
    return url


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_fault_is_the_only_finding(
    sound: URL, make_database: MakeDatabase, drop_database: Callable[[URL], None], fault: Fault
) -> None:
    url = make_database(sound)
    with semmap.connect(url.render_as_string(hide_password=False)) as db:
        for seed in FAULTY:
            _is_the_only_finding(db.map(f"b{seed}"), fault, random.Random(seed))
    drop_database(url)


def _is_the_only_finding(here: semmap.Map, fault: Fault, draw: random.Random) -> None:
    kind, names = fault(here, draw)
    assert seen(here) == {(kind, frozenset(names))}
    (found,) = here.check()
    if found.safe:
        assert here.fix([found]) == 1
        assert here.check() == []
    elif not found.fix.startswith("by hand"):
        assert done(here, found)


def test_books_in_a_row_and_plates_in_a_stack_are_no_twins(db: semmap.Database) -> None:
    here = db.create_map("shelf")
    here.add_room("r", [(0, 0), (4, 0), (4, 4), (0, 4)], floor=0, ceiling=2.5)
    for number in range(3):
        mesh = box_mesh((0, 0, 0), (0.03, 0.2, 0.25))
        here.add_object(f"b{number}", mesh=mesh, pose=(1 + 0.03 * number, 1, 0))
        plate = box_mesh((-0.1, -0.1, 0), (0.1, 0.1, 0.003))
        here.add_object(f"p{number}", mesh=plate, pose=(2, 1, 0.01 + 0.004 * number))
    assert "things at one point" not in {kind for kind, _ in seen(here)}
    here.add_object("b", mesh=mesh, pose=(1.02, 1, 0))
    twins = {names for kind, names in seen(here) if kind == "things at one point"}
    assert any("b" in names for names in twins)


def stool(draw: random.Random) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """The boxes of a table or stool: four legs and a plate."""
    x, y, z = draw.uniform(0.2, 1), draw.uniform(0.2, 0.6), draw.uniform(0.4, 1)
    legs = [((u, v, 0), (u + 0.04, v + 0.04, z)) for u in (-x, x - 0.04) for v in (-y, y - 0.04)]
    return [*legs, ((-x, -y, z), (x, y, z + 0.03))]


def block(draw: random.Random, most: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    x, y, z = (draw.choice([0.01, 0.04, draw.uniform(0.02, most)]) for _ in range(3))
    return [((-x, -y, 0), (x, y, z))]


@pytest.mark.parametrize("seed", range(4))
def test_things_at_a_point_are_twins_where_they_share_their_space(
    db: semmap.Database, seed: int
) -> None:
    """Boxes of random sizes with a middle, of which their volumes say how much they share."""
    draw = random.Random(seed)
    here = db.create_map(f"twins{seed}")
    here.add_room("r", [(0, 0), (90, 0), (90, 4), (0, 4)], floor=0, ceiling=2.5)
    surely, maybe = set(), set()
    for number in range(20):
        kinds = [draw.choice([stool, lambda d: block(d, 0.1), lambda d: block(d, 0.9)])(draw)]
        kinds.append(block(draw, 0.3))
        names = frozenset(f"{letter}{number}" for letter in "ab")
        for name, boxes in zip(sorted(names), kinds, strict=True):
            mesh = join([box_mesh(*ends) for ends in boxes])  # type: ignore[arg-type]
            here.add_object(name, mesh=mesh, pose=(3 + 4 * number, 2, 0))
        volumes = [sum(_volume(*ends) for ends in boxes) for boxes in kinds]
        shared = [_shared(one, two) for one in kinds[0] for two in kinds[1]]
        part = sum(math.prod(extents) for extents in shared) / min(volumes)
        deep = max(extents[2] for extents in shared)
        for found, slack in ((surely, -0.03), (maybe, 0.03)):
            if part >= 0.5 - slack or (part >= 0.1 - slack and deep > 0.03 - slack / 10):
                found.add(("things at one point", names))
    found = {f for f in seen(here) if f[0] == "things at one point"}
    assert surely <= found <= maybe
    assert 0 < len(found) < 20


def _volume(low: tuple[float, ...], high: tuple[float, ...]) -> float:
    return math.prod(b - a for a, b in zip(low, high, strict=True))


def _shared(one: tuple[tuple[float, ...], ...], two: tuple[tuple[float, ...], ...]) -> list[float]:
    sides = zip(*one, *two, strict=True)
    return [max(0.0, min(b, d) - max(a, c)) for a, b, c, d in sides]


def test_things_above_one_another_are_not_at_one_point(db: semmap.Database) -> None:
    here = db.create_map("above")
    here.add_room("r", [(0, 0), (20, 0), (20, 4), (0, 4)], floor=0, ceiling=2.5)
    for number, (name, size) in enumerate(
        [("rug", (3, 2, 0.01)), ("mat", (0.4, 0.3, 0.02)), ("bucket", (0.2, 0.2, 0.3))]
    ):
        table = join([box_mesh(*ends) for ends in stool(random.Random(number))])  # type: ignore[arg-type]
        here.add_object(f"table{number}", mesh=table, pose=(3 + 5 * number, 2, 0))
        here.add_object(name, size=size, pose=(3 + 5 * number, 2, 0))
    here.add_object("tray", size=(0.4, 0.3, 0.02), pose=(18, 2, 0))
    here.add_object("can", size=(0.07, 0.07, 0.12), pose=(18, 2, 0))
    assert here.check() == []
    for name in ("cup", "mug"):  # on the rug, below the table, and no higher than a contact
        here.add_object(name, size=(0.06, 0.06, 0.03), pose=(3, 2, 0.01))
    assert seen(here) == {("things at one point", frozenset({"cup", "mug"}))}


def test_a_stack_of_trays_is_no_fault(db: semmap.Database) -> None:
    here = db.create_map("trays")
    here.add_room("r", [(0, 0), (4, 0), (4, 4), (0, 4)], floor=0, ceiling=2.5)
    for number in range(4):
        here.add_object(f"tray{number}", size=(0.4, 0.3, 0.008), pose=(2, 2, 0.008 * number))
    here.add_object("cupboard", type="cupboard", size=(1, 0.5, 1), pose=(1, 1, 0))
    here.add_object("box", size=(0.3, 0.3, 0.3), pose=(1, 1, 0.02))  # in a coarse model of it
    assert here.check() == []


def test_a_solid_inside_another_is_found_and_what_is_in_an_open_inside_is_not(
    db: semmap.Database,
) -> None:
    here = db.create_map("inside")
    here.add_room("r", [(0, 0), (9, 0), (9, 4), (0, 4)], floor=0, ceiling=2.5)
    boards = [
        box_mesh((0, 0, 0), (1, 0.6, 0.02)),
        box_mesh((0, 0, 0.98), (1, 0.6, 1)),
        *(box_mesh((x, 0, 0.02), (x + 0.02, 0.6, 0.98)) for x in (0, 0.98)),
        *(box_mesh((0.02, y, 0.02), (0.98, y + 0.02, 0.98)) for y in (0, 0.58)),
    ]
    here.add_object("thing", mesh=join(boards), pose=(1, 1, 0))  # shut on all sides
    here.add_object("mug in it", size=(0.1, 0.1, 0.1), pose=(1.5, 1.3, 0.02))
    here.add_object("stool", size=(0.4, 0.4, 0.5), pose=(4, 2, 0))
    here.add_object("mug", size=(0.1, 0.1, 0.1), pose=(4.1, 2, 0.02))
    here.add_object("block", size=(0.6, 0.6, 0.6), pose=(6, 2, 0))
    here.add_object("stated", size=(0.1, 0.1, 0.1), pose=(6, 2, 0.02))
    here.execute("SELECT put(%s, %s, 'in')", here["stated"].id, here["block"].id)
    (found,) = here.check()
    assert (found.kind, found.entities) == ("penetrating", ("mug", "stool"))
    assert done(here, found)


def test_what_hangs_within_a_solid_is_reported_once(db: semmap.Database) -> None:
    here = db.create_map("nested")
    here.add_room("r", [(0, 0), (9, 0), (9, 4), (0, 4)], floor=0, ceiling=2.5)
    here.add_object("block", size=(0.6, 0.6, 0.6), pose=(6, 2, 0))
    here.add_object("core", size=(0.2, 0.2, 0.2), pose=(6, 2, 0.2))
    assert seen(here) == {("penetrating", frozenset({"core", "block"}))}


@pytest.mark.parametrize("names", [("aa", "zz"), ("zz", "aa")])
def test_what_passes_a_door_is_said_of_all_that_is_in_it(
    db: semmap.Database, names: tuple[str, str]
) -> None:
    """A board at 0.7 m, and a box from the floor up to it: alone, either lets robots pass."""
    here = db.create_map("".join(names))
    for name, x in (("west", 0.0), ("east", 5.2)):
        here.add_room(name, [(x, 0), (x + 4.8, 0), (x + 4.8, 4), (x, 4)], floor=0, ceiling=2.7)
    here.add_door("gap", "west", "east", ((5.0, 1), (5.0, 2)))
    board, crate = names
    here.add_object(board, size=(0.1, 1.0, 0.9), pose=(5.0, 1.5, 0.7))
    here.add_object(crate, size=(0.1, 1.0, 0.7), pose=(5.0, 1.5, 0.0))
    (found,) = (each for each in here.check() if "gap" in each.entities)
    assert "no robot passes" in found.text


@pytest.mark.parametrize("storeys", [[], [0.0]])
def test_rooms_above_rooms_are_to_be_on_storeys(db: semmap.Database, storeys: list[float]) -> None:
    """Grids and costmaps say so, too; side by side, as on a split level, they may be."""
    here = db.create_map(f"tower{len(storeys)}")
    for z in storeys:
        here.add_storey("only", elevation=z)
    for number, (x, z) in enumerate([(0, 0.0), (0, 3.0), (6, 3.0)]):
        outline = [(x, 0), (x + 5, 0), (x + 5, 4), (x, 4)]
        here.add_room(f"r{number}", outline, floor=z, ceiling=z + 2.5)
    here.add_object("crate", size=(0.5, 0.5, 0.5), pose=(2, 2, 3.0))
    found = [each for each in here.check() if each.kind == "rooms without storeys"]
    assert [(each.severity, each.entities) for each in found] == [("warning", ("r0", "r1"))]
    assert "0, 3 m" in found[0].text
    said = "rooms lie one above the other at 0, 3 m"
    for (made,) in (here.grids(), here.costmaps([BASE], resolution=0.2)):
        assert any(note.startswith(said) for note in made.notes)
    here["r1"].delete()
    assert not any(each.kind == "rooms without storeys" for each in here.check())


def test_rooms_that_share_a_turned_edge_do_not_overlap(db: semmap.Database) -> None:
    here = db.create_map("beside")
    here.add_storey("s", elevation=0, height=3)
    a, b = (shapely.from_wkt(text) for text in BESIDE)
    for name, outline in (("a", a), ("b", b)):
        here.add_room(name, outline, floor=0, ceiling=2.5)
    assert "overlapping rooms" not in {found.kind for found in here.check()}
    row = here.execute(
        "SELECT ground_share(%s::geometry, %s::geometry), ground_share(%s::geometry, %s::geometry),"
        " sum(ST_Area(geom)) FROM gis_storey WHERE map = 'beside'",
        *(shape.wkb for shape in (a, b, b, a)),
    )
    assert list(row[0]) == pytest.approx([0, 0, a.area + b.area], abs=1e-4)


def test_proposed_doors_are_on_one_floor_and_in_a_common_wall(db: semmap.Database) -> None:
    here = db.create_map("doors")
    for level, names in enumerate(("ab", "cd")):
        z = 6.0 * level
        here.add_storey(f"s{level}", elevation=z, height=3.0)
        for k, name in enumerate(names):
            x = 4.1 * k if name != "d" else 40.0
            outline = [(x, 0), (x + 4, 0), (x + 4, 4), (x, 4)]
            here.add_room(name, outline, floor=z, ceiling=z + 2.5, storey=f"s{level}")
    fixes = {f.entities: f for f in here.check() if f.kind == "room without a door"}
    assert {names for names, f in fixes.items() if f.fix.startswith("by hand")} == {("c",), ("d",)}
    assert done(here, fixes["a",])
    assert seen(here) == {("room without a door", frozenset(n)) for n in "cd"}


def test_rooms_that_doors_join_with_each_other_alone(db: semmap.Database) -> None:
    here = db.create_map("apart")
    for k, name in enumerate("abcdef"):
        here.add_room(name, [(4 * k, 0), (4 * k + 3.8, 0), (4 * k + 3.8, 4), (4 * k, 4)], ceiling=3)
    for one, two in ("ab", "bc", "de"):
        x = 4 * "abcdef".index(two) - 0.1
        here.add_door(one + two, one, two, ((x, 1), (x, 2)))
    found = {f.entities: f for f in here.check() if f.kind == "room without a door"}
    assert set(found) == {("d", "e"), ("f",)}
    assert "doors join the rooms d, e with each other alone" in str(found["d", "e"])
    assert done(here, found["d", "e"])
    assert seen(here) == {("room without a door", frozenset("f"))}
    here["door of d"].delete()
    here.add_door("out", "e", None, ((17, 0), (18, 0)))
    assert ("room without a door", frozenset("de")) not in seen(here)


def test_rooms_of_one_outline_are_the_same_where_most_of_their_heights_is(
    db: semmap.Database,
) -> None:
    here = db.create_map("heights")
    outline = [(0, 0), (4, 0), (4, 4), (0, 4)]
    here.add_room("low", outline, floor=0, ceiling=2.9)
    here.add_room("high", outline, floor=1.9, ceiling=5)
    (found,) = (f for f in here.check() if "low" in f.entities and "overlap" in f.kind)
    assert "overlap in 16.00 m2, from 1.90 to 2.90 m" in str(found)
    here.add_room("again", outline, floor=0, ceiling=2.4)
    assert ("identical rooms", frozenset({"low", "again"})) in seen(here)


def test_copies_are_found_up_to_a_contact_apart_and_overlap_from_there_on(
    db: semmap.Database,
) -> None:
    here = db.create_map("copies")
    here.add_room("r", [(0, 0), (40, 0), (40, 4), (0, 4)], floor=0, ceiling=2.5)
    away = [0.0, 0.0005, 0.0015, 0.005, 0.03, 0.032, 0.05, 0.3]
    for number, metres in enumerate(away):
        for name, beside in (("a", 0.0), ("b", metres)):
            size = (1, 1, 0.7)
            here.add_object(f"{name}{number}", size=size, pose=(2 + 3 * number + beside, 2, 0))
    assert seen(here) == {
        ("things at one point" if metres <= 0.03 else "penetrating", frozenset({f"a{n}", f"b{n}"}))
        for n, metres in enumerate(away)
    }


def test_things_sink_into_a_slab_where_no_room_says_its_height(db: semmap.Database) -> None:
    here = db.create_map("slab")
    slab = box_mesh((0, 0, -0.2), (6, 6, 0))
    here.add_object("slab", mesh=slab, pose=(0, 0, 0), type="floor")
    here.add_object("sunk", size=(0.5, 0.5, 0.5), pose=(2, 2, -0.15))
    here.add_object("stands", size=(0.5, 0.5, 0.5), pose=(4, 4, -0.03))
    assert seen(here) == {("sunk", frozenset({"sunk", "slab"}))}


def test_a_wall_of_another_storey_holds_nothing(db: semmap.Database) -> None:
    here = db.create_map("two storeys")
    for level, wide in enumerate((6, 3)):  # the wall above stands over the middle of the room
        z = 3.2 * level
        here.add_storey(f"s{level}", elevation=z, height=3.0)
        outline = [(0, 0), (wide, 0), (wide, 4), (0, 4)]
        here.add_room(f"r{level}", outline, floor=z, ceiling=z + 2.9, storey=f"s{level}")
        here.add_door(f"d{level}", f"r{level}", None, ((1, 0), (2, 0)), height=z)
    here.add_object("kite", size=(0.3, 0.3, 0.1), pose=(3, 2, 1.2))
    assert seen(here) == {("floating", frozenset({"kite"}))}


@pytest.mark.parametrize("name", ["hotel", "clinic"])
def test_real_buildings_have_the_findings_that_sql_counts(
    imported: Import, worlds: Path, name: str
) -> None:
    path = worlds / "rmf" / name / f"{name}.building.yaml"
    with (
        imported((path, name)) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        here = db.map(name)
        found = here.check()
        without = here.execute(
            "SELECT e.name FROM room r JOIN entity e ON e.id = r.entity_id WHERE NOT EXISTS "
            "(SELECT FROM connector c WHERE e.id IN (c.place_a, c.place_b))"
        )
        shapeless = here.execute(
            "SELECT e.name FROM entity e WHERE kind = 'object' AND NOT EXISTS "
            "(SELECT FROM entity_model m WHERE m.entity_id = e.id)"
        )
    doorless = [each.entities for each in found if each.kind == "room without a door"]
    assert sorted(doorless) == sorted(without)
    (note,) = (each for each in found if each.kind == "without geometry")
    assert sorted(note.entities) == sorted(row[0] for row in shapeless)
    assert len(found) == len(without) + 1


def test_agents_are_in_solids_where_shapely_has_their_middle_in_the_ground(
    db: semmap.Database,
) -> None:
    draw, inside = random.Random(3), set()
    here = db.create_map("agents")
    here.add_room("r", [(0, 0), (90, 0), (90, 6), (0, 6)], floor=0, ceiling=2.5)
    for number in range(30):
        x, turn = 1.5 + 2.9 * number, draw.uniform(-3, 3)
        low, high = draw.choice([(0, 1.9), (0, 0.05), (0, 0.6), (0.7, 0.74), (1.3, 1.6)])
        wide, deep = draw.uniform(0.4, 1.2), draw.uniform(0.3, 0.8)
        block = box_mesh((-wide / 2, -deep / 2, low), (wide / 2, deep / 2, high))
        here.add_object(f"block{number}", mesh=block, pose=(x, 3, 0, turn))
        tall = draw.choice([0.3, 1.0, 1.8])
        at = shapely.Point(x + draw.uniform(-0.3, 0.3), 3 + draw.uniform(-0.3, 0.3))
        here.add_agent(f"agent{number}", size=(0.3, 0.3, tall), pose=(at.x, at.y, 0))
        ground = here[f"block{number}"].footprint
        assert ground is not None
        edge = ground.exterior.distance(at) * (1 if ground.contains(at) else -1)
        if abs(edge) < 0.08:  # partly in it: either is right
            here[f"agent{number}"].delete()
        elif edge > 0 and high >= 0.2 and low < tall:
            inside.add(frozenset({f"agent{number}", f"block{number}"}))
    found = [f for f in here.check() if f.kind == "agent in a solid"]
    assert {frozenset(f.entities) for f in found} == inside
    assert 5 < len(inside) < 20
    assert done(here, found[0])


def test_people_sit_lie_and_carry(db: semmap.Database) -> None:
    here = db.create_map("people")
    here.add_room("r", [(0, 0), (9, 0), (9, 6), (0, 6)], floor=0, ceiling=2.5)
    for number, type_ in enumerate(("chair", "bed", "sofa")):
        here.add_object(type_, type=type_, size=(0.9, 1.2, 0.6), pose=(1 + 2 * number, 2, 0))
        here.add_agent(f"p{number}", size=(0.4, 0.4, 1.2), pose=(1 + 2 * number, 2, 0))
    here.add_agent("carrier", size=(0.4, 0.4, 1.2), pose=(8, 2, 0))
    here.add_object("crate", size=(0.5, 0.5, 0.4), pose=(8, 2, 0.5))
    here.add_object("cup", size=(0.05, 0.05, 0.1), pose=(1, 2, 0.9))
    here.add_agent("cleaner", type="robot", size=(0.4, 0.4, 0.4), pose=(5, 2, 0))
    assert {f.entities for f in here.check() if f.kind == "agent in a solid"} == {
        ("carrier", "crate"),
        ("cleaner", "sofa"),
    }
    here["cleaner"].delete()
    here.execute("SELECT put(%s, %s, 'on')", here["crate"].id, here["carrier"].id)
    assert not [f for f in here.check() if f.kind == "agent in a solid"]


def test_sizes_are_judged_by_their_type_alone(db: semmap.Database) -> None:
    here = db.create_map("sizes")
    here.add_room("r", [(0, 0), (60, 0), (60, 60), (0, 60)], floor=0, ceiling=2.5)
    cases = {
        "row": ("bookshelf", (0.4, 30, 2.0), False),
        "cube": (None, (2, 2, 2), False),
        "toy": ("table", (0.15, 0.15, 0.1), False),
        "millimetres": ("table", (0.0012, 0.0008, 0.00075), True),
        "centimetres": ("table", (0.012, 0.008, 0.0075), True),
        "wide": ("table", (30, 30, 0.75), True),
        "tower": ("bookshelf", (0.4, 0.9, 11), True),
        "glass": ("wine_glass", (0.08, 0.08, 0.25), False),
        "upright": ("plate", (0.02, 0.3, 0.3), False),
    }
    for number, (name, (type_, size, _)) in enumerate(cases.items()):
        here.add_object(name, type=type_, size=size, pose=(5 + 5 * number, 30, 0, 0.3 * number))
    found = {f.entities for f in here.check() if f.kind == "improbable size"}
    assert found == {(name,) for name, (*_, improbable) in cases.items() if improbable}


@pytest.mark.parametrize(
    ("x", "z", "found"), [(0.0, 3.0, False), (2.0, 0.0, True), (9.0, 0.0, False)]
)
def test_storeys_at_one_height_are_of_two_buildings(
    db: semmap.Database, x: float, z: float, found: bool
) -> None:
    here = db.create_map("wings")
    for name, left, floor in (("east", 0.0, 0.0), ("west", x, z)):
        here.add_storey(name, elevation=floor)
        corners = [(left, 0), (left + 4, 0), (left + 4, 4), (left, 4)]
        here.add_room(f"{name} room", corners, floor=floor, ceiling=floor + 2.5, storey=name)
    kinds = {f.entities for f in here.check() if f.kind == "storeys at one height"}
    assert kinds == ({("east", "west")} if found else set())


@pytest.mark.parametrize(("climb", "found"), [(0.0, True), (0.019, True), (0.15, False)])
def test_stairs_climb(db: semmap.Database, climb: float, found: bool) -> None:
    here = db.create_map("climb")
    here.add_room("a", [(0, 0), (4, 0), (4, 4), (0, 4)], floor=0, ceiling=2.5)
    here.add_room("b", [(4.2, 0), (8, 0), (8, 4), (4.2, 4)], floor=climb, ceiling=2.5)
    here.add_door("steps", "a", "b", ((4.1, 1), (4.1, 2)), form="stairs")
    kinds = {f.kind for f in here.check()}
    assert ("stairs on one floor" in kinds) == found


@pytest.fixture
def doorway(database: str) -> Iterator[semmap.Map]:
    """Two rooms with a door of 1 m in a wall of 20 cm."""
    with semmap.connect(database) as db:
        here = db.create_map("lodge")
        for name, x in (("porch", 0.0), ("lobby", 4.2)):
            here.add_room(name, shapely.box(x, 0, x + 4, 4), floor=0, ceiling=2.6)
        here.add_door("gate", "porch", "lobby", ((4.1, 1.5), (4.1, 2.5)))
        yield here


@pytest.mark.parametrize(
    ("size", "low", "type_", "kind", "says"),
    [
        ((0.2, 1.4, 1.2), 1.0, "wall", "blocked door", "only a robot lower than 1.00 m passes"),
        ((0.2, 1.4, 0.05), 0.62, "wall", "blocked door", "only a robot lower than 0.62 m passes"),
        ((0.2, 1.4, 2.4), 0.0, "wall", "blocked door", ": no robot passes"),
        ((0.02, 1.4, 2.1), 0.0, "curtain", "thing in a doorway", ": no robot passes"),
        ((0.05, 0.95, 2.1), 0.0, None, "thing in a doorway", "give it the type door_leaf"),
        ((0.05, 0.95, 2.1), 0.0, "door_leaf", "shut leaf of an open door", "state is open"),
        ((0.05, 0.95, 2.1), 0.0, "door", "shut leaf of an open door", "state is open"),
    ],
    ids=["lintel", "bar", "wall", "curtain", "untyped-leaf", "leaf", "door"],
)
def test_what_closes_a_doorway_is_judged_by_what_it_is(
    doorway: semmap.Map,
    size: tuple[float, float, float],
    low: float,
    type_: str | None,
    kind: str | None,
    says: str,
) -> None:
    doorway.add_object("thing", type=type_, size=size, pose=(4.1, 2, low))
    found = [f for f in doorway.check() if "gate" in f.entities]
    assert [f.kind for f in found] == ([] if kind is None else [kind])
    assert all(says in f"{f.text} {f.fix}" for f in found)
    top = low if low else 1.5  # what check says of heights is so for routes
    for height in (0.9 * top, top + 0.1):
        corners = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]
        part = Part("box", ("box",), (0.03, height), np.array(corners), 0.2, 0.29)
        passes = type_ in ("door", "door_leaf") or 0 < low >= height
        try:
            doorway.route("porch", "lobby", robot=RobotClass("box", (part,)))
        except ValueError:
            assert not passes
        else:
            assert passes


@pytest.mark.parametrize(
    ("type_", "parts", "floats"),
    [
        ("wardrobe", "back left right top", False),
        (None, "back left right front top", False),
        (None, "back left right top", False),
        (None, "left right top", True),
        (None, "top", True),
    ],
    ids=["wardrobe", "closed", "open-front", "between-two-walls", "under-a-table"],
)
def test_what_hangs_in_furniture_is_held(
    doorway: semmap.Map, type_: str | None, parts: str, floats: bool
) -> None:
    """A coat in the middle of a case of boards, a handbreadth from each of them."""
    boards = {
        "back": ((-0.5, -0.5, 0), (-0.48, 0.5, 2)),
        "front": ((0.48, -0.5, 0), (0.5, 0.5, 2)),
        "left": ((-0.5, -0.5, 0), (0.5, -0.48, 2)),
        "right": ((-0.5, 0.48, 0), (0.5, 0.5, 2)),
        "top": ((-0.5, -0.5, 1.98), (0.5, 0.5, 2)),
    }
    legs = [((x, y, 0), (x + 0.04, y + 0.04, 1.99)) for x in (-0.5, 0.46) for y in (-0.5, 0.46)]
    mesh = join([box_mesh(*ends) for ends in (*(boards[p] for p in parts.split()), *legs)])
    doorway.add_object("case", type=type_, mesh=mesh, pose=(2, 2, 0))
    doorway.add_object("coat", size=(0.5, 0.6, 1.0), pose=(2, 2, 0.5))
    found = {f.entities for f in doorway.check() if f.kind == "floating"}
    assert found == ({("coat",)} if floats else set())


@pytest.mark.parametrize("seed", range(8))
def test_what_floats_beside_a_turned_cupboard_is_named(doorway: semmap.Map, seed: int) -> None:
    """By Shapely: within its bounds in the map's frame, but not within its ground."""
    draw = random.Random(seed)
    yaw = draw.uniform(0.4, 1.2)
    doorway.add_object("chest", type="cupboard", size=(1.6, 0.3, 1.8), pose=(2, 2, 0, yaw))
    ground = doorway["chest"].footprint
    x0, y0, x1, y1 = ground.bounds
    while True:
        x, y = draw.uniform(x0 + 0.1, x1 - 0.1), draw.uniform(y0 + 0.1, y1 - 0.1)
        away = ground.distance(shapely.Point(x, y))
        if away == 0 or away > 0.15:
            break
    doorway.add_object("kite", size=(0.1, 0.1, 0.1), pose=(x, y, 1))
    found = {f.entities for f in doorway.check() if f.kind == "floating"}
    assert found == ({("kite",)} if away else set())


@pytest.mark.parametrize("seed", range(12))
def test_a_book_over_an_edge_is_on_the_table_or_named(doorway: semmap.Map, seed: int) -> None:
    """By the millimetre: the middle of its mass decides, as for its holder."""
    draw = random.Random(seed)
    doorway.add_object("table", size=(1.0, 0.8, 0.7), pose=(2, 2, 0))
    long, share = draw.uniform(0.1, 0.4), draw.choice([0.2, 0.45, 0.49, 0.51, 0.55, 0.9])
    x = 2.5 - share * long + long / 2
    doorway.add_object("book", size=(long, 0.15, 0.03), pose=(x, 2, 0.7))
    named = [f for f in doorway.check() if "book" in f.entities]
    assert (doorway["book"].holder is doorway["table"] or not named) == (share > 0.5)
    assert [f.kind for f in named] == ([] if share > 0.5 else ["tipping"])


@pytest.mark.parametrize("away", [0.0, 0.005, 0.02, 0.04])
@pytest.mark.parametrize(
    ("low", "floats"),
    [(0.62, True), (0.61, True), (0.3, False), (0.9, False)],
    ids=["on-no-board", "a-little-lower", "hung-below-it", "hung-above-it"],
)
def test_what_is_beside_the_board_that_it_should_stand_on_floats(
    doorway: semmap.Map, away: float, low: float, floats: bool
) -> None:
    boards = [
        box_mesh((0, 0, 0), (0.02, 0.4, 1.2)),
        box_mesh((0.98, 0, 0), (1, 0.4, 1.2)),
        box_mesh((0, 0, 0.6), (1, 0.4, 0.62)),
        box_mesh((0, 0, 0), (1, 0.4, 0.02)),
    ]
    doorway.add_object("shelf", mesh=join(boards), pose=(2, 2, 0))
    doorway.add_object("vase", size=(0.1, 0.1, 0.25), pose=(2 - away - 0.05, 2.2, low))
    found = [f.kind for f in doorway.check() if "vase" in f.entities]
    assert found == (["floating" if away else "tipping"] if floats else [])


@pytest.mark.parametrize("seed", range(8))
def test_what_hangs_at_a_ceiling_is_near_to_it(doorway: semmap.Map, seed: int) -> None:
    """By arithmetic: at a ceiling with a shape, or at one that is a number, and not above it."""
    draw = random.Random(seed)
    has_shape = seed % 2 == 0
    slab, high = draw.uniform(2.2, 2.5), draw.uniform(0.1, 0.3)
    if has_shape:
        mesh = box_mesh((-0.1, -0.1, slab), (8.3, 4.1, slab + 0.05))
        doorway.add_object(
            draw.choice(NAMES), type=draw.choice(["ceiling", None]), mesh=mesh, pose=(0, 0, 0)
        )
    bottom = slab if has_shape else 2.6
    expected = set()
    spans = [(0.0, 0.04), (0.06, 0.14), (0.16, 0.5), (0.5, 0.9)]
    for number, (least, most) in enumerate(spans):
        air = draw.uniform(least, most)
        doorway.add_object(
            f"lamp{number}", size=(0.2, 0.2, high), pose=(1, 0.5 + number, bottom - air - high)
        )
        if air > 0.15:
            expected.add(f"lamp{number}")
    doorway.add_object("sofa", type="sofa", size=(0.8, 0.8, 0.6), pose=(6.5, 2, bottom - 0.63))
    guess = {"type_guess": {"type": "cup", "confidence": 0.7}}  # by its name, which is no proof
    pose = (4, 1, bottom - 0.15)
    doorway.add_object("cup_0", type="cup", size=(0.3, 0.3, 0.1), pose=pose, properties=guess)
    expected.add("sofa")  # no cable bears it
    above = slab + 0.05 if has_shape else 2.6  # in the room's height, or just above it
    pipe = (3, 2, above + draw.uniform(0.06, 0.09))
    doorway.add_object("pipe", size=(0.2, 0.2, 0.05), pose=pipe)
    expected.add("pipe")
    cable = draw.uniform(0.0, 0.45)
    chandelier = (5, 2, 2.6 - cable - 0.4)
    doorway.add_object("light", type="ceiling_lamp", size=(0.6, 0.6, 0.4), pose=chandelier)
    assert {f.entities[0] for f in doorway.check() if f.kind == "floating"} == expected


@pytest.mark.parametrize("edge", [4.3, 4.36, 4.45, 4.6, 4.9, 5.2])
def test_a_room_that_is_drawn_away_from_its_door_is_named_and_no_route_leads_there(
    doorway: semmap.Map, edge: float
) -> None:
    doorway.execute(
        "UPDATE gis_room SET geom = ST_Multi(ST_MakeEnvelope(%s, 0, 8.2, 4)) "
        "WHERE name = 'lobby' AND map = 'lodge'",
        edge,
    )
    gap = edge - 4.1
    away = gap > 0.3 and edge > 4.1 + 0.65 + 0.05  # who faces the door stands 0.65 m behind it
    said = [f.entities for f in doorway.check() if f.kind == "door away from its room"]
    assert said == ([("gate", "lobby")] if away else [])
    if away:
        with pytest.raises(ValueError, match="gate would join them"):
            doorway.route("porch", "lobby")
    else:
        assert doorway.route("porch", "lobby").steps


@pytest.mark.parametrize("seed", range(6))
def test_a_column_through_storeys_has_not_sunk(database: str, seed: int) -> None:
    draw = random.Random(seed)
    rise, count = draw.uniform(2.6, 4), draw.randint(2, 4)
    low = draw.choice([0.0, -0.3, 0.02])
    with semmap.connect(database) as db:
        here = db.create_map("tower")
        for level in range(count):
            z = level * rise
            here.add_storey(f"s{level}", elevation=z)
            here.add_room(f"r{level}", shapely.box(0, 0, 6, 6), floor=z, ceiling=z + rise - 0.2)
        top = draw.randint(1, count) * rise - draw.choice([0.2, 0.0])
        side = draw.uniform(0.2, 0.6)
        here.add_object("post", size=(side, side, top - low), pose=(3, 3, low))
        here.add_object("cask", size=(0.5, 0.5, 0.8), pose=(1, 1, rise - 0.4))
        found = {f.entities for f in here.check() if f.kind == "sunk"}
    assert found == {("cask", "r1")}


def test_what_is_over_a_table_without_a_shape_is_not_judged(doorway: semmap.Map) -> None:
    doorway.add_object("table", type="table", pose=(2, 2, 0))
    doorway.add_object("cup", size=(0.1, 0.1, 0.1), pose=(2.4, 2, 0.75))
    doorway.add_object("far", size=(0.1, 0.1, 0.1), pose=(3.4, 2, 0.75))
    doorway.add_object("low", size=(0.1, 0.1, 0.1), pose=(7, 2, 0.75))
    doorway.add_object("lid", type="table", pose=(7, 2, 1.5))
    found = doorway.check()
    assert {f.entities for f in found if f.kind == "floating"} == {("far",), ("low",)}
    (note,) = (f.text for f in found if f.kind == "without geometry")
    assert note.endswith("; it is not known whether these stand on them or float: cup")


@pytest.mark.parametrize("low", [3.0, 3.3])
def test_what_hangs_in_a_hall_at_the_height_of_a_gallery_floats(database: str, low: float) -> None:
    """The hall is two storeys high; on the gallery beside it, a box stands on a floor."""
    with semmap.connect(database) as db:
        here = db.create_map("court")
        for name, z in (("low", 0), ("high", 3)):
            here.add_storey(name, elevation=z, height=3)
        here.add_room("hall", shapely.box(0, 0, 6, 5), floor=0, ceiling=5.8)
        here.add_room("below", shapely.box(6, 0, 10, 5), floor=0, ceiling=2.9)
        here.add_room("gallery", shapely.box(6, 0, 10, 5), floor=3, ceiling=5.8)
        here.add_object("stands", size=(0.5, 0.5, 0.5), pose=(8, 2, 3))
        here.add_object("hangs", size=(0.5, 0.5, 0.5), pose=(3, 2, low))
        found = {f.entities: f.text for f in here.check() if f.kind == "floating"}
    assert found.keys() == {("hangs",)}
    assert f"{low:.2f} m above" in found["hangs",]


@pytest.mark.parametrize("seed", range(6))
def test_what_is_before_a_wall_is_not_in_the_opening_beside_it(
    doorway: semmap.Map, seed: int
) -> None:
    """By arithmetic: the box reaches into the wall, or is before it; it leaves so much free."""
    draw = random.Random(seed)
    away, free = draw.choice([-0.05, 0.05, 0.15]), draw.choice([0.3, 0.5, 0.7, 1.0, 1.2])
    x, y = draw.choice([4.0 - away - 0.2, 4.2 + away + 0.2]), 1.5 + free + 0.4
    doorway.add_object("box", size=(0.4, 0.8, 0.6), pose=(x, y, 0))
    found = [f for f in doorway.check() if f.entities == ("gate", "box")]
    where = "in" if away < 0 else "before"
    said = [f"box stands {where} the opening of gate: "] if free < 0.6 else []
    assert [f.text[: len(t)] for f, t in zip(found, said, strict=True)] == said


@pytest.mark.parametrize("seed", range(6))
def test_a_storey_is_a_floor_where_no_room_is_beneath(database: str, seed: int) -> None:
    """By Shapely: a box in the air floats if most of it is over a room, and over no room above."""
    draw = random.Random(seed)
    rise, wide = draw.uniform(2.8, 4), draw.uniform(3, 6)
    lower, upper = shapely.box(0, 0, wide, 5), shapely.box(wide - 1.5, 0, wide + 6, 5)
    with semmap.connect(database) as db:
        here = db.create_map("mezzanine")
        for level in (0, 1):
            here.add_storey(f"s{level}", elevation=level * rise, height=rise)
        here.add_room("hall", lower, floor=0, ceiling=draw.choice([2.5, 2 * rise - 0.2]))
        here.add_room("gallery", upper, floor=rise, ceiling=2 * rise - 0.2)
        expected = set()
        for number in range(5):
            x, y = draw.uniform(-1, wide - 0.5), number + 0.5
            away = draw.choice([0, 0.2, 0.4])
            spot = (x, y, rise + away)
            here.add_object(f"b{number}", type="mug", size=(0.4, 0.4, 0.4), pose=spot)
            ground = shapely.box(x - 0.2, y - 0.2, x + 0.2, y + 0.2)
            over = ground.intersection(lower).area > ground.area / 2
            if away or (over and not ground.intersects(upper)):
                expected.add((f"b{number}",))
        found = {f.entities: f.text for f in here.check() if f.kind == "floating"}
    assert found.keys() == expected


def test_furniture_on_a_storey_without_a_floor_is_named_with_it(doorway: semmap.Map) -> None:
    doorway.add_storey("loft", elevation=3)
    for number in range(3):
        doorway.add_object(f"t{number}", size=(1, 0.6, 0.7), pose=(2, 0.6 + number, 3))
    found = {f.kind: f for f in doorway.check()}
    assert found["storey without a floor"].entities == ("loft",)
    assert found["things without a storey"].entities == ("t0", "t1", "t2")
    assert found["things without a storey"].fix == "by hand: add rooms or a floor to loft"
    assert "floating" not in found


@pytest.mark.parametrize("side", ["wall", "outline", "table"])
@pytest.mark.parametrize(
    ("type_", "size", "reach"),
    [
        ("chair", (0.4, 0.4, 0.9), -1),
        ("sofa", (0.4, 1.2, 0.6), -1),
        ("mug", (0.08, 0.08, 0.1), -1),
        ("mug", (0.03, 0.6, 0.4), 0.05),  # a picture with the name of a mug
        ("box", (0.2, 0.2, 0.2), 0.02),
        ("lamp", (0.1, 0.1, 0.2), 0.02),
        ("picture", (0.03, 0.5, 0.3), 0.05),
        ("range_hood", (0.3, 0.8, 0.5), 0.05),
        (None, (0.2, 0.2, 0.2), 0.05),
    ],
)
def test_what_hangs_beside_a_wall_or_table_is_near_to_it(
    doorway: semmap.Map, side: str, type_: str | None, size: tuple[float, ...], reach: float
) -> None:
    """By the millimetre; seats and cups stand, and nothing beside them bears them."""
    if side == "wall":  # 0.1 m before the outline
        doorway.add_object("wall", type="wall", size=(0.2, 4, 2.6), pose=(0, 2, 0))
    if side == "table":
        doorway.add_object("table", type="table", size=(1, 2, 1.9), pose=(2, 2, 0))
    edge = {"wall": 0.1, "outline": 0.0, "table": 2.5}[side]
    doorway.add_object("it", type=type_, size=size, pose=(1, 1, 0))
    for away in (0.002, 0.015, 0.03, 0.045, 0.07):
        doorway["it"].move_to(edge + away + size[0] / 2, 2, 0.8)
        found = {f.entities for f in doorway.check() if f.kind == "floating"}
        assert found == ({("it",)} if away > reach else set()), away


@pytest.mark.parametrize("seed", range(6))
def test_a_fix_puts_nothing_into_the_air(doorway: semmap.Map, seed: int) -> None:
    """A thing in a block goes onto the block, or onto the floor beside it."""
    draw = random.Random(seed)
    high, side = draw.uniform(1.0, 1.6), draw.uniform(0.1, 0.3)
    doorway.add_object("block", size=(draw.uniform(0.4, 0.8), 0.7, high), pose=(2, 2, 0))
    spot = (2 + draw.uniform(-0.1, 0.1), 2 + draw.uniform(-0.35, 0.35), draw.uniform(0.1, 0.6))
    doorway.add_object("it", type=[None, "box", "mug"][seed % 3], size=(side,) * 3, pose=spot)
    (found,) = (f for f in doorway.check() if f.kind == "penetrating")
    assert done(doorway, found)
    pose = doorway["it"].pose
    assert pose is not None
    assert min(abs(pose.z), abs(pose.z - high)) < 1e-3


Boxes = list[tuple[tuple[float, float, float], tuple[float, float, float]]]

FLOORS: dict[str, tuple[str | None, Boxes, bool]] = {
    "nothing": (None, [], False),
    "slab": (None, [((0, 0, -0.2), (4, 4, 0))], True),
    "a-step-lower": ("floor", [((0, 0, -0.7), (4, 4, -0.3))], True),
    "small": ("floor", [((0, 0, -0.2), (1.9, 1.9, 0))], False),
    "tiles": (
        "floor",
        [((x, y, -0.2), (x + 1, y + 1, 0)) for x in (0, 1) for y in (0, 1, 2)],
        True,
    ),
    "walls": (
        "wall",
        [((0, 0, -2.5), (8, 0.5, -0.2)), ((0, 0, -2.5), (0.5, 4, -0.2))],
        False,
    ),
    "table": ("table", [((0, 0, -0.05), (3, 2, 0))], False),
    "rug": ("carpet", [((0, 0, -0.01), (1.9, 3, 0))], False),
    "underside": ("wall", [((0, 0, 0), (4, 4, 2))], False),
}
"""The boxes of an object by the height of a storey, and whether they are its floor."""


@pytest.mark.parametrize("name", FLOORS)
def test_a_floor_of_a_storey_is_wide_and_level(doorway: semmap.Map, name: str) -> None:
    type_, boxes, is_floor = FLOORS[name]
    doorway.add_storey("loft", elevation=3)
    if boxes:
        mesh = join([box_mesh(*ends) for ends in boxes])
        doorway.add_object("it", type=type_, mesh=mesh, pose=(0, 0, 3))
    found = [f.entities for f in doorway.check() if f.kind == "storey without a floor"]
    assert found == ([] if is_floor else [("loft",)])


@pytest.mark.parametrize("side", [5.0, 3.0])
def test_without_rooms_a_flat_solid_or_a_sheet_is_a_floor(db: semmap.Database, side: float) -> None:
    here = db.create_map("no rooms")
    for name, z in (("low", 0), ("middle", 4), ("high", 8)):
        here.add_storey(name, elevation=z)
    sheet = Mesh(np.array([[0, 0, 0], [9, 0, 0], [9, 5, 0.0]]), np.array([[0, 2, 1]]))
    here.add_object("x17", type="floor", mesh=sheet, pose=(0, 0, 0))  # it faces down
    here.add_object("slab", size=(side, side, 0.2), pose=(2, 2, 3.8))
    missing = {("high",)} if side > 4 else {("middle",), ("high",)}
    assert {f.entities for f in here.check() if f.kind == "storey without a floor"} == missing


def test_a_picture_without_thickness_hangs_before_a_wall(doorway: semmap.Map) -> None:
    corners = np.array([[0, -0.3, 0], [0, 0.3, 0], [0, 0.3, 0.4], [0, -0.3, 0.4]])
    sheet = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    doorway.add_object("sheet", type="picture", mesh=sheet, pose=(0.04, 2, 1.2))
    doorway.add_object("away", type="picture", mesh=sheet, pose=(0.2, 1, 1.2))
    assert {f.entities for f in doorway.check() if f.kind == "floating"} == {("away",)}
