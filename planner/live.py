"""A topology that follows the map in the database, with its travel times for a class of robots.

Travel times are kept in the database, so that loading is cheap, and measured anew where the map
changed: a NOTIFY wakes, and what changed is read from the history by a cursor.
"""

from __future__ import annotations

import gc
import json
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import IntegrityError, OperationalError

from planner.ask import Asker
from planner.ground import Ground
from planner.network import KeptWalks, Network
from planner.robot_class import RobotClass
from planner.rules import Rules
from planner.source.meant import read_names_like, read_place_at, read_targets
from planner.source.robot_class import class_state, read_robot_class
from planner.source.scenes import read_objects, read_regions_on, scene_of
from planner.source.topology import (
    read_connectors,
    read_kinds,
    read_places,
    read_regions,
)
from planner.source.walks import (
    Walk,
    keep_walked_until,
    keep_walks,
    may_keep,
    place_digests,
    read_walks,
    walked_digests,
)
from planner.target import Target
from planner.times import Times
from planner.topology import OUTSIDE, Connector, Topology
from semmap.geometry.pose import Pose
from semmap.query.change_feed import ChangeFeed
from semmap.query.storey_scene import StoreyScene

__all__ = ["Changed", "Live"]

Progress = Callable[[str, int, int], None]


class Changed(NamedTuple):
    """What a look at the map found changed: everything, or the walks in places and connectors."""

    all: bool = False
    places: frozenset[str] = frozenset()
    connectors: frozenset[str] = frozenset()

    def __bool__(self) -> bool:
        return self.all or bool(self.places) or bool(self.connectors)


class Live:
    """The topology of a map, as it is now.

    Parameters
    ----------
    robot : name of a class of robots in the database, or one; without, one that has no shape
    map_name : the newest map if not given
    progress : called with a place and how many of how many are measured

    Attributes
    ----------
    topology, network : as they are since the last look
    """

    topology: Topology
    network: Network

    def __init__(
        self,
        engine: Engine,
        map_name: str | None = None,
        robot: str | RobotClass | None = None,
        *,
        rules: Rules | None = None,
        progress: Progress | None = None,
    ) -> None:
        self._engine = engine
        self._robot = robot
        self._rules = rules or Rules.default()
        self._progress = progress
        self._feed = ChangeFeed(engine, map_name, durable=False)
        self._id: int | None = None
        self._class_state: str | None = None
        self._agents: set[int] = set()
        self._timed: dict[int, list[datetime]] = {}
        self._looked: datetime | None = None
        self._owed: set[str] = set()
        self._warm = False
        self._lock = threading.RLock()
        self._compared = False
        self.catch_up()

    @property
    def ground(self) -> Ground | None:
        """The costmaps; None for a robot without shape."""
        walks = self.network.walks
        return walks if isinstance(walks, Ground) else None

    def asker(self, robot: str | RobotClass | None = None) -> Asker:
        """What answers questions about routes, for this class of robots or another."""
        if robot is not None and robot not in (self._robot, self.network.robot):
            return Live(self._engine, self._feed.map_name, robot, rules=self._rules).asker()
        network = self.network  # with its ground, though another thread may load anew
        ground = network.walks if isinstance(network.walks, Ground) else None
        return Asker(
            network, self._look_up, self._place_at, ground, self._rules, names_like=self._names_like
        )

    def catch_up(self, heard: Callable[[Changed], None] | None = None) -> Changed:
        """Take in what changed since the last look, all the first time.

        Parameters
        ----------
        heard : called with what changed as soon as the network has it, before walks are kept
        """
        with self._lock:
            with self._feed.look() as look:
                if look.changed is None:
                    changed = self._load(look.connection)
                else:
                    ids = look.changed | self._expired(look.moment)
                    changed = self._take_in(look.connection, ids) if ids else Changed()
                if changed:
                    if heard is not None:
                        heard(changed)
                    if not changed.all or self._owed or self._compared:
                        self._keep(look.connection, look.cursor)
            self._feed.take_in(look)
            self._looked = look.moment
            if self._warm:
                self.warm()
            return changed

    def _expired(self, moment: datetime) -> set[int]:
        """The regions that began or ceased to hold since the last look."""
        before = self._looked
        if before is None:
            return {*self._timed}
        return {n for n, ends in self._timed.items() if any(before < t <= moment for t in ends)}

    def warm(self) -> None:
        """Make the costmaps of all storeys, now and after each load: changes are then fast."""
        with self._lock:
            self._warm = True
            ground = self.ground
            if ground is not None and not ground.is_whole():
                for place in self.topology.places:
                    if place != OUTSIDE:
                        ground.room(place)

    def follow(
        self,
        stop: threading.Event,
        heard: Callable[[Changed], None] | None = None,
        *,
        patience: float = 0.2,
    ) -> None:
        """Follow the database until told to stop, through its restarts, too.

        Parameters
        ----------
        heard : called with what changed, after it is taken in
        patience : seconds between looks whether to stop, and before another try to connect
        """

        def wake(payloads: tuple[str, ...] | None) -> None:
            if payloads is None:
                self.warm()
                self.catch_up(heard)
            elif self._expired(datetime.now(UTC)) or not all(map(self._is_idle, payloads)):
                self.catch_up(heard)

        self._feed.follow(stop, wake, patience=patience)

    def _is_idle(self, payload: str) -> bool:
        """Whether a message tells of nothing but agents that moved.

        Anybody can send on the channel: what is not such a message tells of any change.
        """
        try:
            said = json.loads(payload)
            only = not {"added", "changed", "removed", "reshaped"} & said.keys()
            moved = said["moved"]
            return only and isinstance(moved, list) and self._agents.issuperset(moved)
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError):
            return False

    # -- loading --------------------------------------------------------------------------------

    def _load(self, connection: Connection) -> Changed:
        """All of it: walks that still hold from the database, the others measured and kept."""
        with _no_collection():
            places = read_places(connection)
            connectors = read_connectors(connection, places)
            regions, self._timed = read_regions(connection)
            topology = replace(Topology.of(places, connectors, regions), asker=self.asker)
        robot, times, unwalked = RobotClass(), Times(), None
        if isinstance(self._robot, RobotClass):
            robot = self._robot
        elif self._robot is not None:
            self._id, robot, times, self._class_state, unwalked = read_robot_class(
                connection, self._robot
            )
        ground, kept = None, None
        if robot.parts:
            ground = Ground(topology, robot, self._read_scene)
            if self._id is not None:
                kept = self._kept(connection, topology, robot, unwalked)
        total = len(topology.places)
        if self._progress is not None and ground is not None:
            ground.tell(lambda place, n: self._progress and self._progress(place, n, total))
        network = Network(topology, robot, times=times, walks=ground, kept=kept)
        self.topology, self.network = topology, network
        self._owed = {p for p in network.measured if p != OUTSIDE}
        return Changed(all=True)

    def _kept(
        self,
        connection: Connection,
        topology: Topology,
        robot: RobotClass,
        unwalked: Collection[int] | None,
    ) -> KeptWalks | None:
        """The walks that still hold: all of them, or where places are as they were."""
        assert self._id is not None
        rows = read_walks(connection, self._id)
        if unwalked is None and not len(rows):
            return None
        self._compared = bool(
            self._timed or unwalked is None or self._changed_things(connection, unwalked)
        )
        if self._compared:
            digests = place_digests(connection, _reach(robot))
            measured = walked_digests(connection, self._id)
            valid = [number for number, digest in digests.items() if measured.get(number) == digest]
            rows = rows[np.isin(rows["place"], valid)]
        return _as_nodes(topology, rows)

    def _changed_things(self, connection: Connection, ids: Collection[int]) -> bool:
        """Whether any of these is, or was, what walks depend on: all but agents and states."""
        if not ids:
            return False
        kinds = read_kinds(connection, ids)
        return any(kinds.get(number) not in ("agent", "elevator") for number in ids)

    # -- changes --------------------------------------------------------------------------------

    def _take_in(self, connection: Connection, ids: Collection[int]) -> Changed:
        """Connectors' states and moved things; whatever else changed, all is loaded anew."""
        kinds = read_kinds(connection, ids)
        self._agents |= {number for number, kind in kinds.items() if kind == "agent"}
        structure = {p.id for p in self.topology.places.values()}
        structure |= {c.id for c in self.topology.connectors.values()}
        gone = {number for number in ids if number not in kinds}
        things = gone | {n for n, kind in kinds.items() if kind in ("object", "region")}
        connectors = {n for n, kind in kinds.items() if kind == "connector"}
        if not things and not connectors and not {*kinds.values()} & {"room", "storey"}:
            return Changed()
        if (
            structure & gone
            or {*kinds.values()} & {"room", "storey"}
            or (self._id is not None and self._class_state != class_state(connection, self._id))
            or (self.ground is not None and things and not self.ground.is_whole())
        ):
            return self._load(connection)
        told = set()
        for connector in read_connectors(connection, self.topology.places.values(), connectors):
            before = self.topology.connectors.get(connector.name)
            if before is None or _shape(before) != _shape(connector):
                return self._load(connection)
            if before != connector:
                self.network.change_connector(connector)
                told.add(connector.name)
        if gone or "region" in kinds.values():
            self._take_in_regions(connection)
        places = self._take_in_things(connection, things, "region" in kinds.values())
        self._owed |= places
        return Changed(places=frozenset(places), connectors=frozenset(told))

    def _take_in_regions(self, connection: Connection) -> None:
        regions, self._timed = read_regions(connection)
        self.topology = replace(self.topology, regions=tuple(regions))
        self.network.topology = self.topology
        if self.ground is not None:
            self.ground.topology = self.topology

    def _take_in_things(
        self, connection: Connection, ids: Collection[int], with_regions: bool
    ) -> set[str]:
        """Measure where objects or regions changed; the places whose costs are others now."""
        if not ids or self.ground is None:
            return set()
        storeys = self.ground.storeys() if with_regions else []
        regions = {s: read_regions_on(connection, s, ids) for s in storeys}
        objects = read_objects(connection, ids)
        with self.network.lock:
            places = self.ground.update(ids, objects, regions)
            for place in places:
                self.network.change_walks(place)
        return places

    def _keep(self, connection: Connection, now: str) -> None:
        """Keep walks that were measured; next time, if another process is at it just now."""
        if self._id is None or self.ground is None:
            return
        try:
            with connection.begin_nested():
                if may_keep(connection, self._id, self._class_state):
                    self._write(connection, self._id, now)
                    self._owed.clear()
        except (OperationalError, IntegrityError):
            return  # another has kept walks since this transaction began

    def _write(self, connection: Connection, robot_class: int, now: str) -> None:
        network = self.network
        numbers = {
            place: number
            for place in self._owed
            if (number := self.topology.places[place].id) is not None
        }
        walks = []
        for place, number in numbers.items():
            edges = network.walk_edges.get(place, slice(0, 0))
            for edge in range(edges.start, edges.stop):
                a, b = (network.connectors[n[edge] // 2].id for n in (network.tails, network.heads))
                if a is not None and b is not None and a < b:
                    seconds, metres = float(network.base[edge]), float(network.metres[edge])
                    walks.append(Walk(number, a, b, seconds, metres))
        if numbers:
            reach = _reach(network.robot)
            digests = place_digests(connection, reach, [*numbers.values()])
            keep_walks(connection, robot_class, walks, digests)
        keep_walked_until(connection, robot_class, now)

    # -- the database ---------------------------------------------------------------------------

    def _read_scene(self, storey: str) -> StoreyScene:
        with self._feed.snapshot() as connection:
            return scene_of(connection, storey)

    def _look_up(self, said: str) -> list[Target]:
        with self._feed.snapshot() as connection:
            return read_targets(connection, said)

    def _names_like(self, said: str) -> list[str]:
        with self._feed.snapshot() as connection:
            return read_names_like(connection, said)

    def _place_at(self, pose: Pose) -> str | None:
        with self._feed.snapshot() as connection:
            return read_place_at(connection, pose)


@contextmanager
def _no_collection() -> Iterator[None]:
    """While thousands of objects are made that stay, nobody looks for garbage among all there are.

    It would take a tenth of loading 1,000 rooms, and every few times as long as loading itself.
    """
    usual = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if usual:
            gc.enable()


def _reach(robot: RobotClass) -> float:
    """Metres beyond a place from which things have an effect in it."""
    return max(part.radius for part in robot.parts) + 1.0


def _shape(connector: Connector) -> tuple[object, ...]:
    """What of a connector decides how long the walks to it are."""
    return connector.places, connector.poses, connector.width


def _as_nodes(topology: Topology, rows: NDArray[Any]) -> KeptWalks:
    """Walks between connectors by ids, as walks between stands, in both directions."""
    connectors = [*topology.connectors.values()]
    places = {p.name: p.id for p in topology.places.values()}
    ids = np.array([c.id for c in connectors], np.int64)
    first = np.array([places.get(c.places[0]) or -1 for c in connectors], np.int64)
    if not len(ids):
        rows = rows[:0]
    order = np.argsort(ids)
    ends = np.stack([rows["a"], rows["b"]])
    numbers = order[np.searchsorted(ids, ends, sorter=order).clip(max=len(ids) - 1)]
    known = (ids[numbers] == ends).all(axis=0)
    numbers, rows = numbers[:, known], rows[known]
    tails = 2 * numbers + (first[numbers] != rows["place"])
    seconds, metres = np.tile(rows["seconds"], 2), np.tile(rows["metres"], 2)
    return KeptWalks(tails.reshape(-1), tails[::-1].reshape(-1), seconds, metres)
