"""Where the entities of a map were at a moment, and when they moved."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from semmap.fields.store.run_statement import run
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot


def beginning(seen: Snapshot) -> datetime:
    """Return when the current map was made."""
    made: datetime = run(seen.session, "SELECT created_at FROM map WHERE id = current_map()")[
        0
    ].created_at
    return made


def present_poses(seen: Snapshot) -> dict[int, Pose]:
    """Return the pose of each placed entity of the current map."""
    rows = run(
        seen.session,
        "SELECT w.entity_id, w.pose FROM world w WHERE w.map_id = current_map() "
        "AND w.pose IS NOT NULL",
    )
    return {row.entity_id: Pose(*row.pose) for row in rows}


def poses_at(seen: Snapshot, moment: datetime) -> Mapping[int, Pose]:
    """Return the pose of each entity of the current map at a moment; none for one that was not."""
    rows = run(
        seen.session,
        "SELECT id, pose_at(id, %(moment)s) AS pose FROM entity WHERE map_id = current_map()",
        {"moment": moment},
    )
    return {row.id: Pose(*row.pose) for row in rows if row.pose is not None}


def moments_of_moves(seen: Snapshot, begin: datetime, end: datetime) -> list[datetime]:
    """Return when entities of the current map moved after `begin`, until `end`, in order."""
    rows = run(
        seen.session,
        "SELECT DISTINCT at FROM (SELECT p.entity_id, p.since AS at FROM placement p "
        "UNION ALL SELECT h.entity_id, lower(h.during) FROM placement_history h) m "
        "JOIN entity e ON e.id = m.entity_id AND e.map_id = current_map() "
        "WHERE at > %(begin)s AND at <= %(end)s ORDER BY at",
        {"begin": begin, "end": end},
    )
    return [row.at for row in rows]
