"""The node on the small house, as another process of the graph sees it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from scipy.spatial.transform import Rotation

import semmap
from tests.ros.conftest import Peer, RunNode, in_map, matrix, refused, url_of

GRID, MARKERS = "/semmap/ground_floor/grid", "/semmap/markers"
GRIDS, MARKER_ARRAYS = "nav_msgs/msg/OccupancyGrid", "visualization_msgs/msg/MarkerArray"
OF_NAV2 = {0: 100, 254: 0, 205: -1}
"""Cells by the colours of a Nav2 map."""


@pytest.fixture(scope="module")
def node(run_node: RunNode, small_house: semmap.Map) -> Iterator[None]:
    with run_node(url_of(small_house), "house"):
        yield


def cells_of(grid: dict[str, Any]) -> np.ndarray:
    """Rows of cells, row 0 the lowest y."""
    return np.array(grid["data"]).reshape(grid["info"]["height"], grid["info"]["width"])


def cells_written(map: semmap.Map, folder: Path) -> np.ndarray:
    """The cells of the file that the map writes for Nav2; its first row is the highest y."""
    map.grid().write(folder, picture=False)
    pixels = np.asarray(Image.open(folder / "map.pgm"))[::-1]
    return np.vectorize(OF_NAV2.get)(pixels)


def stamped(x: float, y: float, frame: str = "map") -> dict[str, Any]:
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": x, "y": y}}}


@pytest.mark.usefixtures("node")
def test_a_late_subscriber_gets_the_grid_that_is_written_for_nav2(
    peer: Peer, small_house: semmap.Map, tmp_path: Path
) -> None:
    peer.listen(GRID, GRIDS)
    grid = peer.take(GRID)
    np.testing.assert_array_equal(cells_of(grid), cells_written(small_house, tmp_path))
    made = small_house.grid()
    origin = grid["info"]["origin"]["position"]
    assert (origin["x"], origin["y"]) == pytest.approx(made.grid.origin)
    assert grid["header"]["frame_id"] == "map_ground_floor"
    answered = peer.call("/semmap/ground_floor/get_map", "nav_msgs/srv/GetMap")["map"]
    assert answered["data"] == grid["data"]


@pytest.mark.usefixtures("node")
def test_a_moved_object_is_in_the_next_grid_and_markers(
    peer: Peer, small_house: semmap.Map, tmp_path: Path
) -> None:
    peer.listen(GRID, GRIDS)
    peer.listen(MARKERS, MARKER_ARRAYS)
    before = cells_of(peer.take(GRID))
    peer.take(MARKERS)
    chair = small_house["ChairA_01_001"]
    was = chair.pose
    try:
        chair.move_to(was.x, was.y - 1.0, was.z)
        after = cells_of(peer.take(GRID))
        moved = of_thing(peer.take(MARKERS), "ChairA_01_001")
        np.testing.assert_array_equal(after, cells_written(small_house, tmp_path))
        assert (before != after).any()
        assert_is_box_of(moved, small_house["ChairA_01_001"])
    finally:
        chair.move_to(was.x, was.y, was.z)
    np.testing.assert_array_equal(cells_of(peer.take(GRID)), before)


def of_thing(markers: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = (m for m in markers["markers"] if (m["ns"], m["text"]) == ("things", name))
    return found


def assert_is_box_of(marker: dict[str, Any], entity: semmap.MapEntity) -> None:
    """The corners of the marker's cube are those of the box around the mesh in its own frame."""
    turn = Rotation.from_quat(entity.pose[3:])
    own = turn.inv().apply(entity.mesh.vertices - entity.pose[:3])
    middle = turn.apply((own.min(axis=0) + own.max(axis=0)) / 2) + entity.pose[:3]
    at, size = marker["pose"]["position"], marker["scale"]
    assert [at[k] for k in "xyz"] == pytest.approx(middle, abs=1e-4)
    assert [size[k] for k in "xyz"] == pytest.approx(np.ptp(own, axis=0), abs=2e-3)
    turned = marker["pose"]["orientation"]
    assert [turned[k] for k in "xyzw"] == pytest.approx(entity.pose[3:])


@pytest.mark.usefixtures("node")
def test_markers_are_the_rooms_doors_and_things_of_the_map(
    peer: Peer, small_house: semmap.Map
) -> None:
    peer.listen(MARKERS, MARKER_ARRAYS)
    markers = peer.take(MARKERS)["markers"]
    by_kind = {ns: [m for m in markers if m["ns"] == ns] for ns in {m["ns"] for m in markers}}
    assert len({(m["ns"], m["id"]) for m in markers}) == len(markers)
    filled = sorted(area_of_triangles(m["points"]) for m in by_kind["rooms"])
    assert filled == pytest.approx(sorted(r.footprint.area for r in small_house.rooms), rel=1e-3)
    shown = [m["text"] for m in by_kind["things"]]
    for marker in by_kind["things"][::10]:
        assert_is_box_of(marker, small_house[marker["text"]])
    known = small_house.sql(
        "SELECT DISTINCT e.name FROM entity e JOIN entity_model m ON m.entity_id = e.id "
        "JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = current_map() AND e.kind IN ('object', 'agent')"
    )
    assert sorted(shown) == sorted(name for (name,) in known)
    lines = [shapely.LineString([(p["x"], p["y"]) for p in m["points"]]) for m in by_kind["doors"]]
    for door in small_house.doors:
        assert min(line.hausdorff_distance(door.geometry) for line in lines) < 1e-3
    assert len(lines) == len(small_house.doors)


def area_of_triangles(points: list[dict[str, float]]) -> float:
    corners = np.array([(p["x"], p["y"]) for p in points]).reshape(-1, 3, 2)
    return float(sum(shapely.Polygon(triangle).area for triangle in corners))


@pytest.mark.usefixtures("node")
def test_a_path_leads_through_doors_over_free_cells(peer: Peer, small_house: semmap.Map) -> None:
    peer.listen(GRID, GRIDS)
    grid = peer.take(GRID)
    start, goal = (-6.0, -1.0), (5.0, 1.0)
    ends = {"start": stamped(*start), "goal": stamped(*goal)}
    plan = peer.call("/semmap/get_plan", "nav_msgs/srv/GetPlan", **ends)["plan"]
    assert plan["header"]["frame_id"] == "map"
    points = [(p["pose"]["position"]["x"], p["pose"]["position"]["y"]) for p in plan["poses"]]
    line = shapely.LineString(points)
    assert math.dist(points[0], start) < 0.1
    assert math.dist(points[-1], goal) < 0.1
    passed = [door for door in small_house.doors if line.intersects(door.geometry)]
    rooms = [r for r in small_house.rooms if line.intersection(r.footprint).length > 0.3]
    assert len(passed) >= len(rooms) - 1 >= 1
    origin, cell = grid["info"]["origin"]["position"], grid["info"]["resolution"]
    walked = np.array([line.interpolate(d).coords[0] for d in np.arange(0, line.length, 0.02)])
    columns, rows = ((walked - (origin["x"], origin["y"])) / cell).astype(int).T
    assert (cells_of(grid)[rows, columns] == 0).all()


@pytest.mark.usefixtures("node")
def test_a_path_from_nowhere_is_empty_and_the_diagnostics_tell_why(peer: Peer) -> None:
    peer.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", latched=False)
    for start, said in [
        (stamped(-6.0, -1.0, "odom"), "frame 'odom' is not of the map: give one of map, map_"),
        (stamped(100.0, 100.0), "get_plan"),
        (stamped(math.nan, 0.0), "get_plan"),
    ]:
        ends = {"start": start, "goal": stamped(5.0, 1.0)}
        found = peer.call("/semmap/get_plan", "nav_msgs/srv/GetPlan", **ends)
        assert found["plan"]["poses"] == []
        peer.take("/diagnostics", lambda array, said=said: said in refused(array)[1])


@pytest.mark.usefixtures("node")
def test_the_frames_of_things_lead_to_their_poses_in_the_map(
    peer: Peer, small_house: semmap.Map
) -> None:
    peer.listen("/tf_static", "tf2_msgs/msg/TFMessage")
    found = {f["child_frame_id"]: f for f in peer.take("/tf_static")["transforms"]}
    assert found["map_ground_floor"]["header"]["frame_id"] == "map"
    poses = small_house.sql(
        "SELECT e.name, w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = current_map() AND e.kind IN ('object', 'agent')"
    )
    assert len(poses) > 80
    for name, pose in poses:
        np.testing.assert_allclose(in_map(found, f"house/{name}"), matrix(pose), atol=1e-9)
