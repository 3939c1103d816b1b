"""The posture in which a robot drives where none is given: the stored one, else one that is found.

In a URDF all joints are at 0, which stretches many arms out: no door is wide enough then.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from semmap.error import Error
from semmap.robot import load_robot, robot_parts
from semmap.robot.joint_positions import joints_of

if TYPE_CHECKING:
    import psycopg

FAR = 1.5
"""Radii of the base beyond which a part is folded to drive."""

_STORED = """
SELECT a.name, a.posture FROM automaton a JOIN device d ON d.id = a.robot_id
WHERE d.source = %s ORDER BY a.name LIMIT 1
"""


class DrivingPosture(NamedTuple):
    """Positions of joints, radians or metres (others are at 0), and where they come from."""

    joints: Mapping[str, float]
    source: str

    def __str__(self) -> str:
        moved = ", ".join(f"{name} {at:.4g}" for name, at in self.joints.items() if at)
        return f"posture: {self.source}" + (f": {moved}" if moved else "")


def driving_posture(
    session: psycopg.Connection[Any] | None,
    urdf: Path,
    posture: str | Mapping[str, float] | None = None,
    parts: Path | None = None,
) -> DrivingPosture:
    """Return the posture in which a robot drives.

    `posture` is as for `Map.costmaps`. None takes the one stored for this file (none without a
    session), all joints at 0 where no part reaches farther than `FAR` radii of the base, or else
    one that is found. `parts` is a YAML file that groups links into parts.
    """
    if posture is not None:
        return DrivingPosture(joints_of(urdf, posture), "as given")
    row = None if session is None else session.execute(_STORED, (str(urdf.resolve()),)).fetchone()
    if row is not None:
        return DrivingPosture(row[1], f"stored with the robot {row[0]}")
    return _found(urdf.resolve(), urdf.stat().st_mtime_ns if urdf.is_file() else 0, parts)


@lru_cache(maxsize=8)
def _found(urdf: Path, _changed: int, parts: Path | None) -> DrivingPosture:
    robot = load_robot(urdf)

    def reach(joints: Mapping[str, float]) -> tuple[float, str, float]:
        made = robot_parts(robot, joints, parts)
        widest = max(made, key=lambda part: part.circumscribed_radius)
        return widest.circumscribed_radius, widest.name, made[0].circumscribed_radius

    radius, name, base = reach({})
    if radius <= FAR * base:
        return DrivingPosture({}, "all joints at 0")
    far = f"{name} reaches {radius:.2f} m around the robot"
    try:
        from semmap.manipulation.carrying import folded_posture
        from semmap.manipulation.gripper_reader import read_gripper

        joints = folded_posture(read_gripper(urdf))
    except (Error, ImportError) as error:
        return DrivingPosture({}, f"all joints at 0, though the {far}; none was found ({error})")
    folded, *_ = reach(joints)
    if folded >= radius:
        return DrivingPosture({}, f"all joints at 0, though the {far}; none was found")
    return DrivingPosture(joints, f"found, as at 0 the {far}, in it {folded:.2f} m")
