"""Which grasps are free of everything that the map has around an object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from semmap.geometry.pose import Pose
from semmap.manipulation.candidates import Grasps
from semmap.manipulation.collision import Obstacles, free_grasps, free_way
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.query.meshes import world_triangles
from semmap.query.snapshot import Snapshot

REACH = 0.6
"""How far from an object its surroundings are obstacles, metres: a gripper and its approach."""

AT_ONCE = 32
"""Grasps that are checked at a time, until enough of them are free."""


def obstacles_around(
    seen: Snapshot,
    entity: str,
    reach: float = REACH,
    *,
    without: str | None = None,
    along: Sequence[int] = (),
) -> Obstacles:
    """The triangles of all entities within reach of one, without it or `without`, map's frame.

    Those with ids `along` are left out, too.
    """
    return Obstacles(_triangles(seen, ids_around(seen, entity, reach, without, along)))


def ids_around(
    seen: Snapshot,
    entity: str,
    reach: float = REACH,
    without: str | None = None,
    along: Sequence[int] = (),
) -> list[int]:
    """The ids of the entities that are the obstacles of `obstacles_around`."""
    rows = seen.session.execute(
        "SELECT o.entity_id FROM entity e JOIN world w ON w.entity_id = e.id "
        "JOIN world o ON o.map_id = w.map_id AND o.entity_id <> entity_id(%s) "
        "AND o.box && grown(w.box, %s) AND o.box &&& grown(w.box, %s) "
        "JOIN entity oe ON oe.id = o.entity_id AND oe.kind = 'object' "
        "WHERE e.map_id = (SELECT current_map()) AND e.name = %s "
        "AND o.entity_id <> ALL (%s::bigint[])",
        (without or entity, reach, reach, entity, list(along)),
    ).fetchall()
    return [number for (number,) in rows]


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


WAYS = np.array([*((np.cos(a), np.sin(a), 0) for a in np.arange(8) * np.pi / 4), (0, 0, 1)])
"""Directions in which a hand comes out of furniture, beside that from which it approaches."""


class Enclosure(NamedTuple):
    """A body around an object: its name, the corners of its box, and whether its state is shut."""

    name: str
    box: tuple[NDArray[np.float64], NDArray[np.float64]]
    shut: bool


def enclosure_of(seen: Snapshot, entity: str) -> Enclosure | None:
    """The holder in whose box the middle of an object is; None where it stands free."""
    row = seen.session.execute(ENCLOSURE, (entity,)).fetchone()
    if row is None:
        return None
    name, *corners = row
    return Enclosure(name, (np.array(corners[:3]), np.array(corners[3:])), is_shut(seen, name))


def is_shut(seen: Snapshot, entity: str) -> bool:
    """Whether the property of an entity says that it is shut."""
    row = seen.session.execute(
        "SELECT properties->>'shut' = 'true' FROM entity WHERE id = entity_id(%s)", (entity,)
    ).fetchone()
    return bool(row and row[0])


ENCLOSURE = """
SELECT h.name, ST_XMin(b.box), ST_YMin(b.box), ST_ZMin(b.box),
       ST_XMax(b.box), ST_YMax(b.box), ST_ZMax(b.box)
FROM entity e JOIN placement p ON p.entity_id = e.id JOIN world w ON w.entity_id = e.id
JOIN entity h ON h.id = p.holder_id AND h.kind = 'object' AND NOT is_building_part(h.type)
JOIN world b ON b.entity_id = h.id
WHERE e.map_id = (SELECT current_map()) AND e.name = %s
  AND ST_XMin(w.box) + ST_XMax(w.box) BETWEEN 2 * ST_XMin(b.box) AND 2 * ST_XMax(b.box)
  AND ST_YMin(w.box) + ST_YMax(w.box) BETWEEN 2 * ST_YMin(b.box) AND 2 * ST_YMax(b.box)
  AND ST_ZMin(w.box) + ST_ZMax(w.box) BETWEEN 2 * ST_ZMin(b.box) AND 2 * ST_ZMax(b.box)
"""


class Surroundings:
    """What is around objects, read once each, and which grasps of them are free of it."""

    def __init__(self, seen: Snapshot, gripper: Gripper) -> None:
        self._seen, self._gripper = seen, gripper
        self._around: dict[str, tuple[Obstacles, Obstacles]] = {}
        self._enclosures: dict[str, Enclosure | None] = {}

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
        hulls of links are larger than the links. Where a holder is around the object, the open
        gripper must come straight from outside of it to where its approach begins.
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
                self._enclosures[entity] = enclosure_of(self._seen, entity)
            obstacles, item = self._around[entity]
            for some, untouched in ((proven, None), (~proven, item)):
                chosen = some & (names == entity)
                free[chosen] = free_grasps(grasps[chosen], np.eye(4), obstacles, item=untouched)
            around = self._enclosures[entity]
            if around is not None:
                low, high = around.box[0] - REACH, around.box[1] + REACH
                near = obstacles.within(low, high).joined(item.triangles)
                for i in np.flatnonzero(free & (names == entity)):
                    free[i] = self._gets_in(before[i], around, near)
        return free

    def _gets_in(self, pose: NDArray[np.float64], around: Enclosure, near: Obstacles) -> bool:
        """Whether the open gripper comes straight from outside of a body to a pose (4, 4)."""
        ways = (-pose[:3, 2], *WAYS)
        opening, box = self._gripper.opening, around.box
        return not around.shut and any(
            free_way(self._gripper, opening, pose, box, near, out=way) for way in ways
        )
