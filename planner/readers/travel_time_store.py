"""The stored travel times of one class of robots: which still hold, and which must be stored."""

from __future__ import annotations

from collections.abc import Collection, Iterable

import numpy as np
from sqlalchemy.exc import IntegrityError, OperationalError

from planner.measured_travel import as_travel_edges, travel_in_places
from planner.readers.robot_class import StoredRobotClass, read_robot_class_digest
from planner.readers.topology import read_kinds
from planner.readers.travel_times import (
    compute_place_digests,
    may_store_travel_times,
    read_place_digests,
    read_travel_times,
    store_measured_until,
    store_travel_times,
)
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Topology
from planner.travel_edges import TravelEdges
from semmap.query.snapshot import Snapshot


class TravelTimeStore:
    """Loads and stores the travel times of a class of robots, which was read before."""

    def __init__(self, stored: StoredRobotClass) -> None:
        self._class = stored
        self._unstored: set[str] = set()
        self._compared = False

    def is_outdated(self, seen: Snapshot) -> bool:
        """Whether the class was stored with other values, or deleted, since it was read."""
        return self._class.digest != read_robot_class_digest(seen, self._class.id)

    def load(self, seen: Snapshot, topology: Topology, *, some_expire: bool) -> TravelEdges | None:
        """The travel edges that still hold; None if none are stored.

        If anything changed that travel depends on, or the validity of some regions ends or begins
        at a known moment, only the edges of places with the same digest hold.
        """
        rows = read_travel_times(seen, self._class.id)
        unmeasured = self._class.unmeasured
        if unmeasured is None and not len(rows):
            return None
        self._compared = (
            some_expire
            or unmeasured is None
            or self._class.fields_changed
            or _affects_travel(seen, unmeasured)
        )
        if self._compared:
            digests = compute_place_digests(seen, _reach(self._class.robot))
            measured = read_place_digests(seen, self._class.id)
            valid = [number for number, digest in digests.items() if measured.get(number) == digest]
            rows = rows[np.isin(rows["place"], valid)]
        return as_travel_edges(topology, rows)

    def add(self, places: Iterable[str]) -> None:
        """The travel in these places was measured, and must be stored."""
        self._unstored |= {*places} - {OUTSIDE}

    @property
    def is_due(self) -> bool:
        """Whether there is something to store after loading."""
        return bool(self._unstored) or self._compared

    def store(
        self,
        seen: Snapshot,
        graph: RoutingGraph,
        cursor: str,
        but: Collection[str] = (),
    ) -> None:
        """Store the travel in all places that were added, as measured up to a cursor.

        Places of `but` wait: something that is not stored has an effect on their travel now. If
        another process stores travel times at the same time, or this login has no right to, nothing
        is stored: the next call tries again.
        """
        try:
            with seen.connection.begin_nested():
                if may_store_travel_times(seen, self._class.id, self._class.digest):
                    waiting = self._unstored & {*but}
                    self._write(seen, graph, self._unstored - waiting)
                    if not waiting:
                        store_measured_until(seen, self._class.id, cursor)
                    self._unstored = waiting
        except (OperationalError, IntegrityError):
            return  # another process has stored some since this transaction began

    def _write(self, seen: Snapshot, graph: RoutingGraph, places: set[str]) -> None:
        numbers = [n for p in places if (n := graph.topology.places[p].id) is not None]
        if numbers:
            digests = compute_place_digests(seen, _reach(graph.robot), numbers)
            travel = travel_in_places(graph, places)
            store_travel_times(seen, self._class.id, travel, digests)


def _affects_travel(seen: Snapshot, ids: Collection[int]) -> bool:
    """Whether any of these entities is, or was, of a kind that travel depends on."""
    if not ids:
        return False
    kinds = read_kinds(seen, ids)
    return any(kinds.get(number) not in ("agent", "elevator") for number in ids)


def _reach(robot: RobotClass) -> float:
    """Metres beyond a place within which objects have an effect in it."""
    return max(part.circumscribed_radius for part in robot.parts) + 1.0
