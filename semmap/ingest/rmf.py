"""Open-RMF buildings: `building.yaml` into storeys, rooms, doors, lifts, places and lanes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, MultiPolygon, Point, Polygon

from semmap.geometry.mesh import Mesh, box_mesh, join, prism_mesh
from semmap.geometry.pose import Pose
from semmap.ingest.enclosed_rooms import FloorPlan, enclose, rooms_beside
from semmap.ingest.naming import guess_type, unique_name, words
from semmap.ingest.rmf_alignment import Alignment, align
from semmap.ingest.rmf_file import Building, Edge, LevelPlan, Lift, LiftDoor, Model
from semmap.ingest.world import (
    OUTSIDE,
    Connects,
    Entry,
    Kind,
    Level,
    Link,
    Place,
    Shape,
    Skipped,
    World,
)
from semmap.limits import EXTENT

__all__ = ["read_rmf"]

WALL_HEIGHT = 2.5
WALL_THICKNESS = 0.1
"""What the traffic editor's own world generator builds, metres; the file has no say in it."""

LEAF_THICKNESS = 0.05
LEAF_HEIGHT = 2.1
SHAFT_REACH = 0.25
"""How far from an elevator door a wall may stand and still have its opening cut, metres."""

STANDING = (0.6, 0.5, 0.4, 0.8, 1.0, 0.3)
"""Where a robot stands before a door: the first of these distances that lies in the place."""

PLACE_TYPES = (
    ("is_charger", "charging_station"),
    ("dock_name", "docking_station"),
    ("pickup_dispenser", "pickup_point"),
    ("dropoff_ingestor", "dropoff_point"),
    ("is_cleaning_zone", "cleaning_zone"),
    ("is_parking_spot", "parking_spot"),
)
"""A vertex parameter that is set, and the type of place that it makes; the first one counts."""

EQUIPMENT = ("is_charger", "dock_name", "is_cleaning_zone", "spawn_robot_name", "lift_cabin")
"""Vertices with one of these name a piece of equipment or a task, not the room around it."""

ROOM_TYPES = ("kitchen", "lobby", "restaurant", "shop", "office", "corridor", "bathroom", "toilet")
"""Words in a room's name that say its type."""

DOOR_PROPERTIES = (
    "type", "motion_axis", "motion_direction", "motion_degrees", "right_left_ratio", "plugin",
)  # fmt: skip
LANE_PROPERTIES = ("speed_limit", "orientation", "mutex")


def read_rmf(path: Path | str) -> World:
    """Read an Open-RMF building.

    The map's frame is the reference level's drawing in metres, y up; the frame of a storey is the
    same, raised to its elevation. Rooms are the faces that walls, doors and floor outlines
    enclose. Each named vertex and each end of a lane is a region, each lane a link.

    Parameters
    ----------
    path : a ``building.yaml``, coordinate system ``reference_image`` or ``cartesian_meters``

    Raises
    ------
    WorldError
        The file cannot be trusted as a whole; nothing of it is used.
    """
    building = Building.read(Path(path))
    return _Reading(building, align(building)).world()


@dataclass
class _Space:
    """A room or cabin of a storey: its outline in the storey's frame and the name of its entry."""

    name: str
    outline: Polygon
    pose: Pose


@dataclass
class _Door:
    """A door or elevator door as a directed line in the storey's frame."""

    line: LineString
    name: str
    properties: dict[str, object]
    element: str


class _Reading:
    """Builds the world level by level."""

    def __init__(self, building: Building, alignment: Alignment) -> None:
        self.building = building
        self.alignment = alignment
        self.names: dict[str, Kind | None] = {OUTSIDE: None}
        self.out = World(building.name, building.path, skipped=building.skipped)
        self.out.notes += alignment.notes
        self.storeys: dict[str, str] = {}
        self.lifts: dict[str, str] = {}

    def world(self) -> World:
        for plan in self.building.levels.values():
            self.storeys[plan.name] = self.add(
                Entry(plan.name, "storey", "storey", pose=Pose(z=plan.elevation))
            )
        for lift in self.building.lifts:
            self.lift(lift)
        for plan in self.building.levels.values():
            _Storey(self, plan).read()
        return self.out

    def add(self, entry: Entry, suffix: str = "") -> str:
        """Add an entry under a free name; `suffix` tells it from another kind's of its name."""
        wanted = free = entry.name
        if self.names.get(wanted, entry.kind) != entry.kind:
            free += suffix
        entry.name = unique_name(free, self.names)
        if entry.name != wanted:
            entry.label = entry.label or wanted
            if entry.kind != "object":
                self.out.notes.append(f"{wanted}: the name is taken, becomes {entry.name}")
        self.names[entry.name] = entry.kind
        self.out.entries.append(entry)
        return entry.name

    def skip(self, element: str, problem: str, mend: str) -> None:
        self.out.skipped.append(Skipped(element, problem, mend))

    def height(self, plan: LevelPlan) -> float:
        """Of walls and rooms: the generator's, or up to the next level where that is lower."""
        above = [o.elevation - plan.elevation for o in self.building.levels.values()]
        return min([WALL_HEIGHT, *(gap for gap in above if gap > 0)])

    def lift_pose(self, lift: Lift) -> Pose:
        to_map = self.alignment.levels[lift.reference_level]
        (x, y), *_ = to_map.apply([(lift.x, lift.y)])
        return Pose.planar(float(x), float(y), lift.yaw)

    def lift(self, lift: Lift) -> None:
        pose = self.lift_pose(lift)
        initial = self.building.levels.get(lift.initial_level)
        z = initial.elevation if initial else 0.0
        self.lifts[lift.name] = self.add(
            Entry(
                lift.name,
                "elevator",
                "elevator",
                properties={
                    "levels": list(lift.level_doors),
                    "initial_level": lift.initial_level,
                    "width": lift.width,
                    "depth": lift.depth,
                },
                pose=Pose.planar(pose.x, pose.y, lift.yaw, z),
            )
        )


class _Storey:
    """One level: its geometry in metres, and the entries that it gives."""

    def __init__(self, reading: _Reading, plan: LevelPlan) -> None:
        self.reading, self.plan = reading, plan
        self.to_map = reading.alignment.levels[plan.name]
        self.holder = reading.storeys[plan.name]
        self.height = reading.height(plan)
        self.points = self.to_map.apply(
            [(v.x, v.y) if v else (0.0, 0.0) for v in plan.vertices] or np.empty((0, 2))
        )
        self.far = self.far_vertices()
        self.walls = [line for _, line in self.lines(plan.walls)]
        self.doors = [self.door(edge, line) for edge, line in self.lines(plan.doors)]
        self.floors = self.floor_outlines()
        self.lifts = [lift for lift in reading.building.lifts if plan.name in lift.level_doors]
        self.lift_doors = {
            (lift.name, name): self.lift_door(lift, lift.doors[name])
            for lift in self.lifts
            for name in lift.level_doors[plan.name]
        }
        self.spaces: list[_Space] = []

    def read(self) -> None:
        cabins = {lift.name: self.cabin_outline(lift) for lift in self.lifts}
        layout = enclose(
            self.walls,
            [door.line for door in self.doors],
            self.floors,
            list(cabins.values()),
            [door.line for door in self.lift_doors.values()],
        )
        self.storey_entry()
        self.wall_entry()
        self.room_entries(layout)
        rooms = len(self.spaces)
        self.cabin_entries(cabins)
        for door in self.doors:
            self.connect(door, self.spaces[:rooms])
        for number, opening in enumerate(layout.openings, 1):
            self.connect_opening(f"{self.plan.name}-opening{number}", opening.border, rooms)
        for (lift, _), door in self.lift_doors.items():
            self.connect_lift(door, lift, self.spaces[:rooms])
        self.place_entries()
        for model in self.plan.models:
            self.model_entry(model)
        self.note_faces(layout.floorless, "have no floor")
        self.note_faces(layout.solid, "have no door (columns, ducts, shafts)")

    def note_faces(self, faces: Sequence[Polygon], why: str) -> None:
        if faces:
            area = sum(face.area for face in faces)
            self.reading.out.notes.append(
                f"{self.plan.name}: {len(faces)} enclosed faces ({area:.1f} m2) {why}, no rooms"
            )

    # -- what the file says, in metres ------------------------------------------------------

    def far_vertices(self) -> set[int]:
        usable = [i for i, v in enumerate(self.plan.vertices) if v is not None]
        if not usable:
            return set()
        middle = np.median(self.points[usable], axis=0)
        away = np.linalg.norm(self.points - middle, axis=1)
        far = {i for i in usable if not away[i] <= EXTENT.value}
        for i in sorted(far):
            self.reading.skip(
                f"levels/{self.plan.name}/vertices[{i}]",
                f"lies {away[i]:.0f} m from the middle of its level",
                "Move it to where it belongs.",
            )
        return far

    def near(self, indices: Iterable[int], element: str) -> bool:
        if not self.far.isdisjoint(indices):
            self.reading.skip(element, "refers to a vertex that lies far away", "Mend the vertex.")
            return False
        return True

    def lines(self, edges: Sequence[Edge]) -> list[tuple[Edge, LineString]]:
        found = []
        for edge in edges:
            if not self.near((edge.start, edge.end), edge.element):
                continue
            line = LineString(self.points[[edge.start, edge.end]])
            if line.length < 1e-3:
                self.reading.skip(edge.element, "has no length", "Delete it or move an end.")
            else:
                found.append((edge, line))
        return found

    def door(self, edge: Edge, line: LineString) -> _Door:
        name = str(edge.params.get("name") or f"{self.plan.name}-door{edge.start}-{edge.end}")
        properties = {
            ("door_type" if key == "type" else key): edge.params[key]
            for key in DOOR_PROPERTIES
            if key in edge.params
        }
        return _Door(line, name, properties, f"{edge.element} ({name})")

    def lift_door(self, lift: Lift, door: LiftDoor) -> _Door:
        """The elevator door, directed so that the cabin lies to its right."""
        pose = self.reading.lift_pose(lift)
        half = 0.5 * door.width * np.array([math.cos(door.yaw), math.sin(door.yaw)])
        middle = np.array([door.x, door.y])
        if half[0] * -middle[1] - half[1] * -middle[0] > 0:
            half = -half
        ends = np.array([middle - half, middle + half])
        return _Door(
            LineString(pose.apply(np.column_stack([ends, [0, 0]]))[:, :2]),
            f"{lift.name}-{self.plan.name}-{door.name}",
            {"door_type": door.type},
            f"{lift.element}/doors/{door.name} on {self.plan.name}",
        )

    def floor_outlines(self) -> list[Polygon]:
        floors: list[Polygon] = []
        for floor in self.plan.floors:
            if not self.near(floor.vertices, floor.element):
                continue
            drawn = shapely.make_valid(Polygon(self.points[list(floor.vertices)]))
            parts = [p for p in shapely.get_parts(drawn) if isinstance(p, Polygon | MultiPolygon)]
            parts = [p for part in parts for p in shapely.get_parts(part) if p.area > 1e-6]
            if not parts:
                self.reading.skip(floor.element, "encloses no area", "Draw the floor again.")
            floors += parts
        return floors

    def cabin_outline(self, lift: Lift) -> Polygon:
        return _moved(_rectangle(lift.width, lift.depth), self.reading.lift_pose(lift))

    # -- what the map gets ------------------------------------------------------------------

    def storey_entry(self) -> None:
        entry = next(e for e in self.reading.out.entries if e.name == self.holder)
        entry.detail = Level(self.plan.elevation, self.height)
        named = sum(1 for v in self.plan.vertices if v and v.name)
        entry.properties = {
            "walls": len(self.plan.walls),
            "doors": len(self.plan.doors),
            "lanes": len(self.plan.lanes),
            "named_places": named,
            "models": len(self.plan.models),
        }
        if self.floors:
            outline = shapely.union_all(self.floors)
            entry.shapes = [Shape("polygon", _prism(outline, self.height), outline)]

    def wall_entry(self) -> None:
        if not self.walls:
            return
        solid = shapely.union_all(
            [w.buffer(WALL_THICKNESS / 2, cap_style="square") for w in self.walls]
        )
        openings = [d.line.buffer(WALL_THICKNESS, cap_style="flat") for d in self.doors] + [
            d.line.buffer(SHAFT_REACH, cap_style="flat") for d in self.lift_doors.values()
        ]
        outline = shapely.difference(solid, shapely.union_all(openings))
        self.reading.add(
            Entry(
                f"walls-{self.plan.name}",
                "object",
                "wall",
                properties={"walls": len(self.walls), "thickness": WALL_THICKNESS},
                holder=self.holder,
                shapes=[Shape("mesh", _prism(outline, self.height), outline)],
            )
        )

    def room_entries(self, layout: FloorPlan) -> None:
        named = self.namesakes(layout.rooms)
        for number, face in enumerate(layout.rooms, 1):
            name = named.get(number - 1)
            kind = (
                next((w for w in reversed(words(name)) if w in ROOM_TYPES), None) if name else None
            )
            middle = face.centroid if face.contains(face.centroid) else face.representative_point()
            self.space(
                Entry(name or f"{self.plan.name}-room{number}", "room", kind or "room"),
                face,
                Pose(middle.x, middle.y),
                None,
            )

    def namesakes(self, rooms: Sequence[Polygon]) -> dict[int, str]:
        """The rooms that hold one named vertex which is more than a piece of equipment."""
        inside: dict[int, set[str]] = {}
        for i, vertex in enumerate(self.plan.vertices):
            if vertex is None or not vertex.name or i in self.far:
                continue
            if any(vertex.params.get(key) for key in EQUIPMENT):
                continue
            for room, outline in enumerate(rooms):
                if outline.contains(Point(self.points[i])):
                    inside.setdefault(room, set()).add(vertex.name)
        return {room: next(iter(names)) for room, names in inside.items() if len(names) == 1}

    def cabin_entries(self, cabins: Mapping[str, Polygon]) -> None:
        for lift, outline in cabins.items():
            pose = self.reading.lift_pose(next(k for k in self.lifts if k.name == lift))
            entry = Entry(f"{lift}-{self.plan.name}", "room", "elevator_cabin")
            self.space(entry, outline, pose, self.reading.lifts[lift])

    def space(self, entry: Entry, outline: Polygon, pose: Pose, elevator: str | None) -> None:
        """Add a room with its outline about its own origin."""
        own = _moved(outline, pose.inverse())
        entry.holder, entry.pose = self.holder, pose
        entry.shapes = [Shape("polygon", _prism(own, self.height), own)]
        entry.detail = Place(0.0, self.height, elevator)
        self.spaces.append(_Space(self.reading.add(entry), outline, pose))

    def connect(self, door: _Door, rooms: Sequence[_Space]) -> None:
        sides = rooms_beside([room.outline for room in rooms], door.line)
        left, right = (rooms[i] if i is not None else None for i in (sides.left, sides.right))
        if left is None and right is None:
            self.reading.skip(
                door.element, "touches no room", "Join it to walls that enclose a room."
            )
        elif left is right:
            assert left is not None
            self.reading.out.notes.append(
                f"{door.name}: both sides are {left.name}, so that it joins nothing; kept as object"
            )
            frame = _frame(door.line, left, right)
            self.reading.add(
                Entry(
                    door.name,
                    "object",
                    "door",
                    properties=door.properties,
                    holder=self.holder,
                    pose=frame,
                    shapes=[_leaf(door.line.length)],
                )
            )
        else:
            self.connector(door, left, right, "door", "pass_door")

    def connect_lift(self, door: _Door, lift: str, rooms: Sequence[_Space]) -> None:
        """An elevator door joins the room before it (to its left) and the cabin."""
        outlines = [room.outline for room in rooms]
        before = rooms_beside(outlines, door.line, reach=2 * SHAFT_REACH).left
        name = f"{lift}-{self.plan.name}"
        cabin = next(s for s in self.spaces if s.name == name or s.name.startswith(f"{name}_"))
        lobby = rooms[before] if before is not None else None
        self.connector(door, lobby, cabin, "elevator_door", "call_elevator")

    def connect_opening(self, name: str, border: LineString, rooms: int) -> None:
        """A border without wall or door: a connector without a leaf, at the border's middle."""
        half = border.length / 2
        a, b = (border.interpolate(half + d) for d in (-0.25, 0.25))
        sides = rooms_beside([s.outline for s in self.spaces[:rooms]], LineString([a, b]), 0.5)
        if sides.left is None or sides.right is None or sides.left == sides.right:
            return
        door = _Door(LineString([a, b]), name, {"width": border.length}, name)
        left, right = self.spaces[sides.left], self.spaces[sides.right]
        self.connector(door, left, right, "opening", "drive_through")

    def connector(
        self, door: _Door, left: _Space | None, right: _Space | None, form: str, behaviour: str
    ) -> None:
        first, second = (left, right) if left is not None else (right, None)
        assert first is not None
        frame = _frame(door.line, left, right)
        width = float(str(door.properties.get("width", door.line.length)))
        self.reading.add(
            Entry(
                door.name,
                "connector",
                form,
                properties=door.properties,
                holder=self.holder,
                pose=frame,
                shapes=[] if form == "opening" else [_leaf(width)],
                detail=Connects(
                    (first.name, second.name if second is not None else OUTSIDE),
                    (_standing(frame, first, -1), _standing(frame, second, 1)),
                    type="elevator_door" if form == "elevator_door" else "door",
                    behaviour=behaviour,
                    width=width,
                ),
            ),
            "-door",
        )

    def place_entries(self) -> None:
        """Named vertices and the ends of lanes as regions, lanes as links between them."""
        lanes = [edge for edge, _ in self.lines(self.plan.lanes)]
        ends = {i for lane in lanes for i in (lane.start, lane.end)}
        entries: dict[int, str] = {}
        for i, vertex in enumerate(self.plan.vertices):
            if vertex is None or i in self.far or not (vertex.name or i in ends):
                continue
            wanted = vertex.name or f"{self.plan.name}-waypoint{i}"
            type_ = next((t for key, t in PLACE_TYPES if vertex.params.get(key)), "waypoint")
            x, y = (float(v) for v in self.points[i])
            holder, pose = self.held(Pose(x, y))
            entries[i] = self.reading.add(
                Entry(
                    wanted,
                    "region",
                    type_,
                    label=vertex.name or None,
                    properties=dict(vertex.params),
                    holder=holder,
                    pose=pose,
                ),
                "-waypoint",
            )
        links: dict[tuple[str, str], Link] = {}
        for lane in lanes:
            ends_of_lane = (entries[lane.start], entries[lane.end])
            link = links.setdefault(ends_of_lane, Link(ends_of_lane[0], "lane", ends_of_lane[1]))
            _describe_lane(link, lane)
        self.reading.out.links += links.values()

    def held(self, pose: Pose) -> tuple[str, Pose]:
        """The room at a pose in the storey's frame, or the storey, and the pose in that."""
        point = Point(pose.x, pose.y)
        space = next((s for s in self.spaces if s.outline.covers(point)), None)
        return (space.name, space.pose.inverse() @ pose) if space else (self.holder, pose)

    def model_entry(self, model: Model) -> None:
        (x, y), *_ = self.to_map.apply([(model.x, model.y)])
        middle: NDArray[np.float64] = (
            np.median(self.points, axis=0) if len(self.points) else np.zeros(2)
        )
        away = math.hypot(x - middle[0], y - middle[1], model.z)
        if EXTENT.exceeded_by(away):
            self.reading.skip(
                f"{model.element} ({model.name})",
                f"stands {away:.0f} m from the middle of its level",
                "Move it to where it belongs.",
            )
            return
        own = model.model.rpartition("/")[2]
        yaw = model.yaw + self.to_map.yaw
        holder, pose = self.held(Pose.planar(float(x), float(y), yaw, model.z))
        self.reading.add(
            Entry(
                model.name.rpartition("/")[2],
                "object",
                guess_type(own) or "_".join(words(own)) or None,
                label=own,
                properties={"model": model.model, "static": model.static},
                holder=holder,
                pose=pose,
            )
        )


def _describe_lane(link: Link, lane: Edge) -> None:
    """A lane's parameters; lanes of several graphs between the same places are one link."""
    about = link.properties
    graphs = {*about.get("graphs", []), lane.params.get("graph_idx", 0)}
    about["graphs"] = sorted(graphs)
    about["bidirectional"] = bool(lane.params.get("bidirectional", True))
    for key in LANE_PROPERTIES:
        if lane.params.get(key):
            about[key] = lane.params[key]


def _rectangle(width: float, depth: float) -> Polygon:
    return shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)


def _moved(polygon: Polygon, pose: Pose) -> Polygon:
    return shapely.transform(
        polygon, lambda xy: pose.apply(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]
    )


def _prism(outline: Polygon | MultiPolygon, height: float) -> Mesh:
    return join([prism_mesh(part, 0.0, height) for part in shapely.get_parts(outline)])


def _leaf(width: float) -> Shape:
    """The closed door: y along it, as the connector's x leads through it."""
    low = (-LEAF_THICKNESS / 2, -width / 2, 0.0)
    return Shape("box", box_mesh(low, (LEAF_THICKNESS / 2, width / 2, LEAF_HEIGHT)))


def _frame(line: LineString, left: _Space | None, right: _Space | None) -> Pose:
    """The middle of a door, x from its left to its right, or outward where left is outside."""
    (ax, ay), (bx, by) = shapely.get_coordinates(line)
    along = math.atan2(by - ay, bx - ax)
    inward = left is None and right is not None
    yaw = along + (math.pi / 2 if inward else -math.pi / 2)
    return Pose.planar((ax + bx) / 2, (ay + by) / 2, yaw)


def _standing(frame: Pose, space: _Space | None, side: int) -> Pose:
    """A pose before the door, facing it, in the door's frame; `side` is -1 or 1 along x."""
    distances = STANDING if space is not None else STANDING[:1]
    for distance in distances:
        x, y, _ = frame.apply([(side * distance, 0.0, 0.0)])[0]
        if space is None or space.outline.contains(Point(x, y)):
            break
    else:
        distance = STANDING[0]
    return Pose.planar(side * distance, 0.0, 0.0 if side < 0 else math.pi)
