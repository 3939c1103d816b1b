"""The stored travel times of a class of robots: which still hold, and which must be stored.

Why: docs/decisions/travel_times_are_stored_with_a_digest_and_a_cursor.md
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from functools import cache
from hashlib import md5
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError, OperationalError

from planner.graph_edges import TravelEdges
from planner.readers.robot_class import StoredRobotClass, read_robot_class_digest
from planner.readers.rows import fetch_rows
from planner.readers.topology import read_kinds
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.topology import OUTSIDE, Topology
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import CARRIED

RULE = 4
"""Of how travel is measured: stored times of another rule, or of another policy, do not hold."""


class MeasuredTravel(NamedTuple):
    """The travel in a place between the approach poses of two connectors, either way.

    The place and the connectors are ids, a < b; seconds and metres are infinite if no path leads
    there.
    """

    place: int
    a: int
    b: int
    seconds: float
    metres: float


def travel_in_places(graph: RoutingGraph, places: Iterable[str]) -> Iterator[MeasuredTravel]:
    """The travel that a graph has in places; places and connectors without an id are left out."""
    for place in places:
        number = graph.topology.places[place].id
        edges = graph.travel_edges.get(place, slice(0, 0))
        if number is None:
            continue
        for edge in range(edges.start, edges.stop):
            a, b = (graph.connectors[n[edge] // 2].id for n in (graph.tails, graph.heads))
            if a is not None and b is not None and a < b:
                seconds, metres = float(graph.base[edge]), float(graph.metres[edge])
                yield MeasuredTravel(number, a, b, seconds, metres)


def as_travel_edges(topology: Topology, travel: NDArray[Any]) -> TravelEdges:
    """Edges, in both directions, from an array (n,) with the fields of `MeasuredTravel`.

    Unknown connectors are left out.
    """
    connectors = [*topology.connectors.values()]
    places = {p.name: p.id for p in topology.places.values()}
    ids = np.array([c.id for c in connectors], np.int64)
    first = np.array([places.get(c.places[0]) or -1 for c in connectors], np.int64)
    if not len(ids):
        travel = travel[:0]
    order = np.argsort(ids)
    ends = np.stack([travel["a"], travel["b"]])
    numbers = order[np.searchsorted(ids, ends, sorter=order).clip(max=len(ids) - 1)]
    known = (ids[numbers] == ends).all(axis=0)
    numbers, travel = numbers[:, known], travel[known]
    nodes = 2 * numbers + (first[numbers] != travel["place"])
    seconds, metres = np.tile(travel["seconds"], 2), np.tile(travel["metres"], 2)
    return TravelEdges(nodes.reshape(-1), nodes[::-1].reshape(-1), seconds, metres)


_PACKED = np.dtype(
    [("place", ">i8"), ("a", ">i8"), ("b", ">i8"), ("seconds", ">f8"), ("metres", ">f8")]
)
"""A row as the column `packed` has it."""

_READ = "SELECT coalesce(string_agg(packed, ''), '') FROM travel_time WHERE robot_class_id = %s"

_INSERT = """
INSERT INTO travel_time (robot_class_id, place_id, from_id, to_id, seconds, metres)
SELECT :robot, * FROM unnest(CAST(:place AS bigint[]), CAST(:a AS bigint[]), CAST(:b AS bigint[]),
                             CAST(:seconds AS float8[]), CAST(:metres AS float8[]))
"""

_INSERT_PLACES = """
INSERT INTO travel_time_place
SELECT :robot, * FROM unnest(CAST(:places AS bigint[]), CAST(:digests AS text[]))
"""

_INSERT_MAP = """
INSERT INTO travel_time_map VALUES (:robot, current_map(), :cursor)
ON CONFLICT (robot_class_id, map_id) DO UPDATE SET cursor = EXCLUDED.cursor
"""

_DIGESTS = f"""
{CARRIED}
SELECT r.entity_id AS id, md5(concat_ws('|',
    (SELECT string_agg(concat_ws(',', c.entity_id, c.place_a, c.place_b, k.pose, c.pose_a, c.pose_b,
                                 c.width, c.form), ';' ORDER BY c.entity_id)
     FROM connector c JOIN world k ON k.entity_id = c.entity_id
     WHERE c.place_a = r.entity_id OR c.place_b = r.entity_id),
    (SELECT string_agg(concat_ws(',', e.id, e.type, e.properties, o.pose, g.valid,
                       (SELECT string_agg(em.model_id::text, ' ' ORDER BY em.model_id)
                        FROM entity_model em WHERE em.entity_id = e.id)), ';' ORDER BY e.id)
     FROM world o JOIN entity e ON e.id = o.entity_id LEFT JOIN region g ON g.entity_id = e.id
     WHERE e.map_id = current_map() AND e.kind IN ('room', 'object', 'region')
       AND (g.valid IS NULL OR g.valid @> now()) AND e.id NOT IN (SELECT id FROM carried)
       AND o.box && ST_Expand(w.box, :reach)
       AND (o.storey_id IS NULL OR o.storey_id IS NOT DISTINCT FROM w.storey_id
            OR e.kind = 'object')),
    (SELECT string_agg(concat_ws(',', f.property, f.voxel_size, v.placement, b.x, b.y, b.z,
                                 encode(b.digest, 'hex')), ';' ORDER BY f.name, b.x, b.y, b.z)
     FROM field f JOIN field_version v ON v.field_id = f.id AND v.version = f.version
     JOIN field_block b ON b.field_id = f.id AND b.until IS NULL
     WHERE f.map_id = current_map() AND v.state IS NULL
       AND (v.placement <> '{{1,0,0,0,0,1,0,0,0,0,1,0}}'
            OR ST_MakeEnvelope(b.x * f.voxel_size, b.y * f.voxel_size,
                               (b.x + f.edge) * f.voxel_size, (b.y + f.edge) * f.voxel_size)
               && ST_Expand(w.box, :reach)))
    )) AS digest
FROM room r JOIN world w ON w.entity_id = r.entity_id
JOIN entity n ON n.id = r.entity_id AND n.map_id = current_map()
WHERE CAST(:places AS bigint[]) IS NULL OR r.entity_id = ANY (:places)
"""

_OTHER_RULES = """
SELECT EXISTS (
    SELECT FROM travel_time_place p JOIN entity n ON n.id = p.place_id AND n.map_id = current_map()
    WHERE p.robot_class_id = :robot AND NOT starts_with(p.digest, :rule)
      AND EXISTS (SELECT FROM travel_time t
                  WHERE t.robot_class_id = p.robot_class_id AND t.place_id = p.place_id))
"""

_MAY_WRITE = """
SELECT has_table_privilege('travel_time', 'INSERT') AND has_table_privilege('travel_time', 'DELETE')
       AND NOT pg_is_in_recovery() AND current_setting('transaction_read_only') = 'off'
"""

_LOCK = "SELECT pg_try_advisory_xact_lock(hashtext('semmap travel times'), :id)"


def read_travel_times(seen: Snapshot, robot_class: int) -> NDArray[Any]:
    """(n,) the travel times of a class in all maps, with the fields of `MeasuredTravel`."""
    rows = np.frombuffer(fetch_rows(seen, _READ, (robot_class,))[0][0], _PACKED)
    return rows.astype(_PACKED.newbyteorder("="))


def store_travel_times(
    seen: Snapshot, robot_class: int, travel: Iterable[MeasuredTravel], digests: dict[int, str]
) -> None:
    """Replace the travel times in the places, by id, that have these digests."""
    places = {"robot": robot_class, "places": [*digests]}
    where = "WHERE robot_class_id = :robot AND place_id = ANY (:places)"
    seen.connection.execute(text(f"DELETE FROM travel_time {where}"), places)
    seen.connection.execute(text(f"DELETE FROM travel_time_place {where}"), places)
    rows = [*travel]
    columns = {k: [getattr(row, k) for row in rows] for k in MeasuredTravel._fields}
    seen.connection.execute(text(_INSERT), {"robot": robot_class, **columns})
    seen.connection.execute(text(_INSERT_PLACES), places | {"digests": [*digests.values()]})


def compute_place_digests(
    seen: Snapshot, reach: float, places: Collection[int] | None = None
) -> dict[int, str]:
    """The digest of the present state of each place of the current map, or of some, by id.

    It covers all that travel in the place depends on: objects up to `reach` metres beyond it, and
    the rule of measuring, too.
    """
    values = {"reach": reach, "places": None if places is None else [*places]}
    rows = seen.connection.execute(text(_DIGESTS), values)
    return {row.id: _rule() + row.digest for row in rows}


def read_place_digests(seen: Snapshot, robot_class: int) -> dict[int, str]:
    """The digests for which the stored travel times were measured, by id of the place."""
    rows = seen.connection.execute(
        text("SELECT place_id, digest FROM travel_time_place WHERE robot_class_id = :robot"),
        {"robot": robot_class},
    )
    return {row.place_id: row.digest for row in rows}


def store_measured_until(seen: Snapshot, robot_class: int, cursor: str) -> None:
    """Store up to which change the travel times in the current map are measured."""
    seen.connection.execute(text(_INSERT_MAP), {"robot": robot_class, "cursor": cursor})


def may_store_travel_times(seen: Snapshot, robot_class: int, digest: str | None) -> bool:
    """Whether this transaction may store travel times of a class of robots.

    It may if it has the right to write, if the class still has this digest, and if no other
    transaction stores travel times of the class, which is then locked until the transaction ends.
    Raises OperationalError if another transaction has just changed the class.
    """
    allowed = seen.connection.execute(text(_MAY_WRITE)).scalar()
    if not allowed or digest != read_robot_class_digest(seen, robot_class):
        return False
    values = {"id": robot_class}
    seen.connection.execute(text("SELECT FROM robot_class WHERE id = :id FOR SHARE"), values)
    return bool(seen.connection.execute(text(_LOCK), values).scalar())


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

        If anything changed that travel depends on, if some are of another rule, or if the validity
        of some regions ends or begins at a known moment, only the edges of places with the same
        digest hold.
        """
        rows = read_travel_times(seen, self._class.id)
        unmeasured = self._class.unmeasured
        if unmeasured is None and not len(rows):
            return None
        values = {"robot": self._class.id, "rule": _rule()}
        self._compared = bool(
            some_expire
            or unmeasured is None
            or self._class.fields_changed
            or _affects_travel(seen, unmeasured)
            or seen.connection.execute(text(_OTHER_RULES), values).scalar()
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
        self, seen: Snapshot, graph: RoutingGraph, cursor: str, but: Collection[str] = ()
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
                    places = self._unstored - waiting
                    ids = [n for p in places if (n := graph.topology.places[p].id) is not None]
                    if ids:
                        digests = compute_place_digests(seen, _reach(graph.robot), ids)
                        travel = travel_in_places(graph, places)
                        store_travel_times(seen, self._class.id, travel, digests)
                    if not waiting:
                        store_measured_until(seen, self._class.id, cursor)
                    self._unstored = waiting
        except (OperationalError, IntegrityError):
            return  # another process has stored some since this transaction began


def _affects_travel(seen: Snapshot, ids: Collection[int]) -> bool:
    """Whether any of these entities is, or was, of a kind that travel depends on."""
    if not ids:
        return False
    kinds = read_kinds(seen, ids)
    return any(kinds.get(number) not in ("agent", "elevator") for number in ids)


@cache
def _rule() -> str:
    """How digests of this rule and policy begin."""
    policy = (resources.files("navgrid") / "policy.yaml").read_bytes()
    return f"{RULE}.{md5(policy, usedforsecurity=False).hexdigest()[:8]}:"


def _reach(robot: RobotClass) -> float:
    """Metres beyond a place within which objects have an effect in it."""
    return max(part.circumscribed_radius for part in robot.parts) + 1.0
