"""The topology of the current map, read from the database: the one module here that does so."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray
from psycopg.rows import namedtuple_row, tuple_row
from sqlalchemy import Connection, text

from navgrid.scene import Scene, Thing
from navgrid.source import read_scene, read_storey_names, read_things
from navgrid.terrain import Gait
from planner.robot_class import RobotClass
from planner.target import Target
from planner.times import Times
from planner.topology import OUTSIDE, Connector, Place, Region, Topology
from semmap.geometry.pose import Pose
from semmap.robot import Part

__all__ = [
    "Kept",
    "Walk",
    "class_state",
    "delete_robot_class",
    "keep_robot_class",
    "keep_walked_until",
    "keep_walks",
    "may_keep",
    "place_digests",
    "read_connectors",
    "read_kinds",
    "read_moment",
    "read_names_like",
    "read_objects",
    "read_place_at",
    "read_places",
    "read_places_like",
    "read_regions",
    "read_regions_on",
    "read_robot_class",
    "read_robot_names",
    "read_targets",
    "read_topology",
    "read_walks",
    "scene_of",
    "walked_digests",
]

_PLACES = """
SELECT e.name, e.type, e.label, s.name, l.name, NULLIF(e.properties, '{}'),
       coalesce(w.pose[3] + r.floor, 0), e.id
FROM room r JOIN entity e ON e.id = r.entity_id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN entity s ON s.id = w.storey_id LEFT JOIN entity l ON l.id = r.elevator_id
WHERE e.map_id = current_map() ORDER BY e.name
"""

_CONNECTORS = """
SELECT array_send(w.pose || c.pose_a || c.pose_b), c.place_a, c.place_b,
       e.name, c.form, c.direction, c.state, c.behaviour, c.width, c.height, c.step,
       NULLIF(c.permissions, '{}'), NULLIF(e.properties, '{}'), e.id
FROM connector c JOIN entity e ON e.id = c.entity_id JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND (%s::bigint[] IS NULL OR e.id = ANY (%s::bigint[]))
ORDER BY e.name
"""

_SENT = np.dtype([("head", "V20"), ("poses", [("length", ">i4"), ("value", ">f8")], 21)])
"""Three poses as the server sends an array of 21 numbers."""

_NOTHING: Mapping[str, Any] = {}
"""The properties of what has none."""

_REGIONS = """
SELECT e.id, e.name, e.label, e.type, e.properties, ST_AsBinary(w.footprint) AS footprint,
       lower(g.valid) AS since, upper(g.valid) AS until,
       g.origin = 'drawn' AND w.footprint IS NOT NULL AND coalesce(g.valid @> now(), true) AS holds
FROM region g JOIN entity e ON e.id = g.entity_id LEFT JOIN world w ON w.entity_id = e.id
WHERE e.map_id = (SELECT current_map()) ORDER BY e.name
"""

_REACHED = """
SELECT w.entity_id, array_agg(n.name ORDER BY n.name)
FROM world w JOIN world rw ON ST_Intersects(rw.footprint, w.footprint)
     AND (w.storey_id IS NULL OR rw.storey_id IS NOT DISTINCT FROM w.storey_id)
JOIN entity n ON n.id = rw.entity_id AND n.kind = 'room' AND n.map_id = current_map()
WHERE w.entity_id = ANY (:ids) GROUP BY w.entity_id
"""

_SUPERTYPES = """
SELECT sub, array_agg(super ORDER BY super <> sub, super) AS supers FROM type_closure
WHERE sub = ANY (:types) GROUP BY sub
"""


def read_topology(connection: Connection) -> Topology:
    """The rooms of the current map as places, and the connectors with poses in the map's frame."""
    places = read_places(connection)
    return Topology.of(places, read_connectors(connection, places), read_regions(connection)[0])


def read_places(connection: Connection) -> list[Place]:
    """The rooms of the current map, and the cabins of its elevators, by name."""
    rows = _ask(connection, _PLACES)
    types = _supertypes(connection, {row[1] for row in rows})
    return [
        Place(name, type_, label, storey, elevator, types.get(type_, ()), said or _NOTHING, floor,
              number)
        for name, type_, label, storey, elevator, said, floor, number in rows
    ]  # fmt: skip


def _ask(
    connection: Connection, statement: str, values: Sequence[Any] = (), rows: Any = tuple_row
) -> list[Any]:
    """The answer as the driver reads it: thousands of rows in half of SQLAlchemy's time."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    return driver.cursor(binary=True, row_factory=rows).execute(statement, values).fetchall()


def read_regions(connection: Connection) -> tuple[list[Region], dict[int, list[datetime]]]:
    """The drawn regions of the current map that hold now; and when regions begin and end, by id.

    Only those that do not hold for ever have such times.
    """
    rows = _ask(connection, _REGIONS, rows=namedtuple_row)
    ends = {row.id: [t for t in (row.since, row.until) if t is not None] for row in rows}
    timed = {number: times for number, times in ends.items() if times}
    drawn = [row for row in rows if row.holds]
    if not drawn:
        return [], timed
    types = _supertypes(connection, {row.type for row in drawn})
    reached = connection.execute(text(_REACHED), {"ids": [row.id for row in drawn]})
    places = {number: tuple(names) for number, names in reached}
    regions = [
        Region(
            row.name, shapely.from_wkb(bytes(row.footprint)), places[row.id], row.label,
            types.get(row.type, ()), row.properties,
        )
        for row in drawn
        if row.id in places
    ]  # fmt: skip
    return regions, timed


def _supertypes(connection: Connection, types: Set[str | None]) -> dict[str, tuple[str, ...]]:
    """What subsumes types."""
    named = [t for t in types if t]
    if not named:
        return {}
    found = connection.execute(text(_SUPERTYPES), {"types": named})
    return {sub: tuple(supers) for sub, supers in found}


def read_connectors(
    connection: Connection, places: Iterable[Place], ids: Collection[int] | None = None
) -> list[Connector]:
    """The connectors of these places, or those of them with these ids."""
    if ids is not None and not ids:
        return []
    names: dict[int | None, str] = {p.id: p.name for p in places if p.id is not None}
    names[None] = OUTSIDE
    wanted = None if ids is None else [*ids]
    rows = _ask(connection, _CONNECTORS, (wanted, wanted))
    rows = [row for row in rows if row[1] in names and row[2] in names]
    if not rows:
        return []
    sent = np.frombuffer(b"".join([row[0] for row in rows]), _SENT)
    poses = sent["poses"]["value"].astype(np.float64).reshape(-1, 3, 7)
    ends = [map(Pose._make, _composed(poses[:, 0], poses[:, k]).tolist()) for k in (1, 2)]
    return [
        Connector(name, (names[a], names[b]), both, form, direction, state, behaviour, width,
                  height, step, frozenset(permissions or ()), said or _NOTHING, number)
        for both, (_, a, b, name, form, direction, state, behaviour, width, height, step,
                   permissions, said, number) in zip(zip(*ends, strict=True), rows, strict=True)
    ]  # fmt: skip


def _composed(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 7) poses of frames b in the frame of which frames a are: a @ b, row by row."""
    v, w = a[:, 3:6], a[:, 6:]
    t = 2 * np.cross(v, b[:, :3])
    at = a[:, :3] + b[:, :3] + w * t + np.cross(v, t)
    x, s = b[:, 3:6], b[:, 6:]
    turned = w * x + s * v + np.cross(v, x)
    return np.concatenate([at, turned, w * s - (v * x).sum(axis=1, keepdims=True)], axis=1)


def read_kinds(connection: Connection, ids: Collection[int]) -> dict[int, str]:
    """The kinds of those of these entities that are there."""
    rows = connection.execute(
        text("SELECT id, kind FROM entity WHERE id = ANY (:ids)"), {"ids": [*ids]}
    )
    return {row.id: row.kind for row in rows}


# -- what people mean -----------------------------------------------------------------------------

_TARGETS = """
WITH RECURSIVE wanted AS (
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.name = :said
    UNION
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.label = :said
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :said)
    UNION
    SELECT e.id FROM type_closure t JOIN entity e ON e.type = t.sub
    WHERE t.super = :said AND e.map_id = current_map()
      AND NOT EXISTS (SELECT FROM entity n WHERE n.map_id = current_map() AND n.name = :said)
), up (id, at, depth) AS (
    SELECT id, id, 0 FROM wanted
    UNION ALL
    SELECT u.id, p.holder_id, u.depth + 1 FROM up u JOIN placement p ON p.entity_id = u.at
    WHERE p.holder_id IS NOT NULL AND NOT EXISTS (SELECT FROM room r WHERE r.entity_id = u.at)
), held AS (
    SELECT DISTINCT ON (u.id) u.id, e.name AS place
    FROM up u JOIN room r ON r.entity_id = u.at JOIN entity e ON e.id = u.at ORDER BY u.id, u.depth
)
SELECT e.id, e.name, e.kind, e.type, e.label, w.pose, h.place, g.entity_id IS NOT NULL AS is_region,
       ST_AsBinary(w.footprint) AS footprint, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high,
       (SELECT n.name FROM world rw JOIN entity n ON n.id = rw.entity_id
        WHERE h.place IS NULL AND n.kind = 'room' AND n.map_id = e.map_id
          AND rw.storey_id IS NOT DISTINCT FROM coalesce(w.storey_id, rw.storey_id)
          AND ST_Intersects(rw.footprint, ST_PointOnSurface(w.footprint)) LIMIT 1) AS around
FROM wanted q JOIN entity e ON e.id = q.id LEFT JOIN world w ON w.entity_id = e.id
LEFT JOIN held h ON h.id = e.id LEFT JOIN region g ON g.entity_id = e.id
WHERE e.kind IN ('room', 'object', 'region', 'agent')
ORDER BY e.name LIMIT :most
"""


def read_targets(connection: Connection, said: str, most: int = 1000) -> list[Target]:
    """What a person may mean: the entity of that name, else those of that label or type.

    ``kitchen`` means the rooms whose label or type (with subtypes) is kitchen; ``muffin1`` a thing,
    in the room that holds it; ``home`` a region. Empty where nothing fits.
    """
    rows = connection.execute(text(_TARGETS), {"said": said, "most": most}).all()
    return [
        Target(
            row.name,
            row.kind,
            row.name if row.kind == "room" else row.place or row.around,
            None if row.pose is None else Pose(*row.pose),
            None if row.footprint is None else shapely.from_wkb(bytes(row.footprint)),
            None if row.low is None else (row.low, row.high),
            row.id,
        )
        for row in rows
    ]


_NAMES = """
SELECT DISTINCT unnest(ARRAY[type, label]) FROM entity
WHERE map_id = current_map() AND kind IN ('room', 'object', 'region')
UNION
(SELECT name FROM entity WHERE map_id = current_map() AND name ILIKE :start
 AND kind IN ('room', 'object', 'region', 'agent') LIMIT 2000)
"""


def read_names_like(connection: Connection, said: str) -> list[str]:
    """Types, labels, and names that begin as a word does that means nothing."""
    start = said[:2].replace("\\", r"\\").replace("%", r"\%").replace("_", r"\_") + "%"
    rows = connection.execute(text(_NAMES), {"start": start}).scalars()
    return [name for name in rows if name is not None]


def read_place_at(connection: Connection, pose: Pose) -> str | None:
    """The room of the current map in which a pose is; the highest whose floor is not above it."""
    name = connection.execute(
        text(
            "SELECT e.name FROM world w JOIN entity e ON e.id = w.entity_id "
            "JOIN room r ON r.entity_id = e.id WHERE e.map_id = current_map() "
            "AND ST_Covers(w.footprint, ST_MakePoint(:x, :y)) "
            "AND w.pose[3] + r.floor <= :z + 0.5 ORDER BY w.pose[3] + r.floor DESC LIMIT 1"
        ),
        {"x": pose.x, "y": pose.y, "z": pose.z},
    ).scalar()
    return None if name is None else str(name)


def read_places_like(connection: Connection, topology: Topology, said: str) -> list[str]:
    """The places that a person may mean: of that name, of a thing of that name, by label or type.

    Empty where nothing fits.
    """
    if said in topology.places:
        return [said]
    found = [target.place for target in read_targets(connection, said)]
    return [*dict.fromkeys(place for place in found if place in topology.places)]


# -- classes of robots ----------------------------------------------------------------------------

_PLAIN = ("speed", "opens", "unlocks", "outside", "capacity")
_TIMES = {
    "call": "call_seconds", "ride": "ride_seconds", "ride_per_metre": "ride_seconds_per_metre",
    "open": "open_seconds", "unlock": "unlock_seconds", "pickup": "pickup_seconds",
    "place": "place_seconds",
}  # fmt: skip


def keep_robot_class(connection: Connection, robot: RobotClass, times: Times | None = None) -> int:
    """Keep a class of robots under its name, in place of a former one; its id.

    Walks that were measured for a robot of another shape, gait or speed are forgotten.
    """
    times = times or Times()
    shaped = bool(robot.parts)
    row: dict[str, Any] = {
        "name": robot.name,
        "parts": json.dumps([_as_json(part) for part in robot.parts]),
        "width": max(float(np.ptp(p.footprint[:, 1])) for p in robot.parts) if shaped else None,
        "height": max(p.interval[1] for p in robot.parts) if shaped else None,
        "max_step": robot.gait.max_step,
        "max_slope": robot.gait.max_slope,
        "behaviours": None if robot.behaviours is None else sorted(robot.behaviours),
        "permissions": sorted(robot.permissions),
        "reach": list(robot.reach),
        "heights": list(robot.heights),
        **{name: getattr(robot, name) for name in _PLAIN},
        **{column: getattr(times, name) for name, column in _TIMES.items()},
    }
    known = connection.execute(
        text("SELECT id, parts = CAST(:parts AS jsonb) AND max_step = :max_step "
             "AND max_slope = :max_slope AND speed = :speed AS same FROM robot_class "
             "WHERE name = :name"), row
    ).one_or_none()  # fmt: skip
    columns = list(row)
    values = ", ".join("CAST(:parts AS jsonb)" if c == "parts" else f":{c}" for c in columns)
    updates = ", ".join(f"{c} = EXCLUDED.{c}" for c in columns if c != "name")
    number = connection.execute(
        text(
            f"INSERT INTO robot_class ({', '.join(columns)}) VALUES ({values}) "
            f"ON CONFLICT (name) DO UPDATE SET {updates} RETURNING id"
        ),
        row,
    ).scalar_one()
    if known is not None and not known.same:
        for table in ("walk", "walked_place", "walked_map"):
            connection.execute(
                text(f"DELETE FROM {table} WHERE robot_class_id = :id"), {"id": number}
            )
    return int(number)


def delete_robot_class(connection: Connection, name: str) -> None:
    """Forget a class of robots and its walks.

    Raises
    ------
    LookupError
    """
    read_robot_class(connection, name)
    connection.execute(text("DELETE FROM robot_class WHERE name = :name"), {"name": name})


def read_robot_names(connection: Connection) -> list[str]:
    """The names of the classes of robots."""
    return [*connection.execute(text("SELECT name FROM robot_class ORDER BY name")).scalars()]


class Kept(NamedTuple):
    """A class of robots as the database keeps it.

    Attributes
    ----------
    id : in the database
    robot, times : what it can do, and how long that takes; learned times in the current map, too
    state : a digest of all that the database has of the class itself
    unwalked : the entities of the current map that changed since all of its walks were measured;
        None where they never were, or before the history begins
    """

    id: int
    robot: RobotClass
    times: Times
    state: str
    unwalked: frozenset[int] | None


_CLASS = """
SELECT r.*, md5(r::text) AS state,
       CASE WHEN pg_visible_in_snapshot((SELECT min(xid) FROM change)::text::xid8,
                                        w.cursor::pg_snapshot)
            THEN ARRAY(SELECT unnest(s.entities) FROM changes_since(w.cursor) s
                       WHERE s.map_id = w.map_id) END AS unwalked,
       (SELECT jsonb_agg(jsonb_build_array(l.behaviour, e.name, l.seconds))
        FROM learned l JOIN entity e ON e.id = l.entity_id
        WHERE l.robot_class_id = r.id AND e.map_id = current_map()) AS learned
FROM robot_class r
LEFT JOIN walked_map w ON w.robot_class_id = r.id AND w.map_id = (SELECT current_map())
WHERE r.name = %s
"""


def read_robot_class(connection: Connection, name: str) -> Kept:
    """A class of robots by name.

    Raises
    ------
    LookupError
        There is none of that name; the message names those that there are.
    """
    found = _ask(connection, _CLASS, (name,), namedtuple_row)
    if not found:
        known = ", ".join(read_robot_names(connection))
        raise LookupError(
            f"there is no class of robots named {name}; "
            + (f"there are: {known}" if known else "semmap robot add makes one from a URDF")
        )
    (row,) = found
    robot = RobotClass(
        row.name,
        tuple(_part(said) for said in row.parts),
        Gait(row.max_step, row.max_slope),
        behaviours=None if row.behaviours is None else frozenset(row.behaviours),
        permissions=frozenset(row.permissions or ()),
        reach=(row.reach[0], row.reach[1]),
        heights=(row.heights[0], row.heights[1]),
        **{name: getattr(row, name) for name in _PLAIN},
    )
    times = Times(
        **{name: getattr(row, column) for name, column in _TIMES.items()},
        learned={(behaviour, of): float(seconds) for behaviour, of, seconds in row.learned or ()},
    )
    unwalked = None if row.unwalked is None else frozenset(row.unwalked)
    return Kept(row.id, robot, times, row.state, unwalked)


def _as_json(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "links": list(part.links),
        "interval": list(part.interval),
        "footprint": part.footprint.tolist(),
        "inscribed_radius": part.inscribed_radius,
        "circumscribed_radius": part.circumscribed_radius,
        "inflate_by": part.inflate_by,
    }


def _part(said: dict[str, Any]) -> Part:
    return Part(
        said["name"], tuple(said["links"]), (said["interval"][0], said["interval"][1]),
        np.array(said["footprint"]), said["inscribed_radius"], said["circumscribed_radius"],
        said["inflate_by"],
    )  # fmt: skip


# -- walks ----------------------------------------------------------------------------------------


class Walk(NamedTuple):
    """The way in a place between two connectors, by ids."""

    place: int
    a: int
    b: int
    seconds: float
    metres: float


_WALK = np.dtype(
    [("place", ">i8"), ("a", ">i8"), ("b", ">i8"), ("seconds", ">f8"), ("metres", ">f8")]
)


def read_walks(connection: Connection, robot_class: int) -> NDArray[Any]:
    """The walks of a class of robots, of all maps, as an array with the fields of `Walk`."""
    packed = "SELECT coalesce(string_agg(packed, ''), '') FROM walk WHERE robot_class_id = %s"
    found = np.frombuffer(_ask(connection, packed, (robot_class,))[0][0], _WALK)
    return found.astype(_WALK.newbyteorder("="))


def keep_walks(
    connection: Connection, robot_class: int, walks: Iterable[Walk], digests: dict[int, str]
) -> None:
    """Keep the walks of places, in place of all former ones there.

    Parameters
    ----------
    digests : the state of each of the places for which they were measured, by id
    """
    places = {"robot": robot_class, "places": [*digests]}
    where = "WHERE robot_class_id = :robot AND place_id = ANY (:places)"
    connection.execute(text(f"DELETE FROM walk {where}"), places)
    connection.execute(text(f"DELETE FROM walked_place {where}"), places)
    rows = [*walks]
    connection.execute(
        text(
            "INSERT INTO walk (robot_class_id, place_id, from_id, to_id, seconds, metres) "
            "SELECT :robot, * FROM unnest(CAST(:place AS bigint[]), CAST(:a AS bigint[]), "
            "CAST(:b AS bigint[]), CAST(:seconds AS float8[]), CAST(:metres AS float8[]))"
        ),
        {"robot": robot_class, **{k: [getattr(w, k) for w in rows] for k in Walk._fields}},
    )
    connection.execute(
        text(
            "INSERT INTO walked_place SELECT :robot, * FROM unnest(CAST(:places AS bigint[]), "
            "CAST(:digests AS text[]))"
        ),
        {"robot": robot_class, "places": [*digests], "digests": [*digests.values()]},
    )


_DIGESTS = """
WITH RECURSIVE carried (id) AS (
    SELECT p.entity_id FROM placement p JOIN entity a ON a.id = p.holder_id AND a.kind = 'agent'
    WHERE a.map_id = current_map()
    UNION SELECT p.entity_id FROM carried c JOIN placement p ON p.holder_id = c.id
)
SELECT r.entity_id AS id, md5(concat_ws('|',
    (SELECT string_agg(concat_ws(',', c.entity_id, c.place_a, c.place_b, k.pose, c.pose_a, c.pose_b,
                                 c.width), ';' ORDER BY c.entity_id)
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
            OR e.kind = 'object')))) AS digest
FROM room r JOIN world w ON w.entity_id = r.entity_id
JOIN entity n ON n.id = r.entity_id AND n.map_id = current_map()
WHERE CAST(:places AS bigint[]) IS NULL OR r.entity_id = ANY (:places)
"""


def place_digests(
    connection: Connection, reach: float, places: Collection[int] | None = None
) -> dict[int, str]:
    """The state of each place of the current map, as far as walks depend on it, by id.

    Parameters
    ----------
    reach : metres beyond a place from which things have an effect in it
    """
    values = {"reach": reach, "places": None if places is None else [*places]}
    rows = connection.execute(text(_DIGESTS), values)
    return {row.id: row.digest for row in rows}


def keep_walked_until(connection: Connection, robot_class: int, cursor: str) -> None:
    """Say up to which change the walks in the current map are measured."""
    connection.execute(
        text(
            "INSERT INTO walked_map VALUES (:robot, current_map(), :cursor) "
            "ON CONFLICT (robot_class_id, map_id) DO UPDATE SET cursor = EXCLUDED.cursor"
        ),
        {"robot": robot_class, "cursor": cursor},
    )


def walked_digests(connection: Connection, robot_class: int) -> dict[int, str]:
    """The states of places for which walks were measured, by id."""
    rows = connection.execute(
        text("SELECT place_id, digest FROM walked_place WHERE robot_class_id = :robot"),
        {"robot": robot_class},
    )
    return {row.place_id: row.digest for row in rows}


def may_keep(connection: Connection, robot_class: int, state: str | None) -> bool:
    """Whether walks of a class may be kept now: it is as it was, and nobody else is at it.

    Who may keeps others from it, and the class as it is, until the transaction ends.

    Raises
    ------
    sqlalchemy.exc.OperationalError
        Another transaction has just changed the class.
    """
    able = connection.execute(
        text("SELECT has_table_privilege('walk', 'INSERT') AND "
             "has_table_privilege('walk', 'DELETE') AND NOT pg_is_in_recovery() AND "
             "current_setting('transaction_read_only') = 'off'")
    ).scalar()  # fmt: skip
    if not able or state != class_state(connection, robot_class):
        return False
    values = {"id": robot_class}
    connection.execute(text("SELECT FROM robot_class WHERE id = :id FOR SHARE"), values)
    return bool(
        connection.execute(
            text("SELECT pg_try_advisory_xact_lock(hashtext('semmap walks'), :id)"), values
        ).scalar()
    )


def class_state(connection: Connection, robot_class: int) -> str | None:
    """A digest of all that the database has of a class of robots itself; None if it is gone."""
    said = connection.execute(
        text("SELECT md5(r::text) FROM robot_class r WHERE id = :id"), {"id": robot_class}
    ).scalar()
    return None if said is None else str(said)


# -- scenes ---------------------------------------------------------------------------------------


def scene_of(connection: Connection, storey: str) -> Scene:
    """The scene of a storey of the current map as it is now; of "" in a map without storeys."""
    name = storey or read_storey_names(connection)[0]
    return read_scene(connection, name, moment=read_moment(connection))


def read_objects(connection: Connection, ids: Collection[int]) -> list[Thing]:
    """The objects among these entities, as scenes have them."""
    return read_things(connection, ids, kind="object")


def read_regions_on(connection: Connection, storey: str, ids: Collection[int]) -> list[Thing]:
    """The regions among these entities that are in the scene of a storey now."""
    name = storey or read_storey_names(connection)[0]
    moment = read_moment(connection)
    return read_things(connection, ids, kind="region", storey=name, moment=moment)


def read_moment(connection: Connection) -> datetime:
    """When this transaction began, which is what it means by now."""
    moment: datetime = connection.execute(text("SELECT now()")).scalar_one()
    return moment
