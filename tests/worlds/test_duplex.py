"""The Duplex of buildingSMART (IFC 2x3) against the counts, areas and bounds that it states."""

import re
from itertools import combinations

import numpy as np
import pytest
import shapely

import semmap
from semmap.ingest.ifc import read_ifc
from semmap.ingest.importer import import_file
from semmap.ingest.world import OUTSIDE

DUPLEX = "ifc/Duplex_A_20110907.ifc"


@pytest.fixture(scope="module")
def text(worlds):
    return (worlds / DUPLEX).read_text()


@pytest.fixture(scope="module")
def duplex(worlds):
    return read_ifc(worlds / DUPLEX)


@pytest.fixture(scope="module")
def building(imported, worlds):
    with (
        imported((worlds / DUPLEX, "duplex")) as engine,
        semmap.connect(engine.url.render_as_string(hide_password=False)) as db,
    ):
        yield db.map("duplex")


def lines_of(text, name):
    """The arguments of the lines of a class in the file's text: no parser of ours."""
    return re.findall(rf"^#(\d+)\s*=\s*{name}\((.*)\);", text, re.MULTILINE)


def test_outlines_agree_with_the_stated_volumes(duplex):
    """The areas that the file states reach to the middle of walls; its volumes do not."""
    rooms = {entry.name: entry for entry in duplex.entries if entry.kind == "room"}
    assert len(rooms) == 21
    over_stairs = {"A105", "A201", "B105", "B201"}  # of several heights
    for name, room in rooms.items():
        height = room.detail.ceiling - room.detail.floor
        stated = room.properties["PSet_Revit_Dimensions"]["Volume"] / height
        assert room.shapes[0].outline.area == pytest.approx(
            stated, rel=0.11 if name in over_stairs else 2e-3
        )


def test_doors_join_the_spaces_that_they_bound(duplex, text):
    spaces = {k: re.match(r"'[^']*',[^,]*,'([^']*)'", v)[1] for k, v in lines_of(text, "IFCSPACE")}
    tags = {k: re.search(r"'(\d+)',[\d.]+,[\d.]+$", v)[1] for k, v in lines_of(text, "IFCDOOR")}
    bounds = {tag: set() for tag in tags.values()}
    for _, rest in lines_of(text, "IFCRELSPACEBOUNDARY"):
        related = re.search(r"#(\d+),#(\d+),[^,]*,\.", rest)
        if related and related[2] in tags:
            bounds[tags[related[2]]].add(spaces[related[1]])
    found = {
        entry.properties["ifc"]["tag"]: set(entry.detail.places)
        for entry in duplex.entries
        if entry.kind == "connector" and entry.type == "door"
    }
    assert len(found) == 14
    assert sum(OUTSIDE not in places for places in found.values()) == 10
    for tag, places in found.items():
        if len(bounds[tag]) == 2:
            assert places == bounds[tag]
        elif len(bounds[tag]) == 1:
            assert places == bounds[tag] | {OUTSIDE}
        else:
            assert places < bounds[tag]


def test_routes_reach_all_rooms_of_a_flat_and_no_other(building):
    """Both flats are reached from their foyers; from one to the other the way leads outside."""
    flats = {
        flat: [r.name for r in building.rooms if r.name[0] == flat and r.name[1:] != "105"]
        for flat in "AB"
    }
    for names in flats.values():
        assert len(names) == 9
        for start, goal in combinations(names, 2):
            assert building.route(start, goal).steps
    with pytest.raises(semmap.Error, match="outside"):
        building.route("A102", "B102")


def test_rooms_and_stairs_are_found_where_the_file_has_spaces(database, worlds, duplex):
    """The same building without its spaces and doors."""
    bare = read_ifc(worlds / DUPLEX)
    bare.entries = [e for e in bare.entries if e.kind not in ("room", "connector")]
    with semmap.connect(database) as db:
        import_file(db.engine, worlds / DUPLEX, map_name="bare", world=bare)
        house = db.map("bare")
        house.find_rooms(add=True)
        stairs = [door for door in house.doors if door.form == "stairs"]
        known = [e for e in duplex.entries if e.type == "stairs"]
        found = sorted(tuple(door.pose.translation[:2]) for door in stairs)
        assert found == [
            pytest.approx(at, abs=0.1) for at in sorted((e.pose.x, e.pose.y) for e in known)
        ]
        for door in stairs:
            lower, upper = door.places
            assert (lower.storey.name, upper.storey.name) == ("Level 1", "Level 2")
            assert "climb_stairs" in [step.behaviour for step in house.route(lower, upper).steps]
        assert house.find_rooms()[0].stairs == ()


def placed_triangles(world, types=None, storey=None):
    """Triangles (n, 3, 3) of the objects of some types and a storey, in the map's frame."""
    poses = {entry.name: entry.pose for entry in world.entries}
    for entry in world.entries:
        if entry.kind != "object" or (types and entry.type not in types):
            continue
        if storey and entry.holder != storey:
            continue
        pose = (poses[entry.holder] @ entry.pose) if entry.holder else entry.pose
        yield pose.apply(entry.shapes[0].mesh.vertices)[entry.shapes[0].mesh.faces]


def test_walls_are_where_the_file_has_them_and_spaces_are_free(building, duplex):
    """Free cells lie in rooms, occupied ones where elements stand: by Shapely, from triangles."""
    grid = building.grid("Level 1")
    low, high = 0.1, 1.8
    solid = shapely.union_all(
        [
            shapely.MultiPoint(triangle[:, :2]).convex_hull
            for triangles in placed_triangles(duplex)
            for triangle in triangles
            if triangle[:, 2].min() < high and triangle[:, 2].max() > low
        ]
    )
    rng = np.random.default_rng(31)
    for room in (entry for entry in duplex.entries if entry.kind == "room"):
        if room.holder != "Level 1" or room.name[1:] == "105":
            continue
        outline = shapely.transform(
            room.shapes[0].outline, lambda xy, at=room.pose: np.add(xy, (at.x, at.y))
        )
        x0, y0, x1, y1 = outline.bounds
        for x, y in rng.uniform((x0, y0), (x1, y1), (40, 2)):
            at = shapely.Point(x, y)
            if outline.contains(at) and solid.distance(at) > 0.1:
                row = int((y - grid.grid.origin[1]) / grid.grid.resolution)
                column = int((x - grid.grid.origin[0]) / grid.grid.resolution)
                assert grid.cells[row, column] == 0
    crossed = 0
    for triangles in placed_triangles(duplex, {"wall", "cabinet", "sofa"}, "Level 1"):
        for triangle in triangles:
            above = triangle[:, 2] > 0.5
            if above.all() or not above.any():
                continue
            points = []
            for one, other in combinations(triangle, 2):
                if (one[2] > 0.5) != (other[2] > 0.5):
                    points.append(one + (0.5 - one[2]) / (other[2] - one[2]) * (other - one))
            x, y, _ = np.mean(points, axis=0)
            # A face on the border of two cells occupies one of them.
            around = [(x + dx, y + dy) for dx in (-1e-6, 1e-6) for dy in (-1e-6, 1e-6)]
            assert 100 in {grid.cells[grid.grid.cell(*at)] for at in around}
            crossed += 1
    assert crossed > 200
