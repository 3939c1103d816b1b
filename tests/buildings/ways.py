"""Where robots get in a random building, by networkx and Shapely, from its own description.

A robot without a shape is stopped by doors alone. For one with a shape there are two answers. It
surely gets where a disc around all of it does, whatever it meets at any height. It may get where
the disc within its base does. Between the two, its shape decides, and no judge says.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import networkx as nx
import shapely

from tests.buildings.building import OUTSIDE, Building, Door, Item, Room

AHEAD = 0.6
"""Metres before a door at which a robot faces it."""

SNAP = 0.5
"""Metres within which a robot stands where it does not fit."""

CELL = 0.05
"""Metres of a cell of costmaps: what a disc and cells may differ by, in each direction."""


@dataclass(frozen=True)
class Body:
    """What a robot is: radii within its base and around all of it, width, heights, and reach."""

    inner: float
    outer: float
    width: float
    base: tuple[float, float]
    top: float
    step: float = 0.02
    reach: tuple[float, float] = (0.2, 0.8)


def refusal(door: Door, side: int, body: Body | None) -> str | None:
    """Why a robot that opens doors, but unlocks none, cannot pass from ``door.rooms[side]``."""
    if OUTSIDE in door.rooms:
        return "it leads out"
    if door.direction == ("backward", "forward")[side]:
        return "it leads the other way"
    if door.state == "locked" or door.permission:
        return "it is locked"
    if body is None:
        return None
    if door.climbs:
        return "it is too steep"
    if door.height is not None and door.height < body.top:
        return "it is too low"
    if door.width < body.width or door.step > body.step:
        return "it is too narrow, or its step too high"
    return None


def doors_of(building: Building, body: Body | None, opened: Collection[str] = ()) -> nx.DiGraph:
    """Rooms, and an edge for each way from one to another; as if some doors stood open."""
    graph = nx.DiGraph()
    graph.add_nodes_from(room.name for room in building.rooms)
    for door in building.doors:
        for side in (0, 1):
            free = door.name in opened and OUTSIDE not in door.rooms
            if free or refusal(door, side, body) is None:
                graph.add_edge(door.rooms[side], door.rooms[1 - side])
    for a, b in rides(building):
        graph.add_edge(a, b)
    return graph


def rides(building: Building) -> Iterator[tuple[str, str]]:
    """Each two cabins of the lift."""
    cabins = [room.name for room in building.rooms if room.elevator]
    yield from ((a, b) for a in cabins for b in cabins if a != b)


def stand(building: Building, door: Door, side: int) -> tuple[float, float, float]:
    """Where a robot faces a door in ``door.rooms[side]``."""
    room = door.rooms[side]
    if door.climbs:
        return (*door.ends[side], building.room(room).floor)
    inside = building.room(next(r for r in door.rooms if r != OUTSIDE))
    (ax, ay), (bx, by) = door.ends
    away = AHEAD / math.dist(*door.ends)
    spots = [
        ((ax + bx) / 2 - turn * (by - ay), (ay + by) / 2 + turn * (bx - ax))
        for turn in (away, -away)
    ]
    outline = building.room(room if room != OUTSIDE else inside.name).outline
    spots.sort(key=lambda at: outline.distance(shapely.Point(at)))
    return (*spots[0 if room != OUTSIDE else 1], inside.floor)


def seconds(
    building: Building,
    start: str | tuple[str, tuple[float, float]],
    goal: str | tuple[str, tuple[float, float]],
) -> float:
    """How long a robot without a shape takes at 1 m/s; a room is reached at any of its doors.

    A closed door is opened in 2 s, a lift called in 8 s; it rides in 7 s and 1 s for each metre.
    """
    graph = nx.DiGraph()
    ends = [(end, None) if isinstance(end, str) else end for end in (start, goal)]
    graph.add_nodes_from(["start", "goal"])
    inside: dict[str, list[tuple[str, int]]] = {}
    at = {}
    for door in building.doors:
        for side in (0, 1):
            at[door.name, side] = stand(building, door, side)
            inside.setdefault(door.rooms[side], []).append((door.name, side))
    cabins = {room.name for room in building.rooms if room.elevator}
    for door in building.doors:
        for side in (0, 1):
            if refusal(door, side, None) is None:
                here, there = (door.name, side), (door.name, 1 - side)
                took = math.dist(at[here], at[there])
                took += 2.0 * (door.state == "closed" and door.type != "elevator_door")
                took += 8.0 * (door.rooms[1 - side] in cabins)
                graph.add_edge(here, there, seconds=took)
    for room, nodes in inside.items():
        for a in nodes:
            for b in nodes if room != OUTSIDE else ():
                if a != b:
                    graph.add_edge(a, b, seconds=math.dist(at[a], at[b]))
    for a, b in rides(building):
        for p in inside.get(a, ()):
            for q in inside.get(b, ()):
                rise = 7.0 + abs(at[p][2] - at[q][2]) + math.dist(at[p][:2], at[q][:2])
                graph.add_edge(p, q, seconds=rise)
    for node in inside.get(ends[0][0], ()):
        graph.add_edge("start", node, seconds=_away(ends[0][1], at[node]))
    for node in inside.get(ends[1][0], ()):
        graph.add_edge(node, "goal", seconds=_away(ends[1][1], at[node]))
    if ends[0][0] == ends[1][0]:
        known = ends[0][1] is not None and ends[1][1] is not None
        direct = math.dist(ends[0][1], ends[1][1]) if known else 0.0  # type: ignore[arg-type]
        graph.add_edge("start", "goal", seconds=direct)
    try:
        return float(nx.dijkstra_path_length(graph, "start", "goal", weight="seconds"))
    except nx.NetworkXNoPath:
        return math.inf


def _away(point: tuple[float, float] | None, node: tuple[float, float, float]) -> float:
    return 0.0 if point is None else math.dist(point, node[:2])


class Ground:
    """The free floor of a building for the middle of a disc.

    Parameters
    ----------
    sure
        The disc around the robot, off all that is at any of its heights; else the one within its
        base, off what is at the heights of that.
    """

    def __init__(self, building: Building, body: Body, *, sure: bool) -> None:
        self.building, self.body, self.sure = building, body, sure
        self.radius = body.outer + 2 * CELL if sure else max(body.inner - CELL, 0.0)
        self.parts: dict[str, list[shapely.Polygon]] = {
            room.name: self._free(room.outline, room) for room in building.rooms
        }

    def _free(self, outline: shapely.Geometry, room: Room) -> list[shapely.Polygon]:
        left = outline.difference(self._obstacles[room.storey])
        return [part for part in shapely.get_parts(left) if part.area > 1e-6]

    @cached_property
    def _obstacles(self) -> dict[str, shapely.Geometry]:
        low, high = (0.0, self.body.top + CELL) if self.sure else self.body.base
        found = {}
        for storey, floor, _ in self.building.storeys:
            grounds = [
                item.ground.buffer(self.radius)
                for item in self.building.items
                if item.low < floor + high - 1e-3
                and item.high > floor + max(low, 0.0) + (1e-3 if self.sure else CELL)
            ]
            found[storey] = shapely.union_all(grounds)
        return found

    def near(self, room: str, point: tuple[float, float], snap: float = SNAP) -> set[int]:
        """The parts of a room, by number, in which a robot at a point is, or may be."""
        spot = shapely.Point(point)
        slack = 0.0 if self.sure else snap + 2 * CELL
        return {k for k, part in enumerate(self.parts[room]) if part.distance(spot) <= slack}

    def fits(self, room: str, point: tuple[float, float]) -> bool:
        """Whether a robot can be at a point of a room or its doorways, within two cells."""
        spot, place = shapely.Point(point), self.building.room(room)
        taken = self._obstacles[place.storey].buffer(-2 * CELL)
        return place.outline.distance(spot) <= WALL and not taken.contains(spot)

    def leads(self, room: str, way: Sequence[tuple[float, float]]) -> bool:
        """Whether a robot can go along a line on the storey of a room, within two cells."""
        taken = self._obstacles[self.building.room(room).storey].buffer(-2 * CELL)
        return bool(taken.intersection(shapely.LineString(way)).length < CELL / 2)

    @cached_property
    def graph(self) -> nx.DiGraph:
        """From part to part of rooms, (name, number), through doors and by lift."""
        graph = nx.DiGraph()
        for room, parts in self.parts.items():
            graph.add_nodes_from((room, k) for k in range(len(parts)))
        for door in self.building.doors:
            if door.climbs or OUTSIDE in door.rooms:
                continue
            for side in (0, 1):
                if refusal(door, side, self.body) is None:
                    graph.add_edges_from(self._through(door, side))
        lifts = {c: self._before_lift(c) for c in self.parts if self.building.room(c).elevator}
        for a, b in rides(self.building):
            graph.add_edges_from(((a, i), (b, j)) for i in lifts[a] for j in lifts[b])
        return graph

    def _before_lift(self, cabin: str) -> set[int]:
        (door,) = (d for d in self.building.doors if cabin in d.rooms)
        return self.near(cabin, stand(self.building, door, door.rooms.index(cabin))[:2])

    def _through(self, door: Door, side: int) -> Iterator[tuple[tuple[str, int], tuple[str, int]]]:
        a, b = door.rooms[side], door.rooms[1 - side]
        here, there = (stand(self.building, door, s)[:2] for s in (side, 1 - side))
        room = self.building.room(a)
        if self.sure:  # straight through
            way = shapely.LineString([here, there])
            if way.intersects(self._obstacles[room.storey]):
                return
        else:
            # Around what stands in the opening, but not through it.
            gap = shapely.LineString(door.ends).buffer(WALL, cap_style="flat")
            hall = self.building.room(b).outline.union(room.outline).union(gap)
            free = hall.difference(self._obstacles[room.storey])
            pieces = shapely.get_parts(free)
        for i in self.near(a, here):
            for j in self.near(b, there):
                one, two = self.parts[a][i], self.parts[b][j]
                if self.sure or any(p.intersects(one) and p.intersects(two) for p in pieces):
                    yield (a, i), (b, j)

    def reaching(self, item: Item, room: str) -> set[int]:
        """The parts of a room from which a robot reaches a thing."""
        near, far = self.body.reach
        slack = 2 * CELL if self.sure else -2 * CELL
        ring = item.ground.buffer(far - slack)
        if near + slack > 0:
            ring = ring.difference(item.ground.buffer(near + slack))
        if self.sure:
            lines = [shapely.LineString(d.ends) for d in self.building.doors if room in d.rooms]
            ring = ring.difference(shapely.union_all(lines).buffer(self.radius))
        least = (4 * CELL) ** 2 if self.sure else 0.0
        return {
            k for k, part in enumerate(self.parts[room]) if part.intersection(ring).area > least
        }

    def starts(self, room: str) -> set[int]:
        """The parts of a room in which a robot is that is somewhere in it: at one of its doors."""
        if not self.sure:
            return set(range(len(self.parts[room])))
        found: set[int] = set()
        for door in self.building.doors:
            if room in door.rooms and not door.climbs:
                at = stand(self.building, door, door.rooms.index(room))
                found |= self.near(room, at[:2])
        return found


WALL = 0.4
"""Metres on either side of the middle of a wall that an opening is deep, at most."""
