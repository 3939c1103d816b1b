"""The line of a route on the floor plans: straight through doors, in rooms on the grid."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from shapely.ops import substring

from navgrid.occupancy_grid import StoreyGrid
from navgrid.slabs import area_cells
from planner.grid_path import grid_path
from planner.route import Route
from planner.topology import Topology
from semmap.draw.floor_plan import FLAT, shown_objects
from semmap.draw.view import storey_view
from semmap.geometry.pose import Pose

Line = NDArray[np.float64]


def route_lines(
    found: Route, topology: Topology, grids: dict[str, StoreyGrid], target: str | None
) -> dict[str, list[Line]]:
    """The points (N, 2) of a route, metres, by storey, through all poses of its steps.

    Stairs are half on one storey, half on the other.

    With `target`, a type of objects, a route whose start or goal is a whole room is drawn from the
    middle of the one, and to the smallest such object in the other.
    """
    pieces: dict[str, list[Line]] = {}
    only = next(iter(grids)) if len(grids) == 1 else None

    def storey_of(place: str) -> str | None:
        return only or topology.places[place].storey

    first = found.steps[0] if found.steps else None
    if first is None or (target is not None and first.approach is None):
        at = _start_point(found, grids, storey_of(found.start))
    else:
        at = _xy(first.approach or first.leave)
    place, line = found.start, [np.array([at])]
    places = [found.start, *(step.to_place for step in found.transitions)]
    storey = next(filter(None, map(storey_of, places)), None)  # outside is on none
    for step in found.transitions:
        if step.behaviour == "use_elevator":
            if storey in grids:
                pieces.setdefault(str(storey), []).append(np.concatenate(line))
            at = (step.leave.x, step.leave.y)
            place, line = step.to_place, [np.array([at])]
            storey = storey_of(place)
            continue
        line.append(_walk(grids.get(str(storey)), place, at, _xy(step.approach)))
        way = np.array([_xy(step.approach), *step.bends, _xy(step.leave)])
        beyond = storey_of(step.to_place) or storey
        if beyond == storey:
            line.append(way[1:])
        else:
            before, after = _halves(way)
            if storey in grids:
                pieces.setdefault(str(storey), []).append(np.concatenate([*line, before]))
            line = [after]
        at, place, storey = _xy(step.leave), step.to_place, beyond
    if storey in grids:
        if found.steps and found.steps[-1].behaviour == "navigate":
            end = _xy(found.steps[-1].leave)
        elif target is None and found.steps:
            end = at
        else:
            end = _goal_point(grids[str(storey)], found.goal, target, at)
        line.append(_walk(grids[str(storey)], place, at, end))
        pieces.setdefault(str(storey), []).append(np.concatenate(line))
    return pieces


def _halves(line: Line) -> tuple[Line, Line]:
    """A line as two: of a flight of stairs, half is on the plan of each storey."""
    whole = shapely.LineString(line)
    first, second = (substring(whole, *part, normalized=True) for part in ((0, 0.5), (0.5, 1)))
    return shapely.get_coordinates(first), shapely.get_coordinates(second)


def _xy(pose: Pose | None) -> tuple[float, float]:
    assert pose is not None  # of a transition, which begins before its connector
    return (pose.x, pose.y)


def _walk(
    made: StoreyGrid | None, place: str, a: tuple[float, float], b: tuple[float, float]
) -> Line:
    """The way in a room between two points: on the grid, straight where the grid has none."""
    if made is None or math.dist(a, b) < 1e-9:
        return np.array([b])
    cells = made.cells.copy()
    outline = _outline(made, place)
    if outline is not None:
        cells[~area_cells(outline, made.grid)] = 100
    way = grid_path(made.grid, cells, a, b)
    return np.array([b]) if way is None else way


def _outline(made: StoreyGrid, place: str) -> shapely.Geometry | None:
    return next((r.outline for r in storey_view(made.scene).rooms if r.name == place), None)


def _start_point(
    found: Route, grids: dict[str, StoreyGrid], storey: str | None
) -> tuple[float, float]:
    """In the home region of the room, else in the room's middle."""
    if storey in grids:
        made = grids[str(storey)]
        outline = _outline(made, found.start)
        if outline is not None:
            regions = storey_view(made.scene).regions
            homes = [r.outline for r in regions if "home_region" in r.types]
            inside = [home for home in homes if home.intersects(outline)]
            point = (inside[0] if inside else outline).representative_point()
            return (point.x, point.y)
    return _xy(found.transitions[0].approach)


def _goal_point(
    made: StoreyGrid, place: str, target: str | None, near: tuple[float, float]
) -> tuple[float, float]:
    """Where a robot has room to stand: beside the target, else in the middle of the place."""
    outline = _outline(made, place)
    if outline is None:
        return near
    held = [
        (o.footprint, o.types)
        for o in shown_objects(storey_view(made.scene))
        if o.footprint is not None and outline.contains(o.footprint.centroid)
    ]
    wanted = [footprint for footprint, types in held if target in types]
    thing = min(wanted, key=lambda f: f.area, default=None)
    aim = (thing or outline).centroid
    free = (made.cells == 0) & area_cells(outline, made.grid)
    for footprint, types in held:
        if FLAT.isdisjoint(types):
            free &= ~area_cells(footprint, made.grid)
    clear = free & (np.asarray(distance_transform_edt(free)) * made.grid.resolution > 0.3)
    rows, columns = np.nonzero(clear if clear.any() else free)
    if not len(rows):
        return near
    x = made.grid.origin[0] + (columns + 0.5) * made.grid.resolution
    y = made.grid.origin[1] + (rows + 0.5) * made.grid.resolution
    distance = shapely.distance(thing or aim, shapely.points(x, y))
    i = int(np.argmin(distance + 0.05 * np.hypot(x - near[0], y - near[1])))
    return (float(x[i]), float(y[i]))
