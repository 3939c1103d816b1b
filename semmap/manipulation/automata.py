"""Stored robots with arms, and which actions they reach from where they stand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.arrays import Floats
from semmap.belief.store.beliefs import Session
from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.carrying import folded_posture
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.gripper import Gripper
from semmap.manipulation.gripper_reader import kept_gripper, read_gripper
from semmap.manipulation.ranking import is_proven
from semmap.manipulation.retrieval import register_gripper, stored_gripper
from semmap.manipulation.sensors import CAPABILITIES, read_sensors
from semmap.manipulation.store.devices import add_automaton, add_device
from semmap.manipulation.suction import Cup
from semmap.query.snapshot import Snapshot
from semmap.robot.urdf import Robot
from semmap.suggestions import suggestion

TRIED = 200
"""Actions whose reach is computed, at most."""

STARTS = 4
"""Positions from which inverse kinematics of a pose begins."""

CUBE = 0.05
"""Edge of a cube in which the arm reaches no point as far away as one that it missed, metres."""

LEAST = 0.05
"""The least share of successes that is expected of an action."""

WAY = ("pre_pose", "pose", "end", "post_pose")
"""The poses of the gripper in an action, in the order in which it takes them."""


MAY_STORE = "SELECT has_table_privilege('automaton', 'UPDATE')"


def register_robot(
    session: Session,
    urdf: Path,
    name: str | None = None,
    *,
    palm: str | None = None,
    posture: Mapping[str, float] | None = None,
    cup: Cup | None = None,
) -> str:
    """Store a robot with its gripper and sensors, as an automaton; return its name.

    Its sensors are devices ROBOT/SENSOR; the first one that finds objects is that of the automaton.
    `palm` tells its gripper, and `cup` that it is a suction cup; it is named as the robot and
    ``_gripper``. The robot drives with the joints in `posture`, radians or metres, by default
    `folded_posture`. ManipulationError where it has no gripper that a joint moves, or cannot take
    the posture.
    """
    found = read_gripper(urdf, palm, cup)
    _check_posture(found.robot, posture or {})
    arm = Arm(found, posture)
    if posture is None:
        posture = folded_posture(found)
    chosen = name or found.robot.name
    with session.transaction():
        hand = register_gripper(
            session, urdf, f"{chosen}_gripper", palm=palm, preferred=False, cup=cup
        )
        device = _device_name(session, chosen)
        add_device(
            session,
            device,
            "robot",
            urdf=urdf.read_text("utf-8"),
            source=urdf.resolve(),
            joints={j.name: j.limits for j in arm.joints if np.isfinite(j.limits).all()},
        )
        sensors = read_sensors(urdf.read_text("utf-8"))
        for sensor in sensors:
            add_device(
                session,
                f"{chosen}/{sensor.name}",
                "sensor",
                source=f"{urdf.resolve()}#{sensor.link}",
                capabilities=CAPABILITIES[sensor.kind],
            )
        eye = f"{chosen}/{sensors[0].name}" if sensors else None
        add_automaton(session, chosen, device, hand, eye, posture)
    return chosen


def _device_name(session: Session, robot: str) -> str:
    """The name of a robot as a device: a gripper read from the same URDF may have the robot's."""
    row = session.execute("SELECT kind FROM device WHERE name = %s", (robot,)).fetchone()
    return robot if row is None or row[0] == "robot" else f"{robot}_robot"


def _check_posture(robot: Robot, posture: Mapping[str, float]) -> None:
    joints = {joint.name: joint for joint in robot.joints}
    for name, position in posture.items():
        if name not in joints:
            hint = suggestion(name, [*joints], f"it has {', '.join(joints)}")
            raise ManipulationError(f"{robot.name} has no joint {name}{hint}")
        low, high = joints[name].limits
        if not low - 1e-6 <= position <= high + 1e-6:
            raise ManipulationError(
                f"{robot.name}: joint {name} at {position} is beyond its limits {low:g} to {high:g}"
            )


def automaton_of(session: Session, *names: str | None) -> tuple[str, str] | None:
    """The first automaton of some names, and the name of its gripper; None without one."""
    rows = session.execute(
        "SELECT a.name, d.name FROM automaton a JOIN device d ON d.id = a.gripper_id "
        "WHERE a.name = ANY (%s)",
        ([name for name in names if name is not None],),
    ).fetchall()
    found = {name: (name, gripper) for name, gripper in rows}
    return next((found[name] for name in names if name in found), None)


def class_gripper(session: Session, robot_class: str) -> Gripper | None:
    """The gripper in the URDF of a class of robots; None without a URDF or fingers."""
    path = class_urdf(session, robot_class)
    return None if path is None else _gripper_of(path, path.stat().st_mtime_ns)


def class_automaton(session: Session, robot_class: str) -> tuple[str, str] | None:
    """The automaton and gripper of a class's URDF, stored first; None where it cannot be."""
    path = class_urdf(session, robot_class)
    if path is None or class_gripper(session, robot_class) is None:
        return None
    if session.execute(MAY_STORE).fetchone() != (True,):
        return None
    try:
        return automaton_of(session, register_robot(session, path, robot_class))
    except ManipulationError:  # no joint moves the gripper
        return None


def class_urdf(session: Session, robot_class: str) -> Path | None:
    """The URDF of a class of robots, where it is there."""
    found = session.execute("SELECT urdf FROM robot_class WHERE name = %s", (robot_class,))
    row = found.fetchone()
    path = None if row is None or row[0] is None else Path(row[0])
    return path if path is not None and path.is_file() else None


@lru_cache(maxsize=8)
def _gripper_of(path: Path, changed: int) -> Gripper | None:
    try:
        return kept_gripper(path)
    except ManipulationError:
        return None


def stored_arm(session: Session, automaton: str) -> tuple[str, Arm]:
    """The gripper's name and the arm of an automaton; LookupError without, or without its URDF."""
    found = automaton_of(session, automaton)
    if found is None:
        rows = session.execute("SELECT name FROM automaton").fetchall()
        hint = suggestion(
            automaton, [row[0] for row in rows], "semmap manipulation add-robot URDF adds one"
        )
        raise LookupError(f"there is no robot {automaton} with a gripper{hint}")
    row = session.execute("SELECT posture FROM automaton WHERE name = %s", (found[0],)).fetchone()
    posture = tuple(sorted(row[0].items())) if row else ()
    return found[1], gripper_arm(stored_gripper(session, found[1]), posture)


@lru_cache(maxsize=4)
def folded_arm(gripper: Gripper) -> Arm:
    """The arm that moves a gripper, carried as `register_robot` stores it; made once."""
    return Arm(gripper, folded_posture(gripper))


@lru_cache(maxsize=4)
def gripper_arm(gripper: Gripper, posture: tuple[tuple[str, float], ...] = ()) -> Arm:
    """The arm that moves a gripper, made once; as `Arm`."""
    return Arm(gripper, dict(posture))


def base_pose(seen: Snapshot, name: str, given: Sequence[float] | None = None) -> Pose:
    """Where a robot stands: as given, else as the agent of its name does in the map.

    Given are x, y (metres, map's frame), yaw (radians), and z of the floor, by default that of the
    room around the point, the lowest one, else 0. LookupError where neither is known,
    ManipulationError where it is not three or four finite numbers.
    """
    if given is None:
        row = seen.session.execute(
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
    row = seen.session.execute(
        "SELECT min(w.pose[3] + r.floor) FROM room r JOIN world w ON w.entity_id = r.entity_id "
        "WHERE w.map_id = current_map() AND ST_Covers(w.footprint, ST_MakePoint(%s, %s))",
        (x, y),
    ).fetchone()
    return Pose.planar(x, y, yaw, (row and row[0]) or 0.0)


def facing_first(rows: Sequence[dict[str, Any]], base: Pose) -> list[dict[str, Any]]:
    """Actions by expected share, to 0.01, then those first that face away from a robot."""

    def order(row: dict[str, Any]) -> tuple[float, float]:
        pose = row["pose"].matrix
        away = pose[:2, 3] - (base.x, base.y)
        return -round(row["expected"], 2), -float(pose[:2, 2] @ away)

    return sorted(rows, key=order)


def reachable_rows(
    rows: Sequence[dict[str, Any]], arm: Arm, base: Pose, limit: int, reach: Reach | None = None
) -> list[dict[str, Any]]:
    """The actions that an arm at a base reaches, with `position` of its joints; `facing_first`.

    `reach` is that of the arm, which remembers where it does not get to.
    """
    names = [joint.name for joint in arm.joints]
    reach, found = reach or Reach(arm), []
    fit = [row for row in rows if arm.gripper.can_tilt_to(row["pose"].matrix)]
    for row in facing_first(fit, base)[:TRIED]:
        position = reach.along(row, base)
        if position is not None:
            found.append(row | {"position": dict(zip(names, position.tolist(), strict=True))})
        if len(found) == limit:
            break
    return found


def cost_of(row: dict[str, Any], arm: Arm, position: Floats) -> float:
    """Seconds of the arm straight from how it is carried to where an action begins, by its chance.

    The chance is the share of successes that is expected, of a place also that of its grasp.
    """
    chance = float(row.get("expected", 1.0) * row.get("grasp_expected", 1.0))
    return arm.seconds(arm.rest(), position) / max(chance, LEAST)


def quickest_first(rows: Iterable[dict[str, Any]], arm: Arm) -> list[dict[str, Any]]:
    """Rows of `reachable_rows`: as in `best_first`, what succeeded, then what costs least.

    The cost is that of `cost_of`.
    """

    def order(row: dict[str, Any]) -> tuple[bool, float]:
        return not is_proven(row), cost_of(row, arm, arm.position(row["position"]))

    return sorted(rows, key=order)


def way_of(row: dict[str, Any]) -> list[Floats]:
    """The poses (4, 4) of the gripper in an action, map's frame."""
    return [row[key].matrix for key in WAY if row.get(key) is not None]


class Reach:
    """Which actions an arm reaches; it remembers where it does not get to, however it turns."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self._missed: dict[tuple[float, ...], float] = {}  # by cube: from which distance on

    def along(self, row: dict[str, Any], base: Pose) -> NDArray[np.float64] | None:
        """The position (D,) of the joints where an action begins; None if it is out of reach."""
        inverse = np.linalg.inv(base.matrix)
        poses = [inverse @ pose for pose in way_of(row)]
        if not self.arm.gripper.can_tilt_to(poses[0]):
            return None
        points = np.array([pose[:3, 3] for pose in poses])
        cubes = [tuple(cube) for cube in np.floor(points / CUBE)]
        away = np.linalg.norm(points - self.arm.span[0], axis=1).tolist()
        if self.arm.is_far(points).any():
            return None
        if any(d >= self._missed.get(cube, np.inf) for d, cube in zip(away, cubes, strict=True)):
            return None
        positions: list[NDArray[np.float64]] = []
        for pose, cube, d in zip(poses, cubes, away, strict=True):
            near = positions[-1] if positions else None
            position = self.arm.reach(pose, near, starts=STARTS)
            if position is None:
                if self._missed.get(cube) != np.inf:
                    gets_there = self.arm.reaches_point(pose[:3, 3], STARTS)
                    self._missed[cube] = np.inf if gets_there else d
                return None
            positions.append(position)
        return positions[0]
