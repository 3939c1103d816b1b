"""Doors through which nobody gets are refused where they are drawn, and listed where they are."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely

import semmap

ROOMS = {"cella": (0, 0, 4, 4), "aula": (4.2, 0, 9, 3)}


@pytest.fixture
def place(database: str) -> Iterator[semmap.Map]:
    with semmap.connect(database) as db:
        place = db.create_map("doors")
        for name, box in ROOMS.items():
            place.add_room(name, shapely.box(*box))
        yield place


@pytest.mark.parametrize(
    ("rooms", "line", "options", "says"),
    [
        (("cella", "aula"), ((4.1, 1), (4.1, 1.05)), {}, "0.050 m wide, and nobody passes"),
        (("cella", "aula"), ((4.1, 1), (4.1, 2)), {"width": 0.1}, "give its clear width"),
        (("cella", "aula"), ((4.1, 2.6), (4.1, 3.6)), {}, "ends 0.6[0-9] m beside aula"),
        (("cella", None), ((3.7, 4), (4.7, 4)), {}, "ends 0.70 m beside cella"),
        (("cella", "cella"), ((0, 1), (0, 2)), {}, "joins a room with itself, and is not in it"),
    ],
)
def test_a_door_through_which_nobody_gets_is_refused(
    place: semmap.Map, rooms: tuple[str, str], line: object, options: dict[str, float], says: str
) -> None:
    with pytest.raises(ValueError, match=f"^d .*{says}"):
        place.add_door("d", *rooms, line, **options)  # type: ignore[arg-type]
    assert len(place.doors) == 0


def test_doors_are_refused_where_shapely_says_so(place: semmap.Map) -> None:
    draw = random.Random(7)
    outlines = {name: shapely.box(*box) for name, box in ROOMS.items()}
    refused = 0
    for number in range(40):
        y, width = draw.uniform(-0.5, 4), draw.uniform(0.05, 1.5)
        line = shapely.LineString([(4.1, y), (4.1, y + width)])
        posts = shapely.points(line.coords)
        sound = width >= 0.2 and all(
            shapely.dwithin(posts, o, 0.3).all() for o in outlines.values()
        )
        try:
            place.add_door(f"d{number}", "cella", "aula", line.coords[:])
        except ValueError:
            refused += 1
            assert not sound
        else:
            assert sound
    assert 0 < refused < 40
    assert not [each for each in place.check() if each.kind == "no passage"]


def test_a_door_in_a_wall_within_a_room_is_one(place: semmap.Map) -> None:
    place.add_door("hatch", "cella", "cella", ((1.5, 2), (2.5, 2)))
    assert not [each for each in place.check() if each.kind == "no passage"]


def test_a_drawn_door_has_a_width_and_posts_in_the_wall(place: semmap.Map) -> None:
    def draw(y: float, width: float) -> None:
        place.execute(
            "INSERT INTO gis_connector (map, name, width, geom) "
            "VALUES ('doors', 'd', %s, ST_GeomFromText(%s))",
            width,
            f"LINESTRING(3.6 {y}, 4.6 {y})",
        )

    for y, width, says in ((1, 0.05, "nobody passes"), (2.5, 2.0, "beside aula")):
        with pytest.raises(semmap.Error, match=says):
            draw(y, width)
        assert len(place.doors) == 0
    draw(1.0, 0.9)
    with pytest.raises(semmap.Error, match="nobody passes"):
        place.execute("UPDATE gis_connector SET width = 0.1 WHERE name = 'd'")


def test_an_import_says_which_doors_lead_nobody(database: str, tmp_path: Path) -> None:
    rooms = [
        {
            "type": "Feature",
            "properties": {"name": name, "kind": "room"},
            "geometry": shapely.geometry.mapping(shapely.box(*box)),
        }
        for name, box in ROOMS.items()
    ]
    lines = {
        "slit": [(4.1, 1), (4.1, 1.1)],
        "long": [(4.1, 2), (4.1, 3.9)],
        "d": [(4.1, 1), (4.1, 2)],
    }
    doors = [
        {
            "type": "Feature",
            "properties": {"name": name, "kind": "connector", "joins": "cella,aula"},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for name, line in lines.items()
    ]
    path = tmp_path / "doors.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [*rooms, *doors]}))
    with semmap.connect(database) as db:
        summary = db.import_file(path, map="imported")
        assert [note.split(":")[0] for note in summary.notes if note[:4] in ("slit", "long")] == [
            "long ends 0.91 m beside aula, which it joins",
            "slit is 0.100 m wide, and nobody passes less than 0.2 m",
        ]
        found = {each.entities for each in db.map("imported").check() if each.kind == "no passage"}
        assert found == {("slit",), ("long",)}
