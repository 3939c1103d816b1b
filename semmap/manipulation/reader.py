"""Stored actions by instance, function, pose and shape; the best expected outcome first.

The queries of the paper (section III): "Grasp a cup!" is `actions_on(seen, name="cup")`,
"Grasp something suitable for drinking!" `actions_on(seen, function="drinking")`, and "Grasp
the object at pose [x, y, z]!" `actions_on(seen, point=(x, y, z))`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.rows import dict_row

from semmap.belief.store.beliefs import Session
from semmap.finite_number import finite_numbers, is_finite_number
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import KINDS
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.solids import SIZES
from semmap.manipulation.store.database_answers import column, refusals
from semmap.manipulation.store.devices import ABLE, gripper_id
from semmap.query.snapshot import Snapshot
from semmap.suggestions import suggestion

Row = dict[str, Any]

STORED = 1000
"""The most stored actions on an object that are considered."""

POSES = ("pose", "pre_pose", "post_pose", "model_pose", "shape_pose")


def in_model(row: Row, key: str) -> NDArray[np.float64]:
    """A pose (4, 4) of a row of `actions_on` in the frame of the model; else that at contact."""
    there: Pose = row[key] or row["pose"]
    pose: NDArray[np.float64] = row["model_pose"].matrix @ np.linalg.inv(row["pose"].matrix)
    return pose @ there.matrix


def actions_on(
    seen: Snapshot,
    *,
    name: str | None = None,
    function: str | None = None,
    point: Sequence[float] | None = None,
    tolerance: float = 0.05,
    gripper: str | None = None,
    kind: str = "grasp",
    limit: int = 10,
) -> list[Row]:
    """Return the best stored actions on objects of the map (the SQL function ``actions_on``).

    Parameters
    ----------
    name : of an entity, or of a type: any object of the type
    function : what the object is used for, such as drinking
    point : (x, y, z) in the map's frame, metres; the object there, or within the tolerance
    gripper : name; the preferred one where None
    kind : grasp, place, push, turn, open or put

    Returns
    -------
    list of dict
        `entity`, `action_id`, `object_id`, `kind`, `approach`, `family`, `expected` (share of
        successes), `attempts`, `successes`, `width`, `posture`, `pre_posture`, `contributor`;
        `pose`, `pre_pose` and `post_pose` in the map's frame, `model_pose` and `motion` in the
        model's. Of linked models, `link` is the confidence, by which `expected` is multiplied, and
        `frame` tells how its frame lies in that of the object's own model: by equal primitives
        (shape) or taken as equal (model); else both are None. Empty where nothing is stored.

    Raises
    ------
    LookupError
        A name, function or gripper that does not exist, or no object at the point.
    ManipulationError
        Not exactly one of `name`, `function` and `point`, or a kind that is not known.
    """
    _check_kind(kind)
    function = function and function_named(seen.session, function)
    meant, values = _meant(name, function, point, tolerance)
    with _suggestions(seen, name, gripper):
        return _rows(
            seen.session,
            f"SELECT * FROM actions_on({meant}, %s, %s, %s)",
            (*values, gripper, kind, limit),
        )


def entities_meant(
    seen: Snapshot,
    *,
    name: str | None = None,
    function: str | None = None,
    point: Sequence[float] | None = None,
    tolerance: float = 0.05,
) -> list[int]:
    """The ids of the objects that a query means; as `actions_on`."""
    function = function and function_named(seen.session, function)
    meant, values = _meant(name, function, point, tolerance)
    with _suggestions(seen, name):
        return column(seen.session, f"SELECT unnest({meant})", values)


def _meant(
    name: str | None, function: str | None, point: Sequence[float] | None, tolerance: float
) -> tuple[str, tuple[Any, ...]]:
    """The SQL of the entities that a query means, and its values."""
    if sum(given is not None for given in (name, function, point)) != 1:
        raise ManipulationError("give one of a name, a function and a point")
    if name is not None:
        return "entities_named(%s)", (name,)
    if function is not None:
        return "entities_for(%s)", (function,)
    assert point is not None
    numbers = finite_numbers(point, 3)
    if numbers is None:
        raise ManipulationError(f"a point is x, y, z in metres, not {point}")
    _check_tolerance(tolerance)
    return "ARRAY[entity_at(%s, %s, %s, %s)]", (*numbers, tolerance)


@contextmanager
def _suggestions(seen: Snapshot, name: str | None, gripper: str | None = None) -> Iterator[None]:
    """Name similar names where one is unknown; they are looked up only then."""
    inside = seen.session.info.transaction_status != psycopg.pq.TransactionStatus.IDLE
    try:
        with seen.session.transaction() if inside else nullcontext(), refusals():
            yield
    except LookupError:
        if gripper is not None:
            gripper_id(seen.session, gripper)
        if name is not None:
            _check_name(seen, name)
        raise


def function_named(session: Session, word: str) -> str:
    """The function of a word: ``drink`` and ``drinking`` are drinking; LookupError without one."""
    exact = "SELECT 1 FROM {} WHERE functions @> ARRAY[%s] LIMIT 1"
    with refusals():
        for table in ("semantic_type", "object_model"):
            if session.execute(exact.format(table).encode(), (word,)).fetchone():
                return word
    known = column(
        session,
        "SELECT DISTINCT unnest(functions) FROM semantic_type "
        "UNION SELECT DISTINCT unnest(functions) FROM object_model ORDER BY 1",
    )
    begun = [function for function in known if function.startswith(word) and len(word) > 2]
    if len(begun) == 1:
        return str(begun[0])
    otherwise = f"known: {', '.join(known)}" if known else "semmap import FILE loads the T-Box"
    raise LookupError(
        f"no type and no object model has the function {word}{suggestion(word, known, otherwise)}"
    )


def actions_by_shape(
    session: Session,
    shape: str,
    size: Sequence[float],
    *,
    tolerance: float = 0.01,
    gripper: str | None = None,
    kind: str = "grasp",
    limit: int = 10,
) -> list[Row]:
    """The best stored actions on models of a shape, sizes within the tolerance, in its frame."""
    _check_kind(kind)
    numbers = finite_numbers(size, len(SIZES[shape])) if shape in SIZES else None
    if numbers is None or min(numbers) <= 0:
        by_count = sorted(SIZES.items(), key=lambda item: len(item[1]))
        known = ", ".join(f"{name} ({len(sizes)} sizes)" for name, sizes in by_count)
        raise ManipulationError(
            f"{shape} {list(size)} is not a shape: give one of {known}, sizes in metres above 0"
        )
    _check_tolerance(tolerance)
    return _rows(
        session,
        "SELECT * FROM actions_by_shape(%s, %s::float8[], %s, %s, %s, %s)",
        (shape, list(numbers), tolerance, gripper, kind, limit),
    )


def read_shape(session: Session, object_id: int) -> Row | None:
    """Return `shape`, `size`, `shape_pose`, `inliers` and `deviation` of an object model."""
    rows = _rows(
        session,
        "SELECT shape, size, shape_pose, inliers, deviation FROM object_model "
        "WHERE id = %s AND shape IS NOT NULL",
        (object_id,),
    )
    return rows[0] if rows else None


def list_grippers(session: Session) -> list[Row]:
    """Return the stored grippers, with the number of actions of each."""
    return _rows(
        session,
        "SELECT d.name, g.form, g.opening, g.depth, g.force, g.preferred, d.source, "
        "(SELECT count(*) FROM action a WHERE a.gripper_id = d.id) AS actions "
        "FROM gripper g JOIN device d ON d.id = g.device_id ORDER BY d.name",
        (),
    )


AUTOMATA = """
WITH mounted AS (
    SELECT a.id, d.id AS device_id, d.name, d.kind, d.capabilities
    FROM automaton a JOIN device r ON r.id = a.robot_id
    JOIN device d ON d.id IN (r.id, a.gripper_id, a.sensor_id)
      OR d.kind = 'sensor' AND starts_with(d.name, r.name || '/')
)
SELECT a.name, r.name AS robot, g.name AS gripper, s.name AS sensor,
       ARRAY(SELECT m.name FROM mounted m WHERE m.id = a.id AND m.kind = 'sensor'
             ORDER BY m.device_id) AS sensors,
       ARRAY(SELECT DISTINCT c FROM mounted m, unnest(m.capabilities) c WHERE m.id = a.id
             ORDER BY 1) AS capabilities
FROM automaton a JOIN device r ON r.id = a.robot_id
LEFT JOIN device g ON g.id = a.gripper_id LEFT JOIN device s ON s.id = a.sensor_id ORDER BY a.name
"""


def list_automata(session: Session, can: Sequence[str] = ()) -> list[Row]:
    """The stored robots with what is mounted on them and what they are able to do.

    `can` are kinds of actions, or capabilities (seeing, or see): only robots that are able to do
    all; LookupError where a word is neither. `sensor` is the one of `sensors` that serves
    manipulation most.
    """
    rows = _rows(session, AUTOMATA, ())
    known = {c for row in rows for c in row["capabilities"]} | set(ABLE)
    needed: set[str] = set()
    for word in can:
        if word in KINDS:
            ((required,),) = session.execute("SELECT required_capabilities(%s)", (word,)).fetchall()
            needed |= set(required)
            continue
        named = [
            c for c in known if word in (c, c.removesuffix("ing"), c.removesuffix("ing") + "e")
        ]
        if not named:
            words = sorted({*KINDS, *known})
            raise LookupError(f"there is no capability {word}{suggestion(word, words)}")
        needed |= set(named)
    return [row for row in rows if needed <= set(row["capabilities"])]


def list_contributors(session: Session) -> list[Row]:
    """Return whose knowledge the database has: trust, actions, and attempts that it counts."""
    return _rows(
        session,
        "SELECT c.name, c.trust, encode(c.key, 'hex') AS key, c.latest, "
        "(SELECT count(*) FROM action a WHERE a.contributor_id = c.id) AS actions, "
        "(SELECT coalesce(sum(e.attempts), 0) FROM experience e WHERE e.contributor_id = c.id) "
        "AS attempts FROM contributor c ORDER BY c.id",
        (),
    )


def list_tasks(seen: Snapshot, limit: int = 20) -> list[Row]:
    """Return the newest tasks of the map, with their outcomes."""
    return _rows(
        seen.session,
        "SELECT t.id, t.kind, e.name AS entity, r.name AS robot, t.outcome, t.message, "
        "t.action_id, c.name AS contributor, t.created_at, t.ended_at FROM task t "
        "LEFT JOIN entity e ON e.id = t.entity_id LEFT JOIN entity r ON r.id = t.robot_id "
        "JOIN contributor c ON c.id = t.contributor_id "
        "WHERE t.map_id = current_map() ORDER BY t.id DESC LIMIT %s",
        (limit,),
    )


def _check_kind(kind: str) -> None:
    if kind not in KINDS:
        raise ManipulationError(f"{kind} is not one of {', '.join(KINDS)}")


def _check_tolerance(tolerance: float) -> None:
    if not (is_finite_number(tolerance) and tolerance >= 0):
        raise ManipulationError(f"the tolerance is {tolerance}: give metres, at least 0")


def _check_name(seen: Snapshot, name: str) -> None:
    """LookupError where a name is neither an entity nor a type."""
    names = column(
        seen.session,
        "SELECT name FROM entity WHERE map_id = current_map() UNION SELECT name FROM semantic_type",
    )
    if name not in names:
        raise LookupError(
            f"the map has neither an object nor a type {name}"
            f"{suggestion(name, names, 'semmap ls and semmap types list them')}"
        )


def _rows(session: Session, query: str, values: Sequence[Any]) -> list[Row]:
    with refusals(), session.cursor(row_factory=dict_row) as cursor:
        rows = cursor.execute(query.encode(), values).fetchall()
    for row in rows:
        for key in POSES:
            if row.get(key) is not None:
                row[key] = Pose(*row[key])
    return rows
