"""Manipulation knowledge into the database: grippers, object models, actions, paths, outcomes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import psycopg
from psycopg import errors
from psycopg.types.json import Jsonb

from semmap.belief.store import MapConnection, driver
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord, action_key, pose_of
from semmap.manipulation.error import ManipulationError
from semmap.query.entity_query import entity_id
from semmap.suggestions import suggestion

__all__ = [
    "add_actions",
    "add_automaton",
    "add_device",
    "add_gripper",
    "add_object",
    "add_path",
    "add_put",
    "add_task",
    "contributor_id",
    "end_task",
    "gripper_id",
    "insert_actions",
    "object_model_id",
    "record_task",
    "refusals",
    "set_shape",
]

OWN, SIMULATION = "own", "simulation"
"""Contributors that each database has: its own robots, and simulated ones."""

CAPABILITIES = {
    "gripper": ("gripping", "pushing"),
    "robot": ("reaching",),
    "sensor": ("sensing",),
}
"""What components are able to do, where nothing else is stated."""


@contextmanager
def refusals() -> Iterator[None]:
    """Raise refusals of the database as errors of this package, or LookupError for a name."""
    try:
        yield
    except errors.CheckViolation as error:
        name = error.diag.constraint_name
        parts = (error.diag.message_primary, error.diag.message_hint)
        raise ManipulationError(
            f"refused: {name.replace('_', ' ')}" if name else ". ".join(filter(None, parts))
        ) from error
    except errors.NoDataFound as error:
        parts = (error.diag.message_primary, error.diag.message_hint)
        raise LookupError(". ".join(filter(None, parts))) from error
    except errors.InsufficientPrivilege as error:
        raise ManipulationError(
            f"this login may not do that ({error.diag.message_primary}): ask an admin"
        ) from error


# -- automata -------------------------------------------------------------------------------------


def add_device(
    connection: MapConnection,
    name: str,
    kind: str,
    *,
    urdf: str | None = None,
    source: Path | str | None = None,
    joints: Mapping[str, tuple[float, float]] | None = None,
    capabilities: Sequence[str] | None = None,
) -> int:
    """Store a robot, gripper or sensor, or update the one of this name; return its id.

    Parameters
    ----------
    kind : robot, gripper or sensor; a gripper also needs `add_gripper`
    urdf : text of its URDF
    source : the file of the URDF, with its meshes
    joints : limits by name, radians or metres
    capabilities : by default those of its kind (`CAPABILITIES`)

    Raises
    ------
    ManipulationError
        `kind` is not known, or a device of this name is of another kind.
    """
    if kind not in CAPABILITIES:
        raise ManipulationError(f"{name}: {kind} is not one of {', '.join(CAPABILITIES)}")
    session = driver(connection)
    limits = {joint: list(pair) for joint, pair in (joints or {}).items()}
    with refusals(), session.transaction():
        row = session.execute("SELECT id, kind FROM device WHERE name = %s", (name,)).fetchone()
        if row is not None and row[1] != kind:
            raise ManipulationError(f"{name}: there is a {row[1]} of this name: choose another one")
        values = (
            kind,
            urdf,
            None if source is None else str(source),
            Jsonb(limits),
            list(CAPABILITIES[kind] if capabilities is None else capabilities),
            name,
        )
        statement = (
            "INSERT INTO device (kind, urdf, source, joints, capabilities, name) "
            "VALUES (%s, %s, %s, %s, %s, %s) RETURNING id"
            if row is None
            else "UPDATE device SET kind = %s, urdf = %s, source = %s, joints = %s, "
            "capabilities = %s WHERE name = %s RETURNING id"
        )
        return _number(session.execute(statement, values))


def add_gripper(
    connection: MapConnection,
    name: str,
    *,
    form: str,
    opening: float,
    depth: float,
    urdf: str | None = None,
    source: Path | str | None = None,
    joints: Mapping[str, tuple[float, float]] | None = None,
    preferred: bool | None = None,
) -> int:
    """Store a gripper, or update the one of this name; return its id.

    Parameters
    ----------
    form : parallel or multi-finger
    opening, depth : the widest object that it closes on, and how deep its fingers are, metres
    preferred : meant where a query names no gripper; by default, the first one is

    Raises
    ------
    ManipulationError
        A size is not positive, or a device of this name is not a gripper.
    """
    session = driver(connection)
    if not (math.isfinite(opening) and opening > 0):
        raise ManipulationError(f"gripper {name}: its opening is {opening}: give metres above 0")
    if not (math.isfinite(depth) and depth >= 0):
        raise ManipulationError(f"gripper {name}: its depth is {depth}: give metres, at least 0")
    with refusals(), session.transaction():
        id_ = add_device(session, name, "gripper", urdf=urdf, source=source, joints=joints)
        first = session.execute("SELECT NOT EXISTS (SELECT FROM gripper)").fetchone()
        if preferred is None:
            preferred = bool(first and first[0])
        if preferred:
            session.execute("UPDATE gripper SET preferred = false WHERE preferred")
        session.execute(
            "INSERT INTO gripper (device_id, form, opening, depth, preferred) "
            "VALUES (%s, %s, %s, %s, %s) ON CONFLICT (device_id) DO UPDATE SET "
            "form = excluded.form, opening = excluded.opening, depth = excluded.depth, "
            "preferred = excluded.preferred OR gripper.preferred",
            (id_, form, opening, depth, preferred),
        )
    return id_


def add_automaton(
    connection: MapConnection,
    name: str,
    robot: str,
    gripper: str | None = None,
    sensor: str | None = None,
) -> int:
    """Store a robot with a gripper and a sensor, all by their names; return its id.

    Raises
    ------
    LookupError
        There is no device of a name.
    """
    session = driver(connection)
    ids: list[int | None] = []
    for kind, device in (("robot", robot), ("gripper", gripper), ("sensor", sensor)):
        row = session.execute(
            "SELECT id FROM device WHERE kind = %s AND name = %s", (kind, device)
        ).fetchone()
        if device is not None and row is None:
            known = _column(session, "SELECT name FROM device WHERE kind = %s", (kind,))
            raise LookupError(f"there is no {kind} {device}{suggestion(device, known)}")
        ids.append(None if row is None else row[0])
    with refusals():
        return _number(
            session.execute(
                "INSERT INTO automaton (name, robot_id, gripper_id, sensor_id) "
                "VALUES (%s, %s, %s, %s) ON CONFLICT (name) DO UPDATE SET "
                "robot_id = excluded.robot_id, gripper_id = excluded.gripper_id, "
                "sensor_id = excluded.sensor_id RETURNING id",
                (name, *ids),
            )
        )


def gripper_id(connection: MapConnection, name: str | None = None) -> int:
    """Return the id of a gripper; without a name, of the preferred one, else of the only one.

    Raises
    ------
    LookupError
        There is none of this name, none at all, or several and none is preferred.
    """
    session = driver(connection)
    if name is not None:
        known = _column(
            session, "SELECT d.name FROM device d JOIN gripper g ON g.device_id = d.id ORDER BY 1"
        )
        if name not in known:
            hint = suggestion(name, known, "semmap manipulation add-gripper URDF adds one")
            raise LookupError(f"there is no gripper {name}{hint}")
    with refusals():
        return _number(session.execute("SELECT gripper_named(%s)", (name,)))


# -- object models --------------------------------------------------------------------------------


def object_model_id(connection: MapConnection, model: str | int) -> int:
    """Return the id of an object model: of an entity's mesh, which is made if nothing is known yet.

    Parameters
    ----------
    model : name of an entity, or id of an object model

    Raises
    ------
    LookupError
        The map has no entity of this name, or there is no object model of this id.
    ManipulationError
        The entity has no mesh, so that nothing could be shared with others of its model.
    """
    session = driver(connection)
    if isinstance(model, int):
        if session.execute("SELECT 1 FROM object_model WHERE id = %s", (model,)).fetchone():
            return model
        raise LookupError(f"there is no object model {model}")
    entity = entity_id(session, model)
    row = session.execute(
        "SELECT object_of(e.id), e.type, "
        "(SELECT m.digest FROM entity_model em JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = e.id AND m.triangles > 0 ORDER BY em.role DESC, m.id LIMIT 1), "
        "(SELECT m.uri FROM entity_model em JOIN model m ON m.id = em.model_id "
        "WHERE em.entity_id = e.id AND m.triangles > 0 ORDER BY em.role DESC, m.id LIMIT 1) "
        "FROM entity e WHERE e.id = %s",
        (entity,),
    ).fetchone()
    assert row is not None
    known, type_, digest, uri = row
    if known is not None:
        return int(known)
    if digest is None:
        raise ManipulationError(
            f"{model}: has no mesh, so it has no model: import its mesh, or give its size"
        )
    name = Path(str(uri)).stem if uri else model
    return add_object(session, f"mesh:{digest}", name=name, type=type_, digests=[digest])


def add_object(
    connection: MapConnection,
    key: str,
    *,
    name: str | None = None,
    type: str | None = None,
    functions: Sequence[str] = (),
    primitive: Any = None,
    digests: Sequence[str] = (),
) -> int:
    """Store an object model that no map needs to have, such as a shape alone; return its id.

    Parameters
    ----------
    key : the same in all databases
    functions : what it is used for, beside the functions of its type
    primitive : as `set_shape` takes it
    digests : of its meshes

    Raises
    ------
    ManipulationError
        The type is not known, or the primitive is not one.
    """
    session = driver(connection)
    if (
        type is not None
        and not session.execute("SELECT 1 FROM semantic_type WHERE name = %s", (type,)).fetchone()
    ):
        known = _column(session, "SELECT name FROM semantic_type")
        raise ManipulationError(f"{key}: there is no type {type}{suggestion(type, known)}")
    with refusals(), session.transaction():
        session.execute(
            "INSERT INTO object_model (key, name, type, functions) VALUES (%s, %s, %s, %s) "
            "ON CONFLICT (key) DO NOTHING",
            (key, name, type, list(functions)),
        )
        id_ = _number(session.execute("SELECT id FROM object_model WHERE key = %s", (key,)))
        for digest in digests:
            session.execute(
                "INSERT INTO object_mesh (digest, object_id) VALUES (%s, %s) "
                "ON CONFLICT DO NOTHING",
                (digest, id_),
            )
        if primitive is not None:
            set_shape(session, id_, primitive)
    return id_


def set_shape(connection: MapConnection, model: str | int, primitive: Any) -> int:
    """Store the primitive of an object model; return the model's id.

    Parameters
    ----------
    model : name of an entity, or id of an object model
    primitive : with `kind` (sphere, cylinder, cone, cuboid), `size` (metres), `pose` (4, 4) in the
        model's frame, `inliers` and `deviation`

    Raises
    ------
    ManipulationError
        It is not a primitive.
    """
    session = driver(connection)
    size = [float(v) for v in primitive.size]
    where = f"the shape of {model}"
    if not all(math.isfinite(v) and v > 0 for v in size):
        raise ManipulationError(f"{where}: its size is {size}: give metres above 0")
    pose = pose_of(primitive.pose, where)
    with refusals(), session.transaction():
        id_ = object_model_id(session, model)
        session.execute(
            "UPDATE object_model SET shape = %s, size = %s, shape_pose = %s, inliers = %s, "
            "deviation = %s WHERE id = %s",
            (
                primitive.kind,
                size,
                pose.row,
                float(primitive.inliers),
                [float(v) for v in primitive.deviation],
                id_,
            ),
        )
    return id_


# -- actions --------------------------------------------------------------------------------------


def add_actions(
    connection: MapConnection,
    model: str | int,
    gripper: str | None,
    actions: Iterable[Any],
    *,
    kind: str = "grasp",
    frame: str = "model",
    contributor: str = OWN,
) -> list[int]:
    """Store actions on an object model, all or none; return their ids.

    An action that is stored already keeps its id and its outcomes.

    Parameters
    ----------
    model : name of an entity, whose mesh is meant, or id of an object model
    gripper : name; the preferred one where None
    actions : records, or candidates with `pose` (4, 4), `pre_grasp`, `width`, `approach`,
        `quality`, `posture` and `pre_posture`
    kind : of candidates that do not say
    frame : of the poses: ``model``, ``map``, or the name of an entity. The last two need the name
        of an entity as `model`: its pose now.

    Raises
    ------
    LookupError
        There is no such entity, gripper, contributor or frame.
    ManipulationError
        An action cannot be used: the text has its number, and what is wrong. None is stored.
    """
    session = driver(connection)
    records = [
        ActionRecord.of(action, kind, f"{kind} {number}")
        for number, action in enumerate(actions, 1)
    ]
    outer = _frame(session, model, frame)
    if outer is not None:
        records = [record.moved(outer) for record in records]
    with refusals(), session.transaction():
        of_gripper = gripper_id(session, gripper)
        object_ = object_model_id(session, model)
        row = session.execute(
            "SELECT o.key, d.name, g.opening FROM object_model o, device d "
            "JOIN gripper g ON g.device_id = d.id WHERE o.id = %s AND d.id = %s",
            (object_, of_gripper),
        ).fetchone()
        assert row is not None
        for number, record in enumerate(records, 1):
            if record.width is not None and record.width > row[2] + 1e-6:
                raise ManipulationError(
                    f"{kind} {number}: width is {record.width:g} m, but gripper {row[1]} opens "
                    f"{row[2]:g} m: correct the width, or name another gripper"
                )
        keys = [action_key(record, row[0], row[1]) for record in records]
        insert_actions(session, records, keys, object_, of_gripper, contributor)
        found = dict(
            session.execute("SELECT key, id FROM action WHERE key = ANY (%s)", (keys,)).fetchall()
        )
    return [int(found[key]) for key in keys]


INSERT = """
INSERT INTO action (key, kind, object_id, gripper_id, pose, pre_pose, post_pose, motion, approach,
                    family, width, posture, pre_posture, quality{column})
VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s{value}) ON CONFLICT (key) DO NOTHING
"""


def insert_actions(
    session: psycopg.Connection[Any],
    records: Sequence[ActionRecord],
    keys: Sequence[Any],
    object_: int,
    gripper: int,
    contributor: str = OWN,
) -> None:
    """Insert the rows of checked actions; those that are there stay as they are."""
    source = None if contributor == OWN else contributor_id(session, contributor)
    statement = INSERT.format(
        column="" if source is None else ", contributor_id", value="" if source is None else ", %s"
    )
    rows = [
        (
            key,
            record.kind,
            object_,
            gripper,
            record.pose.row,
            record.pre_pose and record.pre_pose.row,
            record.post_pose and record.post_pose.row,
            None if record.motion is None else [float(v) for v in record.motion],
            record.approach,
            record.family,
            record.width,
            Jsonb(dict(record.posture)),
            Jsonb(dict(record.pre_posture)),
            record.quality,
            *(() if source is None else (source,)),
        )
        for key, record in zip(keys, records, strict=True)
    ]
    with session.cursor() as cursor:
        cursor.executemany(statement, rows)


def add_put(connection: MapConnection, grasp: int, place: int) -> int:
    """Store the composed action put (a grasp, then a place); return its id.

    Raises
    ------
    ManipulationError
        They are not a grasp and a place of one gripper on one object model.
    """
    session = driver(connection)
    rows = {
        row[0]: row
        for row in session.execute(
            "SELECT id, kind, object_id, gripper_id, key, quality FROM action WHERE id = ANY (%s)",
            ([grasp, place],),
        ).fetchall()
    }
    for id_, kind in ((grasp, "grasp"), (place, "place")):
        if id_ not in rows or rows[id_][1] != kind:
            was = f"a {rows[id_][1]}" if id_ in rows else "not stored"
            raise ManipulationError(f"action {id_} is {was}: a put is a grasp, then a place")
    if rows[grasp][2:4] != rows[place][2:4]:
        raise ManipulationError(
            f"actions {grasp} and {place} are of different objects or grippers: give those of one"
        )
    with refusals(), session.transaction():
        whole = _number(
            session.execute(
                "INSERT INTO action (kind, object_id, gripper_id, quality) "
                "VALUES ('put', %s, %s, %s) RETURNING id",
                (*rows[grasp][2:4], rows[grasp][5] * rows[place][5]),
            )
        )
        session.execute(
            "INSERT INTO action_step (whole_id, number, step_id) VALUES (%s, 1, %s), (%s, 2, %s)",
            (whole, grasp, whole, place),
        )
    return whole


# -- paths ----------------------------------------------------------------------------------------


def add_path(
    connection: MapConnection,
    automaton: str,
    poses: Sequence[Any],
    *,
    link: str = "",
    clearance: float = 0.1,
) -> int:
    """Store the poses that led a robot, or a link of it, through the map; return the path's id.

    Parameters
    ----------
    poses : at least two, (4, 4) or seven numbers, in the map's frame
    link : whose poses they are; empty for the base
    clearance : metres beside the path in which nothing may have moved when it is reused

    Raises
    ------
    LookupError
        There is no such automaton.
    ManipulationError
        Fewer than two poses, or one that is not a pose.
    """
    session = driver(connection)
    rows = [pose_of(pose, f"pose {n} of the path").row for n, pose in enumerate(poses, 1)]
    if len(rows) < 2:
        raise ManipulationError(f"a path has at least two poses, not {len(rows)}")
    row = session.execute("SELECT id FROM automaton WHERE name = %s", (automaton,)).fetchone()
    if row is None:
        known = _column(session, "SELECT name FROM automaton")
        raise LookupError(f"there is no automaton {automaton}{suggestion(automaton, known)}")
    with refusals():
        return _number(
            session.execute(
                "INSERT INTO path (map_id, automaton_id, link, poses, clearance) "
                "VALUES (current_map(), %s, %s, %s, %s) RETURNING id",
                (row[0], link, rows, clearance),
            )
        )


# -- tasks ----------------------------------------------------------------------------------------


def add_task(
    connection: MapConnection,
    entity: str,
    kind: str = "grasp",
    *,
    action: int | None = None,
    robot: str | None = None,
    start: Any = None,
    goal: Any = None,
    deadline: datetime | None = None,
    outcome: str = "to run",
    message: str | None = None,
    simulated: bool = False,
) -> int:
    """Store a task, or an attempt that has ended; return its id.

    Parameters
    ----------
    entity, robot : names in the map
    action : id of the stored action that is used
    start, goal : of the object, in the map's frame; by default its pose now, and none
    deadline : with a time zone
    outcome : to run, running, completed or error; the last two count for the action
    simulated : the outcome counts for the contributor ``simulation``, which is trusted less

    Raises
    ------
    LookupError
        The map has no such entity.
    ManipulationError
        A value is not one of those allowed.
    """
    session = driver(connection)
    if deadline is not None and deadline.tzinfo is None:
        raise ManipulationError(f"the deadline {deadline.isoformat()} has no time zone: add one")
    of_entity = entity_id(session, entity)
    begins = None if start is None else pose_of(start, "start").row
    ends = None if goal is None else pose_of(goal, "goal").row
    source = contributor_id(session, SIMULATION) if simulated else None
    with refusals():
        return _number(
            session.execute(
                "INSERT INTO task (map_id, robot_id, kind, entity_id, action_id, start, goal, "
                f"deadline, outcome, message{', contributor_id' if source else ''}) "
                "VALUES (current_map(), %s, %s, %s, %s, coalesce(%s::float8[], "
                "(SELECT pose FROM world WHERE entity_id = %s)), %s, %s, %s, %s"
                f"{', %s' if source else ''}) RETURNING id",
                (
                    None if robot is None else entity_id(session, robot),
                    kind,
                    of_entity,
                    action,
                    begins,
                    of_entity,
                    ends,
                    deadline,
                    outcome,
                    message,
                    *((source,) if source else ()),
                ),
            )
        )


def end_task(
    connection: MapConnection, task: int, outcome: str, message: str | None = None
) -> None:
    """State how a task ended (``completed`` or ``error``), or that it is ``running``.

    Raises
    ------
    LookupError
        There is no such task.
    ManipulationError
        It has ended before.
    """
    session = driver(connection)
    with refusals():
        found = session.execute(
            "UPDATE task SET outcome = %s, message = %s WHERE id = %s RETURNING id",
            (outcome, message, task),
        ).fetchone()
    if found is None:
        raise LookupError(f"there is no task {task} of this robot")


def record_task(
    connection: MapConnection,
    entity: str,
    kind: str = "grasp",
    *,
    action: int | None,
    outcome: str,
    instead_of: int | None = None,
    **values: Any,
) -> int:
    """Store an attempt with its outcome (the paper's Effect Evaluator, section IV); return its id.

    Parameters
    ----------
    action : id of the action that was tried
    outcome : completed or error
    instead_of : id of the action that failed before. If the attempt was completed, `action`
        replaces it: it is not proposed any more, and its outcomes stay known.
    values : as for `add_task`

    Raises
    ------
    LookupError, ManipulationError
        As `add_task`; the two actions are not of the same kind, object and gripper.
    """
    session = driver(connection)
    with refusals(), session.transaction():
        task = add_task(session, entity, kind, action=action, outcome=outcome, **values)
        if instead_of is not None and outcome == "completed":
            session.execute("UPDATE action SET replaced_by = NULL WHERE id = %s", (action,))
            found = session.execute(
                "UPDATE action old SET replaced_by = new.id FROM action new "
                "WHERE old.id = %s AND new.id = %s AND (old.kind, old.object_id, old.gripper_id) = "
                "(new.kind, new.object_id, new.gripper_id) RETURNING old.id",
                (instead_of, action),
            ).fetchone()
            if found is None:
                raise ManipulationError(
                    f"action {action} cannot replace {instead_of}: they are not of the same kind, "
                    "object model and gripper"
                )
    return task


# -- helpers --------------------------------------------------------------------------------------


def contributor_id(session: psycopg.Connection[Any], name: str) -> int:
    """Return the id of a contributor.

    Raises
    ------
    LookupError
        There is none of this name.
    """
    row = session.execute("SELECT id FROM contributor WHERE name = %s", (name,)).fetchone()
    if row is None:
        known = _column(session, "SELECT name FROM contributor")
        raise LookupError(
            f"there is no contributor {name}"
            f"{suggestion(name, known, 'semmap manipulation trust NAME KEY adds one')}"
        )
    return int(row[0])


def _frame(session: psycopg.Connection[Any], model: str | int, frame: str) -> Pose | None:
    """The pose of a frame in the frame of a model; None where they are the same."""
    if frame == "model":
        return None
    names = _column(
        session,
        "SELECT e.name FROM entity e JOIN world w ON w.entity_id = e.id "
        "WHERE e.map_id = current_map()",
    )
    if frame != "map" and frame not in names:
        raise LookupError(
            f"there is no frame {frame}{suggestion(frame, names)}: give model, map, or an entity "
            "with a pose"
        )
    if isinstance(model, int) or model not in names:
        raise ManipulationError(
            f"poses in the frame {frame} need an entity that has a pose, not {model}: "
            "name the entity that the poses are for"
        )
    poses = dict(
        session.execute(
            "SELECT e.name, w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.name = ANY (%s)",
            ([model, frame],),
        ).fetchall()
    )
    outer = Pose() if frame == "map" else Pose(*poses[frame])
    return Pose(*poses[model]).inverse() @ outer


def _column(session: psycopg.Connection[Any], query: str, values: Sequence[Any] = ()) -> list[str]:
    return [row[0] for row in session.execute(query.encode(), values).fetchall()]


def _number(cursor: psycopg.Cursor[Any]) -> int:
    row = cursor.fetchone()
    assert row is not None
    return int(row[0])
