"""Exports of random buildings and of maps with something odd come back as the same map."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import shapely
import trimesh
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import semmap
from tests.buildings.building import random_building
from tests.buildings.clouds import scanned
from tests.buildings.judges import stored
from tests.conftest import MakeDatabase
from tests.effort import effort
from tests.export.comparison import Picture, differences

ENDINGS = [".gpkg", ".geojson", ".sdf", ".gml"]


def come_back(place: semmap.Map, path: Path, **options: Any) -> semmap.Map:
    """The map of an export of a map, in the same database."""
    again = place.database.create_map(f"again {path.name}")
    summary = again.import_file(place.export(path, **options))
    assert summary.skipped == []
    return again


@settings(
    max_examples=effort(1, 10),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(seed=st.integers(0, 10_000))
def test_random_buildings(seed: int, make_database: MakeDatabase, tmp_path_factory) -> None:
    folder = tmp_path_factory.mktemp("building")
    url = make_database().render_as_string(hide_password=False)
    with stored(scanned(random_building(seed)), url, folder) as place:
        picture = Picture.of(place)
        for ending in ENDINGS:
            again = come_back(place, folder / f"b{ending}")
            assert differences(picture, again) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_flat_with_a_bit_of_everything(
    furnished: semmap.Map, ending: str, tmp_path: Path
) -> None:
    again = come_back(furnished, tmp_path / f"flat{ending}")
    assert differences(furnished, again) == []
    assert {each.kind for each in again.check()} <= {each.kind for each in furnished.check()}


@pytest.mark.parametrize("ending", ENDINGS)
def test_odd_names_come_back(db: semmap.Database, ending: str, tmp_path: Path) -> None:
    """Commas, quotes, slashes, colons, control characters and letters of all scripts."""
    place = db.create_map("odd/map: <&>")
    ground = place.add_storey('1st, "floor"')
    place.add_storey("2nd\u00e9", elevation=3)
    for number, name in enumerate(("a, b", "c/d", "e::f <&>")):
        x = 4 * number
        place.add_room(name, [(x, 0), (x + 3.9, 0), (x + 3.9, 3), (x, 3)], storey=ground)
    place.add_door("d, 1", "a, b", "c/d", ((3.95, 1), (3.95, 2)))
    place.add_door("d\u4e2d", "e::f <&>", None, ((12, 1), (12, 2)))
    for name in ("../up", "x::y", "X__Y", "x__y", "tab\tand\nline", "\x01", "\u4e2d\u6587"):
        x = len(place.objects) + 0.5
        place.add_object(name, size=(0.5, 0.4, 0.3), pose=(x, 1, 0), label='l, <&> "q"')
    again = come_back(place, tmp_path / f"odd{ending}")
    assert differences(place, again) == []
    assert {p.name for p in tmp_path.iterdir()} <= {f"odd{ending}", "odd_meshes"}


@pytest.mark.parametrize("ending", ENDINGS)
def test_plates_that_have_sunk_keep_their_holders(
    db: semmap.Database, ending: str, tmp_path: Path
) -> None:
    """Half a centimetre into a turned table, and into each other: last digits differ again."""
    place = db.create_map("sunk")
    place.add_room("sala", shapely.box(0, 0, 8, 6), floor=0, ceiling=2.7)
    place.add_object("Tisch", type="table", size=(1.6, 0.9, 0.75), pose=(5, 2, 0, 0.3))
    plate = trimesh.creation.cylinder(0.12, 0.02)
    plate.apply_translation((0, 0, 0.01))
    for name, x, z in (("a", 4.6, 0.745), ("b", 4.6, 0.76), ("c", 5.2, 0.745), ("d", 5.23, 0.765)):
        place.add_object(name, type="plate", mesh=plate, pose=(x, 2, z))
    holders = {name: place[name].holder.name for name in "abcd"}  # type: ignore[union-attr]
    assert holders == {"a": "Tisch", "b": "a", "c": "Tisch", "d": "c"}
    assert differences(place, come_back(place, tmp_path / f"sunk{ending}")) == []


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_cellar_below_two_storeys_has_none(
    db: semmap.Database, ending: str, tmp_path: Path
) -> None:
    """No storey holds its rooms, their door, and what is in them; nothing is lost or moved."""
    place = db.create_map("deep")
    for number, name in enumerate(("ground", "upper")):
        place.add_storey(name, elevation=3.1 * number, height=2.8)
        low = 3.1 * number
        place.add_room(f"flat {name}", shapely.box(0, 0, 9, 6), floor=low, ceiling=low + 2.7)
    for name, box in (("cellar", (0, 0, 4, 6)), ("boiler", (4.1, 0, 9, 6))):
        place.add_room(name, shapely.box(*box), floor=-2.6, ceiling=-0.3)
    place.add_door("hatch", "cellar", "boiler", ((4.05, 1), (4.05, 2)))
    place.add_region("coal", shapely.box(5, 1, 6, 2), floor=-2.6, ceiling=-1.5)
    place.add_object("tank", type="table", size=(1, 1, 1), pose=(7, 4, -2.6))
    place.add_object("jar", type="mug", size=(0.1, 0.1, 0.1), on="tank")
    assert place["cellar"].storey is place["jar"].storey is None
    again = come_back(place, tmp_path / f"deep{ending}")
    assert differences(place, again) == []
    lost = {e.name for e in again if e.storey is None and e.kind != "storey"}
    assert lost >= {"cellar", "boiler", "hatch", "tank", "jar"}


@pytest.mark.parametrize(
    ("ending", "crs"),
    [*((e, None) for e in ENDINGS), *((e, "EPSG:4326") for e in ENDINGS if e != ".sdf")],
)
def test_what_stands_around_its_middle_stays_there(
    db: semmap.Database, ending: str, crs: str | None, tmp_path: Path
) -> None:
    """The centroid of a U is beside it; on the earth, its coordinates differ by rounding."""
    place = db.create_map("desks")
    place.execute(
        "UPDATE map SET crs = 25832, easting = 691600, northing = 5334700, height = 500, "
        "rotation = 0.3 WHERE id = current_map()"
    )
    outline = [(-1, -1), (1, -1), (1, 1), (0.7, 1), (0.7, -0.7), (-0.7, -0.7), (-0.7, 1), (-1, 1)]
    desk = trimesh.creation.extrude_polygon(shapely.Polygon(outline), 0.5)
    for number in range(40):
        pose = (3 * (number % 8), 3 * (number // 8), 0, 0.15 * number)
        place.add_object(f"t{number}", type="table", mesh=desk, pose=pose)
    boxes = {one.name: one.box for one in place.objects}
    place.add_room("hall", shapely.box(-2, -2, 26, 16))
    again = come_back(place, tmp_path / f"desks{ending}", **({} if crs is None else {"crs": crs}))
    for one in again.objects:
        assert one.box == pytest.approx(boxes[one.name], abs=2e-3)


@pytest.mark.parametrize("ending", ENDINGS)
def test_heights_times_and_what_agents_hold_come_back(
    db: semmap.Database, ending: str, tmp_path: Path
) -> None:
    place = db.create_map("stage")
    place.add_storey("S", elevation=2, height=4)
    for name, x, floor in (("low", 0, 2), ("high", 8, 2.6), ("dock", 12, 2.6)):
        wide = 5 if name == "low" else 4
        area = shapely.box(x, 0, x + wide, 4)
        place.add_room(name, area, floor=floor, ceiling=floor + 3, storey="S")
    place.add_door("ramp", "low", "high", ((6.5, 1.4), (6.5, 2.6)), form="ramp", clearance=2.2)
    place.add_door("gate", "high", "dock", ((12, 1), (12, 2)))
    place.add_agent("bot", type="robot", size=(0.5, 0.5, 1), pose=(2, 2, 2, 0.3))
    place.add_object("parcel", type="box", size=(0.2, 0.2, 0.2), on="bot")
    place.add_object("desk", type="table", size=(1, 1, 0.7), pose=(4, 3, 2, 0))
    times = ("2026-11-28T12:00:00+00:00", "2030-01-01T00:00:00+01:00")
    square = (1, 1, 2, 2, 2, 3)
    for name, since, until in (("was", None, 0), ("will", 1, None), ("both", 0, 1)):
        ends = [None if at is None else datetime.fromisoformat(times[at]) for at in (since, until)]
        place.draw_region(name, box=square, since=ends[0], until=ends[1])
    valid = "SELECT e.name, r.valid FROM region r JOIN entity e ON e.id = r.entity_id "
    valid += "WHERE e.map_id = current_map() ORDER BY 1"
    route = place.route("low", "dock")
    again = come_back(place, tmp_path / f"stage{ending}")
    assert again.route("low", "dock").metres == pytest.approx(route.metres, abs=0.05)
    assert again["parcel"].holder.name == "bot"
    assert again.execute(valid) == place.execute(valid)
    assert len({row[1] for row in again.execute(valid)}) == 3
    assert {each.kind for each in again.check()} <= {each.kind for each in place.check()}


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_room_without_a_ceiling_has_none_afterwards(
    db: semmap.Database, ending: str, tmp_path: Path
) -> None:
    """Its solid keeps its top, on a storey with a height, without one, and on none."""
    place = db.create_map("open")
    place.add_storey("ground")
    place.add_storey("upper", elevation=3.75, height=3.1)
    for number, (storey, floor) in enumerate((("ground", 0.15), ("upper", 3.9), (None, -2.0))):
        x = 5 * number
        area = shapely.box(x, 0, x + 4, 3)
        place.add_room(f"r{number}", area, floor=floor, ceiling=None, storey=storey)
    tops = {f"r{number}": floor + 2.5 for number, floor in enumerate((0.15, 3.9, -2.0))}
    again = come_back(place, tmp_path / f"open{ending}")
    assert differences(place, again) == []
    for each in (place, again):
        assert {room.name: room.box[5] for room in each.rooms} == pytest.approx(tops)
        ceilings = "SELECT DISTINCT r.ceiling FROM gis_room r WHERE r.map = '{}'"
        assert [*each.sql(ceilings.format(each.name))] == [(None,)]


@pytest.mark.parametrize("crs", ["EPSG:3414", "EPSG:3857"])
def test_a_building_in_degrees_comes_back(db: semmap.Database, crs: str, tmp_path: Path) -> None:
    """Open-RMF's, far from the origin of its grid: a room, a door, a place and a table."""
    west, south, side = 103.8, 1.3, 0.0001
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.4, 0.0), (0.5, 0.0), (0.5, 0.5)]
    names = ["", "", "", "", "", "", "hub"]
    places = [(west + side * x, south + side * y) for x, y in corners]
    level = {
        "elevation": 0,
        "vertices": [[*place, 0, name] for place, name in zip(places, names, strict=True)],
        "walls": [[0, 4, {}], [5, 1, {}], [1, 2, {}], [2, 3, {}], [3, 0, {}]],
        "doors": [[4, 5, {"name": [1, "front"], "type": [1, "hinged"]}]],
        "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}],
        "models": [
            {"model_name": "Table", "name": "t1", "x": west + side / 4, "y": south + side / 4}
        ],
    }
    path = tmp_path / "camp.building.yaml"
    building = {"name": "camp", "coordinate_system": "wgs84", "levels": {"L1": level}, "lifts": {}}
    path.write_text(yaml.safe_dump(building | {"parameters": {"generate_crs": [1, crs]}}))
    db.import_file(path, map="camp")
    place = db.map("camp")
    picture = Picture.of(place)
    assert {"hub", "front", "t1", "walls-L1", "L1"} <= picture.entities.keys()
    for ending in ENDINGS:
        assert differences(picture, come_back(place, tmp_path / f"again{ending}")) == []


def tower() -> str:
    """A Gazebo world of three floors with walls, beds and cups; it states no storeys."""
    models = []

    def box(
        name: str, middle: tuple[float, float, float], size: tuple[float, float, float]
    ) -> None:
        shape = "<geometry><box><size>{} {} {}</size></box></geometry>".format(*size)
        pose = "<pose>{} {} {} 0 0 0</pose>".format(*middle)
        link = f"<link name='l'><visual name='v'>{shape}</visual></link>"
        models.append(f"<model name='{name}'>{pose}{link}</model>")

    walls = ((5, 0, 10, 0.1), (5, 8, 10, 0.1), (0, 4, 0.1, 8), (10, 4, 0.1, 8))
    for floor, z in enumerate((0, 3, 6)):
        box(f"slab{floor}", (5, 4, z - 0.05), (10, 8, 0.1))
        for number, (x, y, wide, deep) in enumerate((*walls, (5, 2, 0.1, 3.9), (5, 6.5, 0.1, 3))):
            box(f"wall{floor}_{number}", (x, y, z + 1.3), (wide, deep, 2.6))
        for number in range(3):
            box(f"bed{floor}_{number}", (1.5 + 3 * number, 1.5, z + 0.3), (1, 2, 0.6))
            box(f"cup{floor}_{number}", (1.5 + 3 * number, 1.5, z + 0.65), (0.1, 0.1, 0.1))
    return f"<sdf version='1.9'><world name='tower'>{''.join(models)}</world></sdf>"


def test_storeys_and_rooms_that_were_found(db: semmap.Database, tmp_path: Path) -> None:
    path = tmp_path / "tower.sdf"
    path.write_text(tower())
    db.import_file(path, map="tower")
    place = db.map("tower")
    place.find_rooms(add=True)
    assert (len(place.storeys), len(place.rooms), len(place.doors)) == (3, 6, 3)
    picture = Picture.of(place)
    for ending in ENDINGS:
        again = come_back(place, tmp_path / f"again{ending}")
        assert differences(picture, again) == []
