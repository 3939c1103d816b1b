"""The topology as a network of travel times for one class of robots.

A stand is the pose before a connector, on one of its sides. Walks join the stands of a
place, passages the two stands of a connector, rides those of an elevator's cabins; so that of two
doors to one corridor the nearer is taken (Deeken et al., section 4.1 and Figure 4).
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import permutations, product
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.graph import End, Graph
from planner.reasons import why_not
from planner.robot_class import RobotClass
from planner.route import NoRouteError, Route
from planner.stages import stages
from planner.times import Times
from planner.topology import OUTSIDE, Connector, Topology
from planner.walks import StraightWalks, Walks
from semmap.geometry.pose import Pose

__all__ = ["Edges", "KeptWalks", "Network", "Site"]

Floats = NDArray[np.float64]
_ALIKE = attrgetter("state", "type", "behaviour", "permissions", "width", "height", "step")
"""What bars a robot from connectors, but for their direction and a ramp's slope."""

Edges = Sequence[int] | NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Site:
    """Where a robot is, or shall be: a place, or a pose in it.

    `seconds` and `metres` are those from it to each of the place's stands `nodes`, or back.
    Without a pose every stand is equally near.
    """

    place: str
    pose: Pose | None
    nodes: NDArray[np.int64]
    seconds: Floats
    metres: Floats


class KeptWalks(NamedTuple):
    """Walks between stands: from which node to which, seconds and metres, one a direction."""

    tails: NDArray[np.int64]
    heads: NDArray[np.int64]
    seconds: Floats
    metres: Floats

    def take(self, which: Any) -> KeptWalks:
        """Some of them: an index, a mask or a slice."""
        return KeptWalks(
            self.tails[which], self.heads[which], self.seconds[which], self.metres[which]
        )


class Network:
    """Stands, and the directed edges between them in seconds; inf where one may not go.

    Attributes
    ----------
    stands : poses in the map's frame; stand 2 i + side is before connector i, in ``places[side]``
    tails, heads : (E,) int32, stands
    seconds, metres : (E,) float64; what a barred edge would take if it were not is in `base`
    lock : who changes the network, or lays penalties on it, holds it
    """

    def __init__(
        self,
        topology: Topology,
        robot: RobotClass | None = None,
        *,
        times: Times | None = None,
        walks: Walks | None = None,
        kept: KeptWalks | None = None,
    ) -> None:
        self.topology = topology
        self.robot = robot or RobotClass()
        self.times = times or Times()
        self.walks = walks or StraightWalks(self.robot.speed)
        self.connectors = list(topology.connectors.values())
        self.index = {c.name: i for i, c in enumerate(self.connectors)}
        self.stands = [pose for c in self.connectors for pose in c.poses]
        self.place_of = [place for c in self.connectors for place in c.places]
        self.nodes: dict[str, NDArray[np.int64]] = {}
        inside: dict[str, list[int]] = {}
        for node, place in enumerate(self.place_of):
            inside.setdefault(place, []).append(node)
        self.nodes = {place: np.array(nodes) for place, nodes in inside.items()}
        self._cabins = {c: elevator for elevator, all_ in topology.cabins().items() for c in all_}
        self._lay(kept)
        self.graph = Graph(*self.ways, self.seconds, 2 * len(self.stands), least=self._least())
        self.barred_for_now: dict[int, str] = {}
        self.lock = threading.RLock()

    @property
    def ways(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """From which nodes of the graph to which the edges lead.

        It has twice the stands, on arrival and on departure: no walk follows upon another.
        """
        count = len(self.stands)
        walks = np.arange(len(self.tails)) >= count
        return self.tails + count * walks, self.heads + count * ~walks

    # -- edges: passages first, then walks place by place, then rides --------------------------

    def _lay(self, kept: KeptWalks | None) -> None:
        count = 2 * len(self.connectors)
        nodes = np.arange(count)
        through = np.repeat([c.metres for c in self.connectors], 2)
        parts = [(nodes, nodes ^ 1, self._passing(self.connectors, through), through)]
        self.walk_edges: dict[str, slice] = {}
        self.measured: list[str] = []
        at = count
        if kept is not None:
            block, counts = self._whole(kept)
            parts.append(block)
            for place, n in counts.items():
                self.walk_edges[place] = slice(at, at + n)
                at += n
        for place in self.nodes:
            if place not in self.walk_edges:
                walks = self._walks_in(place)
                self.measured.append(place)
                parts.append(walks)
                self.walk_edges[place] = slice(at, at + len(walks.tails))
                at += len(walks.tails)
        self.rides: dict[int, str] = {}
        rides: list[tuple[int, int, float, float]] = []
        if self.robot.rides:
            for elevator, cabins in self.topology.cabins().items():
                for here, there in permutations(cabins, 2):
                    for a, b in product(self.nodes.get(here, ()), self.nodes.get(there, ())):
                        p, q = self.stands[a], self.stands[b]
                        across = math.hypot(p.x - q.x, p.y - q.y)
                        seconds = self.times.of_riding(elevator, p.z - q.z)
                        seconds += across / self.robot.speed
                        self.rides[at + len(rides)] = elevator
                        rides.append((int(a), int(b), seconds, across))
        if rides:
            columns = np.array(rides).T
            parts.append((columns[0], columns[1], columns[2], columns[3]))
        tails, heads, base, metres = (np.concatenate(k) for k in zip(*parts, strict=True))
        self.tails, self.heads = tails.astype(np.int32), heads.astype(np.int32)
        self.base, self.metres = base.astype(np.float64), metres.astype(np.float64)
        self.seconds = self.base.copy()
        self.seconds[:count][self._barred(self.connectors)] = math.inf
        if OUTSIDE in self.walk_edges and not self.robot.outside:
            self.seconds[self.walk_edges[OUTSIDE]] = math.inf

    def _least(self) -> Floats:
        """What edges take at least: a door stands open, a way that is blocked leads straight."""
        count = len(self.stands)
        least = self.base.copy()
        least[:count] = np.minimum(least[:count], self.metres[:count] / self.robot.speed)
        blocked = np.flatnonzero(np.isinf(least))
        a, b = ([self.stands[n] for n in k[blocked]] for k in (self.tails, self.heads))
        least[blocked] = [
            math.hypot(p.x - q.x, p.y - q.y) / self.robot.speed for p, q in zip(a, b, strict=True)
        ]
        return least

    def _whole(self, kept: KeptWalks) -> tuple[KeptWalks, dict[str, int]]:
        """What was kept of places of which nothing is missing, and how much it is of each."""
        numbers = {place: i for i, place in enumerate(self.nodes)}
        of = np.array([numbers[p] for p in self.place_of], np.int64)[kept.tails]
        order = np.argsort(of, kind="stable")
        counts = np.bincount(of, minlength=len(numbers))
        stands = np.array([len(nodes) for nodes in self.nodes.values()])
        whole = counts == stands * (stands - 1)
        if OUTSIDE in numbers:
            whole[numbers[OUTSIDE]] = False
        block = kept.take(order[whole[of[order]]])
        return block, {p: n for p, n, w in zip(numbers, counts.tolist(), whole, strict=True) if w}

    def _walks_in(self, place: str) -> KeptWalks:
        nodes = self.nodes[place]
        stands = [self.stands[n] for n in nodes]
        others = ~np.eye(len(stands), dtype=bool)
        walks = StraightWalks(self.robot.speed) if place == OUTSIDE else self.walks
        walked = walks.between(place, stands, stands)
        a, b = (k[others] for k in np.meshgrid(nodes, nodes, indexing="ij"))
        return KeptWalks(a, b, walked.seconds[others], walked.metres[others])

    def _passing(self, connectors: Sequence[Connector], metres: Floats) -> Floats:
        """(2 n,) seconds of passing each connector from either side, over so many metres."""
        times, cabins = self.times, self._cabins
        found = metres / self.robot.speed
        for i, connector in enumerate(connectors):
            if times.learned:
                found[2 * i : 2 * i + 2] = times.of_passing(connector, self.robot.speed)
            if connector.state != "open":
                found[2 * i : 2 * i + 2] += times.of_opening(connector)
            a, b = connector.places
            if (a in cabins or b in cabins) and cabins.get(a) != cabins.get(b):
                for side, there in enumerate((b, a)):  # it has to come before one goes in
                    if there in cabins:
                        found[2 * i + side] += times.of_calling(cabins[there])
        return found

    def _barred(self, connectors: Sequence[Connector]) -> NDArray[np.bool_]:
        """(2 n,) whether the robot must not pass each connector from either side."""
        bars: list[bool] = []
        known: dict[tuple[object, ...], bool] = {}  # most doors are alike
        for c, alike in zip(connectors, map(_ALIKE, connectors), strict=True):
            bar = known.get(alike)
            if bar is None or c.type == "ramp":
                bar = known[alike] = self.robot.bar(c) is not None
            bars.append(bar)
        found = np.repeat(np.array(bars, np.bool_), 2)
        for i, c in enumerate(connectors):
            if c.direction != "both":
                found[2 * i : 2 * i + 2] |= [not c.passes(0), not c.passes(1)]
        return found

    def called(self, node: int) -> str | None:
        """The elevator that has to come before the passage that begins at a stand."""
        here, there = (self._cabins.get(self.place_of[n]) for n in (node, node ^ 1))
        return there if here != there else None

    # -- changes --------------------------------------------------------------------------------

    def change_connector(self, connector: Connector) -> None:
        """Take in another state, direction or width of a connector; its places and poses stay."""
        number = self.index[connector.name]
        before = self.connectors[number]
        if (before.places, before.poses) != (connector.places, connector.poses):
            raise ValueError(f"{connector.name} joins other places now: make the network anew")
        with self.lock:
            self.connectors[number] = connector
            self.topology.connectors[connector.name] = connector
            edges = np.array([2 * number, 2 * number + 1])
            self.base[edges] = self._passing([connector], np.repeat(connector.metres, 2))
            self.seconds[edges] = np.where(self._barred([connector]), math.inf, self.base[edges])
            self.graph.set_weights(edges, self.seconds[edges])

    def change_walks(self, place: str) -> None:
        """Ask anew how long the ways inside of a place are."""
        edges = self.walk_edges.get(place)
        if edges is None or edges.start == edges.stop:
            return
        with self.lock:
            walks = self.walks_again(place)
            self.base[edges], self.metres[edges] = walks.seconds, walks.metres
            if place != OUTSIDE or self.robot.outside:
                self.seconds[edges] = self.base[edges]
            self.graph.set_weights(np.arange(edges.start, edges.stop), self.seconds[edges])

    def walks_again(self, place: str) -> KeptWalks:
        """The walks of a place as they are now, in the order of its edges."""
        edges = self.walk_edges.get(place, slice(0, 0))
        walks = self._walks_in(place)
        order = np.empty(len(walks.tails), np.int64)
        there = np.lexsort((self.heads[edges], self.tails[edges]))
        order[there] = np.lexsort((walks.heads, walks.tails))
        return walks.take(order)

    @contextmanager
    def penalised(
        self,
        seconds: Mapping[int, float],
        bars: Mapping[int, str],
        walks: Mapping[int, tuple[float, float]] | None = None,
    ) -> Iterator[None]:
        """While it lasts, edges cost so many seconds more, or are barred for a reason.

        Other threads wait. What routes take remains what they take; only which is chosen differs.

        Parameters
        ----------
        walks : what walks take meanwhile, seconds and metres, since they lead elsewhere
        """
        with self.lock:
            walks = walks or {}
            edges = np.array(sorted({*seconds, *bars, *walks}), np.int64)
            usual = self.seconds[edges], self.metres[edges]
            for edge, (longer, further) in walks.items():
                self.seconds[edge], self.metres[edge] = longer, further
            dearer = self.seconds[edges] + [seconds.get(int(e), 0.0) for e in edges]
            dearer[[int(e) in bars for e in edges]] = math.inf
            if len(edges):
                self.graph.set_weights(edges, dearer)
            self.barred_for_now = dict(bars)
            try:
                yield
            finally:
                self.barred_for_now = {}
                self.seconds[edges], self.metres[edges] = usual
                if len(edges):
                    self.graph.set_weights(edges, self.seconds[edges])

    def entering(self, place: str) -> list[int]:
        """The edges by which one comes into a place."""
        nodes = self.nodes.get(place, np.empty(0, np.int64))
        return [int(n) ^ 1 for n in nodes] + [
            e for e in self.rides if self.place_of[int(self.heads[e])] == place
        ]

    # -- questions ------------------------------------------------------------------------------

    def site(self, place: str, pose: Pose | None = None) -> Site:
        """A place, or a pose in it, as a start or a goal.

        Raises
        ------
        UnknownPlaceError
        """
        self.topology.place(place)
        nodes = self.nodes.get(place, np.empty(0, np.int64))
        if pose is None or not len(nodes):
            return Site(place, pose, nodes, np.zeros(len(nodes)), np.zeros(len(nodes)))
        walked = self.walks.between(place, [pose], [self.stands[n] for n in nodes])
        return Site(place, pose, nodes, walked.seconds[0], walked.metres[0])

    def times_between(self, starts: Sequence[Site], goals: Sequence[Site]) -> Floats:
        """(n, m) seconds from each site to each other; inf where no way leads."""
        found = np.full((len(starts), len(goals)), math.inf)
        if not starts or not goals:
            return found
        begins, ends = [self._leaving(s) for s in starts], [self._arriving(g) for g in goals]
        sources, targets = (np.unique(np.concatenate([k[0] for k in e])) for e in (begins, ends))
        ways = self.graph.distances(sources, targets)
        at = [np.searchsorted(targets, nodes) for nodes, _ in ends]
        for i, start in enumerate(starts):
            nodes, seconds = begins[i]
            away = ways[np.searchsorted(sources, nodes)] + seconds[:, None]
            first = away.min(axis=0, initial=math.inf)
            for j, goal in enumerate(goals):
                found[i, j] = (first[at[j]] + ends[j][1]).min(initial=math.inf)
                if start.place == goal.place:
                    found[i, j] = min(found[i, j], self._inside(start, goal)[0])
        return found

    def route(self, start: Site, goal: Site) -> Route:
        """The route that takes the least time.

        Raises
        ------
        NoRouteError
            No way leads there; it says what bars it.
        """
        inside = self._inside(start, goal) if start.place == goal.place else (math.inf, math.inf)
        found = self.graph.shortest(*self.ends(start, goal))
        if found is None and math.isinf(inside[0]):
            raise NoRouteError(self.why_not(start, goal))
        if found is None or inside[0] <= found[0]:
            return self._route(start, goal, (), inside[0], inside[1])
        return self._along(start, goal, found[1])

    def alternatives(self, start: Site, goal: Site, k: int) -> list[Route]:
        """The k shortest routes, none with the same stand twice; fewer where there are no more.

        No two pass the same connectors and ride the same elevators in the same order.
        """
        found: dict[tuple[object, ...], Route] = {}
        asked, more = k, True
        while more and len(found) < k:
            ways = self.graph.alternatives(*self.ends(start, goal), asked)
            for _, edges in ways:
                found.setdefault(self._transitions(edges), self._along(start, goal, edges))
            more, asked = len(ways) == asked, 2 * asked
        if start.place == goal.place:
            seconds, metres = self._inside(start, goal)
            if seconds < (found[()].seconds if () in found else math.inf):
                found[()] = self._route(start, goal, (), seconds, metres)
        return sorted(found.values(), key=lambda r: r.seconds)[:k]

    def _transitions(self, edges: Edges) -> tuple[object, ...]:
        """The passages among edges, and the cabins that rides lead to."""
        passages = 2 * len(self.connectors)
        return tuple(
            int(e) if e < passages else (self.rides[int(e)], self.place_of[int(self.heads[e])])
            for e in edges
            if e < passages or int(e) in self.rides
        )

    def _leaving(self, site: Site) -> tuple[NDArray[np.int64], Floats]:
        """The nodes from which ways lead away from a site; in a cabin rides do, too."""
        if self.topology.places[site.place].elevator is None:
            return site.nodes, site.seconds
        nodes = np.concatenate([site.nodes, site.nodes + len(self.stands)])
        return nodes, np.concatenate([site.seconds, site.seconds])

    def _arriving(self, site: Site) -> tuple[NDArray[np.int64], Floats]:
        """The nodes by which ways lead to a site; in a cabin rides do, too."""
        there = site.nodes + len(self.stands)
        if self.topology.places[site.place].elevator is None:
            return there, site.seconds
        nodes = np.concatenate([there, site.nodes])
        return nodes, np.concatenate([site.seconds, site.seconds])

    def ends(self, start: Site, goal: Site) -> tuple[list[End], list[End]]:
        """Where in the graph ways from a site to another begin and end, and the seconds there."""
        begin, end = (
            [(int(n), float(s)) for n, s in zip(nodes, seconds, strict=True) if s < math.inf]
            for nodes, seconds in (self._leaving(start), self._arriving(goal))
        )
        return begin, end

    def _inside(self, start: Site, goal: Site) -> tuple[float, float]:
        """Seconds and metres from pose to pose of one place."""
        if start.pose is None or goal.pose is None:
            return 0.0, 0.0
        walked = self.walks.between(start.place, [start.pose], [goal.pose])
        return float(walked.seconds[0, 0]), float(walked.metres[0, 0])

    def _along(self, start: Site, goal: Site, edges: Edges) -> Route:
        first, last = (self.tails[edges[0]], self.heads[edges[-1]]) if len(edges) else (None, None)
        if first is None:  # start and goal share a stand
            both = {int(n): i for i, n in enumerate(start.nodes)}
            first = last = min(
                (n for n in goal.nodes if int(n) in both),
                key=lambda n: start.seconds[both[int(n)]] + goal.seconds[list(goal.nodes).index(n)],
            )
        i, j = (int(np.flatnonzero(s.nodes == n)[0]) for s, n in ((start, first), (goal, last)))
        seconds = math.fsum([start.seconds[i], *self.seconds[list(edges)], goal.seconds[j]])
        metres = math.fsum([start.metres[i], *self.metres[list(edges)], goal.metres[j]])
        return self._route(start, goal, edges, seconds, metres, (i, j))

    def _route(
        self,
        start: Site,
        goal: Site,
        edges: Edges,
        seconds: float,
        metres: float,
        ends: tuple[int, int] | None = None,
    ) -> Route:
        found = stages(self, start, goal, edges, seconds, metres, ends)
        return Route(start.place, goal.place, found, seconds, metres)

    def why_not(self, start: Site, goal: Site) -> str:
        """Which forbidden passages the way with the fewest of them would need, in words."""
        return why_not(self, start, goal)
