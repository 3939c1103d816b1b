"""Actions of grippers on object models into the database, and actions composed of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from psycopg.types.json import Jsonb

from semmap.belief.store.beliefs import Session
from semmap.geometry.pose import Pose
from semmap.manipulation.action_record import ActionRecord, action_key, composed_key
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.database_answers import OWN, column, contributor_id, number, refusals
from semmap.manipulation.store.devices import gripper_id
from semmap.manipulation.store.models import object_model_id
from semmap.suggestions import suggestion


def add_actions(
    session: Session,
    model: str | int,
    gripper: str | None,
    actions: Iterable[Any],
    *,
    frame: str = "model",
) -> list[int]:
    """Store actions on an object model, all or none; return their ids.

    An action that is stored already keeps its id and its outcomes.

    Parameters
    ----------
    model : name of an entity, whose mesh is meant, or id of an object model
    gripper : name; the preferred one where None
    actions : records, or candidates with `pose` (4, 4), `pre_grasp`, `width`, `approach`,
        `quality`, `posture` and `pre_posture`
    frame : of the poses: ``model``, ``map``, or the name of an entity. The last two need the name
        of an entity as `model`: its pose now.

    Raises
    ------
    LookupError
        There is no such entity, gripper or frame.
    ManipulationError
        An action cannot be used: the text has its number, and what is wrong. None is stored.
    """
    records = [
        ActionRecord.of(action, f"grasp {number}") for number, action in enumerate(actions, 1)
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
                    f"grasp {number}: width is {record.width:g} m, but gripper {row[1]} opens "
                    f"{row[2]:g} m: correct the width, or name another gripper"
                )
        keys = [action_key(record, row[0], row[1]) for record in records]
        rows = [
            (key, record, object_, of_gripper) for key, record in zip(keys, records, strict=True)
        ]
        insert_actions(session, rows)
        found = dict(
            session.execute("SELECT key, id FROM action WHERE key = ANY (%s)", (keys,)).fetchall()
        )
    return [int(found[key]) for key in keys]


INSERT = """
INSERT INTO action (key, kind, object_id, gripper_id, pose, pre_pose, post_pose, motion, approach,
                    family, width, posture, pre_posture, quality, shift{column})
VALUES (%s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s, %s{value})
ON CONFLICT (key) DO NOTHING
"""


def insert_actions(
    session: Session,
    actions: Iterable[tuple[UUID, ActionRecord, int, int]],
    contributor: str = OWN,
) -> None:
    """Insert checked actions, with key, object model and gripper; those that are there stay."""
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
            None if record.shift is None else list(record.shift),
            *(() if source is None else (source,)),
        )
        for key, record, object_, gripper in actions
    ]
    with session.cursor() as cursor:
        cursor.executemany(statement, rows)


def add_put(session: Session, grasp: int, place: int) -> int:
    """The id of the composed action put: a grasp, then a place of one gripper and object."""
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
    key = composed_key("put", [rows[grasp][4], rows[place][4]])
    with refusals(), session.transaction():
        session.execute(
            "INSERT INTO action (key, kind, object_id, gripper_id, quality) "
            "VALUES (%s, 'put', %s, %s, %s) ON CONFLICT (key) DO NOTHING",
            (key, *rows[grasp][2:4], rows[grasp][5] * rows[place][5]),
        )
        whole = number(session.execute("SELECT id FROM action WHERE key = %s", (key,)))
        session.execute(
            "INSERT INTO action_step (whole_id, number, step_id) VALUES (%s, 1, %s), (%s, 2, %s) "
            "ON CONFLICT DO NOTHING",
            (whole, grasp, whole, place),
        )
    return whole


def _frame(session: Session, model: str | int, frame: str) -> Pose | None:
    """The pose of a frame in the frame of a model; None where they are the same."""
    if frame == "model":
        return None
    names = column(
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
