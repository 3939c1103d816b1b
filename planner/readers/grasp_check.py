"""What a robot's gripper and arm do with objects of the map: plans ask before missions try."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from semmap.query.entity_query import entity_id
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities

if TYPE_CHECKING:
    from trimesh import Trimesh

    from semmap.manipulation.arm import Arm
    from semmap.manipulation.arm_reach import ArmReach
    from semmap.manipulation.gripper import Gripper
    from semmap.manipulation.places import PutDowns
    from semmap.perception.primitives import Primitive


ITEMS = 4
"""Objects for each target of which it is asked from where an arm puts them there."""


@dataclass(frozen=True)
class KnownHand:
    """The gripper by which plans judge: its name in the map, and the robot that moves it, if known.

    `assumed`: the default one, which nothing states.
    """

    robot: str | None
    name: str
    gripper: Gripper
    assumed: bool = False


class GraspCheck:
    """The gripper of a mission: the one that is named, else that of the first robot that has one.

    `robots` are names of stored robots or of classes, whose URDFs count. Other robots have the
    preferred gripper, else the only one of no robot, else the default one (`hand_of`). With
    `assume_sizes`, objects without geometry have the boxes that simulated missions give them. URDFs
    are read when something is picked up. Nothing is stored. A LookupError refuses a `gripper` that
    is not there.
    """

    def __init__(
        self,
        seen: Snapshot,
        *,
        gripper: str | None = None,
        robots: tuple[str | None, ...] = (),
        assume_sizes: bool = False,
    ) -> None:
        self._seen, self._named, self._assume_sizes = seen, gripper, assume_sizes
        self._robots = [name for name in robots if name is not None]
        self._grasps = cache(self._known)
        self._puts: dict[str, list[tuple[PutDowns, list[dict[str, Any]]]]] = {}

    @cached_property
    def _stored(self) -> tuple[str, str] | None:
        """The first stored robot, and its gripper."""
        from semmap.manipulation.automata import automaton_of

        return automaton_of(self._seen.session, *self._robots)

    @cached_property
    def _found(self) -> tuple[KnownHand | None, str | None]:
        """The hand; None, and why, where it is not known."""
        from semmap.manipulation.automata import class_gripper
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.retrieval import stored_gripper, usual_gripper

        session = self._seen.session
        robot, named = (None, self._named) if self._named else self._stored or (None, None)
        try:
            if named:
                return KnownHand(robot, named, stored_gripper(session, named)), None
            for name in self._robots:
                own = class_gripper(session, name)
                if own is not None:
                    return KnownHand(name, f"{name}_gripper", own), None
            with session.transaction():
                return KnownHand(None, *usual_gripper(session)), None
        except (LookupError, ManipulationError) as error:
            if self._named and isinstance(error, LookupError):
                raise
            return None, str(error)

    @property
    def hand(self) -> KnownHand | None:
        """What the robot grasps with; None where it is not known."""
        return self._found[0]

    @cached_property
    def arm(self) -> tuple[str, Arm] | None:
        """The name of the robot that moves the gripper, and its arm; None where it is not known."""
        from semmap.manipulation.automata import folded_arm, stored_arm
        from semmap.manipulation.error import ManipulationError

        if self.hand is None or (robot := self.hand.robot) is None:
            return None
        with suppress(ManipulationError):  # no joint moves the gripper
            if self._stored is not None:
                return robot, stored_arm(self._seen.session, robot)[1]
            return robot, folded_arm(self.hand.gripper)
        return None

    @property
    def _body(self) -> str | None:
        """The first class of robots that has a URDF."""
        from semmap.manipulation.automata import class_urdf

        session = self._seen.session
        return next((name for name in self._robots if class_urdf(session, name)), None)

    def _known(self, item: str) -> list[dict[str, Any]] | str:
        """The grasps of an object, of one that is held the one that holds it; why none is known."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import taken_by
        from semmap.manipulation.retrieval import known_grasps

        hand, why = self._found
        if hand is None:
            return str(why)
        try:
            shape = self._shape(item)
            rows = known_grasps(self._seen, item, hand.name, hand.gripper, shape=shape)
            held = (
                taken_by(self._seen, item, hand.name) if rows and "action_id" in rows[0] else None
            )
            return [row for row in rows if row["action_id"] == held] if held else rows
        except ManipulationError as error:
            return str(error)

    def _shape(self, item: str) -> Primitive:
        """The shape of an object; ManipulationError without a volume."""
        from semmap.manipulation.store.model_shapes import mesh_shape
        from semmap.perception.mesh_shapes import mesh_primitive

        if item in self._boxes:
            return mesh_primitive(self._boxes[item])
        return mesh_shape(self._seen, item)

    @cached_property
    def _boxes(self) -> dict[str, Trimesh]:
        """The assumed boxes of objects without geometry, in the frames of the objects."""
        import trimesh

        if not self._assume_sizes:
            return {}
        boxes = {}
        for entity in read_entities(self._seen, kinds=["object"], assume_sizes=True):
            if entity.assumed:
                corners = entity.pose.inverse().apply(entity.triangles.reshape(-1, 3))
                faces = np.arange(len(corners)).reshape(-1, 3)
                boxes[entity.name] = trimesh.Trimesh(corners, faces)
        return boxes

    def misfit(self, item: str, *, moved: bool = False) -> str | None:
        """Why no grasp takes an object; None if one does, or where nothing is known.

        One takes it that the gripper reaches without touching what is around. Of an object that is
        `moved`, or freed of what is on it before, only the shape counts.
        """
        from semmap.manipulation.retrieval import misfit, slanting, touching
        from semmap.manipulation.suitability import reasons_against

        hand, grasps = self.hand, self._grasps(item)
        if hand is None or isinstance(grasps, str):
            return None
        if not grasps:
            number = entity_id(self._seen.session, item)
            excluded = reasons_against(self._seen, "grasp", hand.gripper.kind, [number])
            held = hand.gripper
            wide = misfit(item, self._shape(item), hand.name, held.opening, held.kind)
            why = excluded.get(item, wide)
        elif moved or grasps[0]["pose"] is None:  # it has no pose in the map
            return None
        else:
            level = [row for row in grasps if hand.gripper.can_tilt_to(row["pose"].matrix)]
            if self._is_free(level):
                return None
            every = len(grasps)
            why = (
                touching(self._seen, item, len(level))
                if level
                else slanting(item, every, hand.name)
            )
        return f"{why}; {assumption(hand.name)}" if hand.assumed else why

    def no_place(
        self,
        item: str,
        on: str,
        heights: tuple[float, float],
        floor: float,
        *,
        inside: bool,
        is_open: bool,
    ) -> str | None:
        """Why the hand puts an object on no level of another one; None where nothing is known.

        Of the levels are those between two `heights` above a floor, and with `inside` those below
        the top. One that `is_open` is taken to have a place; from where an arm gets to it is for
        `reach`.
        """
        from semmap.geometry.surfaces import Levels
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import PutDowns

        known = self._puts.setdefault(on, [])
        if is_open and (self.arm is None or len(known) == ITEMS):
            return None
        hand, grasps = self.hand, self._grasps(item)
        if hand is None or isinstance(grasps, str) or not grasps:
            return None
        levels = Levels((floor + heights[0], floor + heights[1]), inside)
        try:
            puts = PutDowns(self._seen, item, on, hand.gripper, levels)
            free = is_open or puts.some_are_free(puts.ends_of(grasps))
        except ManipulationError:
            return None
        if free:
            known += [(puts, grasps)][: ITEMS - len(known)]
            return None
        low, high = heights
        where = "in" if inside else "on or in"
        return (
            f"{item} cannot be put {where} {on}: at heights from {low:.1f} to {high:.1f} m, which "
            f"the robot reaches, the hand gets straight to no free spot of it"
        )

    def _is_free(self, grasps: list[dict[str, Any]]) -> bool:
        """Whether the gripper gets to one of the grasps, or the library that says so lacks."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.surroundings import Surroundings

        assert self.hand is not None
        try:
            return bool(Surroundings(self._seen, self.hand.gripper).free_rows(grasps, 1))
        except ManipulationError:
            return True

    def unjudged(self, items: Iterable[str]) -> list[str]:
        """A sentence on each object whose grasps are not known, and on an arm that is not."""
        known = [(item, self._grasps(item)) for item in items]
        found = [
            f"the grasps of {item} are not judged: {why}"
            for item, why in known
            if isinstance(why, str)
        ]
        if known and self.hand and self.hand.gripper.is_assumed:
            found.append(
                f"the URDF states no limits of the finger joints of {self.hand.name}: they are "
                f"assumed to open to {self.hand.gripper.opening:.2f} m"
            )
        body = self._body if known and self.arm is None else None
        if body is not None:
            hand = f"{assumption(self.hand.name)}; " if self.hand and self.hand.assumed else ""
            found.append(
                f"{hand}whether an arm of {body} reaches there is not judged: its URDF shows no "
                "arm with a gripper"
            )
        return found

    def reach(self, name: str, *, carried: bool, beneath: bool) -> ArmReach | None:
        """From where the arm acts on an object; None where nothing is known.

        It grasps an object that is carried, which may be `beneath` others. On any other one it puts
        the objects of which `no_place` was asked, else something.
        """
        from semmap.manipulation.arm_reach import GraspReach, PutReach, SurfaceReach

        if self.arm is None:
            return None
        if self._puts.get(name):
            return PutReach(self._seen, self._puts[name], self.arm[1])
        if not carried:
            return SurfaceReach.on(self._seen, name, self.arm[1])
        rows = self._grasps(name)
        if isinstance(rows, str) or not rows:
            return None
        return GraspReach(self._seen, rows, self.arm[1], beneath=beneath)


def assumption(gripper: str) -> str:
    """What is said where nothing states the gripper."""
    return f"{gripper} is assumed: gripper= names another one"
