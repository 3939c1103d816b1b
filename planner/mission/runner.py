"""Runs missions: plans, commands the robot step by step, and plans again after failures.

Every step is committed as started before the robot acts, and as ended together with its outcome. If
a runner dies, at most one step is left in doubt: the next runner observes the robot, writes what is
true, and continues or plans again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Protocol, TypeVar

from planner.infeasibility import ADD_ONE
from planner.mission.behaviours import Behaviours, Outcome, RobotObservation, RunningBehaviour
from planner.mission.claims import claims_of
from planner.mission.command import Command, commands_of
from planner.mission.retry_policy import RetryPolicy
from planner.mission.store.missions import GoneError, LostMissionError, MissionStore
from planner.plan import Plan
from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot

Answer = TypeVar("Answer")


class Planner(Protocol):
    """Plans on the present state of the map."""

    def __call__(
        self,
        seen: Snapshot,
        robot: str,
        goal: str,
        *,
        without: frozenset[str] = frozenset(),
        tried: frozenset[tuple[str, Pose]] = frozenset(),
    ) -> Plan:
        """The actions that reach the goal on a state of the map; none if it is reached.

        The plan must not use the objects, connectors and elevators `without`, nor the base poses
        `tried`, each with the object that the robot could not reach from it. A ValueError or
        LookupError says why there is no plan.
        """


@dataclass(frozen=True)
class MissionResult:
    """How a mission ended: done, failed or cancelled, and why."""

    mission: int
    state: str
    reason: str | None = None


@dataclass(frozen=True)
class MissionEvent:
    """An event of a runner, with its step, if it belongs to one.

    `kind` is planned, waits, starts, started, acted, ended, failed, done or cancelled. The message
    has the actions of a plan, the message of a step, or a reason.
    """

    kind: str
    number: int | None = None
    command: Command | None = None
    message: str = ""


@dataclass
class Runner:
    """Runs the missions of one robot.

    Attributes
    ----------
    behaviours
        The robot.
    planner
        Makes plans.
    retry_policy
        Limits on failures.
    expiry
        Seconds until a claim expires; it is renewed four times in that time.
    tick
        Seconds between two polls of the robot.
    speed
        How much faster the robot's clock runs than real time; for simulations.
    width
        Of the robot, metres, if known: two robots may pass where both have room.
    on_event
        Called with each event.
    """

    store: MissionStore
    behaviours: Behaviours
    planner: Planner
    _: KW_ONLY
    retry_policy: RetryPolicy = field(default_factory=RetryPolicy)
    expiry: float = 30.0
    tick: float = 0.05
    speed: float = 1.0
    width: float | None = None
    on_event: Callable[[MissionEvent], None] | None = None

    def __post_init__(self) -> None:
        if self.expiry <= 0 or self.tick < 0 or self.speed <= 0:
            raise ValueError(
                f"expiry is {self.expiry} s, tick {self.tick} s, speed {self.speed}; give numbers "
                "above 0"
            )

    def tell(self, event: MissionEvent) -> None:
        """Call `on_event`."""
        if self.on_event is not None:
            self.on_event(event)

    def run(self, mission: int) -> MissionResult:
        """Run a mission to its end; continue it if another runner has begun it.

        Raises MissionError if it cannot be taken over; LostMissionError if another process has
        taken it over in the meantime.
        """
        taken = self.store.take(mission)
        elevators = self.store.topology().elevators()
        numbers, commands = self._taken_up(taken.id, taken.begun, taken.planned)
        busy: frozenset[str] = frozenset()
        while True:
            failures = self.store.failures(mission)
            why = self.retry_policy.reason_to_give_up(failures)
            if why is not None:
                return self._finish(mission, "failed", why)
            if not commands:
                avoided = self.retry_policy.avoided(failures)
                try:
                    tried = self.retry_policy.tried(failures)
                    plan = self._plan(taken.robot, taken.goal, frozenset(avoided), busy, tried)
                except (ValueError, LookupError) as error:
                    left = str(error)
                    if avoided:
                        left = left.replace(ADD_ONE, "; run again once one of them works")
                        left = f"without {', '.join(avoided)}: {left}"
                    last = [f.message for f in failures[-1:] if f.is_of_base and not avoided]
                    why = "; ".join([*avoided.values(), *last, left])
                    return self._finish(mission, "failed", why)
                commands = commands_of(plan)
                if not commands:
                    return self._finish(mission, "done")
                numbers = self.store.replan(mission, commands)
                self.tell(MissionEvent("planned", message=", ".join(map(str, plan.actions))))
            attempt = _Attempt(self, mission, numbers, commands, elevators)
            attempt.work()
            if attempt.cancelled:
                return self._finish(mission, "cancelled")
            busy = frozenset([attempt.busy]) if attempt.busy else frozenset()
            if attempt.failed is not None and attempt.failed.cause not in ("locked", "cancelled"):
                time.sleep(self.retry_policy.wait / self.speed)
            numbers, commands = [], []

    def _taken_up(
        self,
        mission: int,
        begun: tuple[int, Command] | None,
        planned: Sequence[tuple[int, Command]],
    ) -> tuple[list[int], list[Command]]:
        """The rest of the plan of an earlier runner, if it still fits the observations."""
        seen = self.behaviours.observe()
        fits = True
        if begun is None:
            self.store.observe(mission, seen)
        else:
            number, command = begun
            fits = happened(command, seen)
            outcome = Outcome() if fits else Outcome("interrupted", "its runner died")
            again = []
            if not fits and command.begins(seen.place, seen.pose):  # it had no effect
                again = [command, *(s for _, s in planned)]
            numbers = self.store.end(mission, number, command, outcome, seen, then=again)
            self.tell(MissionEvent("ended" if fits else "failed", number, command, outcome.message))
            if again:
                return numbers, again
        if fits and planned and planned[0][1].begins(seen.place, seen.pose):
            return [n for n, _ in planned], [command for _, command in planned]
        return [], []

    def _plan(
        self,
        robot: str,
        goal: str,
        without: frozenset[str],
        busy: frozenset[str],
        tried: frozenset[tuple[str, Pose]],
    ) -> Plan:
        plan = partial(self.store.plan, self.planner, robot, goal, tried=tried)
        if busy - without:  # an alternative, if there is one
            with suppress(ValueError, LookupError):
                return plan(without=without | busy)
        return plan(without=without)

    def _finish(self, mission: int, state: str, reason: str | None = None) -> MissionResult:
        self.store.finish(mission, state, reason)
        self.tell(MissionEvent(state, message=reason or ""))
        return MissionResult(mission, state, reason)


class _Attempt:
    """The execution of one plan."""

    def __init__(
        self,
        runner: Runner,
        mission: int,
        numbers: Sequence[int],
        commands: Sequence[Command],
        elevators: dict[str, str],
    ) -> None:
        self._runner = runner
        self._store = runner.store
        self._mission = mission
        self._numbers = numbers
        self._commands = list(commands)
        self._claims = claims_of(commands, elevators, runner.width)
        self._mine: str | None = None
        self._beat = -1e9
        self._waits_since: float | None = None
        self.cancelled = False
        self.busy: str | None = None
        self._note = ""
        self.failed: Outcome | None = None

    def work(self) -> None:
        """Do one command after another, until one fails or the mission does not continue."""
        for index in range(len(self._commands)):
            if not (self._answer(partial(self.claim, index)) and self._is_done(index)):
                break
        if self._mine is not None:
            self._store.release(self._mission, [self._mine])

    def _answer(self, ask: Callable[[], Answer | None]) -> Answer | None:
        """The answer to a question, which is asked each tick; None if the mission ends before."""
        while self.guard():
            answer = ask()
            if answer is not None:
                return answer
            time.sleep(self._runner.tick)
        return None

    def _is_done(self, index: int) -> bool:
        """Whether a command succeeds; it is stopped if the mission does not continue."""
        doing = self.begin(index)
        if doing is None:
            return False
        outcome = self._answer(doing.poll)
        if outcome is None:
            doing.cancel()
            outcome = Outcome("cancelled", "stopped in the middle")
        self.end(index, outcome)
        return outcome.succeeded

    def guard(self) -> bool:
        """Whether the mission continues."""
        now = time.monotonic()
        if now < self._beat + self._runner.expiry / 4:
            return True
        held = self._store.beat(self._mission, self._runner.expiry)
        self._beat = now
        self.cancelled = held.state != "running"
        lost = self._mine is not None and self._mine not in held.claims
        if lost:
            self._mine = None
        return not self.cancelled and not lost

    def claim(self, index: int) -> bool | None:
        """True if the robot has its claim; None while it waits; False if it gives up."""
        wanted = self._claims[index]
        if wanted == self._mine:
            return True
        if self._mine is not None:
            self._store.release(self._mission, [self._mine])
            self._mine = None
        if wanted is None:
            return True
        try:
            held_by_another = self._store.claim(self._mission, [wanted], self._runner.expiry)
        except GoneError:
            return False  # the next plan does without it
        except LostMissionError:
            self._beat = -1e9  # check the state of the mission at the next tick
            return None
        now = time.monotonic()
        if held_by_another is None:
            self._mine, self._waits_since = wanted, None
            return True
        if self._waits_since is None:
            self._waits_since = now
            self._event("waits", index, f"{wanted} is in use")
        if now - self._waits_since > self._runner.retry_policy.queue / self._runner.speed:
            self.busy = wanted
            return False
        return None

    def begin(self, index: int) -> RunningBehaviour | None:
        """Store that the command begins, and start it; None if it cannot begin."""
        number, command = self._numbers[index], self._commands[index]
        behaviours = self._runner.behaviours
        if command.behaviour == "place" and len(command.arguments) > 1:
            towards = command.at or behaviours.observe().pose
            item, target = command.arguments[:2]
            spot = self._store.spot(item, target, towards, self._mission)
            if spot is not None:
                command = self._commands[index] = replace(command, spot=spot)
        self._event("starts", index)
        choice = self._store.start(self._mission, number, command)
        self._note = choice.note
        command = self._commands[index] = choice.of(command)
        self._event("started", index)
        act = getattr(behaviours, command.behaviour, None)
        if choice.refusal is not None:
            self.end(index, choice.refusal)
        elif command.behaviour == "place" and command.spot is None:
            where = command.arguments[-1]
            self.end(index, Outcome("full", f"nothing is free, and within reach, on {where}"))
        elif act is None:
            self.end(index, Outcome("unable", f"the robot has no behaviour {command.behaviour}"))
        else:
            doing: RunningBehaviour = act(command)
            return doing
        return None

    def end(self, index: int, outcome: Outcome) -> None:
        """Store how the command ended, and its effects."""
        number, command = self._numbers[index], self._commands[index]
        if outcome.succeeded and not outcome.message:
            outcome = replace(outcome, message=self._note)
        self._event("acted", index)
        release = []
        following = self._claims[index + 1] if index + 1 < len(self._claims) else None
        if self._mine is not None and (not outcome.succeeded or following != self._mine):
            release.append(self._mine)
        self._store.end(
            self._mission, number, command, outcome, self._runner.behaviours.observe(), release
        )
        if release:
            self._mine = None
        if not outcome.succeeded:
            self.failed = outcome
        self._event("ended" if outcome.succeeded else "failed", index, outcome.message)

    def _event(self, kind: str, index: int, message: str = "") -> None:
        event = MissionEvent(kind, self._numbers[index], self._commands[index], message)
        self._runner.tell(event)


def happened(command: Command, seen: RobotObservation) -> bool:
    """Whether an observation shows that a command is completed."""
    if command.behaviour == "pickup":
        return command.arguments[0] in seen.holds
    if command.behaviour == "place":
        where = seen.seen.get(command.arguments[0])
        return where is not None and where.holder == command.arguments[-1]
    step = command.step
    if step is None or command.behaviour == "switch_map":  # it cannot be observed
        return False
    if step.connector is not None and step.from_place == step.to_place:
        return seen.doors.get(step.connector.name) in ("open", "ajar")
    return command.ends(seen.place, seen.pose)
