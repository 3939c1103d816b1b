"""The topics of a map, and the changes after which each is published again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any, NamedTuple

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from navgrid.grid import ROOT_FRAME, frame_name
from navgrid.launch_files import ros_name
from navgrid.readers.fields import read_fields
from planner.exchange.route_graph import ExchangeError
from semmap.error import UnknownNameError
from semmap.geometry.pose import Pose
from semmap.server.scene import boxes_of, scene_of
from semmap_ros import messages
from semmap_ros.building_map import read_building_map
from semmap_ros.grids import StoreyTopic, read_grids
from semmap_ros.latched import LatchedTopics
from semmap_ros.optional import CostmapFilterInfo, LabelInfo, TFMessage, VisionClass
from semmap_ros.route_graph import RouteGraphFile, read_route_graph

if TYPE_CHECKING:
    import semmap
    from semmap_ros.node import MapNode

FEW = 500
"""Objects of which all markers and frames are published in some tens of milliseconds."""

NOT_SHOWN = {"belief", "statement", "inferred", "linked"}
"""Events after which all that is published is the same."""


class Reading(NamedTuple):
    """A state of the map: grids by their topics, route graph; the others for all topics."""

    grids: dict[str, StoreyTopic]
    route_graph: str | ExchangeError
    scene: dict[str, Any] | None = None
    boxes: Any = None
    fields: Any = None
    types: Any = None
    building: Any = None


class MapTopics:
    """The topics of a map, below the name of the node; use it in one thread.

    Grids take seconds in large buildings: a thread of its own reads them, on its own connections.

    Attributes
    ----------
    grids : the last grids, costmaps and masks by their topics
    """

    def __init__(self, node: MapNode) -> None:
        self._node = node
        self._latched = LatchedTopics(node)
        self._route_graph = RouteGraphFile(node)
        self._floors: dict[str, float] = {}  # by the frames of storeys
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="grids")
        self._database: semmap.Database | None = None  # of that thread
        self._job: Future[Reading] | None = None
        self._stale = self._incomplete = False  # the grids alone, and all topics
        self._moved: dict[str, dict[str, Any]] = {}  # while it reads
        self._partial = False  # whether the last markers are of some objects
        self._floor_plan: OccupancyGrid | None = None  # the last one of `~/map`
        self._building: Any = None  # the last one of Open-RMF
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
        """Publish all topics, and end those of removed storeys and fields."""
        self._moved = {}
        self._show(self._read(map, whole=True))

    def follow(self, map: semmap.Map, events: Iterable[Any]) -> None:
        """Publish the objects that moved, and let the rest be read; `show_read` publishes that.

        Of `FEW` objects all are published, as late subscribers get the last message alone; of more,
        those that moved go first, and all follow with the grids.
        """
        shown = [event for event in events if event.what not in NOT_SHOWN]
        moved = {event.name for event in shown if self._move(map, event)}
        if moved and len(self._things) <= FEW:
            self._publish_scene()
        elif moved:
            self._publish_things(moved)
        if self._node.value("agent") in moved:
            self._publish_map()
        self._stale |= bool(moved)
        self._incomplete |= any(event.name not in moved for event in shown)
        self._begin_to_read()

    def refresh_grids(self) -> None:
        """Read the grids again, once the map is published; `show_read` publishes them."""
        if self._node.is_active:
            self._stale = True
            self._begin_to_read()

    def show_read(self) -> None:
        """Publish what was read; raises the errors of the map. Does nothing before that is done."""
        if self._job is not None and self._job.done():
            job, self._job = self._job, None
            self._show(job.result())
            self._begin_to_read()

    def stop(self) -> None:
        """Wait until nothing is read any more, and close the connections for it."""
        job, self._job = self._job, None
        if job is not None:
            wait([job])
        database, self._database = self._database, None
        if database is not None:
            database.close()
        self._stale = self._incomplete = False

    def _begin_to_read(self) -> None:
        """Read what is out of date, unless something is read: then `show_read` begins again."""
        if self._job is None and (self._stale or self._incomplete):
            whole, self._moved = self._incomplete, {}
            self._stale = self._incomplete = False
            self._job = self._reader.submit(self._read_apart, whole)
            self._job.add_done_callback(lambda _: self._node.was_read.trigger())

    def _read_apart(self, whole: bool) -> Reading:
        if self._database is None:
            self._database = self._node.connect()
        return self._read(self._database.map(self._scene["map"]), whole)

    def _read(self, map: semmap.Map, whole: bool) -> Reading:
        grids, graph = read_grids(self._node, map), read_route_graph(self._node, map)
        if not whole:
            return Reading(grids, graph)
        scene, boxes = scene_of(map), boxes_of(map)
        types = None if LabelInfo is None else sorted(each["name"] for each in map.types())
        fields, building = self._read_fields(map), read_building_map(self._node, map)
        return Reading(grids, graph, scene, boxes, fields, types, building)

    def _show(self, read: Reading) -> None:
        """Publish a state of the map."""
        self._route_graph.write(read.route_graph)
        if read.scene is None:
            self._publish_grids(read.grids)
            if self._partial and not self._stale:
                self._publish_scene()
            return
        self._latched.begin()
        self._scene, self._boxes = read.scene, read.boxes
        self._things = {thing["name"]: thing for thing in self._scene["things"]}
        for name in self._moved.keys() & self._things.keys():
            self._things[name].update(self._moved[name])
        self._publish_grids(read.grids)
        self._publish_scene()
        for name, field in read.fields.items():
            cloud = messages.cloud_message(field.voxels.centres, field.values, self._head())
            self._latched.publish(f"~/fields/{ros_name(name)}", cloud)
        if read.types is not None:
            names = enumerate(read.types)
            classes = [VisionClass(class_id=number, class_name=name) for number, name in names]
            self._latched.publish("~/labels", LabelInfo(header=self._head(), class_map=classes))
        if read.building is not None and read.building != self._building:
            self._building = read.building
            self._latched.publish("~/building_map", read.building)
        elif read.building is not None:
            self._latched.keep("~/building_map")
        self._latched.end_others()

    def withdraw(self) -> None:
        """End all topics."""
        self._latched.begin()
        self._latched.end_others()
        self.grids, self._floor_plan, self._building = {}, None, None

    def _move(self, map: semmap.Map, event: Any) -> bool:
        """Whether the scene is as the event left it, by the new pose of a thing."""
        if event.what != "moved" or event.name not in self._things or event.to_pose is None:
            return False
        storey = map.entity(event.id, event.kind, event.name).storey
        changed = {"pose": [*event.to_pose], "storey": storey and storey.name}
        self._things[event.name].update(changed)
        self._moved[event.name] = changed
        return True

    def _publish_scene(self) -> None:
        head, self._partial = self._head(), False
        shown = messages.markers_message(self._scene, self._boxes, head)
        self._marker_ids = {m.text: m.id for m in shown.markers if m.ns == messages.THINGS}
        self._latched.publish("~/markers", shown)
        floors = [
            messages.transform_message(ROOT_FRAME, frame, Pose(z=height), head.stamp)
            for frame, height in self._floors.items()
        ]
        self._publish_frames([*floors, *self._frames(self._scene["things"], head.stamp)])

    def _publish_things(self, names: Iterable[str]) -> None:
        """Publish the markers and frames of some things."""
        self._partial = True
        head, things = self._head(), [self._things[name] for name in names]
        shown = MarkerArray()
        for thing in things:
            if thing["name"] in self._marker_ids:
                marker = messages.thing_marker(thing, self._boxes[thing["name"]], head)
                marker.id = self._marker_ids[thing["name"]]
                shown.markers.append(marker)
        self._latched.publish("~/markers", shown)
        self._publish_frames([*self._frames(things, head.stamp)])

    def _publish_frames(self, frames: list[TransformStamped]) -> None:
        if TFMessage is not None:
            self._latched.publish("/tf_static", TFMessage(transforms=frames))

    def _frames(self, things: Iterable[Any], stamp: Any) -> Iterator[TransformStamped]:
        """The frames of things in those of their storeys."""
        for thing in things:
            if thing["pose"] is None:
                continue
            above = frame_name(thing["storey"]) if thing["storey"] else ROOT_FRAME
            above = above if above in self._floors else ROOT_FRAME
            x, y, z, *turn = thing["pose"]
            pose = x, y, z - self._floors.get(above, 0.0), *turn
            name = f"{self._scene['map']}/{thing['name']}"
            yield messages.transform_message(above, name, pose, stamp)

    def _publish_grids(self, found: dict[str, StoreyTopic]) -> None:
        """Publish the grids that differ from the last ones."""
        now = {}
        self._floors = {frame_name(of.scene.storey): of.scene.elevation for of in found.values()}
        for topic, of in found.items():
            head = self._head(frame_name(of.scene.storey))
            made = messages.grid_message(of.grid, of.cells, head)
            last = self.grids.get(topic)
            if last is not None and messages.same_grid(last, made):
                now[topic] = last
                self._latched.keep(topic)
            else:
                now[topic] = made
                self._latched.publish(topic, made)
            if of.mask is not None and CostmapFilterInfo is not None:
                info = CostmapFilterInfo(
                    header=head,
                    type=of.mask.type,
                    filter_mask_topic=self._node.resolve_topic_name(topic),
                    base=0.0,
                    multiplier=of.mask.multiplier,
                )
                self._latched.publish(topic.replace("_mask", "_filter_info"), info)
        self.grids = now
        self._publish_map()

    def _publish_map(self) -> None:
        """Publish the grid of the storey on which the agent is, if it is another one."""
        agent = self._things.get(self._node.value("agent"), {})
        topic = f"~/{ros_name(agent['storey'])}/grid" if agent.get("storey") else ""
        grid = self.grids.get(topic, self._floor_plan)
        if grid is not None and grid is not self._floor_plan:
            self._floor_plan = grid
            self._latched.publish("~/map", grid)
        elif grid is not None:
            self._latched.keep("~/map")

    def _read_fields(self, map: semmap.Map) -> Any:
        names = [name for name in self._node.value("fields") if name]
        if not names:
            return {}
        try:
            with map.snapshot() as seen:
                return read_fields(seen, names)
        except LookupError as error:
            raise UnknownNameError(str(error)) from error

    def _head(self, frame: str = ROOT_FRAME) -> Header:
        return Header(frame_id=frame, stamp=self._node.get_clock().now().to_msg())
