"""Sections, headings, storeys and refused edits in the layers that a GIS client edits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

import semmap
from planner.route import NoRouteError
from tests.conftest import Import

OFFICE = Path(__file__).parents[2] / "examples" / "office"


def tin(*meshes: trimesh.Trimesh) -> str:
    """The surfaces of meshes as one TIN, WKT."""
    triangles = [mesh.triangles for mesh in meshes]
    rings = np.concatenate([np.concatenate([t, t[:, :1]], axis=1) for t in triangles])
    return f"TIN Z({','.join(f'(({_corners(ring)}))' for ring in rings)})"


def _corners(ring: np.ndarray[Any, Any]) -> str:
    return ",".join(" ".join(map(repr, map(float, corner))) for corner in ring)


def section(engine: Engine, surface: str, height: float) -> shapely.Geometry:
    with engine.connect() as connection:
        found = connection.execute(
            text("SELECT ST_AsBinary(section_of(ARRAY[ST_GeomFromText(:tin)], :z))"),
            {"tin": surface, "z": height},
        ).scalar_one()
    return shapely.Polygon() if found is None else shapely.from_wkb(bytes(found))


def box(x0: float, y0: float, x1: float, y1: float, top: float = 3) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[(x0, y0, 0), (x1, y1, top)])


EDGE = st.integers(-8, 8)
BOX = st.tuples(EDGE, EDGE, st.integers(1, 6), st.integers(1, 6))


@settings(max_examples=25)
@given(boxes=st.lists(BOX, min_size=1, max_size=6), degrees=st.sampled_from([0, 30, 45]))
def test_the_section_of_solids_that_overlap_is_their_union(
    module_engine: Engine, boxes: list[tuple[int, int, int, int]], degrees: float
) -> None:
    """The oracle is Shapely's union of the rectangles."""
    areas = [(x, y, x + w, y + h) for x, y, w, h in boxes]
    turned = trimesh.transformations.rotation_matrix(math.radians(degrees), (0, 0, 1))
    meshes = [box(*area).apply_transform(turned) for area in areas]
    expected = affinity.rotate(shapely.union_all([shapely.box(*a) for a in areas]), degrees, (0, 0))
    found = section(module_engine, tin(*meshes), 1.0)
    assert found.symmetric_difference(expected).area < 1e-4


def test_the_room_between_walls_is_not_filled_even_where_they_have_no_top(
    module_engine: Engine,
) -> None:
    outer, inner = box(0, 0, 6, 4), box(0.2, 0.2, 5.8, 3.8)
    inner.invert()
    upright = [
        trimesh.Trimesh(m.vertices, m.faces[np.abs(m.face_normals[:, 2]) < 0.5], process=False)
        for m in (outer, inner)
    ]
    found = section(module_engine, tin(*upright), 1.0)
    expected = shapely.box(0, 0, 6, 4) - shapely.box(0.2, 0.2, 5.8, 3.8)
    assert found.symmetric_difference(expected).area < 1e-4


def test_a_sheet_is_shown_as_a_thin_line_and_what_is_lower_not_at_all(
    module_engine: Engine,
) -> None:
    sheet = trimesh.Trimesh([(0, 0, 0), (4, 0, 0), (4, 0, 3), (0, 0, 3)], [(0, 1, 2), (0, 2, 3)])
    found = section(module_engine, tin(sheet), 1.0)
    assert found.symmetric_difference(shapely.box(-0.01, -0.01, 4.01, 0.01)).area < 1e-6
    assert section(module_engine, tin(sheet), 3.5).is_empty


def shown(engine: Engine, name: str, layer: str = "gis_object") -> Any:
    with engine.connect() as connection:
        return connection.execute(
            text(f"SELECT *, ST_AsBinary(geom) AS wkb FROM {layer} WHERE name = :name"),
            {"name": name},
        ).one()


def outline(engine: Engine, name: str) -> shapely.Geometry:
    return shapely.from_wkb(bytes(shown(engine, name).wkb))


def edit(engine: Engine, statement: str, **values: Any) -> None:
    with engine.begin() as connection:
        connection.execute(text(statement), values)


def cut_by_trimesh(mesh: trimesh.Trimesh, height: float) -> shapely.Geometry:
    path = mesh.section(plane_normal=(0, 0, 1), plane_origin=(0, 0, height))
    flat, to_3d = path.to_2D(to_2D=trimesh.geometry.plane_transform((0, 0, height), (0, 0, 1)))
    turn = to_3d[:2, :2]
    return affinity.affine_transform(
        shapely.union_all(flat.polygons_full), [*turn[0], *turn[1], *to_3d[:2, 3]]
    )


def test_walls_are_their_section_a_metre_above_the_floor_of_their_storey(
    office_world: Engine,
) -> None:
    """The oracle is Trimesh; the hull of the walls is a block of 191 square metres."""
    with semmap.connect(office_world.url.render_as_string(hide_password=False)) as database:
        office = database.map("office")
        for name, floor in (("walls-1st", 0.0), ("walls-3rd", 7.0)):
            mesh = office[name].mesh
            assert mesh is not None
            mesh.merge_vertices()
            expected = cut_by_trimesh(mesh, floor + 1)
            assert outline(office_world, name).symmetric_difference(expected).area < 1e-3
            assert 15 < expected.area < 25


@pytest.fixture
def office(imported: Import) -> Any:
    names = ("office_rooms.geojson", "office.sdf")
    with imported(*((OFFICE / name, "office") for name in names)) as engine:
        yield engine


def test_walls_are_moved_and_turned_by_their_section(office: Engine) -> None:
    before = outline(office, "walls-1st")
    pose = affinity.translate(affinity.rotate(before, 30, "centroid"), 2, 1)
    change = "UPDATE gis_object SET geom = ST_GeomFromText(:wkt) WHERE name = :name"
    edit(office, change, wkt=shapely.MultiPolygon(shapely.get_parts(pose)).wkt, name="walls-1st")
    after = outline(office, "walls-1st")
    assert after.symmetric_difference(pose).area < 1e-3
    assert shown(office, "walls-1st").heading_deg == pytest.approx(30)


def test_sections_follow_what_they_are_derived_from(office: Engine) -> None:
    """A type, a height, a model and a storey: each changes the section, or keeps it right."""
    walls = "walls-1st"
    area = outline(office, walls).area
    edit(office, "UPDATE gis_object SET type = 'table' WHERE name = :name", name=walls)
    covered = covered_area(office, walls)
    assert outline(office, walls).area == pytest.approx(covered)
    edit(office, "UPDATE gis_object SET type = 'partition_wall' WHERE name = :name", name=walls)
    assert outline(office, walls).area == pytest.approx(area)
    raised = "SELECT move_to(fid, 0, 0, 2.5) FROM gis_object WHERE name = :name"
    edit(office, raised, name=walls)
    assert outline(office, walls).area == pytest.approx(covered), "above the plane: the whole"
    edit(office, raised.replace("2.5", "-1.5"), name=walls)
    assert outline(office, walls).area == pytest.approx(cut_area(office, walls, 1.0))
    storey = "UPDATE gis_storey SET elevation = elevation + 1 WHERE name = 'floor-1st'"
    edit(office, storey)
    assert outline(office, walls).area == pytest.approx(cut_area(office, walls, 2.0))
    edit(office, "DELETE FROM entity_model WHERE entity_id = entity_id(:name)", name=walls)
    assert shown(office, walls).geom is None


def covered_area(engine: Engine, name: str) -> float:
    """The area below the triangles of an object, by Shapely."""
    with semmap.connect(engine.url.render_as_string(hide_password=False)) as database:
        mesh = database.map("office")[name].mesh
        assert mesh is not None
        flat = shapely.polygons(mesh.triangles[:, :, :2])
        return float(shapely.union_all(flat[shapely.area(flat) > 1e-9]).area)


def cut_area(engine: Engine, name: str, height: float) -> float:
    with semmap.connect(engine.url.render_as_string(hide_password=False)) as database:
        mesh = database.map("office")[name].mesh
        assert mesh is not None
        mesh.merge_vertices()
        return float(cut_by_trimesh(mesh, height).area)


@pytest.mark.parametrize("degrees", [90, -30, 200])
def test_an_object_turns_about_its_middle_by_its_heading(office: Engine, degrees: float) -> None:
    before = shown(office, "desk4")
    area = outline(office, "desk4")
    change = "UPDATE gis_object SET heading_deg = heading_deg + :by WHERE name = 'desk4'"
    edit(office, change, by=degrees)
    after = shown(office, "desk4")
    expected = affinity.rotate(area, degrees, "centroid")
    assert outline(office, "desk4").symmetric_difference(expected).area < 1e-6
    assert math.remainder(after.heading_deg - before.heading_deg - degrees, 360) == pytest.approx(
        0, abs=1e-5
    )
    assert (after.low, after.storey) == (before.low, before.storey)


def test_a_tilted_object_keeps_its_tilt_when_it_is_turned(office: Engine) -> None:
    """The oracle is SciPy."""
    from scipy.spatial.transform import Rotation

    tilted = Rotation.from_euler("xyz", (20, 10, 40), degrees=True)
    edit(
        office,
        "UPDATE placement SET holder_id = NULL, pose = ARRAY[20, 3, 1]::float8[] || "
        "CAST(:q AS float8[]) WHERE entity_id = entity_id('desk4')",
        q=tilted.as_quat().tolist(),
    )
    edit(office, "UPDATE gis_object SET heading_deg = heading_deg + 35 WHERE name = 'desk4'")
    with office.connect() as connection:
        pose = connection.execute(
            text("SELECT pose FROM world WHERE entity_id = entity_id('desk4')")
        ).scalar_one()
    expected = Rotation.from_euler("z", 35, degrees=True) * tilted
    assert (Rotation.from_quat(pose[3:]) * expected.inv()).magnitude() < 1e-6


def test_a_square_that_is_turned_by_a_right_angle_is_turned(office: Engine) -> None:
    edit(
        office,
        "INSERT INTO gis_object (map, name, low, high, geom) VALUES ('office', 'crate', 0, 1, "
        "ST_Multi(ST_MakeEnvelope(30, 0, 31, 1)))",
    )
    edit(
        office,
        "UPDATE gis_object SET geom = ST_Rotate(geom, radians(90), ST_Centroid(geom)) "
        "WHERE name = 'crate'",
    )
    assert shown(office, "crate").heading_deg == pytest.approx(90)


def test_the_height_of_a_drawn_object_is_edited_and_its_heading_is_that_given(
    office: Engine,
) -> None:
    edit(
        office,
        "INSERT INTO gis_object (map, name, low, high, heading_deg, geom) VALUES "
        "('office', 'crate', 0, 1, 45, ST_Multi(ST_MakeEnvelope(30, 0, 32, 1)))",
    )
    assert outline(office, "crate").symmetric_difference(shapely.box(30, 0, 32, 1)).area < 1e-9
    edit(office, "UPDATE gis_object SET low = 0.5, high = 2 WHERE name = 'crate'")
    crate = shown(office, "crate")
    assert (crate.low, crate.high, crate.heading_deg) == pytest.approx((0.5, 2, 45))
    edit(office, "SELECT move_to(entity_id('crate'), 31, 0.5, 0.5)")  # where it is
    assert (shown(office, "crate").low, shown(office, "crate").high) == pytest.approx((0.5, 2))
    assert outline(office, "crate").symmetric_difference(shapely.box(30, 0, 32, 1)).area < 1e-9


def test_things_on_a_drawn_table_follow_its_top_and_stay_where_it_is_reshaped(
    office: Engine,
) -> None:
    for name, low, high, sides in (
        ("table", 0, 0.75, "30, 0, 31, 1"),
        ("cup", 0.75, 0.85, "30.1, 0.1, 30.2, 0.2"),
        ("bin", 0, 0.3, "30.4, 0.4, 30.6, 0.6"),  # under it
    ):
        edit(
            office,
            "INSERT INTO gis_object (map, name, low, high, geom) VALUES ('office', :name, :low, "
            f":high, ST_Multi(ST_MakeEnvelope({sides})))",
            name=name,
            low=low,
            high=high,
        )
    assert shown(office, "cup").holder == "table"
    for height in (0.9, 0.6):
        edit(office, "UPDATE gis_object SET high = :high WHERE name = 'table'", high=height)
        cup = shown(office, "cup")
        assert (cup.holder, cup.low, cup.high) == ("table", pytest.approx(height), height + 0.1)
        assert shown(office, "bin").low == 0
    cup = outline(office, "cup")
    edit(
        office,
        "UPDATE gis_object SET geom = ST_Multi(ST_MakeEnvelope(30, 0, 34, 3)) WHERE name = 'table'",
    )
    assert outline(office, "cup").symmetric_difference(cup).area < 1e-9
    assert shown(office, "cup").holder == "table"
    edit(office, "SELECT move_to(entity_id('table'), 40, 5, 0)")
    table = outline(office, "table")
    assert table.symmetric_difference(shapely.box(38, 3.5, 42, 6.5)).area < 1e-9
    assert shown(office, "cup").holder == "table"


def test_a_storey_is_renamed_and_raised_with_all_that_is_on_it(office: Engine) -> None:
    before = shown(office, "desk4")
    edit(
        office,
        "UPDATE gis_storey SET name = 'top', elevation = 7.5, height = 3.2 "
        "WHERE name = 'floor-3rd'",
    )
    storey, desk = shown(office, "top", "gis_storey"), shown(office, "desk4")
    assert (storey.elevation, storey.height, desk.storey) == (7.5, 3.2, "top")
    assert desk.low == pytest.approx(before.low + 0.5)
    rooms = "SELECT ST_AsBinary(ST_Union(geom)) FROM gis_room WHERE storey = 'top'"
    with office.connect() as connection:
        union = shapely.from_wkb(bytes(connection.execute(text(rooms)).scalar_one()))
    assert shapely.from_wkb(bytes(storey.wkb)).equals(union)


@pytest.mark.parametrize(
    ("edited", "message"),
    [
        ("gis_object SET storey = 'floor-1st' WHERE name = 'desk4'", "storey of desk4 .*follows"),
        ("gis_object SET holder = 'hall' WHERE name = 'desk4'", "holder of desk4 .*follows"),
        ("gis_object SET map = 'other' WHERE name = 'desk4'", "keeps its key and its map"),
        ("gis_object SET high = 9 WHERE name = 'desk4'", "high of desk4 .*follows from the mesh"),
        ("gis_object SET heading_deg = 'NaN' WHERE name = 'desk4'", "desk4 has no heading NaN"),
        ("gis_object SET geom = ST_Scale(geom, 2, 1) WHERE name = 'desk4'", "shape of desk4"),
        ("gis_object SET type = 'tabel' WHERE name = 'desk4'", "no type tabel[^?]*mean table"),
        (
            "gis_object SET type = 'kitchen' WHERE name = 'desk4'",
            "kitchen is not a type of objects",
        ),
        ("gis_object SET name = 'walls-1st' WHERE name = 'desk4'", "already has .* walls-1st"),
        ("gis_object SET properties = '[1]' WHERE name = 'desk4'", "of desk4 are not an object"),
        ("gis_connector SET state = 'ajar' WHERE name = 'door1'", "is not open, closed or locked"),
        ("gis_connector SET direction = 'up' WHERE name = 'door1'", "both, forward or backward"),
        ("gis_connector SET width = -1 WHERE name = 'door1'", "width of door1 is not above 0"),
        ("gis_connector SET step = -1 WHERE name = 'door1'", "step of door1 is below 0"),
        ("gis_connector SET place_a = 'hall' WHERE name = 'door1'", "place_a of door1 .*follows"),
        ("gis_storey SET geom = ST_Scale(geom, 2, 1)", "outline of floor-... .*follows from its"),
        ("gis_storey SET height = 0 WHERE name = 'floor-1st'", "height of floor-1st is not above"),
    ],
)
def test_an_edit_that_is_refused_says_why(office_world: Engine, edited: str, message: str) -> None:
    with pytest.raises(DBAPIError, match=f"(?s){message}") as refused:
        edit(office_world, f"UPDATE {edited}")
    assert "HINT" in str(refused.value)
    assert "constraint" not in str(refused.value.orig).lower()


def test_storeys_are_neither_drawn_nor_deleted(office_world: Engine) -> None:
    for statement in (
        "INSERT INTO gis_storey (map, name) VALUES ('office', 'roof')",
        "DELETE FROM gis_storey",
    ):
        with pytest.raises(DBAPIError, match="neither drawn nor deleted"):
            edit(office_world, statement)


def test_a_door_is_drawn_in_the_wall_of_both_rooms_and_routes_lead_through_no_other(
    database: str,
) -> None:
    with semmap.connect(database) as db:
        here = db.create_map("doors")
        here.add_room("a", [(0, 0), (4, 0), (4, 4), (0, 4)], floor=0, ceiling=2.5)
        here.add_room("b", [(4.1, 0), (8, 0), (8, 4), (4.1, 4)], floor=0, ceiling=2.5)
        draw = (
            "INSERT INTO gis_connector (map, name, geom) VALUES ('doors', 'd', "
            "ST_SetSRID(ST_MakeLine(ST_Point(%s, 2), ST_Point(4.2, 2)), 0))"
        )
        with pytest.raises(ValueError, match=r"the middle of d is 0\.7. m beside a room"):
            here.execute(draw, 2.5)
        assert "d" not in here
        with pytest.raises(ValueError, match=r"e leads from a into b: draw the opening"):
            here.add_door("e", "a", "b", ((3.6, 1), (4.5, 1)))
        here.execute(draw, 3.9)
        db.add_robot("any", OFFICE / "delivery_robot.urdf")
        passable = "SELECT cost >= 0 FROM route_edge WHERE name = 'd' AND map_id = current_map()"
        assert here.route("a", "b").places == ["a", "b"]
        assert [*here.sql(passable)] == [(True,)]
        for x in (4.8, 3.3):
            here["d"].move_to(x, 2, 0)
            assert [each.kind for each in here.check()] == ["door away from its room"]
            assert [*here.sql(passable)] == [(False,)]
            with pytest.raises(NoRouteError):
                here.route("a", "b")
        here["d"].move_to(4.05, 2, 0)
        assert here.route("a", "b").places == ["a", "b"]


@pytest.fixture
def upstairs(database: str) -> Any:
    """A map with a storey at 0 m, and one at 3 m."""
    with semmap.connect(database) as db:
        here = db.create_map("upstairs")
        here.add_storey("ground", elevation=0, height=2.8)
        here.add_storey("upper", elevation=3, height=2.8)
        yield here


def heights(here: semmap.Map, name: str) -> tuple[float, float]:
    """The lowest and the highest z of an entity, from its box in the map's frame."""
    box = here[name].box
    assert box is not None
    return box[2], box[5]


@pytest.mark.parametrize("layer", ["object", "region"])
@pytest.mark.parametrize("storey", ["ground", "upper", None])
def test_heights_are_in_the_maps_frame_when_they_are_drawn_and_edited(
    upstairs: semmap.Map, layer: str, storey: str | None
) -> None:
    draw = (
        f"INSERT INTO gis_{layer} (map, storey, name, low, high, geom) VALUES "
        "('upstairs', %s, %s, %s, %s, ST_Multi(ST_MakeEnvelope(1, 1, 2, 2)))"
    )
    read = f"SELECT low, high FROM gis_{layer} WHERE name = 'a'"
    ground = 3 if storey == "upper" else 0
    low, high = ground + 0.2, ground + 1
    upstairs.execute(draw, storey, "a", low, high)
    assert heights(upstairs, "a") == pytest.approx((low, high))
    assert upstairs.execute(read)[0] == pytest.approx((low, high))
    change = f"UPDATE gis_{layer} SET low = %s, high = %s WHERE name = 'a'"
    upstairs.execute(change, low, high + 0.1)
    assert heights(upstairs, "a") == pytest.approx((low, high + 0.1))
    assert upstairs.execute(read)[0] == pytest.approx((low, high + 0.1))
    upstairs.execute(draw, storey, "without heights", None, None)
    assert heights(upstairs, "without heights")[0] == pytest.approx(ground)
    upstairs.execute(draw, storey, "without top", low, None)
    assert heights(upstairs, "without top")[0] == pytest.approx(low)
    with pytest.raises(ValueError, match="the top of b is below its bottom"):
        upstairs.execute(draw, storey, "b", low, low - 0.1)


@pytest.mark.parametrize(("storey", "ground"), [("upper", 3.0), ("ground", 0.0), (None, 0.0)])
@pytest.mark.parametrize("drawn", [True, False])
def test_a_rooms_floor_is_above_its_storey_however_it_was_made(
    upstairs: semmap.Map, storey: str | None, ground: float, drawn: bool
) -> None:
    if drawn:
        upstairs.execute(
            "INSERT INTO gis_room (map, storey, name, floor, ceiling, geom) VALUES "
            "('upstairs', %s, 'a', 0.3, 2.5, ST_Multi(ST_MakeEnvelope(0, 0, 4, 4)))",
            storey,
        )
    else:
        if storey is None:
            upstairs.execute("DELETE FROM entity WHERE kind = 'storey'")
        upstairs.add_room(
            "a", shapely.box(0, 0, 4, 4), floor=ground + 0.3, ceiling=ground + 2.5, storey=storey
        )
    read = "SELECT storey, floor, ceiling FROM gis_room WHERE name = 'a'"
    assert upstairs.execute(read) == [(storey, 0.3, 2.5)]
    assert heights(upstairs, "a") == pytest.approx((ground + 0.3, ground + 2.5))
    upstairs.execute("UPDATE gis_room SET geom = ST_Translate(geom, 1, 0) WHERE name = 'a'")
    assert upstairs.execute(read) == [(storey, 0.3, 2.5)]
    assert heights(upstairs, "a") == pytest.approx((ground + 0.3, ground + 2.5))
    upstairs.execute("UPDATE gis_room SET floor = 1.0, ceiling = 2.4 WHERE name = 'a'")
    assert upstairs.execute(read) == [(storey, 1.0, 2.4)]
    assert heights(upstairs, "a") == pytest.approx((ground + 1, ground + 2.4))
    stands = (
        "SELECT w.pose[3] + r.floor, w.pose[3] + r.ceiling FROM room r JOIN world w "
        "USING (entity_id)"
    )
    assert upstairs.execute(stands)[0] == pytest.approx((ground + 1, ground + 2.4))
