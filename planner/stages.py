"""A way along edges as what a robot does on it (Deeken et al., section 4.1 and Figure 4)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from navgrid.map_file import file_name
from navgrid.nav2 import frame_name
from planner.route import Step
from planner.topology import Connector
from semmap.geometry.pose import Pose

if TYPE_CHECKING:
    from planner.network import Edges, Network, Site

__all__ = ["stages", "turned"]


def stages(
    network: Network,
    start: Site,
    goal: Site,
    edges: Edges,
    seconds: float,
    metres: float,
    ends: tuple[int, int] | None,
) -> tuple[Step, ...]:
    """What leads from a site to another along edges.

    Parameters
    ----------
    seconds, metres : of the walk from pose to pose, where both are in one place
    ends : which of the start's nodes the way begins with, and which of the goal's it ends with;
        None where it leads past no stand
    """
    return tuple(_Stages(network).along(start, goal, edges, (seconds, metres), ends))


class _Stages:
    def __init__(self, network: Network) -> None:
        self.network = network
        self.several_storeys = len(network.topology.storeys()) > 1

    def along(
        self,
        start: Site,
        goal: Site,
        edges: Edges,
        inside: tuple[float, float],
        ends: tuple[int, int] | None,
    ) -> Iterator[Step]:
        network = self.network
        here, at = start.place, start.pose
        if ends is None:
            if goal.pose is not None:
                yield self.step("navigate", here, here, at, goal.pose, *inside)
            return
        # a walk that is not yet told: its end is known with the next edge
        waiting = (float(start.seconds[ends[0]]), float(start.metres[ends[0]]))
        for edge in edges:
            a, b = int(network.tails[edge]), int(network.heads[edge])
            takes = float(network.seconds[edge]), float(network.metres[edge])
            if edge in network.rides:
                before = turned(network.stands[a])
                if at != before:
                    yield self.step("navigate", here, here, at, before, *waiting)
                    at, waiting = before, (0.0, 0.0)
                there, behind = network.place_of[b], network.stands[b]
                yield self.step(
                    "use_elevator", here, there, at, behind, *takes, elevator=network.rides[edge]
                )
                here, at = there, behind
                yield self.step("switch_map", here, here, at, at)
            elif edge >= 2 * len(network.connectors):
                waiting = (waiting[0] + takes[0], waiting[1] + takes[1])
            else:
                if at != network.stands[a]:
                    yield self.step("navigate", here, here, at, network.stands[a], *waiting)
                waiting = (0.0, 0.0)
                yield from self.passage(edge)
                here, at = network.place_of[b], turned(network.stands[b])
        if goal.pose is not None:
            last = float(goal.seconds[ends[1]]), float(goal.metres[ends[1]])
            waiting = (waiting[0] + last[0], waiting[1] + last[1])
            yield self.step("navigate", here, here, at, goal.pose, *waiting)

    def passage(self, node: int) -> Iterator[Step]:
        """What a robot does from the stand before a connector to the one behind it."""
        network = self.network
        connector, times = network.connectors[node // 2], network.times
        here, there = network.place_of[node], network.place_of[node ^ 1]
        approach, behind = network.stands[node], turned(network.stands[node ^ 1])
        elevator = network.called(node)
        if elevator is not None:
            yield self.step(
                "call_elevator", here, here, approach, approach, times.of_calling(elevator),
                connector=connector, elevator=elevator,
            )  # fmt: skip
        if connector.shut:
            name = "open_door" if connector.state == "closed" else "unlock_door"
            opening = times.of_opening(connector)
            yield self.step(name, here, here, approach, approach, opening, connector=connector)
        behaviour = connector.behaviour
        if behaviour == "call_elevator":  # what is left to do once it came
            behaviour = "pass_door"
        passing = times.of_passing(connector, network.robot.speed)
        metres = float(network.metres[node])
        yield self.step(
            behaviour, here, there, approach, behind, passing, metres, connector=connector
        )
        storeys = [network.topology.places[p].storey for p in (here, there)]
        if None not in storeys and storeys[0] != storeys[1]:
            yield self.step("switch_map", there, there, behind, behind)

    def step(
        self,
        behaviour: str,
        here: str,
        there: str,
        approach: Pose | None,
        leave: Pose,
        seconds: float = 0.0,
        metres: float = 0.0,
        *,
        connector: Connector | None = None,
        elevator: str | None = None,
    ) -> Step:
        storey = self.network.topology.places[here].storey
        frame = "map" if storey is None else frame_name(storey)
        name = "master.yaml" if self.network.robot.parts else "map.yaml"
        if storey is not None and self.several_storeys:
            name = f"{file_name(storey)}/{name}"
        return Step(
            behaviour, here, there, connector, elevator, approach, leave, seconds, metres, frame,
            name,
        )  # fmt: skip


def turned(pose: Pose) -> Pose:
    """The pose turned by half a turn about its own z axis; its quaternion with w >= 0."""
    back = pose @ Pose(qz=1.0, qw=0.0)
    if back.qw >= 0:
        return back
    return Pose(back.x, back.y, back.z, -back.qx, -back.qy, -back.qz, -back.qw)
