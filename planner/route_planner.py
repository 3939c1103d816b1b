"""Routes as people ask for them: to the fridge, to a kitchen, home (Deeken et al., section 5.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import datetime

import numpy as np

from planner.base_pose import poses_in, poses_to_reach
from planner.cost_rules import CostRules, avoiding, forbidden_regions, penalties
from planner.drawn_graph import DrawnGraph, find_drawn_route
from planner.infeasibility import infeasibility
from planner.live_topology import LiveTopology
from planner.location import (
    EntityLookup,
    LocatedEntity,
    Location,
    LocationFinder,
    LocationLike,
)
from planner.robot_class import RobotClass
from planner.route import NoRouteError, Route
from planner.route_search import find_alternatives, find_route, seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import PlaceRegion
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapSource


class RoutePlanner:
    """Plans routes for one class of robots.

    Parameters
    ----------
    graph
        The routing graph of the robots. Where its costs are costmaps, routes lead to poses from
        which the robot reaches an object; else they end anywhere in the room of the object.
    lookup
        Finds the entities that a word may stand for; by default places alone.
    rules
        What places, connectors and regions cost; by default the rules that come with the planner.
    rng
        Draws poses in regions.

    Examples
    --------
    >>> from planner.topology import Place, PlaceConnector, Topology
    >>> door = PlaceConnector("door1", ("lab", "hall"), (Pose(0.0, -1.0), Pose(0.0, 1.0)))
    >>> building = Topology.of([Place("lab"), Place("hall")], [door])
    >>> route = RoutePlanner(RoutingGraph(building)).route("lab", "hall")
    >>> [step.connector.name for step in route.doors], route.seconds
    (['door1'], 2.0)
    """

    def __init__(
        self,
        graph: RoutingGraph,
        *,
        lookup: EntityLookup | None = None,
        rules: CostRules | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.graph = graph
        self.lookup = lookup or EntityLookup()
        self.rules = rules or CostRules.default()
        self.rng = rng or np.random.default_rng()

    @classmethod
    def of_map(
        cls,
        source: MapSource,
        robot: str | RobotClass | None = None,
        *,
        rules: CostRules | None = None,
        progress: Callable[[str, int, int], None] | None = None,
        assume_sizes: bool = False,
    ) -> RoutePlanner:
        """A planner on the present state of a map in the database.

        Arguments and errors are those of `planner.LiveTopology`; with it and `of_live`, a planner
        follows later changes of the map.
        """
        live = LiveTopology(source, robot, progress=progress, assume_sizes=assume_sizes)
        return cls.of_live(live, rules=rules)

    @classmethod
    def of_live(cls, live: LiveTopology, *, rules: CostRules | None = None) -> RoutePlanner:
        """A planner on the routing graph that a live topology has now.

        It takes part in changes of the graph, until the live topology is loaded again.
        """
        return cls(live.graph, lookup=live.lookup, rules=rules)

    @property
    def costmaps(self) -> StoreyCostmaps | None:
        """The costmaps of the robots; None for robots without shape."""
        costs = self.graph.costs
        return costs if isinstance(costs, StoreyCostmaps) else None

    def route(
        self,
        start: LocationLike,
        goal: LocationLike,
        *,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
    ) -> Route:
        """The route that takes the least time.

        Parameters
        ----------
        start, goal
            If several entities have the label or type of the goal, the nearest one counts.
        avoid
            Names, labels or types of places, connectors and regions, and names of elevators, that
            the route must not use.
        at
            The moment of the route, in local time, for rules that have hours.

        Raises
        ------
        UnknownPlaceError
            The map has no entity of this name; the message suggests similar names.
        NoRouteError
            No route exists, or the robot cannot stand there; the message says why.
        ValueError
            The start stands for entities in several places.
        """
        with self._restricted(avoid, at):
            return find_route(self.graph, *self._nearest(start, goal))

    def alternatives(
        self,
        start: LocationLike,
        goal: LocationLike,
        k: int,
        *,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
    ) -> list[Route]:
        """The k quickest routes to the nearest goal, the quickest first, or all if fewer.

        Parameters and errors are those of `route`; a `k` below 1 is a ValueError.
        """
        if k < 1:
            raise ValueError(f"k is {k}; ask for 1 route or more")
        with self._restricted(avoid, at):
            return find_alternatives(self.graph, *self._nearest(start, goal), k)

    def route_on(
        self,
        drawn: DrawnGraph,
        start: LocationLike,
        goal: LocationLike,
        *,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
    ) -> Route:
        """The quickest route on a graph that people drew (`planner.readers.drawn_graph`).

        Parameters and errors are those of `route`. What is to be avoided closes passages, not
        drawn edges inside of a place.
        """
        with self._restricted(avoid, at):
            ends = self._endpoints(start), self._endpoints(goal, beside=True)
            return find_drawn_route(drawn, self.graph, *ends)

    def approach(self, entity: str | LocatedEntity, most: int = 12) -> list[Pose]:
        """The best free base poses that face an object within the robot's reach, clear ones first.

        Raises
        ------
        UnknownPlaceError
            The map has no entity of this name.
        NoBasePoseError
            There is no such pose; the message says why.
        ValueError
            The robots have no shape.
        """
        if self.costmaps is None:
            raise ValueError(
                f"robot {self.graph.robot.name} has no shape, so it has no base poses; give it a "
                "URDF (semmap robot add)"
            )
        if isinstance(entity, str):
            entity = self._locations().entity(entity)
        ground = None if entity.place is None else self.costmaps.ground(entity.place)
        return poses_to_reach(ground, entity, most)

    @contextmanager
    def _restricted(self, avoid: Sequence[str], at: datetime | None) -> Iterator[None]:
        """Apply rules, and what is to be avoided, to the graph and the costmaps."""
        locations = self._locations()
        for name in avoid:
            locations.check_avoided(name)
        cabins = self.graph.topology.cabins()
        avoided = [place for name in avoid for place in (cabins.get(name) or [name])]
        rules = (*self.rules.rules, *avoiding(avoided))
        graph, costmaps = self.graph, self.costmaps
        with graph.lock, ExitStack() as restrictions:  # no other thread sees them
            found = penalties(graph, rules, at, costmaps=costmaps)
            restrictions.enter_context(graph.penalised(found))
            if costmaps is not None:
                by_storey: dict[str, list[PlaceRegion]] = {}
                for region in forbidden_regions(graph, rules, at):
                    for storey in dict.fromkeys(map(costmaps.storey_of, region.places)):
                        by_storey.setdefault(storey, []).append(region)
                restrictions.enter_context(costmaps.also_avoiding(by_storey))
            yield

    def _locations(self) -> LocationFinder:
        costmaps = self.costmaps
        occupants = (lambda pose: ()) if costmaps is None else costmaps.occupants
        return LocationFinder(self.graph.topology, self.lookup, occupants)

    def _nearest(self, start: LocationLike, goal: LocationLike) -> tuple[Endpoint, Endpoint]:
        """The pair of endpoints between which the route takes the least time."""
        starts = self._endpoints(start)
        if len({e.place for e in starts}) > 1:
            names = ", ".join(sorted({e.place for e in starts}))
            raise ValueError(f"{start} may be {names}; name one of them")
        goals = self._endpoints(goal, beside=True)
        seconds = seconds_between(self.graph, starts, goals)
        i, j = np.unravel_index(int(np.argmin(seconds)), seconds.shape)
        if not np.isfinite(seconds[i, j]):
            raise NoRouteError(infeasibility(self.graph, starts[0], goals[0]))
        return starts[int(i)], goals[int(j)]

    def _endpoints(self, given: LocationLike, *, beside: bool = False) -> list[Endpoint]:
        """The endpoints at all locations that are meant and where the robot can stand.

        A route starts where an agent is, and ends `beside` it.
        """
        endpoints: list[Endpoint] = []
        errors: list[NoRouteError] = []
        for location in self._locations().find(given):
            try:
                poses = self._poses(location, beside)
            except NoRouteError as error:
                errors.append(error)
                continue
            ends = self.graph.endpoints([(location.place, pose) for pose in poses])
            if location.entity is not None and location.entity.kind == "region":
                ends = ([e for e in ends if np.isfinite(e.seconds).any()] or ends)[:1]
            endpoints += ends
        if not endpoints:
            raise errors[0]
        return endpoints

    def _poses(self, location: Location, beside: bool) -> Sequence[Pose | None]:
        """The poses at which a route to a location may end; None: anywhere in the place."""
        place, pose, entity = location.place, location.pose, location.entity
        costmaps = self.costmaps
        self.graph.topology.place(place)
        if entity is None or (entity.kind == "agent" and not beside):
            if pose is not None and costmaps is not None:
                self._refuse_blocked(place, pose, measured=entity is not None)
            return [None if costmaps is None and entity is not None else pose]
        if costmaps is None:
            # A waypoint is a region without area.
            return [pose if entity.kind == "region" and entity.footprint is None else None]
        if entity.kind == "room":
            return [None]
        ground = costmaps.ground(place)
        if ground is None and costmaps.straight:
            return [None]
        if entity.kind == "region":
            return poses_in(ground, entity, self.rng)
        return poses_to_reach(ground, entity)

    def _refuse_blocked(self, place: str, pose: Pose, *, measured: bool) -> None:
        assert self.costmaps is not None
        reason = self.costmaps.blocking_reason(place, pose, measured=measured)
        if reason is not None:
            raise NoRouteError(
                f"{self.graph.robot.name} cannot stand at ({pose.x:.2f}, {pose.y:.2f}) in "
                f"{place}: {reason}"
            )
