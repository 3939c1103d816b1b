"""Which grasp takes an object and which place puts it down, by a robot's gripper and arm.

Stored actions come before generated ones. With a trial, each is simulated before the robot acts
(Tosello et al., section IV-C): what fails is stored, and the next one is tried.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from planner.mission.behaviours import Outcome
from planner.mission.command import Command
from planner.readers.grasp_check import assumption
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import ANY_LEVEL, Levels
from semmap.manipulation.arm import Arm
from semmap.manipulation.arm_motions import ArmMotion, FreeArm, plan_action
from semmap.manipulation.automata import (
    automaton_of,
    class_automaton,
    quickest_first,
    reachable_rows,
    stored_arm,
)
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.places import find_places, place_of
from semmap.manipulation.practice import NOT_HELD, practise, try_place
from semmap.manipulation.reader import actions_on
from semmap.manipulation.retrieval import find_grasps, gripper_name, is_default, stored_usual
from semmap.manipulation.store.model_shapes import shape_of
from semmap.manipulation.store.tasks import record_task
from semmap.query.snapshot import Snapshot

GRASPS, REACHED = 400, 100
"""Free grasps of which an arm must reach one, and the most that it reaches that are considered."""

TRIED = 100  # the most grasps of which trials choose
STORED = 1000  # the most stored grasps among which the chosen one is looked up
SPOTS = 12  # spots to which motions of the arm are tried
HERE = 0.05  # metres between a base and an object below which the base is no place to stand

UNCHECKED = "its arm is not checked: the robot's class has no shape (semmap robot add URDF)"

MOTION = 5.0  # the longest time to plan one motion, seconds


@dataclass(frozen=True)
class Hand:
    """What a robot grasps with: a stored gripper, and the stored robot that moves it, if known."""

    gripper: str
    automaton: str | None = None
    assumed: bool = False  # the default one, which nothing states


@dataclass(frozen=True)
class Choice:
    """How a pickup or a place begins."""

    action: int | None = None  # id of the action that is used
    note: str = ""  # how it was chosen, or why there is none
    refusal: Outcome | None = None  # of a step that cannot begin
    tried: bool = False  # a trial in simulation decided
    spot: Pose | None = None  # where else the object is put down, map's frame
    motion: ArmMotion | None = None  # how the arm does it
    decided: frozenset[int] = frozenset()  # actions that trials decided on

    def of(self, command: Command) -> Command:
        """The command with what was chosen for it."""
        motion = None if self.motion is None else self.motion.as_json()
        spot = self.spot or command.spot
        return replace(command, spot=spot, action=self.action, motion=motion)


def hand_of(session: Any, name: str, robot_class: str | None, gripper: str | None = None) -> Hand:
    """What a robot grasps with; where no gripper is stored, the default one, then stored.

    The robot or its class may have the name of a stored automaton; else that of the URDF of the
    class is stored. `gripper` names one, without an arm; by default it is that of the automaton,
    else that of `usual_name`. Raises LookupError: there is no such gripper, or several are of no
    robot and none is preferred.
    """
    names = [each for each in (name, robot_class) if each is not None]
    found = automaton_of(session, *names)
    if gripper is None and found is None:
        found = next(filter(None, (class_automaton(session, each) for each in names)), None)
    if gripper is None and found is not None:
        return Hand(found[1], found[0])
    chosen = stored_usual(session) if gripper is None else gripper_name(session, gripper)
    return Hand(chosen, assumed=gripper is None and is_default(session, chosen))


@dataclass(frozen=True)
class GraspChooser:
    """Chooses the grasps and places of one robot."""

    seen: Snapshot
    robot: str
    hand: Hand
    base: Pose  # where it stands, map's frame
    trial: bool = False  # a trial in simulation decides
    motion_seconds: float | None = None  # of the processor, for motions; None: no motions
    failed: frozenset[int] = frozenset()  # grasps that come after all others
    levels: Levels = ANY_LEVEL  # of what it puts the object on

    @property
    def arm(self) -> Arm | None:
        """The arm of the stored robot; None without one."""
        if self.hand.automaton is None:
            return None
        return stored_arm(self.seen.session, self.hand.automaton)[1]

    def grasp(self, item: str, target: str | None, at: Pose | None = None) -> Choice:
        """The grasp of a pickup: if possible, one that a free place on the target ends.

        `at` is where the robot's base will stand for that, map's frame.
        """
        try:
            with self.seen.session.transaction():
                shape_of(self.seen, item)
        except ManipulationError as error:
            return Choice(note=f"without a grasp: {error}")
        arm = None if self._is_at(item) else self.arm
        most = GRASPS if arm is not None else TRIED if self.trial or self.failed else 1
        found = find_grasps(self.seen, name=item, gripper=self.hand.gripper, limit=most)
        rows = [row for row in found.rows if row["entity"] == item]
        if not rows:
            why = "; ".join(found.problems) or f"{item}: no grasp is known"
            return self._none(why, "unfit")
        if arm is not None:
            automaton = str(self.hand.automaton)
            rows = reachable_rows(rows, arm, self.base, REACHED)
            if not rows:
                return self._none(
                    f"{item}: no free grasp of it is within reach of {automaton} here"
                )
            if self.motion_seconds is not None:
                reached, rows = rows, [*FreeArm(self.seen, arm).rows(self.base, rows)]
                if not rows:
                    reason = f"touches something at each of {len(reached)} grasps"
                    return self._none(f"{item}: the arm of {automaton} {reason}")
            rows = quickest_first(rows, arm)
        rows = self._placeable_first(item, target, rows, at)
        rows.sort(key=lambda row: row["action_id"] in self.failed)
        choices = self._choices(item, target, rows)
        if self._is_at(item) and self.hand.automaton is not None:
            choice = next(choices)
            return replace(choice, note=f"{choice.note}; {UNCHECKED}")
        if arm is None or self.motion_seconds is None:
            return next(choices)
        return self._moved(item, choices, arm)

    def place(
        self,
        item: str,
        grasp: int,
        target: str | None,
        spot: Pose | None,
        *,
        stands: Pose | None = None,
    ) -> Choice:
        """The place on a target, or the floor, that ends a grasp.

        `spot` is a free pose of the item there, `stands` its pose before it was taken, both in the
        map's frame; without the latter there is no trial.
        """
        choice = self._place(item, grasp, None if spot is None else stands)
        planned = choice.refusal is None and choice.action is not None
        if not planned or target is None or spot is None or self.motion_seconds is None:
            return choice
        arm = self.arm
        if arm is None or self._is_at(target):
            return choice
        return self._put(item, grasp, target, spot, choice, arm)

    def _place(self, item: str, grasp: int, stands: Pose | None) -> Choice:
        """The best place that ends a grasp, without a motion."""
        gripper = self.hand.gripper
        action = place_of(self.seen, item, grasp, gripper)
        if action is None or not self.trial or stands is None:
            return Choice(action)
        cause = try_place(self.seen, item, gripper, grasp, action, stands=stands)
        if cause is None:
            return Choice(action, f"place {action}, tried in simulation", tried=True)
        if cause == NOT_HELD:  # says nothing of the place
            return Choice(
                action, f"place {action}, not tried: the grasp does not hold in simulation"
            )
        why = f"{item}: place {action} was tried in simulation: it {cause}"
        return Choice(action, refusal=Outcome("unfit", why), tried=True)

    def _is_at(self, name: str) -> bool:
        """Whether the robot stands in an object: its class has no shape that needs free floor."""
        pose = self._pose_of(name)
        return pose is not None and math.dist(pose[:2], self.base[:2]) < HERE

    def _pose_of(self, name: str) -> Pose | None:
        row = self.seen.session.execute(
            "SELECT w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.map_id = current_map() AND e.name = %s",
            (name,),
        ).fetchone()
        return None if row is None else Pose(*row[0])

    def _choices(
        self, item: str, target: str | None, rows: list[dict[str, Any]]
    ) -> Iterator[Choice]:
        """Each grasp that succeeds in a trial, and then a place on the target; last, a refusal."""
        cause = ""
        while rows:
            tried = self._tried(item, rows) if self.trial else self._chosen(rows[0]["action_id"])
            if tried.action is None:
                yield self._none(f"{item}: {cause}") if cause else tried
                return
            unfit = self._unfit(item, target, tried.action)
            if unfit is None:
                yield tried
            cause = unfit or cause
            if tried.tried:  # whatever becomes of it, it succeeded
                self._record(item, tried.action)
            done = tried.decided | {tried.action}
            rows = [row for row in rows if row["action_id"] not in done]
        yield self._none(f"{item}: {cause or 'no other grasp is known'}")

    def _unfit(self, item: str, target: str | None, grasp: int) -> str | None:
        """Why a trial puts the item badly on the target after a grasp; None if not known."""
        gripper, stands = self.hand.gripper, self._pose_of(item)
        if target is None or stands is None or not self.trial:
            return None
        best = self._place_on(target, item, [grasp])
        if best is None:
            return None
        place = int(best["action_id"])
        cause = try_place(self.seen, item, gripper, grasp, place, stands=stands)
        if cause in (None, NOT_HELD):
            return None
        return f"grasp {grasp} holds it, but put down in simulation it {cause}"

    def _record(self, item: str, action: int) -> None:
        """Store that a grasp succeeded in a trial, where the mission uses another one."""
        done: dict[str, Any] = {"outcome": "completed", "robot": self.robot, "simulated": True}
        record_task(self.seen.session, item, action=action, **done)

    def _moved(self, item: str, choices: Iterator[Choice], arm: Arm) -> Choice:
        """The first grasp to which the arm moves without touching anything; its path is stored."""
        automaton = str(self.hand.automaton)
        clock = _Clock(float(self.motion_seconds or 0))
        looked = 0
        for choice in choices:
            if choice.action is None and looked == 0:
                return choice
            if choice.action is None:
                break
            stored = actions_on(self.seen, name=item, gripper=self.hand.gripper, limit=STORED)
            grasp = [row for row in stored if row["action_id"] == choice.action]
            near = reachable_rows(grasp, arm, self.base, 1)  # a corrected grasp may be out of reach
            try:
                motion = plan_action(
                    self.seen, automaton, self.base, near, seconds=min(clock.left, MOTION)
                )
            except ManipulationError as error:
                return self._none(f"{item}: {error}")
            if motion is not None:
                note = f"{choice.note}; {_told(motion)}"
                return replace(choice, note=note, motion=motion)
            looked += 1
            if clock.left <= 0:
                break
        return self._none(
            f"{item}: {clock.spent} without a free motion of {automaton} to {looked} grasps"
        )

    def _put(
        self, item: str, grasp: int, target: str, spot: Pose, choice: Choice, arm: Arm
    ) -> Choice:
        """The place at the first spot to which the arm brings the item; its path is stored."""
        automaton = str(self.hand.automaton)
        clock = _Clock(float(self.motion_seconds or 0))
        found = find_places(
            self.seen,
            item,
            target,
            gripper=self.hand.gripper,
            grasps=[grasp],
            towards=(spot.x, spot.y),
            arm=arm,
            base=self.base,
            limit=SPOTS,
            levels=self.levels,
        )
        looked = 0
        for row in quickest_first(found.rows, arm):
            if clock.left <= 0:
                break
            seconds = min(clock.left, MOTION)
            try:
                motion = plan_action(self.seen, automaton, self.base, [row], seconds=seconds)
            except ManipulationError as error:  # the arm cannot start from there
                return Choice(refusal=Outcome("unable", f"{item}: {error}"))
            if motion is not None:
                note = "; ".join(filter(None, (choice.note, _told(motion))))
                action, spot = int(row["action_id"]), row["spot"]
                return replace(choice, action=action, note=note, spot=spot, motion=motion)
            looked += 1
        places = f"{looked} places on {target}"
        reason = f"{clock.spent} without a free motion of {automaton} to {places}"
        return Choice(refusal=Outcome("unable", f"{item}: {reason}"))

    def _placeable_first(
        self, item: str, target: str | None, rows: list[dict[str, Any]], at: Pose | None
    ) -> list[dict[str, Any]]:
        """The grasps, first the one with which the object can be put on the target."""
        if target is None:
            return rows
        free_choice = self.hand.automaton is None and not self.trial
        ids = None if free_choice else [int(row["action_id"]) for row in rows]
        place = self._place_on(target, item, ids, at) if at is not None else None
        place = place or self._place_on(target, item, ids)
        if place is None:
            return rows
        best = int(place["grasp_id"])
        first = [row for row in rows if row["action_id"] == best]
        return (first or [{"action_id": best}]) + [r for r in rows if r["action_id"] != best]

    def _place_on(
        self, target: str, item: str, grasps: list[int] | None, at: Pose | None = None
    ) -> dict[str, Any] | None:
        """The best place on a target after some grasps, or any; None without one.

        It is one that the arm reaches from a base `at` a pose of the map's frame.
        """
        gripper = self.hand.gripper
        try:
            with self.seen.session.transaction():
                found = find_places(
                    self.seen,
                    item,
                    target,
                    gripper=gripper,
                    grasps=grasps,
                    arm=None if at is None else self.arm,
                    base=at,
                    limit=1,
                    levels=self.levels,
                )
        except (LookupError, ManipulationError):
            return None  # something without a mesh, or without a level surface
        return next(iter(found.rows), None)

    def _tried(self, item: str, rows: list[dict[str, Any]]) -> Choice:
        """The first grasp that succeeds in a trial; outcomes of the others are stored."""
        made = practise(
            self.seen, item, self.hand.gripper, rows=rows, robot=self.robot, counted=False
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

    def _none(self, why: str, cause: Literal["unable", "unfit"] = "unable") -> Choice:
        assumed = f"; {self._assumption}" if self.hand.assumed else ""
        return Choice(refusal=Outcome(cause, f"{why}{assumed}"))

    @property
    def _assumption(self) -> str:
        return assumption(self.hand.gripper)


class _Clock:
    """How much of a time of the processor is left: others may use it, too."""

    def __init__(self, seconds: float) -> None:
        self._begun, self._seconds = time.process_time(), seconds

    @property
    def left(self) -> float:
        return self._seconds - (time.process_time() - self._begun)

    @property
    def spent(self) -> str:
        return f"{time.process_time() - self._begun:.0f} s"


def _told(motion: ArmMotion) -> str:
    how = "followed again" if motion.reused else "planned"
    return f"path {motion.path} of the arm, {how}"
