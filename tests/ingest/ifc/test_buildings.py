"""IFC files by hand: units, schemas, lifts, ramps, openings, georeference, and what is refused."""

import math
import time

import ifcopenshell
import numpy as np
import pytest
import shapely
import trimesh
from ifcopenshell import geom
from ifcopenshell.util import shape

import semmap
from semmap.geometry.pose import IDENTITY
from semmap.ingest.ifc import read_ifc
from semmap.ingest.importer import read_world
from semmap.ingest.world import OUTSIDE, WorldError
from tests.ingest.ifc.building_by_hand import BuildingByHand

SCHEMAS = [("IFC2X3", None), ("IFC4", "MILLI"), ("IFC4X3", "MILLI")]


@pytest.fixture(params=SCHEMAS, ids=[schema for schema, _ in SCHEMAS])
def house(request):
    """Two storeys of two rooms and a shaft, 3 m high; walls 0.2 m thick between the rooms."""
    made = BuildingByHand(*request.param)
    for number, name in enumerate(("ground", "first")):
        z = 3.0 * number
        level = made.storey(name, z)
        made.add("IfcSpace", f"{number}1", level, ((0, 0, z), (4, 3, z + 2.6)), LongName="Kitchen")
        made.add("IfcSpace", f"{number}2", level, ((4.2, 0, z), (8, 3, z + 2.6)), LongName="Office")
        made.add("IfcSpace", f"{number}L", level, ((8.2, 0, z), (10, 2, z + 2.6)))
        made.add("IfcWall", "between", level, ((4, 0, z), (4.2, 3, z + 2.6)))
        made.add(
            "IfcDoor",
            "door",
            level,
            ((4.1, 1, z), (5, 1.05, z + 2)),
            yaw=math.pi / 2,
            OverallWidth=0.9 * made.scale,
            OverallHeight=2.0 * made.scale,
        )
        made.add("IfcDoor", "liftdoor", level, ((8.1, 0.5, z), (9.1, 0.55, z + 2)), yaw=math.pi / 2)
        made.add("IfcDoor", "front", level, ((1, -0.1, z), (2, -0.05, z + 2)))
    lift = made.add("IfcTransportElement", "lift", level, ((8.4, 0.2, 0), (9.8, 1.8, 2.2)))
    setattr(lift, "OperationType" if request.param[0] == "IFC2X3" else "PredefinedType", "ELEVATOR")
    return made


@pytest.mark.parametrize(
    ("side", "has_body", "is_cabin"),
    [(4.0, True, False), (4.0, False, False), (2.0, True, True), (2.0, False, True)],
)
def test_a_corridor_around_a_lift_is_no_cabin(tmp_path, side, has_body, is_cabin):
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "hall", level, ((0, 0, 0), (side, side, 2.6)), LongName="Corridor")
    made.add("IfcSpace", "room", level, ((side + 0.2, 0, 0), (side + 4, 4, 2.6)))
    made.add("IfcDoor", "door", level, ((side + 0.1, 1, 0), (side + 1, 1.05, 2)), yaw=math.pi / 2)
    lift = made.add(
        "IfcTransportElement", "lift", level, *[((0.3, 0.3, 0), (1.7, 1.7, 2.2))] * has_body
    )
    lift.PredefinedType = "ELEVATOR"
    if not has_body:
        made._place(lift, (1, 1, 0), 0.0)
    world = read_ifc(made.write(tmp_path / "lift.ifc"))
    of = {entry.name: entry for entry in world.entries}
    assert of["hall"].type == ("elevator_cabin" if is_cabin else "corridor")
    assert of["hall"].detail.elevator == ("lift" if is_cabin else None)
    assert of["door"].type == ("elevator_door" if is_cabin else "door")
    notes = [note for note in world.notes if "16.0 m² and is not its cabin" in note]
    assert len(notes) == (not is_cabin)


def placed(world, name):
    """The box (2, 3) of an entry's mesh in the file's frame."""
    entries = {entry.name: entry for entry in world.entries}
    entry = entries[name]
    holder = entries[entry.holder].pose if entry.holder else IDENTITY
    points = (holder @ entry.pose).apply(entry.shapes[0].mesh.used)
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_units_schemas_rooms_doors_and_lifts(house, tmp_path):
    world = read_ifc(house.write(tmp_path / "house.ifc"))
    assert not world.skipped
    of = {entry.name: entry for entry in world.entries}
    storeys = {
        e.name: (e.detail.elevation, e.detail.height) for e in world.entries if e.kind == "storey"
    }
    assert storeys == {"ground": (0.0, pytest.approx(3.0)), "first": (pytest.approx(3.0), None)}
    for name, low, high in (("01", (0, 0, 0), (4, 3, 2.6)), ("12", (4.2, 0, 3), (8, 3, 5.6))):
        assert placed(world, name) == pytest.approx(np.array([low, high]), abs=1e-6)
        assert of[name].detail.ceiling == pytest.approx(2.6)
    assert {of[name].type for name in ("01", "11")} == {"kitchen"}
    assert {of[name].type for name in ("02", "12")} == {"office"}
    assert {of[name].type for name in ("0L", "1L")} == {"elevator_cabin"}
    assert {of[name].detail.elevator for name in ("0L", "1L")} == {"lift"}
    assert of["between"].type == "wall"
    assert of["lift"].kind == "elevator"
    joins = {e.name: (e.type, set(e.detail.places)) for e in world.entries if e.kind == "connector"}
    assert joins == {
        "door": ("door", {"01", "02"}),
        "door_2": ("door", {"11", "12"}),
        "liftdoor": ("elevator_door", {"02", "0L"}),
        "liftdoor_2": ("elevator_door", {"12", "1L"}),
        "front": ("door", {"01", OUTSIDE}),
        "front_2": ("door", {"11", OUTSIDE}),
    }
    assert (of["door"].detail.width, of["door"].detail.height) == (0.9, 2.0)
    assert of["door_2"].pose.x == pytest.approx(4.075, abs=0.03)
    assert of["door_2"].pose.y == pytest.approx(1.45)


def test_poses_of_doors_lie_in_the_rooms_that_they_join(house, tmp_path):
    world = read_ifc(house.write(tmp_path / "house.ifc"))
    of = {entry.name: entry for entry in world.entries}
    for entry in world.entries:
        if entry.kind == "connector":
            for place, pose in zip(entry.detail.places, entry.detail.poses, strict=True):
                at = entry.pose @ pose
                inside = [
                    room.name
                    for room in of.values()
                    if room.kind == "room"
                    and room.holder == entry.holder
                    and shapely.box(*placed(world, room.name)[:, :2].ravel()).covers(
                        shapely.Point(at.x, at.y)
                    )
                ]
                assert inside == ([] if place == OUTSIDE else [place])


def test_spaces_that_touch_are_open_where_nothing_stands(tmp_path):
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "a", level, ((0, 0, 0), (4, 4, 2.6)))
    made.add("IfcSpace", "b", level, ((4, 0, 0), (8, 4, 2.6)))
    made.add("IfcSpace", "c", level, ((0, 4, 0), (8, 8, 2.6)))
    made.add("IfcWall", "screen", level, ((0, 3.95, 0), (8, 4.05, 2.6)))
    made.add("IfcFurniture", "counter", level, ((3.7, 0, 0), (4.3, 2.5, 0.9)))
    made.add("IfcSlab", "slab", level, ((0, 0, -0.2), (8, 8, 0)))
    world = read_ifc(made.write(tmp_path / "open.ifc"))
    (found,) = [entry for entry in world.entries if entry.kind == "connector"]
    assert (found.type, set(found.detail.places)) == ("opening", {"a", "b"})
    assert found.detail.width == pytest.approx(3.9 - 2.5, abs=0.11)
    assert (found.pose.x, found.pose.y) == (
        pytest.approx(4, abs=0.06),
        pytest.approx(3.2, abs=0.06),
    )


def test_stairs_and_ramps_lead_from_the_lower_to_the_upper_room(tmp_path):
    made = BuildingByHand()
    ground, first = made.storey("ground", 0.0), made.storey("first", 3.0)
    made.add("IfcSpace", "hall", ground, ((0, 0, 0), (10, 2, 2.6)))
    made.add("IfcSpace", "landing", first, ((0, 0, 3), (10, 2, 5.6)))
    treads = [((3 + 0.25 * i, 0.5, 0), (3.25 + 0.25 * i, 1.5, 0.2 * (i + 1))) for i in range(14)]
    made.add("IfcStair", "stairs", ground, *treads)
    world = read_ifc(made.write(tmp_path / "stairs.ifc"))
    found = next(entry for entry in world.entries if entry.kind == "connector")
    assert (found.type, found.detail.places) == ("stairs", ("hall", "landing"))
    foot, head = (found.pose @ pose for pose in found.detail.poses)
    assert (foot.x, foot.y, foot.z) == pytest.approx((2.5, 1.0, 0.0), abs=0.01)
    assert (head.x, head.y, head.z) == pytest.approx((7.0, 1.0, 3.0), abs=0.01)
    assert foot.yaw == pytest.approx(0)
    assert abs(head.yaw) == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("gap", "foot", "is_noted"), [(0.55, 0.05, 0), (0.45, 0.05, 0), (0.2, 0.1, 1), (0.05, -0.45, 1)]
)
def test_a_robot_stands_in_its_room_before_stairs_beside_a_wall(tmp_path, gap, foot, is_noted):
    """Stairs begin `gap` metres from the border of their room; the foot is at x = `foot`."""
    made = BuildingByHand()
    ground, first = made.storey("ground", 0.0), made.storey("first", 3.0)
    made.add("IfcSpace", "hall", ground, ((0, 0, 0), (10, 2, 2.6)))
    made.add("IfcSpace", "landing", first, ((0, 0, 3), (10, 2, 5.6)))
    treads = [
        ((gap + 0.25 * i, 0.5, 0), (gap + 0.25 * (i + 1), 1.5, 0.2 * (i + 1))) for i in range(14)
    ]
    made.add("IfcStair", "stairs", ground, *treads)
    world = read_ifc(made.write(tmp_path / "stairs.ifc"))
    found = next(entry for entry in world.entries if entry.kind == "connector")
    lower, upper = (found.pose @ pose for pose in found.detail.poses)
    assert (lower.x, lower.y) == pytest.approx((foot, 1.0), abs=1e-3)
    assert (upper.x, upper.y) == pytest.approx((gap + 14 * 0.25 + 0.5, 1.0), abs=1e-3)
    noted = [note for note in world.notes if "hall has no place" in note and "of stairs" in note]
    assert (len(noted), len(world.notes)) == (is_noted, is_noted)


@pytest.mark.parametrize("rise", [0.25, 0.5])
def test_a_ramp_within_a_storey_rises_to_the_floor_of_its_room_along_its_middle(tmp_path, rise):
    made = BuildingByHand()
    level = made.storey("upper", 3.0)
    made.add("IfcSpace", "hall", level, ((0, 0, 3), (9, 5, 5.6)))
    made.add("IfcSpace", "platform", level, ((9, 0, 3 + rise), (14, 5, 5.6)))
    made.ramp("slope", level, ((6, 2, 3), (9, 3.5, 3 + rise)))
    world = read_ifc(made.write(tmp_path / "ramp.ifc"))
    found = next(entry for entry in world.entries if entry.type == "ramp")
    assert (found.holder, found.detail.places) == ("upper", ("hall", "platform"))
    foot, head = (found.pose @ pose for pose in found.detail.poses)
    assert (foot.x, foot.y, foot.z) == pytest.approx((5.5, 2.75, 0.0), abs=1e-3)
    assert (head.x, head.y, head.z) == pytest.approx((9.5, 2.75, rise), abs=1e-3)
    assert (foot.yaw, abs(head.yaw)) == pytest.approx((0.0, math.pi), abs=1e-3)


def test_a_stair_to_a_half_level_of_its_storey_is_a_way(tmp_path):
    """Seven steps of 0.2 m to a gallery whose floor is 1.5 m above that of the storey."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "hall", level, ((0, 0, 0), (5, 3, 4)))
    made.add("IfcSpace", "gallery", level, ((5, 0, 1.5), (9, 3, 4)))
    steps = [((3.25 + 0.25 * i, 1, 0), (3.5 + 0.25 * i, 2, 0.2 * (i + 1))) for i in range(7)]
    made.add("IfcStair", "steps", level, *steps)
    world = read_ifc(made.write(tmp_path / "gallery.ifc"))
    assert not world.skipped
    found = next(entry for entry in world.entries if entry.kind == "connector")
    assert (found.type, found.detail.places) == ("stairs", ("hall", "gallery"))
    foot, head = (found.pose @ pose for pose in found.detail.poses)
    assert (foot.x, foot.y, foot.z) == pytest.approx((2.75, 1.5, 0.0), abs=1e-3)
    assert (head.x, head.y, head.z) == pytest.approx((5.5, 1.5, 1.5), abs=1e-3)


@pytest.mark.parametrize(
    ("stated", "easting"),
    [(691_600_000.0, 691_600.0), (691_600.0, 691_600.0), (691.6, 0.6916)],
    ids=["millimetres", "metres", "neither"],
)
def test_a_map_conversion_is_the_georeference(tmp_path, stated, easting):
    """Without MapUnit, its unit is that of the project, unless metres alone are on the grid."""
    made = BuildingByHand()
    made.add("IfcWall", "wall", made.storey("ground", 0.0), ((0, 0, 0), (4, 0.2, 3)))
    northing = 5_334_700.0 / 691_600.0 * stated
    made.place_on_earth(25832, stated, northing, (math.cos(0.3), math.sin(0.3)))
    world = read_ifc(made.write(tmp_path / "earth.ifc"))
    assert world.georeference["crs"] == 25832
    assert world.georeference["rotation"] == pytest.approx(0.3)
    assert world.georeference["easting"] == pytest.approx(easting)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda data: data[: len(data) // 2], "no end"),
        (lambda data: b"", "cannot be read|no IfcProject"),
        (lambda data: b"\0\xff garbage" * 50, "cannot be read|no IfcProject"),
    ],
)
def test_a_broken_file_is_refused_with_a_sentence(tmp_path, spoil, problem):
    made = BuildingByHand()
    made.add("IfcWall", "wall", made.storey("ground", 0.0), ((0, 0, 0), (4, 0.2, 3)))
    path = made.write(tmp_path / "whole.ifc")
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(WorldError, match=problem):
        read_world(path)


def test_bodies_of_flat_faces_are_read_fast_and_as_open_cascade_makes_them(tmp_path):
    """In less than half of its time: 9 spheres of 1280 faces, and a wall with a hole."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    ball, block = trimesh.creation.icosphere(3), trimesh.creation.box((4, 0.2, 3))
    for x in range(9):
        made.faceted(
            "IfcFurniture", "ball", level, np.add(ball.vertices, (3 * x, 0, 1)), ball.faces
        )
    wall = made.faceted("IfcWall", "wall", level, np.add(block.vertices, (0, 9, 1.5)), block.faces)
    made.opening(wall, ((-0.5, 8.5, 0), (0.5, 9.5, 2)))
    path = made.write(tmp_path / "faces.ifc")
    began = time.process_time()
    world = read_ifc(path)
    ours = time.process_time() - began
    model = ifcopenshell.open(path)
    began = time.process_time()
    shapes = {
        element.GlobalId: shape.get_vertices(geom.create_shape(geom.settings(), element).geometry)
        for element in model.by_type("IfcElement")
    }
    theirs = time.process_time() - began
    assert ours < theirs / 2, (ours, theirs)
    objects = [entry for entry in world.entries if entry.kind == "object"]
    assert len(objects) == 10
    for entry in objects:
        vertices = shapes[entry.properties["ifc"]["guid"]]
        mesh = entry.shapes[0].mesh
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(vertices, axis=0), abs=1e-6)
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
        volume = ball.volume if entry.type != "wall" else (4 * 3 - 1 * 2) * 0.2
        assert (solid.is_watertight, solid.volume) == (True, pytest.approx(volume, rel=1e-3))


def test_a_building_far_from_the_origin_is_refused(tmp_path):
    made = BuildingByHand()
    made.add("IfcWall", "wall", made.storey("ground", 0.0), ((5e6, 0, 0), (5e6 + 4, 0.2, 3)))
    with pytest.raises(WorldError, match=r"from the origin.*IfcMapConversion"):
        read_ifc(made.write(tmp_path / "far.ifc"))


def test_a_space_whose_outline_crosses_itself_is_left_out_and_named(tmp_path):
    """IfcOpenShell makes a body of one half of a figure of eight, 4 of its 8 square metres."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    eight, concave = [(0, 0), (4, 4), (4, 0), (0, 4)], [(9, 0), (13, 0), (10, 1), (9, 4)]
    assert not shapely.Polygon(eight).is_valid
    made.prism("IfcSpace", "eight", level, eight, 2.6)
    made.prism("IfcSpace", "whole", level, concave, 2.6)
    world = read_ifc(made.write(tmp_path / "eight.ifc"))
    (room,) = [entry for entry in world.entries if entry.kind == "room"]
    assert room.name == "whole"
    assert room.shapes[0].outline.area == pytest.approx(shapely.Polygon(concave).area, abs=1e-3)
    assert [(left.element, left.problem) for left in world.skipped] == [
        ("IfcSpace eight", "has an outline that crosses itself")
    ]


def test_a_door_without_rooms_is_left_out_and_named(tmp_path):
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "a", level, ((0, 0, 0), (4, 4, 2.6)))
    made.add("IfcDoor", "inside", level, ((1, 2, 0), (2, 2.05, 2)))
    world = read_ifc(made.write(tmp_path / "doors.ifc"))
    (left,) = world.skipped
    assert "inside" in left.element
    assert "same one" in left.problem


def test_a_door_joins_the_spaces_that_the_file_states(tmp_path):
    """A niche is drawn over a space and the door: geometry alone would take it."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    spaces = [
        made.add("IfcSpace", name, level, ((low, 0, 0), (high, 4, 2.6)))
        for name, low, high in (("niche", 4.2, 5), ("a", 0, 4), ("b", 4.2, 8))
    ]
    door = made.add("IfcDoor", "door", level, ((4.1, 1, 0), (5, 1.05, 2)), yaw=math.pi / 2)
    for space in spaces[1:]:
        made.bound(space, door)
    world = read_ifc(made.write(tmp_path / "stated.ifc"))
    found = next(entry for entry in world.entries if entry.name == "door")
    assert set(found.detail.places) == {"a", "b"}
    assert found.detail.width == pytest.approx(0.9), "without a stated width, that of its shape"


@pytest.mark.parametrize("has_opening", [False, True])
@pytest.mark.parametrize("depth", [0.05, 0.4])
def test_a_door_faces_as_its_body_does_where_its_placement_is_not_turned(
    tmp_path, has_opening, depth
):
    """It is 0.9 m wide along y, in a wall along y; with a lining as deep as the wall, or not."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "a", level, ((0, 0, 0), (4, 3, 2.6)))
    made.add("IfcSpace", "b", level, ((4.4, 0, 0), (8, 3, 2.6)))
    wall = made.add("IfcWall", "wall", level, ((4, 0, 0), (4.4, 3, 2.6)))
    door = made.add("IfcDoor", "door", level, ((4.4 - depth, 1, 0), (4.4, 1.9, 2)))
    if has_opening:
        made.opening(wall, ((4, 1, 0), (4.4, 1.9, 2)), filled_by=door)
    world = read_ifc(made.write(tmp_path / "door.ifc"))
    assert not world.skipped
    (found,) = [entry for entry in world.entries if entry.kind == "connector"]
    assert (found.type, set(found.detail.places)) == ("door", {"a", "b"})
    assert found.detail.width == pytest.approx(0.9)
    x = 4.2 if has_opening else 4.4 - depth / 2
    assert (found.pose.x, found.pose.y) == pytest.approx((x, 1.45))
    assert abs(math.cos(found.pose.yaw)) == pytest.approx(1.0)


def test_openings_are_ways_where_nothing_fills_them_and_one_can_walk_through(tmp_path):
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "a", level, ((0, 0, 0), (4, 9, 2.6)))
    made.add("IfcSpace", "b", level, ((4.2, 0, 0), (8, 9, 2.6)))
    wall = made.add("IfcWall", "wall", level, ((4, 0, 0), (4.2, 9, 2.6)))
    door = made.add(
        "IfcDoor", "door", level, ((4.1, 1, 0), (5, 1.05, 2)), yaw=math.pi / 2, OverallWidth=800.0
    )
    made.opening(wall, ((4, 1, 0), (4.2, 1.9, 2)), filled_by=door)
    made.opening(wall, ((4, 3, 0.9), (4.2, 4.2, 2)))  # a hatch above a counter
    made.opening(wall, ((4, 5, 0), (4.2, 6, 1.2)))  # for a cat
    made.opening(wall, ((4, 7, 0), (4.2, 8.2, 2.1)))
    world = read_ifc(made.write(tmp_path / "openings.ifc"))
    ways = {e.name: e for e in world.entries if e.kind == "connector"}
    assert {(e.type, e.detail.width) for e in ways.values()} == {("door", 0.8), ("opening", 1.2)}
    assert all({*e.detail.places} == {"a", "b"} for e in ways.values())
    assert ways["door"].pose.y == pytest.approx(1.45)


def test_an_escalator_is_left_out_and_named(tmp_path):
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    made.add("IfcSpace", "a", level, ((0, 0, 0), (4, 4, 2.6)))
    moving = made.add("IfcTransportElement", "moving", level, ((1, 1, 0), (2, 3, 2)))
    moving.PredefinedType = "ESCALATOR"
    world = read_ifc(made.write(tmp_path / "escalator.ifc"))
    assert [(left.element, left.problem) for left in world.skipped] == [
        ("IfcTransportElement moving", "is of the kind ESCALATOR")
    ]
    assert not [entry for entry in world.entries if entry.kind == "elevator"]


def test_without_spaces_storeys_are_those_that_have_elements(tmp_path):
    made = BuildingByHand()
    ground, _, roof = made.storey("ground", 0.0), made.storey("sea", -9.0), made.storey("roof", 3.0)
    for level, z in ((ground, 0), (roof, 3)):
        made.add("IfcWall", "wall", level, ((0, 0, z), (4, 0.2, z + 2.6)))
    world = read_ifc(made.write(tmp_path / "walls.ifc"))
    assert [entry.name for entry in world.entries if entry.kind == "storey"] == ["ground", "roof"]
    assert any("sea" in note for note in world.notes)


def test_doors_without_spaces_are_leaves_that_found_doorways_take(database, tmp_path):
    """Two rooms of 4 by 3 m; a door between them, one to the outside, and a gap in the wall."""
    made = BuildingByHand()
    level = made.storey("ground", 0.0)
    for low, high in (
        ((-0.2, -0.2), (8.4, 0)),
        ((-0.2, 3), (8.4, 3.2)),
        ((-0.2, 0), (0, 3)),
        ((8.2, 0), (8.4, 3)),
    ):
        wall = made.add("IfcWall", "outer", level, ((*low, 0), (*high, 2.6)))
        if high == (8.4, 0):
            front = made.add("IfcDoor", "front", level, ((1, -0.13, 0), (2, -0.08, 2.1)))
            made.opening(wall, ((1, -0.2, 0), (2, 0, 2.1)), filled_by=front)
    wall = made.add("IfcWall", "between", level, ((4, 0, 0), (4.2, 3, 2.6)))
    door = made.add("IfcDoor", "oak", level, ((4.1, 0.3, 0), (5.1, 0.35, 2)), yaw=math.pi / 2)
    made.opening(wall, ((4, 0.3, 0), (4.2, 1.3, 2)), filled_by=door)
    made.opening(wall, ((4, 1.8, 0), (4.2, 2.7, 2)))
    file = made.write(tmp_path / "bare.ifc")
    with semmap.connect(database) as db:
        summary = db.import_file(file, map="bare")
        assert not summary.skipped
        bare = db.map("bare")
        assert {e.name for e in bare.objects if e.type == "door_leaf"} == {"front", "oak"}
        bare.find_rooms(add=True)
        found = {door.label: door for door in bare.doors}
        assert {label: door.type for label, door in found.items()} == {
            "front": "door",
            "oak": "door",
            None: "opening",
        }
        oak = found["oak"]
        ways = bare.execute("SELECT entity_id, behaviour FROM connector")
        assert dict(ways)[oak.id] == "pass_door"
        assert dict(ways)[found[None].id] == "drive_through"
        assert oak.properties["ifc"] == bare["oak"].properties["ifc"]
        assert oak.properties["ifc"]["class"] == "IfcDoor"
        assert oak.properties["found"]["shown_by"] == ["oak"]
        assert oak.width == pytest.approx(1.0, abs=0.01)
        assert tuple(oak.pose.translation[:2]) == pytest.approx((4.1, 0.8), abs=0.02)
        assert len(oak.places) == 2
        assert None in found["front"].places
