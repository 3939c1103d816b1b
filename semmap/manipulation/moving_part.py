"""Parts of the map that move on a joint: what moves along, and how far it opens from where it is.

Imports keep the joint of a link as the property `joint` of its object: `type` (as in URDF), `axis`
through `point` in the object's own frame, `lower` and `upper` (radians or metres, null where there
is no limit), and `closed`, its pose with the joint at zero in the frame of the object that it is
`jointed_to`, by a link, else of the map. What is fixed to a part that moves has the type fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import trimesh

from semmap.arrays import Floats
from semmap.finite_number import finite_numbers, is_finite_number
from semmap.geometry.pose import Pose
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.part_motion import PartMotion
from semmap.manipulation.store.model_shapes import model_mesh
from semmap.manipulation.surroundings import entity_pose
from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot

OFF, TURNED = 0.01, np.radians(2)
"""How far a part may be beside the way of its joint; metres and radians."""

OPENED = 0.05
"""The share of a joint's way to its end that is too little to be opened further."""

WHAT_TO_GIVE = (
    "give hinge=(x, y, z, dx, dy, dz), a point and the direction of its axis in the map's frame, "
    "or slide=(dx, dy, dz), its direction, and travel in radians or metres"
)

Aim = Literal["open", "turn"]


@dataclass(frozen=True, eq=False)
class MovingPart:
    """An object of the map that moves with all that it holds.

    `mesh` is in the frame of its model, with what is fixed to it; `pose` is where it is in the map.
    `ids` are of all that moves along, `body` is of what it is jointed to, else of what it is in or
    on. `placed` is its pose in the frame of what it is jointed to.
    """

    entity: str
    mesh: trimesh.Trimesh
    pose: Pose
    ids: tuple[int, ...]
    body: int | None
    joint: dict[str, Any] | None
    placed: Pose

    @classmethod
    def of(cls, seen: Snapshot, entity: str) -> MovingPart:
        """The part of a name; of what is fixed to a part, such as a handle, that part.

        LookupError without the entity; ManipulationError where it has no mesh or pose.
        """
        entity_id(seen.session, entity)
        row = seen.session.execute(PART, (entity,)).fetchone()
        if row is None:
            raise ManipulationError(f"{entity}: has no pose in the map: semmap put gives it one")
        name, joint, body, at_base = row
        along = seen.session.execute(ALONG, (name,)).fetchall()
        pose = entity_pose(seen, name)
        meshes = [model_mesh(seen, name)]
        for other, fixed, is_shaped, at in along:
            if fixed and is_shaped and other != name:
                mesh = model_mesh(seen, other)
                mesh.apply_transform((pose.inverse() @ Pose(*at)).matrix)
                meshes.append(mesh)
        ids = [entity_id(seen.session, other) for other, *_ in along]
        whole: Any = meshes[0] if len(meshes) == 1 else trimesh.util.concatenate(meshes)
        placed = Pose(*at_base).inverse() @ pose if at_base else pose
        return cls(name, whole, pose, tuple(ids), body, joint, placed)

    @cached_property
    def corners(self) -> Floats:
        """The corners (V, 3) of the convex hull of the mesh, in the frame of the model."""
        corners: Floats = np.asarray(self.mesh.convex_hull.vertices)
        return corners

    def stated_motion(
        self,
        hinge: Sequence[float] | None,
        slide: Sequence[float] | None,
        travel: float | None,
    ) -> PartMotion | None:
        """The motion in the frame of the model of an axis in that of the map; None without one."""
        if hinge is None and slide is None:
            return None
        if hinge is not None and slide is not None:
            raise ManipulationError(f"{self.entity}: give one of hinge and slide")
        if travel is None:
            raise ManipulationError(
                f"{self.entity}: travel is missing: how far does it move, in "
                f"{'metres' if hinge is None else 'radians'}?"
            )
        if hinge is not None:
            stated = PartMotion.about(hinge, travel)
        else:
            assert slide is not None
            stated = PartMotion.along(slide, travel)
        return stated.moved(self.pose.inverse())

    def known_motion(self, seen: Snapshot, aim: Aim, travel: float | None) -> PartMotion | None:
        """The motion of its joint from where it is, in the frame of the model; None without one.

        Without `travel`, radians or metres, it opens as far as its limits allow; a turn of an open
        part closes it: to zero, or the limit next to it. ManipulationError where the joint does
        not allow that.
        """
        joint = self.joint
        if joint is None:
            return None
        point, axis, closed = (
            finite_numbers(joint.get(key) or (), n)
            for key, n in (("point", 3), ("axis", 3), ("closed", 7))
        )
        kind = joint.get("type")
        if kind not in ("revolute", "continuous", "prismatic"):
            moving = [name for (name,) in seen.session.execute(BELOW, (self.entity,)).fetchall()]
            hint = f"name one of {', '.join(moving[:5])}" if moving else WHAT_TO_GIVE
            why = "so it is still" if kind == "fixed" else "and such joints are not handled"
            raise ManipulationError(f"{self.entity}: its joint is {kind}, {why}: {hint}")
        if point is None or axis is None or closed is None or not np.linalg.norm(axis) > 1e-9:
            raise ManipulationError(f"{self.entity}: its property joint is damaged: {WHAT_TO_GIVE}")
        is_hinge = kind != "prismatic"
        unit = PartMotion(
            np.array(point) if is_hinge else None, np.array(axis) / np.linalg.norm(axis), 1.0
        )
        low, high = (
            float(joint[key]) if is_finite_number(joint.get(key)) else None
            for key in ("lower", "upper")
        )
        position = self._position(unit, Pose(*closed))
        if is_hinge:
            position = self._within(position, low, high)
        amount = self._amount(aim, travel, position, low, high)
        if is_hinge:
            return PartMotion.about((*point, *axis), amount)
        return PartMotion.along(axis, amount)

    def _position(self, unit: PartMotion, closed: Pose) -> float:
        """How far its joint, whose motion is by `unit`, is from zero."""
        axis, moved = unit.direction, (closed.inverse() @ self.placed).matrix
        if unit.is_hinge:
            turn = moved[:3, :3]
            across = np.linalg.svd(axis[None])[2][1]
            ahead = np.cross(axis, across)
            position = float(np.arctan2(ahead @ turn @ across, across @ turn @ across))
        else:
            position = float(axis @ moved[:3, 3])
        left = np.linalg.inv(unit.at(position)) @ moved
        angle = float(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
        if np.linalg.norm(left[:3, 3]) > OFF or angle > TURNED:
            raise ManipulationError(
                f"{self.entity}: was moved away from its joint since it was imported: put it back, "
                f"or {WHAT_TO_GIVE}"
            )
        return position

    def _within(self, position: float, low: float | None, high: float | None) -> float:
        """The position of a hinge, of which the pose tells no whole turns, within its limits.

        Files put parts at zero even where their limits leave it out, so that is taken, too.
        """
        least, most = -np.inf if low is None else low, np.inf if high is None else high
        for turns in (0.0, 2 * np.pi, -2 * np.pi):
            if least - TURNED <= position + turns <= most + TURNED:
                return position + turns
        if abs(position) < TURNED:
            return position
        raise ManipulationError(
            f"{self.entity}: its joint goes from {least:g} to {most:g} and is at {position:.3g}: "
            f"put it where its joint allows, or {WHAT_TO_GIVE}"
        )

    def _amount(
        self, aim: Aim, travel: float | None, at: float, low: float | None, high: float | None
    ) -> float:
        """How far it moves from a position: `travel`, else as far as its limits allow."""
        limits = "" if low is None or high is None else f" from {low:g} to {high:g}"
        if travel is not None:
            end = at + travel
            if (low is not None and end < low - 1e-6) or (high is not None and end > high + 1e-6):
                raise ManipulationError(
                    f"{self.entity}: its joint goes{limits} and is at {at:.3g}: travel {travel:g} "
                    "is too far"
                )
            return travel
        if low is None or high is None:
            raise ManipulationError(
                f"{self.entity}: its joint has no limits: give travel, in radians or metres"
            )
        closed = min(max(0.0, low), high)
        farthest = high if high - closed >= closed - low else low
        now, span = min(max(at, low), high), abs(farthest - closed)
        if aim == "turn" and abs(now - closed) > OPENED * span:
            return closed - at
        if span == 0 or abs(farthest - now) < OPENED * span:
            raise ManipulationError(
                f"{self.entity}: is open already: its joint goes{limits} and is at {at:.3g}"
            )
        return farthest - at


def unknown_axis(seen: Snapshot, entity: str) -> ManipulationError:
    """The error where nothing tells how a part moves: it says what to give."""
    moving = [name for (name,) in seen.session.execute(BELOW, (entity,)).fetchall()]
    hint = f"name a part of it that does ({', '.join(moving[:5])}), or " if moving else ""
    return ManipulationError(f"{entity}: the map does not know how it moves: {hint}{WHAT_TO_GIVE}")


PART = """
WITH RECURSIVE part (id, holder, joint, depth) AS (
    SELECT e.id, p.holder_id, e.properties->'joint', 0
    FROM entity e JOIN placement p ON p.entity_id = e.id
    WHERE e.map_id = current_map() AND e.name = %s
    UNION ALL
    SELECT e.id, p.holder_id, e.properties->'joint', part.depth + 1
    FROM part JOIN entity e ON e.id = part.holder JOIN placement p ON p.entity_id = e.id
    WHERE part.joint->>'type' = 'fixed' AND e.properties ? 'joint'
)
SELECT e.name, part.joint, coalesce(l.to_id, part.holder), w.pose
FROM part JOIN entity e ON e.id = part.id
LEFT JOIN link l ON l.from_id = part.id AND l.relation = 'jointed_to'
LEFT JOIN world w ON w.entity_id = l.to_id
ORDER BY part.joint->>'type' IN ('revolute', 'continuous', 'prismatic') DESC NULLS LAST, depth
LIMIT 1
"""
"""The entity or, where it is fixed to one that moves, that one; and what it is jointed to."""

ALONG = """
WITH RECURSIVE part (id, fixed) AS (
    SELECT e.id, true FROM entity e WHERE e.map_id = current_map() AND e.name = %s
    UNION ALL
    SELECT e.id, part.fixed AND coalesce(e.properties->'joint'->>'type' = 'fixed', false)
    FROM part JOIN placement p ON p.holder_id = part.id JOIN entity e ON e.id = p.entity_id
)
SELECT e.name, part.fixed, EXISTS (
           SELECT FROM entity_model em JOIN model m ON m.id = em.model_id AND m.triangles > 0
           WHERE em.entity_id = e.id),
       w.pose
FROM part JOIN entity e ON e.id = part.id JOIN world w ON w.entity_id = e.id
ORDER BY e.id
"""
"""All that an entity holds, directly or not, and itself; is it fixed to it, and has it a mesh?"""

BELOW = """
WITH RECURSIVE part (id) AS (
    SELECT e.id FROM entity e WHERE e.map_id = current_map() AND e.name = %s
    UNION ALL
    SELECT p.entity_id FROM part JOIN placement p ON p.holder_id = part.id
)
SELECT e.name FROM part JOIN entity e ON e.id = part.id
WHERE e.properties->'joint'->>'type' IN ('revolute', 'continuous', 'prismatic') ORDER BY 1
"""
"""The parts of an entity that move on joints."""
