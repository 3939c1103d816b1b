"""A plan: actions in order, as the paper prints them (Deeken et al., Figure 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.route import RouteStep
from semmap.geometry.pose import Pose


@dataclass(frozen=True)
class Action:
    """One action of a plan.

    Attributes
    ----------
    name
        pass_door, call_elevator, use_elevator, open_door, pickup, place, or an action of a domain
        file.
    arguments
        Names, as the paper prints them: ``pass_door(door1, lab1, corridor1)``.
    seconds
        Duration, with the drive to where the action begins.
    steps
        The drive and the transition, in order.
    at
        Base pose of pickup, place and look, in the map's frame.
    camera
        Pose of the camera of a look in the map's frame: x ahead, z up.
    entities
        Names of the entities if `arguments` has the words of the goal: muffin1 for ``muffin``.
        Empty if both are the same.
    """

    name: str
    arguments: tuple[str, ...]
    seconds: float = 0.0
    steps: tuple[RouteStep, ...] = ()
    at: Pose | None = None
    entities: tuple[str, ...] = ()
    camera: Pose | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the entities, one for each argument."""
        return self.entities or self.arguments

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True)
class Plan:
    """Actions in order that reach a goal, which is the text that was given.

    Attributes
    ----------
    seconds
        Duration of all actions.
    bound
        Lower bound on the duration of any plan, seconds; equal to `seconds` if the plan is optimal.
    """

    goal: str
    actions: tuple[Action, ...]
    seconds: float
    bound: float

    @property
    def gap(self) -> float:
        """How much longer than the shortest plan this one may be, as a fraction of the bound."""
        if self.optimal:
            return 0.0
        return (self.seconds - self.bound) / self.bound if self.bound > 0 else math.inf

    @property
    def optimal(self) -> bool:
        """Whether no plan is shorter, within a millisecond."""
        return self.seconds <= self.bound + 1e-3

    @property
    def proof(self) -> str:
        """How near to the shortest plan this one surely is, in words."""
        if self.optimal:
            return "no plan is shorter"
        if not self.bound > 0:
            return "it is not known how much shorter a plan may be"
        return f"at most {self.gap:.0%} longer than the lower bound of {self.bound:.1f} s"

    def __repr__(self) -> str:
        return f"<plan of {self.goal}: {len(self.actions)} actions, {self.seconds:.0f} s>"
