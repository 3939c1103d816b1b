"""A routing graph that follows the map in the database, through its change feed.

Travel is measured again only in affected places. Live fields, such as people whom a camera sees
now, have an effect on travel times, but not on stored ones.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import NamedTuple

from navgrid.policy import NONE, Policy
from navgrid.readers.fields import read_field_versions, read_fields, read_live_versions
from planner.readers.entity_lookup import MapLookup
from planner.readers.robot_class import read_robot_class
from planner.readers.topology import (
    read_astray,
    read_connectors,
    read_kinds,
    read_places,
    read_regions,
)
from planner.readers.travel_times import TravelTimeStore
from planner.robot_class import ASSUMED_BODY, BODY, Durations, RobotClass
from planner.routing_graph import RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import PlaceConnector, Topology
from semmap.garbage import no_garbage_collection
from semmap.query.change_feed import ChangeFeed, Look
from semmap.query.map_handle import MapSource, open_feed
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities, read_scene, read_storey_names
from semmap.query.storey_scene import SceneEntity, StoreyScene

POLL = 1.0  # seconds between looks at live fields, which send no notifications

Progress = Callable[[str, int, int], None]
OnChange = Callable[["TopologyChange"], None]


class TopologyChange(NamedTuple):
    """The changes that a `LiveTopology` has taken over from the map.

    Attributes
    ----------
    reloaded
        Everything was loaded again: the routing graph is a new one.
    places
        The places in which travel was measured again.
    connectors
        The connectors whose passages changed.
    """

    reloaded: bool = False
    places: frozenset[str] = frozenset()
    connectors: frozenset[str] = frozenset()

    def __bool__(self) -> bool:
        """Whether anything changed."""
        return self.reloaded or bool(self.places) or bool(self.connectors)


class LiveTopology:
    """The topology of a map for one class of robots: loaded, and kept up to date.

    Parameters
    ----------
    source
        A `semmap.Map`, or another handle of a map.
    robot
        A class of robots, or the name of one in the database; by default one that has no shape of
        its own.
    progress
        Called with the name of a place that is measured, its number, and the number of places.
    assume_sizes
        Give objects without geometry a typical box for their type. Travel times are measured for
        this topology alone, and not stored.
    body
        Inside of places, a robot without shape has `planner.robot_class.BODY`: it drives around
        obstacles, and needs a free pose at an object. Places without an outline are crossed
        straight. Without it, such a robot is a point, and meets nothing.

    Attributes
    ----------
    graph : RoutingGraph
        As of the last look at the map.
    lookup : MapLookup
        Finds entities of the map.

    Raises
    ------
    LookupError
        There is no such map or class of robots.
    """

    graph: RoutingGraph

    def __init__(
        self,
        source: MapSource,
        robot: str | RobotClass | None = None,
        *,
        progress: Progress | None = None,
        assume_sizes: bool = False,
        body: bool = True,
    ) -> None:
        self._robot = robot
        self._body = body
        self.assume_sizes = assume_sizes
        self._progress = progress
        self._feed: ChangeFeed = open_feed(source)
        self.lookup: MapLookup = MapLookup(self._feed.snapshot)
        self._store: TravelTimeStore | None = None
        self._agents: set[int] = set()
        self._validity: dict[int, list[datetime]] = {}  # when regions become valid or invalid
        self._field_versions: dict[str, tuple[int, int]] = {}
        self._live_versions: dict[str, int] = {}
        self._near_live: set[str] = set()  # places whose travel is not stored now
        self._polled = 0.0
        self._looked: datetime | None = None
        self._warm = False
        self._lock = threading.RLock()
        self.catch_up()

    def snapshot(self) -> AbstractContextManager[Snapshot]:
        """The present state of the map."""
        return self._feed.snapshot()

    @property
    def map_name(self) -> str:
        """The name of the map."""
        name = self._feed.map_name
        assert name is not None  # known from the first look on
        return name

    @property
    def topology(self) -> Topology:
        """The topology, as of the last look at the map."""
        return self.graph.topology

    @property
    def assumed_body(self) -> str | None:
        """Which body is assumed, in words; None for a robot that has a shape, or is a point."""
        return None if self.costmaps is None or self.graph.robot.parts else ASSUMED_BODY

    @property
    def costmaps(self) -> StoreyCostmaps | None:
        """The costmaps; None for a robot that is a point."""
        costs = self.graph.costs
        return costs if isinstance(costs, StoreyCostmaps) else None

    def catch_up(self, on_change: OnChange | None = None) -> TopologyChange:
        """Take over the changes of the map since the last look; the first time, everything.

        `on_change` is called with the changes once `graph` has them, before travel times are
        stored.
        """
        with self._lock:
            with self._feed.look() as look:
                if look.changed is None:
                    change = self._load(look)
                else:
                    ids = look.changed | self._expired(look.moment)
                    change = self._apply(look, ids) if ids else TopologyChange()
                    if not change.reloaded:
                        change = self._apply_fields(look, change)
                change = self._apply_live_fields(look.seen, change)
                if change:
                    if on_change is not None:
                        on_change(change)
                    self._store_travel_times(look, change)
            self._feed.take_in(look)
            self._looked = look.moment
            if self._warm:
                self.warm()
            return change

    def warm(self) -> None:
        """Make all costmaps, now and after each reload: then changes are taken over quickly."""
        with self._lock:
            self._warm = True
            if self.costmaps is not None and not self.costmaps.is_complete():
                self.costmaps.complete()

    def follow(
        self,
        stop: threading.Event,
        on_change: OnChange | None = None,
        *,
        patience: float = 0.2,
    ) -> None:
        """Catch up whenever the map changes, until `stop` is set; `on_change` is as for `catch_up`.

        A restart of the server does not end it. Between looks at `stop`, and between attempts to
        connect, pass `patience` seconds.
        """

        def wake(payloads: tuple[str, ...] | None) -> None:
            if payloads is None:
                self.warm()
                self.catch_up(on_change)
            elif (
                self._expired(datetime.now(UTC))
                or not all(map(self._is_irrelevant, payloads))
                or self._are_live_fields_new()
            ):
                self.catch_up(on_change)

        self._feed.follow(stop, wake, patience=patience)

    def _are_live_fields_new(self) -> bool:
        """Whether live fields changed, began or ended; looks at most once in `POLL` seconds."""
        now = time.monotonic()
        if self.costmaps is None or now < self._polled + POLL:
            return False
        self._polled = now
        with self._feed.snapshot() as seen:
            return _live_versions(seen) != self._live_versions

    def _is_irrelevant(self, payload: str) -> bool:
        """Whether a notification reports nothing but beliefs and agents that moved.

        Anyone can send on the channel: an invalid payload counts as relevant.
        """
        try:
            message = json.loads(payload)
            others = {"added", "changed", "removed", "reshaped", "field"}
            only_moved = not others & message.keys()
            moved = message.get("moved", []) if "belief" in message else message["moved"]
            return only_moved and isinstance(moved, list) and self._agents.issuperset(moved)
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError):
            return False

    def _expired(self, moment: datetime) -> set[int]:
        """The regions that became valid or invalid since the last look."""
        before = self._looked
        if before is None:
            return {*self._validity}
        return {n for n, ends in self._validity.items() if any(before < t <= moment for t in ends)}

    def _load(self, look: Look) -> TopologyChange:
        """Read everything, with the travel times that still hold; measure the others."""
        seen = look.seen
        with no_garbage_collection():
            places = read_places(seen)
            connectors = read_connectors(seen, places)
            regions, validity = read_regions(seen)
            topology = Topology.of(places, connectors, regions, read_astray(seen, connectors))
        robot, durations, store = RobotClass(), Durations(), None
        if isinstance(self._robot, RobotClass):
            robot = self._robot
        elif self._robot is not None:
            read = read_robot_class(seen, self._robot)
            robot, durations = read.robot, read.durations
            store = TravelTimeStore(read) if robot.parts and not self.assume_sizes else None
        costmaps, stored = None, None
        shaped = replace(robot, parts=(BODY,)) if self._body and not robot.parts else robot
        if shaped.parts:
            self._field_versions = read_field_versions(seen)
            costmaps = StoreyCostmaps(
                topology,
                shaped,
                self._read_scene,
                fields=read_fields(seen, live=False),
                straight=not robot.parts,
            )
            if (progress := self._progress) is not None:
                total = len(topology.places)
                costmaps.report_to(lambda place, number: progress(place, number, total))
            if store is not None:
                stored = store.load(seen, topology, some_expire=bool(validity))
        graph = RoutingGraph(topology, robot, costmaps, durations=durations, stored=stored)
        if store is not None:
            store.add(graph.measured)
        self.graph, self._store, self._validity = graph, store, validity
        self._live_versions, self._near_live = {}, set()
        return TopologyChange(reloaded=True)

    def _read_scene(self, storey: str) -> StoreyScene:
        with self._feed.snapshot() as seen:
            name = storey or read_storey_names(seen)[0]
            return read_scene(seen, name, moment=seen.moment, assume_sizes=self.assume_sizes)

    def _store_travel_times(self, look: Look, change: TopologyChange) -> None:
        if self._store is None or self.costmaps is None:
            return
        if not change.reloaded or self._store.is_due:
            self._store.store(look.seen, self.graph, look.cursor, self._near_live)

    def _apply(self, look: Look, ids: Collection[int]) -> TopologyChange:
        """Take over states of connectors, moved objects and regions; load all if more changed."""
        seen = look.seen
        kinds = read_kinds(seen, ids)
        self._agents |= {number for number, kind in kinds.items() if kind == "agent"}
        removed = {number for number in ids if number not in kinds}
        movable = removed | {n for n, kind in kinds.items() if kind in ("object", "region")}
        connectors = {n for n, kind in kinds.items() if kind == "connector"}
        building = {*kinds.values()} & {"room", "storey"}
        if not movable and not connectors and not building:
            return TopologyChange()
        topology = self.topology
        known = {place.id for place in topology.places.values()}
        known |= {connector.id for connector in topology.connectors.values()}
        if (
            building
            or removed & known
            or (self._store is not None and self._store.is_outdated(seen))
            or (movable and self.costmaps is not None and not self.costmaps.is_complete())
        ):
            return self._load(look)
        changed, objects = set(), self._read_objects(seen, movable)
        if self.costmaps is not None and self.costmaps.walls_change(objects, removed):
            return self._load(look)
        if movable:  # on stairs, or a ramp at a step
            connectors |= topology.between_heights
        read = read_connectors(seen, topology.places.values(), connectors)
        if (connectors & known) - {connector.id for connector in read}:
            return self._load(look)  # a door left its rooms
        for connector in read:
            before = topology.connectors.get(connector.name)
            if before is None or _geometry(before) != _geometry(connector):
                return self._load(look)
            if before != connector:
                self.graph.change_connector(connector)
                changed.add(connector.name)
        with_regions = "region" in kinds.values()
        if removed or with_regions:
            regions, self._validity = read_regions(seen)
            self.graph.change_regions(regions)
        places = self._apply_moves(look, movable, objects, with_regions)
        return TopologyChange(places=frozenset(places), connectors=frozenset(changed))

    def _apply_fields(self, look: Look, change: TopologyChange) -> TopologyChange:
        """Measure travel again where fields changed costs."""
        costmaps = self.costmaps
        if costmaps is None:
            return change
        before, now = self._field_versions, read_field_versions(look.seen)
        if now == before:
            return change
        if not costmaps.is_complete():
            return self._load(look)
        changed = [name for name, version in now.items() if before.get(name) != version]
        fields = read_fields(look.seen, changed, live=False)
        removed = dict.fromkeys(before.keys() - now.keys())
        with self._measuring() as places:
            places |= costmaps.set_fields({**removed, **fields})
        if self._store is not None:
            self._store.add(places)
        self._field_versions = now
        return change._replace(places=change.places | places)

    def _apply_live_fields(self, seen: Snapshot, change: TopologyChange) -> TopologyChange:
        """Measure travel again where live fields changed costs; it is stored when they end."""
        costmaps = self.costmaps
        if costmaps is None:
            return change
        before, now = self._live_versions, _live_versions(seen)
        if now == before:
            return change
        fields = read_fields(seen, [n for n, v in now.items() if before.get(n) != v])
        costmaps.make_costmaps_of(fields.values())
        with self._measuring() as places:
            places |= costmaps.set_fields({**dict.fromkeys(before.keys() - now.keys()), **fields})
        self._live_versions, self._near_live = now, costmaps.places_near(now)
        return change._replace(places=change.places | places)

    def _read_objects(self, seen: Snapshot, ids: Collection[int]) -> list[SceneEntity]:
        if not ids or self.costmaps is None:
            return []
        return read_entities(seen, ids, kinds=["object"], assume_sizes=self.assume_sizes)

    def _apply_moves(
        self, look: Look, ids: Collection[int], objects: list[SceneEntity], with_regions: bool
    ) -> set[str]:
        """Measure travel again where objects or regions changed costs; returns these places."""
        costmaps = self.costmaps
        if not ids or costmaps is None:
            return set()
        seen, regions = look.seen, {}
        for storey in costmaps.storeys() if with_regions else ():
            name = storey or read_storey_names(seen)[0]
            regions[storey] = read_entities(
                seen, ids, kinds=["region"], storey=name, moment=seen.moment
            )
        with self._measuring() as places:
            places |= costmaps.update(ids, objects, regions)
        if self._store is not None:
            self._store.add(places)
        return places

    @contextmanager
    def _measuring(self) -> Iterator[set[str]]:
        """Measure the travel again in the places that are put into this set."""
        places: set[str] = set()
        with self.graph.lock:
            yield places
            for place in places:
                self.graph.measure_again(place)


def _live_versions(seen: Snapshot) -> dict[str, int]:
    """The versions of the live fields that have an effect on costs, by name."""
    rule = Policy.default().layer_of_field
    live = read_live_versions(seen)
    return {n: version for n, (what, version) in live.items() if rule(what) not in (None, NONE)}


def _geometry(connector: PlaceConnector) -> tuple[object, ...]:
    """The values of a connector on which the travel to it depends."""
    return connector.places, connector.poses, connector.width
