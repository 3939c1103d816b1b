"""Regions: drawn, of faces, found; held by what they are a part of; written once."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from sqlalchemy import Connection, Engine, text
from sqlalchemy.orm import Session

from semmap.database import open_engine
from semmap.geometry.mesh import Mesh, box_mesh, join
from semmap.geometry.pose import Pose
from semmap.geometry.tin import decode_patch
from semmap.ingest.importer import import_file
from semmap.ingest.ontology.type_store import load_tbox
from semmap.ingest.regions.extraction import (
    draw_region,
    find_observation_area,
    find_support_surfaces,
    find_walkable_floor,
    region_of_faces,
)
from semmap.ingest.store.world_store import store_world
from semmap.ingest.world import Entry, PlaceDetail, Shape, World
from semmap.model import Region
from semmap.query.meshes import model_triangles
from tests.command_line import semmap
from tests.conftest import MakeDatabase
from tests.ingest.worlds_by_hand import room_features

TABLE = join(
    [box_mesh((-0.6, -0.4, 0.70), (0.6, 0.4, 0.74))]
    + [
        box_mesh((x - 0.03, y - 0.03, 0), (x + 0.03, y + 0.03, 0.70))
        for x in (-0.5, 0.5)
        for y in (-0.3, 0.3)
    ]
)
"""Four legs under a board of 1.2 x 0.8 m, 0.74 m high."""

ROOM = shapely.box(0, 0, 5, 4)
PLACED = Pose.planar(2, 2, math.radians(30))


@pytest.fixture
def connection(engine: Engine) -> Any:
    """A connection to a map with a room of 5 x 4 m and a turned table in it."""
    with engine.begin() as connection:
        load_tbox(connection)
        connection.execute(text("INSERT INTO map (name) VALUES ('home')"))
        add(
            connection,
            Entry(
                "kitchen", "room", "kitchen", shapes=[outline_of_room()], detail=PlaceDetail(0, 2.5)
            ),
            Entry(
                "table",
                "object",
                "table",
                holder="kitchen",
                pose=PLACED,
                shapes=[Shape("mesh", TABLE)],
            ),
        )
        yield connection


def outline_of_room() -> Shape:
    return Shape("polygon", box_mesh((0, 0, 0), (5, 4, 2.5)), ROOM)


def add(connection: Connection, *entries: Entry) -> None:
    driver = connection.connection.driver_connection
    assert driver is not None
    source = "by hand: " + ", ".join(e.name for e in entries)
    store_world(driver, map_id(connection), World("home", Path("home"), [*entries]), source)


def map_id(connection: Connection) -> int:
    return int(connection.execute(text("SELECT current_map()")).scalar_one())


def ask(connection: Connection, statement: str, **values: Any) -> Any:
    return connection.execute(text(statement), values).scalar_one()


def named(connection: Connection, name: str) -> int:
    return int(ask(connection, "SELECT entity_id(:name)", name=name))


def footprint(connection: Connection, region: int) -> Any:
    wkb = ask(
        connection, "SELECT ST_AsBinary(footprint) FROM world WHERE entity_id = :id", id=region
    )
    return shapely.from_wkb(bytes(wkb))


def heights(connection: Connection, region: int) -> tuple[float, float]:
    row = connection.execute(
        text("SELECT ST_ZMin(box), ST_ZMax(box) FROM world WHERE entity_id = :id"), {"id": region}
    ).one()
    return tuple(row)


def same(a: Any, b: Any) -> bool:
    return bool(a.symmetric_difference(b).area < 1e-6)


def placed(outline: Any, pose: Pose) -> Any:
    return shapely.transform(
        outline,
        lambda p: pose.apply(np.column_stack([p, np.zeros(len(p))]))[:, :2],
    )


BOARD = shapely.box(-0.6, -0.4, 0.6, 0.4)


def sorted_triangles(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    rows = np.round(triangles.reshape(len(triangles), 9), 6) + 0.0
    return rows[np.lexsort(rows.T)]


def changes(connection: Connection) -> int:
    return int(ask(connection, "SELECT count(*) FROM change"))


def test_a_tables_surface_moves_with_the_table(connection: Connection) -> None:
    table = named(connection, "table")
    (surface,) = find_support_surfaces(connection, table)
    assert same(footprint(connection, surface), placed(BOARD, PLACED))
    assert heights(connection, surface) == pytest.approx((0.74, 0.75))
    connection.execute(text("SELECT move_to(:id, 3.2, 1.1, 0.1, 1.0)"), {"id": table})
    assert same(footprint(connection, surface), placed(BOARD, Pose.planar(3.2, 1.1, 1.0)))
    assert heights(connection, surface) == pytest.approx((0.84, 0.85))


def test_a_region_as_the_orm_sees_it(connection: Connection) -> None:
    table = named(connection, "table")
    (surface,) = find_support_surfaces(connection, table)
    region = Session(connection).get_one(Region, surface)
    assert (region.name, region.type, region.origin) == (
        "table_surface_1",
        "support_surface",
        "support_surface",
    )
    assert region.of is not None
    assert (region.of.name, region.holder and region.holder.name) == ("table", "table")
    assert region.faces is not None
    assert len(region.faces) == 2
    assert ask(connection, "SELECT name FROM gis_region") == "table_surface_1"


def test_what_lies_on_its_side_has_the_surfaces_of_that_side(connection: Connection) -> None:
    """A crate of 0.4 x 0.6 x 1 m, tipped about x: its y side is the upper one."""
    lying = Pose.from_rpy(1, 1, 0.3, math.pi / 2, 0, 0.5)
    crate = Shape("box", box_mesh((-0.2, -0.3, 0), (0.2, 0.3, 1)))
    add(connection, Entry("crate", "object", holder="kitchen", pose=lying, shapes=[crate]))
    (surface,) = find_support_surfaces(connection, named(connection, "crate"))
    assert heights(connection, surface) == pytest.approx((0.6, 0.61))
    top = shapely.box(-0.2, -1, 0.2, 0)  # z of the crate points to -y of the room
    assert same(footprint(connection, surface), placed(top, Pose.planar(1, 1, 0.5)))


HAIRLINE = [
    (-7.4978433663368484, 0.29090038254522455),
    (-6.71950281899473, -0.3369419482697432),
    (-6.0916604881797625, 0.4413985990723752),
    (-7.247005105407973, 0.08856365611237266),
    (-6.870001035521881, 1.0692409298873429),
]
"""A valid outline whose neck is so thin that it crosses itself once the outline is moved."""


def test_one_sliver_of_a_surface_does_not_end_the_search(connection: Connection) -> None:
    """One surface with a hairline neck, one that is nothing but a sliver, and a proper one."""
    table = named(connection, "table")
    assert shapely.Polygon(HAIRLINE).is_valid
    outlines = [HAIRLINE, [(0, 0), (1, 0), (1, 1e-6)], [(0, 0), (1, 0), (1, 1)]]
    find_support_surfaces(connection, table)
    connection.execute(text("DELETE FROM support_surface"))
    for number, corners in enumerate(outlines):
        connection.execute(
            text(
                "INSERT INTO support_surface (model_id, number, height, outline, faces) "
                "SELECT model_id, :number, 0.7, ST_GeomFromWKB(:outline, 0), '{0}' "
                "FROM entity_model WHERE entity_id = :table"
            ),
            {
                "number": number,
                "outline": shapely.to_wkb(shapely.Polygon(corners)),
                "table": table,
            },
        )
    areas = [footprint(connection, r).area for r in find_support_surfaces(connection, table)]
    assert sorted(areas) == pytest.approx([0.5, shapely.Polygon(HAIRLINE).area], abs=1e-6)


def test_surfaces_that_disappeared_are_deleted(connection: Connection) -> None:
    shelf = join([box_mesh((0, 0, z), (1, 0.3, z + 0.02)) for z in (0.5, 1.0, 1.5)])
    table = named(connection, "table")
    connection.execute(text("DELETE FROM entity_model WHERE entity_id = :id"), {"id": table})
    add(connection, Entry("rack", "object", shapes=[Shape("mesh", shelf)]))
    connection.execute(
        text(
            "INSERT INTO entity_model SELECT :id, model_id FROM entity_model "
            "WHERE entity_id = entity_id('rack')"
        ),
        {"id": table},
    )
    assert len(find_support_surfaces(connection, table)) == 3
    connection.execute(text("DELETE FROM entity_model WHERE entity_id = :id"), {"id": table})
    board = Shape("mesh", box_mesh((0, 0, 0), (1, 1, 0.1)))
    add(connection, Entry("board", "object", shapes=[board]))
    connection.execute(
        text(
            "INSERT INTO entity_model SELECT :id, model_id FROM entity_model "
            "WHERE entity_id = entity_id('board')"
        ),
        {"id": table},
    )
    (kept,) = find_support_surfaces(connection, table)
    names = connection.execute(text("SELECT name FROM entity WHERE kind = 'region'")).scalars()
    assert list(names) == ["table_surface_1"]
    assert heights(connection, kept) == pytest.approx((0.1, 0.11))


@pytest.mark.parametrize("count", [1, 3])
def test_a_subset_of_faces_is_just_these_triangles_in_the_world(
    connection: Connection, count: int
) -> None:
    """Over several chunks of a model; tilted, so that all three axes count."""
    number = np.random.default_rng(7)
    soup = number.uniform(-1, 1, (2500, 3, 3))
    mesh = Mesh(soup.reshape(-1, 3), np.arange(7500, dtype=np.int32).reshape(-1, 3))
    pose = Pose.from_rpy(1.5, 2.5, 0.8, 0.3, -0.2, 1.1)
    add(
        connection,
        Entry("soup", "object", holder="kitchen", pose=pose, shapes=[Shape("mesh", mesh)]),
    )
    thing = named(connection, "soup")
    chosen = [0, 1023, 1024, 1500, 2499][:: 6 // (count + 1)]
    region = region_of_faces(connection, thing, chosen, "handle", "handle_region")
    driver = connection.connection.driver_connection
    assert driver is not None
    model = ask(connection, "SELECT model_id FROM entity_model WHERE entity_id = :id", id=thing)
    stored = model_triangles(driver, model)[chosen]
    row = connection.execute(
        text("SELECT name, of, triangles, ST_AsEWKB(geom) FROM region_face WHERE id = :id"),
        {"id": region},
    ).one()
    assert tuple(row[:3]) == ("handle", "soup", len(chosen))
    seen = decode_patch(bytes(row[3]))
    wanted = pose.apply(stored.reshape(-1, 3)).reshape(-1, 3, 3)
    np.testing.assert_allclose(sorted_triangles(seen), sorted_triangles(wanted), atol=2e-6)
    assert footprint(connection, region).area > 0
    connection.execute(text("SELECT move_to(:id, 0, 0, 0, 0.0)"), {"id": thing})
    again = decode_patch(bytes(ask(connection, "SELECT ST_AsEWKB(geom) FROM region_face")))
    np.testing.assert_allclose(sorted_triangles(again), sorted_triangles(stored), atol=2e-6)


def test_faces_that_stand_upright_have_a_footprint(connection: Connection) -> None:
    door = Shape("box", box_mesh((0, 0, 0), (1, 0.1, 2)))
    add(connection, Entry("cupboard", "object", holder="kitchen", shapes=[door]))
    thing = named(connection, "cupboard")
    driver = connection.connection.driver_connection
    assert driver is not None
    model = ask(connection, "SELECT model_id FROM entity_model WHERE entity_id = :id", id=thing)
    front = np.flatnonzero((model_triangles(driver, model)[:, :, 1] == 0).all(axis=1))
    region = region_of_faces(connection, thing, [int(f) for f in front], "front")
    assert heights(connection, region) == pytest.approx((0, 2))
    assert footprint(connection, region).hausdorff_distance(
        shapely.LineString([(0, 0), (1, 0)])
    ) == pytest.approx(0.001, abs=1e-4)


@pytest.mark.parametrize("faces", [[], [-1], [60], [3, 999]])
def test_faces_that_are_not_there(connection: Connection, faces: list[int]) -> None:
    with pytest.raises(ValueError, match="one or more faces of table, from 0 to 59"):
        region_of_faces(connection, named(connection, "table"), faces, "top")


def test_drawn_regions_stay_where_they_were_drawn(connection: Connection) -> None:
    kitchen, table = named(connection, "kitchen"), named(connection, "table")
    home = map_id(connection)
    triangle = shapely.Polygon([(1, 1), (2, 1), (1, 3)])
    wet = draw_region(connection, home, "wet", triangle, type="blocked_region", holder=kitchen)
    assert same(footprint(connection, wet), triangle)
    assert heights(connection, wet) == pytest.approx((0, 2.5))
    reach = draw_region(connection, home, "reach", box=(2, 1, 0.7, 3, 3, 1.2), holder=table)
    assert same(footprint(connection, reach), shapely.box(2, 1, 3, 3))
    assert heights(connection, reach) == pytest.approx((0.7, 1.2))
    free = draw_region(connection, home, "free", ROOM, properties={"by": "hand"})
    assert same(footprint(connection, free), ROOM)
    connection.execute(
        text("SELECT move_to(:id, 2, 2, 0, :yaw)"), {"id": table, "yaw": math.radians(120)}
    )
    assert same(footprint(connection, reach), shapely.box(1, 2, 3, 3))
    assert same(footprint(connection, wet), triangle)


def test_a_drawn_rooms_floor_excludes_its_objects(connection: Connection) -> None:
    kitchen, table = named(connection, "kitchen"), named(connection, "table")
    region = find_walkable_floor(connection, kitchen)
    assert heights(connection, region) == pytest.approx((0, 0.01))
    free = ROOM - placed(BOARD, PLACED)
    assert footprint(connection, region).symmetric_difference(free).area < 1e-3
    connection.execute(text("SELECT move_to(:id, 9, 9, 0, 0.0)"), {"id": table})
    assert find_walkable_floor(connection, kitchen) == region
    assert same(footprint(connection, region), ROOM)


def test_a_mesh_rooms_floor_is_in_the_mesh(connection: Connection) -> None:
    ground = box_mesh((0, 0, 0), (4, 3, 2.6))
    steps = box_mesh((3, 0, 0), (4, 3, 0.5))
    shell = Shape("mesh", join([ground, steps]))
    add(
        connection,
        Entry(
            "hall",
            "room",
            "corridor",
            pose=Pose.planar(10, 0, math.pi / 2),
            shapes=[shell],
            detail=PlaceDetail(0, 2.6),
        ),
    )
    region = find_walkable_floor(connection, named(connection, "hall"))
    assert footprint(connection, region).area == pytest.approx(9, rel=2e-3)
    whole = shapely.box(7, 0, 10, 3)
    assert footprint(connection, region).hausdorff_distance(whole) < 3e-3


def test_the_area_to_look_at_a_table_from(connection: Connection) -> None:
    table = named(connection, "table")
    region = find_observation_area(connection, table, near=0.4, far=1.0)
    top = placed(BOARD, PLACED)
    ring = top.buffer(1.0, quad_segs=16).difference(top.buffer(0.4, quad_segs=16))
    assert same(footprint(connection, region), ring.intersection(ROOM))
    assert heights(connection, region) == pytest.approx((0, 2.5))
    connection.execute(text("SELECT move_to(:id, 2, 2, 0, 0.0)"), {"id": table})
    (middle,) = connection.execute(
        text("SELECT ST_AsText(ST_Centroid(footprint)) FROM world WHERE entity_id = :id"),
        {"id": region},
    ).one()
    assert shapely.from_wkt(middle).distance(shapely.Point(2, 2)) < 0.2, "it moves along"


def test_a_repeat_changes_nothing_and_a_change_changes_the_same(connection: Connection) -> None:
    table = named(connection, "table")
    home = map_id(connection)

    def find(distance: float) -> list[int]:
        return [
            *find_support_surfaces(connection, table),
            draw_region(connection, home, "wet", shapely.box(1, 1, 1 + distance, 2), holder=table),
            region_of_faces(connection, table, [3, 4], "edge"),
        ]

    first = find(0.3)
    models, before = ask(connection, "SELECT count(*) FROM model"), changes(connection)
    assert find(0.3) == first
    assert changes(connection) == before
    assert find(0.5) == first
    assert footprint(connection, first[1]).area == pytest.approx(0.5)
    assert ask(connection, "SELECT count(*) FROM model") == models


def test_notes_on_a_region_are_kept(connection: Connection) -> None:
    table = named(connection, "table")
    (surface,) = find_support_surfaces(connection, table)
    connection.execute(
        text("UPDATE entity SET properties = '{\"clean\": true}' WHERE id = :id"), {"id": surface}
    )
    find_support_surfaces(connection, table)
    kept = ask(connection, "SELECT properties FROM entity WHERE id = :id", id=surface)
    assert kept == {"clean": True}


def test_a_region_is_deleted_with_its_owner(connection: Connection) -> None:
    table = named(connection, "table")
    find_support_surfaces(connection, table)
    draw_region(connection, map_id(connection), "stays", ROOM)
    connection.execute(text("DELETE FROM entity WHERE name = 'table'"))
    names = connection.execute(text("SELECT name FROM entity WHERE kind = 'region'")).scalars()
    assert list(names) == ["stays"]
    connection.execute(text("SELECT drop_map('home')"))
    assert ask(connection, "SELECT count(*) FROM entity") == 0
    assert ask(connection, "SELECT count(*) FROM model") == 0


def test_impossible_regions_are_refused(connection: Connection) -> None:
    table, kitchen = named(connection, "table"), named(connection, "kitchen")
    home = map_id(connection)
    with pytest.raises(ValueError, match="kitchen is not an object but a room"):
        find_support_surfaces(connection, kitchen)
    with pytest.raises(LookupError, match=r"no type of region table; it has .*blocked_region"):
        draw_region(connection, home, "wet", ROOM, type="table")
    with pytest.raises(ValueError, match="either an outline or a box"):
        draw_region(connection, home, "wet")
    with pytest.raises(ValueError, match="not from a lower to a higher corner"):
        draw_region(connection, home, "wet", box=(0, 0, 0, 1, 1, 0))
    with pytest.raises(ValueError, match="the map has another table, an object"):
        draw_region(connection, home, "table", ROOM)
    draw_region(connection, home, "table_surface_1", ROOM)
    with pytest.raises(ValueError, match="another table_surface_1, a drawn region: rename"):
        find_support_surfaces(connection, table)
    add(connection, Entry("ghost", "object", pose=None))
    with pytest.raises(ValueError, match="ghost is not placed"):
        find_support_surfaces(connection, named(connection, "ghost"))
    add(connection, Entry("idea", "object"))
    with pytest.raises(ValueError, match="idea has no triangles"):
        find_support_surfaces(connection, named(connection, "idea"))


def test_every_room_of_the_office_has_a_floor(module_engine: Engine) -> None:
    """Walls of many boxes that touch, and a slab under each storey."""
    folder = Path(__file__).parents[3] / "examples/office"
    for name in ("office_rooms.geojson", "office.sdf"):
        import_file(module_engine, folder / name, map_name="office")
    url = module_engine.url.render_as_string(hide_password=False)
    floors = answer(url, "regions", "find", "floor", "--type", "room", "--map", "office")
    rooms = answer(url, "ls", "room", "--map", "office")
    assert {f["of"] for f in floors} == {r["name"] for r in rooms}
    assert {(f["low"], f["high"]) for f in floors} == {(0.0, 0.01), (7.0, 7.01)}


@pytest.fixture(scope="module")
def flat(make_database: MakeDatabase, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The URL of a database with a kitchen and two tables, as files bring them."""
    folder = tmp_path_factory.mktemp("flat")
    rooms = folder / "rooms.geojson"
    rooms.write_text(json.dumps(room_features({"kitchen": (0, 0, 5, 4)})))
    models = "".join(
        f"<model name='{name}'><pose>{x} 2 0.4 0 0 0</pose><link name='l'><visual name='v'>"
        "<geometry><box><size>1 0.8 0.8</size></box></geometry></visual></link></model>"
        for name, x in (("table_1", 1.5), ("table_2", 3.5))
    )
    things = folder / "things.sdf"
    things.write_text(f"<sdf version='1.7'><world name='flat'>{models}</world></sdf>")
    url = make_database()
    engine = open_engine(url)
    for path in (rooms, things):
        import_file(engine, path, map_name="flat")
    engine.dispose()
    return url.render_as_string(hide_password=False)


def answer(url: str, *words: str) -> Any:
    """What `semmap WORDS --json` answers."""
    done = semmap(url, *words, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_regions_by_command(flat: str) -> None:
    tops = answer(flat, "regions", "find", "surfaces", "--type", "table")
    assert [(t["name"], t["of"], t["area"], t["low"]) for t in tops] == [
        ("table_1_surface_1", "table_1", 0.8, 0.8),
        ("table_2_surface_1", "table_2", 0.8, 0.8),
    ]
    (wet,) = answer(
        flat,
        "regions",
        "draw",
        "wet",
        "--polygon",
        "0,0 1,0 1,1",
        "--type",
        "blocked_region",
        "--holder",
        "kitchen",
        "--property",
        "until=2",
    )
    assert (wet["area"], wet["high"], wet["type"]) == (0.5, 2.5, "blocked_region")
    (home,) = answer(
        flat, "regions", "draw", "home", "--box", "1,1,0,2,2,0.5", "--type", "home_region"
    )
    assert (home["of"], home["high"]) == (None, 0.5)
    (floor,) = answer(flat, "regions", "find", "floor", "--type", "room")
    assert (floor["of"], floor["low"], floor["origin"]) == ("kitchen", 0.0, "walkable_floor")
    (ring,) = answer(flat, "regions", "find", "observation", "table_1", "--near", "0.3")
    assert (ring["holder"], ring["type"]) == ("table_1", "observation_area")
    assert [r["name"] for r in answer(flat, "regions", "ls")] == [
        "home",
        "kitchen_floor",
        "table_1_observation",
        "table_1_surface_1",
        "table_2_surface_1",
        "wet",
    ]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("find", "surfaces", "tabel_1"), "did you mean table_1"),
        (("find", "surfaces", "--type", "tabel"), "did you mean"),
        (("find", "floor", "table_1"), "is not a room with an outline but an object"),
        (("find", "floor", "kitchen", "--headroom", "-1"), "give 0 <= step"),
        (("find", "observation", "kitchen"), "not an object but a room"),
        (("find", "observation", "table_1", "--near", "3", "--far", "2"), "give 0 <= near < far"),
        (("draw", "wet", "--polygon", "0,0 1,1"), "three corners"),
        (("draw", "wet", "--polygon", "0,0 1,1 1,0 0,1"), "crosses its own border"),
        (("draw", "wet", "--box", "0,0,1"), "6 numbers"),
        (("draw", "wet", "--box", "0,0,0,1,1,1", "--property", "blue"), "KEY=VALUE"),
        (("draw", "wet", "--box", "0,0,0,1,1,1", "--type", "sofa"), "no type of region sofa"),
        (("draw", "wet"), "either an outline or a box"),
    ],
)
def test_commands_that_cannot_be_done(flat: str, words: tuple[str, ...], says: str) -> None:
    with pytest.raises((ValueError, LookupError), match=says):
        answer(flat, "regions", *words)
