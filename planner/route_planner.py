"""Routes as people ask for them: to the fridge, to a kitchen, home (Deeken et al., section 5.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import datetime
from typing import TypeAlias

import numpy as np

from planner.base_pose import NoBasePoseError, poses_in, poses_to_reach
from planner.cost_rules import CostRules, avoiding
from planner.drawn_graph import DrawnGraph, find_drawn_route
from planner.entity_lookup import EntityLookup, LocatedEntity, NoLookup
from planner.infeasibility import infeasibility
from planner.live_topology import LiveTopology
from planner.penalties import forbidden_regions, penalties
from planner.robot_class import RobotClass
from planner.route import NoRouteError, Route
from planner.route_search import find_alternatives, find_route, seconds_between
from planner.routing_graph import Endpoint, RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import Place, PlaceRegion, UnknownPlaceError
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapSource

__all__ = ["Location", "RoutePlanner"]

Point: TypeAlias = tuple[float, float] | tuple[float, float, float]

Location: TypeAlias = str | Pose | Point | tuple[str, Pose] | LocatedEntity
"""Where a route begins or ends: a name, a label or a type; a pose or a point in the map's frame,
metres; a place and a pose in it; an entity that was looked up."""


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
    >>> from planner.topology import PlaceConnector, Topology
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
        self.lookup = lookup or NoLookup()
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

        To follow later changes of the map, use `planner.LiveTopology` and `of_live`.

        Parameters
        ----------
        source, robot, progress, assume_sizes
            As for `planner.LiveTopology`.

        Raises
        ------
        LookupError
            There is no such map or class of robots.
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
        start: Location,
        goal: Location,
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
        start: Location,
        goal: Location,
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
        start: Location,
        goal: Location,
        *,
        avoid: Sequence[str] = (),
        at: datetime | None = None,
    ) -> Route:
        """The quickest route on a graph that people drew (`planner.readers.drawn_graph`).

        Parameters and errors are those of `route`. What is to be avoided closes passages, not
        drawn edges inside of a place.
        """
        with self._restricted(avoid, at):
            ends = self._endpoints(start), self._endpoints(goal)
            return find_drawn_route(drawn, self.graph, *ends)

    def approach(self, entity: str | LocatedEntity, most: int = 12) -> list[Pose]:
        """Free base poses that face an object within the robot's reach, clear ones first.

        Parameters
        ----------
        entity
            A name, or an entity that was looked up.
        most
            Return no more poses than this.

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
            found = self.lookup.find(entity)
            if not found:
                raise UnknownPlaceError(
                    entity, {*self._names(), *self.lookup.similar_names(entity)}
                )
            entity = found[0]
        return poses_to_reach(self.costmaps, self._with_place(entity), most)

    # -- rules ----------------------------------------------------------------------------------

    @contextmanager
    def _restricted(self, avoid: Sequence[str], at: datetime | None) -> Iterator[None]:
        """Apply rules, and what is to be avoided, to the graph and the costmaps."""
        cabins = self.graph.topology.cabins()
        for name in avoid:
            if name not in cabins and not self._is_known(name):
                raise UnknownPlaceError(name, [*self._names(), *cabins])
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

    def _is_known(self, name: str) -> bool:
        topology = self.graph.topology
        labelled: list[Place | PlaceRegion] = [*topology.places.values(), *topology.regions]
        return any(name in (c.name, c.type) for c in topology.connectors.values()) or any(
            name in (e.name, e.label, *e.types) for e in labelled
        )

    def _names(self) -> list[str]:
        topology = self.graph.topology
        return [*topology.places, *topology.connectors, *(r.name for r in topology.regions)]

    # -- endpoints ------------------------------------------------------------------------------

    def _nearest(self, start: Location, goal: Location) -> tuple[Endpoint, Endpoint]:
        """The pair of endpoints between which the route takes the least time."""
        starts = self._endpoints(start)
        if len({e.place for e in starts}) > 1:
            names = ", ".join(sorted({e.place for e in starts}))
            raise ValueError(f"{start} may be {names}; name one of them")
        goals = self._endpoints(goal)
        seconds = seconds_between(self.graph, starts, goals)
        i, j = np.unravel_index(int(np.argmin(seconds)), seconds.shape)
        if not np.isfinite(seconds[i, j]):
            raise NoRouteError(infeasibility(self.graph, starts[0], goals[0]))
        return starts[int(i)], goals[int(j)]

    def _endpoints(self, location: Location) -> list[Endpoint]:
        """All endpoints that a location may stand for.

        Raises
        ------
        UnknownPlaceError, NoRouteError
        """
        if isinstance(location, str):
            return self._endpoints_of_word(location)
        if isinstance(location, LocatedEntity):
            return self._endpoints_of_entity(self._with_place(location))
        if isinstance(location, Pose):
            return [self._endpoint_at_pose(location)]
        if isinstance(location[0], str):
            place, pose = location
            return [self._endpoint_at(place, pose)]
        return [self._endpoint_at_pose(Pose(*location))]

    def _endpoint_at_pose(self, pose: Pose) -> Endpoint:
        place = self.lookup.place_at(pose)
        if place is None:
            names = self.costmaps.occupants(pose) if self.costmaps is not None else ()
            there = f"; {', '.join(names)} is there" if names else ""
            raise NoRouteError(f"({pose.x:.2f}, {pose.y:.2f}, {pose.z:.2f}) is in no room{there}")
        return self._endpoint_at(place, pose)

    def _endpoints_of_word(self, word: str) -> list[Endpoint]:
        topology = self.graph.topology
        if word in topology.places:
            return [self.graph.endpoint(word)]
        found = [self._with_place(entity) for entity in self.lookup.find(word)]
        entities = [e for e in found if e.place in topology.places]
        if found and not entities:
            raise NoRouteError(f"no room holds {found[0].name}: move it into one, or draw its room")
        entities = entities or [
            LocatedEntity(p.name, "room", p.name)
            for p in topology.places.values()
            if word == p.label or word in p.types
        ]
        if not entities:
            raise UnknownPlaceError(word, {*self._names(), *self.lookup.similar_names(word)})
        endpoints: list[Endpoint] = []
        errors: list[NoRouteError] = []
        for entity in entities:
            try:
                endpoints += self._endpoints_of_entity(entity)
            except NoRouteError as error:
                errors.append(error)
        if not endpoints:
            raise NoRouteError(str(errors[0]))
        return endpoints

    def _with_place(self, entity: LocatedEntity) -> LocatedEntity:
        """The entity with the room in which its pose lies, if no room holds it."""
        if entity.place is not None or entity.pose is None:
            return entity
        return replace(entity, place=self.lookup.place_at(entity.pose))

    def _endpoints_of_entity(self, entity: LocatedEntity) -> list[Endpoint]:
        place, costmaps = entity.place, self.costmaps
        if place is None:
            raise NoBasePoseError(f"no room holds {entity.name}")
        if costmaps is None and entity.kind == "region" and entity.footprint is None:
            return [self.graph.endpoint(place, entity.pose)]  # a waypoint: a region without area
        if entity.kind == "room" or costmaps is None:
            return [self.graph.endpoint(place)]
        if entity.kind == "agent" and entity.pose is not None:
            return [self._endpoint_at(place, entity.pose, measured=True)]
        if entity.kind == "region":
            drawn = [self.graph.endpoint(place, p) for p in poses_in(costmaps, entity, self.rng)]
            connected = [e for e in drawn if np.isfinite(e.seconds).any()]
            return (connected or drawn)[:1]
        return [self.graph.endpoint(place, p) for p in poses_to_reach(costmaps, entity)]

    def _endpoint_at(self, place: str, pose: Pose, *, measured: bool = False) -> Endpoint:
        self.graph.topology.place(place)
        if self.costmaps is not None:
            reason = self.costmaps.blocking_reason(place, pose, measured=measured)
            if reason is not None:
                raise NoRouteError(
                    f"{self.graph.robot.name} cannot stand at ({pose.x:.2f}, {pose.y:.2f}) in "
                    f"{place}: {reason}"
                )
        return self.graph.endpoint(place, pose)
