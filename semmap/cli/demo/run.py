"""The main job from end to end: a world in, Figure 3 answered, grids, a route and pictures out."""

from __future__ import annotations

import itertools
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from navgrid.grid_output import with_grid
from navgrid.map_file import folder_of
from navgrid.occupancy_grid import StoreyGrid
from planner.exchange.picture import topology_plan
from planner.readers.topology import read_topology
from planner.route import NoRouteError
from planner.route_lines import Line, route_lines
from planner.route_search import seconds_between
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Topology
from semmap import cli
from semmap.api.database import Database
from semmap.api.map import Map
from semmap.api.map_results import MapRoute
from semmap.cli.demo.choices import DemoChoices, choose, figure_3, read_choices
from semmap.cli.demo.costmaps import DemoRobot, robot_demo
from semmap.cli.demo.fields import field_demo
from semmap.cli.demo.sparql import ask_in_sparql
from semmap.cli.demo.task import search_demo, task_demo
from semmap.draw.floor_plan import floor_plan
from semmap.draw.scene3d import scene3d
from semmap.draw.view import StoreyView, storey_view

WORLD_FILES = ("*.world", "*.sdf", "*.building.yaml", "*.gpkg", "*.geojson")
MOST_ROOMS = 40
"""Number of rooms among which the longest route is searched."""

MOST_ROUTES = 40
"""Number of routes, the longest first, that are tried until one has room for the robot: a room that
furniture closes has the longest of all."""

Say = Callable[..., Any]


def run_demo(
    worlds: Sequence[Path],
    folder: Path,
    robot: DemoRobot,
    *,
    start: str | None = None,
    goal: str | None = None,
    model_path: Sequence[Path] = (),
    pixels: int = 2200,
    say: Say = print,
) -> list[Path]:
    """Import worlds into one map, ask it, write its grids, find a route, draw; the pictures made.

    The route is between rooms; by default from the robot's home to the room of the chosen object.
    """
    began = time.perf_counter()
    files = _files(worlds)
    with cli.open_database(migrate=True) as db:
        map_name = _map_name(db, files)
        say(f"\n1. {', '.join(f.name for f in files)} into the map {map_name}")
        say(f"   the database is ready: {time.perf_counter() - began:.1f} s")
        for file in files:
            cli.print_summary(db.import_file(file, map=map_name, model_path=model_path))
        house = db.map(map_name)
        if not house.rooms:
            _find_rooms(house, say)
        with house.snapshot() as seen:
            choices = choose(seen, read_choices(files[0].with_name("demo.yaml")))
            topology = read_topology(seen)
        _ask(house, choices, say)
        ask_in_sparql(house, choices, say)
        say("\n3. A Nav2 map of each storey")
        grids = {made.scene.storey: made for made in house.grids()}
        storeys = [storey_view(made.scene) for made in grids.values()]
        for made in grids.values():
            place = folder_of(made.scene.storey, folder, len(grids))
            written = made.write(place, picture=False)
            say(f"   {written['map']}: {written['width']} x {written['height']} cells")

        say("\n4. A route")
        found = _find_route(house, topology, start or choices.start, goal or choices.place)
        paths: dict[str, list[Line]] = {}
        if isinstance(found, str):
            say(f"   {found}")
        else:
            doors = ", ".join(s.connector.name for s in found.doors if s.connector is not None)
            say(f"   {found.start} -> {found.goal}: {doors or 'no door'} ({found.metres:.1f} m)")
            paths = route_lines(found, topology, grids, choices.type)

        say("\n5. A robot's costmaps (Figures 5, 6, 7 and 9)")
        pictures = robot_demo(house, folder, storeys, robot, say, min(pixels, 1800))

        say("\n6. What somebody sees (the query of reMap, section 4)")
        with house.snapshot() as seen:
            pictures += field_demo(seen, folder, say, pixels=min(pixels, 1400))

        say("\n7. A task (Figure 4), in a copy of the map")
        if choices.type is None:
            say("   there is no small object on a table to fetch, so the robot drives to a room")
        task_demo(
            house,
            replace(choices, start=start or choices.start),
            robot.robot_class("delivery"),
            folder,
            say,
            lambda copy: _ask(copy, choices, say, again=True),
        )
        say("\n8. A search, as if nobody had seen the object lately")
        begin = replace(choices, start=start or choices.start)
        pictures += search_demo(house, begin, storeys, folder, say)

        say("\n9. Pictures")
        for picture in _draw(map_name, folder, storeys, topology, grids, paths, pixels):
            pictures.append(picture)
            say(f"   {picture}")
        say("\n10. A QGIS project")
        say(f"   {house.write_qgis_project(folder / 'map.qgz')}")
        say("\n11. The map in the browser, with its changes as they come")
        say(f"   .venv/bin/semmap view --map {shlex.quote(map_name)}")
        say(f"\n{time.perf_counter() - began:.1f} s")
    return pictures


def _find_rooms(house: Map, say: Say) -> None:
    """Find rooms in the walls of a world that states none."""
    try:
        found = house.find_rooms(add=True)
    except ValueError as error:
        say(f"   no rooms: {error}")
        return
    rooms, doorways = (sum(len(getattr(f, k)) for f in found) for k in ("rooms", "doorways"))
    say(f"   the world has no rooms: {rooms} rooms and {doorways} doorways found in its walls")


def _ask(house: Map, choices: DemoChoices, say: Say, *, again: bool = False) -> None:
    """Ask which tables hold an object of the chosen type, as Figure 3 does."""
    if choices.type is None:
        if not again:
            say("\n2. Which tables hold a small object? (Figure 3)")
            say("   none: no object with a shape stands on a piece of furniture in a room")
        return
    table = choices.table_type.replace("_", " ")
    wanted = choices.type.replace("_", " ")
    article = "an" if wanted[0] in "aeiou" else "a"
    question = f"Which {table} holds {article} {wanted}"
    say(f"   {question} now? (Figure 3, again)" if again else f"\n2. {question}? (Figure 3)")
    rows = house.sql(figure_3(choices))
    cli.show_rows([*rows.columns], [*rows], False)


def _map_name(db: Database, files: Sequence[Path]) -> str:
    """The name of the first file, with a number where a map of other things has it."""
    stem = files[0].name.split(".")[0]
    sources = [str(file.resolve()) for file in files]
    for number in itertools.count(1):
        name = stem if number == 1 else f"{stem}_{number}"
        if name not in db.maps:
            return name
        ((own, others),) = db.map(name).sql(
            "SELECT count(*) FILTER (WHERE own), count(*) FILTER (WHERE NOT own) FROM entity "
            "CROSS JOIN LATERAL (SELECT source = ANY (%s)) s (own) WHERE map_id = current_map()",
            sources,
        )
        if own and not others:
            return name
    raise AssertionError("a number is free")


def _draw(
    map_name: str,
    folder: Path,
    storeys: Sequence[StoreyView],
    topology: Topology,
    grids: Mapping[str, StoreyGrid],
    paths: Mapping[str, list[Line]],
    pixels: int,
) -> Iterator[Path]:
    """Draw the topology and the plan of each storey, and all storeys in 3D, one after the other."""
    for storey in storeys:
        if topology.connectors:
            picture = folder_of(storey.name, folder, len(storeys)) / "topology.png"
            title = f"{map_name}, {storey.name}: which doors lead where"
            yield topology_plan(topology, storey, picture, title=title)
    shown = []
    for storey in storeys:
        view = replace(with_grid(grids[storey.name]), path=paths.get(storey.name, []))
        shown.append(view)
        place = folder_of(storey.name, folder, len(storeys))
        title = map_name if len(storeys) == 1 else f"{map_name}, {storey.name}"
        yield floor_plan(view, place / "plan.png", title=title, dpi=pixels // 12)
    if any(s.rooms for s in storeys):
        rooms, title = folder / "rooms.png", f"{map_name}: rooms and their boxes"
        yield scene3d(shown, rooms, cut=1.0, width=pixels, title=title)
    if any(s.objects or s.rooms for s in storeys):
        yield scene3d(
            [replace(s, path=[]) for s in shown],
            folder / "objects.png",
            width=pixels,
            title=f"{map_name}: what stands where",
            boxes=False,
            object_labels=True,
        )


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


def _find_route(
    house: Map, topology: Topology, start: str | None, goal: str | None
) -> MapRoute | str:
    """The route of a robot with a shape between two rooms; without them, a long one."""
    rooms = sorted(name for name in topology.places if name != OUTSIDE)
    if len(rooms) < 2 or not topology.connectors:
        return "none: the map has no rooms that doors join; annotate some (GeoJSON, GeoPackage)"
    graph = RoutingGraph(topology)
    starts = [start] if start is not None else rooms[:MOST_ROOMS]
    goals = [goal] if goal is not None and goal != start else rooms
    ends = [[*map(graph.endpoint, names)] for names in (starts, goals)]
    seconds = seconds_between(graph, *ends)
    longest = np.argsort(-np.where(np.isfinite(seconds), seconds, -1.0), axis=None)
    reason = "none: no two rooms are joined"
    tried: set[frozenset[str]] = set()
    for a, b in np.array(np.unravel_index(longest, seconds.shape)).T:
        pair = frozenset((starts[a], goals[b]))
        if len(pair) == 2 and pair not in tried and len(tried) < MOST_ROUTES:
            tried.add(pair)
            try:
                return house.route(starts[a], goals[b])
            except NoRouteError as error:
                reason = str(error)
    return reason
