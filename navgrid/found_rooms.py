"""Rooms and doorways found in the geometry of a storey that has none, or not all."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, takewhile
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import LineString, Polygon, affinity

from navgrid.grid import Grid, grid_around
from navgrid.lintels import lintel_heights
from navgrid.posts import between_posts
from navgrid.room_segments import Gap, Passage, border_labels, room_segments, wall_heading
from navgrid.slabs import area_cells, mesh_of, occupancy
from semmap.geometry.extent import extent
from semmap.geometry.mesh import prism_mesh
from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import common, united
from semmap.ingest.floor_plan import reading_order
from semmap.ingest.world import OUTSIDE
from semmap.query.storey_scene import FRAME, IN_OPENING, SceneEntity, StoreyScene

RESOLUTION = 0.05
"""The sides of the cells that are divided into rooms, metres."""

MOST_CELLS = 2**26
"""Of a storey: 410 m by 410 m, in 2 GB of memory."""

TALL, THIN = 2.25, 0.5
"""Metres: an object without a type, so high above the floor and so thin, is a wall."""

WALL_HEIGHTS, LINTEL_HEIGHTS = (0.1, 1.8), (TALL, TALL + 0.2)
"""Metres above the floor in which a wall stands, and in which only it and lintels are."""

HOLLOW = 0.3
"""Metres between the two faces of a wall whose mesh is not closed."""

PANEL, PANEL_HIGH, PANEL_PART = 0.3, 0.3, 0.8
"""Metres: what is so thin and so high and has no type fills a gap between walls of which it stands
along so large a part: it is a parapet, and the gap no doorway."""

SMALLEST, SMALLEST_CLOSED = 1.25, 2.0
"""Square metres of a room, at least, such as a toilet; and of one into which no doorway leads."""

WALLS = frozenset({"wall", "window", "building_shell"})
"""Types of the parts of a building between which rooms are."""

GATE, BESIDE_GATE, SURE_GATE = 3.0, 0.4, 0.9
"""Metres of the least width of a gate, and from its leaf to the walls; its confidence."""

CLOSED = 0.5
"""The confidence of a room without a doorway."""

LIFT = 0.7
"""The confidence of a lift: a shaft may be one of pipes, with doors for their keeper."""

MARGIN = 1.0
"""Metres of the grid around the walls: the cells connected with its border are outside."""

BESIDE = 0.15
"""Metres from its room to a doorway that leads outside, at most."""

SAME, PART = 0.5, 0.2
"""The part of a found room that rooms of the map cover if they are the same, and of the smaller
one's area that each of them shares with it; and metres from another doorway within which a found
one is the same."""


class FoundRoom(NamedTuple):
    """A room: its outline in the map's frame, metres; how sure it is one, 0 to 1.

    Its type follows from the objects `shown_by`; None where they show none.
    """

    name: str
    outline: Polygon
    ceiling: float | None
    confidence: float
    type: str | None = None
    shown_by: tuple[str, ...] = ()


class FoundDoorway(NamedTuple):
    """A doorway of two rooms, or of one that leads outside: the line from post to post, metres.

    `height` is from the floor to the lintel; None where it is open up to the ceiling, or unknown.
    `leaf` is the object that is the door in it; None where it is an opening.
    """

    name: str
    rooms: tuple[str, str | None]
    line: LineString
    confidence: float
    height: float | None = None
    leaf: str | None = None

    @property
    def type(self) -> Literal["door", "opening"]:
        """What the connector is."""
        return "door" if self.leaf else "opening"

    @property
    def joins(self) -> tuple[str, str]:
        """The rooms, or `outside`."""
        return self.rooms[0], self.rooms[1] or OUTSIDE


class FoundStairs(NamedTuple):
    """Stairs from a room to one of the storey above.

    `ends` (2, 3) are where a robot stands before and behind them, `floors` the z of both, metres in
    the map's frame; `treads` is the name of the object.
    """

    name: str
    rooms: tuple[str, str]
    ends: NDArray[np.float64]
    floors: tuple[float, float]
    treads: str


class FoundLift(NamedTuple):
    """A lift: the rooms that are its cabin, from the lowest storey on."""

    name: str
    cabins: tuple[str, ...]
    confidence: float = LIFT


@dataclass(frozen=True, eq=False)
class FoundRooms:
    """What the geometry of a storey shows and the map does not have yet.

    These are rooms, doorways, stairs to the storey above, and lifts that begin here. `known` are
    the rooms of the map that were found again; `problem` says why nothing was found, or which
    doorways were not added, and why; `notes` are on stairs before which a room has no place.
    """

    storey: str
    elevation: float
    rooms: tuple[FoundRoom, ...] = ()
    doorways: tuple[FoundDoorway, ...] = ()
    stairs: tuple[FoundStairs, ...] = ()
    lifts: tuple[FoundLift, ...] = ()
    known: tuple[str, ...] = ()
    problem: str | None = None
    notes: tuple[str, ...] = ()

    def table(self) -> list[dict[str, Any]]:
        """A row for each: kind, name, type, metres (square, of rooms), high, confidence, and `by`.

        `high` are the metres to the ceiling of a room or the lintel of a doorway, where one is
        known. `by` are the objects that show a room's type, the rooms that a doorway or stairs
        join, and the cabins of a lift, of which `metres` is the number.
        """
        high = {r.name: r.ceiling - self.elevation for r in self.rooms if r.ceiling is not None}
        high |= {d.name: d.height for d in self.doorways if d.height is not None}
        rooms = [
            ("room", r.name, r.type, round(r.outline.area, 1), r.confidence, r.shown_by)
            for r in self.rooms
        ]
        doorways = [
            ("doorway", d.name, d.type, round(d.line.length, 2), d.confidence, d.joins)
            for d in self.doorways
        ]
        stairs = [
            ("stairs", s.name, "stairs", round(float(np.ptp(s.ends[:, 2])), 2), 1.0, s.rooms)
            for s in self.stairs
        ]
        lifts = [
            ("lift", lift.name, "elevator", len(lift.cabins), lift.confidence, lift.cabins)
            for lift in self.lifts
        ]
        return [
            {
                "storey": self.storey,
                "kind": kind,
                "name": name,
                "type": type_,
                "metres": metres,
                "high": round(high[name], 2) if name in high else None,
                "confidence": round(confidence, 2),
                "by": ", ".join(by),
            }
            for kind, name, type_, metres, confidence, by in (*rooms, *doorways, *stairs, *lifts)
        ]


def find_rooms(
    scene: StoreyScene,
    shows: Mapping[str, Sequence[str]] = MappingProxyType({}),
    supertypes: Mapping[str, Sequence[str]] = MappingProxyType({}),
    resolution: float = RESOLUTION,
) -> FoundRooms:
    """Divide the space between the walls of a storey into rooms, and find their doorways.

    `shows`: by type of objects, the types of rooms in which they usually are. `supertypes`: by
    these, what subsumes them, themselves first. Furniture and the leaves of doors divide nothing.
    Raises ValueError where no walls enclose a room.
    """
    walls = [_filled(wall) for wall in scene_walls(scene)]
    turn, grid, cells, above = turned_cells(walls, scene.elevation, resolution)
    segments = room_segments(
        cells,
        resolution,
        above,
        any(wall.properties.get("scanned") for wall in walls),
        list(_gates(scene, cells, grid, turn)),
    )
    outside = set(border_labels(segments.labels).tolist())
    entered = {segment for passage in segments.passages for segment in passage.segments}
    areas = np.bincount(segments.labels.ravel()) * resolution**2
    outlines = {
        segment: outline
        for segment in range(1, len(areas))
        if segment not in outside
        and areas[segment] >= (SMALLEST if segment in entered else SMALLEST_CLOSED)
        and (outline := outline_of_cells(segments.labels == segment, grid)) is not None
    }
    outlines = {
        segment: shapely.transform(outline, lambda xy: turned_points(xy, turn))
        for segment, outline in outlines.items()
    }
    if not outlines:
        raise ValueError(
            f"the walls of {scene.storey} enclose no room: those of its border are missing, or "
            f"are no objects of the type wall, nor {TALL:g} m high and {THIN:g} m thin"
        )
    origin = np.array(grid.origin)
    ways = [
        (each, turned_points((each.ends[:, ::-1] + 0.5) * resolution + origin, turn))
        for each in segments.passages
    ]
    found = _new(scene, outlines, ways)
    panels = _panels(scene)
    found = replace(
        found,
        doorways=tuple(
            way
            for way in found.doorways
            if not any(
                common(panel, way.line).length >= PANEL_PART * way.line.length for panel in panels
            )
        ),
    )
    triangles = np.concatenate([wall.triangles for wall in walls])
    lines = [way.line for way in found.doorways]
    if not any(wall.properties.get("scanned") for wall in walls):
        lines = between_posts(lines, triangles, scene.elevation, 2 * resolution)
    heights = lintel_heights(lines, triangles, scene.elevation)
    return replace(
        found,
        rooms=tuple(_typed(room, scene, shows, supertypes) for room in found.rooms),
        doorways=tuple(
            way._replace(line=line, height=height, leaf=_leaf_across(scene, line))
            for way, line, height in zip(found.doorways, lines, heights, strict=True)
        ),
    )


def _gates(scene: StoreyScene, walls: NDArray[np.bool_], grid: Grid, turn: float) -> Iterator[Gap]:
    """Leaves across openings that are too wide for a doorway, such as those of a shop."""
    reach = ndimage.binary_dilation(walls, iterations=math.ceil(BESIDE_GATE / grid.resolution))
    for entity in scene.entities:
        if "door_leaf" not in entity.types or entity.footprint is None:
            continue
        points = turned_points(shapely.get_coordinates(entity.footprint), -turn)
        around = shapely.MultiPoint(points).minimum_rotated_rectangle
        corners = shapely.get_coordinates(around)[:4]
        if len(corners) < 4 or around.length / 2 < GATE:
            continue
        if math.dist(*corners[:2]) > math.dist(*corners[1:3]):
            corners = np.roll(corners, 1, axis=0)  # the short sides are the first and the third
        posts = np.array([corners[:2].mean(axis=0), corners[2:].mean(axis=0)])
        ends = ((posts - grid.origin) / grid.resolution - 0.5)[:, ::-1]
        rows, columns = np.round(ends).astype(int).clip(0, np.array(grid.shape) - 1).T
        if reach[rows, columns].all():
            leaf = around.buffer(2 * grid.resolution, join_style="mitre")
            yield Gap(np.argwhere(area_cells(leaf, grid) & ~walls), ends, SURE_GATE)


def _leaf_across(scene: StoreyScene, line: LineString) -> str | None:
    """The name of the door's leaf that fills most of a doorway, from its floor on."""
    longer = 1 + 2 * FRAME / line.length
    across = affinity.scale(line, longer, longer).buffer(FRAME, cap_style="flat")
    low = scene.elevation + FRAME
    filled = {
        entity.name: common(entity.footprint, line.buffer(FRAME, cap_style="flat")).area
        for entity in scene.entities
        if entity.kind == "object" and not {"door", "door_leaf"}.isdisjoint(entity.types)
        if entity.footprint is not None and entity.heights is not None
        if entity.heights[0] <= low < entity.heights[1]
        if common(entity.footprint, across).area >= IN_OPENING * entity.footprint.area
    }
    return max(filled, key=lambda name: filled[name], default=None)


def scene_walls(scene: StoreyScene) -> list[SceneEntity]:
    """Return the walls, by type, or by shape where an object has none; ValueError without any."""
    walls = [
        entity
        for entity in scene.entities
        if entity.kind == "object" and len(entity.triangles)
        if not WALLS.isdisjoint(entity.types)
        or (entity.types[:1] in ((), ("object",)) and _is_upright(entity, scene.elevation))
    ]
    if not walls:
        raise ValueError(
            f"{scene.storey} has no walls: no object is of the type wall or building_shell, nor is "
            f"one without a type {TALL:g} m high and {THIN:g} m thin"
        )
    return walls


def _panels(scene: StoreyScene) -> list[shapely.Geometry]:
    """What is near to things without a type that stand as parapets do: thin, and on the floor."""
    return [
        entity.footprint.buffer(BESIDE, cap_style="flat", join_style="mitre")
        for entity in scene.entities
        if entity.kind == "object" and entity.types[:1] in ((), ("object",))
        if entity.footprint is not None and entity.heights is not None
        if entity.heights[0] <= scene.elevation + PANEL_HIGH / 2
        if entity.heights[1] >= scene.elevation + PANEL_HIGH
        if _thickness(entity.footprint) <= PANEL
    ]


def _thickness(footprint: shapely.Geometry) -> float:
    """Metres of the width of a strip that is as large and has as long a border."""
    half, area = footprint.length / 2, footprint.area
    return float(half - math.sqrt(max(half**2 - 4 * area, 0.0))) / 2


def _filled(entity: SceneEntity) -> SceneEntity:
    """A window with its panes, which may be no shapes, between its frame; others as they are."""
    if "window" not in entity.types or entity.footprint is None or entity.heights is None:
        return entity
    panes = prism_mesh(entity.footprint, *entity.heights)
    return replace(entity, triangles=np.asarray(panes.vertices[panes.faces], np.float64))


def _is_upright(entity: SceneEntity, floor: float) -> bool:
    """Return whether an entity stands as a wall or a column does: thin, and up to the ceiling."""
    if entity.heights is None or not (
        entity.heights[0] <= floor + TALL / 2 and entity.heights[1] >= floor + TALL
    ):
        return False
    if entity.footprint is None:
        return True
    return _thickness(entity.footprint) <= THIN


def turned_cells(
    walls: Sequence[SceneEntity], floor: float, resolution: float
) -> tuple[float, Grid, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return by how many radians to turn cells back, their grid, those of walls, and of lintels.

    They are turned so that most walls run along rows and columns.
    """
    triangles = np.concatenate([entity.triangles for entity in walls])
    solids = np.repeat(np.arange(len(walls)), [len(entity.triangles) for entity in walls])

    def drawn() -> tuple[Grid, NDArray[np.bool_]]:
        low, high = extent(triangles)
        sides = np.ptp([low, high], axis=0)[:2]
        if sides.prod() / resolution**2 > MOST_CELLS:
            raise ValueError(
                f"its walls are {sides[0]:.0f} m by {sides[1]:.0f} m: too large to find rooms in "
                f"cells of {resolution:g} m. If that is the wrong unit, import it by its scale"
            )
        grid = grid_around([(low[0], low[1], high[0], high[1])], resolution, MARGIN)
        return grid, _wall_cells(triangles, solids, floor, grid)

    grid, cells = drawn()
    turn = wall_heading(cells[0])
    if abs(turn) * max(grid.shape) > 0.5:
        triangles = turned_points(triangles, -turn)
        grid, cells = drawn()
    return turn, grid, cells[0], cells[1]


def _wall_cells(
    triangles: NDArray[np.float64], solids: NDArray[np.int64], floor: float, grid: Grid
) -> NDArray[np.bool_]:
    slabs = [(floor + low, floor + high) for low, high in (WALL_HEIGHTS, LINTEL_HEIGHTS)]
    cells = occupancy(mesh_of(triangles), slabs, grid, solid=solids, fill=True)
    line = np.ones((1, 1, 2 * math.ceil(HOLLOW / 2 / grid.resolution) + 1), np.bool_)
    for across in (line, line.swapaxes(1, 2)):  # a ball would fill the corners of rooms
        cells |= ndimage.binary_closing(cells, across)
    return cells


def turned_points(points: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Turn points (..., 2 or 3) about the origin and the z axis."""
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack(
        [cos * x - sin * y, sin * x + cos * y, *np.moveaxis(points[..., 2:], -1, 0)], -1
    )


def outline_of_cells(cells: NDArray[np.bool_], grid: Grid) -> Polygon | None:
    """Return the outline of cells, metres: straight along rows and columns, and along other walls.

    It is half a cell wider, since a wall has the cells that it touches.
    """
    smooth = polygons(grid.area(cells).simplify(1.1 * grid.resolution).buffer(0))
    largest = max(smooth, key=lambda part: part.area, default=None)
    if largest is None:
        return None
    shell, *holes = (
        _straight(ring, 2 * grid.resolution) for ring in (largest.exterior, *largest.interiors)
    )
    wider = Polygon(shell, holes).buffer(0).buffer(grid.resolution / 2, join_style="mitre")
    return max(polygons(wider), key=lambda part: part.area, default=None)


def _straight(ring: shapely.LinearRing, slack: float) -> NDArray[np.float64]:
    """Put the edges of a ring that are along an axis, but for `slack` metres, along it."""
    corners = shapely.get_coordinates(ring)[:-1]
    ends = np.roll(corners, -1, axis=0)
    across = np.abs(ends - corners)
    along = (across <= slack) & (across < across[:, ::-1] / 2)  # (N, 2): x is the same, y is
    level = (corners + ends) / 2
    found = []
    for i, corner in enumerate(corners):
        before, after = corner.copy(), corner.copy()
        before[along[i - 1]] = level[i - 1][along[i - 1]]
        after[along[i]] = level[i][along[i]]
        if (along[i - 1] & along[i]).any():
            found += [before, after]
        else:
            found.append(np.where(along[i - 1], before, after))
    return np.array(found)


def _new(
    scene: StoreyScene,
    outlines: dict[int, Polygon],
    passages: Sequence[tuple[Passage, NDArray[np.float64]]],
) -> FoundRooms:
    """Name the rooms that the map lacks, from top to bottom and left to right."""
    taken = {entity.name for entity in scene.entities}
    room_names, door_names = (_names(f"{scene.storey}_{kind}", taken) for kind in ("room", "door"))
    names: dict[int, dict[str, Any]] = {}  # of the rooms that a segment is, with their outlines
    rooms, known = [], []
    for segment in sorted(outlines, key=lambda each: reading_order(outlines[each])):
        outline = outlines[segment]
        names[segment] = _same(scene, outline)
        known += [name for name in names[segment] if name not in known]
        if not names[segment]:
            name = next(room_names)
            names[segment] = {name: outline}
            sure = min((p.confidence for p, _ in passages if segment in p.segments), default=CLOSED)
            rooms.append(FoundRoom(name, outline, _ceiling(scene, outline), sure))
    there = [
        LineString([side.translation[:2] for side in e.sides]).interpolate(0.5, normalized=True)
        for e in scene.entities
        if e.sides is not None
    ]
    doorways: list[FoundDoorway] = []
    for passage, posts in sorted(passages, key=lambda each: -each[0].confidence):
        a, b = sorted(passage.segments, key=lambda each: names.get(each) is None)
        if a not in names:
            continue
        line = _amid(LineString(posts), outlines[a], outlines.get(b))
        middle = line.interpolate(0.5, normalized=True)
        if any(middle.distance(other) < SAME for other in there):
            continue
        first, second = _nearest(names[a], middle), _nearest(names.get(b, {}), middle)
        if first is None or first == second:  # inside of a room that was merged
            continue
        there.append(middle)
        way = FoundDoorway(next(door_names), (first, second), line, passage.confidence)
        doorways.append(way)
    return FoundRooms(
        scene.storey, scene.elevation, tuple(rooms), tuple(doorways), known=tuple(known)
    )


def _amid(line: LineString, first: Polygon, second: Polygon | None) -> LineString:
    """A line in a thick wall, moved to the middle between two rooms, or to `BESIDE` one."""
    behind = BESIDE if second is None else second.distance(line)
    ahead = first.distance(line)
    if second is None and ahead <= behind:
        return line
    middle, nearest = shapely.shortest_line(line.centroid, first).coords
    away = np.subtract(nearest, middle)
    reach = float(np.hypot(*away))
    shift = away / reach * (ahead - behind) / (2 if second is not None else 1) if reach else away
    return shapely.transform(line, lambda xy: xy + shift)


def _same(scene: StoreyScene, outline: Polygon) -> dict[str, Any]:
    """The rooms of the map, with their outlines, that a found one is: one, or parts of it."""
    parts = {
        e.name: e.footprint
        for e in scene.entities
        if e.kind == "room" and e.footprint is not None
        if common(e.footprint, outline).area >= PART * min(outline.area, e.footprint.area)
    }
    whole = united(parts.values())
    return parts if common(whole, outline).area >= SAME * outline.area else {}


def _nearest(rooms: Mapping[str, Any], at: shapely.Point) -> str | None:
    """The name of the room that is nearest to a point; None without rooms."""
    return min(rooms, key=lambda name: rooms[name].distance(at), default=None)


def _typed(
    room: FoundRoom,
    scene: StoreyScene,
    shows: Mapping[str, Sequence[str]],
    supertypes: Mapping[str, Sequence[str]],
) -> FoundRoom:
    """Give a room the type for which most of its objects speak, each for those that it shows.

    What speaks for a type speaks for what subsumes it: a bathtub and a toilet, for a sanitary room.
    It becomes a type of it for which half of these speak: a bathroom. Of several types for which as
    many speak, it is what subsumes them.
    """
    votes: defaultdict[str, float] = defaultdict(float)
    voters: defaultdict[str, list[str]] = defaultdict(list)
    for entity in scene.entities:
        told = next((shows[t] for t in entity.types if t in shows), ())
        if not told or entity.bounds is None:
            continue
        if room.outline.contains(shapely.box(*entity.bounds).centroid):
            for each in told:
                votes[each] += 1 / len(told)
                voters[each].append(entity.name)
    if not votes:
        return room
    uses = {
        type_: list(takewhile("room".__ne__, supertypes.get(type_, (type_,)))) for type_ in votes
    }
    spoken = {type_: sum(votes[v] for v in votes if type_ in uses[v]) for type_ in votes}
    most = [type_ for type_ in votes if math.isclose(spoken[type_], max(spoken.values()))]
    best = next((use for use in uses[most[0]] if all(use in uses[t] for t in most)), None)
    if best is None:
        return room
    narrower = [v for v in votes if best in uses[v] and 2 * spoken[v] >= spoken.get(best, math.inf)]
    best = min(narrower, key=lambda type_: spoken[type_], default=best)
    speakers = [
        name
        for type_ in votes
        if best in uses[type_] or type_ in uses[best]
        for name in voters[type_]
    ]
    return room._replace(type=best, shown_by=tuple(dict.fromkeys(speakers)))


def _ceiling(scene: StoreyScene, outline: Polygon) -> float | None:
    """Return the lowest ceiling above the middle of a room, where an object is one."""
    middle = outline.representative_point()
    above = [
        e.heights[0]
        for e in scene.entities
        if "ceiling" in e.types and e.heights is not None and e.bounds is not None
        if shapely.box(*e.bounds).contains(middle) and e.heights[0] > scene.elevation + TALL
    ]
    return min(above, default=None)


def _names(stem: str, taken: set[str]) -> Iterator[str]:
    """Yield names that the storey does not have: stem1, stem2 and so on."""
    return (name for i in count(1) if (name := f"{stem}{i}") not in taken)
