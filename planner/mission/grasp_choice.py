"""Which grasp takes an object and which place puts it down, by a robot's gripper and arm.

Stored actions come before generated ones. With a trial, each is simulated before the robot acts
(Tosello et al., section IV-C): what fails is stored, and the next one is tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from planner.mission.behaviours import Outcome
from semmap.geometry.pose import Pose

__all__ = ["Choice", "GraspChooser", "Hand", "hand_of"]

GRASPS, REACHED = 400, 24
"""Free grasps of which an arm must reach one, and the most that it reaches that are considered."""

TRIED = 100
"""The most grasps of which trials choose."""


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
    """

    action: int | None = None
    note: str = ""
    refusal: Outcome | None = None
    tried: bool = False


def hand_of(session: Any, name: str, robot_class: str | None, gripper: str | None = None) -> Hand:
    """Return what a robot grasps with; where no gripper is stored, the default one, then stored.

    Parameters
    ----------
    name, robot_class : of the robot, which may be those of a stored automaton
    gripper : name of the gripper that was asked for; by default that of the automaton, else the
        preferred one, else the only one

    Raises
    ------
    LookupError
        There is no such gripper, or there are several and none is preferred.
    """
    from semmap.manipulation.automata import automaton_of
    from semmap.manipulation.retrieval import DEFAULT_GRIPPER, gripper_name

    found = automaton_of(session, name, robot_class)
    if found is not None and gripper in (None, found[1]):
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
    """

    session: Any
    robot: str
    hand: Hand
    base: Pose
    trial: bool = False
    lenient: bool = False

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
        arm = self.hand.automaton is not None
        most = GRASPS if arm else TRIED if self.trial else 1
        found = find_grasps(self.session, name=item, gripper=self.hand.gripper, limit=most)
        rows = [row for row in found.rows if row["entity"] == item]
        if not rows:
            return self._none("; ".join(found.problems) or f"{item}: no grasp is known")
        if arm:
            rows = self._reached(rows)
            if not rows:
                where = f"no free grasp of it is within reach of {self.hand.automaton} here"
                return self._none(f"{item}: {where}")
        rows = self._placeable_first(item, target, rows)
        return self._tried(item, rows) if self.trial else self._chosen(int(rows[0]["action_id"]))

    def place(self, item: str, grasp: int, *, stands: Pose | None = None) -> Choice:
        """Return the place that ends a grasp.

        Parameters
        ----------
        stands : pose of the object before it was taken, in the map's frame; None for no trial
        """
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

    def _reached(self, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
        from semmap.manipulation.automata import reachable_rows, stored_arm

        assert self.hand.automaton is not None
        _, arm = stored_arm(self.session, self.hand.automaton)
        return reachable_rows(rows, arm, self.base, REACHED)

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
        return self._chosen(last["stored"] or last["action_id"], f"{tried} tried in simulation")

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
