"""Robots with arms: which stored grasps they reach from where they stand, and the motions there."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from semmap.belief.store import MapConnection, driver
from semmap.geometry.pose import Pose
from semmap.manipulation.device_store import add_automaton, add_device
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.path_store import add_path
from semmap.manipulation.retrieval import register_gripper, stored_gripper
from semmap.manipulation.surroundings import entity_triangles, obstacles_around
from semmap.suggestions import suggestion

if TYPE_CHECKING:
    from semmap.manipulation.arm import Arm
    from semmap.manipulation.gripper import Gripper

__all__ = [
    "Motion",
    "automaton_of",
    "base_pose",
    "plan_grasp",
    "reachable_rows",
    "register_robot",
    "stored_arm",
]

Floats = NDArray[np.float64]

TRIED = 200
"""Grasps whose reach is computed, at most."""

STARTS = 4
"""Positions from which inverse kinematics of a grasp begins."""

AROUND = 1.5
"""Metres around an object whose contents are obstacles for an arm."""


@dataclass(frozen=True)
class Motion:
    """A motion of an arm to a grasp.

    Attributes
    ----------
    row : the grasp, as `semmap.manipulation.reader.actions_on` returns it
    joints : names of the joints
    to_pre_grasp, approach : (N, D) positions, radians or metres
    path : id of the stored path to the pre-grasp, with the positions of the joints
    reused : it was stored before
    seconds : that were spent
    """

    row: dict[str, Any]
    joints: tuple[str, ...]
    to_pre_grasp: Floats
    approach: Floats
    path: int
    reused: bool
    seconds: float


def register_robot(
    connection: MapConnection,
    urdf: Path,
    name: str | None = None,
    *,
    palm: str | None = None,
    gripper: str | None = None,
) -> str:
    """Store a robot with its gripper, as an automaton; return its name.

    Parameters
    ----------
    urdf : of the whole robot
    name : by default that in the URDF
    palm : the link that holds the fingers, where it has several grippers
    gripper : name of the gripper; by default that of the robot and ``_gripper``

    Raises
    ------
    ManipulationError
        The robot has no gripper, or no joint moves it.
    RobotError
        The file is not a usable URDF.
    """
    from semmap.manipulation.arm import Arm
    from semmap.manipulation.gripper import read_gripper

    found = read_gripper(urdf, palm)
    arm = Arm(found)
    chosen = name or found.robot.name
    session = driver(connection)
    with session.transaction():
        hand = register_gripper(session, urdf, gripper or f"{chosen}_gripper", palm=palm)
        add_device(
            session,
            chosen,
            "robot",
            urdf=urdf.read_text("utf-8"),
            source=urdf.resolve(),
            joints={j.name: j.limits for j in arm.joints if np.isfinite(j.limits).all()},
        )
        add_automaton(session, chosen, chosen, hand)
    return chosen


def automaton_of(connection: MapConnection, *names: str | None) -> tuple[str, str] | None:
    """Return the first automaton of some names, and the name of its gripper; None without one."""
    rows = (
        driver(connection)
        .execute(
            "SELECT a.name, d.name FROM automaton a JOIN device d ON d.id = a.gripper_id "
            "WHERE a.name = ANY (%s)",
            ([name for name in names if name is not None],),
        )
        .fetchall()
    )
    found = {name: (name, gripper) for name, gripper in rows}
    return next((found[name] for name in names if name in found), None)


def stored_arm(connection: MapConnection, automaton: str) -> tuple[str, Arm]:
    """Return the gripper's name and the arm of a stored automaton.

    Raises
    ------
    LookupError
        There is no automaton of this name with a gripper.
    ManipulationError
        Its URDF is not on this machine, or is that of the gripper alone.
    """
    found = automaton_of(connection, automaton)
    if found is None:
        rows = driver(connection).execute("SELECT name FROM automaton").fetchall()
        hint = suggestion(
            automaton, [row[0] for row in rows], "semmap manipulation add-robot URDF adds one"
        )
        raise LookupError(f"there is no robot {automaton} with a gripper{hint}")
    return found[1], _arm(stored_gripper(connection, found[1]))


@lru_cache(maxsize=4)
def _arm(gripper: Gripper) -> Arm:
    from semmap.manipulation.arm import Arm

    return Arm(gripper)


def base_pose(connection: MapConnection, name: str, given: Sequence[float] | None = None) -> Pose:
    """Return where a robot stands: as given, else as the agent of its name does in the map.

    Parameters
    ----------
    given : x, y (metres, map's frame), yaw (radians), and z of the floor, by default that of the
        room around the point, the lowest one, else 0

    Raises
    ------
    LookupError
        No pose is given, and the map has no agent of this name with one.
    ManipulationError
        Not three or four finite numbers.
    """
    session = driver(connection)
    if given is None:
        row = session.execute(
            "SELECT w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.kind = 'agent' AND e.name = %s",
            (name,),
        ).fetchone()
        if row is None:
            raise LookupError(f"the map has no agent {name} with a pose: give its base")
        return Pose(*row[0])
    if len(given) not in (3, 4) or not np.isfinite(given).all():
        raise ManipulationError(f"a base is x, y, yaw and, if known, z, not {list(given)}")
    x, y, yaw = given[:3]
    if len(given) == 4:
        return Pose.planar(x, y, yaw, given[3])
    row = session.execute(
        "SELECT min(w.pose[3] + r.floor) FROM room r JOIN world w ON w.entity_id = r.entity_id "
        "WHERE w.map_id = current_map() AND ST_Covers(w.footprint, ST_MakePoint(%s, %s))",
        (x, y),
    ).fetchone()
    return Pose.planar(x, y, yaw, (row and row[0]) or 0.0)


def reachable_rows(
    rows: Sequence[dict[str, Any]], arm: Arm, base: Pose, limit: int
) -> list[dict[str, Any]]:
    """Return the first rows of actions whose poses of contact and approach an arm reaches.

    Parameters
    ----------
    rows : as `semmap.manipulation.reader.actions_on` returns them
    base : of the robot, in the map's frame
    limit : the most rows

    Returns
    -------
    list of dict
        The rows with `position`: of the joints at the approach, by name, radians or metres.
    """
    inverse = np.linalg.inv(base.matrix)
    found: list[dict[str, Any]] = []
    for row in rows[:TRIED]:
        before = inverse @ (row["pre_pose"] or row["pose"]).matrix
        pose = inverse @ row["pose"].matrix
        if arm.is_far(before) or arm.is_far(pose):
            continue
        position = arm.reach(before, starts=STARTS)
        if position is None or arm.reach(pose, position, starts=STARTS) is None:
            continue
        names = (joint.name for joint in arm.joints)
        found.append(row | {"position": dict(zip(names, position.tolist(), strict=True))})
        if len(found) == limit:
            break
    return found


def plan_grasp(
    connection: MapConnection,
    automaton: str,
    base: Pose,
    rows: Sequence[dict[str, Any]],
    *,
    state: Mapping[str, float] | None = None,
    seconds: float = 5.0,
) -> Motion | None:
    """Return a motion of a robot's arm to the first grasp that it reaches; None if not found.

    A stored path to one of the grasps is followed if nothing has moved into its way. Else a motion
    is planned (`semmap.manipulation.motion.plan_pick`) and its path is stored.

    Parameters
    ----------
    rows : grasps of one object, the best first, as `reachable_rows` returns them
    state : positions of the joints at the start; by default at rest
    seconds : the longest time to plan one motion

    Raises
    ------
    LookupError
        There is no automaton of this name.
    ManipulationError
        The start touches something.
    """
    from semmap.manipulation.candidates import Grasps
    from semmap.manipulation.collision import Obstacles
    from semmap.manipulation.motion import plan_pick, straight_motion

    if not rows:
        return None
    begun = time.perf_counter()
    session = driver(connection)
    _, arm = stored_arm(session, automaton)
    given = dict(zip((j.name for j in arm.joints), arm.rest().tolist(), strict=True))
    start = np.array([(given | dict(state or {}))[joint.name] for joint in arm.joints])
    inverse = np.linalg.inv(base.matrix)

    def local(triangles: Floats) -> Floats:
        moved: Floats = triangles @ inverse[:3, :3].T + inverse[:3, 3]
        return moved

    entity = rows[0]["entity"]
    some = [row for row in rows if row["entity"] == entity]
    around = Obstacles(local(obstacles_around(session, entity, AROUND).triangles))
    item = local(entity_triangles(session, entity))
    room = around.joined(item)
    grasps = Grasps(
        arm.gripper,
        np.array([inverse @ row["pose"].matrix for row in some]),
        np.array([inverse @ (row["pre_pose"] or row["pose"]).matrix for row in some]),
        np.array([arm.gripper.opening if r["width"] is None else r["width"] for r in some]),
        np.array([row["expected"] for row in some]),
        np.array([row["approach"] or "" for row in some]),
        np.array([row["family"] or "" for row in some]),
    )
    joints = tuple(joint.name for joint in arm.joints)
    for i, row in enumerate(some):
        goal = base.matrix @ grasps.pre_grasps[i] @ np.linalg.inv(arm.gripper.frame)
        known = _stored_path(session, automaton, base.matrix @ _palm(arm, start), goal, arm)
        if known is None:
            continue
        number, way = known
        approach = straight_motion(arm, way[-1], grasps.poses[i])
        free = all(arm.is_free(q, room) for q in way)
        if approach is not None and free and all(arm.is_free(q, around) for q in approach):
            return Motion(row, joints, way, approach, number, True, time.perf_counter() - begun)
    picked = plan_pick(
        arm, start, grasps, np.eye(4), around, object_triangles=item, seconds=seconds
    )
    if picked is None:
        return None
    poses = [base.matrix @ _palm(arm, q) for q in picked.to_pre_grasp]
    positions = dict(zip(joints, picked.to_pre_grasp.T.tolist(), strict=True))
    path = add_path(session, automaton, poses, link=arm.gripper.palm, positions=positions)
    spent = time.perf_counter() - begun
    row = some[picked.grasp]
    return Motion(row, joints, picked.to_pre_grasp, picked.approach, path, False, spent)


def _palm(arm: Arm, position: Floats) -> Floats:
    pose: Floats = arm.grasp_pose(position) @ np.linalg.inv(arm.gripper.frame)
    return pose


def _stored_path(
    session: Any, automaton: str, start: Floats, goal: Floats, arm: Arm
) -> tuple[int, Floats] | None:
    """A valid path between two poses of the palm, its number and the positions along it."""
    row = session.execute(
        "SELECT id, joints, positions FROM path "
        "WHERE id = path_between(%s, %s::float8[], %s::float8[], %s)",
        (automaton, Pose.from_matrix(start).row, Pose.from_matrix(goal).row, arm.gripper.palm),
    ).fetchone()
    if row is None or row[1] != [joint.name for joint in arm.joints]:
        return None
    return int(row[0]), np.array(row[2])
