"""Grasps of models that links state to be the same as those of a map (Tosello et al., III-D).

Links tell which model an object is, not where the frame of the one lies in that of the other.
Equal primitives tell it, up to the symmetry of the shape. Else both frames are taken to be equal,
and this is checked: the pads of a gripper close on the object, not beside it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from semmap.belief.store.beliefs import Session
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.model_shapes import model_mesh, shape_of
from semmap.query.snapshot import Snapshot

BESIDE = 0.01
"""Metres beside the box of a mesh at which pads are still on the object."""


def prepare_links(seen: Snapshot, entities: Sequence[int]) -> None:
    """Store the primitives of entities with linked models, by which frames are compared."""
    rows = seen.session.execute(
        "SELECT DISTINCT e.name FROM linked_objects(%s) l JOIN entity e ON e.id = l.entity_id "
        "JOIN object_model m ON m.id = l.object_id AND m.shape IS NOT NULL "
        "LEFT JOIN entity_object h ON h.entity_id = e.id LEFT JOIN object_model o "
        "ON o.id = h.object_id WHERE o.shape IS NULL",
        (list(entities),),
    ).fetchall()
    for (name,) in sorted(rows):
        try:
            with seen.session.transaction():
                shape_of(seen, name)
        except ManipulationError:
            continue  # without a volume: no primitive, so its frame is compared by the points


def fitting_rows(
    seen: Snapshot, rows: Sequence[dict[str, Any]]
) -> tuple[list[dict[str, Any]], list[str]]:
    """The rows of `actions_on` whose poses are on the object, and why others are left out."""
    boxes: dict[str, Any] = {}
    kept: list[dict[str, Any]] = []
    dropped: Counter[tuple[str, int]] = Counter()
    for row in rows:
        entity = row["entity"]
        if row["frame"] == "model":
            if entity not in boxes:
                boxes[entity] = _box(seen, entity)
            low, high = boxes[entity]
            point = row["model_pose"].matrix[:3, 3]
            if (point < low - BESIDE).any() or (point > high + BESIDE).any():
                dropped[entity, row["object_id"]] += 1
                continue
        kept.append(row)
    problems = [
        f"{entity}: {count} grasps of the linked model {_name(seen.session, model)} are left out: "
        "they are beside the object, so the frames of both models differ, and their primitives do "
        "not tell how. Import the meshes of the linked models, too, or grasps in the object's frame"
        for (entity, model), count in dropped.items()
    ]
    return kept, problems


def _box(seen: Snapshot, entity: str) -> tuple[Any, Any]:
    """The lowest and the highest corner of an entity's mesh, in its frame."""
    try:
        corners = np.asarray(model_mesh(seen, entity).vertices)
    except ManipulationError:
        return np.full(3, -np.inf), np.full(3, np.inf)  # nothing to compare with
    return corners.min(axis=0), corners.max(axis=0)


def _name(session: Session, model: int) -> str:
    row = session.execute(
        "SELECT coalesce(name || ' (' || key || ')', key) FROM object_model WHERE id = %s", (model,)
    )
    ((name,),) = row.fetchall()
    return str(name)
