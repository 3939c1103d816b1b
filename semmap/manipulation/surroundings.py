"""Which grasps are free of everything that the map has around an object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.collision import Obstacles, free_grasps
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot

REACH = 0.6
"""How far from an object its surroundings are obstacles, metres: a gripper and its approach."""

AT_ONCE = 32
"""Grasps that are checked at a time, until enough of them are free."""


def obstacles_around(
    seen: Snapshot, entity: str, reach: float = REACH, *, without: str | None = None
) -> Obstacles:
    """The triangles of all entities within reach of one, without it or `without`, map's frame."""
    rows = seen.session.execute(
        "SELECT o.entity_id FROM entity e JOIN world w ON w.entity_id = e.id "
        "JOIN world o ON o.map_id = w.map_id AND o.entity_id <> entity_id(%s) "
        "AND o.box && grown(w.box, %s) AND o.box &&& grown(w.box, %s) "
        "JOIN entity oe ON oe.id = o.entity_id AND oe.kind = 'object' "
        "WHERE e.map_id = (SELECT current_map()) AND e.name = %s",
        (without or entity, reach, reach, entity),
    ).fetchall()
    return Obstacles(_triangles(seen, [number for (number,) in rows]))


def entity_pose(seen: Snapshot, entity: str) -> Pose:
    """The pose of an entity in the map; ManipulationError where it has none."""
    row = seen.session.execute(
        "SELECT pose FROM world WHERE entity_id = entity_id(%s)", (entity,)
    ).fetchone()
    if row is None or row[0] is None:
        raise ManipulationError(f"{entity}: has no pose in the map: semmap put gives it one")
    return Pose(*row[0])


def entity_triangles(seen: Snapshot, entity: str) -> NDArray[np.float64]:
    """The triangles (F, 3, 3) of all meshes of an entity in the map's frame, metres."""
    row = seen.session.execute("SELECT entity_id(%s)", (entity,)).fetchone()
    return _triangles(seen, list(row or ()))


def _triangles(seen: Snapshot, ids: list[int]) -> NDArray[np.float64]:
    return np.concatenate([np.empty((0, 3, 3)), *world_triangles(seen.session, ids).values()])


class Surroundings:
    """What is around objects, read once each, and which grasps of them are free of it."""

    def __init__(self, seen: Snapshot, gripper: Gripper) -> None:
        self._seen, self._gripper = seen, gripper
        self._around: dict[str, tuple[Obstacles, Obstacles]] = {}

    def free_rows(
        self, rows: Sequence[dict[str, Any]], limit: int | None = None
    ) -> list[dict[str, Any]]:
        """The first rows of grasps that are free."""
        found: list[dict[str, Any]] = []
        for start in range(0, len(rows), AT_ONCE):
            batch = rows[start : start + AT_ONCE]
            found += [row for row, free in zip(batch, self.free(batch), strict=True) if free]
            if limit is not None and len(found) >= limit:
                break
        return found[:limit]

    def free(self, rows: Sequence[dict[str, Any]]) -> NDArray[np.bool_]:
        """(N,) whether the gripper gets to grasps without touching anything else.

        The object must not be touched either on the way, except by grasps that have succeeded:
        hulls of links are larger than the links.
        """
        poses = np.array([row["pose"].matrix for row in rows])
        before = np.array([(row["pre_pose"] or row["pose"]).matrix for row in rows])
        grasps = Grasps.of_rows(self._gripper, rows, poses, before)
        proven = np.array([row["successes"] > 0 for row in rows])
        names = np.array([row["entity"] for row in rows])
        free = np.zeros(len(rows), bool)
        for entity in dict.fromkeys(names.tolist()):
            if entity not in self._around:
                item = Obstacles(entity_triangles(self._seen, entity))
                self._around[entity] = obstacles_around(self._seen, entity), item
            obstacles, item = self._around[entity]
            for some, untouched in ((proven, None), (~proven, item)):
                chosen = some & (names == entity)
                free[chosen] = free_grasps(grasps[chosen], np.eye(4), obstacles, item=untouched)
        return free
