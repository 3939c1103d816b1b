"""TIAGo in the small house, Stretch in the hotel: costmaps checked by an independent way."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
import yaml
from numpy.typing import NDArray
from sqlalchemy import Engine, text

from navgrid.costmap import Costmap
from navgrid.costmap_output import NoFreeCellError, check_free
from navgrid.grid import Grid, scene_grid
from navgrid.nav2 import write_nav2
from navgrid.occupancy_grid import storey_grid
from planner.live_topology import LiveTopology
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from semmap.database.maps import see_map
from semmap.query.geometry_notes import geometry_lists, geometry_notes, read_names_without_geometry
from semmap.query.map_handle import MapHandle
from semmap.query.storey_reader import read_scene, read_storey_names, read_storeys
from semmap.query.storey_scene import StoreyScene
from semmap.robot import load_robot, robot_parts
from tests.command_line import semmap
from tests.navgrid.scenes import BASE, part, square
from tests.robot.robots import real_robot
from tests.seen import seen_by


def costmap_of(engine: Engine, name: str, storey: str | None, robot: str) -> Costmap:
    with engine.connect() as connection:
        see_map(connection, name)
        scene = read_scene(seen_by(connection), storey or read_storey_names(seen_by(connection))[0])
    parts = robot_parts(load_robot(real_robot(robot)), {})
    return Costmap(scene, parts, scene_grid(scene, 0.05))


def touched(scene: StoreyScene, square: shapely.Polygon, low: float, high: float) -> bool:
    """Whether a thing's triangles between two heights meet a square: trimesh cuts, shapely asks."""
    x0, y0, x1, y1 = square.bounds
    for thing in scene.entities:
        t = thing.triangles
        if thing.kind != "object" or not len(t):
            continue
        near = (
            (t[:, :, 0].min(1) <= x1)
            & (t[:, :, 0].max(1) >= x0)
            & (t[:, :, 1].min(1) <= y1)
            & (t[:, :, 1].max(1) >= y0)
            & (t[:, :, 2].min(1) <= high)
            & (t[:, :, 2].max(1) >= low)
        )
        for triangle in t[near]:
            if between(triangle, low, high).distance(square) == 0:
                return True
    return False


def between(triangle: NDArray[np.float64], low: float, high: float) -> shapely.Geometry:
    vertices, faces = triangle, np.array([[0, 1, 2]])
    for side, at in ((1, low), (-1, high)):
        if len(faces):
            vertices, faces, _ = trimesh.intersections.slice_faces_plane(
                vertices, faces, (0, 0, side), (0, 0, at)
            )
    if not len(faces):
        return shapely.Point()
    return shapely.union_all(shapely.convex_hull(shapely.multipoints(vertices[faces][:, :, :2])))


def check(made: Costmap, count: int) -> None:
    """Random cells: occupied if something reaches into the part's interval there."""
    random = np.random.default_rng(8)
    grid, floor = made.grid, made.scene.elevation
    for number, (low, high) in enumerate(made.intervals):
        occupied = np.zeros(grid.shape, bool)
        for name in ("admissible_objects", "lethal_obstacles", "room_geometry"):
            occupied |= made.occupied[name][number]
        sure = [np.argwhere(occupied == value) for value in (True, False)]
        for value, cells in zip((True, False), sure, strict=True):
            for r, c in cells[random.integers(0, len(cells), count)]:
                x, y = grid.origin[0] + c * 0.05, grid.origin[1] + r * 0.05
                inner = shapely.box(x + 1e-6, y + 1e-6, x + 0.05 - 1e-6, y + 0.05 - 1e-6)
                outer = shapely.box(x - 1e-6, y - 1e-6, x + 0.05 + 1e-6, y + 0.05 + 1e-6)
                if value:
                    assert touched(made.scene, outer, floor + low, floor + high) or filled(
                        made, number, r, c
                    )
                else:
                    assert not touched(made.scene, inner, floor + low, floor + high)


def filled(made: Costmap, number: int, r: int, c: int) -> bool:
    """Whether the cell's middle is inside of a closed thing, at the lower end of the interval."""
    low = made.intervals[number][0] + made.scene.elevation
    x = made.grid.origin[0] + (c + 0.5) * made.grid.resolution
    y = made.grid.origin[1] + (r + 0.5) * made.grid.resolution
    point = shapely.Point(x, y)
    for thing in made.scene.entities:
        if thing.kind != "object" or thing.bounds is None:
            continue
        if shapely.box(*thing.bounds).contains(point):
            faces = np.arange(3 * len(thing.triangles)).reshape(-1, 3)
            body = trimesh.Trimesh(thing.triangles.reshape(-1, 3), faces)
            if body.contains([[x, y, low + 1e-6]]).any():
                return True
    return False


def test_tiago_in_the_small_house(house: Engine, tmp_path: Path) -> None:
    made = costmap_of(house, "house", None, "tiago")
    check(made, 25)
    free = (made.master < 253).mean()
    assert 0.1 < free < 0.7
    said = write_nav2(made, tmp_path)
    assert len(said["maps"]) >= 1 + 4 + 4 * 4 + 1
    row, column = np.argwhere(made.master == 254)[0]
    x = made.grid.origin[0] + (column + 0.5) * 0.05
    y = made.grid.origin[1] + (row + 0.5) * 0.05
    assert made.explain(x, y)[0].cost == 254
    assert made.explain(x, y)[0].entities
    check_parameters(tmp_path, set(said["maps"]))


def check_parameters(folder: Path, maps: set[str]) -> None:
    """The rules of rcl's parser, on the events that it gets from YAML; and the files named."""
    file = folder / "nav2_params.yaml"
    assert not any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(file.read_text()))
    params = yaml.safe_load(file.read_text())

    def check_node(node: object, path: str) -> None:
        assert isinstance(node, dict), f"{path} has a value above ros__parameters"
        for key, value in node.items():
            if key == "ros__parameters":
                assert path, "parameters belong to a node"
                check_value(value, path)
            else:
                check_node(value, f"{path}/{key}")

    def check_value(value: object, path: str) -> None:
        if isinstance(value, dict):
            assert value, f"{path} is empty"
            assert "ros__parameters" not in value, path
            for key, inner in value.items():
                check_value(inner, f"{path}.{key}")
        elif isinstance(value, list):
            assert len({type(item) for item in value}) == 1, f"{path} is of one type"
            check_value(value[0], path)
            assert not isinstance(value[0], dict | list), path
        else:
            assert isinstance(value, bool | int | float | str), path

    check_node(params, "")
    named = {
        Path(inner["yaml_filename"])
        for node in params.values()
        if "yaml_filename" in (inner := node.get("ros__parameters", {}))
    }
    assert {path.stem for path in named} == maps
    for path in named:  # Nav2 does not start in this folder
        assert path.is_absolute()
        assert (path.parent / yaml.safe_load(path.read_text())["image"]).is_file()


@pytest.mark.parametrize("level", ["L1", "L2", "L3"])
def test_stretch_in_the_hotel(level: str, hotel: Engine, tmp_path: Path) -> None:
    made = costmap_of(hotel, "hotel", level, "stretch")
    check(made, 10)
    inside = ~made.unknown
    assert 0.3 < (made.master[inside] < 253).mean() < 0.98
    assert (made.master == 255).any()
    said = write_nav2(made, tmp_path)
    check_parameters(tmp_path, set(said["maps"]))


def test_typical_sizes_of_furniture_in_the_hotel(hotel: Engine) -> None:
    """Objects without geometry get boxes where they stand; what has no typical size is listed."""
    with hotel.connect() as connection:
        see_map(connection, "hotel")
        bare = read_scene(seen_by(connection), "L2")
        scene = read_scene(seen_by(connection), "L2", assume_sizes=True)
        unknown = read_names_without_geometry(seen_by(connection))
    assert len(unknown) == 175
    missing = geometry_lists(bare.entities)["no_geometry"]
    assert len(missing) == 59
    assert not any(entity.assumed for entity in bare.entities)
    assert not geometry_lists(scene.entities)["no_geometry"]
    boxes = {entity.name: entity for entity in scene.entities if entity.assumed}
    assert {*boxes} == {*missing}
    for entity in boxes.values():
        low, high = entity.triangles.min(axis=(0, 1)), entity.triangles.max(axis=(0, 1))
        assert np.allclose((low + high)[:2] / 2, (entity.pose.x, entity.pose.y))
        assert low[2] == pytest.approx(entity.pose.z)
    heights = {b.types[0]: float(np.ptp(b.triangles[:, :, 2])) for b in boxes.values()}
    assert heights["bed"] == pytest.approx(0.6)
    assert heights["shower"] == pytest.approx(2.1)
    (note,) = geometry_notes(scene.entities)
    assert "59 objects with no geometry: the typical size of the type is assumed" in note
    made = Costmap(scene, [BASE], scene_grid(scene, 0.1))
    bed = boxes["NormalBed"]
    (cause, *_) = made.explain(bed.pose.x, bed.pose.y)
    assert (cause.cost, cause.entities, cause.assumed) == (254, ("NormalBed",), ("NormalBed",))


def test_routes_and_plans_assume_sizes_too(hotel: Engine) -> None:
    """Ways around typical beds are longer, and are not stored: others do not assume them."""
    with hotel.begin() as connection:
        store_robot_class(connection, RobotClass("cart", (part("cart", 0.0, 0.6, square(0.15)),)))
        rooms = connection.execute(text(_TWO_BESIDE_BEDS)).one()
    url = hotel.url.render_as_string(hide_password=False)
    stored = "SELECT count(*), sum(seconds) FROM travel_time"
    words = (rooms.one, rooms.other, "--robot", "cart", "--json", "--map", "hotel")
    bare = json.loads(semmap(url, "route", *words).stdout)
    with hotel.connect() as connection:
        before = connection.execute(text(stored)).one()
    assumed = json.loads(semmap(url, "route", *words, "--assume-sizes").stdout)
    assert assumed["assumed_sizes"] == bare["no_geometry"] != []
    assert (assumed["no_geometry"], bare["assumed_sizes"]) == ([], [])
    live = {
        flag: LiveTopology(MapHandle(hotel, "hotel"), "cart", assume_sizes=flag)
        for flag in (False, True)
    }
    with hotel.connect() as connection:
        assert connection.execute(text(stored)).one() == before
    costs = {flag: each.costmaps for flag, each in live.items()}
    for storey in ("L1", "L2"):
        masters = {flag: made.costmap(storey).master for flag, made in costs.items() if made}
        more = (masters[True] == 254).sum() / (masters[False] == 254).sum()
        assert (masters[True] >= masters[False]).all()
        assert more > 1.2
    times = {flag: each.graph.seconds for flag, each in live.items()}
    assert (times[True] > times[False] + 0.1).any()
    goal = f"in(robot, {rooms.other})"
    planned = semmap(url, "plan", goal, "--from", rooms.one, *words[2:], "--assume-sizes")
    assert planned.exit_code == 0, planned.output
    anyone = (rooms.one, rooms.other, "--map", "hotel", "--json", "--assume-sizes")
    assert json.loads(semmap(url, "route", *anyone).stdout)["assumed_sizes"] != []


_TWO_BESIDE_BEDS = """
SELECT min(r.name) AS one, max(r.name) AS other FROM entity r
WHERE r.kind = 'room' AND r.name LIKE 'L2-%' AND EXISTS (
    SELECT FROM placement p JOIN entity o ON o.id = p.entity_id
    WHERE p.holder_id = r.id AND o.kind = 'object' AND o.type LIKE '%bed')
"""


def test_commands_list_or_assume_missing_geometry(hotel: Engine, tmp_path: Path) -> None:
    url = hotel.url.render_as_string(hide_password=False)
    words = ("--map", "hotel", "--storey", "L3", "--no-picture", "--json")
    lists = {}
    for name in ("", "--assume-sizes"):
        done = semmap(url, "grid", "-o", tmp_path / name, *words, *([name] if name else []))
        (row,) = json.loads(done.stdout)
        lists[name] = row
    assert len(lists[""]["no_geometry"]) == len(lists["--assume-sizes"]["assumed_sizes"]) == 55
    assert lists[""]["assumed_sizes"] == lists["--assume-sizes"]["no_geometry"] == []
    assert lists["--assume-sizes"]["occupied"] > 2 * lists[""]["occupied"]
    head = (tmp_path / "--assume-sizes" / "map.yaml").read_text()
    assert "the typical size of the type is assumed" in head
    done = semmap(url, "route", "L2_master_suite", "L3_master_suite", "--map", "hotel", "--json")
    assert "NormalBed_18" in json.loads(done.stdout)["no_geometry"]


@pytest.mark.parametrize("world", ["house", "hotel", "clinic"])
def test_grid_and_costmap_agree_slab_by_slab(world: str, request: pytest.FixtureRequest) -> None:
    engine: Engine = request.getfixturevalue(world)
    with engine.connect() as connection:
        see_map(connection, world)
        storeys = read_storeys(seen_by(connection))
    assert len(storeys) == {"house": 1, "hotel": 3, "clinic": 2}[world]
    slabs = [(round(0.05 + 0.35 * k, 2), round(0.4 + 0.35 * k, 2)) for k in range(5)]
    robot = [part(f"slab{k}", *slab, square(0.2)) for k, slab in enumerate(slabs)]
    for storey in storeys:
        made = Costmap(storey, robot, scene_grid(storey, 0.1))
        for number, slab in enumerate(slabs):
            occupied = np.any([cells[number] for cells in made.occupied.values()], axis=0)
            grid = storey_grid(storey, slab, grid=made.grid)
            assert occupied.any()
            np.testing.assert_array_equal(grid.cells == 100, occupied)
            np.testing.assert_array_equal(grid.cells == -1, made.unknown & ~occupied)


def test_the_interval_of_a_grid_is_given_as_its_help_shows_it(
    house: Engine, tmp_path: Path
) -> None:
    url = house.url.render_as_string(hide_password=False)
    (shown,) = re.findall(r"--interval\s+(\S+)", semmap(url, "grid", "--help").output)
    assert shown == "LOW,HIGH"
    with house.connect() as connection:
        see_map(connection, "house")
        (scene,) = read_storeys(seen_by(connection))
    words = ("grid", "--resolution", "0.1", "--no-picture", "--json", "--map", "house")
    occupied = set()
    for low, high in ((0.05, 0.3), (1.2, 1.8)):
        given = shown.replace("LOW", str(low)).replace("HIGH", str(high))
        done = semmap(url, *words, "-o", tmp_path / given, "--interval", given)
        (row,) = json.loads(done.stdout)
        cells = storey_grid(scene, (low, high), 0.1).cells
        assert row["occupied"] == (cells == 100).sum()
        occupied.add(row["occupied"])
    assert len(occupied) == 2
    with pytest.raises(ValueError, match="--interval LOW,HIGH"):
        semmap(url, *words, "-o", tmp_path / "none", "--interval", "0.05")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("change", "half", "cause"),
    [
        (
            "WITH ground AS (UPDATE entity SET type = 'furniture' WHERE id = "
            "entity_id('FloorB_01_001')) UPDATE room SET floor = -0.05 WHERE entity_id IN "
            "(SELECT id FROM entity WHERE map_id = current_map())",
            0.2,
            r"FloorB_01_001 .*its top is 0\.050 m above the floor at z = -0\.050 m",
        ),
        (
            "INSERT INTO gis_region (map, storey, name, type, geom) VALUES ('house', "
            "'ground-floor', 'wet floor', 'blocked_region', "
            "ST_Multi(ST_MakeEnvelope(-12, -9, 12, 9, 0)))",
            0.2,
            "wet floor .*covers 100%.*check its type",
        ),
        ("SELECT 1", 3.0, r"part base keeps 3\.00 m from them; take a smaller robot"),
    ],
    ids=["floor-of-another-type-above-that-of-the-rooms", "blocked-region", "too-wide"],
)
def test_a_small_house_without_a_free_cell_names_the_cause(
    change: str, half: float, cause: str, house: Engine
) -> None:
    with house.connect() as connection:
        see_map(connection, "house")
        connection.execute(text(change))
        scene = read_scene(seen_by(connection), "ground-floor")
        connection.rollback()
    inside = Grid((-9.2, -5.4), 0.1, (80, 180))  # without the ground before the front door
    made = Costmap(scene, [part("base", 0.0, 0.3, square(half))], inside)
    with pytest.raises(NoFreeCellError, match=f"ground-floor: no cell.*{cause}"):
        check_free(made)


WORLD = """<sdf version="1.7"><world name="yard">
{bodies}
</world></sdf>"""
BODY = """<model name="{name}"><static>true</static><pose>{x} {y} {z} 0 0 0</pose><link name="l">
<visual name="v"><geometry><box><size>{dx} {dy} {dz}</size></box></geometry></visual>
</link></model>"""


def test_a_ground_above_zero_is_the_floor_of_a_world_without_rooms(
    database: str, tmp_path: Path
) -> None:
    """Its top is at +0.034 m; where nothing is free, the cause is named and no file is written."""
    ground = {"name": "ground", "x": 0, "y": 0, "z": -0.016, "dx": 8, "dy": 8, "dz": 0.1}
    for size in (1, 9):
        crate = {"name": "crate", "x": 0, "y": 0, "z": 0.534, "dx": size, "dy": size, "dz": 1}
        file = tmp_path / f"yard{size}.world"
        file.write_text(WORLD.format(bodies=BODY.format(**ground) + BODY.format(**crate)))
        done = semmap(database, "import", file, "--map", f"yard{size}")
        assert done.exit_code == 0, done.output
    robot = real_robot("tiago")
    words = ("costmap", "--robot", robot, "--resolution", "0.1", "--no-picture", "--json")
    done = semmap(database, *words, "-o", tmp_path / "yard", "--map", "yard1")
    (files,) = json.loads(done.stdout)
    assert files["elevation"] == pytest.approx(0.034)
    assert 0 < files["lethal"] < 0.05 * files["width"] * files["height"]
    with pytest.raises(ValueError, match=r"no cell of the costmap is free: .*crate"):
        semmap(database, *words, "-o", tmp_path / "none", "--map", "yard9", "--box", "-2,-2,2,2")
    assert not (tmp_path / "none").exists()
