"""Several storeys, a robot and zones: what the node gives beside one grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from sqlalchemy import Engine

import semmap
from navgrid.launch_files import ros_name
from tests.ros.conftest import Peer, RunNode, detection, header, in_map, matrix, url_of
from tests.waiting import wait_until
from tests.worlds.conftest import store_slim_robot

GRIDS = "nav_msgs/msg/OccupancyGrid"


@pytest.fixture(scope="module")
def building(run_node: RunNode, hotel: Engine) -> Iterator[semmap.Map]:
    """The hotel with a slim robot, a zone that is closed and one that is slow."""
    store_slim_robot(hotel)
    url = hotel.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with semmap.connect(url) as db:
        found = db.map("hotel")
        low, middle, _ = sorted(found.storeys, key=lambda storey: storey.pose.z)
        for number, (storey, kind, rules) in enumerate(
            [(low, "keepout_zone", {}), (middle, "speed_zone", {"speed_limit": 0.4})]
        ):
            x, y = largest_room(found, storey).footprint.representative_point().coords[0]
            zone = shapely.box(x - 1, y - 0.5, x + 1, y + 0.5)
            options = {"type": kind, "floor": storey.pose.z, "storey": storey.name}
            found.add_region(f"zone{number}", zone, **options).properties = rules
        low_room = largest_room(found, low)
        x, y = low_room.footprint.representative_point().coords[0]
        found.add_agent("porter", type="robot", pose=(x, y, low.pose.z))
        given = {"robot": "slim", "agent": "porter", "resolution": 0.1, "oldest": 60.0}
        with run_node(url_of(found), "hotel", **given):
            yield found


def largest_room(map: semmap.Map, storey: semmap.MapEntity) -> semmap.MapEntity:
    return max((r for r in map.rooms if r.storey == storey), key=lambda r: r.footprint.area)


def topic_of(storey: semmap.MapEntity) -> str:
    return f"/semmap/{ros_name(storey.name)}"


def test_each_storey_has_its_grid_and_the_costmaps_of_the_robot(
    peer: Peer, building: semmap.Map, tmp_path: Path
) -> None:
    made = {c.scene.storey: c for c in building.costmaps("slim", resolution=0.1)}
    assert len(made) == len(building.storeys) == 3
    for storey in building.storeys:
        folder = tmp_path / storey.name
        made[storey.name].write(folder, picture=False)
        for topic, file in (("costmap", "master"), ("costmap/base", "base")):
            peer.listen(f"{topic_of(storey)}/{topic}", GRIDS)
            cells = np.array(peer.take(f"{topic_of(storey)}/{topic}")["data"])
            pixels = np.asarray(Image.open(folder / f"{file}.pgm"))[::-1].astype(int).ravel()
            np.testing.assert_array_equal(cells, np.where(pixels > 100, -1, pixels))


def test_the_map_is_that_of_the_storey_of_the_robot(peer: Peer, building: semmap.Map) -> None:
    low, *_, high = sorted(building.storeys, key=lambda storey: storey.pose.z)
    peer.listen("/semmap/map", GRIDS)
    for storey in (low, high, low):
        x, y = largest_room(building, storey).footprint.representative_point().coords[0]
        building["porter"].move_to(x, y, storey.pose.z)
        frame = "map_" + storey.name.replace("-", "_")
        shown = peer.take("/semmap/map", lambda m, frame=frame: m["header"]["frame_id"] == frame)
        peer.listen(f"{topic_of(storey)}/grid", GRIDS)
        assert peer.take(f"{topic_of(storey)}/grid")["data"] == shown["data"]
        assert peer("take", "/semmap/map", 0.5) is None  # a move on a storey changes no map


def test_zones_are_masks_with_their_filters(peer: Peer, building: semmap.Map) -> None:
    for name, kind, value, of_type, limit in (
        ("zone0", "keepout", 100, 0, 1.0),
        ("zone1", "speed", 100, 2, 0.004),
    ):
        zone = building[name]
        top = f"{topic_of(zone.storey)}/{kind}"
        peer.listen(f"{top}_mask", GRIDS)
        peer.listen(f"{top}_filter_info", "nav2_msgs/msg/CostmapFilterInfo")
        info = peer.take(f"{top}_filter_info")
        assert (info["type"], info["filter_mask_topic"]) == (of_type, f"{top}_mask")
        assert (info["base"], info["multiplier"]) == pytest.approx((0.0, limit), rel=1e-6)
        x, y, cells = centres(peer.take(f"{top}_mask"))
        depth = shapely.boundary(zone.footprint).distance(shapely.points(x, y))
        inside = shapely.contains_xy(zone.footprint, x, y)
        sure = depth > 0.1
        np.testing.assert_array_equal(cells[sure], np.where(inside, value, 0)[sure])
        assert (cells == value).sum() == pytest.approx(200, abs=40)
    others = [t for t in peer("topics") if "_mask" in t]
    assert len(others) == 2


def centres(grid: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x and y of the middles of cells, metres, and the cells."""
    info = grid["info"]
    rows, columns = np.divmod(np.arange(info["width"] * info["height"]), info["width"])
    origin = info["origin"]["position"]
    x = origin["x"] + (columns + 0.5) * info["resolution"]
    return x, origin["y"] + (rows + 0.5) * info["resolution"], np.array(grid["data"])


def test_a_path_leads_over_storeys_in_the_frame_of_the_map(
    peer: Peer, building: semmap.Map
) -> None:
    low, *_, high = sorted(building.storeys, key=lambda storey: storey.pose.z)
    ends = {}
    for name, storey, frame, z in (
        ("start", low, "map", low.pose.z),
        ("goal", high, "map_" + high.name.replace("-", "_"), 0.0),
    ):
        free = largest_room(building, storey).footprint
        if storey == low:
            free = free.difference(building["zone0"].footprint.buffer(1))
        x, y = free.representative_point().coords[0]
        at = {"position": {"x": x, "y": y, "z": z}}
        ends[name] = {"header": {"frame_id": frame}, "pose": at}
    plan = peer.call("/semmap/get_plan", "nav_msgs/srv/GetPlan", seconds=60, **ends)["plan"]
    points = [[p["pose"]["position"][k] for k in "xyz"] for p in plan["poses"]]
    assert points[0][2] == pytest.approx(low.pose.z)
    assert points[-1][2] == pytest.approx(high.pose.z)
    end = ends["goal"]["pose"]["position"]
    assert math.dist(points[-1][:2], (end["x"], end["y"])) < 0.2
    assert {round(z, 3) for _, _, z in points} == {round(s.pose.z, 3) for s in (low, high)}


def test_a_detection_in_the_frame_of_a_storey_is_on_its_floor(
    peer: Peer, building: semmap.Map
) -> None:
    *_, high = sorted(building.storeys, key=lambda storey: storey.pose.z)
    x, y = largest_room(building, high).footprint.representative_point().coords[0]
    head = header("map_" + high.name.replace("-", "_"))
    message = {"header": head, "detections": [detection("apple", (x, y, 0.04))]}
    peer("send", "/semmap/detections", "vision_msgs/msg/Detection3DArray", message)
    (apple,) = wait_until(lambda: building.find("apple"))
    assert apple.storey == high
    assert apple.pose[:3] == pytest.approx((x, y, high.pose.z), abs=0.05)
    name = f"hotel/{apple.name}"
    peer.listen("/tf_static", "tf2_msgs/msg/TFMessage")
    transforms = peer.take(
        "/tf_static", lambda m: name in [f["child_frame_id"] for f in m["transforms"]]
    )["transforms"]
    frames = {each["child_frame_id"]: each for each in transforms}
    assert frames[name]["header"]["frame_id"] == head["frame_id"]
    np.testing.assert_allclose(in_map(frames, name), matrix(apple.pose), atol=1e-9)
