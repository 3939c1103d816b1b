"""The world that an IFC building becomes: its storeys, spaces, lifts and elements.

IFC 4.3 (ISO 16739-1:2024), 5.4: the spatial structure.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from semmap.geometry.mesh import prism_mesh
from semmap.geometry.morphology import areas_within
from semmap.geometry.outline import placed_outline
from semmap.geometry.pose import Pose
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.ifc.element_types import family, give_element_type
from semmap.ingest.ifc.ifc_file import IfcFile
from semmap.ingest.naming import guess_type
from semmap.ingest.world import (
    OUTSIDE,
    Entry,
    PlaceDetail,
    Shape,
    Skipped,
    StoreyDetail,
    World,
    unique_name,
)

APART = ("IfcFeatureElement", "IfcTransportElement", "IfcVirtualElement")
"""Classes of elements that are no objects: lifts, and what has no matter."""

CABIN, LARGER = 7.0, 3.0
"""Square metres of a cabin, at most, of a lift without a body; how many times larger than the body
of a lift a space may be that is its cabin."""

UPRIGHT, SMALLEST = 1e-6, 1e-4
"""Square metres of a triangle seen from above: a smaller one stands upright; and of an area."""


@dataclass(frozen=True)
class IfcStorey:
    """A storey of the map; `elevation` in metres above the file's origin."""

    name: str
    elevation: float


@dataclass(frozen=True)
class IfcRoom:
    """A room: its outline and the z of its floor in the map's frame, metres.

    `number` is that of the file's entity.
    """

    name: str
    outline: Polygon | MultiPolygon
    floor: float
    storey: IfcStorey
    number: int
    is_cabin: bool


class IfcBuilding:
    """A world `out` that grows from an IFC file, each holder before what it holds."""

    def __init__(self, file: IfcFile) -> None:
        self.file = file
        self.out = World(file.path.stem, file.path)
        self.spaces: list[IfcRoom] = []
        self._names = {OUTSIDE}
        self._storeys: dict[int, IfcStorey] = {}
        self._lifts: list[tuple[str, Point, float]] = []

    def add(self, entry: Entry, about: Any = None) -> str:
        """Add an entry under a free name, with what the file says about an entity; return it."""
        entry.name = unique_name(entry.name, self._names)
        self._names.add(entry.name)
        if about is not None:
            entry.properties |= self.file.properties(about)
        self.out.entries.append(entry)
        return entry.name

    def skip(self, element: Any, problem: str, fix: str) -> None:
        """Leave an element out."""
        where = f"{element.is_a()} {element.Name or element.GlobalId}"
        self.out.skipped.append(Skipped(where, problem, fix))

    def storey_of(self, element: Any) -> IfcStorey | None:
        """Return the storey that an element is in, through spaces and assemblies."""
        level = self._level(element)
        return None if level is None else self._storeys.get(level.id())

    def add_storeys(self) -> None:
        """Add the storeys that have spaces or, where none has, elements; the lowest first."""
        levels = self.file.of("IfcBuildingStorey")
        used = {self._level(space) for space in self.file.of("IfcSpace")}
        if used.isdisjoint(levels):
            used = {self._level(element) for element in self.file.of("IfcElement")}
        others = [level.Name or level.GlobalId for level in levels if level not in used]
        if others:
            self.out.notes.append(
                f"no storeys of the map, since without rooms: {', '.join(others)}"
            )
        heights = {level: self.file.placement(level).z for level in levels if level in used}
        rising = sorted(heights, key=lambda level: (heights[level], level.id()))
        for level, above in pairwise([*rising, None]):
            gap = heights[above] - heights[level] if above is not None else 0.0
            entry = Entry(level.Name or "storey", "storey", "storey", level.LongName)
            entry.pose = Pose(z=heights[level])
            entry.detail = StoreyDetail(heights[level], gap or None)
            self._storeys[level.id()] = IfcStorey(self.add(entry, level), heights[level])

    def add_lifts(self) -> None:
        """Add the lifts; a space around one that is not much larger is its cabin."""
        for lift in self.file.of("IfcTransportElement"):
            kind = getattr(lift, "PredefinedType", None) or getattr(lift, "OperationType", None)
            if kind not in (None, "ELEVATOR"):
                self.skip(lift, f"is of the kind {kind}", "Draw a connector where it is.")
                continue
            solid = self.file.solid(lift)
            pose = solid.pose if solid else self.file.placement(lift)
            entry = Entry(family(lift) or "lift", "elevator", "elevator")
            entry.pose = Pose.planar(pose.x, pose.y, pose.yaw, pose.z)
            body = None if solid is None else _from_above(solid.triangles)
            most = CABIN if body is None else LARGER * body.area
            self._lifts.append((self.add(entry, lift), Point(pose.x, pose.y), most))

    def add_spaces(self) -> None:
        """Add each space as a room with its outline from above, its floor and ceiling."""
        for space in self.file.of("IfcSpace"):
            solid, storey = self.file.solid(space), self.storey_of(space)
            outline = None if solid is None else _from_above(solid.triangles)
            if solid is not None and any(
                len(areas_within(drawn, SMALLEST)) > 1 for drawn in self.file.outlines(space)
            ):
                self.skip(space, "has an outline that crosses itself", "Draw the space again.")
                continue
            if outline is None or solid is None or storey is None:
                problem = "has no storey" if storey is None else "has no area"
                self.skip(space, problem, "Correct it, or draw the room.")
                continue
            cabin = self._lift_in(outline, space)
            names = (space.LongName or "", space.Name or "", f"{space.LongName} room")
            guesses = [guess_type(name, "room") for name in names]
            type_ = next((guess.type for guess in guesses if guess is not None), "room")
            floor, ceiling = (solid.box[:, 2] - storey.elevation).tolist()
            middle = middle_of(outline)
            own = placed_outline(outline, Pose(-middle.x, -middle.y))
            entry = Entry(space.Name or space.LongName or "room", "room", label=space.LongName)
            entry.type = "elevator_cabin" if cabin else type_
            entry.holder, entry.pose = storey.name, Pose(middle.x, middle.y)
            entry.shapes = [Shape("polygon", prism_mesh(own, floor, ceiling), own)]
            entry.detail = PlaceDetail(floor, ceiling, cabin)
            name = self.add(entry, space)
            z = storey.elevation + floor
            self.spaces.append(IfcRoom(name, outline, z, storey, space.id(), cabin is not None))

    def _lift_in(self, outline: Polygon | MultiPolygon, space: Any) -> str | None:
        """Return the lift whose cabin a space is; None, with a note, where it is too large."""
        for lift, at, most in self._lifts:
            if not outline.covers(at):
                continue
            if outline.area <= most:
                return lift
            self.out.notes.append(
                f"{lift} stands in {space.Name or space.LongName}, which has {outline.area:.1f} m² "
                "and is not its cabin: draw that in a GeoJSON file (kind room, type "
                f'elevator_cabin, elevator "{lift}")'
            )
        return None

    def add_elements(self) -> None:
        """Add each element with a surface as an object; the import derives finer holders.

        A door is a connector; without rooms, which it could join, it is the leaf of one.
        """
        apart = (*APART, "IfcDoor") if self.spaces else APART
        for element in self.file.of("IfcElement"):
            solid = self.file.solid(element)
            if solid is None or any(map(element.is_a, apart)):
                continue
            storey = self.storey_of(element)
            entry = Entry(self.name_of(element), "object", label=element.Name, pose=solid.pose)
            entry.shapes = [
                Shape("mesh", solid.mesh, uri=f"{self.file.path.name}#{element.GlobalId}")
            ]
            give_element_type(entry, element)
            if storey is not None:
                entry.holder, entry.pose = storey.name, Pose(z=-storey.elevation) @ solid.pose
            self.add(entry, element)

    def name_of(self, element: Any) -> str:
        """Return a short name of an element: what it is, and its tag."""
        tag = getattr(element, "Tag", None)
        what = family(element) or element.is_a().removeprefix("Ifc")
        return f"{what} {tag}" if tag else what

    def _level(self, element: Any) -> Any:
        from ifcopenshell.util.element import get_aggregate, get_container

        while element is not None and not element.is_a("IfcBuildingStorey"):
            element = get_container(element, should_get_direct=True) or get_aggregate(element)
        return element


def _from_above(triangles: NDArray[Any]) -> Polygon | MultiPolygon | None:
    """Return the area that a body (M, 3, 3) covers seen from above; None where it has none."""
    flat = shapely.polygons(triangles[:, :, :2])
    seen = shapely.union_all(flat[shapely.area(flat) > UPRIGHT], grid_size=1e-4)
    area = shapely.simplify(shapely.buffer(seen, 0), 1e-3)
    return area if isinstance(area, Polygon | MultiPolygon) and area.area > 0 else None
