"""Stored fields of the small house in its grids and costmaps: as obstacles and as social costs."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.ndimage import distance_transform_edt
from sqlalchemy import Engine, text

from navgrid.costmap import Costmap
from navgrid.map_file import read_map
from navgrid.occupancy_grid import storey_grid
from navgrid.readers.costmaps import read_costmaps
from navgrid.readers.fields import read_fields, read_mirror
from planner.live_topology import LiveTopology, TopologyChange
from planner.readers.robot_class import store_robot_class
from planner.robot_class import RobotClass
from planner.route import NoRouteError
from planner.route_planner import RoutePlanner
from planner.topology import Topology
from semmap.database.files import schema_folder
from semmap.database.maps import see_map
from semmap.fields import Box
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.maps.vocabulary import read_vocabulary
from semmap.fields.sources import People, PersonalSpaceSource, PersonMotion
from semmap.fields.store import field_store
from semmap.fields.store.map_store import save_map
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.geometry.voxels import Voxels
from semmap.limits import REGION_VOXELS
from semmap.query.map_handle import MapHandle
from semmap.query.storey_reader import read_storeys
from semmap.robot import load_robot, robot_parts
from semmap_vdb import BoolGrid
from tests.command_line import semmap
from tests.navgrid.scenes import part, square
from tests.navgrid.test_from_voxels import check_within_a_voxel
from tests.robot.robots import real_robot
from tests.seen import seen_by

NOW = datetime(2026, 11, 21, tzinfo=UTC)
VOCABULARY = read_vocabulary([schema_folder() / "ontology" / "fields.ttl"])


@pytest.fixture(scope="module")
def bare(house: Engine) -> Costmap:
    """The costmap of TIAGo without fields."""
    with house.connect() as connection:
        (made,) = read_costmaps(
            seen_by(connection), robot_parts(load_robot(real_robot("tiago")), {})
        )
    return made


@pytest.fixture(scope="module")
def spot(bare: Costmap) -> tuple[float, float]:
    """The middle of the free cell that is farthest from all costs."""
    row, column = np.unravel_index(
        distance_transform_edt(bare.master == 0).argmax(), bare.master.shape
    )
    grid = bare.grid
    return (
        float(grid.origin[0] + (column + 0.5) * grid.resolution),
        float(grid.origin[1] + (row + 0.5) * grid.resolution),
    )


@pytest.fixture
def fields(house: Engine, bare: Costmap, spot: tuple[float, float]) -> Iterator[str]:
    """The URL of the database with a person at the spot, and the space that she needs."""
    x, y = spot
    floor = bare.scene.elevation
    body = Box((x, y, floor + 0.85), (0.4, 0.3, 1.7))
    (space,) = PersonalSpaceSource(VOCABULARY)(
        People({"human7": PersonMotion(x, y, floor, 0, 0)}, NOW)
    )
    with house.begin() as connection:
        save_map(connection, "people", person(body))
        save_map(connection, "space of human7", space)
    yield house.url.render_as_string(hide_password=False)
    with house.begin() as connection:
        for name in ("people", "space of human7"):
            field_store.forget(connection, name)


def person(body: Box) -> RepresentationMap:
    return RepresentationMap.of_regions(
        VOCABULARY["containsPerson"], [(body, True)], 0.05, about="human7"
    )


def explain(url: str, spot: tuple[float, float], *words: str) -> dict[str, Any]:
    robot = real_robot("tiago")
    done = semmap(
        url, "costmap", "--robot", robot, "--explain", f"{spot[0]},{spot[1]}", *words, "--json"
    )
    assert done.exit_code == 0, done.output
    found: dict[str, Any] = json.loads(done.stdout)[0]
    return found


def test_a_person_in_a_stored_field_is_an_obstacle(fields: str, spot: tuple[float, float]) -> None:
    found = explain(fields, spot)
    assert found["cost"] == 254
    people = [b for b in found["because"] if b["field"] == "people"]
    assert {b["layer"] for b in people} == {"lethal_obstacles"}
    assert {name for b in people for name in b["entities"]} == {"human7"}
    assert len({b["part"] for b in people}) == 4, "she is as tall as TIAGo"
    social = [b for b in found["because"] if b["field"] == "space of human7"]
    assert {(b["layer"], tuple(b["entities"])) for b in social} == {("social", ("human7",))}


def test_options_choose_the_fields(fields: str, spot: tuple[float, float]) -> None:
    assert explain(fields, spot, "--no-fields")["cost"] == 0
    assert 200 < explain(fields, spot, "--field", "space of human7")["cost"] < 253
    assert explain(fields, spot, "--field", "people")["cost"] == 254
    with pytest.raises(LookupError, match="no field named peple; did you mean people"):
        explain(fields, spot, "--field", "peple")
    with pytest.raises(ValueError, match="exclude each other"):
        explain(fields, spot, "--field", "people", "--no-fields")


def test_grid_and_costmap_have_the_same_people(
    fields: str, spot: tuple[float, float], tmp_path: Path
) -> None:
    cells = {}
    for name, words in (("with", ()), ("without", ("--no-fields",))):
        done = semmap(fields, "grid", "-o", tmp_path / name, "--no-picture", "--json", *words)
        (row,) = json.loads(done.stdout)
        assert row["fields"] == ({"people": "lethal_obstacles"} if name == "with" else {})
        cells[name] = read_map(row["map"])
    grid, there = cells["with"]
    new = np.argwhere((there == 100) & (cells["without"][1] != 100))
    low, high = new.min(axis=0), new.max(axis=0) + 1
    corner = np.array(grid.origin)[::-1] + low * grid.resolution
    size = (high - low) * grid.resolution
    # The person is 0.4 x 0.3 m; voxels and cells add up to one each.
    assert (size >= (0.3, 0.4)).all()
    assert (size <= np.array([0.3, 0.4]) + 0.11).all()
    assert np.abs(corner + size / 2 - spot[::-1]).max() < 0.06


def test_a_field_that_the_policy_does_not_name_is_reported(
    fields: str, spot: tuple[float, float], tmp_path: Path
) -> None:
    file = tmp_path / "policy.yaml"
    file.write_text("layers: {all: }\nrules: [{kind: object, layer: all}]\n")
    done = semmap(fields, "grid", "-o", tmp_path / "grid", "--no-picture", "--policy", file)
    assert "no rule for, not used: people, space of human7" in " ".join(done.output.split())
    head = (tmp_path / "grid" / "map.yaml").read_text()
    assert "people" in head


def test_files_for_nav2_have_a_map_for_each_field(
    fields: str, spot: tuple[float, float], tmp_path: Path
) -> None:
    robot = real_robot("tiago")
    box = f"{spot[0] - 1},{spot[1] - 1},{spot[0] + 1},{spot[1] + 1}"
    done = semmap(
        fields, "costmap", "--robot", robot, "-o", tmp_path, "--box", box, "--no-picture", "--json"
    )
    (files,) = json.loads(done.stdout)
    assert files["fields"] == {"people": "lethal_obstacles", "space of human7": "social"}
    grid, people = read_map(tmp_path / files["maps"]["base_field1_people"])
    _, social = read_map(tmp_path / files["maps"]["base_field2_space_of_human7"])
    cell = grid.cell(*spot)
    assert people[cell] == 100
    assert 50 < social[cell] < 100


def test_a_missing_openvdb_is_noticed_where_there_are_fields(fields: str, tmp_path: Path) -> None:
    """Without the native module, a map with fields is an error; grids without fields need none."""

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        start = "import sys; sys.modules['semmap_vdb'] = None; from semmap.cli import main; main()"
        given = ["--db", fields, "grid", "-o", tmp_path / "grid", "--no-picture", *words]
        command = [sys.executable, "-c", start, *map(str, given)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    refused = run()
    assert refused.returncode != 0
    assert "install semmap_vdb" in " ".join(refused.stderr.split())
    assert "people" in refused.stderr
    assert not (tmp_path / "grid").exists()
    assert run("--no-fields").returncode == 0


def test_entities_of_a_legend_are_named(
    house: Engine, bare: Costmap, spot: tuple[float, float]
) -> None:
    """A field of several entities: the one at the nearest cells is the cause."""
    x, y = spot
    z = bare.scene.elevation
    seen = RepresentationMap.of_regions(
        VOCABULARY["containsObject"],
        [
            (Box((x - 0.3, y, z + 0.2), (0.2, 0.2, 0.2)), 1),
            (Box((x + 0.3, y, z + 0.2), (0.2,) * 3), 2),
        ],
        0.05,
        value_type="int32",
        legend={1: "crate", 2: "trolley"},
    )
    with house.connect() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'house', true)"))
        save_map(connection, "seen", seen)
        found = read_fields(seen_by(connection), ["seen"])
        connection.rollback()
    parts = bare.parts[:1]
    made = Costmap(bare.scene, parts, bare.grid, fields=found)
    assert made.explain(x - 0.3, y)[0].entities == ("crate",)
    assert made.explain(x + 0.3, y)[0].entities == ("trolley",)
    assert made.explain(x + 0.3, y)[0].field == "seen"


SEEN = "camera containsPerson human7"
"""The field in which the service keeps what its source `camera` sees."""


def see(engine: Engine, visitor: RepresentationMap) -> None:
    """Keep what a camera sees as a service does: its last map, and a record that names it."""
    provides, save = "urn:semmap:ontology#provides", field_store.save
    with engine.begin() as connection:
        version = save(
            connection,
            SEEN,
            visitor.grid,
            property=visitor.property.iri,
            about="human7",
            state={"of": "source"},
        )
        record = {"source": "camera", "provides": ["containsPerson"], "maps": {SEEN: version}}
        save(connection, "source camera", BoolGrid(1.0, False), property=provides, state=record)


def end_of_sight(engine: Engine) -> None:
    """Let an hour pass since the camera saw something."""
    with engine.begin() as connection:
        connection.execute(
            text(
                "UPDATE field_version v SET at = at - interval '1 hour' FROM field f "
                "WHERE f.id = v.field_id AND f.name IN (:seen, 'source camera')"
            ),
            {"seen": SEEN},
        )


@pytest.fixture
def camera(house: Engine) -> Iterator[Engine]:
    """The house, whose kept sight is forgotten in the end."""
    yield house
    with house.begin() as connection:
        for each in (SEEN, "source camera"):
            field_store.forget(connection, each)


def test_fields_of_sources_count_while_they_are_live(
    camera: Engine, bare: Costmap, spot: tuple[float, float]
) -> None:
    x, y = spot
    see(camera, person(Box((x, y, bare.scene.elevation + 0.85), (0.4, 0.3, 1.7))))
    url = camera.url.render_as_string(hide_password=False)
    found = explain(url, spot)
    assert {b["field"] for b in found["because"] if b["cost"] == 254} == {SEEN}
    end_of_sight(camera)
    assert explain(url, spot)["cost"] == 0
    done = semmap(url, "costmap", "--robot", real_robot("tiago"), "--explain", f"{x},{y}")
    assert f"for 60 s, not used: {SEEN}" in " ".join(done.output.split())
    assert explain(url, spot, "--field", SEEN)["cost"] == 254


# -- from voxels alone -------------------------------------------------------------------------


def test_a_costmap_from_the_mirror_equals_that_from_meshes(house: Engine, bare: Costmap) -> None:
    """Per part of TIAGo: each occupied cell of one has one of the other within a voxel."""
    with house.connect() as connection:
        voxels = read_mirror(MapHandle(house, "house"))
        (made,) = read_costmaps(seen_by(connection), bare.parts, voxels=voxels)
    assert made.grid == bare.grid
    assert all(not len(e.triangles) for e in made.scene.entities)
    for interval in [(0.02, 3.0), *bare.intervals]:
        check_within_a_voxel(bare.scene, made.scene, interval, 0.05, bare.grid)
    row, column = np.argwhere(made.master == 254)[1000]
    x, y = (o + (c + 0.5) * 0.05 for o, c in zip(made.grid.origin, (column, row), strict=True))
    assert made.explain(x, y)[0].entities, "voxels have the names of their entities"


def test_a_grid_of_the_hotel_from_the_mirror_has_no_mesh(hotel: Engine) -> None:
    """Walls and shut doors, too, are voxels alone; the cells are those of meshes within a voxel."""
    with hotel.connect() as connection:
        meshes = read_storeys(seen_by(connection))
        storeys = read_storeys(seen_by(connection), voxels=read_mirror(MapHandle(hotel, "hotel")))
    for there, here in zip(meshes, storeys, strict=True):
        shown = {e.id for e in there.entities if len(e.triangles)}
        assert {e.kind for e in there.entities if e.id in shown} == {"object", "connector"}
        assert {e.id for e in here.entities if e.voxels is not None} == shown
        assert not any(len(e.triangles) for e in here.entities)
        for interval in [(0.05, 1.8), (0.3, 0.6)]:
            check_within_a_voxel(there, here, interval, 0.05, storey_grid(there).grid)


def test_walls_of_rooms_follow_the_map(house: Engine, tmp_path: Path) -> None:
    """A room with a mesh is its space in the mirror, and its walls beside it, through restarts."""
    url = house.url.render_as_string(hide_password=False)
    shed = trimesh.creation.box((2, 2, 2), trimesh.transformations.translation_matrix((30, 0, 1)))
    shed.export(tmp_path / "shed.ply")
    done = semmap(url, "import", tmp_path / "shed.ply", "--map", "house", "--as", "room")
    assert done.exit_code == 0, done.output
    try:
        mirror = VoxelMirror(house, "house")
        mirror.catch_up()
        mirror.save()
        number = next(n for n, name in mirror.names.items() if name == "shed")
        assert len(mirror.regions.voxels(number)) == 40**3
        for each in (mirror, VoxelMirror.resume(house, "house")):
            assert each.catch_up() == set()
            walls = Voxels(0.05, each.walls.voxels(number).astype(np.int64))
            assert walls.corners is not None
            np.testing.assert_allclose(walls.corners, [(29, -1, 0), (31, 1, 2)], atol=0.051)
            assert not (np.abs(walls.centres - (30, 0, 1)) < 0.94).all(axis=1).any()
        with house.begin() as connection:
            connection.execute(
                text("UPDATE placement SET pose[1] = pose[1] + 5 WHERE entity_id = :id"),
                {"id": number},
            )
        mirror = VoxelMirror.resume(house, "house")
        assert number in mirror.catch_up()
        assert mirror.walls.voxels(number)[:, 0].min() >= 33 / 0.05
    finally:
        with house.begin() as connection:
            connection.execute(text("DELETE FROM entity WHERE name = 'shed'"))
    mirror.catch_up()
    assert number not in mirror.walls


def test_a_point_cloud_is_an_obstacle(
    house: Engine, bare: Costmap, spot: tuple[float, float], tmp_path: Path
) -> None:
    """A scanned block has points and no mesh: meshes and mirror give the same cells."""
    url = house.url.render_as_string(hide_password=False)
    middle = np.array([*spot, bare.scene.elevation + 0.2])
    points = middle + np.random.default_rng(5).uniform(-0.1, 0.1, (4000, 3))
    trimesh.PointCloud(points).export(tmp_path / "block.ply")
    done = semmap(url, "import", tmp_path / "block.ply", "--map", "house", "--json")
    assert done.exit_code == 0, done.output
    try:
        found = {}
        for words in ((), ("--from-voxels",)):
            found[words] = explain(url, spot, "--no-fields", *words)["because"]
            lethal = {b["part"]: b["entities"] for b in found[words] if b["cost"] == 254}
            assert lethal["base"] == ["block"]
            assert "head" not in lethal, "it is higher"
        assert [b["part"] for b in found[()]] == [b["part"] for b in found["--from-voxels",]]
        done = semmap(url, "grid", "-o", tmp_path / "grid", "--no-picture", "--json")
        assert "block" not in json.loads(done.stdout)[0]["no_geometry"]
    finally:
        with house.begin() as connection:
            connection.execute(text("DELETE FROM entity WHERE name = 'block'"))


def test_objects_beyond_the_limits_of_voxels_are_named(
    house: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = house.url.render_as_string(hide_password=False)
    monkeypatch.setenv(REGION_VOXELS.variable, "20000")
    with pytest.raises(ValueError, match=r"has no voxels: .*; take larger voxels"):
        semmap(url, "grid", "-o", tmp_path, "--from-voxels", "--voxel-size", 0.06)
    assert list(tmp_path.iterdir()) == []


# -- the planner on the same costmaps -----------------------------------------------------


@pytest.fixture(scope="module")
def robot(house: Engine) -> str:
    """The name of a class of slim robots, which fit through all doors."""
    cart = part("cart", 0.0, 0.6, square(0.15))
    with house.begin() as connection:
        store_robot_class(connection, RobotClass("cart", (cart,), speed=0.5))
    return "cart"


def crowd(topology: Topology) -> RepresentationMap:
    """People who fill the passage of the kitchen's door."""
    poses = topology.connectors["kitchen-door"].poses
    middle = np.mean([(p.x, p.y, p.z + 0.9) for p in poses], axis=0)
    return person(Box(tuple(middle), (2.5, 2.5, 1.8)))


def travel(live: LiveTopology) -> dict[tuple[int, int], float]:
    graph = live.graph
    edges = zip(graph.tails.tolist(), graph.heads.tolist(), strict=True)
    return dict(zip(edges, graph.seconds.tolist(), strict=True))


def test_travel_times_follow_fields(house: Engine, robot: str) -> None:
    """What a live topology takes over equals one that is loaded again, stored times included."""
    live = LiveTopology(MapHandle(house, "house"), robot)
    live.warm()
    free = travel(live)
    with house.begin() as connection:
        save_map(connection, "crowd", crowd(live.topology))
    change = live.catch_up()
    assert not change.reloaded
    assert {"kitchen", "living-room"} <= change.places
    assert live.catch_up().places == frozenset()
    jammed = travel(live)
    assert sum(map(np.isinf, jammed.values())) > sum(map(np.isinf, free.values()))
    again = LiveTopology(MapHandle(house, "house"), robot)
    assert travel(again) == jammed, "from the stored travel times"
    assert (
        travel(LiveTopology(MapHandle(house, "house"), replace(again.graph.robot, name="new")))
        == jammed
    )
    with house.begin() as connection:
        field_store.forget(connection, "crowd")
    assert travel(LiveTopology(MapHandle(house, "house"), robot)) == free
    assert {"kitchen", "living-room"} <= live.catch_up().places
    assert travel(live) == free


def test_people_close_a_route(house: Engine, robot: str) -> None:
    planner = RoutePlanner.of_map(MapHandle(house, "house"), robot)
    assert planner.route("bedroom", "kitchen").seconds > 0
    with house.begin() as connection:
        save_map(connection, "crowd", crowd(planner.graph.topology))
    try:
        with pytest.raises(NoRouteError):
            RoutePlanner.of_map(MapHandle(house, "house"), robot).route("bedroom", "kitchen")
    finally:
        with house.begin() as connection:
            field_store.forget(connection, "crowd")


def test_simulated_runs_have_the_stored_fields(house: Engine, robot: str) -> None:
    """A run takes place in a copy of the map: its costmaps have the same people."""
    topology = LiveTopology(MapHandle(house, "house"), robot).topology
    with house.begin() as connection:
        save_map(connection, "crowd", crowd(topology))
    try:
        with house.begin() as connection:
            connection.execute(text("SELECT copy_map('house', 'run')"))
        here, there = (
            travel(LiveTopology(MapHandle(house, name), robot)) for name in ("house", "run")
        )
        assert sorted(here.values()) == pytest.approx(sorted(there.values()))
        with house.connect() as connection:
            see_map(connection, "run")
            assert len(read_fields(seen_by(connection))["crowd"].voxels) > 1000
    finally:
        with house.begin() as connection:
            see_map(connection, "house")
            field_store.forget(connection, "crowd")
            connection.execute(text("SELECT drop_map('run')"))


def test_a_stored_field_wakes_followers(house: Engine, robot: str) -> None:
    live = LiveTopology(MapHandle(house, "house"), robot)
    stop = threading.Event()
    seen: list[TopologyChange] = []

    def note(change: TopologyChange) -> None:
        seen.append(change)
        stop.set()

    thread = threading.Thread(target=live.follow, args=(stop, note))
    thread.start()
    try:
        time.sleep(0.5)
        with house.begin() as connection:
            save_map(connection, "crowd", crowd(live.topology))
        assert stop.wait(20)
    finally:
        stop.set()
        thread.join()
        with house.begin() as connection:
            field_store.forget(connection, "crowd")
    assert "kitchen" in seen[0].places


# -- live fields in travel times ----------------------------------------------------------


def test_travel_times_follow_what_a_camera_sees(camera: Engine, robot: str) -> None:
    """People count while they are seen; stored travel times are those without them."""
    live = LiveTopology(MapHandle(camera, "house"), robot)
    free = travel(live)
    stored = read_stored(camera)
    see(camera, crowd(live.topology))
    assert {"kitchen", "living-room"} <= live.catch_up().places
    jammed = travel(live)
    assert sum(map(np.isinf, jammed.values())) > sum(map(np.isinf, free.values()))
    assert travel(LiveTopology(MapHandle(camera, "house"), robot)) == jammed
    assert not live.catch_up()
    assert read_stored(camera) == stored
    end_of_sight(camera)
    assert {"kitchen", "living-room"} <= live.catch_up().places
    for each in (live, LiveTopology(MapHandle(camera, "house"), robot)):
        assert travel(each) == pytest.approx(free)


def test_what_moves_while_people_are_seen_is_stored_later(camera: Engine, robot: str) -> None:
    """A bin in the kitchen's door: travel times are not stored with the people in them."""
    live = LiveTopology(MapHandle(camera, "house"), robot)
    free = travel(live)
    see(camera, crowd(live.topology))
    live.warm()
    poses = live.topology.connectors["kitchen-door"].poses
    x, y = np.mean([(p.x, p.y) for p in poses], axis=0)
    with camera.begin() as connection:
        see_map(connection, "house")
        before = connection.execute(
            text(
                "SELECT entity_id, pose FROM placement WHERE entity_id = entity_id('Trash_01_001')"
            )
        ).one()
        connection.execute(
            text("SELECT move_to(:id, :x, :y, 0)"), {"id": before.entity_id, "x": x, "y": y}
        )
    try:
        live.catch_up()
        end_of_sight(camera)
        live.catch_up()
        bare = RobotClass("cart", (part("cart", 0.0, 0.6, square(0.15)),), speed=0.5)
        measured = travel(LiveTopology(MapHandle(camera, "house"), bare))
        assert travel(live) != pytest.approx(free)
        for each in (live, LiveTopology(MapHandle(camera, "house"), robot)):
            assert travel(each) == pytest.approx(measured)
    finally:
        with camera.begin() as connection:
            connection.execute(
                text("UPDATE placement SET pose = :pose WHERE entity_id = :id"),
                {"id": before.entity_id, "pose": before.pose},
            )


def test_a_followed_map_has_what_a_camera_sees(camera: Engine, robot: str) -> None:
    """No notification announces it: followers look each second."""
    live = LiveTopology(MapHandle(camera, "house"), robot)
    stop, seen = threading.Event(), threading.Event()
    thread = threading.Thread(target=live.follow, args=(stop, lambda _: seen.set()))
    thread.start()
    try:
        see(camera, crowd(live.topology))
        assert seen.wait(20)
        seen.clear()
        end_of_sight(camera)
        assert seen.wait(20)
    finally:
        stop.set()
        thread.join()


def test_people_whom_a_camera_sees_close_a_route_also_in_a_simulated_run(
    camera: Engine, robot: str
) -> None:
    planner = RoutePlanner.of_map(MapHandle(camera, "house"), robot)
    assert planner.route("bedroom", "kitchen").seconds > 0
    see(camera, crowd(planner.graph.topology))
    with camera.begin() as connection:
        connection.execute(text("SELECT copy_map('house', 'run')"))
    try:
        for name in ("house", "run"):
            with pytest.raises(NoRouteError):
                RoutePlanner.of_map(MapHandle(camera, name), robot).route("bedroom", "kitchen")
    finally:
        with camera.begin() as connection:
            connection.execute(text("SELECT drop_map('run')"))


def read_stored(engine: Engine) -> list[tuple[object, ...]]:
    with engine.connect() as connection:
        rows = connection.execute(text("SELECT * FROM travel_time ORDER BY 1, 2, 3, 4"))
        return [tuple(row) for row in rows]
