"""Questions about entities, as the command line asks them: rows of the current map."""

from __future__ import annotations

import difflib
import json
import math
import re
from dataclasses import dataclass, field
from datetime import datetime
from decimal import Decimal
from itertools import chain, count
from typing import Any

import psycopg
from psycopg.abc import Buffer, Loader
from psycopg.pq import ExecStatus
from psycopg.types.datetime import DateLoader, TimestampLoader, TimestamptzLoader
from psycopg.types.range import Range
from sqlalchemy import Connection, text

from semmap.query.change_feed import settle
from semmap.query.statements import READING, kind

__all__ = [
    "Question",
    "changes",
    "describe",
    "find",
    "incomplete",
    "is_superuser",
    "maps",
    "plain",
    "readable",
    "run_sql",
    "unique_names",
]

Rows = tuple[list[str], list[tuple[Any, ...]]]


@dataclass
class Question:
    """What an entity is asked to be; empty parts ask nothing.

    Attributes
    ----------
    type : a semantic type; its subtypes count
    inside : name of a holder; what its contents hold counts, too
    label : the property label (``kitchen``) of the entity, or of its type
    where : ``KEY=VALUE`` of the properties
    near : ``x,y,z`` in the map's frame or the name of an entity: the nearest come first
    within : metres from `near`, to the entity's 3D box
    box : ``x0,y0,z0,x1,y1,z1``: the entity's 3D box meets it
    """

    type: str | None = None
    inside: str | None = None
    label: str | None = None
    where: list[str] = field(default_factory=list)
    near: str | None = None
    within: float | None = None
    box: str | None = None


def _rows(connection: Connection, statement: str, parameters: dict[str, Any] | None = None) -> Rows:
    result = connection.execute(text(statement), parameters or {})
    return list(result.keys()), [tuple(row) for row in result]


def maps(connection: Connection) -> Rows:
    """The maps and how many entities each has."""
    return _rows(
        connection,
        "SELECT m.name, count(e.id) AS entities, count(*) FILTER (WHERE e.kind = 'room') AS rooms, "
        "m.crs, m.created_at FROM map m LEFT JOIN entity e ON e.map_id = m.id "
        "GROUP BY m.id ORDER BY m.id",
    )


def incomplete(connection: Connection) -> Rows:
    """Entities of which a part is empty: geometry, type, placement or topology (section 3.3)."""
    return _rows(connection, "SELECT name, kind, missing FROM incomplete ORDER BY name")


def find(connection: Connection, question: Question) -> Rows:
    """The entities that are as the question asks.

    Raises
    ------
    LookupError
        A type or name that the map does not know, with those that come near it.
    ValueError
        A point, box or property that cannot be read.
    """
    conditions = ["e.map_id = current_map()"]
    parameters: dict[str, Any] = {}
    order = "e.kind, e.name"
    extra = ""
    if question.type is not None:
        _known(connection, "SELECT name FROM semantic_type", question.type, "type")
        conditions.append("e.id IN (SELECT id FROM object WHERE type = :type)")
        parameters["type"] = question.type
    if question.label is not None:
        conditions.append("(e.label = :label OR e.type = ANY (subtypes(:label)))")
        parameters["label"] = question.label
    if question.inside is not None:
        parameters["inside"] = _entity(connection, question.inside)
        conditions.append(
            "e.id IN (WITH RECURSIVE held (id) AS ("
            "SELECT ob_id FROM inventory WHERE inv_id = :inside UNION "
            "SELECT i.ob_id FROM held JOIN inventory i ON i.inv_id = held.id) SELECT id FROM held)"
        )
    for number, condition in enumerate(question.where):
        key, equals, value = condition.partition("=")
        if not equals:
            raise ValueError(f"--where takes KEY=VALUE, not {condition}")
        conditions.append(f"e.properties @> CAST(:where{number} AS jsonb)")
        parameters[f"where{number}"] = json.dumps({key: _value(value)})
    if question.box is not None:
        corners = _numbers(question.box, 6, "--box")
        if not all(low <= high for low, high in zip(corners[:3], corners[3:], strict=True)):
            raise ValueError(f"--box takes its lowest corner, then its highest, not {question.box}")
        parameters |= {f"b{i}": v for i, v in enumerate(corners)}
        conditions.append(
            "w.box &&& ST_MakeLine(ST_MakePoint(:b0, :b1, :b2), ST_MakePoint(:b3, :b4, :b5))"
        )
    if question.near is not None:
        parameters |= dict(zip("xyz", _point(connection, question.near), strict=True))
        extra = ", round(CAST(box_distance(w.box, :x, :y, :z) AS numeric), 3) AS distance"
        order = "box_distance(w.box, :x, :y, :z), e.name"
        if question.within is not None:
            if not 0 <= question.within < math.inf:
                raise ValueError(f"--within takes metres from 0 on, not {question.within}")
            conditions.append("w.box &&& around(:x, :y, :z, :within)")
            conditions.append("box_distance(w.box, :x, :y, :z) <= :within")
            parameters["within"] = question.within
    elif question.within is not None:
        raise ValueError("--within needs --near: a point x,y,z or a name")
    return _rows(
        connection,
        "SELECT e.name, e.kind, e.type, e.label, h.name AS holder, s.name AS storey, "
        "round(CAST(w.pose[1] AS numeric), 3) AS x, round(CAST(w.pose[2] AS numeric), 3) AS y, "
        f"round(CAST(w.pose[3] AS numeric), 3) AS z{extra} "
        "FROM entity e LEFT JOIN placement p ON p.entity_id = e.id "
        "LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id "
        "LEFT JOIN entity s ON s.id = w.storey_id "
        f"WHERE {' AND '.join(conditions)} ORDER BY {order}",
        parameters,
    )


def describe(connection: Connection, name: str, at: str | None = None) -> dict[str, Any]:
    """All that the map knows of one entity; with `at` (ISO 8601), where it was at that time."""
    thing = _entity(connection, name)
    known = dict(
        connection.execute(
            text(
                "SELECT e.name, e.kind, e.type, e.label, h.name AS holder, p.relation, "
                "p.confidence, s.name AS storey, w.pose, e.properties, e.front, e.since, e.source, "
                "CAST(Box3D(w.box) AS text) AS box, ST_AsText(w.footprint, 3) AS footprint "
                "FROM entity e LEFT JOIN placement p ON p.entity_id = e.id "
                "LEFT JOIN entity h ON h.id = p.holder_id LEFT JOIN world w ON w.entity_id = e.id "
                "LEFT JOIN entity s ON s.id = w.storey_id WHERE e.id = :id"
            ),
            {"id": thing},
        )
        .mappings()
        .one()
    )
    if known["pose"] is not None:
        known["pose"] = [round(v, 6) for v in known["pose"]]
    lists = {
        "types": "SELECT type FROM object WHERE id = :id ORDER BY type",
        "holds": "SELECT e.name FROM inventory i JOIN entity e ON e.id = i.ob_id "
        "WHERE i.inv_id = :id ORDER BY e.name",
        "connectors": "SELECT e.name FROM connector c JOIN entity e ON e.id = c.entity_id "
        "WHERE :id IN (c.place_a, c.place_b) ORDER BY e.name",
        "links": "SELECT l.relation || ' ' || e.name FROM link l JOIN entity e ON e.id = l.to_id "
        "WHERE l.from_id = :id ORDER BY 1",
        "missing": "SELECT unnest(missing) FROM incomplete WHERE id = :id",
    }
    for key, statement in lists.items():
        known[key] = list(connection.execute(text(statement), {"id": thing}).scalars())
    known["models"] = [
        dict(row)
        for row in connection.execute(
            text(
                "SELECT m.kind, m.triangles, m.uri, em.role FROM entity_model em "
                "JOIN model m ON m.id = em.model_id WHERE em.entity_id = :id ORDER BY m.id"
            ),
            {"id": thing},
        ).mappings()
    ]
    joins = (
        connection.execute(
            text(
                "SELECT a.name AS place_a, coalesce(b.name, 'outside') AS place_b, c.form, "
                "c.direction, c.state, c.behaviour, c.width, c.pose_a, c.pose_b FROM connector c "
                "JOIN entity a ON a.id = c.place_a LEFT JOIN entity b ON b.id = c.place_b "
                "WHERE c.entity_id = :id"
            ),
            {"id": thing},
        )
        .mappings()
        .one_or_none()
    )
    if joins is not None:
        known["joins"] = dict(joins)
    if at is not None:
        try:
            moment = datetime.fromisoformat(at)
        except ValueError:
            raise ValueError(
                f"--at takes a time as ISO 8601 has it, 2026-01-31T10:00, not {at}"
            ) from None
        if moment.tzinfo is None:
            moment = moment.astimezone()
        pose = connection.execute(
            text("SELECT pose_at(:id, :at)"), {"id": thing, "at": moment}
        ).scalar()
        holder = connection.execute(
            text(
                "SELECT e.name FROM placement_at(:id, :at) p "
                "LEFT JOIN entity e ON e.id = p.holder_id"
            ),
            {"id": thing, "at": moment},
        ).scalar()
        known["then"] = {"at": moment.isoformat(), "pose": pose, "holder": holder}
    return known


def run_sql(connection: Connection, statement: str, *, write: bool) -> Rows:
    """Run one statement as it stands; without `write`, one that reads, and can only read.

    Without `write`, the transaction is read-only, and a superuser has the role ``semmap_reader``
    in it. That role is left by a function such as ``set_config``: only a login that is not a
    superuser keeps a hostile statement from it (`semmap.database.as_reader`).

    Raises
    ------
    ValueError
        There is no statement, or it copies from standard input or to standard output, or it does
        not read while `write` is not given.
    """
    driver = connection.connection.driver_connection
    assert isinstance(driver, psycopg.Connection)
    if not statement.strip(" \t\r\n;"):
        raise ValueError("no statement: give one, or - to read it from standard input")
    if not write:
        _check_that_it_reads(driver, statement)
        connection.exec_driver_sql("SET TRANSACTION READ ONLY")
        if is_superuser(connection):
            connection.exec_driver_sql("SET LOCAL ROLE semmap_reader")
    cursor = driver.cursor()
    for name, loader in _LENIENT.items():
        cursor.adapters.register_loader(name, loader)
    try:
        # Prepared, so that it is one statement: no COMMIT in it ends the read-only transaction.
        cursor.execute(statement, prepare=None if write else True)
    except psycopg.ProgrammingError as error:
        if "COPY" not in str(error) or error.sqlstate is not None:
            raise
        connection.invalidate()  # it waits for data that nobody sends
        raise ValueError("semmap sql copies nothing to and fro: semmap db psql does") from None
    if cursor.description is None:
        return ["rows"], [(cursor.rowcount,)]
    return [column[0] for column in cursor.description], cursor.fetchall()


def is_superuser(connection: Connection) -> bool:
    """Whether a connection has the rights of a superuser."""
    return bool(
        connection.exec_driver_sql(
            "SELECT rolsuper FROM pg_roles WHERE rolname = current_user"
        ).scalar()
    )


def _check_that_it_reads(driver: psycopg.Connection[Any], statement: str) -> None:
    word = kind(statement)
    if word in READING:
        return
    parsed = driver.pgconn.prepare(b"", statement.encode())
    if parsed.status != ExecStatus.COMMAND_OK:  # not a statement, or several
        raise psycopg.errors.error_from_result(parsed)
    raise ValueError(
        f"permission denied for {word}: without --write, semmap sql runs {', '.join(READING[:-1])} "
        f"and {READING[-1]}. Add --write to run it with all your rights, or use semmap db psql"
    )


def _lenient(usual: type[Loader]) -> type[Loader]:
    """A loader that gives what Python has no time for as text: infinity, years before Christ."""

    class Lenient(usual):  # type: ignore[misc, valid-type]
        def load(self, data: Buffer) -> Any:
            try:
                return super().load(data)
            except psycopg.DataError:
                return bytes(data).decode()

    return Lenient


_LENIENT = {
    "timestamptz": _lenient(TimestamptzLoader),
    "timestamp": _lenient(TimestampLoader),
    "date": _lenient(DateLoader),
}


def changes(
    connection: Connection, since: str | None
) -> tuple[str, list[str], list[tuple[Any, ...]]]:
    """Changes after a cursor (all that are kept where None), and the cursor for the next call.

    Commit the transaction before the cursor leaves this process: then it survives a crash of the
    server.
    """
    if since is not None and not re.fullmatch(r"\d+:\d+:[\d,]*", since):
        raise ValueError(
            f"{since} is no cursor: give the one that an earlier call printed, or none"
        )
    # One statement, so that cursor and rows are of one snapshot.
    columns, rows = _rows(
        connection,
        "SELECT change_cursor(), c.id, c.at, m.name AS map, c.what, c.entities "
        "FROM (SELECT) once LEFT JOIN changes_since(:since) c ON true "
        "LEFT JOIN map m ON m.id = c.map_id ORDER BY c.id",
        {"since": since},
    )
    settle(connection)
    return str(rows[0][0]), columns[1:], [row[1:] for row in rows if row[1] is not None]


def unique_names(columns: list[str]) -> list[str]:
    """Column names, a repeated one numbered: label, label_2.

    >>> unique_names(["label", "label", "box3d"])
    ['label', 'label_2', 'box3d']
    """
    names: list[str] = []
    for column in columns:
        numbered = (f"{column}_{n}" for n in count(2))
        names.append(next(n for n in chain([column], numbered) if n not in names))
    return names


def plain(value: Any) -> Any:
    """A value as JSON has it; numbers that it has no form for, and all else, as PostgreSQL says."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, Decimal) and value.is_finite():
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, float | Decimal) and not math.isfinite(value):
        return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, bytes | memoryview):
        return "\\x" + bytes(value).hex()
    if isinstance(value, Range):
        return _range(value)
    return value if isinstance(value, str | int | float | None) else str(value)


def _range(value: Range[Any]) -> str:
    if value.isempty:
        return "empty"
    low, high = ("" if end is None else str(end) for end in (value.lower, value.upper))
    return f"{'[' if value.lower_inc else '('}{low},{high}{']' if value.upper_inc else ')'}"


def readable(value: Any) -> str:
    """A value as a table shows it."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict | list):
        return ", ".join(map(str, value)) if _flat(value) else json.dumps(value, default=str)
    return str(value)


def _flat(value: Any) -> bool:
    return isinstance(value, list) and not any(isinstance(v, dict | list) for v in value)


def _entity(connection: Connection, name: str) -> int:
    thing = connection.execute(text("SELECT entity_id(:name)"), {"name": name}).scalar()
    if thing is None:
        _known(connection, "SELECT name FROM entity WHERE map_id = current_map()", name, "entity")
    return int(thing)  # type: ignore[arg-type]


def _known(connection: Connection, statement: str, name: str, what: str) -> None:
    names = list(connection.execute(text(statement)).scalars())
    if name not in names:
        close = difflib.get_close_matches(name, names, n=3)
        hint = f"; did you mean {', '.join(close)}?" if close else "; semmap ls lists what there is"
        raise LookupError(f"the map has no {what} {name}{hint}")


def _point(connection: Connection, near: str) -> list[float]:
    if "," in near:
        return _numbers(near, 3, "--near")
    pose = connection.execute(
        text("SELECT pose FROM world WHERE entity_id = :id"), {"id": _entity(connection, near)}
    ).scalar()
    if pose is None:
        raise ValueError(f"{near} has no placement: give --near a point x,y,z")
    return list(pose[:3])


def _numbers(said: str, count: int, option: str) -> list[float]:
    try:
        numbers = [float(v) for v in said.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{option} takes {count} numbers with commas between, not {said}")
    return numbers


def _value(said: str) -> Any:
    try:
        return json.loads(said)
    except json.JSONDecodeError:
        return said
