"""Observations and beliefs in the database, of the map that the connection sees.

The database computes beliefs (`schema/functions/480_belief.sql`): after a new observation, it
updates the rows of the object in the table ``belief`` and announces the change.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, TypeAlias

import psycopg
from psycopg import errors
from psycopg.rows import dict_row

from semmap.belief.error import BeliefError
from semmap.finite_number import is_finite_number
from semmap.query.entity_query import entity_id
from semmap.query.refusal import refusal_text
from semmap.query.snapshot import Snapshot
from semmap.snake_case import snake_case
from semmap.suggestions import suggestion

ELSEWHERE = "elsewhere"
"""The name of being at no place of the map."""

Session: TypeAlias = psycopg.Connection[Any]
Row = dict[str, Any]

RATES = ("hit", "false_alarm")
COLUMNS = ("object", "place", "seen", "at", "inside", "position", "visible", *RATES, "observer")
"""The values of an observation; the first three are required."""


def read_belief(
    seen: Snapshot, name: str, at: datetime | None = None, moves: float | None = None
) -> dict[str, float]:
    """Return the probabilities by names of places, the most probable first, and of `ELSEWHERE`.

    They sum to 1 within 1e-12. Arguments and errors are those of `where`.
    """
    return {row["place"]: row["probability"] for row in where(seen, name, at, moves)}


def where(
    seen: Snapshot, name: str, at: datetime | None = None, moves: float | None = None
) -> list[Row]:
    """Return the rows of the SQL function ``where_is``: the belief with its reasons.

    Of a type, they are about any thing of the type: the mean of the beliefs about each. It is by
    the evidence until `at` (now where None), at its age then; `moves` are the seconds in which an
    object of mobility 1 moves once. `BeliefError` if it is not an object or agent, or `at` has no
    time zone.
    """
    if at is not None and at.tzinfo is None:
        raise BeliefError(f"the time {at.isoformat()} has no time zone: give it with one")
    beliefs = [_where(seen, thing, at, moves) for thing in things_named(seen, name)]
    return beliefs[0] if len(beliefs) == 1 else _of_any(beliefs)


def things_named(seen: Snapshot, name: str) -> list[str]:
    """Return the entity of a name, else the objects and agents of the type of that name."""
    try:
        entity_id(seen.session, name)
    except LookupError:
        type_ = snake_case(name)
        rows = seen.session.execute(
            "SELECT name FROM entity WHERE map_id = current_map() AND type = ANY (subtypes(%s)) "
            "AND kind IN ('object', 'agent') ORDER BY name",
            (type_,),
        ).fetchall()
        if rows:
            return [str(row[0]) for row in rows]
        known = [row[0] for row in seen.session.execute("SELECT name FROM semantic_type")]
        if type_ not in known:
            entities = "SELECT name FROM entity WHERE map_id = current_map()"
            names = [row[0] for row in seen.session.execute(entities)]
            hint = suggestion(name, [*names, *known], "semmap ls and semmap types list the names")
            raise LookupError(f"the map has no entity {name}{hint}") from None
        raise LookupError(f"the map has no {type_}: add or teach an object of this type") from None
    return [name]


def _of_any(beliefs: Sequence[list[Row]]) -> list[Row]:
    """The mean of some beliefs, the most probable place first."""
    found: dict[str, Row] = {}
    for row in (row for rows in beliefs for row in rows):
        mean = found.setdefault(row["place"], row | {"probability": 0.0, "prior": 0.0})
        for key in ("probability", "prior"):
            mean[key] += row[key] / len(beliefs)
        for key in ("last_seen", "last_missed"):
            mean[key] = max(filter(None, (mean[key], row[key])), default=None)
    return sorted(found.values(), key=lambda row: -row["probability"])


def _where(seen: Snapshot, name: str, at: datetime | None, moves: float | None) -> list[Row]:
    try:
        with seen.session.cursor(row_factory=dict_row) as cursor:
            rows = cursor.execute(
                "SELECT * FROM where_is(%s, coalesce(%s, statement_timestamp()), %s)",
                (name, at, moves),
            ).fetchall()
    except errors.CheckViolation as error:
        raise refusal(error) from error
    if len({row["place"] for row in rows}) < len(rows):
        raise BeliefError(f"the map has a place of the name {ELSEWHERE}: rename it")
    return rows


def initial_belief(
    seen: Snapshot, names: Sequence[str], at: datetime | None = None
) -> dict[str, list[Any]]:
    """Return the message of the thesis's appendix B.2: locations, and a distribution for each name.

    `location` has the names of all places, `ELSEWHERE` last; each name its probabilities in that
    order. `BeliefError` as `where`, and for a name that is ``location``.
    """
    if "location" in names:
        raise BeliefError("an object of the name location has no place in this message: rename it")
    beliefs = {name: read_belief(seen, name, at) for name in names}
    places = sorted({place for belief in beliefs.values() for place in belief} - {ELSEWHERE})
    places.append(ELSEWHERE)
    return {"location": list(places)} | {
        name: [belief.get(place, 0.0) for place in places] for name, belief in beliefs.items()
    }


def add_observations(session: Session, rows: Iterable[Mapping[str, Any]]) -> list[int]:
    """Store observations, and return their ids; the beliefs follow in the same transaction.

    `object` and `place` of a row are names, `seen` is a bool. Optional: `at` (aware datetime, or
    text in ISO 8601 with a time zone; by default now), `visible` (the share of the place in view,
    in (0, 1]), `hit` and `false_alarm`, `position` (x, y, z in the frame of the place, metres),
    `inside` (anywhere in the place), `observer` (name of an agent). `BeliefError` for a value out
    of its range, the future, or a place without room for the object; no row is stored.
    """
    checked = [_checked(row, number) for number, row in enumerate(rows, 1)]
    if not checked:
        return []
    ids: dict[str, int] = {}
    for row in checked:
        for key in ("object", "place", "observer"):
            if row[key] is not None and row[key] not in ids:
                ids[row[key]] = entity_id(session, row[key])
    columns = [
        [ids.get(row["object"]) for row in checked],
        [ids.get(row["place"]) for row in checked],
        [ids.get(row["observer"]) for row in checked],
        *([row[key] for row in checked] for key in ("seen", "at", "inside", "visible", *RATES)),
        *([row["position"] and row["position"][axis] for row in checked] for axis in range(3)),
    ]
    try:
        with session.transaction():
            return [number for (number,) in session.execute(INSERT, columns).fetchall()]
    except errors.CheckViolation as error:
        raise refusal(error) from error


INSERT = """
INSERT INTO observation (entity_id, place_id, observer_id, seen, at, inside, visible, hit,
                         false_alarm, position)
SELECT object, place, observer, seen, coalesce(at, statement_timestamp()), inside, visible, hit,
       false_alarm, CASE WHEN x IS NOT NULL THEN ARRAY[x, y, z] END
FROM unnest(%s::bigint[], %s::bigint[], %s::bigint[], %s::boolean[], %s::timestamptz[],
            %s::boolean[], %s::float8[], %s::float8[], %s::float8[], %s::float8[], %s::float8[],
            %s::float8[]) o (object, place, observer, seen, at, inside, visible, hit, false_alarm,
                             x, y, z)
RETURNING id
"""


def refusal(error: errors.CheckViolation) -> BeliefError:
    """The database's refusal as an error of this package."""
    return BeliefError(refusal_text(error))


def _checked(row: Mapping[str, Any], number: int) -> Row:
    """The columns of an observation, with its defaults; `number` is its place in the input."""
    where = f"observation {number}"
    unknown = [key for key in row if key not in COLUMNS]
    if unknown:
        raise BeliefError(f"{where}: {unknown[0]} is not one of {', '.join(COLUMNS)}")
    for key in ("object", "place"):
        if not isinstance(row.get(key), str) or not row[key]:
            raise BeliefError(f"{where}: {key} is {row.get(key)!r}: give the name of an entity")
    where += f" ({row['object']} at {row['place']})"
    for key in ("seen", "inside"):
        if not isinstance(row.get(key, key == "inside"), bool):
            raise BeliefError(f"{where}: {key} is {row.get(key)!r}: give true or false")
    found: Row = dict.fromkeys(COLUMNS) | {"inside": False, "visible": 1.0} | dict(row)
    if row["object"] == row["place"]:
        raise BeliefError(f"{where}: an object is not its own place: name what it is on or in")
    found["at"] = _moment(found["at"], where)
    visible = found["visible"]
    if not (is_finite_number(visible) and 0 < visible <= 1):
        raise BeliefError(f"{where}: visible is {visible!r}: give the share in view, in (0, 1]")
    for key in RATES:
        rate = found[key]
        if rate is not None and not (is_finite_number(rate) and 0 < rate < 1):
            raise BeliefError(f"{where}: {key} is {rate!r}: give a probability between 0 and 1")
    spot = found["position"]
    if spot is not None and not (
        isinstance(spot, list | tuple) and len(spot) == 3 and all(map(is_finite_number, spot))
    ):
        raise BeliefError(f"{where}: position is {spot!r}: give x, y, z in metres")
    if spot is not None:
        refuse_far(spot, where)
    return found


FARTHEST = 1e7
"""Metres from its frame's origin at which nothing of a map is, as the table placement has it."""


def refuse_far(point: Sequence[float], what: str) -> None:
    """Raise `BeliefError` for a point that is too far away for a map."""
    far = max(point, key=abs)
    if abs(far) > FARTHEST:
        raise BeliefError(
            f"{what}: the coordinate {far:.6g} is out of range: give metres of at most {FARTHEST:g}"
        )


def _moment(given: Any, where: str) -> datetime | None:
    """The time of an observation, aware; None for the present."""
    if given is None:
        return None
    if isinstance(given, str):
        try:
            given = datetime.fromisoformat(given)
        except ValueError:
            raise BeliefError(
                f"{where}: at is {given!r}: give ISO 8601, such as 2026-05-01T12:00:00Z"
            ) from None
    if not isinstance(given, datetime) or given.tzinfo is None:
        raise BeliefError(f"{where}: at is {given}: give a time with its time zone")
    if given > datetime.now(UTC):
        raise BeliefError(
            f"{where}: at is {given.isoformat()}, in the future: give a time in the past, or "
            "compare the clocks"
        )
    return given
