"""Open-RMF buildings: a small one written here, what may be wrong with it, and random damage."""

import copy
import math

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import Geod, Proj
from shapely import Point

from semmap.geometry.pose import Pose
from semmap.ingest.rmf import read_rmf
from semmap.ingest.rmf.storey_entries import WALL_THICKNESS
from semmap.ingest.world import OUTSIDE, WorldError

SCALE = 0.02
"""Metres a pixel in the plan below."""

# Two rooms of 6 x 6 m and 4 x 6 m, a shaft of 2 x 2 m in the second one's corner; pixels, y down.
CORNERS = [
    (0, 0),
    (500, 0),
    (500, 300),
    (0, 300),  # 0-3: the house
    (300, 0),
    (300, 100),
    (300, 150),
    (300, 300),  # 4-7: the wall between the rooms, and its door
    (100, 300),
    (150, 300),  # 8-9: the front door
    (400, 0),
    (400, 100),
    (425, 100),
    (475, 100),
    (500, 100),  # 10-14: the shaft, its opening
    (50, 200),
    (200, 200),
    (350, 250),
    (450, 50),
    (400, 200),  # 15-19: places
]
NAMES = {15: "charger", 16: "kitchen", 17: "desk spot"}
PARAMS = {
    15: {"is_charger": [4, True], "is_parking_spot": [4, True]},
    17: {"is_parking_spot": [4, True], "is_charger": [4, False]},
    18: {"lift_cabin": [1, "lift"]},
}
WALLS = [
    (0, 4),
    (4, 10),
    (10, 1),
    (1, 14),
    (14, 2),
    (2, 7),
    (7, 9),
    (8, 3),
    (3, 0),
    (4, 5),
    (6, 7),
    (10, 11),
    (11, 12),
    (13, 14),
]


def door(a, b, name, **params):
    return [
        a,
        b,
        {
            "name": [1, name],
            "type": [1, "hinged"],
            "motion_axis": [1, "start"],
            "motion_degrees": [3, 90],
            "motion_direction": [2, 1],
            **params,
        },
    ]


def level(elevation, *, move=lambda x, y: (x, y)):
    def moved(x, y):
        return [float(v) for v in move(x, y)]

    return {
        "elevation": elevation,
        "drawing": {"filename": "plan.png"},
        "fiducials": [[*moved(*CORNERS[i]), f"f{i}"] for i in (0, 1, 3)],
        "measurements": [[0, 1, {"distance": [3, 500 * SCALE]}]],
        "vertices": [
            [*moved(x, y), 0, NAMES.get(i, ""), copy.deepcopy(PARAMS.get(i, {}))]
            for i, (x, y) in enumerate(CORNERS)
        ],
        "walls": [[a, b, {"alpha": [3, 1]}] for a, b in WALLS],
        "doors": [door(5, 6, "inner"), door(8, 9, "front")],
        "lanes": [
            [15, 16, {"bidirectional": [4, True], "graph_idx": [2, 0], "speed_limit": [3, 0]}],
            [16, 19, {"bidirectional": [4, False], "graph_idx": [2, 0], "speed_limit": [3, 0.5]}],
            [16, 19, {"bidirectional": [4, False], "graph_idx": [2, 1], "speed_limit": [3, 0.5]}],
        ],
        "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}],
        "models": [
            {
                "model_name": "Shop/OfficeChair",
                "name": "Shop/OfficeChair",
                "static": True,
                "x": move(100, 100)[0],
                "y": move(100, 100)[1],
                "yaw": 0.5,
                "z": 0.1,
            },
        ]
        * 2,
    }


def turned(x, y):
    """A second drawing: turned by 0.3 rad, twice as large, shifted."""
    c, s = 2 * math.cos(0.3), 2 * math.sin(0.3)
    return (c * x - s * y + 70, s * x + c * y - 20)


def building():
    return {
        "name": "house",
        "coordinate_system": "reference_image",
        "levels": {"G": level(0.0), "U": level(4.0, move=turned)},
        "lifts": {
            "lift": {
                "x": 450,
                "y": 50,
                "yaw": 0.0,
                "width": 1.6,
                "depth": 1.6,
                "reference_floor_name": "G",
                "initial_floor_name": "G",
                "doors": {
                    "d": {
                        "door_type": 2,
                        "motion_axis_orientation": 0.0,
                        "width": 1.0,
                        "x": 0.0,
                        "y": -0.9,
                    }
                },
                "level_doors": {"G": ["d"], "U": ["d"]},
            }
        },
    }


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data):
        return True


def dump(data):
    return yaml.dump(data, Dumper=_Plain)


@pytest.fixture
def read(tmp_path):
    def read(data):
        path = tmp_path / "house.building.yaml"
        path.write_text(data if isinstance(data, str) else dump(data))
        return read_rmf(path)

    return read


@pytest.fixture
def house(read):
    world = read(building())
    assert world.skipped == []
    return world


def entry(world, name):
    (found,) = [e for e in world.entries if e.name == name]
    return found


def pose(world, name):
    """In the map's frame."""
    found = entry(world, name)
    return pose(world, found.holder) @ found.pose if found.holder else found.pose


def outline(world, name):
    to_map = pose(world, name)
    return shapely.transform(
        entry(world, name).shapes[0].outline,
        lambda xy: to_map.apply(np.column_stack([xy, np.zeros(len(xy))]))[:, :2],
    )


def test_names_are_unique_and_holders_stand_before_what_they_hold(house):
    names = [e.name for e in house.entries]
    assert len(set(names)) == len(names)
    for i, e in enumerate(house.entries):
        assert e.holder is None or e.holder in names[:i]


def test_levels(house):
    storeys = [e for e in house.entries if e.kind == "storey"]
    assert [(s.name, s.pose.z, s.detail.elevation) for s in storeys] == [("G", 0, 0), ("U", 4, 4)]
    assert storeys[0].detail.height == 2.5
    assert storeys[0].properties == {
        "walls": 14,
        "doors": 2,
        "lanes": 3,
        "named_places": 3,
        "models": 2,
    }


def test_a_low_level_ends_below_the_next_one(read):
    data = building()
    data["levels"]["U"]["elevation"] = 2.2
    assert entry(read(data), "G").detail.height == 2.2
    assert entry(read(data), "U").detail.height == 2.5


@pytest.mark.parametrize("suffix", ["", "_2"])
def test_rooms_have_the_areas_of_the_drawing(house, suffix):
    kitchen = outline(house, f"kitchen{suffix}")
    assert kitchen.hausdorff_distance(shapely.box(0, -6, 6, 0)) < 1e-3
    assert len(kitchen.exterior.coords) == 5
    office = outline(house, f"desk spot{suffix}")
    assert office.area == pytest.approx(4 * 6 - 2 * 2, abs=0.3)  # the shaft's door stands forward


def test_a_room_hangs_at_its_middle_and_reaches_the_ceiling(house):
    room = entry(house, "kitchen")
    (shape,) = room.shapes
    assert (room.pose.x, room.pose.y) == pytest.approx((3, -3), abs=1e-3)
    assert shape.outline.centroid.distance(Point(0, 0)) < 1e-6
    assert (room.detail.floor, room.detail.ceiling) == (0, 2.5)
    assert shape.mesh.bounds[:, 2] == pytest.approx([0, 2.5])


def test_a_level_in_another_drawing_is_aligned_by_its_fiducials(house):
    below, above = outline(house, "kitchen"), outline(house, "kitchen_2")
    assert below.hausdorff_distance(above) < 1e-3
    assert entry(house, "kitchen_2").holder == "U"


def test_a_room_takes_the_name_of_its_only_place_and_its_type(house):
    assert entry(house, "kitchen").type == "kitchen"
    assert entry(house, "kitchen-waypoint").kind == "region"
    assert entry(house, "kitchen-waypoint").label == "kitchen"
    assert any(note.startswith("kitchen: the name is taken") for note in house.notes)


def test_a_room_of_two_places_is_numbered(read):
    data = building()
    data["levels"]["G"]["vertices"][15] = [50, 200, 0, "stove"]
    world = read(data)
    assert [e.name for e in world.entries if e.kind == "room" and e.holder == "G"] == [
        "G-room1",
        "desk spot",
        "lift-G",
    ]


def test_doors_join_the_places_beside_them(house):
    inner, front = entry(house, "inner").detail, entry(house, "front").detail
    assert set(inner.places) == {"kitchen", "desk spot"}
    assert front.places == ("kitchen", OUTSIDE)
    assert (inner.width, front.width) == pytest.approx((1, 1))
    assert entry(house, "inner").properties["motion_degrees"] == 90


def test_connectors_lead_from_the_first_place_to_the_second(house):
    connectors = [e for e in house.entries if e.kind == "connector"]
    assert len(connectors) == 6
    for e in connectors:
        frame = pose(house, e.name)
        for place, standing, side in zip(e.detail.places, e.detail.poses, (-1, 1), strict=True):
            assert standing.x * side > 0
            facing = np.array([math.cos(standing.yaw), math.sin(standing.yaw)])
            assert facing @ [-standing.x, -standing.y] > 0
            if place != OUTSIDE:
                where = frame @ standing
                assert outline(house, place).contains(Point(where.x, where.y))


@pytest.mark.parametrize("ends", [(8, 9), (9, 8)])
def test_an_exterior_door_leads_out_whichever_way_it_was_drawn(read, ends):
    data = building()
    data["levels"]["G"]["doors"][1] = door(*ends, "front")  # type: ignore[call-arg]
    world = read(data)
    assert entry(world, "front").detail.places == ("kitchen", OUTSIDE)
    ahead = pose(world, "front").apply([(1, 0, 0)])[0]
    assert ahead == pytest.approx([2.5, -7, 0])


def test_in_a_shallow_room_the_robot_stands_nearer_to_the_door(read):
    data = building()
    plan = data["levels"]["G"]
    plan["vertices"] += [[25, y, 0, ""] for y in (0, 100, 150, 300)]
    plan["walls"] += [[20, 21], [22, 23]]
    plan["doors"].append(door(22, 21, "closet"))
    world = read(data)
    connects = entry(world, "closet").detail
    reaches = {place: abs(p.x) for place, p in zip(connects.places, connects.poses, strict=True)}
    assert reaches["kitchen"] == 0.6
    assert sorted(reaches.values()) == [0.4, 0.6]


def test_a_lift_is_an_elevator_with_a_cabin_on_each_level(house):
    lift = entry(house, "lift")
    assert (lift.kind, lift.properties["levels"]) == ("elevator", ["G", "U"])
    for storey, lobby in (("G", "desk spot"), ("U", "desk spot_2")):
        cabin = entry(house, f"lift-{storey}")
        assert (cabin.detail.elevator, cabin.type, cabin.holder) == (
            "lift",
            "elevator_cabin",
            storey,
        )
        assert outline(house, cabin.name).equals_exact(
            shapely.box(8.2, -1.8, 9.8, -0.2), 1e-6, normalize=True
        )
        detail = entry(house, f"lift-{storey}-d").detail
        assert detail.places == (lobby, cabin.name)
        assert (detail.type, detail.behaviour) == ("elevator_door", "call_elevator")
    assert pose(house, "lift-U").z == 4


@pytest.mark.parametrize(
    ("x", "y", "yaw"), [(0.9, 0, math.pi / 2), (-0.9, 0, math.pi / 2), (0, 0.9, 0)]
)
def test_a_lift_door_looks_away_from_its_cabin_whatever_side_it_is_on(read, x, y, yaw):
    data = building()
    data["levels"] = {"G": data["levels"]["G"]}
    walls = data["levels"]["G"]["walls"]
    data["levels"]["G"]["walls"] = [w for w in walls if not {11, 12, 13} & {w[0], w[1]}]
    data["lifts"]["lift"].update(x=400, y=150, level_doors={"G": ["d"]})
    data["lifts"]["lift"]["doors"]["d"].update(x=x, y=y, motion_axis_orientation=yaw)
    world = read(data)
    detail = entry(world, "lift-G-d").detail
    assert detail.places == ("desk spot", "lift-G")
    standing = pose(world, "lift-G-d") @ detail.poses[0]
    assert (standing.x - 8, standing.y + 3) == pytest.approx((x / 0.9 * 1.5, y / 0.9 * 1.5))


def test_walls_are_solid_and_leave_the_doors_open(house):
    walls = entry(house, "walls-G")
    (shape,) = walls.shapes
    run = sum(math.dist(CORNERS[a], CORNERS[b]) * SCALE for a, b in WALLS)
    assert shape.outline.area == pytest.approx(run * WALL_THICKNESS, rel=0.02)
    v = shape.mesh.triangles
    volume = np.einsum("ij,ij->i", v[:, 0], np.cross(v[:, 1], v[:, 2])).sum() / 6
    assert volume == pytest.approx(shape.outline.area * 2.5)
    for name in ("inner", "front", "lift-G-d"):
        width = entry(house, name).detail.width
        through = pose(house, name).apply([(-0.3, 0, 0), (0.3, 0, 0)])[:, :2]
        opening = shapely.LineString(through).buffer(width / 2 - 1e-3, cap_style="flat")
        assert not shape.outline.intersects(opening)


def test_a_closed_door_fills_its_opening(house):
    (leaf,) = entry(house, "inner").shapes
    corners = pose(house, "inner").apply(leaf.mesh.bounds)
    assert sorted(corners[:, 1]) == pytest.approx([-3, -2])
    assert corners[:, 0] == pytest.approx([6, 6], abs=0.05)


def test_places_and_lanes(house):
    assert entry(house, "charger").type == "charging_station"
    assert entry(house, "desk spot-waypoint").type == "parking_spot"
    assert (pose(house, "charger").x, pose(house, "charger").y) == pytest.approx((1, -4))
    assert entry(house, "charger").holder == "kitchen"
    assert entry(house, "G-waypoint19").type == "waypoint"
    links = {(k.subject, k.object): k.properties for k in house.links if k.relation == "lane"}
    assert links["charger", "kitchen-waypoint"]["bidirectional"] is True
    assert links["kitchen-waypoint", "G-waypoint19"] == {
        "graphs": [0, 1],
        "bidirectional": False,
        "speed_limit": 0.5,
    }
    names = {e.name for e in house.entries}
    assert all(k.subject in names and k.object in names for k in house.links)


def test_furniture_has_its_type_and_turns_with_its_level(house):
    chairs = [e for e in house.entries if e.type == "office_chair"]
    assert [c.name for c in chairs] == ["OfficeChair"] + [f"OfficeChair_{n}" for n in (2, 3, 4)]
    assert [c.holder for c in chairs] == ["kitchen", "kitchen", "kitchen_2", "kitchen_2"]
    below, above = pose(house, "OfficeChair"), pose(house, "OfficeChair_3")
    assert below.translation == pytest.approx([2, -2, 0.1])
    assert above.translation == pytest.approx([2, -2, 4.1])
    assert below.yaw == pytest.approx(0.5)
    # Drawn at the same angle on paper that is turned by 0.3 rad clockwise, as y points down.
    assert above.yaw == pytest.approx(0.8)


def test_the_scale_is_the_mean_over_the_measurements(read):
    data = building()
    data["levels"]["G"]["measurements"].append([0, 3, {"distance": [3, 300 * SCALE * 1.1]}])
    assert outline(read(data), "kitchen").area == pytest.approx(36 * 1.05**2, rel=1e-3)


def test_metres_are_taken_as_they_are(read):
    data = building()
    data["coordinate_system"] = "cartesian_meters"
    del data["levels"]["U"], data["lifts"]
    for vertex in data["levels"]["G"]["vertices"]:
        vertex[0], vertex[1] = vertex[0] * SCALE, -vertex[1] * SCALE
    assert outline(read(data), "kitchen").hausdorff_distance(shapely.box(0, -6, 6, 0)) < 1e-3


SINGAPORE = Proj("EPSG:3414")


def in_degrees():
    """The building with its corner at 28,000 m east and 38,700 m north of Singapore's grid."""
    data = building()
    data["coordinate_system"] = "wgs84"
    data["parameters"] = {
        "generate_crs": [1, "EPSG:3414"],
        "suggested_offset_x": [3, 28000],
        "suggested_offset_y": [3, 38700],
    }
    del data["levels"]["U"], data["lifts"]
    for vertex in data["levels"]["G"]["vertices"]:
        east, north = 28000 + vertex[0] * SCALE, 38700 - vertex[1] * SCALE
        vertex[0], vertex[1] = SINGAPORE(east, north, inverse=True)
    return data


def test_degrees_become_metres_of_the_stated_grid(read):
    world = read(in_degrees())
    assert outline(world, "kitchen").hausdorff_distance(shapely.box(0, -6, 6, 0)) < 1e-3
    frame = {"crs": 3414, "easting": 28000, "northing": 38700, "height": 0, "rotation": 0}
    assert world.georeference == frame


@pytest.mark.parametrize("offset", [None, (0, 0), (28000 - 5e4, 38700)])
def test_the_origin_is_near_the_building(read, offset):
    """Where the file states none near it: the lowest whole metres of its vertices."""
    data = in_degrees()
    for axis, number in zip("xy", offset or (0, 0), strict=True):
        data["parameters"][f"suggested_offset_{axis}"] = [3, number]
        if offset is None:
            del data["parameters"][f"suggested_offset_{axis}"]
    world = read(data)
    origin = np.array([28000, 38694])  # 300 pixels of 0.02 m to the south
    frame = world.georeference
    assert (frame["crs"], frame["rotation"]) == (3414, 0)
    assert (frame["easting"], frame["northing"]) == pytest.approx(origin, abs=1)
    shift = origin - (frame["easting"], frame["northing"])
    kitchen = shapely.transform(shapely.box(0, 0, 6, 6), lambda xy: xy + shift)
    assert outline(world, "kitchen").hausdorff_distance(kitchen) < 1e-3


def surveyed(crs):
    """The building at 52 degrees north, by geodesics; a desk looks along the east of a grid."""
    earth, data = Geod(ellps="WGS84"), building()
    data["coordinate_system"] = "wgs84"
    data["parameters"] = {"generate_crs": [1, crs]}
    del data["levels"]["U"], data["lifts"]
    for vertex in data["levels"]["G"]["vertices"]:
        east = earth.fwd(8.0472, 52.2799, 90, vertex[0] * SCALE)[:2]
        vertex[0], vertex[1] = earth.fwd(*east, 180, vertex[1] * SCALE)[:2]
    desk = {"model_name": "Desk", "name": "desk9", "x": 8.04724, "y": 52.27987, "yaw": 0.0}
    data["levels"]["G"]["models"] = [desk]
    return data


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:32632", "EPSG:2263", "EPSG:3034"])
def test_a_grid_that_stretches_lengths_gives_metres(read, crs):
    world = read(surveyed(crs))
    assert world.georeference["crs"] == 32632
    assert outline(world, "kitchen").area == pytest.approx(36, rel=2e-3)
    stretched = [note for note in world.notes if "times those on the ground" in note]
    assert len(stretched) == (crs != "EPSG:32632")


@pytest.mark.parametrize("rotation", [0.0, 0.7])
def test_degrees_come_into_the_frame_of_a_map(tmp_path, rotation):
    """A desk that looks to true east, in a frame that pyproj places on another grid."""
    path = tmp_path / "site.building.yaml"
    path.write_text(yaml.safe_dump(surveyed("EPSG:3857")))
    grid = Proj("EPSG:32632")
    easting, northing = grid(8.047, 52.279)
    frame = {"crs": 32632, "easting": easting, "northing": northing, "height": 0}
    world = read_rmf(path, georeference=frame | {"rotation": rotation})
    assert world.georeference is None
    (desk,) = (e for e in world.entries if e.name == "desk9")
    place = next(e for e in world.entries if e.name == desk.holder)
    pose = (place.pose if place.kind == "room" else Pose()) @ desk.pose
    turn = np.array([[np.cos(rotation), -np.sin(rotation)], [np.sin(rotation), np.cos(rotation)]])
    back = turn @ (pose.x, pose.y) + (easting, northing)
    assert back == pytest.approx(grid(8.04724, 52.27987), abs=1e-3)
    ahead = turn @ (np.cos(pose.yaw), np.sin(pose.yaw))
    start, end = (grid(*point, inverse=True) for point in (back, back + 100 * ahead))
    azimuth, *_ = Geod(ellps="WGS84").inv(*start, *end)
    assert azimuth == pytest.approx(90, abs=0.01)


def test_metres_of_a_grid_of_the_earth_are_refused(read):
    """Far from the origin, a map is of no use: an import of its export would refuse it."""
    data = building()
    data["coordinate_system"] = "cartesian_meters"
    del data["levels"]["U"], data["lifts"]
    for vertex in data["levels"]["G"]["vertices"]:
        vertex[0] += 691600
    with pytest.raises(WorldError, match=r"off the map's origin by 69.,.* Move it to the origin"):
        read(data)


@pytest.mark.parametrize("crs", [None, "EPSG:99999", "EPSG:abc", 7])
def test_degrees_without_a_grid_are_refused(read, crs):
    data = in_degrees()
    data["parameters"] = {} if crs is None else {"generate_crs": [1, crs]}
    with pytest.raises(WorldError, match="parameters"):
        read(data)


def test_another_reference_level_turns_the_whole_map(read):
    data = building()
    data["reference_level_name"] = "U"
    data["lifts"] = {}
    world = read(data)
    assert outline(world, "kitchen").area == pytest.approx(36, rel=1e-3)
    assert outline(world, "kitchen").hausdorff_distance(outline(world, "kitchen_2")) < 1e-3
    assert outline(world, "kitchen").hausdorff_distance(shapely.box(0, -6, 6, 0)) > 1


def test_a_level_without_common_fiducials_is_reported(read):
    data = building()
    data["levels"]["U"]["fiducials"] = []
    world = read(data)
    assert any("U: fewer than two fiducials" in note for note in world.notes)
    assert outline(world, "kitchen_2").area == pytest.approx(36, rel=1e-3)


def test_fiducials_that_disagree_say_so(read):
    data = building()
    data["levels"]["U"]["fiducials"][0][0] += 50
    assert any("fiducials disagree" in note for note in read(data).notes)


def test_a_door_within_one_room_stays_a_door(read):
    data = building()
    data["levels"]["G"]["vertices"] += [[100, 50, 0, ""], [150, 50, 0, ""]]
    data["levels"]["G"]["doors"].append(door(20, 21, "screen"))
    screen = entry(read(data), "screen")
    assert (screen.kind, screen.type) == ("connector", "door")
    assert screen.detail.places[0] == screen.detail.places[1]
    (ax, ay, _), (bx, by, _) = (p.translation for p in screen.detail.poses)
    assert (ax, ay, bx, by) == (-0.6, 0, 0.6, 0)


def test_the_same_file_gives_the_same_world(read):
    first, second = read(building()), read(building())
    assert [(e.name, e.pose, e.holder) for e in first.entries] == [
        (e.name, e.pose, e.holder) for e in second.entries
    ]


# -- elements that cannot be used -----------------------------------------------------------------


def put(path, value):
    def damage(data):
        *way, last = path
        for key in way:
            data = data[key]
        if isinstance(data, list) and last == "end":
            data.append(value)
        else:
            data[last] = value

    return damage


G = ("levels", "G")
UNUSABLE = {
    "a vertex that is no number": (put((*G, "vertices", 16, 0), math.nan), "levels/G/vertices[16]"),
    "a vertex without numbers": (put((*G, "vertices", 16), ["a"]), "levels/G/vertices[16]"),
    "a vertex that is far away": (put((*G, "vertices", 19, 0), 1e7), "levels/G/vertices[19]"),
    "a vertex beyond all measure": (
        put((*G, "vertices", 16, 0), 1e200),
        "levels/G/vertices[16]",
    ),
    "an infinite parameter": (
        put((*G, "vertices", 16, 4), {"dock_name": [3, math.inf]}),
        "levels/G/vertices[16]",
    ),
    "a wall to no vertex": (put((*G, "walls", "end"), [0, 99, {}]), "levels/G/walls[14]"),
    "a wall to a negative vertex": (put((*G, "walls", "end"), [0, -1, {}]), "levels/G/walls[14]"),
    "a wall without length": (put((*G, "walls", "end"), [3, 3, {}]), "levels/G/walls[14]"),
    "a wall that is a word": (put((*G, "walls", "end"), "wall"), "levels/G/walls[14]"),
    "a lane to nowhere": (put((*G, "lanes", "end"), [0, 99]), "levels/G/lanes[3]"),
    "a lane of a graph that is a word": (
        put((*G, "lanes", "end"), [15, 16, {"graph_idx": [1, "first"]}]),
        "levels/G/lanes[3]",
    ),
    "a door without length": (put((*G, "doors", "end"), door(5, 5, "x")), "levels/G/doors[2]"),
    "a floor of one line": (
        put((*G, "floors", "end"), {"vertices": [0, 4, 1]}),
        "levels/G/floors[1]",
    ),
    "a floor of two corners": (
        put((*G, "floors", "end"), {"vertices": [0, 1]}),
        "levels/G/floors[1]",
    ),
    "a model that flies": (put((*G, "models", 0, "z"), 343_582.0), "levels/G/models[0]"),
    "a model nowhere": (put((*G, "models", 0, "x"), None), "levels/G/models[0]"),
    "a measurement of nothing": (
        put((*G, "measurements", "end"), [3, 3, {"distance": [3, 1]}]),
        "levels/G/measurements[1]",
    ),
    "a nameless fiducial": (put((*G, "fiducials", "end"), [0, 0]), "levels/G/fiducials[3]"),
    "a lift without size": (put(("lifts", "lift", "width"), 0.0), "lifts/lift"),
    "a lift at NaN": (put(("lifts", "lift", "x"), math.nan), "lifts/lift"),
    "a lift to no level": (put(("lifts", "lift", "level_doors", "X"), ["d"]), "level_doors/X"),
    "a lift door of no name": (put(("lifts", "lift", "level_doors", "U"), ["e"]), "level_doors/U"),
    "a lift door of no width": (put(("lifts", "lift", "doors", "d", "width"), -1), "doors/d"),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_elements_are_left_out_and_named(read, case):
    damage, element = UNUSABLE[case]
    data = copy.deepcopy(building())
    damage(data)
    world = read(data)
    assert any(element in skipped.element for skipped in world.skipped)
    assert all(s.problem and s.fix.endswith(".") for s in world.skipped)
    assert "desk spot" in {e.name for e in world.entries}
    assert all(np.isfinite(e.pose).all() for e in world.entries)


def test_names_are_kept_without_what_cannot_be_stored(read):
    data = building()
    data["levels"]["G"]["vertices"][16][3] = "kit\0chen\n"
    assert entry(read(data), "kitchen").kind == "room"


def test_a_door_that_touches_no_room_is_left_out(read):
    data = building()
    data["levels"]["G"]["vertices"] += [[-200, 50, 0, ""], [-150, 50, 0, ""]]
    data["levels"]["G"]["doors"].append(door(20, 21, "lost"))
    world = read(data)
    (skipped,) = world.skipped
    assert "lost" in skipped.element
    assert "touches no room" in skipped.problem
    assert "lost" not in {e.name for e in world.entries}


# -- files that cannot be trusted -----------------------------------------------------------------


def text(**changes):
    return dump({**building(), **changes})


UNTRUSTED = {
    "truncated": (text()[: len(text()) // 3] + "\n  [", "line"),
    "empty": ("", "file"),
    "a list": ("- 1\n- 2\n", "file"),
    "a sentence": ("hello", "file"),
    "two documents": ("a: 1\n---\nb: 2\n", "line"),
    "no levels": ("name: x\n", "levels"),
    "empty levels": (text(levels={}), "levels"),
    "levels in a list": (text(levels=[1]), "levels"),
    "a level that is a number": (text(levels={"G": 1}), "levels/G"),
    "walls that are a word": (text(levels={"G": {**level(0.0), "walls": "x"}}), "levels/G/walls"),
    "an elevation of NaN": (text(levels={"G": level(math.nan)}), "levels/G/elevation"),
    "no measurement": (
        text(levels={"G": {**level(0.0), "measurements": []}}, lifts={}),
        "measurements",
    ),
    "an unknown reference level": (text(reference_level_name="X"), "reference_level_name"),
    "an unknown coordinate system": (text(coordinate_system="mars"), "coordinate_system"),
    "lifts in a list": (text(lifts=[1]), "lifts"),
    "an alias": ("levels: &a {x: *a}\n", "line 1"),
    "an alias bomb": ("a: &a [x, x]\nb: &b [*a, *a]\nlevels: [*b, *b]\n", "line 2"),
    "deep nesting": ("levels: " + "[" * 100_000, "line 1"),
    "an impossible date": ("levels: 2021-13-45\n", "file"),
    "an object of Python": ("levels: !!python/object/apply:os.getcwd []\n", "line 1"),
}


@pytest.mark.parametrize("case", UNTRUSTED)
def test_a_file_that_cannot_be_trusted_is_refused(read, case):
    content, element = UNTRUSTED[case]
    with pytest.raises(WorldError) as error:
        read(content)
    assert element in error.value.element
    assert error.value.path.endswith("house.building.yaml")
    assert error.value.fix


def test_bytes_that_are_not_text_are_refused(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(WorldError, match="not UTF-8"):
        read_rmf(path)


def places_in(node, way=()):
    yield way
    items = node.items() if isinstance(node, dict) else enumerate(node)
    for key, value in items:
        if isinstance(value, dict | list):
            yield from places_in(value, (*way, key))
        else:
            yield (*way, key)


WAYS = [way for way in places_in(building()) if way]
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 200),
    st.floats(),
    st.text(max_size=3),
    st.just([]),
    st.just({}),
    st.just([[]]),
    st.just({"x": [1]}),
    st.just(10**400),
)


@settings(
    deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.lists(st.tuples(st.sampled_from(WAYS), JUNK), min_size=1, max_size=3))
def test_random_damage_gives_a_world_or_a_clear_error(read, damages):
    data = building()
    for way, junk in damages:
        try:
            put(way, junk)(data)
        except (TypeError, KeyError, IndexError):
            continue
    try:
        world = read(data)
    except WorldError as error:
        assert_clear(error)
        return
    names = {e.name for e in world.entries}
    assert len(names) == len(world.entries)
    assert all(isinstance(e.pose, Pose) and np.isfinite(e.pose).all() for e in world.entries)
    assert all(k.subject in names and k.object in names for k in world.links)


def assert_clear(error):
    assert error.element
    assert error.problem
    assert error.fix.endswith((".", "?"))
