"""Which grasp takes an object and which place puts it down, by a robot's gripper and arm.

Stored actions come before generated ones. With a trial, each is simulated before the robot acts
(Tosello et al., section IV-C): what fails is stored, and the next one is tried.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from planner.mission.behaviours import Outcome
from semmap.geometry.pose import Pose
from semmap.manipulation.automata import reachable_rows

if TYPE_CHECKING:
    from semmap.manipulation.arm import Arm
    from semmap.manipulation.arm_motions import Motion

__all__ = ["Choice", "GraspChooser", "Hand", "hand_of"]

GRASPS, REACHED = 400, 24
"""Free grasps of which an arm must reach one, and the most that it reaches that are considered."""

TRIED = 100
"""The most grasps of which trials choose."""

STORED = 1000
"""The most stored grasps among which the chosen one is looked up."""

SPOTS = 12
"""Spots to which motions of the arm are tried."""

HERE = 0.05
"""Metres between a base and an object below which the base is no place to stand."""

UNCHECKED = "its arm is not checked: the robot's class has no shape (semmap robot add URDF)"

LIFT = 0.1
"""Metres by which an object is lifted that was grasped."""

MOTION = 5.0
"""The longest time to plan one motion, seconds."""


@dataclass(frozen=True)
class Hand:
    """What a robot grasps with.

    Attributes
    ----------
    gripper : name of a stored gripper
    automaton : name of the stored robot whose arm moves it; None if not known
    assumed : nothing says that the robot has this gripper: it is the default one
    """

    gripper: str
    automaton: str | None = None
    assumed: bool = False


@dataclass(frozen=True)
class Choice:
    """How a pickup or a place begins.

    Attributes
    ----------
    action : id of the action that is used; None without one
    note : how it was chosen, or why there is none, in words
    refusal : the outcome of a step that cannot begin; None where the robot shall act
    tried : whether a trial in simulation decided
    spot : of a place: where the object is put down instead, map's frame
    decided : ids of the actions that trials decided on
    """

    action: int | None = None
    note: str = ""
    refusal: Outcome | None = None
    tried: bool = False
    spot: Pose | None = None
    decided: frozenset[int] = frozenset()


def hand_of(session: Any, name: str, robot_class: str | None, gripper: str | None = None) -> Hand:
    """Return what a robot grasps with; where no gripper is stored, the default one, then stored.

    Parameters
    ----------
    name, robot_class : of the robot, which may be those of a stored automaton
    gripper : name of a gripper, without an arm; by default that of the automaton, else the
        preferred one, else the only one

    Raises
    ------
    LookupError
        There is no such gripper, or there are several and none is preferred.
    """
    from semmap.manipulation.automata import automaton_of
    from semmap.manipulation.retrieval import DEFAULT_GRIPPER, gripper_name

    found = automaton_of(session, name, robot_class)
    if found is not None and gripper is None:
        return Hand(found[1], found[0])
    chosen = gripper_name(session, gripper)
    (preferred,) = session.execute(
        "SELECT g.preferred FROM gripper g JOIN device d ON d.id = g.device_id WHERE d.name = %s",
        (chosen,),
    ).fetchone()
    default = chosen == DEFAULT_GRIPPER.stem and not preferred
    return Hand(chosen, assumed=default and gripper is None)


@dataclass(frozen=True)
class GraspChooser:
    """Chooses the grasps and places of one robot.

    Attributes
    ----------
    session : of the map
    robot : name of the agent
    hand : what it grasps with
    base : where it stands, in the map's frame
    trial : whether a trial in simulation decides
    lenient : an assumed gripper refuses nothing: the robot acts without a grasp then
    motion_seconds : the longest time to look for motions of the arm; None for no motions
    """

    session: Any
    robot: str
    hand: Hand
    base: Pose
    trial: bool = False
    lenient: bool = False
    motion_seconds: float | None = None

    @property
    def arm(self) -> Arm | None:
        """The arm of the stored robot; None without one."""
        from semmap.manipulation.automata import stored_arm

        if self.hand.automaton is None:
            return None
        return stored_arm(self.session, self.hand.automaton)[1]

    def grasp(self, item: str, target: str | None) -> Choice:
        """Return the grasp of a pickup: if possible, one that a free place on the target ends."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.retrieval import find_grasps
        from semmap.manipulation.shape_store import shape_of

        try:
            with self.session.transaction():
                shape_of(self.session, item)
        except ManipulationError as error:
            return Choice(note=f"without a grasp: {error}")
        arm = None if self._is_at(item) else self.arm
        most = GRASPS if arm is not None else TRIED if self.trial else 1
        found = find_grasps(self.session, name=item, gripper=self.hand.gripper, limit=most)
        rows = [row for row in found.rows if row["entity"] == item]
        if not rows:
            return self._none("; ".join(found.problems) or f"{item}: no grasp is known")
        if arm is not None:
            rows = reachable_rows(rows, arm, self.base, REACHED)
            if not rows:
                where = f"no free grasp of it is within reach of {self.hand.automaton} here"
                return self._none(f"{item}: {where}")
        rows = self._placeable_first(item, target, rows)
        if self._is_at(item) and self.hand.automaton is not None:
            choice = self._first(item, rows)
            return replace(choice, note=f"{choice.note}; {UNCHECKED}")
        if arm is None or self.motion_seconds is None:
            return self._first(item, rows)
        return self._moved(item, rows, arm)

    def place(
        self,
        item: str,
        grasp: int,
        target: str | None,
        spot: Pose | None,
        *,
        stands: Pose | None = None,
    ) -> Choice:
        """Return the place that ends a grasp.

        Parameters
        ----------
        target : object on which the item is put; None for a floor
        spot : free pose of the item there, in the map's frame; None without one
        stands : pose of the item before it was taken, in the map's frame; None for no trial
        """
        choice = self._place(item, grasp, None if spot is None else stands)
        planned = choice.refusal is None and choice.action is not None
        if not planned or target is None or spot is None or self.motion_seconds is None:
            return choice
        if self.arm is None or self._is_at(target):
            return choice
        return self._put(item, grasp, target, spot, choice)

    def _place(self, item: str, grasp: int, stands: Pose | None) -> Choice:
        """The best place that ends a grasp, without a motion."""
        from semmap.manipulation.places import place_of
        from semmap.manipulation.practice import NOT_HELD, try_place
        from semmap.manipulation.task_store import record_task

        gripper = self.hand.gripper
        action = place_of(self.session, item, grasp, gripper)
        if action is None or not self.trial or stands is None:
            return Choice(action)
        cause = try_place(self.session, item, gripper, grasp, action, stands=stands)
        if cause is None:
            return Choice(action, f"place {action}, tried in simulation", tried=True)
        if cause == NOT_HELD:  # says nothing of the place
            return Choice(
                action, f"place {action}, not tried: the grasp does not hold in simulation"
            )
        why = f"{item}: place {action} was tried in simulation: it {cause}"
        if self._acts_anyway:
            record_task(
                self.session,
                item,
                "place",
                action=action,
                outcome="error",
                robot=self.robot,
                simulated=True,
                message=cause,
            )
            return Choice(note=f"without a place: {why}; {self._assumption}")
        return Choice(action, refusal=Outcome("missed", why), tried=True)

    def _is_at(self, name: str) -> bool:
        """Whether the robot stands in an object: its class has no shape that needs free floor."""
        row = self.session.execute(
            "SELECT pose FROM world WHERE entity_id = entity_id(%s)", (name,)
        ).fetchone()
        return row is not None and math.dist(row[0][:2], self.base[:2]) < HERE

    def _first(self, item: str, rows: list[dict[str, Any]]) -> Choice:
        """The first grasp, or the first one that succeeds in a trial."""
        return self._tried(item, rows) if self.trial else self._chosen(int(rows[0]["action_id"]))

    def _moved(self, item: str, rows: list[dict[str, Any]], arm: Arm) -> Choice:
        """The first grasp to which the arm moves without touching anything; its path is stored."""
        from semmap.manipulation.arm_motions import plan_grasp
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.reader import actions_on
        from semmap.manipulation.task_store import record_task

        automaton, robot = str(self.hand.automaton), self.robot
        clock = _Clock(float(self.motion_seconds or 0))
        looked = 0
        while rows and clock.left > 0:
            choice = self._first(item, rows)
            if choice.action is None:
                return choice
            stored = actions_on(self.session, name=item, gripper=self.hand.gripper, limit=STORED)
            grasp = [row for row in stored if row["action_id"] == choice.action]
            near = reachable_rows(grasp, arm, self.base, 1)  # a corrected grasp may be out of reach
            try:
                motion = plan_grasp(
                    self.session, automaton, self.base, near, seconds=min(clock.left, MOTION)
                )
            except ManipulationError as error:
                return self._none(f"{item}: {error}")
            if motion is not None:
                return replace(choice, note=f"{choice.note}; {_told(motion)}")
            looked += 1
            if choice.tried:  # another grasp is used, and still this one succeeded
                record_task(
                    self.session,
                    item,
                    action=choice.action,
                    outcome="completed",
                    robot=robot,
                    simulated=True,
                )
            done = choice.decided | {choice.action}
            rows = [row for row in rows if row["action_id"] not in done]
        return self._none(
            f"{item}: {clock.spent} without a free motion of {automaton} to {looked} grasps"
        )

    def _put(self, item: str, grasp: int, target: str, spot: Pose, choice: Choice) -> Choice:
        """The place at the first spot to which the arm brings the item; its path is stored."""
        from semmap.manipulation.arm_motions import plan_place
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import find_places

        automaton = str(self.hand.automaton)
        clock = _Clock(float(self.motion_seconds or 0))
        found = find_places(
            self.session,
            item,
            target,
            gripper=self.hand.gripper,
            grasps=[grasp],
            towards=(spot.x, spot.y),
            arm=self.arm,
            base=self.base,
            limit=SPOTS,
        )
        looked, why = 0, ""
        for state in self._carries():
            for row in found.rows:
                if clock.left <= 0:
                    break
                seconds = min(clock.left, MOTION)
                try:
                    motion = plan_place(
                        self.session, automaton, self.base, [row], state=state, seconds=seconds
                    )
                except ManipulationError as error:
                    why = f"; {error}"
                    break  # the arm cannot start from there
                if motion is not None:
                    note = "; ".join(filter(None, (choice.note, _told(motion))))
                    action = int(row["action_id"])
                    return replace(choice, action=action, note=note, spot=row["spot"])
                looked += 1
        places = f"{looked} places on {target}"
        told = f"{clock.spent} without a free motion of {automaton} to {places}{why}"
        return Choice(refusal=Outcome("unable", f"{item}: {told}"))

    def _carries(self) -> list[dict[str, float] | None]:
        """Positions of the joints with which the arm may carry an object, None for those at rest.

        First those above where the last motion led: a pickup lifts what it took, and goes back to
        where its approach began.
        """
        row = self.session.execute(LAST, (self.hand.automaton,)).fetchone()
        arm = self.arm
        if row is None or arm is None:
            return [None]
        last = dict(zip(row[0], row[1][-1], strict=True))
        begun = np.array([last.get(joint.name, 0.0) for joint in arm.joints])
        pose = arm.grasp_pose(begun)
        pose[2, 3] += LIFT
        lifted = arm.reach(pose, begun)
        if lifted is None:
            return [None]
        return [dict(zip((j.name for j in arm.joints), lifted.tolist(), strict=True)), None]

    def _placeable_first(
        self, item: str, target: str | None, rows: list[dict[str, Any]]
    ) -> list[dict[str, Any]]:
        """The grasps, first the one with which the object can be put on the target."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.places import find_places

        if target is None:
            return rows
        free_choice = self.hand.automaton is None and not self.trial
        ids = None if free_choice else [int(row["action_id"]) for row in rows]
        try:
            with self.session.transaction():
                places = find_places(
                    self.session, item, target, gripper=self.hand.gripper, grasps=ids, limit=1
                )
        except (LookupError, ManipulationError):
            return rows  # something without a mesh, or without a level surface
        if not places.rows:
            return rows
        best = int(places.rows[0]["grasp_id"])
        first = [row for row in rows if row["action_id"] == best]
        return (first or [{"action_id": best}]) + [r for r in rows if r["action_id"] != best]

    def _tried(self, item: str, rows: list[dict[str, Any]]) -> Choice:
        """The first grasp that succeeds in a trial; outcomes of the others are stored."""
        from semmap.manipulation.practice import practise

        made = practise(
            self.session, item, self.hand.gripper, rows=rows, robot=self.robot, counted=False
        )
        last = made[-1]
        tried = "1 grasp" if len(made) == 1 else f"{len(made)} grasps"
        if last["outcome"] != "completed":
            return self._none(
                f"{item}: {tried} tried in simulation, the last one: {last['outcome']}"
            )
        choice = self._chosen(last["stored"] or last["action_id"], f"{tried} tried in simulation")
        return replace(choice, decided=frozenset(int(each["action_id"]) for each in made))

    def _chosen(self, action: int, how: str = "not tried") -> Choice:
        assumed = f", {self._assumption}" if self.hand.assumed else ""
        note = f"grasp {action} by {self.hand.gripper}, {how}{assumed}"
        return Choice(action, note, tried=self.trial)

    def _none(self, why: str) -> Choice:
        if self._acts_anyway:
            return Choice(note=f"without a grasp: {why}; {self._assumption}")
        return Choice(refusal=Outcome("unable", why))

    @property
    def _acts_anyway(self) -> bool:
        return self.lenient and self.hand.assumed

    @property
    def _assumption(self) -> str:
        return f"{self.hand.gripper} is assumed: --gripper names another one"


LAST = """
SELECT p.joints, p.positions FROM path p JOIN automaton a ON a.id = p.automaton_id
WHERE p.map_id = (SELECT current_map()) AND a.name = %s AND p.joints IS NOT NULL
ORDER BY p.id DESC LIMIT 1
"""


class _Clock:
    """How much of a time is left."""

    def __init__(self, seconds: float) -> None:
        self._begun, self._seconds = time.monotonic(), seconds

    @property
    def left(self) -> float:
        return self._seconds - (time.monotonic() - self._begun)

    @property
    def spent(self) -> str:
        return f"{time.monotonic() - self._begun:.0f} s"


def _told(motion: Motion) -> str:
    how = "followed again" if motion.reused else "planned"
    return f"path {motion.path} of the arm, {how}"
