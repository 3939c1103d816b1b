"""Object models into the database: one for all instances of a mesh, with its primitive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from semmap.belief.store.beliefs import Session
from semmap.manipulation.action_record import pose_of
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.database_answers import column, number, refusals
from semmap.query.entity_query import entity_id
from semmap.suggestions import suggestion


def object_model_id(session: Session, model: str | int) -> int:
    """The id of an object model, or of that of an entity's mesh, which is made at need."""
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
    session: Session,
    key: str,
    *,
    name: str | None = None,
    type: str | None = None,
    primitive: Any = None,
    digests: Sequence[str] = (),
) -> int:
    """Store an object model, such as a shape alone, by a key for all databases; return its id."""
    if (
        type is not None
        and not session.execute("SELECT 1 FROM semantic_type WHERE name = %s", (type,)).fetchone()
    ):
        known = column(session, "SELECT name FROM semantic_type")
        raise ManipulationError(f"{key}: there is no type {type}{suggestion(type, known)}")
    with refusals(), session.transaction():
        session.execute(
            "INSERT INTO object_model (key, name, type) VALUES (%s, %s, %s) "
            "ON CONFLICT (key) DO NOTHING",
            (key, name, type),
        )
        id_ = number(session.execute("SELECT id FROM object_model WHERE key = %s", (key,)))
        for digest in digests:
            session.execute(
                "INSERT INTO object_mesh (digest, object_id) VALUES (%s, %s) "
                "ON CONFLICT DO NOTHING",
                (digest, id_),
            )
        if primitive is not None:
            set_shape(session, id_, primitive)
    return id_


def set_shape(session: Session, model: str | int, primitive: Any) -> int:
    """Store the primitive of an object model, (4, 4) in its frame; return the model's id."""
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
