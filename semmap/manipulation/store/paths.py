"""Paths of robots and of their links into the database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from semmap.belief.store.beliefs import Session
from semmap.manipulation.action_record import pose_of
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.statements import column, number, refusals
from semmap.suggestions import suggestion


def add_path(
    session: Session,
    automaton: str,
    poses: Sequence[Any],
    *,
    link: str = "",
    positions: Mapping[str, Sequence[float]] | None = None,
) -> int:
    """Store the poses that led a robot, or a link of it, through the map; return the path's id.

    The poses are at least two, (4, 4) or seven numbers, map's frame; `link` is empty for the base;
    `positions` are those of an arm's joints by name at each pose, radians or metres. LookupError
    without the automaton, ManipulationError where a pose is none or there are fewer than two.
    """
    rows = [pose_of(pose, f"pose {n} of the path").row for n, pose in enumerate(poses, 1)]
    if len(rows) < 2:
        raise ManipulationError(f"a path has at least two poses, not {len(rows)}")
    joints = at_poses = None
    if positions is not None:
        joints = list(positions)
        at_poses = [[float(v) for v in at] for at in zip(*positions.values(), strict=True)]
    row = session.execute("SELECT id FROM automaton WHERE name = %s", (automaton,)).fetchone()
    if row is None:
        known = column(session, "SELECT name FROM automaton")
        raise LookupError(f"there is no automaton {automaton}{suggestion(automaton, known)}")
    with refusals():
        return number(
            session.execute(
                "INSERT INTO path (map_id, automaton_id, link, poses, joints, positions) "
                "VALUES (current_map(), %s, %s, %s, %s, %s) RETURNING id",
                (row[0], link, rows, joints, at_poses),
            )
        )
