"""What a robot's gripper and arm do with objects of the map: plans ask before missions try."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.manipulation.arm import Arm
    from semmap.manipulation.gripper import Gripper


class GraspCheck:
    """The gripper that is named, else that of the first robot that has one, with its arm.

    `robots` are names of stored robots or of classes, whose URDFs count. Of a robot without any,
    and of an object without a mesh, nothing is known. URDFs are read when something is picked up.
    """

    def __init__(
        self, seen: Snapshot, *, gripper: str | None = None, robots: tuple[str | None, ...] = ()
    ) -> None:
        self._seen, self._named = seen, gripper
        self._robots = [name for name in robots if name is not None]
        self._grasps = cache(self._known)

    @cached_property
    def _stored(self) -> tuple[str, str] | None:
        """The first stored robot, and its gripper."""
        from semmap.manipulation.automata import automaton_of

        return automaton_of(self._seen.session, *self._robots)

    @cached_property
    def hand(self) -> tuple[str | None, str, Gripper] | None:
        """The robot, and its gripper with the name by which the map knows it."""
        from semmap.manipulation.automata import class_gripper
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.retrieval import stored_gripper

        session = self._seen.session
        robot, named = (None, self._named) if self._named else self._stored or (None, None)
        try:
            if named:
                return robot, named, stored_gripper(session, named)
        except ManipulationError:
            return None  # its URDF is not on this machine
        owns = ((name, class_gripper(session, name)) for name in self._robots)
        return next(((name, own.name, own) for name, own in owns if own is not None), None)

    @cached_property
    def arm(self) -> tuple[str, Arm] | None:
        """The name of the robot that moves the gripper, and its arm; None where it is not known."""
        from semmap.manipulation.automata import gripper_arm, stored_arm
        from semmap.manipulation.error import ManipulationError

        if self.hand is None or (robot := self.hand[0]) is None:
            return None
        with suppress(ManipulationError):  # no joint moves the gripper
            if self._stored is not None:
                return robot, stored_arm(self._seen.session, robot)[1]
            return robot, gripper_arm(self.hand[2])
        return None

    def _known(self, item: str) -> list[dict[str, Any]] | None:
        """The grasps of an object; None where they are not known."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.retrieval import known_grasps

        with suppress(ManipulationError):
            if self.hand is not None:
                return known_grasps(self._seen, item, *self.hand[1:])
        return None

    def misfit(self, item: str) -> str | None:
        """Why no grasp of an object fits; None if one does, or where nothing is known."""
        from semmap.manipulation.retrieval import misfit
        from semmap.manipulation.store.model_shapes import mesh_shape

        if self.hand is None or self._grasps(item) != []:
            return None
        _, name, gripper = self.hand
        return misfit(item, mesh_shape(self._seen, item), name, gripper.opening)

    def reach(self, name: str, *, carried: bool, beneath: bool) -> Callable[[Pose], bool] | None:
        """Whether the arm acts on an object from a base pose; None where nothing is known.

        It grasps an object that is carried, which may be `beneath` others; it puts something on any
        other one.
        """
        from semmap.manipulation.arm_reach import grasp_reach, surface_reach

        if self.arm is None:
            return None
        if not carried:
            return surface_reach(self._seen, name, self.arm[1])
        rows = self._grasps(name)
        return grasp_reach(self._seen, rows, self.arm[1], beneath=beneath) if rows else None


def assumed_misfits(
    seen: Snapshot, items: Iterable[str], *, robots: tuple[str | None, ...] = ()
) -> list[str]:
    """Why missions may fail to pick up items for which `GraspCheck` knows no gripper.

    A mission then has the preferred stored gripper, else the default one. Empty where a gripper is
    known: a plan refuses what does not fit in it.
    """
    from semmap.manipulation.error import ManipulationError
    from semmap.manipulation.gripper import read_gripper
    from semmap.manipulation.retrieval import (
        ANY_GRIPPER,
        DEFAULT_GRIPPER,
        gripper_name,
        stored_gripper,
    )

    items, session, check = list(items), seen.session, GraspCheck(seen, robots=robots)
    if not items or check.hand:
        return []
    try:
        if session.execute(ANY_GRIPPER).fetchone():
            name = gripper_name(session, None)
            check.hand = None, name, stored_gripper(session, name)
        else:
            check.hand = None, DEFAULT_GRIPPER.stem, read_gripper(DEFAULT_GRIPPER)
    except (LookupError, ManipulationError):  # several, or its URDF is not on this machine
        return []
    return [
        f"{why}. A robot that states no gripper has it in missions, and fails if it tries grasps"
        for why in map(check.misfit, items)
        if why is not None
    ]
