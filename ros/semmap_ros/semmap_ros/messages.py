"""ROS 2 messages from a map's answers: grids, paths, markers and frames.

Coordinates are metres in the frame ``map``; grids are in the frame of their storey, which lies at
its floor (`navgrid.grid.frame_name`).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import mapbox_earcut
import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Path
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from navgrid.grid import Grid
from semmap.geometry.pose import Pose as MapPose

THINGS = "things"
"""The namespace of their markers."""

DOOR_WIDTH, TEXT_HEIGHT = 0.08, 0.3
"""Metres, of the line of a door and of a room's name."""


def grid_message(grid: Grid, cells: NDArray[np.int8], head: Header) -> OccupancyGrid:
    """Return cells (rows, columns), row 0 the lowest y, as an occupancy grid on the floor."""
    found = OccupancyGrid(header=head)
    found.info.map_load_time = head.stamp
    found.info.resolution = grid.resolution
    found.info.height, found.info.width = grid.shape
    found.info.origin.position.x, found.info.origin.position.y = grid.origin
    found.info.origin.orientation.w = 1.0
    found.data = array("b", np.ascontiguousarray(cells, np.int8).tobytes())
    return found


def same_grid(a: OccupancyGrid, b: OccupancyGrid) -> bool:
    """Whether two grids say the same; their stamps do not count."""
    return (a.info.origin, a.info.width, a.info.resolution, a.data) == (
        b.info.origin,
        b.info.width,
        b.info.resolution,
        b.data,
    )


def path_message(points: Sequence[Sequence[float]], head: Header) -> Path:
    """Return points (x, y, z) as a path; each pose heads for the next one, the last as before."""
    path, yaw = Path(header=head), 0.0
    for here, after in zip(points, [*points[1:], points[-1]] if points else [], strict=True):
        if here[:2] != after[:2]:
            yaw = math.atan2(after[1] - here[1], after[0] - here[0])
        turned = [*here, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]
        path.poses.append(PoseStamped(header=head, pose=pose_message(turned)))
    return path


def pose_message(pose: Sequence[float]) -> Pose:
    """Return a pose (x, y, z, qx, qy, qz, qw)."""
    found = Pose()
    found.position.x, found.position.y, found.position.z = map(float, pose[:3])
    turn = found.orientation
    turn.x, turn.y, turn.z, turn.w = map(float, pose[3:])
    return found


def cloud_message(
    points: NDArray[np.float64], values: NDArray[np.float32] | None, head: Header
) -> PointCloud2:
    """Return points (N, 3) as a cloud of x, y, z, and `intensity` where they have values (N,)."""
    names = ["x", "y", "z", *(["intensity"] if values is not None else [])]
    columns = points if values is None else np.column_stack([points, values])
    found = PointCloud2(header=head, height=1, width=len(points), is_dense=True)
    found.fields = [
        PointField(name=name, offset=4 * place, datatype=PointField.FLOAT32, count=1)
        for place, name in enumerate(names)
    ]
    found.point_step = 4 * len(names)
    found.row_step = found.point_step * len(points)
    found.data = array("B", np.ascontiguousarray(columns, "<f4").tobytes())
    return found


def transform_message(
    parent: str, child: str, pose: Sequence[float], stamp: Time
) -> TransformStamped:
    """Return the frame `child` at a pose (x, y, z, qx, qy, qz, qw) in the frame `parent`."""
    found = TransformStamped(header=Header(frame_id=parent, stamp=stamp), child_frame_id=child)
    shift, turn = found.transform.translation, found.transform.rotation
    shift.x, shift.y, shift.z = map(float, pose[:3])
    turn.x, turn.y, turn.z, turn.w = map(float, pose[3:])
    return found


def markers_message(
    scene: Mapping[str, Any], boxes: Mapping[str, Sequence[float]], head: Header
) -> MarkerArray:
    """Return markers of rooms, doors and objects in the viewer's colours, for all earlier ones.

    Parameters
    ----------
    scene : of `semmap.server.scene.scene_of`
    boxes : (x0, y0, z0, x1, y1, z1) of things by name, metres in their own frames
    """
    found = [Marker(header=head, action=Marker.DELETEALL)]
    states = scene["states"]
    for place in scene["places"]:
        floor, colour = place["floor"], _colour(place["colour"])
        corners = [corner for area in place["areas"] for corner in _triangles(area)]
        if not corners:
            continue
        middle = np.mean(place["areas"][0][0], axis=0)
        ns = f"{place['kind']}s"
        found += [
            _marker(head, ns, Marker.TRIANGLE_LIST, colour, points=_points(corners, floor)),
            _marker(
                head,
                f"{ns}_names",
                Marker.TEXT_VIEW_FACING,
                _colour("#2b2f36"),
                pose=pose_message([*middle, floor + TEXT_HEIGHT, 0, 0, 0, 1]),
                size=(0.0, 0.0, TEXT_HEIGHT),
                text=place["label"] or place["name"],
            ),
        ]
    for door in scene["doors"]:
        line = _points(door["line"], door["floor"])
        colour = _colour(states.get(door["state"], states["open"]))
        size = (DOOR_WIDTH, 0.0, 0.0)
        found.append(_marker(head, "doors", Marker.LINE_STRIP, colour, points=line, size=size))
    found += [
        thing_marker(thing, boxes[thing["name"]], head)
        for thing in scene["things"]
        if thing["pose"] is not None and thing["name"] in boxes
    ]
    for number, marker in enumerate(found):
        marker.id = number
    return MarkerArray(markers=found)


def thing_marker(thing: Mapping[str, Any], box: Sequence[float], head: Header) -> Marker:
    """Return the box of a thing of the scene, at its pose; `text` has its name."""
    low, high = np.array(box[:3]), np.array(box[3:])
    pose = thing_pose(thing["pose"], (low + high) / 2)
    size = np.maximum(high - low, 1e-3)  # a flat thing is shown, too
    colour = _colour(thing["colour"])
    return _marker(head, THINGS, Marker.CUBE, colour, pose=pose, size=size, text=thing["name"])


def thing_pose(pose: Sequence[float], middle: NDArray[np.float64]) -> Pose:
    """Return the pose of the middle (x, y, z) of a thing, given in its frame, in the map's."""
    at = MapPose(*pose)
    return pose_message([*at.apply(middle[None])[0], *at[3:]])


def _marker(
    head: Header,
    ns: str,
    kind: int,
    colour: ColorRGBA,
    *,
    points: Iterable[Point] = (),
    pose: Pose | None = None,
    size: Sequence[float] = (1.0, 1.0, 1.0),
    text: str = "",
) -> Marker:
    found = Marker(header=head, ns=ns, type=kind, action=Marker.ADD, color=colour, text=text)
    found.pose = pose or pose_message([0, 0, 0, 0, 0, 0, 1])
    found.scale.x, found.scale.y, found.scale.z = map(float, size)
    found.points = list(points)
    return found


def _triangles(rings: Sequence[Sequence[Sequence[float]]]) -> Iterator[Sequence[float]]:
    """The corners (x, y) of triangles that fill an outer ring without the inner ones."""
    corners = np.concatenate([np.array(ring)[:-1] for ring in rings])
    ends = np.cumsum([len(ring) - 1 for ring in rings]).astype(np.uint32)
    for corner in mapbox_earcut.triangulate_float64(corners, ends):
        yield corners[corner]


def _points(corners: Iterable[Sequence[float]], height: float) -> list[Point]:
    return [Point(x=float(x), y=float(y), z=float(height)) for x, y in corners]


def _colour(colour: str) -> ColorRGBA:
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)
