"""Buildings for Open-RMF: read back by our importer, and drawn as Shapely measures it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import shapely
import yaml

import semmap
from tests.buildings.building import random_building
from tests.buildings.judges import stored
from tests.conftest import Import, MakeDatabase
from tests.worlds.conftest import HOTEL

DOORWAY = 0.4
"""Metres from the line of a door within which half its doorway becomes a part of a room."""


def check_rooms(before: semmap.Map, after: semmap.Map, file: Path) -> None:
    """Rooms, doors and lifts are those of the map; no wall stands in a doorway."""
    summary = after.import_file(before.export(file))
    assert summary.skipped == []
    storeys = [{s.name: s.pose.z for s in place.storeys} for place in (before, after)]
    assert storeys[0] == pytest.approx(storeys[1])
    cabins = {row[0] for row in before.sql(CABINS)}
    rooms = {room.name: room for room in before.rooms if room.name not in cabins}
    for name, room in rooms.items():
        back, doorways = after[name].geometry, shapely.union_all([d.geometry for d in before.doors])
        assert room.geometry.difference(back).area < 0.01, name
        added = back.difference(room.geometry).difference(doorways.buffer(DOORWAY))
        assert added.area < 0.01, name
        assert after[name].storey.name == room.storey.name
    for name in cabins:
        outline = before.rooms[name].geometry
        assert max(_shared(outline, room.geometry) for room in after.rooms) > 0.99, name
    assert len(after.rooms) == len(before.rooms)
    assert Counter(joins(before)) == Counter(joins(after))
    drawn = yaml.safe_load(file.read_text())["levels"]
    for name, level in drawn.items():
        points = [v[:2] for v in level["vertices"]]
        walls = shapely.union_all(
            [shapely.LineString([points[a], points[b]]) for a, b, _ in level["walls"]]
        )
        for door in before.doors:
            here = door.storey and door.storey.name == name and door.form == "door"
            if here and door.geometry is not None:
                middle = shapely.line_interpolate_point(door.geometry, 0.5, normalized=True)
                assert walls.distance(middle) > 0.3, door.name


def _shared(one: shapely.Geometry, two: shapely.Geometry) -> float:
    """The part of the area of both that is of each."""
    return float(one.intersection(two).area / one.union(two).area)


CABINS = (
    "SELECT e.name FROM room r JOIN entity e ON e.id = r.entity_id "
    "WHERE e.map_id = current_map() AND r.elevator_id IS NOT NULL"
)


def joins(place: semmap.Map) -> list[tuple[str, ...]]:
    """The rooms that doors and openings of a storey join; cabins by their lift and storey."""
    cabins = {
        row[0]: f"{row[1]} {row[2]}"
        for row in place.sql(
            "SELECT e.name, l.name, s.name FROM room r JOIN entity e ON e.id = r.entity_id "
            "JOIN entity l ON l.id = r.elevator_id JOIN world w ON w.entity_id = e.id "
            "JOIN entity s ON s.id = w.storey_id WHERE e.map_id = current_map()"
        )
    }
    return [
        tuple(sorted(cabins.get(p.name, p.name) if p else "outside" for p in door.places))
        for door in place.doors
        if door.form in ("door", "elevator_door")
        and not (door.type == "opening" and None in door.places)  # of which it has none
    ]


@pytest.mark.parametrize("seed", [2, 3, 112])
def test_random_buildings(seed: int, make_database: MakeDatabase, tmp_path: Path) -> None:
    url = make_database().render_as_string(hide_password=False)
    with stored(random_building(seed), url, tmp_path) as place:
        again = place.database.create_map("again")
        check_rooms(place, again, tmp_path / f"b{seed}.building.yaml")


def test_the_hotel(imported: Import, worlds: Path, tmp_path: Path) -> None:
    with (
        imported((worlds / HOTEL, "hotel")) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        before, after = db.map("hotel"), db.create_map("again")
        check_rooms(before, after, tmp_path / "hotel.building.yaml")
        lanes = [
            {
                (row[0], row[1]): (row[2], row[3])
                for row in place.sql(
                    "SELECT a.name, b.name, l.properties->'bidirectional', l.properties->'graphs' "
                    "FROM link l JOIN entity a ON a.id = l.from_id JOIN entity b ON b.id = l.to_id "
                    "WHERE a.map_id = current_map() AND l.relation = 'lane'"
                )
            }
            for place in (before, after)
        ]
        assert len(lanes[0]) > 80
        assert sorted(map(str, lanes[0].values())) == sorted(map(str, lanes[1].values()))
        types = [Counter(e.type for e in place.regions) for place in (before, after)]
        assert types[0] == types[1]


def drawn(features: list[tuple[dict[str, Any], Any]], file: Path) -> Path:
    """A GeoJSON file of properties and geometries."""
    found = [
        {"type": "Feature", "properties": p, "geometry": g and shapely.geometry.mapping(g)}
        for p, g in features
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": found}))
    return file


def test_an_object_without_a_type_comes_back_without_one(database: str, tmp_path: Path) -> None:
    about = {"kind": "object", "storey": "F1"}
    features = [
        ({"kind": "storey", "name": "F1", "elevation": 0}, None),
        ({"kind": "room", "name": "hall", "storey": "F1"}, shapely.box(0, 0, 5, 5)),
        ({**about, "name": "gizmo one", "height": 1.0}, shapely.box(1, 1, 2, 2)),
        ({**about, "name": "gizmo two", "type": "table", "height": 1.0}, shapely.box(3, 1, 4, 2)),
    ]
    file = drawn(features, tmp_path / "plan.geojson")
    with semmap.connect(database) as db:
        before, after = db.create_map("plan"), db.create_map("again")
        before.import_file(file)
        after.import_file(before.export(tmp_path / "plan.building.yaml"))
        types = {o.name: o.type for o in after.objects}
        assert (types["gizmo one"], types["gizmo two"]) == (None, "table")


def test_names_of_objects_come_back_whole(database: str, tmp_path: Path) -> None:
    """Slashes are those of the object's own name; of a model they part it from its owner."""
    names = ["Tisch 'gro\u00df'/1", "a/b/c", "/", "Desk", "OpenRobotics", "Owner/Desk"]
    with semmap.connect(database) as db:
        before, after = db.create_map("plan"), db.create_map("again")
        before.add_room("hall", shapely.box(0, 0, 9, 5))
        for number, name in enumerate(names):
            model = {"model": "OpenRobotics/Desk"} if number > 2 else {}
            pose, size = (1 + number, 2, 0), (0.5, 0.5, 0.5)
            before.add_object(name, type="desk", size=size, pose=pose, properties=model)
        after.import_file(before.export(tmp_path / "plan.building.yaml"))
        back = {o.name: o.type for o in after.objects if not o.name.startswith("walls-")}
        assert back == dict.fromkeys(names, "desk")


def test_what_has_no_storey_is_on_the_level_below_it(database: str, tmp_path: Path) -> None:
    square = shapely.box(0, 0, 4, 4)
    features = [
        ({"kind": "storey", "name": "low", "elevation": 0}, None),
        ({"kind": "storey", "name": "high", "elevation": 3}, None),
        ({"kind": "room", "name": "hall", "storey": "low", "ceiling": 2.7}, square),
        ({"kind": "room", "name": "attic", "floor": 4.2, "ceiling": 6.7}, square),
        ({"kind": "room", "name": "annex", "floor": 1, "ceiling": 2.7}, shapely.box(5, 0, 9, 4)),
    ]
    file = drawn(features, tmp_path / "tower.geojson")
    with semmap.connect(database) as db:
        tower = db.create_map("tower")
        tower.import_file(file)
        tower.add_object("bed", type="bed", size=(2, 1, 0.5), pose=(2, 2, 4.2))
        assert tower["attic"].storey is tower["annex"].storey is None
        written = yaml.safe_load(tower.export(tmp_path / "tower.building.yaml").read_text())
    named = {n: {v[3] for v in level["vertices"]} for n, level in written["levels"].items()}
    assert named["low"] >= {"hall", "annex"}
    assert named["high"] >= {"attic"}
    assert [model["name"] for model in written["levels"]["high"]["models"]] == ["bed"]
