"""The line of a route on the floor plans: straight through doors, in rooms on the grid."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navgrid.area import area_cells
from navgrid.occupancy_grid import StoreyGrid
from planner.grid_path import grid_path
from planner.route import Route
from planner.topology import Topology
from semmap.draw.view import storey_view
from semmap.geometry.pose import Pose

Line = NDArray[np.float64]


def route_lines(
    found: Route, topology: Topology, grids: dict[str, StoreyGrid], target: str | None
) -> dict[str, list[Line]]:
    """The points (N, 2) of a route, metres, by storey.

    With `target`, a type of objects, it ends beside the smallest one in its last room.
    """
    pieces: dict[str, list[Line]] = {}
    only = next(iter(grids)) if len(grids) == 1 else None

    def storey_of(place: str) -> str | None:
        return only or topology.places[place].storey

    at = _start_point(found, grids, storey_of(found.start))
    place, line = found.start, [np.array([at])]
    for step in found.transitions:
        storey = storey_of(place)
        if step.behaviour == "use_elevator":
            if storey in grids:
                pieces.setdefault(str(storey), []).append(np.concatenate(line))
            at = (step.leave.x, step.leave.y)
            place, line = step.to_place, [np.array([at])]
            continue
        line.append(_walk(grids.get(str(storey)), place, at, _xy(step.approach)))
        line.append(np.array([_xy(step.leave)]))
        at, place = _xy(step.leave), step.to_place
    storey = storey_of(place)
    if storey in grids:
        end = _goal_point(grids[str(storey)], found.goal, target, at)
        line.append(_walk(grids[str(storey)], place, at, end))
        pieces.setdefault(str(storey), []).append(np.concatenate(line))
    return pieces


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
    room = next((r for r in storey_view(made.scene).rooms if r.name == place), None)
    if room is not None:
        cells[~area_cells(room.outline, made.grid)] = 100
    way = grid_path(made.grid, cells, a, b)
    return np.array([b]) if way is None else way


def _start_point(
    found: Route, grids: dict[str, StoreyGrid], storey: str | None
) -> tuple[float, float]:
    """In the home region of the room, else in the room's middle."""
    if storey in grids:
        view = storey_view(grids[str(storey)].scene)
        outline = next((r.outline for r in view.rooms if r.name == found.start), None)
        if outline is not None:
            inside = [
                r.outline
                for r in view.regions
                if "home_region" in r.types and r.outline.intersects(outline)
            ]
            point = (inside[0] if inside else outline).representative_point()
            return (point.x, point.y)
    return _xy(found.transitions[0].approach)


def _goal_point(
    made: StoreyGrid, place: str, target: str | None, near: tuple[float, float]
) -> tuple[float, float]:
    """Where a robot has room to stand: beside the target, else in the middle of the place."""
    room = next((r for r in storey_view(made.scene).rooms if r.name == place), None)
    if room is None:
        return near
    held = [
        o
        for o in storey_view(made.scene).objects
        if o.footprint is not None and room.outline.contains(o.footprint.centroid)
    ]
    wanted = [o.footprint for o in held if o.footprint is not None and target in o.types]
    thing = min(wanted, key=lambda f: f.area, default=None)
    aim = (thing or room.outline).centroid
    free = (made.cells == 0) & area_cells(room.outline, made.grid)
    for other in held:
        if other.footprint is not None and "carpet" not in other.types:
            free &= ~area_cells(other.footprint, made.grid)
    clear = free & (np.asarray(distance_transform_edt(free)) * made.grid.resolution > 0.3)
    rows, columns = np.nonzero(clear if clear.any() else free)
    if not len(rows):
        return (aim.x, aim.y)
    x = made.grid.origin[0] + (columns + 0.5) * made.grid.resolution
    y = made.grid.origin[1] + (rows + 0.5) * made.grid.resolution
    distance = shapely.distance(thing or aim, shapely.points(x, y))
    i = int(np.argmin(distance + 0.05 * np.hypot(x - near[0], y - near[1])))
    return (float(x[i]), float(y[i]))
