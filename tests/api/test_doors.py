"""Doors through which nobody gets are refused where they are drawn, and listed where they are."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
import shapely
import shapely.affinity

import semmap
from navgrid.found_rooms import FoundDoorway, FoundRoom, FoundRooms
from semmap.api.additions import add_found_rooms

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
        (("cella", None), ((1.5, 2), (2.5, 2)), {}, "leads outside, but cella is on both sides"),
        (("cella", None), ((4.05, 1), (4.05, 2)), {}, "leads outside, but aula is on its other"),
        (
            ("cella", "aula"),
            ((4.1, 1), (4.1, 1.6)),
            {"width": 3.0},
            "3 m wide, but its line is 0.60",
        ),
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
    doors[2]["properties"]["width"] = 1.05  # type: ignore[index]
    doors.append(json.loads(json.dumps(doors[2])))
    doors[3]["properties"] |= {"name": "torn", "width": 3.0}  # type: ignore[operator]
    path = tmp_path / "doors.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [*rooms, *doors]}))
    with semmap.connect(database) as db:
        summary = db.import_file(path, map="imported")
        assert [note.split(":")[1] for note in summary.notes if note.startswith("error: ")] == [
            " long ends 0.91 m beside aula, which it joins",
            " slit is 0.100 m wide, and nobody passes less than 0.2 m",
        ]
        assert [s.problem for s in summary.skipped] == [
            "its width is 3 m, but its line is 1.00 m long"
        ]
        found = {each.entities for each in db.map("imported").check() if each.kind == "no passage"}
        assert found == {("slit",), ("long",)}


def two_rooms(place: semmap.Map, wall: float, turn: float) -> shapely.LineString:
    """Add rooms to both sides of a wall; return the line through it, x from 0 to its thickness."""
    for name, (low, high) in {"one": (-4, 0), "other": (wall, wall + 4)}.items():
        outline = shapely.affinity.rotate(shapely.box(low, 20, high, 24), turn, origin=(0, 20))
        place.add_room(name, outline)
    return shapely.affinity.rotate(shapely.LineString([(0, 22), (wall, 22)]), turn, origin=(0, 20))


def across(wall: shapely.LineString, part: float, along: float = 0.0) -> list[tuple[float, float]]:
    """A line of 1 m through a part of a wall, parallel to its faces."""
    (ax, ay), (bx, by) = wall.coords
    x, y = ax + part * (bx - ax), ay + part * (by - ay)
    u, v = -(by - ay) / wall.length, (bx - ax) / wall.length
    return [(x + (along + s) * u, y + (along + s) * v) for s in (-0.5, 0.5)]


@pytest.mark.parametrize("turn", [0, 33])
@pytest.mark.parametrize("thick", [0.2, 0.35, 0.5, 0.65, 0.7, 0.9, 1.0])
def test_a_door_may_be_anywhere_in_a_thick_wall(
    place: semmap.Map, thick: float, turn: float
) -> None:
    wall = two_rooms(place, thick, turn)
    for number, part in enumerate((0, 0.25, 0.5, 0.75, 1)):
        made = place.add_door(f"d{number}", "one", "other", across(wall, part))
        poses = place.execute("SELECT pose FROM approach_pose WHERE connector = %s", made.name)
        stands = [shapely.Point(pose[:2]) for (pose,) in poses]
        for room in ("one", "other"):
            assert any(place[room].footprint.buffer(-0.1).contains(each) for each in stands)  # type: ignore[union-attr]
    assert not [f for f in place.check() if f.kind in ("no passage", "door away from its room")]
    passable = "SELECT is_at_its_rooms(c, w.pose) FROM connector c JOIN world w USING (entity_id)"
    assert {row[0] for row in place.execute(passable)} == {True}
    for line in (across(wall, 1 + 0.5 / thick), across(wall, 0.5, along=2.1)):
        with pytest.raises(ValueError, match="beside"):
            place.add_door("off", "one", "other", line)


@pytest.mark.parametrize("thick", [0.4, 0.9])
def test_a_door_through_a_thick_wall_is_drawn_and_moved_in_it(
    place: semmap.Map, thick: float
) -> None:
    two_rooms(place, thick, 0)
    place.execute(
        "INSERT INTO gis_connector (map, name, width, geom) VALUES ('doors', 'd', 1, "
        "ST_GeomFromText(%s))",
        f"LINESTRING(-0.5 22, {thick + 0.5} 22)",
    )
    passable = "SELECT is_at_its_rooms(c, w.pose) FROM connector c JOIN world w USING (entity_id)"
    for x, sound in ((0.0, True), (thick, True), (thick + 0.5, False), (-0.5, False)):
        place["d"].move_to(x, 22, 0)
        assert place.execute(passable)[0][0] == sound
        found = {each.kind for each in place.check() if "d" in each.entities}
        assert ("door away from its room" in found) != sound


def test_no_door_leads_through_a_room_or_a_wall_of_two_metres(place: semmap.Map) -> None:
    for name, (low, high) in {
        "a": (0, 3),
        "closet": (3.1, 3.8),
        "b": (3.9, 7),
        "c": (9, 12),
    }.items():
        place.add_room(name, shapely.box(low, 20, high, 24))
    for rooms, x in ((("a", "b"), 3.45), (("b", "c"), 8.0)):
        with pytest.raises(ValueError, match="beside"):
            place.add_door("d", *rooms, ((x, 21), (x, 22)))


@pytest.mark.parametrize("thick", [0.2, 0.4, 0.64, 0.7, 0.9, 1.0])
def test_rooms_are_found_on_both_sides_of_a_thick_wall(database: str, thick: float) -> None:
    walls: list[tuple[float, ...]] = [
        (0, 0, 0.2, 5),
        (9.8 + thick, 0, 10 + thick, 5),
        (0, 0, 10 + thick, 0.2),
    ]
    walls += [(0, 4.8, 10 + thick, 5), (3, 0, 3.2, 2), (3, 2.9, 3.2, 5)]
    walls += [(6, 0, 6 + thick, 2), (6, 2.9, 6 + thick, 5)]
    with semmap.connect(database) as db:
        place = db.create_map("walled")
        for number, (a, b, c, d) in enumerate(walls):
            middle = ((a + c) / 2, (b + d) / 2, 0)
            place.add_object(f"w{number}", type="wall", size=(c - a, d - b, 2.6), pose=middle)
        (found,) = place.find_rooms(add=True)
        assert {room.name for room in found.rooms} == {room.name for room in place.rooms}
        assert {way.name for way in found.doorways} == {door.name for door in place.doors}
        west, *_, east = sorted(place.rooms, key=lambda room: room.footprint.centroid.x)  # type: ignore[union-attr]
        assert found.problem is None
        assert len(place.route(west.name, east.name).doors) == 2


def test_a_found_doorway_that_is_no_door_is_left_out_alone(place: semmap.Map) -> None:
    rooms = tuple(
        FoundRoom(name, shapely.box(low, 20, low + 4, 24), 2.5, 0.9)
        for name, low in (("west", 0.0), ("east", 4.7))
    )
    posts = {"sound": ((4.35, 21), (4.35, 22)), "off": ((6, 21), (6, 22))}
    ways = tuple(
        FoundDoorway(name, ("west", "east"), shapely.LineString(line), 1.0)
        for name, line in posts.items()
    )
    added = add_found_rooms(place, FoundRooms("ground", 0.0, rooms, ways))
    assert {"west", "east"} <= {room.name for room in place.rooms}
    assert [door.name for door in place.doors] == [way.name for way in added.doorways] == ["sound"]
    assert (added.problem or "").startswith("off ends 2.00 m beside west")


@pytest.mark.parametrize("thick", [0.4, 0.9, 1.1])
@pytest.mark.parametrize("part", [0, 0.5])
def test_a_door_of_a_file_leads_through_a_thick_wall(
    database: str, tmp_path: Path, thick: float, part: float
) -> None:
    shapes = {"p": shapely.box(0, 0, 4, 3), "q": shapely.box(4 + thick, 0, 9, 3)}
    x = 4 + part * thick
    shapes["d"] = shapely.LineString([(x, 1), (x, 2)])
    kinds = {"p": {"kind": "room"}, "q": {"kind": "room"}}
    features = [
        {
            "type": "Feature",
            "properties": {"name": name, **kinds.get(name, {"kind": "connector", "joins": "p,q"})},
            "geometry": shapely.geometry.mapping(shape),
        }
        for name, shape in shapes.items()
    ]
    path = tmp_path / "thick.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    with semmap.connect(database) as db:
        summary = db.import_file(path, map="thick")
        place = db.map("thick")
        assert not [note for note in summary.notes if note.startswith("error: d ")]
        assert [step.connector.name for step in place.route("p", "q").doors] == ["d"]
        assert not [each for each in place.check() if "d" in each.entities]


def test_ways_out_lead_outside_where_shapely_says_so(place: semmap.Map) -> None:
    """A door of one room is refused within it, and before another room; else it is accepted."""
    draw = random.Random(11)
    cella, aula = (shapely.box(*ROOMS[name]) for name in ("cella", "aula"))
    drawn = {True: 0, False: 0}
    for number in range(80):
        x, y = draw.choice([(draw.uniform(0, 4), draw.choice([0, 2, 4])), (4, draw.uniform(0, 4))])
        line = shapely.LineString([(x - 0.4, y), (x + 0.4, y)])
        line = shapely.affinity.rotate(line, 90 * (x == 4 or draw.random() < 0.2))
        sides = [
            shapely.LineString([(x, y), end]) for end in shapely.affinity.rotate(line, 90).coords[:]
        ]
        within = [cella.covers(side) for side in sides]
        beyond = [side for side, inner in zip(sides, within, strict=True) if not inner]
        sound = len(beyond) == 1 and not beyond[0].dwithin(aula, 0.25)
        sound &= all(cella.dwithin(shapely.Point(post), 0.29) for post in line.coords)
        wrong = not beyond or (len(beyond) == 1 and beyond[0].intersects(aula))
        assert not (sound and wrong), line
        if sound or wrong:
            drawn[sound] += 1
            refused = False
            try:
                place.add_door(f"d{number}", "cella", None, line.coords[:])
            except ValueError:
                refused = True
            assert refused == wrong, line
    assert min(drawn.values()) > 5
    assert not [each for each in place.check() if each.kind == "no passage"]


def test_check_says_which_doors_lead_outside_into_a_room(place: semmap.Map) -> None:
    """Also where the room behind a door was added after it."""
    place.add_door("east", "aula", None, ((9.05, 1), (9.05, 2)))
    place.add_door("south", "aula", None, ((6, 0), (7, 0)))
    assert not [each for each in place.check() if each.kind == "no passage"]
    place.add_room("annexe", shapely.box(9.2, 0, 12, 3))
    (found,) = [each for each in place.check() if each.kind == "no passage"]
    assert found.text == "the door east leads outside, but annexe is on its other side"


def test_a_way_out_drawn_into_a_room_is_refused(place: semmap.Map) -> None:
    """Its line ends in the wall before the other room, which it does not join."""
    for line in ("3.6 1, 4.1 1", "1.5 2, 2.5 2"):
        with pytest.raises(semmap.Error, match=r"aula is on its other side|does not join"):
            place.execute(
                "INSERT INTO gis_connector (map, name, width, geom) "
                "VALUES ('doors', 'd', 0.8, ST_GeomFromText(%s))",
                f"LINESTRING({line})",
            )


@pytest.mark.parametrize("seed", range(4))
def test_a_door_is_on_the_floor_of_its_rooms_and_stairs_on_both(database: str, seed: int) -> None:
    draw = random.Random(seed)
    z, rise, lower = draw.uniform(-200, 200), draw.uniform(2, 5), draw.uniform(0, 0.4)
    with semmap.connect(database) as db:
        place = db.create_map("tower")
        for name, floor in (("s0", z), ("s1", z + rise)):
            place.add_storey(name, elevation=floor)
        for name, box, floor in (
            ("cella", (0, 0, 4, 4), z),
            ("aula", (4.2, 0, 9, 4), z - lower),
            ("loft", (0, 0, 9, 4), z + rise),
        ):
            place.add_room(name, shapely.box(*box), floor=floor, ceiling=floor + 2)
        door = place.add_door("d", "cella", "aula", ((4.1, 2.5), (4.1, 3.5)))
        assert door.pose is not None
        assert door.pose.z == pytest.approx(z - lower)
        for options in ({"height": z + 0.6}, {"height": z - lower - 0.6}):
            with pytest.raises(ValueError, match=r"^e is at .* but the floor of"):
                place.add_door("e", "cella", "aula", ((4.1, 1), (4.1, 2)), **options)
        with pytest.raises(ValueError, match=r"^e is at .*the floor of loft.*stairs"):
            place.add_door("e", "cella", "loft", ((4.1, 1), (4.1, 2)))
        long = draw.uniform(1.2, 1.8)
        place.add_door("up", "aula", "loft", ((6.5, 1), (6.5, 2)), form="stairs", clearance=long)
        steps = place.route("cella", "loft").steps
        way = next(step for step in steps if step.connector and step.connector.name == "up")
        assert way.behaviour == "climb_stairs"
        low, high = way.connector.poses  # type: ignore[union-attr]
        assert (low.z, high.z) == pytest.approx((z - lower, z + rise))
        assert abs(high.x - low.x) == pytest.approx(2 * (long + 0.05))
        assert {each.kind for each in place.check()} == (
            {"step in a door"} if lower > 0.021 else set()
        )
