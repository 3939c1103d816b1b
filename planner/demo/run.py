"""The main job from end to end: a world in, Figure 3 answered, grids, a route and pictures out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navgrid.area import area_cells
from navgrid.grid_output import with_grid, write_grid
from navgrid.map_file import file_name
from navgrid.occupancy_grid import StoreyGrid, storey_grid
from planner.demo.costmaps import robot_demo
from planner.demo.fields import field_demo
from planner.demo.grid_path import grid_path
from planner.demo.office import office_files
from planner.demo.task import put_back, task_demo
from planner.exchange.picture import topology_plan
from planner.readers.topology import read_topology
from planner.route import NoRouteError, Route
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Topology
from semmap import cli
from semmap.draw.floor_plan import floor_plan
from semmap.draw.scene3d import scene3d
from semmap.draw.view import StoreyView, storey_view
from semmap.geometry.pose import Pose
from semmap.ingest.importer import import_file
from semmap.query.sql_statement import run_sql
from semmap.query.storey_reader import read_storeys

__all__ = ["FIGURE_3", "run_demo"]

FIGURE_3 = (
    "SELECT ob_a.label, ob_b.label, Box3D(ST_Collect(face.triangle)) "
    "FROM object ob_a, inventory inv_ab, object ob_b, inventory inv_bc, object ob_c, face, "
    "fa_to_ob "
    "WHERE ob_a.type = 'room' AND inv_ab.inv_id = ob_a.inv_id AND ob_b.id = inv_ab.ob_id "
    "AND ob_b.type = 'table' AND inv_bc.inv_id = ob_b.inv_id AND ob_c.id = inv_bc.ob_id "
    "AND ob_c.type = 'muffin' AND fa_to_ob.ob_id = ob_b.id AND face.id = fa_to_ob.face_id "
    "GROUP BY ob_a.label, ob_b.label"
)
"""Tables that hold a muffin, their rooms and their boxes, as Deeken et al. print it in Figure 3."""

WORLD_FILES = ("*.world", "*.sdf", "*.building.yaml", "*.gpkg", "*.geojson")
INTERVAL = (0.05, 1.8)
Say = Callable[..., Any]
Line = NDArray[np.float64]


def run_demo(
    worlds: Sequence[Path],
    folder: Path,
    *,
    start: str | None = None,
    goal: str | None = None,
    pixels: int = 2200,
    say: Say = print,
) -> list[Path]:
    """Import worlds into one map, ask it, write its grids, find a route, draw; the pictures made.

    `start` and `goal` are rooms; by default the robot's home, and where Figure 3 finds a muffin.
    `pixels` is the width of the pictures.
    """
    began = time.perf_counter()
    files = _files(worlds) or office_files()
    ours = not worlds
    map_name = "office" if ours else files[0].name.split(".")[0]

    say(f"\n1. {', '.join(f.name for f in files)} into the map {map_name}")
    with cli.database(migrate=True) as engine:
        for file in files:
            cli.print_summary(import_file(engine, file, map_name=map_name))
    if ours:
        put_back(map_name)  # one who ran this before may have stopped halfway

    with cli.open_map(map_name) as connection:
        say("\n2. Which tables hold a muffin? (Figure 3)")
        columns, rows = run_sql(connection, FIGURE_3, write=False)
        scenes = read_storeys(connection)
        topology = read_topology(connection)
    storeys = [storey_view(scene) for scene in scenes]
    muffins = [(str(room), str(table)) for room, table, _ in rows]
    if rows:
        cli.show_rows(columns, rows, False)
    else:
        say("   none")

    say("\n3. A Nav2 map of each storey")
    grids: dict[str, StoreyGrid] = {}
    for storey, scene in zip(storeys, scenes, strict=True):
        made = storey_grid(scene, INTERVAL)
        grids[storey.name] = made
        written = write_grid(made, _place(folder, storeys, storey), INTERVAL, picture=False)
        say(f"   {written['map']}: {written['width']} x {written['height']} cells")

    say("\n4. A route")
    found = _find_route(topology, storeys, start, goal, muffins)
    paths: dict[str, list[Line]] = {}
    if isinstance(found, str):
        say(f"   {found}")
    else:
        doors = ", ".join(s.connector.name for s in found.doors if s.connector is not None)
        say(f"   {found.start} -> {found.goal}: {doors or 'no door'} ({found.metres:.1f} m)")
        target = next((table for room, table in muffins if room == found.goal), None)
        paths = _paths(found, topology, grids, target)

    say("\n5. A robot's costmaps (Figures 5, 6, 7 and 9)")
    pictures = robot_demo(map_name, folder, storeys, say)

    say("\n6. What somebody sees (the query of reMap, section 4)")
    with cli.open_map(map_name) as connection:
        pictures += field_demo(connection, folder, say)

    if ours:
        say("\n7. A task: fetch a muffin and put it on desk1 (Figure 4)")
        task_demo(map_name, folder, say)
        say("   Which tables hold a muffin now? (Figure 3, again)")
        with cli.open_map(map_name) as connection:
            cli.show_rows(*run_sql(connection, FIGURE_3, write=False), False)
        if put_back(map_name):
            say("   Back to desk4 with it, as the example has it")

    say("\n8. Pictures" if ours else "\n7. Pictures")
    shown = []
    for storey in storeys:
        if topology.connectors:
            picture = _place(folder, storeys, storey) / "topology.png"
            title = f"{map_name}, {storey.name}: which doors lead where"
            pictures.append(topology_plan(topology, storey, picture, title=title))
            say(f"   {pictures[-1]}")
    for storey in storeys:
        view = replace(with_grid(grids[storey.name]), path=paths.get(storey.name, []))
        shown.append(view)
        place = _place(folder, storeys, storey)
        title = map_name if len(storeys) == 1 else f"{map_name}, {storey.name}"
        pictures.append(floor_plan(view, place / "plan.png", title=title, dpi=pixels // 12))
        say(f"   {pictures[-1]}")
    if any(s.objects for s in storeys) or any(s.rooms for s in storeys):
        if any(s.rooms for s in storeys):
            pictures.append(
                scene3d(
                    shown,
                    folder / "rooms.png",
                    cut=1.0,
                    width=pixels,
                    title=f"{map_name}: rooms and their boxes",
                )
            )
            say(f"   {pictures[-1]}")
        pictures.append(
            scene3d(
                [replace(s, path=[]) for s in shown],
                folder / "objects.png",
                width=pixels,
                title=f"{map_name}: what stands where",
                boxes=False,
                object_labels=True,
            )
        )
        say(f"   {pictures[-1]}")
    say(f"\n{time.perf_counter() - began:.1f} s")
    return pictures


def _files(worlds: Sequence[Path]) -> list[Path]:
    """The world files that are named, or lie in a folder that is named."""
    files: list[Path] = []
    for world in worlds:
        if world.is_dir():
            inside = [f for pattern in WORLD_FILES for f in sorted(world.rglob(pattern))]
            if not inside:
                raise LookupError(f"{world}: no world in it; it takes {', '.join(WORLD_FILES)}")
            files += inside
        else:
            files.append(world)
    return files


def _place(folder: Path, storeys: Sequence[StoreyView], storey: StoreyView) -> Path:
    return folder if len(storeys) == 1 else folder / file_name(storey.name)


def _find_route(
    topology: Topology,
    storeys: Sequence[StoreyView],
    start: str | None,
    goal: str | None,
    muffins: Sequence[tuple[str, str]],
) -> Route | str:
    """The route asked for; else from the home region to a muffin; else the longest there is."""
    rooms = sorted(name for name in topology.places if name != OUTSIDE)
    if len(rooms) < 2 or not topology.connectors:
        return "none: the map has no rooms that doors join; annotate some (GeoJSON, GeoPackage)"
    start = start or _home(storeys)
    goal = goal or next((room for room, _ in muffins if room != start), None)
    graph = RoutingGraph(topology)
    if start is not None and goal is not None:
        try:
            return find_route(graph, graph.endpoint(start), graph.endpoint(goal))
        except NoRouteError as error:
            return str(error)
    best: Route | None = None
    for a in [start] if start else rooms[:40]:
        for b in [goal] if goal else rooms:
            try:
                found = find_route(graph, graph.endpoint(a), graph.endpoint(b))
            except NoRouteError:
                continue
            if best is None or found.metres > best.metres:
                best = found
    return best or "none: no two rooms are joined"


def _home(storeys: Sequence[StoreyView]) -> str | None:
    for storey in storeys:
        for region in storey.regions:
            if "home_region" in region.types:
                point = region.outline.representative_point()
                for room in storey.rooms:
                    if room.outline.contains(point):
                        return room.name
    return None


def _paths(
    found: Route, topology: Topology, grids: dict[str, StoreyGrid], target: str | None
) -> dict[str, list[Line]]:
    """The metres of a route, storey by storey: through doors straight, in rooms on the grid."""
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
    wanted = [
        o.footprint
        for o in held
        if o.footprint is not None and ("muffin" in o.types or o.name == target)
    ]
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
