"""Annotations: what is drawn comes in, and what cannot be used is left out by name."""

import contextlib
import json
import math
import sqlite3
import string
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import Geod, Proj, Transformer

from semmap.geometry.pose import IDENTITY, Pose
from semmap.ingest.annotation.annotation import read_annotation
from semmap.ingest.world import ConnectorDetail, Entry, PlaceDetail, StoreyDetail, World, WorldError

OFFICE = Path(__file__).parents[3] / "examples/office/office_rooms.geojson"

Write = Callable[..., Path]
RELAXED = settings(
    max_examples=100,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def to_file(*features: dict[str, Any], **members: Any) -> Path:
        path = tmp_path / "plan.geojson"
        collection = {"type": "FeatureCollection", "features": list(features), **members}
        path.write_text(json.dumps(collection), encoding="utf-8")
        return path

    return to_file


def feature(geometry: tuple[str, Any] | None = None, **properties: Any) -> dict[str, Any]:
    drawn = None if geometry is None else {"type": geometry[0], "coordinates": geometry[1]}
    return {"type": "Feature", "properties": properties, "geometry": drawn}


def rectangle(x0: float, y0: float, x1: float, y1: float) -> tuple[str, Any]:
    return "Polygon", [[[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]]


def line(*points: tuple[float, float]) -> tuple[str, Any]:
    return "LineString", [list(p) for p in points]


def room(name: str, *bounds: float, **properties: Any) -> dict[str, Any]:
    return feature(rectangle(*bounds), kind="room", name=name, **properties)


LAB = room("lab", 0, 0, 4, 3)
HALL = room("hall", 4.2, 0, 8, 3)
DOOR = feature(line((4.1, 1), (4.1, 2)), kind="door", name="door")


def by_name(world: World) -> dict[str, Entry]:
    return {e.name: e for e in world.entries}


def in_map(world: World, name: str) -> Pose:
    entries, pose = by_name(world), IDENTITY
    entry: Entry | None = entries[name]
    while entry is not None:
        assert entry.pose is not None
        pose, entry = entry.pose @ pose, entries.get(entry.holder or "")
    return pose


def placed_outline(world: World, name: str) -> shapely.Polygon:
    pose = in_map(world, name)
    outline = by_name(world)[name].shapes[0].outline
    return shapely.transform(
        outline, lambda xy: pose.apply(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]
    )


# Rooms and storeys


def test_a_room(write: Write) -> None:
    world = read_annotation(
        write(
            room(
                "k", 1, 2, 5, 4, type="Kitchen", label="tea kitchen", floor=0.1, ceiling=2.6, size=8
            )
        )
    )
    assert (world.name, world.skipped, world.notes) == ("plan", [], [])
    (entry,) = world.entries
    assert (entry.kind, entry.type, entry.label) == ("room", "kitchen", "tea kitchen")
    assert entry.properties == {"size": 8}
    assert entry.detail == PlaceDetail(0.1, 2.6, None)
    assert placed_outline(world, "k").equals(shapely.box(1, 2, 5, 4))
    solid = entry.shapes[0].mesh.moved(entry.pose)
    assert np.allclose(solid.bounds, [[1, 2, 0.1], [5, 4, 2.6]])


def test_rooms_stand_on_their_storey(write: Write) -> None:
    world = read_annotation(
        write(
            feature(kind="storey", name="up", elevation=3.5, height=2.8),
            feature(kind="storey", name="down", elevation=-3.0),
            room("a", 0, 0, 1, 1, storey="up"),
            room("b", 0, 0, 1, 1, storey="down", ceiling=2.2),
        )
    )
    entries = by_name(world)
    assert entries["up"].detail == StoreyDetail(3.5, 2.8)
    assert (entries["a"].holder, entries["a"].detail) == ("up", PlaceDetail(0.0, 2.8, None))
    assert in_map(world, "a").z == 3.5
    assert in_map(world, "b").z == -3.0
    assert world.notes == []


def test_the_only_storey_is_the_holder_of_all(write: Write) -> None:
    world = read_annotation(write(LAB, DOOR, HALL, feature(kind="storey", name="s")))
    assert {e.name: e.holder for e in world.entries} == {
        "s": None,
        "lab": "s",
        "hall": "s",
        "door": "s",
    }


def test_a_room_with_a_bay_stands_inside_itself(write: Write) -> None:
    corner = [[0, 0], [6, 0], [6, 1], [1, 1], [1, 6], [0, 6], [0, 0]]
    world = read_annotation(write(feature(("Polygon", [corner]), kind="room", name="r")))
    pose = in_map(world, "r")
    assert shapely.Polygon(corner).contains(shapely.Point(pose.x, pose.y))
    assert placed_outline(world, "r").equals(shapely.Polygon(corner))


def test_a_room_around_a_courtyard_and_a_room_in_two_parts(write: Write) -> None:
    ring = rectangle(0, 0, 9, 9)[1] + rectangle(3, 3, 6, 6)[1]
    parts = [rectangle(20, 0, 21, 1)[1], rectangle(22, 0, 23, 1)[1]]
    world = read_annotation(
        write(
            feature(("Polygon", ring), kind="room", name="ring"),
            feature(("MultiPolygon", parts), kind="room", name="parts"),
            feature(("MultiPolygon", parts[:1]), kind="region", name="single"),
        )
    )
    assert world.skipped == []
    assert placed_outline(world, "ring").area == pytest.approx(72)
    assert placed_outline(world, "parts").area == pytest.approx(2)
    assert by_name(world)["single"].shapes[0].outline.geom_type == "Polygon"


def test_cabins_belong_to_an_elevator(write: Write) -> None:
    world = read_annotation(
        write(
            room("e1", 0, 0, 2, 2, elevator="lift"),
            room("e2", 0, 0, 2, 2, elevator="lift", floor=3.0),
            room("x1", 4, 0, 6, 2, elevator="undrawn"),
            feature(("Point", [1, 1]), kind="elevator", name="lift"),
        )
    )
    entries = by_name(world)
    assert entries["e1"].type == "elevator_cabin"
    assert entries["e1"].detail.elevator == entries["e2"].detail.elevator == "lift"
    assert (entries["undrawn"].kind, entries["undrawn"].pose) == ("elevator", None)
    assert "undrawn" in world.notes[0]
    names = [e.name for e in world.entries]
    assert names.index("lift") < names.index("e1")


# Words


@pytest.mark.parametrize(
    ("said", "type_"),
    [
        ("DiningTable", "dining_table"),
        ("dining table", "dining_table"),
        ("dining_table", "dining_table"),
        ("hallway", "corridor"),
        ("TV", "tv"),
        ("Zeppelin hangar", "zeppelin_hangar"),
    ],
)
def test_types_are_words_of_the_tbox(write: Write, said: str, type_: str) -> None:
    (entry,) = read_annotation(write(feature(kind="object", name="x", type=said))).entries
    assert entry.type == type_


@pytest.mark.parametrize(
    ("properties", "layer", "kind"),
    [
        ({"kind": "region"}, "rooms", "region"),
        ({"type": "mug"}, "rooms", "room"),
        ({"type": "mug"}, "scribbles", "object"),
        ({"type": "lab"}, None, "room"),
        ({"type": "robot"}, None, "agent"),
        ({}, "Furniture", "object"),
        ({"kind": "mug"}, None, "object"),
    ],
)
def test_the_kind_is_given_or_follows_from_layer_or_type(
    write: Write, properties: dict[str, str], layer: str | None, kind: str
) -> None:
    members = {} if layer is None else {"name": layer}
    (entry,) = read_annotation(write(feature(**properties, name="x"), **members)).entries
    assert entry.kind == kind


def test_names_are_made_and_made_unique(write: Write) -> None:
    world = read_annotation(
        write(
            feature(type="mug"),
            feature(type="mug", name="mug1"),
            feature(type="mug"),
            feature(kind="object"),
            feature(type="cup", name="a"),
            feature(type="cup", name="a"),
        )
    )
    assert [e.name for e in world.entries] == ["mug2", "mug1", "mug3", "object1", "a", "a_2"]
    assert ["a_2" in note for note in world.notes] == [True]


def test_free_properties_keep_their_structure(write: Write) -> None:
    said = {
        "a": [1, {"b": None}],
        "text": '{"c": [2]}',
        "odd": "{not json",
        "none": None,
        "yes": True,
    }
    (entry,) = read_annotation(write(feature(kind="object", name="x", **said))).entries
    assert entry.properties == {
        "a": [1, {"b": None}],
        "text": {"c": [2]},
        "odd": "{not json",
        "yes": True,
    }


def test_an_entry_without_geometry_is_incomplete(write: Write) -> None:
    world = read_annotation(
        write(feature(type="mug", name="m", label="old mug"), feature(type="lab", name="l"))
    )
    assert [(e.pose, e.holder, e.shapes) for e in world.entries] == [(None, None, [])] * 2


# Objects and regions


def test_objects_and_agents(write: Write) -> None:
    world = read_annotation(
        write(
            LAB,
            feature(rectangle(1, 1, 2, 2.6), type="desk", name="d", floor=0.5, height=0.74),
            feature(rectangle(0, 0, 1, 1), type="carpet", name="flat"),
            feature(("Point", [3, 1]), type="robot", name="r", heading_deg=90, front=0.5),
            feature(("Point", [1.5, 1.2]), type="mug", name="m", holder="d", floor=1.24),
        )
    )
    entries = by_name(world)
    assert entries["d"].holder is None
    desk = entries["d"].shapes[0].mesh.moved(in_map(world, "d"))
    assert np.allclose(desk.bounds, [[1, 1, 0.5], [2, 2.6, 1.24]])
    assert entries["flat"].shapes[0].mesh is None
    assert in_map(world, "r").yaw == pytest.approx(math.pi / 2)
    assert (entries["r"].front, entries["r"].holder) == (0.5, "lab")
    assert entries["m"].holder == "d"
    assert np.allclose(in_map(world, "m").translation, [1.5, 1.2, 1.24])


def test_regions_lie_in_rooms(write: Write) -> None:
    world = read_annotation(
        write(
            feature(kind="storey", name="s", elevation=2.0, height=2.7),
            LAB,
            feature(rectangle(1, 1, 2, 2), type="home region", name="h", home="yes"),
            feature(rectangle(3, 1, 9, 2), kind="region", name="far", blocked=0, ceiling=1.0),
            feature(("Point", [1, 2]), type="waypoint", name="w"),
        )
    )
    entries = by_name(world)
    assert (entries["h"].holder, entries["h"].properties) == ("lab", {"home": True})
    assert np.allclose(
        entries["h"].shapes[0].mesh.moved(in_map(world, "h")).bounds, [[1, 1, 2], [2, 2, 4.7]]
    )
    assert (entries["far"].holder, entries["far"].properties) == ("s", {"blocked": False})
    assert np.allclose(in_map(world, "w").translation, [1, 2, 2])


# Doors


def test_a_door_joins_the_places_on_its_sides(write: Write) -> None:
    world = read_annotation(write(HALL, DOOR, LAB))
    door = by_name(world)["door"]
    assert isinstance(door.detail, ConnectorDetail)
    assert door.detail.places == ("hall", "lab")  # in the order of the file
    assert (door.detail.type, door.detail.state, door.detail.behaviour, door.detail.width) == (
        "door",
        "open",
        "pass_door",
        1.0,
    )
    assert door.pose.apply([[1, 0, 0]])[0] == pytest.approx([3.1, 1.5, 0])  # x leads to the lab
    assert np.allclose(door.shapes[0].mesh.bounds, [[-0.025, -0.5, 0], [0.025, 0.5, 2.1]])


def test_limits_of_a_door_are_read(write: Write) -> None:
    said = {"height": 1.9, "step": 0.03, "permissions": "staff, night"}
    drawn = feature(line((4.1, 1), (4.1, 2)), kind="door", name="gate", **said)
    gate = by_name(read_annotation(write(HALL, drawn, LAB)))["gate"]
    assert isinstance(gate.detail, ConnectorDetail)
    assert (gate.detail.height, gate.detail.step) == (1.9, 0.03)
    assert gate.detail.permissions == ("staff", "night")
    assert gate.properties == {}


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("joins", ["lab,hall", "hall, lab", ["lab", "hall"]])
def test_x_of_a_door_leads_to_the_second_place(write: Write, joins: Any, reverse: bool) -> None:
    ends = [(4.1, 1.0), (4.1, 2.0)]
    drawn = line(*(reversed(ends) if reverse else ends))
    world = read_annotation(write(LAB, HALL, feature(drawn, kind="door", name="d", joins=joins)))
    door = by_name(world)["d"]
    assert door.detail.places == tuple(
        j.strip() for j in (joins.split(",") if isinstance(joins, str) else joins)
    )
    for place, pose in zip(door.detail.places, door.detail.poses, strict=True):
        standing = door.pose @ pose
        assert placed_outline(world, place).contains(shapely.Point(standing.x, standing.y))
        to_door = door.pose.translation - standing.translation
        assert to_door @ standing.rotation_matrix[:, 0] == pytest.approx(0.6)


def test_a_door_to_the_outside(write: Write) -> None:
    world = read_annotation(
        write(
            LAB,
            feature(line((1, -0.1), (2, -0.1)), type="exterior door", name="a"),
            feature(line((1, 3.1), (2, 3.1)), type="exterior door", name="b", joins="outside,lab"),
        )
    )
    entries = by_name(world)
    assert entries["a"].detail.places == entries["b"].detail.places == ("lab", "outside")
    assert entries["a"].pose.yaw == pytest.approx(-math.pi / 2)
    assert entries["b"].pose.yaw == pytest.approx(math.pi / 2)
    assert [note.split(":")[0] for note in world.notes] == ["a"]


def test_a_door_drawn_as_a_point(write: Write) -> None:
    point = feature(("Point", [4.1, 1.5]), kind="door", name="d", width=0.9, heading=0.0)
    door = by_name(read_annotation(write(LAB, HALL, point)))["d"]
    assert door.detail.places == ("lab", "hall")
    assert door.detail.width == pytest.approx(0.9)


def test_attributes_of_a_door_are_read(write: Write) -> None:
    said = {"state": "locked", "direction": "backward", "behaviour": "open_gate", "colour": "red"}
    drawn = feature(line((4.1, 1), (4.1, 2)), type="fire door", name="d", joins="lab,hall", **said)
    door = by_name(read_annotation(write(LAB, HALL, drawn)))["d"]
    assert (door.detail.state, door.detail.direction, door.detail.behaviour) == (
        "locked",
        "backward",
        "open_gate",
    )
    assert (door.type, door.properties) == ("fire_door", {"colour": "red"})


def test_an_elevator_door_and_an_opening(write: Write) -> None:
    world = read_annotation(
        write(
            LAB,
            HALL,
            feature(line((4.1, 0), (4.1, 1)), type="lift door", name="e"),
            feature(line((4.1, 2), (4.1, 3)), type="opening", name="o"),
        )
    )
    entries = by_name(world)
    assert (entries["e"].detail.type, entries["e"].detail.behaviour) == (
        "elevator_door",
        "call_elevator",
    )
    assert (entries["o"].detail.type, entries["o"].detail.behaviour, entries["o"].shapes) == (
        "door",
        "drive_through",
        [],
    )


def test_stairs_lead_from_storey_to_storey(write: Write) -> None:
    world = read_annotation(
        write(
            feature(kind="storey", name="low", elevation=0.0),
            feature(kind="storey", name="high", elevation=3.0),
            room("a", 0, 0, 4, 4, storey="low"),
            room("b", 6, 0, 9, 4, storey="high"),
            feature(line((3, 2), (7, 2)), type="stairs", name="s", joins="a,b"),
        )
    )
    stairs = by_name(world)["s"]
    assert (stairs.detail.type, stairs.holder) == ("stairs", "low")
    ends = [(in_map(world, "s") @ pose).translation for pose in stairs.detail.poses]
    assert np.allclose(ends, [[3, 2, 0], [7, 2, 3]])


def test_a_door_may_join_rooms_that_the_map_has(write: Write) -> None:
    drawn = feature(line((4.1, 1), (4.1, 2)), kind="door", name="d", joins="there,lab")
    door = by_name(read_annotation(write(LAB, drawn)))["d"]
    assert door.detail.places == ("there", "lab")
    assert door.pose.apply([[1, 0, 0]])[0] == pytest.approx([3.1, 1.5, 0])


def test_the_rooms_of_the_small_house() -> None:
    world = read_annotation(Path(__file__).parents[2] / "worlds/small_house_rooms.geojson")
    assert (world.skipped, world.notes) == ([], [])
    assert {
        e.name: e.detail.places for e in world.entries if isinstance(e.detail, ConnectorDetail)
    } == {
        "bedroom-door": ("bedroom", "living-room"),
        "kitchen-door": ("living-room", "kitchen"),
        "balcony-opening": ("living-room", "balcony"),
        "front-door": ("kitchen", "outside"),
    }


# What is left out

BOW_TIE = ("Polygon", [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]])
SPIKE = ("Polygon", [[[0, 0], [2, 0], [2, 2], [2, 3], [2, 2], [0, 2], [0, 0]]])
UNUSABLE = [
    (feature(rectangle(0, 0, 0, 5), kind="room", name="bad"), "no area"),
    (feature(("Polygon", [[[0, 0], [1, 1], [2, 2], [0, 0]]]), kind="room", name="bad"), "no area"),
    (feature(BOW_TIE, kind="room", name="bad"), "crosses itself"),
    (feature(("Polygon", [[[0, 0], [1, 1]]]), kind="room", name="bad"), "not a valid Polygon"),
    (feature(("Polygon", [[0, 0], [1, 1]]), kind="room", name="bad"), "nested|position"),
    (feature(("Point", [math.nan, 1]), kind="region", name="bad"), "nan"),
    (feature(("Point", [1, math.inf]), kind="region", name="bad"), "inf"),
    (feature(("Point", [1, 10**400]), kind="region", name="bad"), "1000"),
    (feature(("Point", [1, "2"]), kind="region", name="bad"), "position"),
    (feature(("Point", [499_000.0, 5_400_000.0]), kind="region", name="bad"), "local frame"),
    (feature(("Circle", [1, 2]), kind="region", name="bad"), "Circle"),
    (feature(line((0, 0), (1, 1)), kind="room", name="bad"), "LineString"),
    (feature(rectangle(0, 0, 1, 1), name="bad"), "no kind"),
    (feature(rectangle(0, 0, 1, 1), kind="spaceship", name="bad"), "spaceship"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", ceiling=-1), "ceiling"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", ceiling=5e-9), "ceiling"),
    (feature(rectangle(0, 0, 1, 1), kind="storey", name="bad", height=1e-320), "height"),
    (feature(rectangle(0, 0, 1, 1), kind="object", name="bad", height=1e-9), "no height"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="a\x00b"), "character"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="\ud800"), "character"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", floor="low"), "low"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", ceiling=math.nan), "nan"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", deep={"x": [math.inf]}), "inf"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", note="a\x00b"), "character"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", note="\ud800"), "character"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", elevator="lab"), "is a room"),
    (feature(rectangle(0, 0, 1, 1), kind="room", name="bad", storey="lab"), "is a room"),
    (feature(rectangle(0, 0, 1, 1), kind="region", name="bad", blocked="maybe"), "maybe"),
    (feature(rectangle(0, 0, 1, 1), kind="object", name="bad", height=0), "no height"),
    (feature(("Point", [0, 0]), kind="object", name="bad", holder="nobody"), "nobody"),
    (feature(("Point", [0, 0]), kind="object", name="bad", holder="bad"), "bad"),
    (feature(("Point", [0, 0]), kind="object", name="bad", front="up"), "up"),
    (feature(kind="room", name="outside"), "outside"),
    (feature(line((50, 1), (50, 2)), kind="door", name="bad"), "touches no room"),
    (feature(line((2, 1), (2, 2)), kind="door", name="bad"), "both sides"),
    (feature(line((4.1, 1), (4.1, 1)), kind="door", name="bad"), "no length|no LineString"),
    (feature(("Point", [4.1, 1]), kind="door", name="bad"), "width and heading"),
    (feature(rectangle(4, 1, 4.2, 2), kind="door", name="bad"), "Polygon"),
    (feature(kind="door", name="bad"), "no geometry"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", joins="lab"), "joins lab"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", joins="outside,outside"), "joins"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", joins=[1, 2]), "joins"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", state="ajar"), "ajar"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", direction="forward"), "direction"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", width=-1), "width"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", height=0), "height"),
    (feature(line((4.1, 1), (4.1, 2)), kind="door", name="bad", step=-0.1), "step"),
    (feature(line((1, 1), (2, 2)), type="stairs", name="bad"), "two rooms"),
    ({"type": "Feature", "properties": [], "geometry": None}, "properties"),
    ("scribble", "not a Feature"),
]


@pytest.mark.parametrize(("bad", "problem"), UNUSABLE)
def test_unusable_features_are_left_out_and_named(write: Write, bad: Any, problem: str) -> None:
    world = read_annotation(write(LAB, bad, HALL, DOOR))
    assert sorted(e.name for e in world.entries) == ["door", "hall", "lab"]
    (skipped,) = world.skipped
    assert skipped.element.startswith("features[1]")
    assert "\0" not in skipped.element.encode().decode()
    assert any(p in skipped.problem for p in problem.split("|")), skipped
    assert skipped.fix


def test_a_door_to_a_room_that_is_left_out_is_left_out(write: Write) -> None:
    bad = feature(BOW_TIE, kind="room", name="bad")
    door = feature(line((4.1, 1), (4.1, 2)), kind="door", name="d", joins="lab,bad")
    world = read_annotation(write(LAB, bad, door))
    assert [e.name for e in world.entries] == ["lab"]
    assert [s.element for s in world.skipped] == ["features[1] (bad)", "features[2] (d)"]


def test_a_feature_without_storey_in_a_house_of_two(write: Write) -> None:
    world = read_annotation(
        write(feature(kind="storey", name="a"), feature(kind="storey", name="b"), LAB)
    )
    assert "storey" in world.skipped[0].problem


def test_entities_in_a_cycle_of_holders_are_left_out(write: Write) -> None:
    world = read_annotation(
        write(
            feature(("Point", [0, 0]), type="box", name="a", holder="b"),
            feature(("Point", [0, 0]), type="box", name="b", holder="a"),
            feature(("Point", [0, 0]), type="box", name="c", holder="d"),
            feature(("Point", [1, 0]), type="box", name="d"),
        )
    )
    assert [e.name for e in world.entries] == ["d", "c"]
    assert len(world.skipped) == 2


def test_an_outline_that_can_be_repaired_is_repaired_and_noted(write: Write) -> None:
    world = read_annotation(write(feature(SPIKE, kind="room", name="r")))
    assert placed_outline(world, "r").equals(shapely.box(0, 0, 2, 2))
    assert "repaired" in world.notes[0]


def test_overlapping_rooms_are_noted(write: Write) -> None:
    world = read_annotation(write(LAB, room("twin", 3, 0, 5, 3)))
    assert world.notes == ["lab and twin overlap by 3.00 m2"]


def test_a_crs_is_noted(write: Write) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    assert "CRS" in read_annotation(write(LAB, crs=crs)).notes[0]


def test_a_georeference(write: Write) -> None:
    said = {"crs": 25832, "easting": 4.3e5, "northing": 5.7e6, "height": 60.0, "rotation": 0.1}
    assert read_annotation(write(LAB, georeference=said)).georeference == said
    bad = read_annotation(write(LAB, georeference={"crs": 25832}))
    assert (bad.georeference, bad.skipped[0].element) == (None, "georeference")


# Files that cannot be trusted


@pytest.mark.parametrize(
    ("content", "element"),
    [
        (b'{"type": "FeatureCollection",\n "features": [', "line 2"),
        (b"", "line 1"),
        (b"<gml/>", "line 1"),
        (b"\xff\xfe{", "byte 0"),
        (b"[]", "type"),
        (b'{"type": "Topology", "objects": {}}', "type"),
        (b'{"type": "FeatureCollection", "features": {}}', "features"),
        (b"[" * 100_000, "file"),
        (b'{"type": ' + b"1" * 5000 + b"}", "file"),
    ],
)
def test_files_that_are_not_geojson(tmp_path: Path, content: bytes, element: str) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(content)
    with pytest.raises(WorldError, match=r"plan\.geojson") as caught:
        read_annotation(path)
    assert caught.value.element.startswith(element)
    assert caught.value.fix


def test_files_that_are_not_there_or_something_else(tmp_path: Path) -> None:
    for name in ("absent.geojson", "absent.gpkg", "plan.dxf"):
        with pytest.raises(WorldError, match=name):
            read_annotation(tmp_path / name)


@RELAXED
@given(st.data())
def test_any_damage_is_told(tmp_path: Path, data: st.DataObject) -> None:
    """Some bytes of a good file changed: it is read, or refused as a whole, but never crashes."""
    content = bytearray(OFFICE.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    path = tmp_path / "plan.geojson"
    path.write_bytes(content)
    with contextlib.suppress(WorldError):
        assert_sound(read_annotation(path))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(string.printable, max_size=4),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=6,
)
WORDS = "lab hall door s room region object storey stairs desk outside".split()  # noqa: SIM905
KEYS = (  # noqa: SIM905
    "name kind type storey holder floor ceiling joins state elevator width heading front label "
    "blocked height note"
).split()
COORDINATE = st.integers(-3, 12) | st.floats(-12, 12)
POSITIONS = st.lists(st.lists(COORDINATE, min_size=2, max_size=3), max_size=6)
GEOMETRY = (
    st.none()
    | st.builds(lambda p: {"type": "Polygon", "coordinates": [[*p, *p[:1]]]}, POSITIONS)
    | st.builds(lambda p: {"type": "LineString", "coordinates": p}, POSITIONS)
    | st.builds(lambda p: {"type": "Point", "coordinates": p}, st.lists(COORDINATE, max_size=3))
    | JSON
)
SAID = st.dictionaries(
    st.sampled_from(KEYS), st.sampled_from(WORDS) | COORDINATE | JSON, max_size=6
)


@RELAXED
@given(st.lists(st.tuples(GEOMETRY, SAID), max_size=5))
def test_any_features_are_read_or_left_out(tmp_path: Path, drawn: list[Any]) -> None:
    made = [{"type": "Feature", "geometry": g, "properties": p} for g, p in drawn]
    path = tmp_path / "plan.geojson"
    collection = {"type": "FeatureCollection", "features": [LAB, *made, HALL, DOOR]}
    path.write_text(json.dumps(collection))
    world = read_annotation(path)
    assert_sound(world)
    added = sum("is added" in note for note in world.notes)
    assert len(world.entries) - added + len(world.skipped) == 3 + len(made)


def assert_sound(world: World) -> None:
    """What a map can take: unique names, holders before what they hold, finite numbers."""
    seen: set[str] = set()
    storeys = {e.name for e in world.entries if e.kind == "storey"}
    for entry in world.entries:
        assert entry.name not in seen
        assert entry.name != "outside"
        if entry.holder in {e.name for e in world.entries}:
            assert entry.holder in seen
        assert entry.pose is None or np.isfinite(entry.pose).all()
        json.dumps(entry.properties, allow_nan=False).encode()
        for shape in entry.shapes:
            assert shape.outline is None or shape.outline.is_valid
            assert shape.mesh is None or np.isfinite(shape.mesh.vertices).all()
        if isinstance(entry.detail, ConnectorDetail):
            assert entry.detail.places[0] != "outside"
        seen.add(entry.name)
    assert storeys <= seen


# GeoPackage


def to_geopackage(source: Path, path: Path, layer_of: Callable[[dict[str, Any]], str]) -> None:
    """What QGIS would write: a layer a kind, a column a property, most of them empty."""
    layers: dict[str, list[dict[str, Any]]] = {}
    for drawn in json.loads(source.read_text())["features"]:
        layers.setdefault(layer_of(drawn["properties"]), []).append(drawn)
    for layer, drawn in layers.items():
        fields = sorted({k for d in drawn for k in d["properties"]} - {"kind"})
        columns = [np.array([d["properties"].get(f) for d in drawn], dtype=object) for f in fields]
        shapes = [shapely.geometry.shape(d["geometry"]) for d in drawn]
        pyogrio.raw.write(
            path,
            geometry=shapely.to_wkb(np.array(shapes)),
            field_data=[_column(c) for c in columns],
            fields=fields,
            layer=layer,
            driver="GPKG",
            geometry_type=shapes[0].geom_type,
            crs="EPSG:25832",
            append=path.exists(),
        )


def _column(values: np.ndarray) -> np.ndarray:
    present = [v for v in values if v is not None]
    if all(isinstance(v, int | float) for v in present) and len(present) == len(values):
        return values.astype(bool if isinstance(present[0], bool) else float)
    return values


@pytest.fixture
def geopackage(tmp_path: Path) -> Path:
    path = tmp_path / "office.gpkg"
    layers = {
        "storey": "storeys",
        "elevator": "elevators",
        "room": "rooms",
        "connector": "doors",
        "region": "regions",
    }
    to_geopackage(OFFICE, path, lambda said: layers[said["kind"]])
    return path


def test_a_geopackage_gives_the_same_world_as_geojson(geopackage: Path) -> None:
    drawn, packed = read_annotation(OFFICE), read_annotation(geopackage)
    assert packed.skipped == []
    ours = by_name(packed)
    assert ours.keys() == by_name(drawn).keys()
    for name, entry in by_name(drawn).items():
        twin = ours[name]
        assert (twin.kind, twin.type, twin.label, twin.holder, twin.detail) == (
            entry.kind,
            entry.type,
            entry.label,
            entry.holder,
            entry.detail,
        )
        assert twin.pose == entry.pose
        assert [s.mesh.digest() for s in twin.shapes] == [s.mesh.digest() for s in entry.shapes]


@pytest.mark.parametrize(
    "change",
    [
        'ALTER TABLE "{0}" RENAME TO old; CREATE VIEW "{0}" AS SELECT * FROM old',
        'ALTER TABLE "{0}" ADD COLUMN more AS (zeroblob(1000000000))',
        "ALTER TABLE gpkg_contents RENAME TO old; CREATE VIEW gpkg_contents AS SELECT * FROM old",
        # GDAL reads what is not in gpkg_contents, too.
        'CREATE VIEW bomb AS SELECT * FROM "{0}"',
        "CREATE TABLE bomb (a INTEGER, b AS (zeroblob(1000000000)))",
    ],
)
def test_a_geopackage_computes_nothing(geopackage: Path, change: str) -> None:
    with contextlib.closing(sqlite3.connect(geopackage)) as database:
        (layer,) = database.execute("SELECT table_name FROM gpkg_contents").fetchone()
        database.executescript("PRAGMA legacy_alter_table = ON;" + change.format(layer))
    with pytest.raises(WorldError, match="computed by a query"):
        read_annotation(geopackage)


def test_a_geopackage_has_as_many_features_as_are_read(
    geopackage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SEMMAP_MAX_ELEMENTS", "5")
    with pytest.raises(WorldError, match="the limit is 5"):
        read_annotation(geopackage)


def test_the_crs_and_styles_of_a_geopackage_are_not_features(geopackage: Path) -> None:
    pyogrio.raw.write(
        geopackage,
        geometry=None,
        field_data=[np.array(["<qgis/>"], dtype=object)],
        fields=["styleQML"],
        layer="layer_styles",
        driver="GPKG",
        geometry_type=None,
        append=True,
    )
    world = read_annotation(geopackage)
    assert world.skipped == []
    assert [n for n in world.notes if "CRS" in n] == world.notes


def test_a_table_without_geometry_gives_entries_without(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpkg"
    pyogrio.raw.write(
        path,
        geometry=None,
        fields=["name", "elevation", "seen", "note"],
        layer="storeys",
        field_data=[
            np.array(["s", "t"], dtype=object),
            np.array([3.5, np.nan]),
            np.array(["2025-01-02T03:04", "NaT"], dtype="datetime64[ms]"),
            np.array(['{"a": [1]}', None], dtype=object),
        ],
        driver="GPKG",
        geometry_type=None,
    )
    entries = by_name(read_annotation(path))
    assert (entries["s"].detail, entries["t"].detail) == (
        StoreyDetail(3.5, None),
        StoreyDetail(0.0, None),
    )
    assert entries["s"].properties["note"] == {"a": [1]}
    assert entries["s"].properties["seen"].startswith("2025-01-02T03:04")
    assert entries["t"].properties == {}


def test_unusable_rows_are_named_by_layer_and_row(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpkg"
    shapes = [shapely.box(0, 0, 4, 3), shapely.Polygon(BOW_TIE[1][0])]
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(shapes)),
        fields=["name"],
        layer="rooms",
        field_data=[np.array(["a", "b"], dtype=object)],
        driver="GPKG",
        geometry_type="Polygon",
        crs="EPSG:25832",
    )
    world = read_annotation(path)
    assert [s.element for s in world.skipped] == ["rooms/2 (b)"]


def test_files_that_are_not_geopackages(geopackage: Path) -> None:
    whole = geopackage.read_bytes()
    for content in (
        b"",
        b"PK\x03\x04",
        whole[: len(whole) // 2],
        whole[:1000],
        OFFICE.read_bytes(),
    ):
        geopackage.write_bytes(content)
        with pytest.raises(WorldError, match=r"office\.gpkg: database"):
            read_annotation(geopackage)


MUNICH = Proj("EPSG:32632")
"""UTM by PROJ's own function, not by a transformation as the import has it."""


def outlines(world: World) -> dict[str, shapely.Geometry]:
    """The rooms' outlines in the map's frame."""
    return {
        entry.name: shapely.transform(
            entry.shapes[0].outline,
            lambda xy, pose=entry.pose: pose.apply(np.column_stack([xy, 0 * xy[:, 0]]))[:, :2],
        )
        for entry in world.entries
        if entry.kind == "room"
    }


def test_degrees_become_metres_of_a_georeferenced_frame(write: Write) -> None:
    """A building as GIS exports it, in longitude and latitude; a point alone is no evidence."""
    hall = room("hall", 11.57, 48.14, 11.5705, 48.1402)
    world = read_annotation(write(hall))
    west, south = world.georeference["easting"], world.georeference["northing"]
    corners = [(11.57, 48.14), (11.5705, 48.14), (11.5705, 48.1402), (11.57, 48.1402)]
    expected = shapely.Polygon([np.subtract(MUNICH(*corner), (west, south)) for corner in corners])
    found = outlines(world)["hall"]
    assert found.symmetric_difference(expected).area < 1e-3
    assert 37 < found.bounds[2] - found.bounds[0] < 38  # metres of half a thousandth of a degree
    assert min(found.bounds[:2]) >= 0
    assert (world.georeference["crs"], world.georeference["rotation"]) == (32632, 0.0)
    read_annotation(write(feature(("Point", [0.01, 0.02]), kind="region", name="spot"), LAB))


def test_points_in_degrees_come_into_the_frame_of_a_map_that_is_there(write: Write) -> None:
    easting, northing = MUNICH(11.57, 48.14)
    frame = {"crs": 32632, "easting": easting, "northing": northing, "height": 0, "rotation": 0}
    spots = [
        feature(("Point", [11.57 + at, 48.14]), kind="region", name=f"spot{number}")
        for number, at in enumerate((0.0003, 0.0006))
    ]
    world = read_annotation(write(*spots), georeference=frame)
    found = [entry.pose.translation[:2] for entry in world.entries if entry.name[:4] == "spot"]
    expected = [np.subtract(MUNICH(11.57 + at, 48.14), (easting, northing)) for at in (3e-4, 6e-4)]
    np.testing.assert_allclose(found, expected, atol=1e-3)
    far = feature(("Point", [12.57, 48.14]), kind="region", name="spot")
    (entry,) = read_annotation(write(far), georeference=frame).entries
    assert entry.pose.translation[:2] == pytest.approx((12.57, 48.14)), "metres"


def test_small_things_are_in_metres(write: Write) -> None:
    """As degrees, a mug of 8 cm would be 9 km wide."""
    mugs = [
        feature(
            ("Polygon", [shapely.get_coordinates(shapely.box(x, 3, x + 0.08, 3.08)).tolist()]),
            kind="object",
            type="mug",
            name=f"mug{number}",
            floor=0.75,
            height=0.1,
        )
        for number, x in enumerate((5.0, 5.01))
    ]
    world = read_annotation(write(*mugs))
    assert world.georeference is None
    assert world.entries[-1].pose.translation[0] == pytest.approx(5.05)
    hall = room("hall", 11.57, 48.14, 11.5705, 48.1402)
    desk = shapely.get_coordinates(shapely.box(11.5701, 48.1401, 11.57011, 48.14011)).tolist()
    both = [hall, feature(("Polygon", [desk]), kind="object", type="desk", name="d", height=1)]
    assert read_annotation(write(*both)).georeference is not None


@pytest.mark.parametrize("rotation", [0.0, 0.7, -2.0])
def test_degrees_come_into_the_frame_of_a_map(write: Write, rotation: float) -> None:
    easting, northing = MUNICH(11.57, 48.14)
    frame = {"crs": 32632, "easting": easting, "northing": northing}
    frame |= {"height": 0.0, "rotation": rotation}
    door = feature(
        ("Point", [11.5702, 48.1401]),
        kind="connector",
        name="d",
        heading=0.3,
        width=1.0,
        joins="hall,outside",
    )
    world = read_annotation(
        write(room("hall", 11.57, 48.14, 11.5705, 48.1402), door), georeference=frame
    )
    assert world.georeference is None
    turn = np.array([[np.cos(rotation), -np.sin(rotation)], [np.sin(rotation), np.cos(rotation)]])
    back = shapely.transform(outlines(world)["hall"], lambda xy: xy @ turn.T + (easting, northing))
    corners = [(11.57, 48.14), (11.5705, 48.14), (11.5705, 48.1402), (11.57, 48.1402)]
    expected = shapely.Polygon([MUNICH(*corner) for corner in corners])
    assert back.symmetric_difference(expected).area < 1e-3
    (placed,) = [entry for entry in world.entries if entry.name == "d"]
    assert math.remainder(placed.pose.yaw + rotation - 0.3, math.pi) == pytest.approx(0)


def test_a_layer_of_a_projection_comes_in_with_its_crs(tmp_path: Path) -> None:
    path = tmp_path / "site.gpkg"
    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(shapely.box(691600.5, 5334700, 691608.5, 5334706))], object),
        [np.array(["hall"], object), np.array(["room"], object)],
        ["name", "kind"],
        layer="site",
        geometry_type="Polygon",
        crs="EPSG:25832",
    )
    world = read_annotation(path)
    assert world.georeference["crs"] == 25832
    assert outlines(world)["hall"].equals(shapely.box(0.5, 0, 8.5, 6))


CORNERS = ((0, 0), (5, 0), (5, 4), (0, 4), (0, 0))
"""Of a room, metres to the east and north of its first corner."""


def surveyed(crs: str) -> shapely.Polygon:
    """The room of these corners at 52 degrees north, by geodesics, in the coordinates of a CRS."""
    earth, to_crs = Geod(ellps="WGS84"), Transformer.from_crs(4326, crs, always_xy=True)
    places = []
    for east, north in CORNERS:
        middle = earth.fwd(8.0472, 52.2799, 90, east)[:2]
        places.append(to_crs.transform(*earth.fwd(*middle, 0, north)[:2]))
    return shapely.Polygon(places)


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:3395", "EPSG:3034", "EPSG:6933"])
@pytest.mark.parametrize("ending", [".geojson", ".gpkg"])
def test_a_projection_that_stretches_lengths_is_brought_to_metres(
    ending: str, crs: str, tmp_path: Path
) -> None:
    path = tmp_path / f"site{ending}"
    drawn = np.array([shapely.to_wkb(surveyed(crs))], object)
    pyogrio.raw.write(
        path,
        drawn,
        [np.array(["hall"], object), np.array(["room"], object)],
        ["name", "kind"],
        layer="site",
        geometry_type="Polygon",
        crs=crs,
        driver="GPKG" if ending == ".gpkg" else "GeoJSON",
        layer_options={} if ending == ".gpkg" else {"RFC7946": "NO"},
    )
    world = read_annotation(path)
    assert world.georeference["crs"] == 32632
    room = outlines(world)["hall"]
    lengths = [math.dist(a, b) for a, b in pairwise(shapely.get_coordinates(room))]
    assert sorted(lengths) == pytest.approx([4, 4, 5, 5], rel=2e-3)
    assert any("times those on the ground" in note for note in world.notes)


def test_a_georeference_on_a_grid_that_stretches_lengths_is_one_of_utm(write: Write) -> None:
    """The map's corner stays at its place, and its x axis points to the east."""
    easting, northing = Transformer.from_crs(4326, 3857, always_xy=True).transform(8.0472, 52.2799)
    said = {"crs": 3857, "easting": easting, "northing": northing, "height": 5.0, "rotation": 0.0}
    world = read_annotation(write(room("hall", 0, 0, 5, 4), georeference=said))
    frame = world.georeference
    assert (frame["crs"], frame["height"]) == (32632, 5.0)
    assert outlines(world)["hall"].equals(shapely.box(0, 0, 5, 4))
    back = Transformer.from_crs(32632, 4326, always_xy=True)
    turned = 1e3 * np.array([math.cos(frame["rotation"]), math.sin(frame["rotation"])])
    ends = [(frame["easting"], frame["northing"])]
    ends.append((ends[0][0] + turned[0], ends[0][1] + turned[1]))
    (west, south), (east, north) = (back.transform(*end) for end in ends)
    assert (west, south) == pytest.approx((8.0472, 52.2799), abs=1e-8)
    azimuth, _, away = Geod(ellps="WGS84").inv(west, south, east, north)
    assert (azimuth, away) == pytest.approx((90, 1e3), abs=0.5)


def test_coordinates_that_are_on_no_grid_of_the_earth_are_refused(write: Write) -> None:
    far = room("far", 691600, 5334700, 691610, 5334710)
    (left,) = read_annotation(write(far)).skipped
    assert "too large for a local frame" in left.problem
    with pytest.raises(WorldError, match="beyond UTM"):
        read_annotation(write(room("pole", 10.0, 89.0, 10.01, 89.01)))


@pytest.mark.parametrize(
    ("heights", "given", "noted"),
    [
        ((4.2, 4.2), {}, True),
        ((0.0, 4.2), {}, True),
        ((0.0, 0.0), {}, False),
        ((4.2, 4.2), {"floor": 4.2}, False),
    ],
)
@pytest.mark.parametrize("ending", ["geojson", "gpkg"])
def test_heights_in_coordinates_alone_are_noted(
    tmp_path: Path,
    write: Write,
    ending: str,
    heights: tuple[float, float],
    given: dict[str, float],
    noted: bool,
) -> None:
    low, high = heights
    ring = [[0, 0, low], [5, 0, low], [5, 4, high], [0, 4, high], [0, 0, low]]
    if ending == "geojson":
        path = write(feature(("Polygon", [ring]), kind="room", name="r1", **given), LAB)
    else:
        path = tmp_path / "site.gpkg"
        values = {"kind": "room", "name": "r1", **given}
        pyogrio.raw.write(
            path,
            np.array([shapely.to_wkb(shapely.Polygon(ring), output_dimension=3)], object),
            [np.array([value]) for value in values.values()],
            list(values),
            layer="site",
            geometry_type="Polygon Z",
            crs="EPSG:32632",
        )
    world = read_annotation(path)
    assert by_name(world)["r1"].detail.floor == given.get("floor", 0)
    assert outlines(world)["r1"].equals(shapely.box(0, 0, 5, 4))
    notes = [note for note in world.notes if "heights in coordinates" in note]
    assert [("r1" in note, "give floor" in note) for note in notes] == [(True, True)] * noted
