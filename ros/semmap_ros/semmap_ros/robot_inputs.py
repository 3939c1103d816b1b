"""Messages of a robot that its costmaps follow: its joints, and grids that it made of scans."""

from __future__ import annotations

import math
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from navgrid.grid import ROOT_FRAME, Grid, frame_name
from navgrid.map_file import write_map
from planner.readers.robot_class import read_robot_urdf
from semmap.api.map_driving import URDF
from semmap.robot import load_robot
from semmap_ros.latched import LATCHED

if TYPE_CHECKING:
    from semmap_ros.node import MapNode

MOVED = 0.02
"""Radians or metres by which a joint moves until costmaps are made again."""

OCCUPIED = 65
"""Percent from which a cell is occupied, as in Nav2."""


class RobotInputs:
    """Keeps the last positions of joints and the last grids, as `Map.costmaps` takes them.

    Attributes
    ----------
    posture : positions of joints; None before the first message
    """

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._joints: set[str] | None = None
        self._grids: dict[str, Path] = {}  # by the frame of the storey
        self._folder = tempfile.TemporaryDirectory(prefix="semmap-grids-")
        self.posture: dict[str, float] | None = None
        topic = node.value("joint_states")
        if topic:
            take = partial(self._take, topic, self._move)
            node.create_subscription(JointState, topic, take, qos_profile_sensor_data)
        topic = node.value("scanned_grid")
        if topic:
            take = partial(self._take, topic, self._see)
            node.create_subscription(OccupancyGrid, topic, take, LATCHED)

    def grid_of(self, storey: str) -> Path | None:
        """The last grid of a storey as a map file."""
        return self._grids.get(frame_name(storey))

    def _take(self, topic: str, step: Any, message: Any) -> None:
        self._node.attempt(topic, lambda: step(message))

    def _move(self, message: JointState) -> None:
        """Note positions; wheels, which turn without end, have no part in the shape."""
        if self._joints is None:
            self._joints = self._moving_joints()
        if len(message.name) != len(message.position):
            raise ValueError(f"{len(message.name)} joints have {len(message.position)} positions")
        found = dict(zip(message.name, message.position, strict=True))
        if not all(map(math.isfinite, found.values())):
            raise ValueError("a position is not finite")
        now = {name: at for name, at in found.items() if name in self._joints}
        before = self.posture or {}
        if any(abs(at - before.get(name, math.inf)) > MOVED for name, at in now.items()):
            self.posture = before | now
            self._node.topics.refresh_grids()

    def _moving_joints(self) -> set[str]:
        robot = self._node.value("robot")
        if not robot:
            raise ValueError("there is no robot whose joints these are: set the parameter robot")
        if not robot.endswith(URDF):
            with self._node.map.snapshot() as seen:
                robot = read_robot_urdf(seen, robot)
        joints = load_robot(robot).joints
        return {j.name for j in joints if j.type in ("revolute", "prismatic") and j.mimics is None}

    def _see(self, message: OccupancyGrid) -> None:
        """Keep a grid as a map file; its occupied cells are obstacles of its storey."""
        frame, about = message.header.frame_id, message.info
        if frame == ROOT_FRAME:
            raise ValueError("the frame of a grid is that of a storey, such as map_ground_floor")
        self._node.topics.height_of(frame)
        origin, turn = about.origin.position, about.origin.orientation
        yaw = math.atan2(2 * (turn.w * turn.z), 1 - 2 * turn.z**2)
        values = (origin.x, origin.y, yaw, about.resolution)
        if not (all(map(math.isfinite, values)) and about.resolution > 0 and abs(yaw) < 1e-3):
            raise ValueError(f"a grid at {values}: give finite metres, and a grid without a turn")
        cells = np.array(message.data, np.int8)
        if cells.size == 0 or cells.size != about.width * about.height:
            raise ValueError(f"{cells.size} cells are not {about.width} x {about.height}")
        grid = Grid((origin.x, origin.y), about.resolution, (about.height, about.width))
        stem = Path(self._folder.name, frame)
        shown = np.where(cells >= 0, np.where(cells >= OCCUPIED, 100, 0), -1).astype(np.int8)
        self._grids[frame] = write_map(grid, shown.reshape(about.height, about.width), stem)
        self._node.topics.refresh_grids()
