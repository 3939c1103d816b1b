"""Where robots get in a random building, by networkx and Shapely, from its own description.

There are two answers. A robot surely gets where a disc around all of it does, whatever it meets at
any height. It may get where the disc within its base does. Between the two, its shape decides, and
no judge says.
"""

from __future__ import annotations

import itertools
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
    """What a robot is: radii within its base and around all of it, width, heights, and reach.

    No stairs are too steep for one that is only `assumed`, and no threshold is too high.
    """

    inner: float
    outer: float
    width: float
    base: tuple[float, float]
    top: float
    step: float = 0.02
    reach: tuple[float, float] = (0.2, 0.8)
    assumed: bool = False


BODY = Body(0.3, 0.3, 0.6, (0.0, 1.5), 1.5, assumed=True)
"""The robot of which nothing is known."""


def refusal(building: Building, door: Door, side: int, body: Body | None) -> str | None:
    """Why a robot that opens doors, but unlocks none, cannot pass from ``door.rooms[side]``."""
    if OUTSIDE in door.rooms:
        return "it leads out"
    if door.direction == ("backward", "forward")[side]:
        return "it leads the other way"
    if door.state == "locked" or door.permission:
        return "it is locked"
    if body is None:
        return None
    if door.climbs and things_across(building, door, body.width):
        return "things stand on it"
    if door.climbs:
        return None if body.assumed else "it is too steep"
    if door.height is not None and door.height < body.top:
        return "it is too low"
    if door.width < body.width or (door.step > body.step and not body.assumed):
        return "it is too narrow, or its step too high"
    return None


STAIRS = 0.9
"""Metres of the width of stairs: the buildings state none."""


def things_across(building: Building, stairs: Door, width: float) -> list[str]:
    """The names of things that leave a disc no way over stairs, whichever way around them.

    They are a chain from side to side, whose gaps are all narrower than the disc. Stairs that rise
    by more than their length turn, and no judge knows where.
    """
    line = shapely.LineString(stairs.ends)
    low, high = (building.room(room).floor for room in stairs.rooms)
    if line.length < high - low:
        return []
    strip = line.buffer(STAIRS / 2, cap_style="flat")
    sides = {turn: line.offset_curve(turn * STAIRS / 2) for turn in (-1, 1)}
    graph: nx.Graph = nx.Graph()
    graph.add_nodes_from(sides)
    grounds: dict[object, shapely.Geometry] = dict(sides)
    for item in building.items:
        if item.what not in ("thing", "stub") or not item.ground.intersects(strip):
            continue
        ground = item.ground.intersection(strip)
        spots = line.project(shapely.points(shapely.get_coordinates(ground))).tolist()
        first, last = (low + (high - low) * f(spots) / line.length for f in (min, max))
        if item.low < last + BODY.top and (item.low >= first - 0.4 or item.high > last + 0.02):
            grounds[item.name] = ground
    for (one, a), (two, b) in itertools.combinations(grounds.items(), 2):
        if {one, two} != {*sides} and a.distance(b) < width:
            graph.add_edge(one, two)
    if not nx.has_path(graph, *sides):
        return []
    return [str(name) for name in nx.node_connected_component(graph, 1) if name not in sides]


def doors_of(building: Building, body: Body | None, opened: Collection[str] = ()) -> nx.DiGraph:
    """Rooms, and an edge for each way from one to another; as if some doors stood open."""
    graph = nx.DiGraph()
    graph.add_nodes_from(room.name for room in building.rooms)
    for door in building.doors:
        for side in (0, 1):
            free = door.name in opened and OUTSIDE not in door.rooms
            if free or refusal(building, door, side, body) is None:
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
            for side in (0, 1):
                if refusal(self.building, door, side, self.body) is None:
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
        if door.climbs:
            ends = self.near(a, here), self.near(b, there)
            yield from (((a, i), (b, j)) for i in ends[0] for j in ends[1])
            return
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
