"""The topology as a graph of travel times for one class of robots.

Nodes are approach poses: the poses before a connector, one on each of its sides. A travel edge
joins two approach poses in one place, a passage the two of one connector, a ride those in the
cabins of one elevator (Deeken et al., section 4.1 and Figure 4).
"""

from __future__ import annotations

import math
import threading
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from planner.graph import Graph, PathEnd
from planner.graph_edges import (
    Penalties,
    StraightTravelCost,
    TravelCost,
    TravelEdges,
    blocked_passages,
    complete_travel,
    measure_travel,
    passage_seconds,
    ride_edges,
)
from planner.robot_class import Durations, RobotClass
from planner.topology import OUTSIDE, PlaceConnector, PlaceRegion, Topology
from semmap.arrays import Floats, Ints
from semmap.geometry.pose import Pose

Edges = Sequence[int] | Ints


@dataclass(frozen=True, eq=False)
class Endpoint:
    """Where a route begins or ends: a place, or a pose in it.

    Attributes
    ----------
    place
        Name of the place.
    pose
        In the map's frame. None stands for the whole place: every approach pose in it is 0 s away.
    nodes
        (n,) the approach poses of the place, by number.
    seconds, metres
        (n,) the travel from the endpoint to each of them, or back.
    """

    place: str
    pose: Pose | None
    nodes: Ints
    seconds: Floats
    metres: Floats


class RoutingGraph:
    """Approach poses, and the directed edges between them with their seconds and metres.

    The graph owns no map: whoever follows a map tells it what changed, by `change_connector`,
    `change_regions` and `measure_again`.

    Parameters
    ----------
    robot
        By default a robot without shape that opens closed doors.
    costs
        Measures the travel inside of places; by default straight lines at the robot's speed.
    durations
        How long all other behaviours take.
    stored
        Travel edges that were measured before. The travel in a place is measured if one of its
        edges is missing.

    Attributes
    ----------
    topology : Topology
        The present one.
    poses : list of Pose
        The approach poses in the map's frame; number 2 i + side belongs to connector i and lies in
        its ``places[side]``.
    place_of : list of str
        The place of each approach pose.
    nodes : dict of str to (n,) int64
        The approach poses of each place.
    tails, heads
        (E,) int32: from which approach pose to which each edge leads.
    seconds, metres, base
        (E,) float64. A blocked edge has infinite `seconds`, and in `base` the seconds that it would
        take.
    travel_edges : dict of str to slice
        The travel edges of each place.
    rides : dict of int to str
        The edges that are rides, each with its elevator.
    cut_rides : dict of int to str
        The rides on which nobody crosses the cabin, each with the reason.
    measured : list of str
        The places whose travel was measured by this graph.
    lock
        Held by whoever changes the graph or applies penalties.

    Examples
    --------
    >>> from planner.topology import Place
    >>> door = PlaceConnector("door1", ("lab", "hall"), (Pose(0.0, -1.0), Pose(0.0, 1.0)))
    >>> graph = RoutingGraph(Topology.of([Place("lab"), Place("hall")], [door]))
    >>> graph.seconds
    array([2., 2.])
    """

    tails: NDArray[np.int32]
    heads: NDArray[np.int32]
    seconds: Floats
    metres: Floats
    base: Floats

    def __init__(
        self,
        topology: Topology,
        robot: RobotClass | None = None,
        costs: TravelCost | None = None,
        *,
        durations: Durations | None = None,
        stored: TravelEdges | None = None,
    ) -> None:
        self.topology = topology
        self.robot: RobotClass = robot or RobotClass()
        self.costs: TravelCost = costs or StraightTravelCost(self.robot.speed)
        self.durations: Durations = durations or Durations()
        self.connectors: list[PlaceConnector] = list(topology.connectors.values())
        self.index: dict[str, int] = {c.name: i for i, c in enumerate(self.connectors)}
        self.poses: list[Pose] = [pose for c in self.connectors for pose in c.poses]
        self.place_of: list[str] = [place for c in self.connectors for place in c.places]
        inside: dict[str, list[int]] = {}
        for node, place in enumerate(self.place_of):
            inside.setdefault(place, []).append(node)
        self.nodes: dict[str, Ints] = {place: np.array(nodes) for place, nodes in inside.items()}
        self._elevators = topology.elevators()
        self._unseen: set[str] = {place for place in self._elevators if place in self.nodes}
        self._obstructed: dict[int, str] = {}  # approach poses in cabins
        self.cut_rides: dict[int, str] = {}
        self._make_edges(stored)
        least = self._least()
        self.graph: Graph = Graph(*self.arcs, self.seconds, 2 * len(self.poses), least=least)
        self.penalties: Penalties = Penalties()
        self.lock: threading.RLock = threading.RLock()

    @property
    def arcs(self) -> tuple[Ints, Ints]:
        """(E,) tails and (E,) heads of the edges in `graph`, which has two nodes a pose.

        A robot arrives at the first and departs from the second. Travel and rides lead from an
        arrival to a departure, passages from a departure to an arrival: so no travel follows
        another, and alternatives do not differ by a stop at a door on the way.
        """
        count = len(self.poses)
        inside = np.arange(len(self.tails)) >= count
        return self.tails + count * inside, self.heads + count * ~inside

    @cached_property
    def has_several_storeys(self) -> bool:
        """Whether its places are on more than one storey."""
        return len(self.topology.storeys()) > 1

    def _make_edges(self, stored: TravelEdges | None) -> None:
        count = 2 * len(self.connectors)
        nodes = np.arange(count)
        through = np.repeat([c.metres for c in self.connectors], 2)
        parts = [TravelEdges(nodes, nodes ^ 1, self._passing(self.connectors, through), through)]
        self.travel_edges: dict[str, slice] = {}
        self.measured: list[str] = []
        at = count
        if stored is not None:
            block, counts = complete_travel(stored, self.nodes, self.place_of)
            parts.append(block)
            for place, n in counts.items():
                self.travel_edges[place] = slice(at, at + n)
                at += n
        for place in self.nodes:
            if place not in self.travel_edges:
                travel = self._measure(place)
                self.measured.append(place)
                parts.append(travel)
                self.travel_edges[place] = slice(at, at + len(travel.tails))
                at += len(travel.tails)
        cabins = self.topology.cabins() if self.robot.rides_elevators else {}
        rides, elevators = ride_edges(
            cabins, self.nodes, self.poses, self.durations, self.robot.speed
        )
        self.rides: dict[int, str] = dict(enumerate(elevators, at))
        parts.append(rides)
        tails, heads, base, metres = (np.concatenate(k) for k in zip(*parts, strict=True))
        self.tails, self.heads = tails.astype(np.int32), heads.astype(np.int32)
        self.base, self.metres = base.astype(np.float64), metres.astype(np.float64)
        self.seconds = self.base.copy()
        self.seconds[:count][blocked_passages(self.connectors, self.robot)] = math.inf
        if OUTSIDE in self.travel_edges and not self.robot.outside:
            self.seconds[self.travel_edges[OUTSIDE]] = math.inf

    def _passing(self, connectors: Sequence[PlaceConnector], metres: Floats) -> Floats:
        return passage_seconds(connectors, metres, self.robot, self.durations, self._elevators)

    def _least(self) -> Floats:
        """(E,) lower bounds of the seconds: doors stand open, travel follows straight lines."""
        count = len(self.poses)
        least = self.base.copy()
        least[:count] = np.minimum(least[:count], self.metres[:count] / self.robot.speed)
        unreachable = np.flatnonzero(np.isinf(least))
        a, b = ([self.poses[n] for n in k[unreachable]] for k in (self.tails, self.heads))
        least[unreachable] = [
            math.hypot(p.x - q.x, p.y - q.y) / self.robot.speed for p, q in zip(a, b, strict=True)
        ]
        return least

    def _measure(self, place: str) -> TravelEdges:
        nodes = self.nodes[place]
        costs = StraightTravelCost(self.robot.speed) if place == OUTSIDE else self.costs
        return measure_travel(costs, place, nodes, [self.poses[n] for n in nodes])

    def change_connector(self, connector: PlaceConnector) -> None:
        """Replace a connector by one of another state, direction or size.

        Other places or poses than before are a ValueError.
        """
        number = self.index[connector.name]
        before = self.connectors[number]
        if (before.places, before.poses) != (connector.places, connector.poses):
            raise ValueError(
                f"{connector.name} now joins other places or has other poses: make a new graph"
            )
        with self.lock:
            self.connectors[number] = connector
            others = self.topology.connectors
            connectors = {**others, connector.name: connector}
            self.topology = replace(self.topology, connectors=connectors)
            edges = slice(2 * number, 2 * number + 2)
            self.base[edges] = self._passing([connector], np.repeat(connector.metres, 2))
            self._block(number)

    def _block(self, number: int) -> None:
        """Block the passages of a connector that the robot cannot take, and no others."""
        edges = np.array([2 * number, 2 * number + 1])
        blocked = blocked_passages([self.connectors[number]], self.robot)
        blocked |= self.obstruction(2 * number) is not None
        self.seconds[edges] = np.where(blocked, math.inf, self.base[edges])
        self.graph.set_weights(edges, self.seconds[edges])

    def look_into_cabins(self) -> None:
        """Block the doors of cabins inside of which something leaves no way to the door.

        Travel says so in all other places, but a ride begins and ends at one door. A ride to
        another door crosses the cabin, too. As it takes the costmaps of all cabins, it waits for
        the first search.
        """
        with self.lock:
            places, self._unseen = self._unseen, set()
            for edge in self.rides if places else ():
                ends = int(self.tails[edge]), int(self.heads[edge])
                if not places.isdisjoint(self.place_of[node] for node in ends):
                    self._look_at_ride(edge, *ends)
            for place in places:
                for node in map(int, self.nodes[place]):
                    before = self._obstructed.pop(node, None)
                    reason = self.costs.obstruction(place, self.poses[node])
                    if reason is not None:
                        self._obstructed[node] = reason
                    if reason != before:
                        self._block(node // 2)

    def _look_at_ride(self, edge: int, a: int, b: int) -> None:
        """Block a ride if something divides the cabin between its doors, in either storey."""
        self.cut_rides.pop(edge, None)
        p, q = self.poses[a], self.poses[b]
        for place, floor in ((self.place_of[a], p.z), (self.place_of[b], q.z)):
            ends = [p._replace(z=floor), q._replace(z=floor)]
            crossing = self.costs.between(place, ends[:1], ends[1:]).seconds
            if np.isinf(crossing).all() and all(self._fits(place, end) for end in ends):
                doors = " to ".join(self.connectors[node // 2].name for node in (a, b))
                self.cut_rides[edge] = f"{self.robot.name} finds no path in {place} from {doors}"
        seconds = math.inf if edge in self.cut_rides else self.base[edge]
        if seconds != self.seconds[edge]:
            self.seconds[edge] = seconds
            self.graph.set_weights(np.array([edge]), self.seconds[[edge]])

    def obstruction(self, node: int) -> str | None:
        """What stands in a cabin before a passage, by number, in words; None if nothing does."""
        return self._obstructed.get(node) or self._obstructed.get(node ^ 1)

    def change_regions(self, regions: Iterable[PlaceRegion]) -> None:
        """Replace the regions of the topology; they have an effect on edges by penalties alone."""
        with self.lock:
            self.topology = replace(self.topology, regions=tuple(regions))

    def measure_again(self, place: str) -> None:
        """Measure the travel in a place again, after something changed there."""
        if place in self._elevators and place in self.nodes:
            self._unseen.add(place)
        edges = self.travel_edges.get(place)
        if edges is None or edges.start == edges.stop:
            return
        with self.lock:
            travel = self.travel_in(place)
            self.base[edges], self.metres[edges] = travel.seconds, travel.metres
            if place != OUTSIDE or self.robot.outside:
                self.seconds[edges] = self.base[edges]
            self.graph.set_weights(np.arange(edges.start, edges.stop), self.seconds[edges])

    def travel_in(self, place: str) -> TravelEdges:
        """The travel in a place as `costs` measure it now, in the order of its edges."""
        edges = self.travel_edges.get(place, slice(0, 0))
        travel = self._measure(place)
        order = np.empty(len(travel.tails), np.int64)
        there = np.lexsort((self.heads[edges], self.tails[edges]))
        order[there] = np.lexsort((travel.heads, travel.tails))
        return travel.take(order)

    @contextmanager
    def penalised(self, penalties: Penalties) -> Iterator[None]:
        """Apply penalties inside a ``with`` block; other threads that change the graph wait."""
        with self.lock:
            self.look_into_cabins()
            more, blocked, detours = penalties.seconds, penalties.blocked, penalties.detours
            edges = np.array(sorted({*more, *blocked, *detours}), np.int64)
            usual = self.seconds[edges], self.metres[edges]
            for edge, (seconds, metres) in detours.items():
                self.seconds[edge], self.metres[edge] = seconds, metres
            weights = self.seconds[edges] + [more.get(int(e), 0.0) for e in edges]
            weights[[int(e) in blocked for e in edges]] = math.inf
            if len(edges):
                self.graph.set_weights(edges, weights)
            self.penalties = penalties
            try:
                yield
            finally:
                self.penalties = Penalties()
                self.seconds[edges], self.metres[edges] = usual
                if len(edges):
                    self.graph.set_weights(edges, self.seconds[edges])

    def elevator_to_call(self, node: int) -> str | None:
        """The elevator that must come before the passage from an approach pose can begin."""
        here, there = (self._elevators.get(self.place_of[n]) for n in (node, node ^ 1))
        return there if there != here else None

    def edges_into(self, place: str) -> list[int]:
        """The passages and rides that lead into a place."""
        nodes = self.nodes.get(place, np.empty(0, np.int64))
        return [int(n) ^ 1 for n in nodes] + [
            e for e in self.rides if self.place_of[int(self.heads[e])] == place
        ]

    def without(self, names: Collection[str]) -> RoutingGraph:
        """The graph without the connectors and elevators of these names; itself without names."""
        if not names:
            return self
        topology = self.topology.without(names)
        return RoutingGraph(topology, self.robot, self.costs, durations=self.durations)

    def with_abilities(
        self, *, opens: bool = True, unlocks: bool = False, outside: bool = False
    ) -> RoutingGraph:
        """The graph of the same robots that also unlock or go outside, or open nothing."""
        robot = replace(
            self.robot,
            opens=self.robot.opens and opens,
            unlocks=self.robot.unlocks or unlocks,
            outside=self.robot.outside or outside,
        )
        return RoutingGraph(self.topology, robot, self.costs, durations=self.durations)

    def endpoint(self, place: str, pose: Pose | None = None) -> Endpoint:
        """A place, or a pose in it, as an end of routes; raises UnknownPlaceError.

        Somewhere in a place, a robot is at one of its doors, but at none that something closes. In
        a cabin, it may be there, too, and ride on.
        """
        return self.endpoints([(place, pose)])[0]

    def endpoints(self, ends: Sequence[tuple[str, Pose | None]]) -> list[Endpoint]:
        """As `endpoint`, each: travel in a place is measured to all of its poses together.

        Equal ends are one.
        """
        found: dict[tuple[str, Pose | None], Endpoint] = {}
        for place in dict.fromkeys(place for place, _ in ends):
            self.topology.place(place)
            nodes = self.nodes.get(place, np.empty(0, np.int64))
            poses = [*dict.fromkeys(pose for at, pose in ends if at == place and pose is not None)]
            if poses and len(nodes):
                travel = self.costs.between(place, poses, [self.poses[n] for n in nodes])
                for pose, *row in zip(poses, travel.seconds, travel.metres, strict=True):
                    found[place, pose] = Endpoint(place, pose, nodes, *row)
        found |= {end: self._somewhere(*end) for end in dict.fromkeys(ends) if end not in found}
        return [found[end] for end in ends]

    def _somewhere(self, place: str, pose: Pose | None) -> Endpoint:
        """A place as an end of routes, from its doors."""
        nodes = self.nodes.get(place, np.empty(0, np.int64))
        seconds = np.zeros(len(nodes))
        for i in np.flatnonzero(self._cut_off(place)):
            at = self.poses[nodes[i]]
            rides = place in self._elevators and self._fits(place, at)
            if not rides and self.costs.obstruction(place, at) is not None:
                seconds[i] = math.inf
        return Endpoint(place, pose, nodes, seconds, np.zeros(len(nodes)))

    def _fits(self, place: str, pose: Pose) -> bool:
        """Whether the robot can be at a pose in a place, or beside it."""
        return bool(np.isfinite(self.costs.between(place, [pose], [pose]).seconds).all())

    def standing(self, node: int) -> Pose:
        """Where the robot stands for an approach pose, by number: aside of what is there.

        Travel has the way to it from the approach pose and back, too.
        """
        place, pose = self.place_of[node], self.poses[node]
        return pose if place == OUTSIDE else self.costs.standing(place, pose)

    def bends(self, node: int) -> list[tuple[float, float]]:
        """Where the passage from an approach pose, by number, bends; none if it is straight."""
        found = self.costs.bends(self.connectors[node // 2])
        return found[::-1] if node % 2 else found

    def _cut_off(self, place: str) -> NDArray[np.bool_]:
        """(n,) the approach poses of a place from which no travel leads to another one."""
        nodes = self.nodes.get(place, np.empty(0, np.int64))
        if place == OUTSIDE:
            return np.zeros(len(nodes), np.bool_)
        edges = self.travel_edges.get(place, slice(0, 0))
        return ~np.isin(nodes, self.tails[edges][np.isfinite(self.base[edges])])

    def departures(self, start: Endpoint) -> tuple[Ints, Floats]:
        """The nodes of `graph` at which paths from an endpoint begin, and the seconds to them.

        From a cabin, a ride may begin at once, too.
        """
        return self._both(start, start.nodes, start.nodes + len(self.poses))

    def arrivals(self, goal: Endpoint) -> tuple[Ints, Floats]:
        """The nodes of `graph` at which paths to an endpoint end, and the seconds from them.

        In a cabin, a ride may be the end, too.
        """
        return self._both(goal, goal.nodes + len(self.poses), goal.nodes)

    def _both(self, end: Endpoint, nodes: Ints, in_cabin: Ints) -> tuple[Ints, Floats]:
        self.look_into_cabins()
        if self.topology.places[end.place].elevator is None:
            return nodes, end.seconds
        return np.concatenate([nodes, in_cabin]), np.tile(end.seconds, 2)

    def path_ends(self, start: Endpoint, goal: Endpoint) -> tuple[list[PathEnd], list[PathEnd]]:
        """Sources and targets in `graph` of paths from one endpoint to another."""
        sources, targets = (
            [(int(n), float(s)) for n, s in zip(nodes, seconds, strict=True) if s < math.inf]
            for nodes, seconds in (self.departures(start), self.arrivals(goal))
        )
        return sources, targets
