"""The entries of one storey: walls, rooms, connectors, places, lanes and furniture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from shapely import LineString, Point, Polygon

from semmap.geometry.mesh import prism_mesh
from semmap.geometry.outline import placed_outline
from semmap.geometry.overlay import united, without
from semmap.geometry.pose import Pose
from semmap.ingest.floor_plan import FloorPlan, enclose, middle_of, rooms_beside
from semmap.ingest.naming import give_type, words
from semmap.ingest.openings import make_connector, opening_pose
from semmap.ingest.rmf.building_file import Edge, LevelPlan, RmfModel
from semmap.ingest.rmf.building_world import BuildingWorld
from semmap.ingest.rmf.model_shapes import ModelShapes
from semmap.ingest.rmf.storey_drawing import DrawnDoor, StoreyDrawing
from semmap.ingest.world import (
    Entry,
    PlaceDetail,
    Shape,
    StoreyDetail,
    WorldLink,
)
from semmap.limits import EXTENT

WALL_THICKNESS = 0.1
"""The thickness at which the traffic editor's own world generator builds walls, metres."""

SHAFT_REACH = 0.25
"""Distance from an elevator door within which its opening is cut into a wall, metres."""

PLACE_TYPES = (
    ("is_charger", "charging_station"),
    ("dock_name", "docking_station"),
    ("pickup_dispenser", "pickup_point"),
    ("dropoff_ingestor", "dropoff_point"),
    ("is_cleaning_zone", "cleaning_zone"),
    ("is_parking_spot", "parking_spot"),
)
"""Vertex parameters and the type of place that each makes; the first that is set counts."""

EQUIPMENT = ("is_charger", "dock_name", "is_cleaning_zone", "spawn_robot_name", "lift_cabin")
"""Parameters of vertices that name a piece of equipment or a task, not the room around it."""

ROOM_TYPES = ("kitchen", "lobby", "restaurant", "shop", "office", "corridor", "bathroom", "toilet")
"""Words in a room's name that are its type."""

NAMES_ROOM = "names_room"
"""The parameter of a vertex that is there to name its room, as exports of semmap have it."""

LANE_PROPERTIES = ("speed_limit", "orientation", "mutex")
"""Parameters of a lane that become properties."""


@dataclass
class DrawnRoom:
    """A room or cabin: its outline in the storey's frame, the name and pose of its entry."""

    name: str
    outline: Polygon
    pose: Pose


class StoreyEntries:
    """Adds the entries of one level to the world of its building."""

    def __init__(self, world: BuildingWorld, plan: LevelPlan, shapes: ModelShapes) -> None:
        self.world, self.plan, self.shapes = world, plan, shapes
        self.drawing = StoreyDrawing(world, plan)
        self.holder = world.storeys[plan.name]
        self.height = world.height(plan)
        self.spaces: list[DrawnRoom] = []

    def add_all(self) -> None:
        """Add the storey's walls, rooms, connectors, places and models to the world."""
        cabins = {lift.name: self.drawing.cabin_outline(lift) for lift in self.drawing.lifts}
        layout = enclose(
            self.drawing.walls,
            [door.line for door in self.drawing.doors],
            self.drawing.floors,
            list(cabins.values()),
            [door.line for door in self.drawing.lift_doors.values()],
        )
        self._storey_entry()
        self._wall_entry()
        self._room_entries(layout)
        rooms = len(self.spaces)
        self._cabin_entries(cabins)
        for door in self.drawing.doors:
            self._connect(door, self.spaces[:rooms])
        for number, opening in enumerate(layout.openings, 1):
            self._connect_opening(f"{self.plan.name}-opening{number}", opening.border, rooms)
        for (lift, _), door in self.drawing.lift_doors.items():
            self._connect_lift(door, lift, self.spaces[:rooms])
        self._place_entries()
        for model in self.plan.models:
            self._model_entry(model)
        self._note_faces(layout.floorless, "have no floor")
        self._note_faces(layout.solid, "have no door (columns, ducts, shafts)")

    def _note_faces(self, faces: Sequence[Polygon], why: str) -> None:
        if faces:
            area = sum(face.area for face in faces)
            self.world.out.notes.append(
                f"{self.plan.name}: {len(faces)} enclosed faces ({area:.1f} m2) {why}, no rooms"
            )

    def _storey_entry(self) -> None:
        entry = next(e for e in self.world.out.entries if e.name == self.holder)
        entry.detail = StoreyDetail(self.plan.elevation, self.height)
        entry.properties = {
            "walls": len(self.plan.walls),
            "doors": len(self.plan.doors),
            "lanes": len(self.plan.lanes),
            "named_places": sum(1 for v in self.plan.vertices if v and v.name),
            "models": len(self.plan.models),
        }
        if self.drawing.floors:
            outline = united(self.drawing.floors)
            entry.shapes = [Shape("polygon", prism_mesh(outline, 0.0, self.height), outline)]

    def _wall_entry(self) -> None:
        drawing = self.drawing
        if not drawing.walls:
            return
        walls = [w.buffer(WALL_THICKNESS / 2, cap_style="square") for w in drawing.walls]
        doors = [d.line.buffer(WALL_THICKNESS, cap_style="flat") for d in drawing.doors]
        lifts = [d.line.buffer(SHAFT_REACH, cap_style="flat") for d in drawing.lift_doors.values()]
        outline = without(united(walls), united(doors + lifts))
        entry = Entry(f"walls-{self.plan.name}", "object", "wall", holder=self.holder)
        entry.properties = {"walls": len(drawing.walls), "thickness": WALL_THICKNESS}
        entry.shapes = [Shape("mesh", prism_mesh(outline, 0.0, self.height), outline)]
        self.world.add(entry)

    def _room_entries(self, layout: FloorPlan) -> None:
        named = self._namesakes(layout.rooms)
        for number, face in enumerate(layout.rooms, 1):
            name = named.get(number - 1)
            kind = next((w for w in reversed(words(name or "")) if w in ROOM_TYPES), "room")
            middle = middle_of(face)
            entry = Entry(name or f"{self.plan.name}-room{number}", "room", kind)
            self._space(entry, face, Pose(middle.x, middle.y), None)

    def _namesakes(self, rooms: Sequence[Polygon]) -> dict[int, str]:
        """Return the names of rooms: of the one named vertex in each that is not equipment.

        A vertex that states that it names its room counts before others.
        """
        inside: dict[int, set[str]] = {}
        stated: dict[int, str] = {}
        for i, vertex in enumerate(self.plan.vertices):
            if vertex is None or not vertex.name or i in self.drawing.far:
                continue
            if any(vertex.params.get(key) for key in EQUIPMENT):
                continue
            for room, outline in enumerate(rooms):
                if outline.contains(Point(self.drawing.points[i])):
                    inside.setdefault(room, set()).add(vertex.name)
                    if vertex.params.get(NAMES_ROOM):
                        stated[room] = vertex.name
        found = {room: next(iter(names)) for room, names in inside.items() if len(names) == 1}
        return found | stated

    def _cabin_entries(self, cabins: Mapping[str, Polygon]) -> None:
        for lift, outline in cabins.items():
            pose = self.world.lift_pose(next(k for k in self.drawing.lifts if k.name == lift))
            entry = Entry(f"{lift}-{self.plan.name}", "room", "elevator_cabin")
            self._space(entry, outline, pose, self.world.elevators[lift])

    def _space(self, entry: Entry, outline: Polygon, pose: Pose, elevator: str | None) -> None:
        """Add a room with its outline about its own origin."""
        own = placed_outline(outline, pose.inverse())
        entry.holder, entry.pose = self.holder, pose
        entry.shapes = [Shape("polygon", prism_mesh(own, 0.0, self.height), own)]
        entry.detail = PlaceDetail(0.0, self.height, elevator)
        self.spaces.append(DrawnRoom(self.world.add(entry), outline, pose))

    def _connect(self, door: DrawnDoor, rooms: Sequence[DrawnRoom]) -> None:
        sides = rooms_beside([room.outline for room in rooms], door.line)
        left, right = (rooms[i] if i is not None else None for i in (sides.left, sides.right))
        if left is None and right is None:
            fix = "Join it to walls that enclose a room."
            self.world.skip(door.element, "touches no room", fix)
        else:
            self._connector(door, left, right, "door")

    def _connect_lift(self, door: DrawnDoor, lift: str, rooms: Sequence[DrawnRoom]) -> None:
        """Join the room before an elevator door (to its left) and the cabin."""
        outlines = [room.outline for room in rooms]
        before = rooms_beside(outlines, door.line, reach=2 * SHAFT_REACH).left
        name = f"{lift}-{self.plan.name}"
        cabin = next(s for s in self.spaces if s.name == name or s.name.startswith(f"{name}_"))
        lobby = rooms[before] if before is not None else None
        self._connector(door, lobby, cabin, "elevator_door")

    def _connect_opening(self, name: str, border: LineString, rooms: int) -> None:
        """Add a border without wall or door as a connector, at the border's middle."""
        half = border.length / 2
        a, b = (border.interpolate(half + d) for d in (-0.25, 0.25))
        sides = rooms_beside([s.outline for s in self.spaces[:rooms]], LineString([a, b]), 0.5)
        if sides.left is None or sides.right is None or sides.left == sides.right:
            return
        door = DrawnDoor(LineString([a, b]), name, {"width": border.length}, name)
        left, right = self.spaces[sides.left], self.spaces[sides.right]
        self._connector(door, left, right, "opening")

    def _connector(
        self, door: DrawnDoor, left: DrawnRoom | None, right: DrawnRoom | None, type_: str
    ) -> None:
        """Add a connector whose x leads from its left to its right, or outward."""
        rooms = [room for room in (left, right) if room is not None]
        width = float(str(door.properties.get("width", door.line.length)))
        entry = Entry(door.name, "connector", type_, holder=self.holder)
        entry.properties = door.properties
        frame = opening_pose(door.line, from_left=left is not None)
        make_connector(entry, frame, [(room.name, room.outline) for room in rooms], width)
        self.world.add(entry, "-door")

    def _place_entries(self) -> None:
        """Add named vertices and the ends of lanes as regions, lanes as links between them."""
        lanes = [edge for edge, _ in self.drawing.lines(self.plan.lanes)]
        ends = {i for lane in lanes for i in (lane.start, lane.end)}
        entries: dict[int, str] = {}
        for i, vertex in enumerate(self.plan.vertices):
            if vertex is None or i in self.drawing.far or not (vertex.name or i in ends):
                continue
            if vertex.params.get(NAMES_ROOM) and i not in ends:
                continue
            wanted = vertex.name or f"{self.plan.name}-waypoint{i}"
            type_ = next((t for key, t in PLACE_TYPES if vertex.params.get(key)), "waypoint")
            entry = Entry(wanted, "region", type_, vertex.name or None, dict(vertex.params))
            x, y = (float(v) for v in self.drawing.points[i])
            entry.holder, entry.pose = self._held(Pose(x, y))
            entries[i] = self.world.add(entry, "-waypoint")
        links: dict[tuple[str, str], WorldLink] = {}
        for lane in lanes:
            start, end = entries[lane.start], entries[lane.end]
            _describe_lane(links.setdefault((start, end), WorldLink(start, "lane", end)), lane)
        self.world.out.links += links.values()

    def _held(self, pose: Pose) -> tuple[str, Pose]:
        """Return the room at a pose in the storey's frame, or the storey, and the pose in it."""
        point = Point(pose.x, pose.y)
        space = next((s for s in self.spaces if s.outline.covers(point)), None)
        return (space.name, space.pose.inverse() @ pose) if space else (self.holder, pose)

    def _model_entry(self, model: RmfModel) -> None:
        (x, y), *_ = self.drawing.to_map.apply([(model.x, model.y)])
        points = self.drawing.points
        middle = np.median(points, axis=0) if len(points) else (0.0, 0.0)
        away = math.hypot(x - middle[0], y - middle[1], model.z)
        if EXTENT.exceeded_by(away):
            element = f"{model.element} ({model.name})"
            problem = f"stands {away:.0f} m from the middle of its level"
            self.world.skip(element, problem, "Move it to where it belongs.")
            return
        owner, slash, own = model.model.rpartition("/")
        label = own if own != "object" else None  # as an export names what has no type
        type_ = "_".join(words(label or "")) or None
        name = model.name.removeprefix(owner + slash) or model.name  # as the editor names it
        entry = Entry(name, "object", type_, label)
        entry.properties = {"model": model.model, "static": model.static}
        yaw = model.yaw + self.drawing.to_map.yaw
        inside, entry.shapes = self.shapes.of(model.model, f"{model.element} ({model.name})")
        stands = Pose.planar(float(x), float(y), yaw, model.z) @ inside
        entry.holder, entry.pose = self._held(stands)
        give_type(entry, (own,))
        self.world.add(entry)


def _describe_lane(link: WorldLink, lane: Edge) -> None:
    """Add a lane's parameters to its link; lanes of several graphs between two places share one."""
    about = link.properties
    graphs = {*about.get("graphs", []), lane.params.get("graph_idx", 0)}
    about["graphs"] = sorted(graphs)
    about["bidirectional"] = bool(lane.params.get("bidirectional", True))
    for key in LANE_PROPERTIES:
        if lane.params.get(key):
            about[key] = lane.params[key]
