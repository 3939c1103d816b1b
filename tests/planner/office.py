"""The topology of Figure 4 (Deeken et al.) as plain dataclasses."""

from __future__ import annotations

import math
from typing import Any

from planner.robot_class import RobotClass
from planner.route import Route
from planner.route_search import find_route
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose


def door(
    name: str, a: str, b: str, x: float, y: float, yaw: float, z: float = 0.0, **more: object
) -> PlaceConnector:
    """A door at (x, y) whose x axis points from place `a` to `b`; poses 0.7 m before it."""
    frame = Pose.planar(x, y, yaw, z)
    poses = (frame @ Pose.planar(-0.7, 0.0), frame @ Pose.planar(0.7, 0.0, math.pi))
    return PlaceConnector(name, (a, b), poses, **more)  # type: ignore[arg-type]


def office(**changed: dict[str, object]) -> Topology:
    """The building; ``door5={"state": "locked"}`` changes a connector."""
    east, north, south = 0.0, math.pi / 2, -math.pi / 2
    rows = [
        ("door1", "lab1", "corridor1", 2.0, 4.0, north, 0.0, {}),
        ("door2", "corridor1", "foyer-1st", 12.0, 5.0, east, 0.0, {}),
        ("edoor1", "foyer-1st", "elevator-1st", 16.0, 5.0, east, 0.0, {"type": "elevator_door"}),
        ("edoor3", "elevator-3rd", "foyer-3rd", 16.0, 5.0, math.pi, 6.4, {"type": "elevator_door"}),
        ("door5", "foyer-3rd", "corridor3", 12.0, 5.0, math.pi, 6.4, {}),
        ("door6", "corridor3", "office4", 9.0, 6.0, north, 6.4, {}),
        ("door7", "office4", "corridor3", 5.0, 6.0, south, 6.4, {}),
        ("door8", "corridor3", "lab2", 2.0, 4.0, south, 6.4, {}),
        ("exit", "foyer-1st", OUTSIDE, 14.0, 0.0, south, 0.0, {}),
        ("side_door", "lab1", OUTSIDE, 2.0, 0.0, south, 0.0, {}),
    ]
    connectors = [
        door(n, a, b, x, y, yaw, z, **{**more, **changed.get(n, {})})
        for n, a, b, x, y, yaw, z, more in rows
    ]
    places = [
        Place(name, storey="floor-3rd" if "3" in name else "floor-1st")
        for name in ("lab1", "corridor1", "foyer-1st", "foyer-3rd", "corridor3", "office4")
    ]
    places += [
        Place("lab2", storey="floor-3rd"),
        Place("elevator-1st", storey="floor-1st", elevator="elevator"),
        Place("elevator-3rd", storey="floor-3rd", elevator="elevator"),
    ]
    return Topology.of(places, connectors)


def route(
    topology: Topology,
    start: str,
    goal: str,
    *,
    start_pose: Pose | None = None,
    goal_pose: Pose | None = None,
    times: Any = None,
    walks: Any = None,
    allow_closed: bool = True,
    allow_locked: bool = False,
    allow_outside: bool = False,
    behaviours: Any = None,
) -> Route:
    """The route of a robot without a shape."""
    robot = RobotClass(
        opens=allow_closed,
        unlocks=allow_locked,
        outside=allow_outside,
        behaviours=None if behaviours is None else frozenset(behaviours),
    )
    graph = RoutingGraph(topology, robot, walks, durations=times)
    return find_route(graph, graph.endpoint(start, start_pose), graph.endpoint(goal, goal_pose))
