"""A topology that follows the map in the database, with its travel times for a class of robots.

Travel times are kept in the database, so that loading is cheap, and measured anew where the map
changed: a NOTIFY wakes, and what changed is read from the history by a cursor.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import psycopg
from numpy.typing import NDArray
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError

from navgrid.scene import Scene
from navgrid.source import changes_since, cursor, read_things
from planner import source
from planner.ask import Asker
from planner.ground import Ground
from planner.network import KeptWalks, Network
from planner.robot_class import RobotClass
from planner.rules import Rules
from planner.target import Target
from planner.times import Times
from planner.topology import OUTSIDE, Topology
from semmap.geometry.pose import Pose

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
    topology, network, ground : as they are since the last look; no ground for a robot without shape
    """

    topology: Topology
    network: Network
    ground: Ground | None

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
        self._map_name = map_name
        self._robot = robot
        self._rules = rules or Rules.default()
        self._progress = progress
        self._since: str | None = None
        self._id: int | None = None
        self._lock = threading.RLock()
        self.catch_up()

    def asker(self, robot: str | RobotClass | None = None) -> Asker:
        """What answers questions about routes, for this class of robots or another."""
        if robot is not None and robot not in (self._robot, self.network.robot):
            return Live(self._engine, self._map_name, robot, rules=self._rules).asker()
        return Asker(self.network, self._look_up, self._place_at, self.ground, self._rules)

    def catch_up(self) -> Changed:
        """Take in what changed since the last look, all the first time."""
        with self._lock, self._snapshot() as connection:
            now = cursor(connection)
            ids = [] if self._since is None else changes_since(connection, self._since)[0]
            if self._since is None:
                changed = self._load(connection, now)
            elif ids:
                changed = self._take_in(connection, ids, now)
            else:
                changed = Changed()
            connection.commit()
            self._since = now
            return changed

    def warm(self) -> None:
        """Make the costmaps of all storeys, so that changes are taken in at once."""
        if self.ground is None:
            return
        with self._lock:
            for place in self.topology.places:
                if place != OUTSIDE:
                    self.ground.room(place)

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
        self.warm()
        while not stop.is_set():
            try:
                with self._engine.connect() as connection:
                    driver = connection.connection.driver_connection
                    assert isinstance(driver, psycopg.Connection)
                    driver.autocommit = True
                    driver.execute("LISTEN semmap")
                    self._tell(heard)
                    while not stop.is_set():
                        if any(True for _ in driver.notifies(timeout=patience, stop_after=1)):
                            self._tell(heard)
                    driver.execute("UNLISTEN semmap")
                    driver.autocommit = False
            except (psycopg.OperationalError, DBAPIError):
                stop.wait(patience)  # the server is away; the cursor knows where we were

    def _tell(self, heard: Callable[[Changed], None] | None) -> None:
        changed = self.catch_up()
        if changed and heard is not None:
            heard(changed)

    # -- loading --------------------------------------------------------------------------------

    def _load(self, connection: Connection, now: str) -> Changed:
        """All of it: walks that still hold from the database, the others measured and kept."""
        self.topology = replace(source.read_topology(connection), asker=self.asker)
        robot, times = RobotClass(), Times()
        if isinstance(self._robot, RobotClass):
            robot = self._robot
        elif self._robot is not None:
            self._id, robot, times = source.read_robot_class(connection, self._robot)
        self.ground, kept = None, None
        digests: dict[int, str] = {}
        if robot.parts:
            self.ground = Ground(self.topology, robot, self._read_scene)
            if self._id is not None:
                kept, digests = self._kept(connection, robot)
        total = len(self.topology.places)
        if self._progress is not None and self.ground is not None:
            self.ground.tell(lambda place, n: self._progress and self._progress(place, n, total))
        self.network = Network(self.topology, robot, times=times, walks=self.ground, kept=kept)
        if self._id is not None and self.ground is not None:
            places = [p for p in self.network.measured if p != OUTSIDE]
            if places and not digests:
                digests = source.place_digests(connection, _reach(robot))
            if digests:
                self._keep(connection, places, now, digests)
        return Changed(all=True)

    def _kept(
        self, connection: Connection, robot: RobotClass
    ) -> tuple[KeptWalks | None, dict[int, str]]:
        """The walks that still hold, and the state of places, where it had to be looked at."""
        assert self._id is not None
        until = source.walked_until(connection, self._id)
        if until is None:
            return None, {}
        rows = source.read_walks(connection, self._id)
        digests: dict[int, str] = {}
        if self._changed_things(connection, changes_since(connection, until)[0]):
            digests = source.place_digests(connection, _reach(robot))
            measured = source.walked_digests(connection, self._id)
            valid = [number for number, digest in digests.items() if measured.get(number) == digest]
            rows = rows[np.isin(rows["place"], valid)]
        return self._as_nodes(rows), digests

    def _changed_things(self, connection: Connection, ids: Collection[int]) -> bool:
        """Whether any of these is, or was, what walks depend on: all but agents and states."""
        if not ids:
            return False
        kinds = source.read_kinds(connection, ids)
        return any(kinds.get(number) not in ("agent", "elevator") for number in ids)

    def _as_nodes(self, rows: NDArray[Any]) -> KeptWalks:
        """Walks between connectors by ids, as walks between stands, in both directions."""
        topology = self.topology
        connectors = [*topology.connectors.values()]
        places = {p.name: p.id for p in topology.places.values()}
        ids = np.array([c.id for c in connectors], np.int64)
        first = np.array([places.get(c.places[0]) or -1 for c in connectors], np.int64)
        order = np.argsort(ids)
        known = np.isin(rows["a"], ids) & np.isin(rows["b"], ids)
        rows = rows[known]
        a, b = (order[np.searchsorted(ids, rows[k], sorter=order)] for k in ("a", "b"))
        a, b = (2 * k + (first[k] != rows["place"]) for k in (a, b))
        seconds, metres = (rows[k].astype(np.float64) for k in ("seconds", "metres"))
        both = (np.concatenate([a, b]), np.concatenate([b, a]))
        return KeptWalks(*both, np.concatenate([seconds] * 2), np.concatenate([metres] * 2))

    # -- changes --------------------------------------------------------------------------------

    def _take_in(self, connection: Connection, ids: Collection[int], now: str) -> Changed:
        """Connectors' states and moved things; whatever else changed, all is loaded anew."""
        kinds = source.read_kinds(connection, ids)
        structure = {p.id for p in self.topology.places.values()}
        structure |= {c.id for c in self.topology.connectors.values()}
        gone = [number for number in ids if number not in kinds]
        connectors = [number for number, kind in kinds.items() if kind == "connector"]
        if structure.intersection(gone) or {*kinds.values()} & {"room", "storey", "region"}:
            return self._load(connection, now)
        told = set()
        for connector in source.read_connectors(
            connection, self.topology.places.values(), connectors
        ):
            before = self.topology.connectors.get(connector.name)
            if before is None or (before.places, before.poses) != (
                connector.places,
                connector.poses,
            ):
                return self._load(connection, now)
            if before != connector:
                self.network.change_connector(connector)
                told.add(connector.name)
        things = [number for number, kind in kinds.items() if kind == "object"]
        places: set[str] = set()
        if (things or gone) and self.ground is not None:
            if not self.ground.is_whole():
                return self._load(connection, now)
            places = self.ground.update(read_things(connection, things), gone)
            for place in places:
                self.network.change_walks(place)
            if self._id is not None:
                numbers = [p.id for n in places if (p := self.topology.places[n]).id is not None]
                self._keep(connection, places, now, dict.fromkeys(numbers, ""))
        return Changed(places=frozenset(places), connectors=frozenset(told))

    def _keep(
        self, connection: Connection, places: Collection[str], now: str, digests: dict[int, str]
    ) -> None:
        """Keep the walks of places, unless another process is at it, or we may not."""
        assert self._id is not None
        allowed = connection.execute(
            text("SELECT has_table_privilege('walk', 'INSERT, DELETE') "
                 "AND pg_try_advisory_xact_lock(hashtext('semmap walks'), :id)"),
            {"id": self._id},
        ).scalar()  # fmt: skip
        if not allowed:
            return
        network = self.network
        numbers = {p.name: p.id for p in self.topology.places.values()}
        walks = []
        for place in places:
            number = numbers[place]
            edges = network.walk_edges.get(place, slice(0, 0))
            for edge in range(edges.start, edges.stop):
                a, b = (network.connectors[n[edge] // 2].id for n in (network.tails, network.heads))
                if number is not None and a is not None and b is not None and a < b:
                    seconds, metres = float(network.base[edge]), float(network.metres[edge])
                    walks.append(source.Walk(number, a, b, seconds, metres))
        kept = {numbers[p]: digests.get(numbers[p] or -1, "") for p in places}
        source.keep_walks(
            connection, self._id, walks, {n: d for n, d in kept.items() if n is not None}
        )
        source.keep_walked_until(connection, self._id, now)

    # -- the database ---------------------------------------------------------------------------

    def _read_scene(self, storey: str) -> Scene:
        with self._snapshot() as connection:
            return source.scene_of(connection, storey)

    def _look_up(self, said: str) -> list[Target]:
        with self._snapshot() as connection:
            return source.read_targets(connection, said)

    def _place_at(self, pose: Pose) -> str | None:
        with self._snapshot() as connection:
            return source.read_place_at(connection, pose)

    @contextmanager
    def _snapshot(self) -> Iterator[Connection]:
        """A transaction on the map that sees one state of the database."""
        options = {"isolation_level": "REPEATABLE READ"}
        with self._engine.connect().execution_options(**options) as connection:
            if self._map_name is None:
                self._map_name = connection.execute(
                    text("SELECT name FROM map WHERE id = current_map()")
                ).scalar()
                if self._map_name is None:
                    raise LookupError("there is no map: semmap import FILE makes one")
            connection.execute(
                text("SELECT set_config('semmap.map', :name, true)"), {"name": self._map_name}
            )
            yield connection


def _reach(robot: RobotClass) -> float:
    """Metres beyond a place from which things have an effect in it."""
    return max(part.radius for part in robot.parts) + 1.0
