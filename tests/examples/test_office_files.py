"""The office: what its files say, against shapely, trimesh and NetworkX."""

import itertools
import json
import subprocess
import sys
from pathlib import Path

import networkx
import numpy as np
import pytest
import shapely
import trimesh

from semmap.ingest.annotation.annotation import read_annotation
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import ConnectorDetail, Entry, PlaceDetail, World

OFFICE = Path(__file__).parents[2] / "examples/office"

FLOORS = {"floor-1st": 0.0, "floor-3rd": 7.0}

JOINED = {
    "door1": ("lab1", "corridor1"),
    "door2": ("corridor1", "foyer-1st"),
    "door3": ("corridor1", "kitchen"),
    "edoor1": ("foyer-1st", "elevator-1st"),
    "edoor3": ("elevator-3rd", "foyer-3rd"),
    "door5": ("foyer-3rd", "corridor3"),
    "door6": ("corridor3", "office4"),
    "door7": ("office4", "corridor3"),
    "door8": ("corridor3", "lab2"),
}


@pytest.fixture(scope="module")
def plan() -> World:
    return read_annotation(OFFICE / "office_rooms.geojson")


@pytest.fixture(scope="module")
def things() -> dict[str, Entry]:
    world = read_sdf(OFFICE / "office.sdf")
    assert world.skipped == []
    return {e.name: e for e in world.entries}


@pytest.fixture(scope="module")
def rooms(plan: World) -> dict[str, tuple[shapely.Polygon, float]]:
    """Area in the map and height of the floor, by name."""
    elevation = {e.name: e.pose.z for e in plan.entries if e.kind == "storey"}
    return {
        e.name: (
            shapely.transform(e.shapes[0].outline, lambda xy, p=e.pose: xy + p.translation[:2]),
            elevation[e.holder],
        )
        for e in plan.entries
        if e.kind == "room"
    }


def solid(entry: Entry) -> trimesh.Trimesh:
    mesh = entry.shapes[0].mesh.moved(entry.pose)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def footprint(entry: Entry) -> shapely.Polygon:
    return shapely.MultiPoint(solid(entry).vertices[:, :2]).convex_hull


def room_of(entry: Entry, rooms: dict[str, tuple[shapely.Polygon, float]]) -> str:
    base = solid(entry).bounds[0, 2]
    middle = footprint(entry).centroid
    return next(
        name for name, (area, z) in rooms.items() if area.covers(middle) and z - 2 <= base < z + 3
    )


def doors(world: World) -> dict[str, ConnectorDetail]:
    return {e.name: e.detail for e in world.entries if isinstance(e.detail, ConnectorDetail)}


# Rooms and doors


def test_nothing_is_left_out(plan: World) -> None:
    assert plan.skipped == []
    assert plan.notes == []


@pytest.mark.parametrize(("door", "places"), JOINED.items())
def test_doors_join_what_figure_4_says(plan: World, door: str, places: tuple[str, str]) -> None:
    assert doors(plan)[door].places == places


def test_doors_join_by_geometry_what_they_name(plan: World, tmp_path: Path) -> None:
    drawn = json.loads((OFFICE / "office_rooms.geojson").read_text())
    for feature in drawn["features"]:
        feature["properties"].pop("joins", None)
    path = tmp_path / "drawn.geojson"
    path.write_text(json.dumps(drawn))
    assert {n: set(d.places) for n, d in doors(read_annotation(path)).items()} == {
        n: set(d.places) for n, d in doors(plan).items()
    }


def test_door_lines_lie_in_the_wall_between_their_rooms(
    plan: World, rooms: dict[str, tuple[shapely.Polygon, float]]
) -> None:
    for entry in plan.entries:
        if isinstance(entry.detail, ConnectorDetail):
            for place in set(entry.detail.places) - {"outside"}:
                middle = shapely.Point(entry.pose.x, entry.pose.y)
                assert 0.0 < rooms[place][0].distance(middle) <= 0.2
                assert rooms[place][1] == FLOORS[entry.holder]


def test_robots_stand_in_the_places_that_a_door_joins(
    plan: World, rooms: dict[str, tuple[shapely.Polygon, float]]
) -> None:
    for entry in plan.entries:
        if isinstance(entry.detail, ConnectorDetail):
            for place, pose in zip(entry.detail.places, entry.detail.poses, strict=True):
                standing = entry.pose @ pose
                facing = entry.pose.translation - standing.translation
                assert facing @ standing.rotation_matrix[:, 0] == pytest.approx(
                    np.linalg.norm(facing)
                )
                point = shapely.Point(standing.x, standing.y)
                if place == "outside":
                    assert not any(area.covers(point) for area, z in rooms.values() if z == 0)
                else:
                    assert rooms[place][0].contains(point.buffer(0.25))


def test_rooms_of_a_storey_do_not_overlap(
    rooms: dict[str, tuple[shapely.Polygon, float]],
) -> None:
    for (a, z), (b, other) in itertools.combinations(rooms.values(), 2):
        assert z != other or a.distance(b) > 0.19


def test_names_are_unique_over_both_files(plan: World, things: dict[str, Entry]) -> None:
    assert {e.name for e in plan.entries} & things.keys() == set()


def test_the_elevator_has_a_cabin_on_each_storey(plan: World) -> None:
    cabins = [e for e in plan.entries if isinstance(e.detail, PlaceDetail) and e.detail.elevator]
    assert [(e.name, e.holder, e.detail.elevator) for e in cabins] == [
        ("elevator-1st", "floor-1st", "elevator"),
        ("elevator-3rd", "floor-3rd", "elevator"),
    ]
    assert np.allclose(cabins[0].pose.translation, cabins[1].pose.translation)


def test_the_shortest_ways_pass_the_doors_of_figure_4(plan: World) -> None:
    entries = {e.name: e for e in plan.entries if isinstance(e.detail, ConnectorDetail)}
    graph = networkx.Graph()
    for a, b in itertools.combinations(entries.values(), 2):
        if set(a.detail.places) & set(b.detail.places) - {"outside"} and a.holder == b.holder:
            graph.add_edge(
                a.name, b.name, weight=np.linalg.norm(a.pose.translation - b.pose.translation)
            )
    graph.add_edge("edoor1", "edoor3", weight=7.0)
    assert networkx.dijkstra_path(graph, "door1", "door6") == [
        "door1",
        "door2",
        "edoor1",
        "edoor3",
        "door5",
        "door6",
    ]
    way = networkx.dijkstra_path_length
    assert way(graph, "door5", "door6") < way(graph, "door5", "door7")
    assert way(graph, "door7", "door8") < way(graph, "door6", "door8")
    desk4 = 9.2, 0.45
    past = {
        door: np.hypot(entries[door].pose.x - desk4[0], entries[door].pose.y - desk4[1])
        + way(graph, door, "door8")
        for door in ("door6", "door7")
    }
    assert past["door7"] < past["door6"]


def test_regions_lie_in_their_rooms(plan: World) -> None:
    regions = {e.name: e for e in plan.entries if e.kind == "region"}
    assert (regions["home"].holder, regions["home"].properties["home"]) == ("lab1", True)
    stairs = regions["staircase"]
    assert (stairs.holder, stairs.properties["blocked"]) == ("foyer-1st", True)


# Furniture


def test_things_stand_in_rooms_and_not_in_walls(
    things: dict[str, Entry], rooms: dict[str, tuple[shapely.Polygon, float]]
) -> None:
    for name, entry in things.items():
        if not name.startswith(("walls-", "slab-")):
            area, _ = rooms[room_of(entry, rooms)]
            assert area.buffer(1e-6).covers(footprint(entry)), name


@pytest.mark.parametrize(
    ("thing", "room"),
    [
        ("desk4", "office4"),
        ("muffin1", "office4"),
        ("desk1", "lab2"),
        ("desk2", "lab1"),
        ("kitchen_table1", "kitchen"),
        ("cup1", "kitchen"),
        ("stairs_down", "foyer-1st"),
    ],
)
def test_rooms_of_things(
    things: dict[str, Entry],
    rooms: dict[str, tuple[shapely.Polygon, float]],
    thing: str,
    room: str,
) -> None:
    assert room_of(things[thing], rooms) == room


def test_furniture_on_the_floor_does_not_overlap(
    things: dict[str, Entry], rooms: dict[str, tuple[shapely.Polygon, float]]
) -> None:
    standing = {
        name: (footprint(e), round(solid(e).bounds[0, 2]))
        for name, e in things.items()
        if not name.startswith(("walls-", "slab-"))
        and round(float(solid(e).bounds[0, 2]), 3) in {z for _, z in rooms.values()}
    }
    assert len(standing) > 60
    for (a, (one, z)), (b, (two, other)) in itertools.combinations(standing.items(), 2):
        seated = a.startswith("office_chair") or b.startswith("office_chair")
        allowed = 0.04 if seated else 1e-9  # feet under the desk
        assert z != other or one.intersection(two).area <= allowed, (a, b)


def test_the_only_muffin_lies_flush_on_desk4(things: dict[str, Entry]) -> None:
    assert [n for n, e in things.items() if e.type == "muffin"] == ["muffin1"]
    muffin, desk = solid(things["muffin1"]), solid(things["desk4"])
    assert muffin.bounds[0, 2] == pytest.approx(desk.bounds[1, 2], abs=1e-4)
    assert desk.bounds[1, 2] == pytest.approx(7.74, abs=1e-6)
    assert footprint(things["desk4"]).contains(footprint(things["muffin1"]))


@pytest.mark.parametrize(
    ("thing", "holder"),
    [
        ("tray1", "kitchen_table1"),
        ("cup1", "tray1"),
        ("cup2", "tray1"),
        ("laptop2", "desk7"),
        ("plate1", "kitchen_table1"),
        ("microwave1", "kitchen_counter1"),
        ("monitor5", "desk4"),
        ("cup4", "desk4"),
        ("tray2", "lab_bench2"),
    ],
)
def test_things_lie_on_top_of_others(things: dict[str, Entry], thing: str, holder: str) -> None:
    assert footprint(things[holder]).contains(footprint(things[thing]))
    below = trimesh.proximity.closest_point(solid(things[holder]), _base(things[thing]))[1]
    assert below.max() == pytest.approx(0.0, abs=2e-4)


def _base(entry: Entry) -> np.ndarray:
    vertices = solid(entry).vertices
    return vertices[np.isclose(vertices[:, 2], vertices[:, 2].min())]


def test_books_stand_on_the_boards_of_shelves(things: dict[str, Entry]) -> None:
    shelves = [solid(e) for e in things.values() if e.type == "bookshelf"]
    books = [e for e in things.values() if e.type == "book"]
    levels = {round(float(solid(b).bounds[0, 2]) % 7, 2) for b in books}
    assert levels == {0.45, 0.85, 1.25, 1.65}
    for book in books:
        base = _base(book)
        gaps = [trimesh.proximity.closest_point(s, base)[1].max() for s in shelves]
        assert min(gaps) == pytest.approx(0.0, abs=1e-4)


def test_things_have_types(things: dict[str, Entry]) -> None:
    assert [n for n, e in things.items() if e.type is None] == []
    types = {n: e.type for n, e in things.items()}
    assert types["desk4"] == "desk"
    assert types["office_chair5"] == "office_chair"
    assert types["kitchen_table1"] == "kitchen_table"


def test_models_have_the_sizes_of_real_things(things: dict[str, Entry]) -> None:
    sizes = {
        "desk4": (0.8, 1.6, 0.74),
        "kitchen_table1": (0.9, 1.4, 0.75),
        "cup1": (0.08, 0.103, 0.08),
        "chair1": (0.42, 0.42, 0.85),
        "bookshelf1": (0.35, 1.2, 1.9),
        "sofa1": (0.85, 1.9, 0.8),
        "conference_table1": (1.2, 2.8, 0.74),
        "muffin1": (0.082, 0.082, 0.079),
    }
    for name, size in sizes.items():
        extents = np.ptp(things[name].shapes[0].mesh.vertices, axis=0)
        assert np.allclose(extents, size, atol=0.004), (name, extents)


# Walls


@pytest.mark.parametrize(("short", "z"), [("1st", 0.0), ("3rd", 7.0)])
def test_walls_enclose_the_rooms_and_open_at_doors(
    plan: World,
    things: dict[str, Entry],
    rooms: dict[str, tuple[shapely.Polygon, float]],
    short: str,
    z: float,
) -> None:
    walls = solid(things[f"walls-{short}"])
    assert walls.is_watertight
    assert np.allclose(walls.bounds, [[-0.2, -0.2, z], [18.2, 10.2, z + 3]])
    section = walls.section([0, 0, 1], [0, 0, z + 0.5])
    plane = shapely.polygonize([shapely.LineString(line[:, :2]) for line in section.discrete])
    parts = list(plane.geoms)
    solid_part = shapely.box(-0.2, -0.2, 18.2, 10.2).difference(
        shapely.union_all([area for area, floor in rooms.values() if floor == z])
    )
    drawn = [e for e in plan.entries if e.kind == "connector" and e.holder == f"floor-{short}"]
    for entry in drawn:
        across = entry.pose.apply([[0, -entry.detail.width / 2, 0], [0, entry.detail.width / 2, 0]])
        gap = shapely.LineString(across[:, :2]).buffer(0.15, cap_style="flat")
        solid_part = solid_part.difference(gap)
    cut = shapely.union_all([p for p in parts if solid_part.contains(p.representative_point())])
    assert cut.symmetric_difference(solid_part).area < 1e-6


def test_a_lintel_is_above_each_door(plan: World, things: dict[str, Entry]) -> None:
    for entry in plan.entries:
        if entry.kind == "connector":
            short, z = entry.holder.removeprefix("floor-"), FLOORS[entry.holder]
            x, y = entry.pose.x, entry.pose.y
            inside = solid(things[f"walls-{short}"]).contains([[x, y, z + 1.5], [x, y, z + 2.5]])
            assert inside.tolist() == [False, True], entry.name


def test_the_floor_opens_over_the_stairs(things: dict[str, Entry]) -> None:
    slab = solid(things["slab-1st"])
    assert slab.contains([[2.0, 3.0, -0.1], [0.6, 3.0, -0.1]]).tolist() == [True, False]
    assert solid(things["stairs_down"]).bounds[:, 2] == pytest.approx([-1.85, -0.17])


# The files


def test_the_files_are_those_that_the_plan_makes(tmp_path: Path) -> None:
    subprocess.run([sys.executable, OFFICE / "make_office.py", tmp_path], check=True)
    for made in (p for p in tmp_path.rglob("*") if p.is_file()):
        kept = OFFICE / made.relative_to(tmp_path)
        if made.suffix in (".sdf", ".config", ".geojson"):
            assert kept.read_text() == made.read_text(), kept
        else:
            a, b = (trimesh.load(p, force="mesh") for p in (kept, made))
            assert np.allclose(a.bounds, b.bounds, atol=1e-4), kept
            assert a.area == pytest.approx(b.area, rel=1e-4), kept  # type: ignore[attr-defined]
    assert {p.name for p in tmp_path.glob("models/*")} == {p.name for p in OFFICE.glob("models/*")}


def test_several_mesh_formats_are_used() -> None:
    assert {p.suffix for p in OFFICE.glob("models/*/meshes/*")} == {".obj", ".stl", ".dae", ".glb"}
