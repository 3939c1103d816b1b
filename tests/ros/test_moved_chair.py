"""A chair that a robot detects elsewhere: in costmap, SPARQL, events and scene, after kills too."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
import pytest
import shapely

import semmap
from semmap.database import Cluster, open_engine
from tests.cluster_folder import cluster_folder
from tests.ros.conftest import Peer, RunNode, detection, header
from tests.served import served
from tests.worlds.conftest import HOUSE, ROOMS, store_slim_robot

CHAIR = "ChairA_01_001"
COSTMAP, GRIDS = "/semmap/ground_floor/costmap", "nav_msgs/msg/OccupancyGrid"
DETECTIONS = "/semmap/detections", "vision_msgs/msg/Detection3DArray"
HEIGHTS = 0.05, 1.0
"""Of the base of the slim robot, metres."""
LETHAL = 100
WEST, SOUTH = (0.0, 1.5), (3.5, -3.0)
"""Free spots in the living room, x and y in metres; the chair comes from the kitchen."""
WHERE = f"""SELECT ?room ?shape WHERE {{
    :{CHAIR} oro:isIn ?room ; geo:hasDefaultGeometry/geo:asWKT ?shape }}"""


class House(NamedTuple):
    """The small house, as it was imported, with what serves it."""

    cluster: Cluster
    peer: Peer
    web: httpx.Client
    start_node: Callable[[], Any]
    chairs: dict[str, Any]  # their meshes


@pytest.fixture(scope="module")
def house(peer: Peer, run_node: RunNode, worlds: Path) -> Iterator[House]:
    with cluster_folder(Path("/tmp")) as folder, ExitStack() as stack:
        cluster = Cluster(folder / "house")
        url = cluster.ensure().set(drivername="postgresql").render_as_string(hide_password=False)
        db = stack.enter_context(semmap.connect(url, migrate=True))
        for file in (worlds / HOUSE, ROOMS):
            db.import_file(file, map="house")
        engine = open_engine(cluster.ensure())
        store_slim_robot(engine)
        engine.dispose()
        db.map("house").add_agent("rover", pose=(0.0, 0.0, 0.0, 0.0))  # its frame is the map's
        chairs = {each.name: each.mesh for each in db.map("house").find("chair")}
        web = httpx.Client(base_url=stack.enter_context(served(db)), timeout=30)
        stack.enter_context(web)
        nodes = ExitStack()

        def start_node() -> Any:
            return nodes.enter_context(run_node(url, "house", robot="slim", oldest=60.0))

        with nodes:
            yield House(cluster, peer, web, start_node, chairs)


@pytest.fixture(scope="module")
def node(house: House) -> list[Any]:
    """The process of the node, the newest one last."""
    return [house.start_node()]


def leave_alone(house: House, node: list[Any]) -> None:
    pass


def kill_node(house: House, node: list[Any]) -> None:
    node[-1].kill()
    node[-1].wait()
    node.append(house.start_node())


def stop_database(house: House, node: list[Any]) -> None:
    """At once: the server ends its sessions, writes nothing, and recovers when it starts."""
    pid = int((house.cluster.data / "postmaster.pid").read_text().split()[0])
    os.kill(pid, signal.SIGQUIT)
    while Path(f"/proc/{pid}").exists():
        time.sleep(0.02)
    house.cluster.ensure()


@pytest.mark.parametrize("harm", [leave_alone, kill_node, stop_database])
def test_a_chair_that_was_moved_is_elsewhere_in_all_faces(
    house: House, node: list[Any], harm: Any
) -> None:
    detect(house, WEST)
    check_faces(house, WEST)
    harm(house, node)
    check_faces(house, WEST)
    detect(house, SOUTH)
    check_faces(house, SOUTH)
    assert node[-1].poll() is None


def detect(house: House, spot: tuple[float, float]) -> None:
    """Send views of all chairs, one of them at a spot, until the server has an event of it.

    The first one is in doubt, as the chair was in another room; another observer confirms it.
    """
    cursor, found = house.web.get("/maps/house/scene").json()["cursor"], []
    for name, mesh in house.chairs.items():
        low, high = mesh.bounds
        x, y, z = (low + high) / 2
        point = (*spot, z) if name == CHAIR else (x, y, z)
        size = dict(zip("xyz", map(float, high - low), strict=True))
        seen = detection("chair", point)
        seen["bbox"]["size"] = size
        found.append(seen)
    for frame in ["map", "house/rover"] * 20:  # a node that starts misses the first ones
        house.peer("send", *DETECTIONS, {"header": header(frame), "detections": found})
        event = move_since(house.web, cursor)
        if event is not None:
            break
    assert event is not None
    assert event["to_pose"][:2] == pytest.approx(spot, abs=0.05)


def move_since(web: httpx.Client, cursor: str) -> Any:
    """The event of the chair's move that the server sends; None where it sends nothing for 1 s."""
    after = {"headers": {"Last-Event-ID": cursor}, "timeout": 1}
    with suppress(httpx.ReadTimeout), web.stream("GET", "/maps/house/events", **after) as stream:
        for line in stream.iter_lines():
            event = json.loads(line[6:]) if line.startswith("data: ") else {}
            if (event.get("name"), event.get("what")) == (CHAIR, "moved"):
                return event
    return None


def check_faces(house: House, spot: tuple[float, float]) -> None:
    """All faces have the chair at a spot, and nothing at the others."""
    mesh = house.chairs[CHAIR]
    first = tuple(mesh.bounds.mean(axis=0)[:2])

    def at(point: tuple[float, float], shape: shapely.Geometry) -> shapely.Geometry:
        return shapely.affinity.translate(shape, *np.subtract(point, first))

    part = shadow_of(mesh, *HEIGHTS)
    others = {first, WEST, SOUTH} - {spot}
    free = shapely.union_all([at(other, part) for other in others])
    check_costmap(house.peer, at(spot, part), free)
    check_answer(house.web, at(spot, shadow_of(mesh, -1.0, 9.0)))
    things = house.web.get("/maps/house/scene").json()["things"]
    (pose,) = (each["pose"] for each in things if each["name"] == CHAIR)
    assert pose[:2] == pytest.approx(spot, abs=0.05)


def shadow_of(mesh: Any, low: float, high: float) -> shapely.Geometry:
    """The triangles of a mesh between two heights, metres, from above."""
    cut = mesh.slice_plane((0, 0, low), (0, 0, 1)).slice_plane((0, 0, high), (0, 0, -1))
    flat = shapely.polygons(cut.triangles[:, :, :2])
    return shapely.union_all(flat[shapely.area(flat) > 1e-9])


def check_costmap(peer: Peer, here: shapely.Geometry, free: shapely.Geometry) -> None:
    """A costmap comes whose cells within a shape are lethal, and none that touches another."""

    def shows(grid: Any) -> bool:
        side, origin = grid["info"]["resolution"], grid["info"]["origin"]["position"]
        cells = np.array(grid["data"])
        rows, columns = np.divmod(np.arange(cells.size), grid["info"]["width"])
        x, y = origin["x"] + columns * side, origin["y"] + rows * side
        squares = shapely.box(x, y, x + side, y + side)
        within, touching = shapely.contains(here, squares), shapely.intersects(free, squares)
        assert min(within.sum(), touching.sum()) > 20
        return bool((cells[within] == LETHAL).all() and (cells[touching] < LETHAL).all())

    peer.listen(COSTMAP, GRIDS)
    peer.take(COSTMAP, shows)


def check_answer(web: httpx.Client, shape: shapely.Geometry) -> None:
    """SPARQL names the room whose outline has the chair, and its footprint."""
    answer = web.get("/maps/house/rdf/sparql", params={"query": WHERE}).raise_for_status().json()
    (row,) = answer["results"]["bindings"]
    outlines = json.loads(ROOMS.read_text())["features"]
    (room,) = (
        each["properties"]["name"]
        for each in outlines
        if each["geometry"] and shapely.geometry.shape(each["geometry"]).contains(shape)
    )
    assert row["room"]["value"].endswith(f"#{room}")
    found = shapely.from_wkt(row["shape"]["value"].split("> ")[-1])
    assert found.symmetric_difference(shape).area < 0.1 * shape.area
