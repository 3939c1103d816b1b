"""Questions about the entities of one map, as plain rows; the session sees that map.

Why: docs/decisions/a_near_point_is_hidden_from_the_planner_a_distant_one_is_not.md
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import psycopg
from psycopg.rows import dict_row
from psycopg.types.json import Jsonb

from semmap.query.snapshot import Snapshot
from semmap.suggestions import suggestion

Session = psycopg.Connection[Any]
Row = dict[str, Any]

Near = str | Sequence[float]
"""A point (x, y, z) in the map's frame, metres, or the name of an entity: its place."""

CLOSE = 10.0
"""Within so many metres, one plan that begins with the spatial index serves all types: a subquery
hides the place from the planner. A wider one is planned each time, to begin with rare types."""


PLACED = (
    "entity e LEFT JOIN placement p ON p.entity_id = e.id LEFT JOIN entity h ON h.id = p.holder_id "
    "LEFT JOIN world w ON w.entity_id = e.id LEFT JOIN entity s ON s.id = w.storey_id"
)
"""Entities with their placements, holders, world poses and storeys, where they have one."""


def list_maps(session: Session) -> list[Row]:
    """The maps, the oldest first, with numbers of entities; not the copies of simulated runs."""
    return _rows(
        session,
        "SELECT m.name, count(e.id) AS entities, count(*) FILTER (WHERE e.kind = 'room') AS rooms, "
        "m.crs, m.created_at FROM map m LEFT JOIN entity e ON e.map_id = m.id "
        "WHERE m.copy_of IS NULL GROUP BY m.id ORDER BY m.id",
    )


def list_types(seen: Snapshot) -> list[Row]:
    """The semantic types, each with its parents and how many entities of the map are of it."""
    return _rows(
        seen.session,
        "SELECT t.name, "
        "array_agg(DISTINCT p.parent) FILTER (WHERE p.parent IS NOT NULL) AS parents, "
        "t.origin, (SELECT count(*) FROM object o WHERE o.type = t.name) AS entities "
        "FROM semantic_type t LEFT JOIN type_parent p ON p.type = t.name "
        "GROUP BY t.name, t.origin ORDER BY t.name",
    )


def list_incomplete(seen: Snapshot) -> list[Row]:
    """The entities that lack geometry, type, placement or topology (Deeken et al., section 3.3)."""
    return _rows(seen.session, "SELECT name, kind, missing FROM incomplete ORDER BY name")


def list_guessed_types(seen: Snapshot) -> list[Row]:
    """The entities whose type an import guessed from a name, the least certain first."""
    return _rows(
        seen.session,
        "SELECT name, type, confidence, model FROM guessed_type ORDER BY confidence, name",
    )


def list_regions(seen: Snapshot, ids: Sequence[int] | None = None) -> list[Row]:
    """The regions of the map, or those with these ids; area in square metres, z in metres."""
    rows = _rows(
        seen.session,
        "SELECT e.name, e.type, r.origin, o.name AS of, h.name AS holder, "
        "ST_Area(w.footprint) AS area, ST_ZMin(w.box) AS low, ST_ZMax(w.box) AS high, "
        "cardinality(r.faces) AS faces FROM region r JOIN entity e ON e.id = r.entity_id "
        "LEFT JOIN entity o ON o.id = r.of_id LEFT JOIN placement p ON p.entity_id = e.id "
        "LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = current_map() AND (%(ids)s::bigint[] IS NULL OR e.id = ANY (%(ids)s)) "
        "ORDER BY e.name",
        {"ids": ids},
    )
    return [{k: round(v, 3) if isinstance(v, float) else v for k, v in r.items()} for r in rows]


def entity_id(session: Session, name: str) -> int:
    """The id of an entity; a LookupError names those that come near an unknown name."""
    query = "SELECT id FROM entity WHERE map_id = current_map() AND name = %s"
    row = None if "\0" in name else session.execute(query, (name,)).fetchone()  # no text has it
    if row is None:
        names = _column(session, "SELECT name FROM entity WHERE map_id = current_map()")
        raise LookupError(
            f"the map has no entity {name}{suggestion(name, names, 'semmap ls lists them')}"
        )
    return int(row[0])


def find(
    seen: Snapshot,
    *,
    type: str | None = None,
    holder: str | None = None,
    label: str | None = None,
    where: Mapping[str, Any] | None = None,
    near: Near | None = None,
    within: float | None = None,
    box: Sequence[float] | None = None,
    name: str | None = None,
    on: str | None = None,
    limit: int | None = None,
) -> list[Row]:
    """The entities of the map that meet all the conditions of `semmap.Map.find`, by one statement.

    Rows with `id`, `name`, `kind`, `type`, `label`, `holder`, `storey`, `x`, `y`, `z` (metres, map
    frame) and, with `near`, `distance`. A LookupError says which type or name the map does not
    have, a ValueError which point, box, distance or limit is none.
    """
    patterned = name is not None and any(character in name for character in "*?")
    given: dict[str, tuple[Any, str]] = {
        "type": (type, "e.id IN (SELECT id FROM object WHERE type = %(type)s)"),
        "label": (label, "(e.label = %(label)s OR e.type = ANY (subtypes(%(label)s)))"),
        "holder": (holder, f"e.id IN (SELECT contents_of({_ID.format('holder')}))"),
        "on": (on, f"p.relation = 'on' AND p.holder_id = {_ID.format('on')}"),
        "name": (
            _like(name) if name and patterned else name,
            f"e.name {'LIKE' if patterned else '='} %(name)s",
        ),
        "where": (Jsonb(dict(where)) if where else None, "e.properties @> %(where)s"),
    }
    values: dict[str, Any] = {k: value for k, (value, _) in given.items() if value is not None}
    conditions = ["e.map_id = current_map()", *(given[key][1] for key in values)]
    order, extra, source, is_close = "e.kind, e.name", "", "", False
    if box is not None:
        corners = _numbers(box, 6, "box")
        if not all(low <= high for low, high in zip(corners[:3], corners[3:], strict=True)):
            raise ValueError(f"a box has its lowest corner first, then its highest, not {box}")
        conditions.append(
            "w.box &&& ST_MakeLine(ST_MakePoint(%(x0)s, %(y0)s, %(z0)s), "
            "ST_MakePoint(%(x1)s, %(y1)s, %(z1)s))"
        )
        values |= dict(zip(("x0", "y0", "z0", "x1", "y1", "z1"), corners, strict=True))
    if near is not None:
        if isinstance(near, str):
            place = f"(SELECT n.pose[1:3] FROM world n WHERE n.entity_id = {_ID.format('near')})"
            values["near"] = near
        else:
            place, values["near"] = "%(near)s::float8[]", _numbers(near, 3, "a point")
        conditions.append("at IS NOT NULL")
        source = (
            f"CROSS JOIN LATERAL (SELECT {place} OFFSET 0) point (at) LEFT JOIN LATERAL ("
            "SELECT shape_distance(w.entity_id, at[1], at[2], at[3]) OFFSET 0) measured (distance) "
            "ON true "
        )
        if within is not None:
            if not 0 <= within < math.inf:
                raise ValueError(f"within takes metres from 0 on, not {within}")
            cube = "around(at[1], at[2], at[3], %(within)s)"
            if not isinstance(near, str):  # a point that the planner knows, or that it must not
                values |= dict(zip("xyz", values["near"], strict=True))
                cube = "around(%(x)s, %(y)s, %(z)s, %(within)s)"
                is_close = within <= CLOSE
            conditions.append(f"w.box && (SELECT {cube})" if is_close else f"w.box &&& {cube}")
            conditions.append("measured.distance <= %(within)s")
            values["within"] = within
        extra = ", round(distance::numeric, 3) AS distance"
        order = "measured.distance, e.name"  # not the rounded one
    elif within is not None:
        raise ValueError("within needs near: a point (x, y, z) or a name")
    if limit is not None and not 0 <= limit < 2**31:
        raise ValueError(f"limit takes a number from 0 on, not {limit}")
    values["limit"] = limit
    rows = _rows(
        seen.session,
        "SELECT e.id, e.name, e.kind, e.type, e.label, h.name AS holder, s.name AS storey, "
        "round(w.pose[1]::numeric, 3) AS x, round(w.pose[2]::numeric, 3) AS y, "
        f"round(w.pose[3]::numeric, 3) AS z{extra} "
        f"FROM {PLACED} {source}"
        f"WHERE {' AND '.join(conditions)} ORDER BY {order} LIMIT %(limit)s",
        values,
        prepare=None if within is None or is_close else False,
    )
    if not rows:
        _check_names(seen, type, (holder, on), near)
    return rows


_ID = "(SELECT id FROM entity WHERE map_id = current_map() AND name = %({})s)"


def _like(pattern: str) -> str:
    """The pattern of LIKE for one in which ``*`` is any text and ``?`` any character."""
    quoted = re.sub(r"([\\%_])", r"\\\1", pattern)
    return quoted.replace("*", "%").replace("?", "_")


def _check_names(
    seen: Snapshot, type: str | None, holders: Sequence[str | None], near: Near | None
) -> None:
    """Refuse what the map does not have; a name that it has may hold nothing."""
    if type is not None:
        types = _column(seen.session, "SELECT name FROM semantic_type")
        if type not in types:
            raise LookupError(
                f"the map has no type {type}{suggestion(type, types, 'semmap types lists them')}"
            )
    for each in holders:
        if each is not None:
            entity_id(seen.session, each)
    if isinstance(near, str):
        number = entity_id(seen.session, near)
        if not _column(seen.session, "SELECT 1 FROM world WHERE entity_id = %s", (number,)):
            raise ValueError(f"{near} has no placement: give a point (x, y, z)")


PARTS = {
    "types": "SELECT type FROM object WHERE id = %s ORDER BY type",
    "holds": "SELECT e.name FROM inventory i JOIN entity e ON e.id = i.ob_id "
    "WHERE i.inv_id = %s ORDER BY e.name",
    "connectors": "SELECT e.name FROM connector c JOIN entity e ON e.id = c.entity_id "
    "WHERE %s IN (c.place_a, c.place_b) ORDER BY e.name",
    "links": "SELECT l.relation || ' ' || e.name FROM link l JOIN entity e ON e.id = l.to_id "
    "WHERE l.from_id = %s ORDER BY 1",
    "missing": "SELECT unnest(missing) FROM incomplete WHERE id = %s",
}


def describe(seen: Snapshot, name: str, at: datetime | None = None) -> Row:
    """All that the map has of one entity; `at` adds `then`: pose and holder at that time."""
    return describe_id(seen, entity_id(seen.session, name), at)


def describe_id(seen: Snapshot, number: int, at: datetime | None = None) -> Row:
    """As `describe`, of the entity of an id."""
    found = _rows(
        seen.session,
        "SELECT e.name, e.kind, e.type, e.label, h.name AS holder, p.relation, "
        "p.confidence, s.name AS storey, w.pose, e.properties, e.front, "
        "greatest(e.since, p.since) AS since, e.source, "
        "Box3D(w.box)::text AS box, ST_AsText(w.footprint, 3) AS footprint "
        f"FROM {PLACED} WHERE e.id = %s",
        (number,),
    )
    if not found:
        raise LookupError(f"the map has no entity with the id {number}")
    known = found[0]
    if known["pose"] is not None:
        known["pose"] = [round(v, 6) for v in known["pose"]]
    for part, statement in PARTS.items():
        known[part] = _column(seen.session, statement, (number,))
    known["models"] = _rows(
        seen.session,
        "SELECT m.kind, m.triangles, m.uri, em.role FROM entity_model em "
        "JOIN model m ON m.id = em.model_id WHERE em.entity_id = %s ORDER BY m.id",
        (number,),
    )
    joins = _rows(
        seen.session,
        "SELECT a.name AS place_a, coalesce(b.name, 'outside') AS place_b, c.form, "
        "c.direction, c.state, c.behaviour, c.width, c.pose_a, c.pose_b FROM connector c "
        "JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b "
        "WHERE c.entity_id = %s",
        (number,),
    )
    if joins:
        known["joins"] = joins[0]
    if at is not None:
        then = _rows(
            seen.session,
            "SELECT pose_at(%(id)s, %(at)s) AS pose, (SELECT e.name FROM placement_at(%(id)s, "
            "%(at)s) p LEFT JOIN entity e ON e.id = p.holder_id) AS holder",
            {"id": number, "at": at},
        )
        if then[0]["pose"] is None and at < (first := _first_version(seen, number)):
            raise LookupError(
                f"{known['name']} was not in the map at {at.isoformat()}: the first version "
                f"that the map has of it is of {first.isoformat()}"
            )
        known["then"] = {"at": at.isoformat()} | then[0]
    return known


def _first_version(seen: Snapshot, number: int) -> datetime:
    """The beginning of the first version of an entity that the map still has."""
    row = seen.session.execute(
        "SELECT least(e.since, p.since, (SELECT min(lower(during)) FROM entity_history "
        "WHERE entity_id = e.id), (SELECT min(lower(during)) FROM placement_history "
        "WHERE entity_id = e.id)) FROM entity e LEFT JOIN placement p ON p.entity_id = e.id "
        "WHERE e.id = %s",
        (number,),
    ).fetchone()
    assert row is not None
    first: datetime = row[0]
    return first


def changes_since(session: Session, since: str | None) -> tuple[str, list[Row]]:
    """The changes after a cursor (all that are kept where None), and the cursor for the next call.

    The cursor survives a crash of the server; a ValueError refuses what is not one.
    """
    check_cursor(since)
    with session.transaction():
        # One statement, so that cursor and rows are of one snapshot.
        rows = _rows(
            session,
            "SELECT change_cursor() AS cursor, c.id, c.at, m.name AS map, c.what, c.entities "
            "FROM (SELECT) once LEFT JOIN changes_since(%s) c ON true "
            "LEFT JOIN map m ON m.id = c.map_id ORDER BY c.id",
            (since,),
        )
        session.execute(SETTLE)
    cursor = str(rows[0]["cursor"])
    for row in rows:
        del row["cursor"]
    return cursor, [row for row in rows if row["id"] is not None]


def check_cursor(given: str | None) -> None:
    """Refuse what is not a cursor."""
    if given is not None and not re.fullmatch(r"\d+:\d+:[\d,]*", given):
        raise ValueError(f"{given} is not a cursor: give one that an earlier call printed, or none")


SETTLE = "SELECT set_config('synchronous_commit', 'on', true), settle()"
"""Writes what a cursor of this transaction saw to disk when it commits.

Standbys for which commits wait have it then, too. A server that crashes, or takes over, assigns
numbers of transactions again that it had not written yet; a cursor that saw the first would take
the second for seen. Needed where a cursor is stored outside of the database."""


def _rows(
    session: Session, statement: str, values: Any = None, prepare: bool | None = None
) -> list[Row]:
    with session.cursor(row_factory=dict_row) as cursor:
        return cursor.execute(statement, values, prepare=prepare).fetchall()


def _column(session: Session, statement: str, values: Any = None) -> list[Any]:
    return [row[0] for row in session.execute(statement, values).fetchall()]


def _numbers(given: Sequence[float], count: int, what: str) -> list[float]:
    numbers = [float("nan") if v is None else float(v) for v in given]
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{what} has {count} finite numbers, not {given}")
    return numbers
