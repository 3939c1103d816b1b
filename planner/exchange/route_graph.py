"""Route graphs for other software: approach poses, waypoints, and the moves between them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from planner.exchange.visibility_graph import CLEARANCE, corner_paths
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, PlaceConnector, Topology
from semmap.error import Error
from semmap.geometry.overlay import without

Outline: TypeAlias = Polygon | MultiPolygon

JAMB = 0.1  # metres by which a shut door reaches into the wall on each side of its opening


class ExchangeError(Error, ValueError):
    """A format cannot express a topology; the message says how to fix it."""


@dataclass(frozen=True)
class Cabin:
    """The cabin of an elevator from above: middle in the map's frame, metres, and yaw, radians.

    `width` is along its x axis, `depth` across, metres.
    """

    x: float
    y: float
    yaw: float
    width: float
    depth: float


@dataclass(frozen=True, eq=False)
class DrawnLane:
    """A lane of an Open-RMF building from one waypoint to another, by their names in the map.

    `properties` are those of its link: ``bidirectional``, ``orientation``, ``speed_limit``, ...
    """

    start: str
    end: str
    properties: Mapping[str, Any]


@dataclass(frozen=True)
class BuildingOutline:
    """Outlines of rooms in the map's frame, by place, cabins by elevator, and drawn lanes."""

    outlines: Mapping[str, Polygon | MultiPolygon] = field(default_factory=dict)
    cabins: Mapping[str, Cabin] = field(default_factory=dict)
    lanes: tuple[DrawnLane, ...] = ()


@dataclass(frozen=True)
class RouteNode:
    """An approach pose, or a point of a place: drawn, at a corner, or in the middle.

    An approach pose has its connector, the side (0 or 1) on which it is, and a heading, radians. A
    drawn point has the name of its region, and the parameters of Open-RMF, such as ``is_charger``.
    Names are unique.
    """

    name: str
    place: str
    storey: str
    point: tuple[float, float, float]  # metres, in the map's frame
    elevator: str | None = None
    connector: PlaceConnector | None = None
    side: int = 0
    yaw: float | None = None
    region: str | None = None
    params: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Move:
    """A move from one node to another, by index, in one direction.

    A walk is inside a place; a passage has its connector and the elevator into which it leads, a
    ride its elevator. The way through an opening in which something stands has a passage for each
    piece between its bends.
    """

    start: int
    end: int
    kind: Literal["walk", "passage", "ride"]
    seconds: float
    connector: PlaceConnector | None = None
    elevator: str | None = None


@dataclass(frozen=True)
class RouteGraph:
    """The nodes and moves of a routing graph, or of one storey of it."""

    nodes: tuple[RouteNode, ...]
    moves: tuple[Move, ...]

    @property
    def storeys(self) -> list[str]:
        """The names of the storeys that have nodes, in the order of the nodes."""
        return list(dict.fromkeys(node.storey for node in self.nodes))

    def busiest(self) -> tuple[str, int]:
        """The place with the most connectors, and how many it has."""
        counted = Counter(s.place for s in self.nodes if s.connector is not None)
        return counted.most_common(1)[0]


def route_graph(
    routing: RoutingGraph, *, storey: str | None = None, storeyless: str = "map"
) -> RouteGraph:
    """The approach poses of a routing graph, and the moves that its robot can make between them.

    Shortest paths over the moves are those of the routing graph. No move leads through `OUTSIDE`,
    which the map does not describe. One storey alone is without rides, which lead away from it;
    places without storey are on `storeyless`. Approach poses are where the robot stands for them:
    beside what is there. Raises ExchangeError for an unknown storey.
    """
    routing.look_into_cabins()
    topology = routing.topology
    nodes = [_approach_pose(routing, node, storeyless) for node in range(len(routing.poses))]
    kept = list(range(len(nodes)))
    if storey is not None:
        known = dict.fromkeys(p.storey or storeyless for p in topology.places.values())
        if storey not in known:
            raise ExchangeError(f"there is no storey {storey}; there are: {', '.join(known)}")
        kept = [n for n in kept if nodes[n].storey == storey]
    number = {node: i for i, node in enumerate(kept)}
    found = [nodes[n] for n in kept]
    bent: dict[tuple[int, tuple[float, float]], int] = {}  # nodes at bends, of each connector
    moves = []
    for edge, (tail, head) in enumerate(zip(routing.tails, routing.heads, strict=True)):
        start, end, seconds = int(tail), int(head), float(routing.seconds[edge])
        if start not in number or end not in number or math.isinf(seconds):
            continue
        a, b = number[start], number[end]
        if edge in routing.rides:
            moves.append(Move(a, b, "ride", seconds, elevator=routing.rides[edge]))
        elif edge < len(nodes):  # passages come first
            into = nodes[end].elevator if nodes[end].elevator != nodes[start].elevator else None
            over = []
            for bend in routing.bends(edge):
                if (edge // 2, bend) not in bent:
                    bent[edge // 2, bend] = len(found)
                    found.append(_bend(nodes[start], len(bent), bend))
                over.append(bent[edge // 2, bend])
            steps = list(pairwise([a, *over, b]))
            metres = [max(math.dist(found[i].point, found[j].point), 1e-6) for i, j in steps]
            moves += [
                Move(i, j, "passage", seconds * m / sum(metres), nodes[start].connector, into)
                for (i, j), m in zip(steps, metres, strict=True)
            ]
        elif nodes[start].place != OUTSIDE:
            moves.append(Move(a, b, "walk", seconds))
    return RouteGraph(tuple(found), tuple(moves))


PARAMS = {"charging_station": "is_charger", "parking_spot": "is_parking_spot"}
"""The parameter of Open-RMF that a type of region stands for."""


def with_waypoints(
    made: RouteGraph, topology: Topology, lanes: Sequence[DrawnLane], speed: float
) -> RouteGraph:
    """The graph with the waypoints of the map: points, chargers and parking spots.

    Each has its label as name, if that is unique or was its name, and is joined with the approach
    poses of its place; one with drawn lanes, with the nearest of them alone.
    """
    nodes, moves = list(made.nodes), list(made.moves)
    storeys, inside = set(made.storeys), _inside(made)
    laned = {name for lane in lanes for name in (lane.start, lane.end)}
    labels = Counter(region.label for region in topology.regions)
    names = {node.name for node in nodes}
    for region in topology.regions:
        place = topology.places[region.places[0]]
        params = {PARAMS[t]: True for t in region.types if t in PARAMS}
        if (region.outline.area > 0 and not params) or place.storey not in {*storeys, None}:
            continue
        here = inside.get(place.name, [])
        if not here and region.name not in laned:
            continue
        storey = place.storey or nodes[here[0]].storey
        point = region.outline.representative_point()
        # An import from Open-RMF renames a waypoint that has the name of a room.
        own = labels[region.label] == 1 or region.name == f"{region.label}-waypoint"
        name = region.label if own and region.label and region.label not in names else region.name
        given = {
            k: v for k, v in region.properties.items() if isinstance(v, bool | int | float | str)
        }
        number, at = len(nodes), (float(point.x), float(point.y), place.floor)
        about: dict[str, Any] = {"region": region.name, "params": params | given}
        nodes.append(RouteNode(str(name), place.name, storey, at, place.elevator, **about))
        names.add(str(name))
        near = sorted(here, key=lambda n: math.dist(nodes[n].point[:2], at[:2]))
        for n in near[:1] if region.name in laned and name != place.name else near:
            seconds = math.dist(nodes[n].point[:2], at[:2]) / speed
            moves += [Move(n, number, "walk", seconds), Move(number, n, "walk", seconds)]
    return RouteGraph(tuple(nodes), tuple(moves))


def with_middles(made: RouteGraph, outlines: Mapping[str, Outline], speed: float) -> RouteGraph:
    """The graph with one more waypoint in each place, named as it and joined with its doors.

    A place that has a waypoint of its name keeps that.
    """
    nodes, moves = list(made.nodes), list(made.moves)
    names = {node.name for node in nodes}
    for place, inside in _inside(made).items():
        numbers = [n for n in inside if nodes[n].connector is not None]
        if place in names or not numbers or nodes[numbers[0]].elevator is not None:
            continue
        points = np.array([nodes[n].point for n in numbers])
        outline = outlines.get(place)
        x, y = points[:, :2].mean(axis=0) if outline is None else middle_of(outline)
        z = float(points[0, 2])
        number = len(nodes)
        nodes.append(RouteNode(place, place, nodes[numbers[0]].storey, (float(x), float(y), z)))
        for n in numbers:
            seconds = math.dist(nodes[n].point, nodes[number].point) / speed
            moves += [Move(n, number, "walk", seconds), Move(number, n, "walk", seconds)]
    return RouteGraph(tuple(nodes), tuple(moves))


def _approach_pose(routing: RoutingGraph, node: int, storeyless: str) -> RouteNode:
    """The node on a side of a connector; outside, on the storey of the other side."""
    topology, connector, side = routing.topology, routing.connectors[node // 2], node % 2
    here, there = (topology.places[connector.places[s]] for s in (side, 1 - side))
    storey = here.storey or (there.storey if here.name == OUTSIDE else None) or storeyless
    name, pose = f"{connector.name}@{here.name}", routing.standing(node)
    return RouteNode(name, here.name, storey, pose[:3], here.elevator, connector, side, pose.yaw)


def _bend(start: RouteNode, number: int, at: tuple[float, float]) -> RouteNode:
    """A node where the passage from an approach pose bends."""
    assert start.connector is not None
    name = f"{start.connector.name}#{number}"
    return RouteNode(name, start.place, start.storey, (*at, start.point[2]))


def middle_of(outline: shapely.Geometry) -> tuple[float, float]:
    """The centroid of an outline, or else a point in it."""
    middle = outline.centroid
    if not outline.contains(middle):
        middle = outline.representative_point()
    return (middle.x, middle.y)


def around_corners(
    made: RouteGraph, outlines: Mapping[str, Outline], robot: RobotClass
) -> RouteGraph:
    """The graph with travel that keeps the robot's radius from walls, over waypoints at corners.

    Where a room is too narrow for the circumscribed radius, the inscribed radius is kept; a
    pair of nodes that no path with it joins has half of it, and so on. A pair that no path joins at
    all has no travel. A piece between corners takes its length at the robot's speed, or more if
    the travel over it does. Places without outline are not changed.
    """
    nodes = list(made.nodes)
    clearances = _clearances(robot)
    driven: dict[str, set[tuple[int, int]]] = {}
    for move in (m for m in made.moves if m.kind == "walk"):
        pair = (min(move.start, move.end), max(move.start, move.end))
        driven.setdefault(nodes[move.start].place, set()).add(pair)
    bent: dict[tuple[int, int], list[int] | None] = {}
    for place, joined in driven.items():
        if place not in outlines:
            continue
        numbers = sorted({n for pair in joined for n in pair})
        index = {n: i for i, n in enumerate(numbers)}
        pairs = sorted((index[a], index[b]) for a, b in joined)
        points = np.array([nodes[n].point[:2] for n in numbers])
        outline = without(outlines[place], _doors_inside(made, numbers))
        ways = corner_paths(outline, points, clearances, pairs)
        first, z = nodes[numbers[0]], nodes[numbers[0]].point[2]
        at = {}
        for corner, (x, y) in enumerate(ways.corners):
            at[corner] = len(nodes)
            name = f"{place}#{corner + 1}"
            nodes.append(RouteNode(name, place, first.storey, (float(x), float(y), z)))
        for i, j in pairs:
            way = ways.between.get((i, j))
            over = None if way is None else [at[c] for c in way]
            bent[numbers[i], numbers[j]] = over
            bent[numbers[j], numbers[i]] = None if over is None else over[::-1]
    moves = []
    legs: dict[tuple[int, int], float] = {}
    for move in made.moves:
        over = bent.get((move.start, move.end), []) if move.kind == "walk" else []
        if over is None:
            continue
        if not over:
            moves.append(move)
            continue
        steps = list(pairwise([move.start, *over, move.end]))
        metres = [math.dist(nodes[a].point, nodes[b].point) for a, b in steps]
        pace = max(move.seconds / sum(metres), 1 / robot.speed)
        for step, length in zip(steps, metres, strict=True):
            legs[step] = min(legs.get(step, math.inf), pace * length)
    moves += [Move(a, b, "walk", seconds) for (a, b), seconds in legs.items()]
    return RouteGraph(tuple(nodes), tuple(moves))


def _doors_inside(made: RouteGraph, numbers: list[int]) -> shapely.Geometry:
    """The doors in walls that stand free in a place, as if shut: only a passage leads through."""
    doors = [made.nodes[n].connector for n in numbers if made.nodes[n].side == 0]
    leaves = [door.leaf(JAMB) for door in doors if door and door.places[0] == door.places[1]]
    return shapely.union_all(leaves).buffer(0.01)


def _clearances(robot: RobotClass) -> list[float]:
    """The radii of a robot, the largest first."""
    if not robot.parts:
        return [CLEARANCE]
    radii = {max(p.circumscribed_radius for p in robot.parts)}
    radii.add(max(p.inscribed_radius for p in robot.parts))
    return sorted((float(r) for r in radii if r > 0), reverse=True) or [CLEARANCE]


def _inside(made: RouteGraph) -> dict[str, list[int]]:
    """The indices of the approach poses and drawn points of each place inside the building."""
    inside: dict[str, list[int]] = {}
    for number, node in enumerate(made.nodes):
        if node.place != OUTSIDE and (node.connector is not None or node.region is not None):
            inside.setdefault(node.place, []).append(number)
    return inside
