"""What the node publishes of a map: grids, costmaps, markers and frames, and when again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray

from navgrid.grid import ROOT_FRAME, check_storey_names, frame_name
from navgrid.launch_files import ros_name
from navgrid.nav2 import as_occupancy
from semmap.geometry.pose import Pose
from semmap.server.scene import scene_of
from semmap_ros import messages
from semmap_ros.latched import LatchedTopics
from semmap_ros.optional import TFMessage

if TYPE_CHECKING:
    import semmap
    from navgrid.costmap import Costmap
    from navgrid.occupancy_grid import StoreyGrid
    from semmap_ros.node import MapNode

Cells = NDArray[np.int8]

NOT_SHOWN = {"belief", "statement", "inferred", "linked"}
"""Events after which grids, markers and frames are the same."""

BOXES = (
    "SELECT e.name, ST_XMin(b), ST_YMin(b), ST_ZMin(b), ST_XMax(b), ST_YMax(b), ST_ZMax(b) "
    "FROM (SELECT em.entity_id, ST_3DExtent(m.hull) AS b FROM entity_model em "
    "JOIN model m ON m.id = em.model_id GROUP BY 1) t JOIN entity e ON e.id = t.entity_id "
    "WHERE e.map_id = current_map() AND b IS NOT NULL"
)
"""The boxes of entities in their own frames, metres."""


class MapTopics:
    """The topics of a map, below the name of the node; use it in one thread.

    Attributes
    ----------
    grids : the last grids and costmaps by their topics
    """

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._latched = LatchedTopics(node)
        self._floors: dict[str, float] = {}  # by the frames of storeys
        self.grids: dict[str, OccupancyGrid] = {}

    @property
    def storeys(self) -> set[str]:
        """The storeys that have grids, by their names in topics."""
        return {topic.split("/")[1] for topic in self.grids}

    def height_of(self, frame: str) -> float:
        """The height of a frame in the map's, metres; ValueError where it is not of this map."""
        if frame == ROOT_FRAME:
            return 0.0
        if frame not in self._floors:
            known = ", ".join([ROOT_FRAME, *self._floors])
            raise ValueError(f"frame {frame!r} is not of the map: give one of {known}")
        return self._floors[frame]

    def publish(self, map: semmap.Map) -> None:
        """Publish all."""
        self._read_scene(map)
        self._publish_grids(map)
        self._publish_scene()
        self._latched.withdraw_others({*self.grids, "~/markers", "/tf_static"})

    def follow(self, map: semmap.Map, events: Iterable[Any]) -> None:
        """Publish what events concern: first what is shown, since grids take longer."""
        shown = [event for event in events if event.what not in NOT_SHOWN]
        moved = [event for event in shown if self._move(map, event)]
        if len(moved) < len(shown):
            self.publish(map)
        elif moved:
            self._publish_scene()
            self._publish_grids(map)

    def withdraw(self) -> None:
        """End all topics."""
        self._latched.withdraw_others()
        self.grids = {}

    def _read_scene(self, map: semmap.Map) -> None:
        self._scene = scene_of(map)
        self._boxes = {name: box for name, *box in map.execute(BOXES)}
        self._things = {thing["name"]: thing for thing in self._scene["things"]}

    def _move(self, map: semmap.Map, event: Any) -> bool:
        """Whether the scene is as the event left it, by the new pose of a thing."""
        if event.what != "moved" or event.name not in self._things or event.to_pose is None:
            return False
        storey = map.entity(event.id, event.kind, event.name).storey
        changed = {"pose": [*event.to_pose], "storey": storey and storey.name}
        self._things[event.name].update(changed)
        return True

    def _publish_scene(self) -> None:
        stamp = self._now()
        shown = messages.markers_message(self._scene, self._boxes, stamp)
        self._latched.publish("~/markers", shown)
        if TFMessage is not None:
            self._latched.publish("/tf_static", TFMessage(transforms=[*self._frames(stamp)]))

    def _frames(self, stamp: Any) -> Iterator[TransformStamped]:
        """The frames of storeys in that of the map, and of things in those of their storeys."""
        for frame, height in self._floors.items():
            yield messages.transform_message(ROOT_FRAME, frame, Pose(z=height), stamp)
        for thing in self._scene["things"]:
            if thing["pose"] is None:
                continue
            above = frame_name(thing["storey"]) if thing["storey"] else ROOT_FRAME
            above = above if above in self._floors else ROOT_FRAME
            x, y, z, *turn = thing["pose"]
            pose = x, y, z - self._floors.get(above, 0.0), *turn
            name = f"{self._scene['map']}/{thing['name']}"
            yield messages.transform_message(above, name, pose, stamp)

    def _publish_grids(self, map: semmap.Map) -> None:
        """Publish the grids that differ from the last ones."""
        found: dict[str, tuple[StoreyGrid | Costmap, Cells]] = {}
        low, high = self._node.value("interval")
        robot, options = self._node.value("robot"), {"resolution": self._node.value("resolution")}
        for name in self._node.value("storeys"):
            storey = name or None
            for grid in map.grids(storey=storey, interval=(low, high), **options):
                found[f"~/{ros_name(grid.scene.storey)}/grid"] = grid, grid.cells
            for made in map.costmaps(robot, storey=storey, **options) if robot else ():
                topic = f"~/{ros_name(made.scene.storey)}/costmap"
                found[topic] = made, as_occupancy(made.master)
                for part, costs in zip(made.parts, made.costs, strict=True):
                    found[f"{topic}/{ros_name(part.name)}"] = made, as_occupancy(costs)
        scenes = {made.scene.storey: made.scene for made, _ in found.values()}
        check_storey_names(scenes)
        if len({ros_name(name) for name in scenes}) < len(scenes):
            raise ValueError(
                f"storeys {', '.join(scenes)} have one name in ROS: rename one of them"
            )
        self._floors = {frame_name(name): scene.elevation for name, scene in scenes.items()}
        for topic, (of, cells) in found.items():
            frame = frame_name(of.scene.storey)
            message = messages.grid_message(of.grid, cells, frame, self._now())
            last = self.grids.get(topic)
            if last is None or not messages.same_grid(last, message):
                self.grids[topic] = message
                self._latched.publish(topic, message)
        self.grids = {topic: self.grids[topic] for topic in found}

    def _now(self) -> Any:
        return self._node.get_clock().now().to_msg()
