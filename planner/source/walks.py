"""The ways in places, as long as a class of robots takes; and for which state they hold."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, text

from planner.source.robot_class import class_state
from planner.source.rows import ask

__all__ = [
    "Walk",
    "keep_walked_until",
    "keep_walks",
    "may_keep",
    "place_digests",
    "read_walks",
    "walked_digests",
]


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
    found = np.frombuffer(ask(connection, packed, (robot_class,))[0][0], _WALK)
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
