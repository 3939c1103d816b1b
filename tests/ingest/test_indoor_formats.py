"""IMDF archives and OpenStreetMap's indoor tags: rooms, doors and levels where pyproj puts them."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import Transformer

import semmap
from planner.route import NoRouteError
from semmap.ingest.importer import read_world
from semmap.ingest.world import OUTSIDE, World, WorldError

PLACE = np.array([691600.0, 5334700.0])
"""A place on the grid of EPSG:32632."""

TO_DEGREES = Transformer.from_crs(32632, 4326, always_xy=True)


def degrees(shape: shapely.Geometry) -> dict[str, Any]:
    """A shape in metres from a place of the grid, in longitude and latitude."""
    moved = shapely.transform(
        shape, lambda p: np.column_stack(TO_DEGREES.transform(*(p + PLACE).T))
    )
    return shapely.geometry.mapping(moved)


def feature(shape: shapely.Geometry | None, properties: dict[str, Any], **members: Any) -> Any:
    geometry = None if shape is None else degrees(shape)
    return {"type": "Feature", "geometry": geometry, "properties": properties, **members}


LAB, HALL, UPPER = shapely.box(0, 0, 4, 3), shapely.box(4.1, 0, 9, 3), shapely.box(0, 0, 9, 3)
DOOR = shapely.LineString([(4.05, 1), (4.05, 2)])


def imdf() -> dict[str, Any]:
    """The files of an archive of two levels."""

    def on(level: int, type_: str, id_: str, shape: Any, **properties: Any) -> Any:
        given = {"level_id": f"level{level}", "restriction": None, **properties}
        return feature(shape, given, id=id_, feature_type=type_)

    def level(number: int, shape: Any) -> Any:
        about = {"ordinal": number, "short_name": {"en": f"{number}F"}, "name": None}
        return feature(shape, about, id=f"level{number}", feature_type="level")

    def amenity(id_: str, shape: Any, name: Any, *units: str) -> Any:
        """In units, on the levels of these: OGC 20-094 gives an amenity no level_id."""
        about = {"category": "atm", "name": name, "unit_ids": [*units], "address_id": None}
        return feature(shape, about, id=id_, feature_type="amenity")

    named = {"name": {"en": "Museum", "de": "Haus"}}
    files: dict[str, list[Any]] = {
        "venue": [feature(UPPER, named, id="v", feature_type="venue")],
        "level": [level(0, UPPER), level(1, UPPER)],
        "unit": [
            on(0, "unit", "u1", LAB, category="laboratory", name={"en": "Lab 1"}),
            on(0, "unit", "u2", HALL, category="walkway", name=None),
            on(1, "unit", "u3", UPPER, category="restroom.female", name={"en": "wc"}),
            on(1, "unit", "u4", shapely.box(2, 2, 3, 2.5), category="column", name=None),
            on(1, "unit", "u5", shapely.box(5, 1, 6, 2), category="opentobelow", name=None),
        ],
        "opening": [
            on(
                0,
                "opening",
                "o1",
                DOOR,
                category="pedestrian",
                door={"type": "sliding"},
            ),
            on(
                0,
                "opening",
                "o2",
                shapely.LineString([(9, 1), (9, 2)]),
                door=None,
                name={"en": "x"},
                access_control=["badgereader", "outofservice"],
            ),
        ],
        "fixture": [on(0, "fixture", "f", shapely.box(1, 1, 2, 2), category="desk", name=None)],
        "amenity": [
            amenity("a", shapely.Point(6, 1), {"en": "ATM"}, "u2"),
            amenity("b", shapely.Point(6, 2), {"en": "Escape chute"}, "u2", "u3", "unknown"),
        ],
        "anchor": [feature(shapely.Point(1, 1), {"unit_id": "u1"}, id="n", feature_type="anchor")],
        "occupant": [
            feature(
                None,
                {"name": {"en": "Chemistry"}, "anchor_id": "n"},
                id="c",
                feature_type="occupant",
            )
        ],
    }
    return {
        name: {"type": "FeatureCollection", "name": name, "features": features}
        for name, features in files.items()
    }


def write_zip(path: Path, files: dict[str, Any]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("manifest.json", json.dumps({"version": "1.0.0", "language": "en"}))
        for name, root in files.items():
            archive.writestr(f"{name}.geojson", json.dumps(root))
    return path


def write_folder(path: Path, files: dict[str, Any]) -> Path:
    folder = path.with_suffix("")
    folder.mkdir()
    for name, root in files.items():
        (folder / f"{name}.geojson").write_text(json.dumps(root))
    return folder


def on_grid(world: World, name: str) -> shapely.Geometry:
    """The outline of an entry, by its pose, in metres from the place of the grid."""
    entry = next(e for e in world.entries if e.name == name)
    origin = np.array([world.georeference["easting"], world.georeference["northing"]])
    shift = np.array([entry.pose.x, entry.pose.y]) + origin - PLACE
    return shapely.transform(entry.shapes[0].outline, lambda p: p + shift)


@pytest.mark.parametrize("write", [write_zip, write_folder])
def test_imdf(write: Callable[..., Path], tmp_path: Path) -> None:
    world = read_world(write(tmp_path / "museum.zip", imdf()))
    assert world.skipped == []
    assert world.name == "Museum"
    entries = {entry.name: entry for entry in world.entries}
    storeys = {e.name: e.detail.elevation for e in world.entries if e.kind == "storey"}
    assert storeys == {"0F": 0, "1F": 3}
    rooms = {e.name: (e.type, e.holder) for e in world.entries if e.kind == "room"}
    assert rooms == {
        "Lab 1": ("lab", "0F"),
        "corridor1": ("corridor", "0F"),
        "wc": ("restroom", "1F"),
    }
    assert entries["Lab 1"].label == "Chemistry"
    assert shapely.symmetric_difference(on_grid(world, "Lab 1"), LAB).area < 1e-5
    doors = {e.type: e.detail.places for e in world.entries if e.kind == "connector"}
    assert doors == {"sliding_door": ("Lab 1", "corridor1"), "opening": ("corridor1", OUTSIDE)}
    states = {
        e.type: (e.detail.state, e.detail.permissions) for e in entries.values() if e.type in doors
    }
    assert states == {"sliding_door": ("open", ()), "opening": ("locked", ("badgereader",))}
    (desk,) = (e for e in world.entries if e.type == "desk")
    assert np.ptp(desk.shapes[0].mesh.vertices[:, 2]) == pytest.approx(1.0)
    regions = {e.name: e.holder for e in world.entries if e.kind == "region"}
    assert regions == {"ATM": "corridor1", "Escape chute": "corridor1", "Escape chute_2": "wc"}
    assert any("IMDF has no heights" in note for note in world.notes)


def osm() -> dict[str, Any]:
    """Rooms on two levels with stairs and an elevator between them."""
    return {
        "type": "FeatureCollection",
        "features": [
            feature(LAB, {"indoor": "room", "name": "lab", "room": "laboratory", "level": "0"}),
            feature(HALL, {"indoor": "corridor", "level": "0;1", "ref": "c"}),
            feature(shapely.box(0, 3, 2, 6), {"indoor": "room", "stairs": "yes", "level": "0-1"}),
            feature(
                shapely.box(4, 3, 6, 5),
                {"indoor": "room", "highway": "elevator", "level": "0-1", "name": "e"},
            ),
            feature(shapely.Point(4.05, 1.5), {"door": "hinged", "level": "0", "width": "1.2"}),
            feature(shapely.LineString([(0, 0), (4, 0)]), {"indoor": "wall", "level": "0"}),
            feature(shapely.Point(1, 1), {"amenity": "vending_machine", "level": "0"}),
        ],
    }


def test_osm_indoor(tmp_path: Path) -> None:
    path = tmp_path / "house.geojson"
    path.write_text(json.dumps(osm()))
    world = read_world(path)
    assert world.skipped == []
    entries = {entry.name: entry for entry in world.entries}
    storeys = {e.name: e.detail.elevation for e in world.entries if e.kind == "storey"}
    assert storeys == {"level 0": 0, "level 1": 3}
    rooms = {e.name: (e.type, e.holder) for e in world.entries if e.kind == "room"}
    assert rooms == {
        "lab": ("lab", "level 0"),
        "c 0": ("corridor", "level 0"),
        "c 1": ("corridor", "level 1"),
        "room 0": ("stairwell", "level 0"),
        "room 1": ("stairwell", "level 1"),
        "e 0": ("elevator_cabin", "level 0"),
        "e 1": ("elevator_cabin", "level 1"),
    }
    assert entries["e 0"].detail.elevator == entries["e 1"].detail.elevator == "e lift"
    (door,) = (e for e in world.entries if e.type == "door")
    assert (door.detail.places, door.detail.width) == (("lab", "c 0"), pytest.approx(1.2))
    (stairs,) = (e for e in world.entries if e.type == "stairs")
    assert stairs.detail.places == ("room 0", "room 1")
    assert stairs.detail.poses[1].z == pytest.approx(3)
    assert shapely.symmetric_difference(on_grid(world, "lab"), LAB).area < 1e-5
    (wall,) = (e for e in world.entries if e.type == "wall")
    assert wall.shapes[0].outline.area == pytest.approx(0.4, rel=1e-3)


@pytest.mark.parametrize(
    ("width", "metres"),
    [
        ("1.2", 1.2),
        ("90 cm", 0.9),
        ("3'", 0.9144),
        ("2'11\"", 0.889),
        ('36"', 0.9144),
        ("wide", None),
    ],
)
def test_doors_of_osm_have_widths_and_locks(tmp_path: Path, width: str, metres: float) -> None:
    made = osm()
    made["features"][4]["properties"] |= {"width": width, "locked": "yes"}
    path = tmp_path / "house.geojson"
    path.write_text(json.dumps(made))
    world = read_world(path)
    doors = [e.detail for e in world.entries if e.type == "door"]
    if metres is None:
        assert (doors, [each.problem for each in world.skipped]) == ([], ["its width is 'wide'"])
    else:
        assert [(d.state, d.width) for d in doors] == [("locked", pytest.approx(metres))]


@pytest.mark.parametrize(
    ("height", "metres"),
    [("2.8", 2.8), (2.8, 2.8), ("2.8 m", 2.8), ("9'2\"", 2.794), ("high", None), (None, None)],
)
def test_a_room_of_osm_has_its_height(tmp_path: Path, height: Any, metres: float | None) -> None:
    """On each of its levels, 3 m apart; a shaft states the height of all of its levels."""
    made = osm()
    for number in (0, 1, 2):
        made["features"][number]["properties"]["height"] = height
    path = tmp_path / "house.geojson"
    path.write_text(json.dumps(made))
    world = read_world(path)
    assert world.skipped == []
    rooms = {e.name: e for e in world.entries if e.kind == "room"}
    for name in ("lab", "c 0", "c 1"):
        assert rooms[name].detail.ceiling == pytest.approx(metres)
        top = 2.5 if metres is None else metres
        assert np.ptp(rooms[name].shapes[0].mesh.vertices[:, 2]) == pytest.approx(top)
    assert rooms["room 0"].detail.ceiling is None
    assert sum("its height is 'high'" in note for note in world.notes) == 2 * (height == "high")


@pytest.mark.parametrize(
    ("access", "needed"),
    [("private", ("private",)), ("no", ("private",)), ("yes", ()), ("customers", ()), (None, ())],
)
def test_a_private_door_of_osm_needs_a_permission(
    tmp_path: Path, access: str | None, needed: tuple[str, ...]
) -> None:
    made = osm()
    made["features"][4]["properties"]["access"] = access
    path = tmp_path / "house.geojson"
    path.write_text(json.dumps(made))
    (door,) = (e.detail for e in read_world(path).entries if e.type == "door")
    assert (door.permissions, door.state) == (needed, "open")


def whole_zip(tmp_path: Path) -> bytes:
    return write_zip(tmp_path / "whole.zip", imdf()).read_bytes()


def test_damaged_archives_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, path = whole_zip(tmp_path), tmp_path / "case.zip"
    for bad in (b"", data[:500], data[: len(data) // 2], b"PK\3\4" + b"x" * 90):
        path.write_bytes(bad)
        with pytest.raises(WorldError, match="is not a readable archive"):
            read_world(path)
    write_zip(path, {"unit": imdf()["unit"]})
    with pytest.raises(WorldError, match="has no levels"):
        read_world(path)
    path.write_bytes(data)
    monkeypatch.setenv("SEMMAP_MAX_TEXT_BYTES", "2000")
    with pytest.raises(WorldError, match="the limit is"):
        read_world(path)


def test_what_is_wrong_is_left_out_and_named(tmp_path: Path) -> None:
    """A unit far from the building, levels that are words, and a door without rooms."""
    files = imdf()
    files["unit"]["features"][1]["properties"]["name"] = {"en": "Corridor"}
    files["unit"]["features"][1]["geometry"]["coordinates"] = [[[0, 0], [4e9, 0], [4e9, 3], [0, 0]]]
    world = read_world(write_zip(tmp_path / "far.zip", files))
    assert any("too large" in each.problem for each in world.skipped)
    lost, *_ = world.skipped
    assert lost.element == "features[1] (Corridor)"
    assert shapely.symmetric_difference(on_grid(world, "Lab 1"), LAB).area < 1e-5
    given = osm()
    given["features"][0]["properties"]["level"] = "ground"
    given["features"].append(feature(shapely.Point(1, 1), {"door": "yes", "level": "7"}))
    path = tmp_path / "words.geojson"
    path.write_text(json.dumps(given))
    problems = [each.problem for each in read_world(path).skipped]
    assert "its level is 'ground'" in problems
    assert "is a door on a level without rooms" in problems


@pytest.mark.parametrize("write", [write_zip, write_folder])
def test_an_archive_becomes_a_map(
    write: Callable[..., Path], database: str, tmp_path: Path
) -> None:
    """From a file or folder to a map with a georeference, in which robots find their way."""
    with semmap.connect(database) as db:
        path = write(tmp_path / "museum.zip", imdf())
        assert db.import_file(path).skipped == []
        place = db.map("Museum")
        assert place.route("Lab 1", "corridor1").places == ["Lab 1", "corridor1"]
        (row,) = place.sql("SELECT crs FROM map WHERE id = current_map()")
        assert row[0] == 32632
        assert db.import_file(path).changed == 0


UPSTAIRS = {
    "passage": shapely.box(0, 0, 10, 3),
    "stairs": shapely.box(0, 3, 2, 7),
    "lift": shapely.box(8, 3, 10, 5),
    "lab": shapely.box(4, 3, 7, 6),
    "yard": shapely.box(0, -3, 10, 0),
}
"""A passage, stairs and a lift on two levels, a lab above; below a yard with an escalator."""

WAYS_UP = {"elevator_door", "escalator", "stairs"}

UP = shapely.LineString([(5, -1), (5, 2)])
DOORS = {
    name: shapely.LineString([(x, 3), (x + 1, 3)]) for name, x in (("stairs", 0.5), ("lift", 8.5))
}
LAB_DOOR = shapely.LineString([(5, 3), (6, 3)])


def two_levels_of_osm(path: Path) -> Path:
    drawn = UPSTAIRS
    node = {name: line.centroid for name, line in DOORS.items()}
    features = [
        feature(drawn["passage"], {"indoor": "corridor", "level": "0;1", "name": "passage"}),
        feature(drawn["yard"], {"indoor": "area", "level": "0", "name": "yard"}),
        feature(drawn["lab"], {"indoor": "room", "level": "1", "name": "lab"}),
        feature(
            drawn["stairs"],
            {"indoor": "room", "stairs": "yes", "level": "0", "repeat_on": "1", "name": "stairs"},
        ),
        feature(drawn["lift"], {"highway": "elevator", "level": "0-1", "name": "lift"}),
        feature(node["stairs"], {"door": "yes", "level": "0;1"}),
        feature(node["lift"], {"door": "sliding", "level": "0;1"}),
        feature(LAB_DOOR.centroid, {"door": "yes", "level": "1"}),
        feature(
            UP.reverse(),
            {"highway": "steps", "incline": "down", "conveying": "backward", "level": "0;1"},
        ),
        feature(shapely.Point(3, 1), {"highway": "elevator", "level": "0-1", "name": "node"}),
    ]
    path.with_suffix(".geojson").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    return path.with_suffix(".geojson")


def two_levels_of_imdf(path: Path) -> Path:
    files: dict[str, list[Any]] = {"level": [], "unit": [], "opening": [], "relationship": []}
    categories = {"passage": "walkway", "lab": "laboratory", "lift": "elevator"}
    on = {"yard": (), "lab": (1,)}

    def add(file: str, id_: str, level: int | None, shape: Any, **about: Any) -> None:
        about |= {} if level is None else {"level_id": f"level{level}"}
        files[file].append(feature(shape, about, id=id_, feature_type=file))

    for level in (0, 1):
        label = {"en": f"{level}F"}
        add("level", f"level{level}", None, UPSTAIRS["passage"], ordinal=level, short_name=label)
        for name, shape in UPSTAIRS.items():
            if level in on.get(name, (0, 1)):
                category, label = categories.get(name, name), {"en": name}
                add("unit", f"{name}{level}", level, shape, category=category, name=label)
        for name, line in DOORS.items():
            add("opening", f"{name} door{level}", level, line, door={"type": "sliding"})
    foot = shapely.box(4, -2.5, 5.5, -0.2)
    add("unit", "yard0", 0, UPSTAIRS["yard"] - foot, category="courtyard", name={"en": "yard"})
    add("unit", "escalator", 0, foot, category="escalator", name=None)
    add("opening", "lab door", 1, LAB_DOOR, door=None)
    add("opening", "foot", 0, shapely.LineString([(4, -2.5), (5.5, -2.5)]), door=None)
    add("opening", "gate", 0, shapely.LineString([(1, 0), (2, 0)]), door=None)
    ends = [{"id": id_, "feature_type": "unit"} for id_ in ("escalator", "passage1")]
    about = {"category": "escalator", "direction": "directed", "intermediary": None}
    add("relationship", "r", None, None, origin=ends[0], destination=ends[1], **about)
    return write_zip(
        path.with_suffix(".zip"),
        {
            name: {"type": "FeatureCollection", "name": name, "features": features}
            for name, features in files.items()
        },
    )


@pytest.mark.parametrize("write", [two_levels_of_osm, two_levels_of_imdf])
def test_stairs_lifts_and_escalators_join_levels(
    write: Callable[[Path], Path], database: str, tmp_path: Path
) -> None:
    """Each way is taken where the others are avoided, up and, but for the escalator, down."""
    with semmap.connect(database) as db:
        summary = db.import_file(write(tmp_path / "house"), map="house")
        assert summary.skipped == []
        house = db.map("house")
        ways = {e.name: e.type for e in house.doors if e.type in WAYS_UP}
        assert set(ways.values()) == WAYS_UP
        up, down = ("yard", "lab"), ("lab", "yard")
        for way, ends in [(w, up) for w in WAYS_UP] + [("stairs", down), ("elevator_door", down)]:
            others = [name for name, type_ in ways.items() if type_ != way]
            steps = house.route(*ends, avoid=others).steps
            taken = [step.connector.name for step in steps if step.connector]
            assert way in {ways.get(name) for name in taken}
        others = [name for name, type_ in ways.items() if type_ != "escalator"]
        with pytest.raises(NoRouteError):
            house.route(*down, avoid=others)


def test_a_lift_that_is_a_node_gets_a_cabin_and_a_door_on_each_level(
    database: str, tmp_path: Path
) -> None:
    with semmap.connect(database) as db:
        file = two_levels_of_osm(tmp_path / "house")
        summary = db.import_file(file, map="house")
        house = db.map("house")
        assert [note for note in summary.notes if "is a node: its cabin is assumed 1.6 m" in note]
        assert {house[f"node {n}"].type for n in (0, 1)} == {"elevator_cabin"}
        assert house["node 0"].geometry.area == pytest.approx(1.6**2, rel=1e-3)
        for room in (house["passage 0"], house["passage 1"]):
            assert room.geometry.area == pytest.approx(30 - 1.6**2, rel=1e-3)
        others = [
            door.name
            for door in house.doors
            if door.type in WAYS_UP and not any(p and "node" in p.name for p in door.places)
        ]
        route = house.route("yard", "lab", avoid=others)
        assert route.places[1:5] == ["passage 0", "node 0", "node 1", "passage 1"]

        features = json.loads(file.read_text())
        node = features["features"][-1]
        for at, problem in (
            (shapely.Point(30, 1), "is a lift beside no room of its levels"),
            (shapely.Point(1, 5), "is a lift in a room of its size"),
        ):
            node["geometry"] = degrees(at)
            features["features"][3]["geometry"] = degrees(shapely.box(0, 4, 2, 6))
            file.write_text(json.dumps(features))
            (skipped,) = db.import_file(file, map=problem).skipped
            assert skipped.problem == problem

        node["geometry"] = degrees(shapely.Point(3, 1))
        node["properties"]["level"] = "-1;0;1"  # no room is drawn below
        file.write_text(json.dumps(features))
        summary = db.import_file(file, map="cellar")
        assert [note for note in summary.notes if "no room of level -1: it does not stop" in note]
        assert summary.skipped == []
        cabins = {r.name for r in db.map("cellar").rooms if r.type == "elevator_cabin"}
        assert {name for name in cabins if name.startswith("node")} == {"node 0", "node 1"}
        node["properties"]["level"] = "0;1"
        bow = shapely.Polygon([(20, 0), (24, 4), (24, 0), (20, 4)])
        features["features"][2]["geometry"] = degrees(bow)
        node["geometry"] = degrees(shapely.Point(3, 1))
        file.write_text(json.dumps(features))
        assert [s.element for s in db.import_file(file, map="bow").skipped] == ["features[2] (lab)"]


def at_place(longitude: float, latitude: float, swapped: bool = False) -> list[dict[str, Any]]:
    """Two rooms of some metres at a place on the earth, or with latitude first."""
    made = []
    for number in range(2):
        west, south = longitude + 5e-5 * (number - 1), latitude
        room = shapely.box(west, south, west + 4e-5, south + 4e-5)
        if swapped:
            room = shapely.transform(room, lambda points: points[:, ::-1])
        geometry = shapely.geometry.mapping(room)
        tags = {"indoor": "room", "level": "0", "room": "office", "name": f"room {number}"}
        made.append({"type": "Feature", "properties": tags, "geometry": geometry})
    return made


def large(longitude: float, latitude: float) -> dict[str, Any]:
    around = shapely.Point(longitude, latitude).buffer(0.2)
    tags = {"indoor": "level", "level": "0"}
    return {
        "type": "Feature",
        "properties": tags,
        "geometry": shapely.geometry.mapping(around),
    }


@pytest.mark.parametrize(
    ("features", "problem"),
    [
        (at_place(151.2, -33.9, swapped=True), "in degrees, but a latitude is 151.2"),
        ([*at_place(151.2, -33.9), large(151.2, -33.9)], r"0\.4 degrees across; .*features\[2\]"),
        (at_place(-180, -16.5) + at_place(179.9999, -16.5), "both sides of 180 degrees"),
    ],
)
def test_degrees_that_cannot_be_brought_into_a_frame_are_refused_as_such(
    features: list[dict[str, Any]], problem: str, tmp_path: Path, database: str
) -> None:
    file = tmp_path / "degrees.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with semmap.connect(database) as db:
        with pytest.raises(WorldError, match=problem):
            db.import_file(file, map="nowhere")
        assert "nowhere" not in db.maps


OSM_ROOMS = {
    ("room", "toilet"): "restroom",
    ("room", "toilets"): "restroom",
    ("amenity", "toilets"): "restroom",
    ("room", "conference"): "meeting_room",
    ("room", "waiting"): "waiting_room",
    ("room", "laundry"): "laundry_room",
    ("room", "office"): "office",
    ("room", "nothing_known"): None,
}


def test_rooms_of_osm_have_the_types_of_their_uses(tmp_path: Path) -> None:
    features = []
    for number, (key, value) in enumerate(OSM_ROOMS):
        (room, _) = at_place(11.6 + 1e-4 * number, 48.1)
        room["properties"] = {"indoor": "room", "level": "0", key: value, "name": f"{number}"}
        features.append(room)
    file = tmp_path / "uses.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    rooms = {e.name: e.type for e in read_world(file).entries if e.kind == "room"}
    assert rooms == {f"{n}": type_ for n, type_ in enumerate(OSM_ROOMS.values())}
