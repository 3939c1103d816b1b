"""The drawing of one level in metres, in the frame of its storey."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely
from shapely import LineString, Polygon

from semmap.geometry.morphology import polygons
from semmap.geometry.outline import placed_outline
from semmap.ingest.rmf.building_file import Edge, LevelPlan, Lift, LiftDoor
from semmap.ingest.rmf.building_world import BuildingWorld
from semmap.ingest.world import WorldError
from semmap.limits import EXTENT

DOOR_PROPERTIES = (
    "type",
    "motion_axis",
    "motion_direction",
    "motion_degrees",
    "right_left_ratio",
    "plugin",
)
"""Parameters of a door that become properties."""


@dataclass
class DrawnDoor:
    """A door or elevator door as a directed line."""

    line: LineString
    name: str
    properties: dict[str, object]
    element: str


class StoreyDrawing:
    """What a level draws; unusable elements are left out of the world and named.

    `points` (V, 2) are its vertices, of which those numbered in `far` are too far away to be used;
    `lift_doors` are by names of lift and door, each with the cabin to its right.
    """

    def __init__(self, world: BuildingWorld, plan: LevelPlan) -> None:
        self._world, self.plan = world, plan
        self.to_map = world.to_map[plan.name]
        self.points = self.to_map.apply(
            [(v.x, v.y) if v else (0.0, 0.0) for v in plan.vertices] or np.empty((0, 2))
        )
        self.far = self._far_vertices()
        self.walls = [line for _, line in self.lines(plan.walls)]
        self.doors = [self._door(edge, line) for edge, line in self.lines(plan.doors)]
        self.floors = self._floor_outlines()
        self.lifts = [lift for lift in world.building.lifts if plan.name in lift.level_doors]
        self.lift_doors = {
            (lift.name, name): self._lift_door(lift, lift.doors[name])
            for lift in self.lifts
            for name in lift.level_doors[plan.name]
        }

    def _far_vertices(self) -> set[int]:
        """Return the vertices beyond the extent of a map around the level's middle."""
        usable = [i for i, v in enumerate(self.plan.vertices) if v is not None]
        if not usable:
            return set()
        refused = partial(WorldError, self._world.building.path, f"levels/{self.plan.name}")
        fix = "Move it to the origin, or import it into a map of its own."
        most = np.percentile(np.linalg.norm(self.points[usable], axis=1), 50, method="lower")
        EXTENT.check(float(most), refused, fix, "lies off the map's origin by")
        middle = np.median(self.points[usable], axis=0)
        away = np.linalg.norm(self.points - middle, axis=1)
        far = {i for i in usable if not away[i] <= EXTENT.value}
        for i in sorted(far):
            element = f"levels/{self.plan.name}/vertices[{i}]"
            problem = f"lies {away[i]:.0f} m from the middle of its level"
            self._world.skip(element, problem, "Move it to where it belongs.")
        return far

    def _near(self, indices: Iterable[int], element: str) -> bool:
        """Return whether all vertices are near; if not, the element is left out."""
        near = self.far.isdisjoint(indices)
        if not near:
            problem = "refers to a vertex that lies far away"
            self._world.skip(element, problem, "Correct the vertex.")
        return near

    def lines(self, edges: Sequence[Edge]) -> list[tuple[Edge, LineString]]:
        """Return the usable edges, each with its line."""
        found = []
        for edge in edges:
            if not self._near((edge.start, edge.end), edge.element):
                continue
            line = LineString(self.points[[edge.start, edge.end]])
            if line.length < 1e-3:
                self._world.skip(edge.element, "has no length", "Delete it or move an end.")
            else:
                found.append((edge, line))
        return found

    def _door(self, edge: Edge, line: LineString) -> DrawnDoor:
        name = str(edge.params.get("name") or f"{self.plan.name}-door{edge.start}-{edge.end}")
        given = {key: edge.params[key] for key in DOOR_PROPERTIES if key in edge.params}
        properties = {("door_type" if k == "type" else k): v for k, v in given.items()}
        return DrawnDoor(line, name, properties, f"{edge.element} ({name})")

    def _lift_door(self, lift: Lift, door: LiftDoor) -> DrawnDoor:
        """Return the elevator door, directed so that the cabin lies to its right."""
        pose = self._world.lift_pose(lift)
        half = 0.5 * door.width * np.array([math.cos(door.yaw), math.sin(door.yaw)])
        middle = np.array([door.x, door.y])
        if half[0] * -middle[1] - half[1] * -middle[0] > 0:
            half = -half
        ends = np.array([middle - half, middle + half])
        return DrawnDoor(
            LineString(pose.apply(np.column_stack([ends, [0, 0]]))[:, :2]),
            f"{lift.name}-{self.plan.name}-{door.name}",
            {"door_type": door.type},
            f"{lift.element}/doors/{door.name} on {self.plan.name}",
        )

    def _floor_outlines(self) -> list[Polygon]:
        floors: list[Polygon] = []
        for floor in self.plan.floors:
            if not self._near(floor.vertices, floor.element):
                continue
            drawn = shapely.make_valid(Polygon(self.points[list(floor.vertices)]))
            parts = [
                p for part in shapely.get_parts(drawn) for p in polygons(part) if p.area > 1e-6
            ]
            if not parts:
                self._world.skip(floor.element, "encloses no area", "Draw the floor again.")
            floors += parts
        return floors

    def cabin_outline(self, lift: Lift) -> Polygon:
        """Return the outline of a lift's cabin."""
        width, depth = lift.width, lift.depth
        cabin = shapely.box(-width / 2, -depth / 2, width / 2, depth / 2)
        return placed_outline(cabin, self._world.lift_pose(lift))
