"""Missions from goal to end: planned, done step by step, planned anew where a step fails.

Every step is committed as started before the robot acts, and as ended together with what came of
it. A runner that dies leaves at most one step of which nobody knows whether it happened: the next
one asks the robot, writes what is true, and goes on, or plans anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from py_trees.common import Status

from planner.mission.behaviours import Behaviours, Doing, Observation, Outcome
from planner.mission.claims import claims_of
from planner.mission.journal import Journal, LostMissionError
from planner.mission.patience import Patience
from planner.mission.stage import Stage, stages_of, with_spot
from planner.mission.tree import mission_tree
from planner.plan import Plan

__all__ = ["Event", "Planner", "Result", "Runner"]


class Planner(Protocol):
    """Plans from what the map says now."""

    def __call__(
        self, connection: Any, robot: str, goal: str, *, without: frozenset[str] = frozenset()
    ) -> Plan:
        """Actions that reach the goal; none where it is reached.

        Parameters
        ----------
        connection : to the map, in a transaction
        without : things, connectors and elevators that it does not use

        Raises
        ------
        ValueError, LookupError
            There is no plan, with the reason.
        """
        ...


@dataclass(frozen=True)
class Result:
    """How a mission ended: done, failed or cancelled, and why."""

    mission: int
    state: str
    reason: str | None = None


@dataclass(frozen=True)
class Event:
    """Something that a runner did: planned, waits, starts, started, acted, ended, failed, done.

    `said` is in words: the plan's length, what a step said, a reason.
    """

    what: str
    number: int | None = None
    stage: Stage | None = None
    said: str = ""


class Runner:
    """Runs the missions of one robot.

    Parameters
    ----------
    behaviours : the robot
    planner : see `Planner`
    expiry : seconds until a claim expires; it is renewed four times in that
    tick : seconds between two looks at the robot
    speed : how much faster than the wall's the robot's clock runs, as of a simulated one
    width : of the robot, metres, where known: two may pass where both have room
    hear : told what happens
    """

    def __init__(
        self,
        journal: Journal,
        behaviours: Behaviours,
        planner: Planner,
        *,
        patience: Patience | None = None,
        expiry: float = 30.0,
        tick: float = 0.05,
        speed: float = 1.0,
        width: float | None = None,
        hear: Callable[[Event], None] | None = None,
    ) -> None:
        if expiry <= 0 or tick < 0 or speed <= 0:
            raise ValueError(
                f"expiry is {expiry} s, tick {tick} s, speed {speed}; give numbers above 0"
            )
        self._journal = journal
        self._behaviours = behaviours
        self._planner = planner
        self._patience = patience or Patience()
        self._expiry = expiry
        self._tick = tick
        self._speed = speed
        self._width = width
        self._hear = hear or (lambda event: None)

    def run(self, mission: int) -> Result:
        """Run a mission to its end, or go on with it.

        Raises
        ------
        MissionError
            It cannot be taken up.
        LostMissionError
            Another process took it over meanwhile.
        """
        taken = self._journal.take(mission)
        elevators = {
            place.name: place.elevator
            for place in self._journal.topology().places.values()
            if place.elevator is not None
        }
        numbers, stages = self._taken_up(taken.id, taken.begun, taken.planned)
        busy: frozenset[str] = frozenset()
        while True:
            failures = self._journal.failures(mission)
            why = self._patience.at_an_end(failures)
            if why is not None:
                return self._finish(mission, "failed", why)
            if not stages:
                avoided = self._patience.avoided(failures)
                try:
                    plan = self._plan(taken.robot, taken.goal, frozenset(avoided), busy)
                except (ValueError, LookupError) as error:
                    why = "; ".join([str(error), *avoided.values()])
                    return self._finish(mission, "failed", why)
                stages = stages_of(plan)
                if not stages:
                    return self._finish(mission, "done")
                numbers = self._journal.replan(mission, stages)
                self._hear(Event("planned", said=", ".join(map(str, plan.actions))))
            attempt = _Attempt(self, mission, numbers, stages, elevators)
            attempt.work()
            if attempt.cancelled:
                return self._finish(mission, "cancelled")
            busy = frozenset([attempt.busy]) if attempt.busy else frozenset()
            if attempt.failed is not None and attempt.failed.cause not in ("locked", "cancelled"):
                time.sleep(self._patience.wait / self._speed)
            numbers, stages = [], []

    def _taken_up(
        self,
        mission: int,
        begun: tuple[int, Stage] | None,
        planned: Sequence[tuple[int, Stage]],
    ) -> tuple[list[int], list[Stage]]:
        """What is left of a former runner's plan, where it still fits to what is true."""
        seen = self._behaviours.observe()
        fits = True
        if begun is None:
            self._journal.observe(mission, seen)
        else:
            number, stage = begun
            fits = happened(stage, seen)
            outcome = Outcome() if fits else Outcome("interrupted", "its runner died")
            again = []
            if not fits and stage.begins(seen.place, seen.pose):  # nothing of it happened
                again = [stage, *(s for _, s in planned)]
            numbers = self._journal.end(mission, number, stage, outcome, seen, then=again)
            self._hear(Event("ended" if fits else "failed", number, stage, outcome.said))
            if again:
                return numbers, again
        if fits and planned and planned[0][1].begins(seen.place, seen.pose):
            return [n for n, _ in planned], [stage for _, stage in planned]
        return [], []

    def _plan(self, robot: str, goal: str, without: frozenset[str], busy: frozenset[str]) -> Plan:
        if busy - without:  # another way, if there is one
            try:
                return self._asked(robot, goal, without | busy)
            except (ValueError, LookupError):
                pass
        return self._asked(robot, goal, without)

    def _asked(self, robot: str, goal: str, without: frozenset[str]) -> Plan:
        plan: Plan = self._journal.plan(self._planner, robot, goal, without)
        return plan

    def _finish(self, mission: int, state: str, reason: str | None = None) -> Result:
        self._journal.finish(mission, state, reason)
        self._hear(Event(state, said=reason or ""))
        return Result(mission, state, reason)


class _Attempt:
    """One plan at work: what the leaves of its tree do."""

    def __init__(
        self,
        runner: Runner,
        mission: int,
        numbers: Sequence[int],
        stages: Sequence[Stage],
        elevators: dict[str, str],
    ) -> None:
        self._runner = runner
        self._journal = runner._journal
        self._mission = mission
        self._numbers = numbers
        self._stages = list(stages)
        self._claims = claims_of(stages, elevators, runner._width)
        self._mine: str | None = None
        self._beat = -1e9
        self._waits_since: float | None = None
        self.cancelled = False
        self.busy: str | None = None
        self.failed: Outcome | None = None

    def work(self) -> None:
        """Tick the tree until it succeeds or fails."""
        tree = mission_tree(self._stages, self)
        while True:
            tree.tick_once()
            if tree.status is not Status.RUNNING:
                break
            time.sleep(self._runner._tick)
        if self._mine is not None:
            self._journal.release(self._mission, [self._mine])

    def guard(self) -> bool:
        now = time.monotonic()
        if now < self._beat + self._runner._expiry / 4:
            return True
        held = self._journal.beat(self._mission, self._runner._expiry)
        self._beat = now
        self.cancelled = held.state != "running"
        lost = self._mine is not None and self._mine not in held.claims
        if lost:
            self._mine = None
        return not self.cancelled and not lost

    def claim(self, index: int) -> bool | None:
        wanted = self._claims[index]
        if wanted == self._mine:
            return True
        if self._mine is not None:
            self._journal.release(self._mission, [self._mine])
            self._mine = None
        if wanted is None:
            return True
        try:
            held_by_another = self._journal.claim(self._mission, [wanted], self._runner._expiry)
        except LostMissionError:
            self._beat = -1e9  # ask at the next tick what became of it
            return None
        now = time.monotonic()
        if held_by_another is None:
            self._mine, self._waits_since = wanted, None
            return True
        if self._waits_since is None:
            self._waits_since = now
            self._runner._hear(
                Event("waits", self._numbers[index], self._stages[index], f"{wanted} is in use")
            )
        if now - self._waits_since > self._runner._patience.queue / self._runner._speed:
            self.busy = wanted
            return False
        return None

    def begin(self, index: int) -> Doing | None:
        number, stage = self._numbers[index], self._stages[index]
        behaviours = self._runner._behaviours
        if stage.behaviour == "place" and len(stage.arguments) > 1:
            spot = self._journal.spot(
                stage.arguments[0], stage.arguments[1], stage.at or behaviours.observe().pose
            )
            if spot is not None:
                stage = self._stages[index] = with_spot(stage, spot)
        self._runner._hear(Event("starts", number, stage))
        self._journal.start(self._mission, number, stage)
        self._runner._hear(Event("started", number, stage))
        act = getattr(behaviours, stage.behaviour, None)
        if stage.behaviour == "place" and stage.spot is None:
            self.end(index, Outcome("full", f"nothing is free on {stage.arguments[-1]}"))
        elif act is None:
            self.end(index, Outcome("unable", f"the robot has no behaviour {stage.behaviour}"))
        else:
            doing: Doing = act(stage)
            return doing
        return None

    def end(self, index: int, outcome: Outcome) -> None:
        number, stage = self._numbers[index], self._stages[index]
        self._runner._hear(Event("acted", number, stage))
        release = []
        following = self._claims[index + 1] if index + 1 < len(self._claims) else None
        if self._mine is not None and (not outcome.succeeded or following != self._mine):
            release.append(self._mine)
        self._journal.end(
            self._mission, number, stage, outcome, self._runner._behaviours.observe(), release
        )
        if release:
            self._mine = None
        if not outcome.succeeded:
            self.failed = outcome
        self._runner._hear(
            Event("ended" if outcome.succeeded else "failed", number, stage, outcome.said)
        )


def happened(stage: Stage, seen: Observation) -> bool:
    """Whether a robot that observes this has done all of a stage."""
    if stage.behaviour == "pickup":
        return stage.arguments[0] in seen.holds
    if stage.behaviour == "place":
        where = seen.seen.get(stage.arguments[0])
        return where is not None and where.holder == stage.arguments[-1]
    step = stage.step
    if step is None or stage.behaviour == "switch_map":  # of which nothing can be seen
        return False
    if step.connector is not None and step.from_place == step.to_place:
        return seen.doors.get(step.connector.name) in ("open", "ajar")
    return stage.ends(seen.place, seen.pose)
