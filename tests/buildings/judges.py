"""Judges of a map of a random building: each asks it, and says what disagrees with the truth.

None calls what it judges: rooms and cells are measured by Shapely, ways by networkx.
"""

from __future__ import annotations

import itertools
import math
import random
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import networkx as nx
import numpy as np
import shapely

import semmap
from semmap.database import Cluster
from tests.buildings.beliefs import judge_beliefs, undone
from tests.buildings.building import OUTSIDE, Building, Door, Item, room_of
from tests.buildings.clouds import cloud_cells, write_scans
from tests.buildings.faults import judge_faults
from tests.buildings.missions import judge_missions
from tests.buildings.plans import judge_plans
from tests.buildings.rooms import disagreements, said_rooms
from tests.buildings.ways import BODY, CELL, Ground, doors_of, things_across

Judge = Callable[[Building, semmap.Map], tuple[int, list[str]]]
"""Returns how many questions it asked, and a sentence for each wrong answer."""


@contextmanager
def stored(building: Building, url: str | Cluster, folder: Path) -> Iterator[semmap.Map]:
    """The map of a building, imported from its files."""
    with semmap.connect(url) as database:
        name = f"building{building.seed}"
        for path in [*building.write(folder), *write_scans(building, folder)]:
            database.import_file(path, map=name)
        yield database.map(name)


def things(building: Building) -> list[Item]:
    """What is no part of the building."""
    return [item for item in building.items if item.what == "thing"]


def judge_rooms(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """All ways say one room of each entity; of a thing, the one that Shapely says."""
    said = said_rooms(place)
    wrong = disagreements(said)
    for item in things(building):
        room, accepted = place[item.name].room, room_of(building, item)
        found = {room.name} if room else set()
        if found != said[item.name]["inventory"] or len(found) != 1 or not found <= accepted:
            wrong.append(f"{item.name} is in one of {accepted}, not {found}")
    return 7 * len(said), wrong


IN_FIELDS = "PREFIX : <urn:semmap:ontology#> SELECT ?what ?room { ?what :in ?room . ?room a :Room }"


def judge_rooms_of_fields(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Fields say the room of each thing as the inventory does, and as Shapely."""
    said = defaultdict(set)
    for name, room in place.fields.query(IN_FIELDS).rows:
        said[name].add(room)
    wrong = []
    for item in things(building):
        accepted, inventory = room_of(building, item), place[item.name].room
        if said[item.name] != {inventory and inventory.name} or not said[item.name] <= accepted:
            wrong.append(f"{item.name} is in {said[item.name]} of fields, not {inventory}")
    return len(things(building)), wrong


def judge_holders(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """What bears a thing holds it, else its room."""
    wrong = []
    for item in things(building):
        holder = place[item.name].holder
        said = holder.name if holder else None
        if said not in ({item.on} if item.on else room_of(building, item)):
            wrong.append(f"{item.name} is held by {said}, not {item.on or 'its room'}")
    return len(things(building)), wrong


def judge_grounds(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """The footprint of a mesh is its ground, and what is seen between two arms is in the room."""
    solids = [item for item in building.items if item.points is None]
    found = dict(
        place.sql(
            "SELECT e.name, ST_AsBinary(w.footprint) FROM entity e "
            "JOIN world w ON w.entity_id = e.id WHERE e.map_id = current_map()"
        )
    )
    wrong = []
    for item in solids:
        footprint = shapely.from_wkb(bytes(found[item.name]))
        beyond = footprint.symmetric_difference(item.ground).area
        if beyond > 1e-4:
            wrong.append(f"the footprint of {item.name} and its ground differ by {beyond:.4f} m2")
    between = [
        (item, table)
        for table in solids
        if table.shape is not None
        for item in things(building)
        if item.on is None and table.ground.convex_hull.contains(item.ground.centroid)
        if item is not table and abs(item.low - table.low) < 1e-3
    ]
    for item, table in between:
        height = random.Random(item.name).uniform(item.low, min(item.high, item.low + 0.3))
        with undone(place):
            said = place.observe_point(item.name, (*item.centre, height))["place"]
        if said not in room_of(building, item):
            wrong.append(f"{item.name} is seen between arms of {table.name}, and said in {said}")
    return len(solids) + len(between), wrong


PARTS = {"floor", "wall", "ceiling"}


def judge_parts(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Floors, walls and ceilings are recognised, and things are not taken for them."""
    types = dict(
        place.sql("SELECT name, type FROM entity WHERE kind = 'object' AND map_id = current_map()")
    )
    judged = [item for item in building.items if item.what in PARTS | {"thing"}]
    wrong = [
        f"{item.name} is a {item.what}, not of the type {types[item.name]}"
        for item in judged
        if (types[item.name] != item.what)
        if item.what in PARTS or types[item.name] in {*PARTS, "roof", "building_shell"}
    ]
    return len(judged), wrong


def judge_grids(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """A cell is occupied where the border of an obstacle meets it, and free where none does.

    Obstacles are things, walls, shut doors and the voxels of clouds.
    """
    wrong, asked = [], 0
    low, high = 0.05, 1.8
    for name, elevation, _ in building.storeys:
        made = place.grid(name)
        grounds = [
            item.ground
            for item in building.items
            if item.points is None
            if item.low < elevation + high - 1e-6 and item.high > elevation + low + 1e-6
        ]
        grounds += [
            shapely.LineString(door.ends).buffer(LEAF / 2, cap_style="flat")
            for door in building.doors
            if door.state != "open" and building.room(door.rooms[0]).storey == name
        ]
        rows, columns = np.indices(made.cells.shape)
        x, y = made.grid.origin
        size = made.grid.resolution
        slack = 1e-6
        squares = shapely.box(
            x + columns * size + slack,
            y + rows * size + slack,
            x + (columns + 1) * size - slack,
            y + (rows + 1) * size - slack,
        )
        tree = shapely.STRtree(squares.ravel())
        met = np.zeros(squares.size, dtype=bool)
        border = np.zeros(squares.size, dtype=bool)
        for ground in grounds:
            met[tree.query(ground.buffer(1e-5), predicate="intersects")] = True
            border[tree.query(ground.exterior, predicate="intersects")] = True
        for item in building.items:
            if item.points is not None:
                heights = (elevation + low, elevation + high)
                must, may = cloud_cells(item.points, heights, (x, y), size, made.cells.shape)
                border |= must.ravel()
                met |= may.ravel()
        cells = made.cells.ravel()
        missed, invented = border & (cells != 100), ~met & (cells == 100)
        asked += cells.size
        if missed.any() or invented.any():
            wrong.append(f"storey {name}: {missed.sum()} cells missed, {invented.sum()} invented")
    return asked, wrong


def judge_routes(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """A route leads where a disc surely gets, and none where its smaller one does not."""
    through = doors_of(building, None)
    sure, may = (_reached(building, sure=sure) for sure in (True, False))
    chance = random.Random(building.seed)
    names = [room.name for room in building.rooms]
    pairs = [tuple(chance.sample(names, 2)) for _ in range(6)] if len(names) > 1 else []
    lifts = [door.rooms for door in building.doors if door.type == "elevator_door"]
    pairs += [*lifts, *(rooms[::-1] for rooms in lifts)]
    for below, above in itertools.pairwise(lifts):
        pairs += zip(below, above, strict=True)
    wrong = []
    for start, goal in pairs:
        places, why = [], ""
        try:
            places = place.route(start, goal).places
        except ValueError as error:
            why = str(error)
        ends = (start, None), (None, goal)
        if not nx.has_path(sure, *ends) <= bool(places) <= nx.has_path(may, *ends):
            wrong.append(f"{start} to {goal}: {places or why}")
        elif places and not (
            places[0] == start
            and places[-1] == goal
            and all(itertools.starmap(through.has_edge, itertools.pairwise(places)))
        ):
            wrong.append(f"{start} to {goal}: {places} is no way through doors")
    return len(pairs), wrong


def judge_steps(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """The steps of routes name points where the robot fits, joined by ways of their lengths."""
    ground = Ground(building, BODY, sure=False)
    names = [room.name for room in building.rooms]
    pairs = [*itertools.permutations(names, 2)]
    random.Random(building.seed).shuffle(pairs)
    wrong, asked = [], 0
    for start, goal in pairs[:12]:
        try:
            route = place.route(start, goal)
        except ValueError:
            continue
        asked += 1
        at = None
        for step in route.steps:
            what = f"{start} to {goal}: {step.behaviour} in {step.from_place}"
            poses = [p for p in (step.approach, step.leave) if p is not None]
            if at not in (None, poses[0][:2]):
                wrong.append(f"{what} begins at {poses[0][:2]}, not at {at}")
            at = step.leave[:2]
            for room, pose in zip(
                (step.from_place, step.to_place)[-len(poses) :], poses, strict=True
            ):
                if not ground.fits(room, pose[:2]):
                    wrong.append(f"{what} names {pose[:2]} in {room}, where it does not fit")
            way = [poses[0][:2], *step.bends, step.leave[:2]]
            length = math.fsum(itertools.starmap(math.dist, itertools.pairwise(way)))
            passes = step.connector is not None and step.from_place != step.to_place
            if passes and step.connector.type == "door":
                if not ground.leads(step.from_place, way):
                    wrong.append(f"{what} leads through what stands at {step.connector.name}")
                if abs(step.metres - length) > 1e-6:
                    wrong.append(f"{what} is {length} m long, not {step.metres}")
            elif step.behaviour == "navigate" and step.approach and step.metres < length - 2 * CELL:
                wrong.append(f"{what} is {length} m or longer, not {step.metres}")
        if abs(math.fsum(step.metres for step in route.steps) - route.metres) > 1e-6:
            wrong.append(f"{start} to {goal}: {route.metres} m are not those of the steps")
    return max(asked, 1), wrong


def _reached(building: Building, *, sure: bool) -> nx.DiGraph:
    """Where its disc surely gets, or may, from a room, (name, None), to a room, (None, name).

    It surely starts at all doors of a room alone.
    """
    ground = Ground(building, BODY, sure=sure)
    graph = ground.graph.copy()
    for room in building.rooms:
        graph.add_nodes_from([(room.name, None), (None, room.name)])
        graph.add_edges_from(((room.name, None), (room.name, k)) for k in ground.starts(room.name))
        parts = range(len(ground.parts[room.name]))
        graph.add_edges_from(((room.name, k), (None, room.name)) for k in parts)
    return graph


def judge_check(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """`Map.check` finds in a sound building the doors that the assumed body cannot pass, alone."""
    found = [each for each in place.check() if each.severity != "note"]
    shut = {("narrow door", d.name) for d in building.doors if _is_small(d)}
    shut |= {("thing in a doorway", d.name) for d in building.doors if _is_shut(building, d)}
    stairs = [door for door in building.doors if door.climbs]
    shut |= {("thing on stairs", d.name) for d in stairs if things_across(building, d, BODY.width)}
    shut |= {("improbable height", d.name) for d in building.doors if (d.height or 9) < LOW}
    one_way = [{("one-way room", name) for name in names} for names in _one_way(building)]
    told = {(each.kind, each.entities[0]) for each in found}
    shut |= next((rooms for rooms in one_way if rooms <= told), one_way[0])
    apart = {frozenset(e.entities) for e in found if e.kind == "room without a door"}
    wrong = [
        str(each)
        for each in found
        if (each.kind, each.entities[0]) not in shut
        if each.kind != "room without a door"
        if not (each.kind == "penetrating" and _overlap(building, *each.entities))
    ]
    wrong += [f"{name}: no {kind}" for kind, name in shut - told]
    choices = [{*rooms} for rooms in _cut_off(building)]
    if apart not in choices:
        wrong += [f"cut off: {sorted(rooms)}" for rooms in apart ^ choices[0]]
    return len(building.items), wrong


def _cut_off(building: Building) -> list[list[frozenset[str]]]:
    """The rooms that doors, stairs and lifts do not join with the outside, else with most rooms.

    Several choices where several groups have most rooms.
    """
    graph = nx.Graph([door.rooms for door in building.doors])
    graph.add_nodes_from(room.name for room in building.rooms)
    nx.add_path(graph, [room.name for room in building.rooms if room.elevator is not None])
    apart = [frozenset(rooms) for rooms in nx.connected_components(graph)]
    sizes = [(OUTSIDE in rooms, len(rooms)) for rooms in apart]
    return [
        [rooms for rooms in apart if rooms is not most]
        for most, size in zip(apart, sizes, strict=True)
        if size == max(sizes)
    ]


def _one_way(building: Building) -> list[set[str]]:
    """The rooms that nobody enters, or that nobody leaves, by the choice of the largest circle."""
    graph, shaft = nx.DiGraph(), {room.name: "lift" for room in building.rooms if room.elevator}
    graph.add_nodes_from(shaft.get(room.name, room.name) for room in building.rooms)
    for door in building.doors:
        a, b = (shaft.get(name, name) for name in door.rooms)
        graph.add_edges_from([(a, b)] if door.direction != "backward" else [])
        graph.add_edges_from([(b, a)] if door.direction != "forward" else [])
    choices: list[set[str]] = [set()]
    for group in nx.weakly_connected_components(graph):
        circles = [*nx.strongly_connected_components(graph.subgraph(group))]
        most = max(map(len, circles))
        apart = [
            {r.name for r in building.rooms if shaft.get(r.name, r.name) in group - circle}
            for circle in circles
            if len(circle) == most
        ]
        choices = [known | more for known in choices for more in apart]
    return choices


def _overlap(building: Building, *names: str) -> bool:
    """Whether two things were placed at one place: they share more than a centimetre."""
    one, two = (item for item in building.items if item.name in names)
    shared = one.ground.intersection(two.ground)
    high = min(one.high, two.high) - max(one.low, two.low)
    return bool(high > 0.01 and not shared.buffer(-0.005).is_empty)


def _is_small(door: Door) -> bool:
    """Whether the opening of a door is narrower or lower than the assumed body."""
    low = door.height is not None and door.height < BODY.top
    return not door.climbs and (low or door.width < BODY.width)


def _is_shut(building: Building, door: Door) -> bool:
    """Whether things leave the assumed body no gap in the opening of a door."""
    if door.climbs:
        return False
    line = shapely.LineString(door.ends)
    strip = line.buffer(0.3, cap_style="flat")
    inside = building.room(next(room for room in door.rooms if room != OUTSIDE))
    free = line
    for item in building.items:
        low, high = item.low - inside.floor, item.high - inside.floor
        if item.points is None and low <= BODY.top and high >= 0.021:
            for part in shapely.get_parts(item.ground.intersection(strip)):
                along = [line.project(shapely.Point(at)) for at in shapely.get_coordinates(part)]
                if along and min(along) < max(along):
                    ends = line.interpolate([min(along), max(along)])
                    free = free.difference(shapely.LineString(ends).buffer(1e-4))
    return max((part.length for part in shapely.get_parts(free)), default=0.0) < BODY.width


LOW = 0.9
"""Metres below which the height of a door is improbable."""

LEAF = 0.05
"""Metres of the thickness of a door's leaf."""

JUDGES: tuple[Judge, ...] = (
    judge_rooms,
    judge_rooms_of_fields,
    judge_holders,
    judge_grounds,
    judge_parts,
    judge_grids,
    judge_routes,
    judge_steps,
    judge_check,
    judge_plans,
    judge_missions,
    judge_beliefs,
    judge_faults,
)
