"""Actions that a stored robot does from where it stands, with the motion of its arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from semmap.geometry.pose import Pose
from semmap.manipulation.arm import Arm
from semmap.manipulation.arm_motions import plan_action
from semmap.manipulation.automata import base_pose, reachable_rows, register_robot, stored_arm
from semmap.manipulation.found_actions import FoundActions
from semmap.manipulation.openings import find_openings, find_turns
from semmap.manipulation.places import find_places
from semmap.manipulation.pushes import find_pushes
from semmap.manipulation.reader import STORED
from semmap.manipulation.retrieval import find_grasps, is_urdf
from semmap.query.snapshot import Snapshot

PLANNED = 40
"""Actions within reach among which one is chosen whose motion is free."""


FINDERS: dict[str, tuple[Callable[..., FoundActions], str, str]] = {
    "places": (find_places, "to_pre_place", "retreat_positions"),
    "pushes": (find_pushes, "to_pre_push", "push_positions"),
    "openings": (find_openings, "to_pre_grasp", "open_positions"),
    "turns": (find_turns, "to_pre_push", "turn_positions"),
}
"""What finds actions, and the keys of a motion to where they begin, and after the approach."""


@dataclass(frozen=True)
class RobotActions:
    """A stored robot at `base`, map's frame: what its arm reaches, and if to `plan` motions."""

    seen: Snapshot
    name: str
    gripper: str
    arm: Arm
    base: Pose
    plan: bool = False
    state: Mapping[str, float] | None = None
    limit: int = 10

    @classmethod
    def of(
        cls,
        seen: Snapshot,
        robot: str | Path,
        base: Sequence[float] | None = None,
        **options: Any,
    ) -> RobotActions:
        """A stored robot, or that of a URDF, stored first; as `stored_arm` and `base_pose`."""
        name = register_robot(seen.session, Path(robot)) if is_urdf(robot) else str(robot)
        gripper, arm = stored_arm(seen.session, name)
        at = base_pose(seen, name, base)
        return cls(seen, name, gripper, arm, at, **options)

    @property
    def count(self) -> int:
        """The most actions within reach that are looked for."""
        return max(self.limit, PLANNED) if self.plan else self.limit

    def grasps(self, **asked: Any) -> FoundActions:
        """The grasps that the arm reaches; arguments as of `find_grasps`."""
        found = find_grasps(self.seen, **asked, gripper=self.gripper, limit=STORED)
        rows = reachable_rows(found.rows, self.arm, self.base, self.count)
        problems = found.problems
        if found.rows and not rows:
            where = f"{self.base.x:g}, {self.base.y:g}"
            problem = f"{self.name} reaches none of {len(found.rows)} free grasps from ({where})"
            problems = [*problems, problem]
        return self._planned(
            replace(found, rows=rows, problems=problems), "to_pre_grasp", "retreat_positions"
        )

    def found(self, what: str, *names: str, **asked: Any) -> FoundActions:
        """The actions `what` of `FINDERS` that the arm reaches, with arguments as of its finder."""
        find, before, after = FINDERS[what]
        reach: dict[str, Any] = {"arm": self.arm, "base": self.base, "limit": self.count}
        found = find(self.seen, *names, gripper=self.gripper, **asked, **reach)
        return self._planned(found, before, after)

    def _planned(self, found: FoundActions, before: str, after: str) -> FoundActions:
        """The action of a motion, its positions before and after the approach under these keys."""
        if not self.plan or not found.rows:
            return found
        motion = plan_action(self.seen, self.name, self.base, found.rows, state=self.state)
        if motion is None:
            count = len(found.rows)
            problem = f"{self.name}: no motion to one of {count} within reach was found"
            return replace(found, rows=[], problems=[*found.problems, problem])
        pieces = {
            before: motion.to_pre_grasp,
            "approach_positions": motion.approach,
            after: motion.after,
            "back_positions": motion.back,
        }
        moved = {key: positions.tolist() for key, positions in pieces.items() if len(positions)}
        row = motion.row | {"joints": list(motion.joints), "path": motion.path} | moved
        return replace(found, rows=[row], motion=motion)
