"""From a path in the routing graph to steps of the robot (Deeken et al., 4.1 and Figure 4)."""

from __future__ import annotations

from collections.abc import Iterator

from navgrid.map_file import file_name
from navgrid.nav2 import frame_name
from planner.route import RouteStep
from planner.routing_graph import Edges, Endpoint, RoutingGraph
from planner.topology import PlaceConnector
from semmap.geometry.pose import Pose


def steps_along(
    graph: RoutingGraph,
    start: Endpoint,
    goal: Endpoint,
    edges: Edges,
    ends: tuple[int, int] | None,
    inside: tuple[float, float],
) -> tuple[RouteStep, ...]:
    """The steps that lead from one endpoint to another along edges of the graph, in order.

    `ends` are the indices of the path's first approach pose among those of the start, and of its
    last among those of the goal. They are None if the route visits none: then it takes the seconds
    and metres `inside` the place.
    """
    if ends is None:
        if goal.pose is None:
            return ()
        here = start.place
        return (make_step(graph, "navigate", here, here, start.pose, goal.pose, *inside),)
    return tuple(_along(graph, start, goal, edges, ends))


def _along(
    graph: RoutingGraph, start: Endpoint, goal: Endpoint, edges: Edges, ends: tuple[int, int]
) -> Iterator[RouteStep]:
    here, at = start.place, start.pose
    # Seconds and metres of a drive whose end is known only with the next edge.
    pending = (float(start.seconds[ends[0]]), float(start.metres[ends[0]]))
    for edge in edges:
        a, b = int(graph.tails[edge]), int(graph.heads[edge])
        takes = float(graph.seconds[edge]), float(graph.metres[edge])
        if edge in graph.rides:
            before = turned_around(graph.poses[a])
            if at != before:
                yield make_step(graph, "navigate", here, here, at, before, *pending)
                at, pending = before, (0.0, 0.0)
            there, behind = graph.place_of[b], graph.poses[b]
            yield make_step(
                graph, "use_elevator", here, there, at, behind, *takes, elevator=graph.rides[edge]
            )
            here, at = there, behind
            yield make_step(graph, "switch_map", here, here, at, at)
        elif edge >= 2 * len(graph.connectors):
            pending = (pending[0] + takes[0], pending[1] + takes[1])
        else:
            if at != graph.poses[a]:
                yield make_step(graph, "navigate", here, here, at, graph.poses[a], *pending)
            pending = (0.0, 0.0)
            there, behind = graph.place_of[b], turned_around(graph.poses[b])
            yield from passage_steps(graph, int(edge), graph.poses[a], behind, takes[1])
            storeys = [graph.topology.places[p].storey for p in (here, there)]
            if None not in storeys and storeys[0] != storeys[1]:
                yield make_step(graph, "switch_map", there, there, behind, behind)
            here, at = there, behind
    if goal.pose is not None:
        last = float(goal.seconds[ends[1]]), float(goal.metres[ends[1]])
        pending = (pending[0] + last[0], pending[1] + last[1])
        yield make_step(graph, "navigate", here, here, at, goal.pose, *pending)


def passage_steps(
    graph: RoutingGraph,
    node: int,
    approach: Pose,
    leave: Pose,
    metres: float,
    seconds: float | None = None,
) -> Iterator[RouteStep]:
    """The steps from an approach pose to the other side of its connector.

    Together they take `seconds`; by default, the passage takes what it takes such robots.
    """
    connector, durations = graph.connectors[node // 2], graph.durations
    here, there = graph.place_of[node], graph.place_of[node ^ 1]
    elevator = graph.elevator_to_call(node)
    calling, opening = 0.0, durations.of_opening(connector)
    waiting = here, here, approach, approach
    if elevator is not None:
        calling = durations.of_calling(elevator)
        yield make_step(
            graph, "call_elevator", *waiting, calling, connector=connector, elevator=elevator
        )
    if connector.must_be_opened:
        name = "open_door" if connector.state == "closed" else "unlock_door"
        yield make_step(graph, name, *waiting, opening, connector=connector)
    behaviour = connector.behaviour
    if behaviour == "call_elevator":  # it was called by now: what is left is to drive through
        behaviour = "pass_door"
    passing = durations.of_passing(connector, graph.robot.speed)
    if seconds is not None:
        passing = max(seconds - calling - opening, 0.0)
    yield make_step(
        graph, behaviour, here, there, approach, leave, passing, metres, connector=connector
    )


def make_step(
    graph: RoutingGraph,
    behaviour: str,
    here: str,
    there: str,
    approach: Pose | None,
    leave: Pose,
    seconds: float = 0.0,
    metres: float = 0.0,
    *,
    connector: PlaceConnector | None = None,
    elevator: str | None = None,
) -> RouteStep:
    """A step from one place to another, with the frame and the map to drive on."""
    storey = graph.topology.places[here].storey
    frame = "map" if storey is None else frame_name(storey)
    file = "master.yaml" if graph.robot.parts else "map.yaml"
    if storey is not None and graph.has_several_storeys:
        file = f"{file_name(storey)}/{file}"
    ends = here, there, connector, elevator, approach, leave
    return RouteStep(behaviour, *ends, seconds, metres, frame, file)


def turned_around(pose: Pose) -> Pose:
    """The pose turned by 180 degrees about its own z axis; its quaternion has w >= 0."""
    back = pose @ Pose(qz=1.0, qw=0.0)
    if back.qw >= 0:
        return back
    return Pose(back.x, back.y, back.z, -back.qx, -back.qy, -back.qz, -back.qw)
